"""Plane waves in a stack of flat layers.

The vertical flux density is B_z = Σ b(z) e^{ik·x}, and in flat layers each wave keeps its pattern
in the plane. In a layer of relative permeability μ and conductivity σ, b'' = γ² b with γ² = k² +
jωμ0μσ. Both b and b'/μ are continuous. A wave from medium a to medium b is reflected with

    ρ = (γ_a/μ_a − γ_b/μ_b)/(γ_a/μ_a + γ_b/μ_b),

and by a layer of thickness d with reflection r beyond it with (ρ + r e^{−2γd})/(1 + ρ r e^{−2γd}),
from the outermost layer inwards (Dodd & Deeds, J. Appl. Phys. 39, 2829 (1968), for a circular coil
over two media; Cheng, Dodd & Deeds, Int. J. NDT 3, 109 (1971), for any number). Without conduction
H = −∇Ψ and b = −μ ∂Ψ/∂z, and the potential is reflected with −ρ. The electric potential above a
board is the same with permittivities, but the copper below holds the potential.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

import numpy as np

from coilarray.compute.arrays import ComplexArray, FloatArray
from coilarray.constants import MU_0
from coilarray.electromagnetics.coil_spectrum import Segments, mirrored_segments

# medium below z = 0: air with the incident field, or electrodes that hold the potential
Base: TypeAlias = Literal["open", "grounded"]


@dataclass(frozen=True)
class Layer:
    """Flat layer: thickness in m, relative permeability, conductivity in S/m or inf."""

    thickness: float
    permeability: float = 1.0
    conductivity: float = 0.0


_AIR = Layer(math.inf)


def with_gaps(bodies: Sequence[tuple[float, Layer]], start: float) -> tuple[Layer, ...]:
    """Return layers at rising heights in m with the air between."""
    layers: list[Layer] = []
    for height, layer in bodies:
        layers += [Layer(height - start)] if height > start else []
        layers.append(layer)
        start = height + layer.thickness
    return tuple(layers)


@dataclass(frozen=True, eq=False)
class LayerWaves:
    """Waves in flat layers and their reflection at the first face.

    `growths` (layers, …, k) are γ in 1/m, inf in a perfect conductor. `beyond` is the reflection r
    at each outer face, and `passed` is 1 − r, which cancellation would lose. `reflection` (…, k) is
    ρ of b at the first face and `potential` 1 − ρ, the potential there over the wave's alone.
    """

    layers: tuple[Layer, ...]
    wavenumbers: FloatArray
    growths: ComplexArray
    beyond: ComplexArray
    passed: ComplexArray
    reflection: ComplexArray
    potential: ComplexArray

    @property
    def faces(self) -> list[ComplexArray]:
        """B at the inner faces and the last outer face, over B at the first."""
        found = [np.ones_like(self.reflection)]
        for number, (r, layer) in enumerate(zip(self.beyond, self.layers, strict=True)):
            fall = self._fall(number, layer.thickness)
            found.append(found[-1] * fall * (1 + r) / (1 + r * fall**2))
        return found

    def at(self, height: float) -> tuple[ComplexArray, ComplexArray]:
        """Return b and its slope in 1/m at a height in m, over b at the first face."""
        edges = np.concatenate(([0.0], np.cumsum([layer.thickness for layer in self.layers])))
        number = int(np.searchsorted(edges, height, side="right")) - 1
        if number >= len(self.layers):
            b = self.faces[-1] * np.exp(-self.wavenumbers * (height - edges[-1]))
            return b, -self.wavenumbers * b
        if math.isinf(self.layers[number].conductivity):
            return np.zeros_like(self.reflection), np.zeros_like(self.reflection)
        growth, r, d = self.growths[number], self.beyond[number], self.layers[number].thickness
        h = height - edges[number]
        out, back = self._fall(number, h), r * self._fall(number, 2 * d - h)
        b = self.faces[number] / (1 + r * self._fall(number, 2 * d))
        return b * (out + back), b * growth * (back - out)

    def _fall(self, number: int, way: float) -> ComplexArray:
        """Decay e^{−γ·way} in a layer over a way in m, 0 in a perfect conductor."""
        if math.isinf(self.layers[number].conductivity):
            return np.zeros_like(self.reflection)
        return np.asarray(np.exp(-self.growths[number] * way))

    def integral(self, number: int) -> ComplexArray:
        """Return ∫ b dz over a layer in m, over b at the first face."""
        growth, r, d = self.growths[number], self.beyond[number], self.layers[number].thickness
        fall = self._fall(number, d)
        return np.asarray(self.faces[number] * (1 - fall) * (1 + r * fall) / growth / (1 + r * fall**2))

    def through(self, number: int, height: FloatArray) -> FloatArray:
        """Potential in an insulating layer over its inner face's, heights (…, 1) in m."""
        k, d = self.wavenumbers, self.layers[number].thickness
        return np.asarray(np.exp(-k * height) * self._left(number, d - height) / self._left(number, d))

    def _left(self, number: int, way: FloatArray | float) -> FloatArray:
        """1 − r e^{−2k·way}."""
        twice = -2 * self.wavenumbers * way
        return np.asarray(-np.expm1(twice) + np.exp(twice) * self.passed[number].real)


def layer_waves(layers: Sequence[Layer], wavenumbers: FloatArray, omega: FloatArray | float = 0.0) -> LayerWaves:
    """Compute the waves in flat layers between air.

    An `omega` (f, 1) in 1/s leads the shapes of the result. A thick layer of the permeability 3
    draws half of the flux in, a perfect conductor sends all back:

    >>> k = np.array([100.0])
    >>> layer_waves([Layer(1.0, 3.0)], k).reflection.real
    array([0.5])
    >>> layer_waves([Layer(1e-3, 1.0, math.inf)], k, 1.0).reflection.real
    array([-1.])
    """
    zero = np.zeros(np.broadcast_shapes(np.shape(omega), wavenumbers.shape), dtype=np.complex128)
    r, passed = zero, zero + 1
    growths, beyond, left = (np.empty((len(layers), *zero.shape), dtype=np.complex128) for _ in range(3))
    outer = _AIR
    for number in range(len(layers) - 1, -1, -1):
        layer = layers[number]
        r, passed = _joined(layer, outer, wavenumbers, omega, r, passed)
        beyond[number], left[number] = r, passed
        if math.isinf(layer.conductivity):
            growths[number], r, passed = math.inf, zero, zero + 1
        else:
            growths[number] = _growth(layer, wavenumbers, omega)
            twice = -2 * growths[number] * layer.thickness
            r, passed = r * np.exp(twice), -np.expm1(twice) + passed * np.exp(twice)
        outer = layer
    r, passed = _joined(_AIR, outer, wavenumbers, omega, r, passed)
    return LayerWaves(tuple(layers), wavenumbers, growths, beyond, left, r, passed)


def _growth(layer: Layer, k: FloatArray, omega: FloatArray | float) -> ComplexArray:
    """Growth γ of a wave in 1/m."""
    return np.asarray(np.sqrt(k**2 + 1j * omega * MU_0 * layer.permeability * layer.conductivity))


def _joined(
    a: Layer, b: Layer, k: FloatArray, omega: FloatArray | float, r: ComplexArray, passed: ComplexArray
) -> tuple[ComplexArray, ComplexArray]:
    """Reflection ρ from medium a to b and 1 − ρ, neither cancelled.

    Behind the face the reflection is r, and `passed` is 1 − r.
    """
    if math.isinf(b.conductivity) or math.isinf(a.conductivity):
        return np.full_like(r, -1.0), np.full_like(r, 2.0)
    mu_a, mu_b = a.permeability, b.permeability
    of_a, of_b = _growth(a, k, omega) * mu_b, _growth(b, k, omega) * mu_a
    eddies = 1j * omega * MU_0 * mu_a * mu_b * (a.conductivity * mu_b - b.conductivity * mu_a)
    face = (k**2 * (mu_b**2 - mu_a**2) + eddies) / (of_a + of_b) ** 2
    both = 1 + face * r
    return np.asarray((face + r) / both), np.asarray(2 * of_b / (of_a + of_b) * passed / both)


@dataclass(frozen=True)
class PassedWaves:
    """Currents behind layers that pass a `share` (k,) of waves e^{k(z' − z)} upwards."""

    eddies: Segments
    share: Callable[[FloatArray], ComplexArray]


@dataclass(frozen=True)
class Backing:
    """Bodies below the coils that return their field.

    `layers` go downwards from a `face` in m below all coils. `eddies` are currents above the face
    for 1 A in each of n coils, with 2n weights each: the real parts, then the imaginary parts.
    `passed` are currents between or below the layers, from above, with the same pieces and weights.
    """

    face: float
    layers: tuple[Layer, ...]
    frequency: float
    eddies: Segments | None = None
    passed: tuple[PassedWaves, ...] = ()

    def sources(self, coils: Sequence[Segments]) -> list[Segments]:
        """Return the coils and, as further coils, the currents below."""
        return [*coils, *([] if self.eddies is None else [self.eddies])]

    def seen(self, coils: Sequence[Segments]) -> list[list[Segments]]:
        """Return the `sources`, their images in the layers, and the `passed`."""
        sources = self.sources(coils)
        if not self.layers:
            return [sources]
        silent = [replace(coil, weights=0 * coil.weights) for coil in coils]
        return [sources, mirrored_segments(sources, self.face), *([*silent, one.eddies] for one in self.passed)]

    def currents(self, coils: int) -> ComplexArray:
        """Currents in the `sources` for 1 A per coil, (sources, coils)."""
        one = np.eye(coils, dtype=np.complex128)
        return one if self.eddies is None else np.concatenate((one, one, 1j * one))

    def reflection(self, wavenumbers: FloatArray) -> ComplexArray:
        """Reflection ρ of b at the face for waves (k,) of mirrored coils."""
        return layer_waves(self.layers, wavenumbers, 2 * math.pi * self.frequency).reflection

    def between(
        self, wavenumbers: FloatArray, thicknesses: Sequence[float], permeabilities: Sequence[float], lift: float = 0.0
    ) -> tuple[ComplexArray, ComplexArray]:
        """Multiple reflections between the backing and sheets above it.

        The first result (k,) is how often each wave arrives at the sheets, 1/(1 − ρ_u ρ e^{−2kD}).
        The second is ρ e^{−2kD} times that, for a wave that leaves z = `lift` downwards.
        """
        back = self.reflection(wavenumbers) * np.exp(-2 * wavenumbers * (lift - self.face))
        often = 1 / (1 + reflection(wavenumbers, thicknesses, permeabilities) * back)
        return often, often * back

    def arriving(
        self, wavenumbers: FloatArray, thicknesses: Sequence[float], permeabilities: Sequence[float], lift: float = 0.0
    ) -> list[ComplexArray]:
        """Part of the waves (k,) of each of the `seen` at flat sheets."""
        often, _ = self.between(wavenumbers, thicknesses, permeabilities, lift)
        ways = [self.reflection(wavenumbers), *(one.share(wavenumbers) for one in self.passed)]
        return [often, *(often * way for way in ways)] if self.layers else [often]


def flat_profile(
    wavenumbers: FloatArray,
    z: FloatArray,
    thicknesses: Sequence[float],
    permeabilities: Sequence[float],
    base: Base = "open",
) -> FloatArray:
    """Total potential g(z) in flat sheets, shape (n, k).

    The incident potential is e^{−kz} from air below ("open"), or electrodes at z = 0 hold the
    potential 1 ("grounded"). Heights `z` (n,) are in m from the lowest sheet's lower face.
    """
    waves = layer_waves(_sheets(thicknesses, permeabilities), wavenumbers)
    profile = np.empty((len(z), len(wavenumbers)))
    below = waves.potential.real if base == "open" else np.ones_like(wavenumbers)
    edge = 0.0
    for number, d in enumerate(thicknesses):
        here = (z >= edge) & (z <= edge + d)
        profile[here] = below * waves.through(number, z[here, None] - edge)
        below = below * waves.through(number, np.array([d]))
        edge += d
    above = z >= edge
    profile[above] = below * np.exp(-wavenumbers * (z[above, None] - edge))
    return profile


def reflection(wavenumbers: FloatArray, thicknesses: Sequence[float], permeabilities: Sequence[float]) -> FloatArray:
    """Reflected potential at the lower face of flat sheets, (k,).

    It is R e^{kz} for an incident e^{−kz}, with pattern and sheets as in `flat_profile`. R = −ρ is
    from −1 to 0. Magnetic sheets draw the flux in, which raises the inductance.
    """
    return np.asarray(-layer_waves(_sheets(thicknesses, permeabilities), wavenumbers).reflection.real)


def _sheets(thicknesses: Sequence[float], permeabilities: Sequence[float]) -> list[Layer]:
    return [Layer(d, mu) for d, mu in zip(thicknesses, permeabilities, strict=True)]
