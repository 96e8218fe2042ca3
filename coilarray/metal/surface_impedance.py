"""Surface impedance of a plate of any thickness against its skin depth.

Currents on both faces of a plate in air stand for those in it. With k² = jωµ0σ and κ the wavenumber along the plate, a
vector potential that is even about the mid-plane is A cosh(γz)/cosh(γt/2) in the metal, γ² = κ² + k², but would be
A cosh(κz)/cosh(κt/2) in air, so that the current of each face, the jump of H from air within to air without, is
A (γ tanh(γt/2) − κ tanh(κt/2))/µ0; an odd one has coth for tanh. For fields that are wide against t or the skin depth
(κ → 0) the ratio of A to that current is

    λ_even = µ0/(k tanh(kt/2)),   λ_odd = µ0/(k coth(kt/2) − 2/t),

and Z = jωλ: for t ≪ δ the sheet's 2/σt on each face and 6/σt, for t ≫ δ both (1 + j)/σδ. At the rim, in the corner of a
strip of metal, p_n = (2n + 1)π/t,

    F = Σ 8 k²/((2n + 1)²π² (p_n² + k²)^{3/2}),   λ_along = µ0/(k² F),   λ_across = µ0 F/(1 − tanh(kt/2)/(kt/2)),

are the current along the rim beyond that of the faces (A = 1 on all sides of the strip), and the flux beyond theirs
(H = 1 on all sides): the same (1 + j)/σδ for t ≫ δ, and no current along it for t ≪ δ, where the faces carry all.
"""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass

import numpy as np

from coilarray.constants import MU_0
from coilarray.geometry.material import Material

_TERMS = 4096  # of F, whose rest falls as their number squared, or in thick plates by itself
_STIFF = 1e-6  # of the thickness: least |F|, beyond which the rim's current along it is none to double precision


@dataclass(frozen=True)
class SurfaceImpedance:
    """Z/jω in H of the faces for even and odd fields, and of the rim for currents along it and across it."""

    even: complex
    odd: complex
    along: complex
    across: complex


def surface_impedance(material: Material, thickness: float, frequency: float) -> SurfaceImpedance:
    """Compute the impedances of a plate of a metal that is not magnetic; thickness in m, frequency in Hz, positive."""
    if math.isinf(material.conductivity):
        return SurfaceImpedance(0, 0, 0, 0)
    k = (1 + 1j) / material.skin_depth(frequency)
    x = k * thickness / 2
    # 1 − tanh(x)/x without cancellation
    tanh = cmath.tanh(x) if x.real < 20 else 1.0
    short = x * x / 3 * (1 - 2 * x * x / 5 * (1 - 17 * x * x / 42)) if abs(x) < 0.05 else 1 - tanh / x
    odd_number = 2 * np.arange(_TERMS) + 1
    p = odd_number * np.pi / thickness
    F = complex((8 * k**2 / (odd_number**2 * np.pi**2 * (p**2 + k**2) ** 1.5)).sum())
    F += _STIFF * thickness * (1 - 1j) if abs(F) < _STIFF * thickness else 0
    return SurfaceImpedance(
        even=MU_0 / (k * tanh),
        odd=MU_0 * tanh / (k * short),
        along=MU_0 / (k**2 * F),
        across=MU_0 * F / short,
    )


def model_error(material: Material, thickness: float, frequency: float, scale: float) -> float:
    """Relative error of the reflection of a plate without end, by λ at κ = 0 against that at κ = 2/`scale` in 1/m.

    With e = e^{−κt}, R = −½ Σ± (1 ± e)/(1 + 2κλ/(µ0 (1 ± e))): each face lies in the field of both.
    """
    if math.isinf(material.conductivity):
        return 0.0
    kappa = 2 / scale
    gamma = cmath.sqrt(kappa**2 + (1 + 1j) ** 2 / material.skin_depth(frequency) ** 2)
    local = surface_impedance(material, thickness, frequency)
    tanh, own = (
        cmath.tanh(min(gamma.real, 40 / thickness) * thickness / 2 + 0.5j * gamma.imag * thickness),
        math.tanh(kappa * thickness / 2),
    )
    exact = MU_0 / (gamma * tanh - kappa * own), MU_0 / (gamma / tanh - kappa / own)
    e = math.exp(-kappa * thickness)
    reflections = [
        sum(part / (1 + 2 * kappa * value / (MU_0 * part)) for part, value in ((1 + e, even), (1 - e, odd)))
        for even, odd in (exact, (local.even, local.odd))
    ]
    return abs(reflections[1] / reflections[0] - 1)
