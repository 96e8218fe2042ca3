"""Surface impedance of a plate of any thickness.

Currents on both faces of a plate in air represent the currents in it. With k² = jωµ0σ and κ the
wavenumber along the plate, a vector potential that is even about the mid-plane is A
cosh(γz)/cosh(γt/2) in the metal, γ² = κ² + k². In air it would be A cosh(κz)/cosh(κt/2). So the
current of each face, the jump of H from the air solution inside to the air outside, is A (γ
tanh(γt/2) − κ tanh(κt/2))/µ0. An odd potential has coth in place of tanh. The ratio of A to the
current is

    λ_even = µ0/(γ tanh(γt/2) − κ tanh(κt/2)),   λ_odd = µ0/(γ coth(γt/2) − κ coth(κt/2)),

and Z = jωλ. For patterns that are wide compared with t or the skin depth (κ → 0) it no longer
depends on κ. For t ≪ δ it is the sheet's 2/σt on each face and 6/σt, for t ≫ δ both are (1 + j)/σδ.
A single κ is used for all patterns, the wavenumber of the coils' field, which is 2 over the sum of
their radius and distance. If the skin depth is large, the field in the metal is the coils' field,
for any pattern of the currents. If it is small, κ hardly counts. At the rim, in the corner of a
strip of metal, p_n = (2n + 1)π/t,

    F = Σ 8 k²/((2n + 1)²π² (p_n² + k²)^{3/2}),
    λ_along = µ0/(k² F),   λ_across = µ0 F/(1 − tanh(kt/2)/(kt/2)),

are the current along the rim beyond the current of the faces (A = 1 on all sides of the strip), and
the flux beyond the flux of the faces (H = 1 on all sides). For t ≫ δ both are the same (1 + j)/σδ.
For t ≪ δ there is no current along the rim, as the faces carry all of it.
"""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass, replace

import numpy as np

from coilarray.constants import MU_0
from coilarray.electromagnetics.flat_stack import Layer, layer_waves
from coilarray.geometry.bodies import Material

_TERMS = 4096  # of F, whose remainder falls as their number squared, or in thick plates by itself
_STIFF = 1e-6  # of the thickness: below this |F| the rim carries no current along it, to double precision
_WEAK = 1e-6  # |k²| over κ² + 4/t², below which differences are taken by the derivative
# discs of copper within a loop, by finite elements: the error of ΔL is 0.2 to 0.35 of the skin
# depth over the radius, the error of ΔR −11 % at 21 skin depths of thickness, −8 % at 11, −1 % at 4
# and 13 % at 2. It is less in thinner discs, whose currents flow through the whole thickness and
# are taken at faces and rim. For ΔL the first value is of half the thickness, or of the skin depth
# if that is less
_AT_RIM = 0.5, 0.13
_THIN = 2.0  # skin depths
_DEEP = 20.0  # real part of γt/2, beyond which tanh is 1


@dataclass(frozen=True)
class SurfaceImpedance:
    """λ = Z/jω in H of faces (even, odd) and rim (along, across)."""

    even: complex
    odd: complex
    along: complex
    across: complex


def surface_impedance(material: Material, thickness: float, frequency: float, kappa: float) -> SurfaceImpedance:
    """Compute the impedances of a plate without iron, in SI units."""
    if math.isinf(material.conductivity):
        return SurfaceImpedance(0, 0, 0, 0)
    even, odd = _faces(material, thickness, frequency, kappa)
    k = (1 + 1j) / material.skin_depth(frequency)
    x = k * thickness / 2
    # 1 − tanh(x)/x without cancellation
    short = x * x / 3 * (1 - 2 * x * x / 5 * (1 - 17 * x * x / 42)) if abs(x) < 0.05 else 1 - _tanh(x) / x
    odd_number = 2 * np.arange(_TERMS) + 1
    p = odd_number * np.pi / thickness
    F = complex((8 * k**2 / (odd_number**2 * np.pi**2 * (p**2 + k**2) ** 1.5)).sum())
    F += _STIFF * thickness * (1 - 1j) if abs(F) < _STIFF * thickness else 0
    return SurfaceImpedance(even, odd, along=MU_0 / (k**2 * F), across=MU_0 * F / short)


@dataclass(frozen=True)
class ModelError:
    """Estimated relative errors of a plate's ΔL and ΔR.

    `whole` is the error of ΔL − jΔR/ω, `depths` the thickness in skin depths, 0 if perfect.
    """

    whole: float = 0.0
    inductance: float = 0.0
    resistance: float = 0.0
    depths: float = 0.0

    def times(self, share: float) -> ModelError:
        """Return a share of the errors."""
        return replace(
            self, whole=share * self.whole, inductance=share * self.inductance, resistance=share * self.resistance
        )

    def or_worse(self, other: ModelError) -> ModelError:
        """Return the larger of each error, with its depths for ΔR."""
        return ModelError(
            max(self.whole, other.whole),
            max(self.inductance, other.inductance),
            max(self.resistance, other.resistance),
            max(self, other, key=lambda one: one.resistance).depths,
        )


def model_error(material: Material, thickness: float, frequency: float, taken: float, kappa: float) -> ModelError:
    """Errors of an infinite plate's reflection for the wavenumber `kappa`.

    They are due to λ at the κ `taken`, both in 1/m. With e = e^{−κt}, R = −½ Σ± (1 ± e)/(1 +
    2κλ/(µ0 (1 ± e))), as each face lies in the field of both. A magnetic plate has R = (κℓ − 1)/(κℓ
    + 1) by `coilarray.metal.magnetic_plates`, and errors of |R|. The edges' error comes with its
    solution.
    """
    if math.isinf(material.conductivity):
        return ModelError()
    depths = thickness / material.skin_depth(frequency)
    if material.relative_permeability != 1:
        way = kappa * material.relative_permeability * material.skin_depth(frequency) * (1 - 1j) / 2
        layer = Layer(thickness, material.relative_permeability, material.conductivity)
        wave = complex(layer_waves([layer], np.array([kappa]), 2 * np.pi * frequency).reflection[0])
        wide = abs((way - 1) / (way + 1) - wave) / abs(wave)
        return ModelError(wide, wide, wide, depths)
    e = math.exp(-kappa * thickness)
    found, exact = (
        sum(part / (1 + 2 * kappa * value / (MU_0 * part)) for part, value in zip((1 + e, 1 - e), values, strict=True))
        for values in (_faces(material, thickness, frequency, at) for at in (taken, kappa))
    )
    real, imaginary = abs(found.real / exact.real - 1), abs(found.imag / exact.imag - 1)
    return ModelError(abs(found / exact - 1), real, imaginary, depths)


def own_share(material: Material, thickness: float, frequency: float, kappa: float) -> float:
    """Share of currents' own field in their driving field (perfect conductors: 1)."""
    if math.isinf(material.conductivity):
        return 1.0
    even, _ = _faces(material, thickness, frequency, kappa)
    return 1 / abs(1 + 2 * kappa * even / (MU_0 * (1 + math.exp(-kappa * thickness))))


def with_rim(error: ModelError, thickness: float, inscribed: float, nearest: float, margin: float) -> ModelError:
    """Add the error by a non-magnetic plate's sharp rim.

    The model includes only the mean current of the rim. `nearest` is the distance d in m between
    the planes of plate and coils, `margin` m the extension of the plate beyond the coils. The eddy
    currents that a coil induces there fall as d²/(d² + m²), and the losses as their square.
    """
    share = (1 + (margin / nearest) ** 2) ** -2
    L, R = _AT_RIM
    of_L = L * thickness / max(error.depths, 2.0) / inscribed
    of_R = R * min((error.depths / _THIN) ** 2, 1.0)
    return replace(error, inductance=error.inductance + of_L * share, resistance=error.resistance + of_R * share)


def _faces(material: Material, t: float, frequency: float, kappa: float) -> tuple[complex, complex]:
    """Impedances λ in H for even and odd fields at κ in 1/m."""
    k2 = 2j / material.skin_depth(frequency) ** 2
    own, tanh_own = kappa * t / 2, math.tanh(kappa * t / 2)
    if abs(k2) < _WEAK * (kappa**2 + 4 / t**2):
        even = k2 * t / 4 * (tanh_own / own + 1 - tanh_own**2)
        if own < 0.05:
            odd = k2 * t / 6 * (1 - 2 * own**2 / 15)
        else:
            odd = k2 * t / 4 * (1 / (own * tanh_own) - 1 / math.sinh(own) ** 2)
        return MU_0 / even, MU_0 / odd
    gamma = cmath.sqrt(kappa**2 + k2)
    tanh = _tanh(gamma * t / 2)
    return MU_0 / (gamma * tanh - kappa * tanh_own), MU_0 / (gamma / tanh - kappa / tanh_own)


def _tanh(x: complex) -> complex:
    return cmath.tanh(x) if x.real < _DEEP else 1.0
