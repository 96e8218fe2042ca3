"""Plane waves and harmonics of the coils' field, and waves in flat layers.

Above a closed current path H = −∇Ψ with

    Ψ(x, y, z) = ∫∫ d²k/(2π)² S(k, α) e^{ik·(x, y)} e^{−kz},
    S = i/(2k) Σ ∮ (cos α dy − sin α dx) e^{−ik·(x, y)} e^{kz},

from the vector potential of the segments with 1/(4π|r|) = ∫∫ d²k/(2π)² e^{ik·(x, y)}
e^{−k|z|}/(2k). About a point p the plane waves become harmonics of the angle θ (Jacobi–Anger),

    Ψ = Σ_m e^{imθ} ∫ k dk/(2π) c_m(k) J_m(kr) e^{−kz},
    c_m(k) = i^m/(2π) ∫ dα S(k, α) e^{ik·p} e^{−imα}.

By Green's theorem 2 S is also the Fourier transform of a function that is 1 inside the path and 0
outside (path at z = 0, anticlockwise). So weighted paths make any piecewise constant potential.

The vertical flux density is B_z = Σ b(z) e^{ik·x}, and in flat layers each wave keeps its pattern
in the plane, b'' = γ² b. Both b and b'/μ are continuous, so that faces and layers reflect waves
with ρ and r of docs/theory/metal.md, "Infinite plates". Without conduction H = −∇Ψ and b = −μ
∂Ψ/∂z, and the potential is reflected with −ρ. The electric potential above a board is the same with
permittivities, but the copper below holds the potential.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.polynomial.legendre import leggauss

from coilarray.compute.arrays import ComplexArray, FloatArray
from coilarray.compute.threads import ranges, run_blocks
from coilarray.constants import MU_0
from coilarray.electromagnetics.field import Source, as_conductors, first_of_each

_SAME_SHAPE = 1e-9  # of the size; coils that differ by less share a spectrum
_AT_ONCE = 16  # wavenumbers of a grid, which limits the memory
_OFFSETS = 512  # positions from coils at a time, which limits the memory
_SPARE_ANGLES = 40  # above the bandwidth; the rest decays like the Bessel functions beyond their turning point


@dataclass(frozen=True, eq=False)
class Segments:
    """Straight pieces of the closed paths of a coil, in m.

    `weights` (n,) are the shares of the pieces in S: their current per current of the coil, or for
    an electrode twice the potential inside. Weights (n, m) make m coils of the same pieces.
    """

    start: FloatArray
    stop: FloatArray
    weights: FloatArray

    @property
    def count(self) -> int:
        """Number of coils."""
        return 1 if self.weights.ndim == 1 else self.weights.shape[1]


@dataclass(frozen=True, eq=False)
class CoilSpectra:
    """Spectra of coils about their own centres.

    `wavenumbers` (k,) are in 1/m. `radius` in m is the largest distance of a corner. `series` is
    the Fourier series of S over α, by shape and wavenumber, in m per A (electrode: m² per V).
    """

    wavenumbers: FloatArray
    centres: FloatArray
    radius: float
    shape_of: tuple[int, ...]
    series: tuple[tuple[ComplexArray, ...], ...]


def coil_segments(source: Source) -> list[Segments]:
    """Segments of current paths at z ≤ 0, open ones closed by a straight line."""
    vertices = [conductor.vertices for conductor in as_conductors(source)]
    return [Segments(v, np.roll(v, -1, axis=0), np.ones(len(v))) for v in vertices]


def mirrored_segments(coils: Sequence[Segments], height: float) -> list[Segments]:
    """Mirror coil segments and currents at a height in m."""
    flip, lift = np.array([1.0, 1.0, -1.0]), np.array([0.0, 0.0, 2 * height])
    return [replace(coil, start=coil.start * flip + lift, stop=coil.stop * flip + lift) for coil in coils]


def segment_centres(coils: Sequence[Segments]) -> tuple[FloatArray, float]:
    """Centres (coils, 2) of the coils' bounding rectangles and largest radius, in m."""
    plane = [np.concatenate((coil.start, coil.stop))[:, :2] for coil in coils]
    centres = np.array([(points.min(axis=0) + points.max(axis=0)) / 2 for points in plane])
    radius = max(float(np.hypot(*(points - centre).T).max()) for points, centre in zip(plane, centres, strict=True))
    return np.repeat(centres, [coil.count for coil in coils], axis=0), radius


def segment_spectra(coils: Sequence[Segments], wavenumbers: FloatArray) -> CoilSpectra:
    """Spectra at wavenumbers in 1/m of coils at z ≤ 0, by shape."""
    centres, radius = segment_centres(coils)
    first = np.cumsum([0, *(coil.count for coil in coils[:-1])])
    own = [
        replace(coil, start=coil.start - [*centre, 0.0], stop=coil.stop - [*centre, 0.0])
        for coil, centre in zip(coils, centres[first], strict=True)
    ]
    ends = [np.column_stack((np.hstack((one.start, one.stop)) / radius, one.weights)) for one in own]
    # as integers, as −0.0 and 0.0 have different bytes
    examples, number = first_of_each(np.round(each / _SAME_SHAPE).astype(np.int64).tobytes() for each in ends)
    shapes = [own[k] for k in examples]
    begin = np.cumsum([0, *(shape.count for shape in shapes)])
    shape_of = [int(begin[k]) + m for k in number.tolist() for m in range(shapes[k].count)]
    rows = [run_blocks(lambda k, shape=shape: _series(shape, k, radius), wavenumbers.tolist()) for shape in shapes]  # type: ignore[misc]
    series = tuple(tuple(one) for bundle in rows for one in zip(*bundle, strict=True))
    return CoilSpectra(wavenumbers, centres, radius, tuple(shape_of), series)


def turned_spectra(spectra: CoilSpectra, slope: tuple[float, float]) -> CoilSpectra:
    """Turn every coil about its centre by a small slope.

    The derivative by k needs the wavenumbers of `wave_rule`.
    Let n be the direction α, n' the direction across it, f = slope·n and f' = slope·n'. To first
    order its waves are the flat coil's with k (1 − i f) and α − i f', and k S becomes

        S + δS,   δS = −i (f ∂(k S)/∂k + f' ∂S/∂α).
    """
    if slope == (0.0, 0.0):
        return spectra
    k = spectra.wavenumbers
    # differentiation matrix at Gauss–Legendre nodes (Berrut & Trefethen, SIAM Rev. 46, 2004)
    x, weights = leggauss(len(k))
    weights = np.sqrt((1 - x**2) * weights) * (-1.0) ** np.arange(len(x))
    distance = k[:, None] - k
    np.fill_diagonal(distance, 1.0)
    derivative = weights / weights[:, None] / distance
    np.fill_diagonal(derivative, 0.0)
    np.fill_diagonal(derivative, -derivative.sum(axis=1))
    fall = complex(*slope) / 2  # f = fall e^{−iα} + its conjugate, f' = −i fall e^{−iα} + its conjugate

    def turned(series: Sequence[ComplexArray]) -> tuple[ComplexArray, ...]:
        size = len(series[-1])  # the highest wavenumber has the most orders
        flat = np.array([_padded(one, size) for one in series])
        by_k = derivative @ (k[:, None] * flat)
        by_angle = np.fft.fftfreq(size, 1 / size) * flat  # i times it is the derivative
        lower, higher = fall * (by_k + by_angle), fall.conjugate() * (by_k - by_angle)
        falling = flat - 1j * (np.roll(lower, -1, axis=1) + np.roll(higher, 1, axis=1))
        halves = (len(one) // 2 for one in series)
        return tuple(np.concatenate((row[:half], row[-half:])) for row, half in zip(falling, halves, strict=True))

    return replace(spectra, series=tuple(map(turned, spectra.series)))


def coil_harmonics(spectra: CoilSpectra, shape: int, offsets: FloatArray, highest: int) -> FloatArray:
    """Harmonics c_m(k) of a coil's potential in m/A.

    They are (highest + 1, 2, k, n), real and imaginary. In opposite directions S e^{ik·p} are
    conjugates, so half a circle suffices: 2 Re for even m and 2i Im for odd m.
    """
    (x, of_x), (y, of_y) = (np.unique(values, return_inverse=True) for values in offsets.T)
    distance = float(np.hypot(*offsets.T).max(initial=0.0))
    harmonics = np.empty((highest + 1, 2, len(spectra.wavenumbers), len(offsets)))
    for index, k in enumerate(spectra.wavenumbers.tolist()):
        half = _angles(k * (distance + spectra.radius) + highest) // 2
        alpha = np.pi * np.arange(half) / half
        spectrum = _on_angles(spectra.series[shape][index], 2 * half)[:half]
        wave = (spectrum * np.exp(1j * np.outer(x, k * np.cos(alpha))))[of_x]
        wave *= np.exp(1j * np.outer(y, k * np.sin(alpha)))[of_y]
        for odd, part in enumerate((wave.real, wave.imag)):
            m = np.arange(odd, highest + 1, 2)
            factor = (-1.0) ** ((m + odd) // 2) / half  # of them i^m, or i^(m+1)
            turns = np.stack((np.cos(np.outer(m, alpha)), -np.sin(np.outer(m, alpha))), axis=1) * factor[:, None, None]
            harmonics[m, :, index] = (turns.reshape(-1, half) @ part.T).reshape(len(m), 2, len(offsets))
    return harmonics


def harmonics_about(spectra: CoilSpectra, points: FloatArray, highest: int) -> ComplexArray:
    """`coil_harmonics` of all coils about points in m, (k, points, coils, highest + 1)."""
    shapes = np.array(spectra.shape_of)
    found = np.empty((len(spectra.wavenumbers), len(points), len(shapes), highest + 1), dtype=np.complex128)

    def about(block: tuple[int, int]) -> None:
        rows = slice(*block)
        for shape in range(len(spectra.series)):
            of_shape = np.flatnonzero(shapes == shape)
            offsets = points[rows, None] - spectra.centres[of_shape]
            real, imaginary = np.moveaxis(coil_harmonics(spectra, shape, offsets.reshape(-1, 2), highest), 1, 0)
            values = (real + 1j * imaginary).reshape(*real.shape[:2], *offsets.shape[:2])
            found[:, rows, of_shape] = values.transpose(1, 2, 3, 0)

    run_blocks(about, ranges(len(points), max(1, _OFFSETS // len(shapes))))
    return found


def gradients_on_grid(
    spectra: CoilSpectra, x: FloatArray, y: FloatArray, weights: FloatArray, profiles: FloatArray, slopes: FloatArray
) -> FloatArray:
    """Gradient of every coil's potential on a grid in 1/m.

    The result (coils, 3, planes, nx, ny) is for 1 A. `profiles` (planes, k) are the potential over
    its value at z = 0 in each wave, `slopes` its derivative by the height in 1/m.
    """
    corners = np.array(np.meshgrid(x[[0, -1]], y[[0, -1]])).reshape(2, -1).T
    distance = np.hypot(*(corners[:, None] - spectra.centres).T).max()

    def at(index: int) -> FloatArray:
        k = float(spectra.wavenumbers[index])
        n = _angles(k * (distance + spectra.radius))
        half = slice(0, n // 2)  # the waves of opposite directions are conjugates
        alpha = 2 * np.pi * np.arange(n // 2) / n
        kx, ky = k * np.cos(alpha), k * np.sin(alpha)
        own = [_on_angles(series[index], n)[half] for series in spectra.series]
        along_x, along_y = np.exp(1j * np.outer(x, kx)), np.exp(-1j * np.outer(y, ky))
        wave = np.array([own[shape] for shape in spectra.shape_of]) * (k / np.pi / n)
        wave = wave * np.exp(-1j * spectra.centres @ np.array([kx, ky]))
        parts = wave[:, None] * np.array([1j * kx, 1j * ky, np.ones_like(kx)])
        # Re(u v) of complex numbers is the product of (Re u, Im u) with (Re v, −Im v)
        left = (parts[:, :, None] * along_x).reshape(-1, len(kx)).view(np.float64)
        return np.asarray((left @ along_y.view(np.float64).T).reshape(*parts.shape[:2], len(x), len(y)))

    total = np.zeros((len(spectra.centres), 3, len(profiles), len(x), len(y)))
    for start, stop in ranges(len(spectra.wavenumbers), _AT_ONCE):
        numbers = range(start, stop)
        for k, waves in zip(numbers, run_blocks(at, numbers), strict=True):
            total[:, :2] += waves[:, :2, None] * (weights[k] * profiles[:, k])[:, None, None]
            total[:, 2] += waves[:, 2, None] * (weights[k] * slopes[:, k])[:, None, None]
    return total


def wave_count(highest: float, extent: float) -> int:
    """Count the nodes up to `highest` in 1/m, two per period of an extent in m."""
    return math.ceil(highest * extent / np.pi) + 20


def wave_rule(highest: float, count: int) -> tuple[FloatArray, FloatArray]:
    """Gauss–Legendre nodes and weights (count,) from 0 to `highest`, in 1/m."""
    nodes, weights = np.polynomial.legendre.leggauss(count)
    return (nodes + 1) / 2 * highest, weights / 2 * highest


def _angles(bandwidth: float) -> int:
    """Even number of angles for a bandwidth in radians/radian."""
    return 2 * (int(np.ceil(bandwidth)) + _SPARE_ANGLES // 2)


def _series(shape: Segments, k: float, radius: float) -> ComplexArray:
    """Fourier series of S(k, α) over α of closed paths, (coils, n) in numpy's order."""
    n = _angles(k * radius)
    alpha = 2 * np.pi * np.arange(n // 2) / n  # S(k, α + π) is the conjugate
    cos, sin = np.cos(alpha), np.sin(alpha)
    step, middle = shape.stop - shape.start, (shape.stop + shape.start) / 2
    flat = np.hypot(step[:, 0], step[:, 1]) > 0  # vertical segments make no field along z
    (dx, dy, dz), (x, y, z) = step[flat].T[:, :, None], middle[flat].T[:, :, None]
    # ∫ e^{−ik·x} e^{kz} along a segment is the value in its middle times sinh(w)/w, w = k (dz −
    # i(dx cos α + dy sin α))/2.
    turns = k * (dx * cos + dy * sin) / (2 * np.pi)
    mean: Any = np.sinc(turns)
    if (sloping := dz[:, 0] != 0).any():  # few, and complex numbers take as long as the rest
        mean = mean + 0j
        mean[sloping] = np.sinc(turns[sloping] + 0.5j * k * dz[sloping] / np.pi)
    wave = np.exp(k * z - 1j * k * (x * cos + y * sin)) * mean
    weights = shape.weights[flat].reshape(len(dx), -1)
    along_x, along_y = ((weights * step).T @ wave for step in (dx, dy))
    half = 0.5j / k * (along_y * cos - along_x * sin)
    return np.asarray(np.fft.fft(np.concatenate((half, half.conj()), axis=1)) / n)


def _on_angles(series: ComplexArray, n: int) -> ComplexArray:
    """Values of a Fourier series at n equal angles, n ≥ its length."""
    return np.asarray(np.fft.ifft(_padded(series, n)) * n)


def _padded(series: ComplexArray, n: int) -> ComplexArray:
    """Fourier series extended to n orders in numpy's order."""
    half = len(series) // 2
    padded = np.zeros(n, dtype=np.complex128)
    padded[:half], padded[-half:] = series[:half], series[-half:]
    return padded


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
    """Compute the waves in flat layers between air, shapes led by an `omega` (f, 1) in 1/s."""
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
    """Reflection ρ from medium a to b and 1 − ρ, neither cancelled, r and 1 − r behind the face."""
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
    wavenumbers: FloatArray, z: FloatArray, thicknesses: Sequence[float], permeabilities: Sequence[float]
) -> FloatArray:
    """Total potential g(z) in flat sheets, shape (n, k).

    The incident potential is e^{−kz} from air below. Heights `z` (n,) are in m from the lowest
    sheet's lower face.
    """
    waves = layer_waves(_sheets(thicknesses, permeabilities), wavenumbers)
    profile = np.empty((len(z), len(wavenumbers)))
    below = waves.potential.real
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
