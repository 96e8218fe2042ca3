"""Plane waves and harmonics of the coils' field on a sheet.

Above a closed current path H = −∇Ψ with

    Ψ(x, y, z) = ∫∫ d²k/(2π)² S(k, α) e^{ik·(x, y)} e^{−kz},
    S = i/(2k) Σ ∮ (cos α dy − sin α dx) e^{−ik·(x, y)} e^{kz},

from the vector potential of the segments with 1/(4π|r|) = ∫∫ d²k/(2π)² e^{ik·(x, y)}
e^{−k|z|}/(2k). About a point p the plane waves become harmonics of the angle θ (Jacobi–Anger),

    Ψ = Σ_m e^{imθ} ∫ k dk/(2π) c_m(k) J_m(kr) e^{−kz},
    c_m(k) = i^m/(2π) ∫ dα S(k, α) e^{ik·p} e^{−imα}.

By Green's theorem 2 S is also the Fourier transform of a function that is 1 inside the path and 0
outside (path at z = 0, anticlockwise). So weighted paths make any piecewise constant potential.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.polynomial.legendre import leggauss

from coilarray.compute.arrays import ComplexArray, FloatArray
from coilarray.compute.threads import ranges, run_blocks
from coilarray.electromagnetics.source import Source, as_conductors

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
    """Segments of current paths at z ≤ 0.

    A path whose ends lie apart is closed by a straight line between them, since only a closed
    current has a potential.
    """
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
    known: dict[bytes, int] = {}
    shapes: list[Segments] = []
    shape_of: list[int] = []
    first = np.cumsum([0, *(coil.count for coil in coils[:-1])])
    for coil, centre in zip(coils, centres[first], strict=True):
        shape = replace(coil, start=coil.start - [*centre, 0.0], stop=coil.stop - [*centre, 0.0])
        ends = np.hstack((shape.start, shape.stop)) / radius
        # as integers, as −0.0 and 0.0 have different bytes
        key = np.round(np.column_stack((ends, shape.weights)) / _SAME_SHAPE).astype(np.int64).tobytes()
        if key not in known:
            known[key] = sum(one.count for one in shapes)
            shapes.append(shape)
        shape_of += range(known[key], known[key] + shape.count)
    rows = [run_blocks(lambda k, shape=shape: _series(shape, k, radius), wavenumbers.tolist()) for shape in shapes]  # type: ignore[misc]
    series = tuple(tuple(one) for bundle in rows for one in zip(*bundle, strict=True))
    return CoilSpectra(wavenumbers, centres, radius, tuple(shape_of), series)


def turned_spectra(spectra: CoilSpectra, slope: tuple[float, float]) -> CoilSpectra:
    """Turn every coil about its centre by a small slope.

    The derivative by k needs the wavenumbers of `coilarray.electromagnetics.plane_waves.wave_rule`.
    Let n be the direction α, n' the direction across it, f = slope·n and f' = slope·n'. To first
    order its waves are the flat coil's with k (1 − i f) and α − i f', and k S becomes

        S + δS,   δS = −i (f ∂(k S)/∂k + f' ∂S/∂α).
    """
    if slope == (0.0, 0.0):
        return spectra
    k = spectra.wavenumbers
    derivative = _derivative(k)
    fall = complex(*slope) / 2  # f = fall e^{−iα} + its conjugate, f' = −i fall e^{−iα} + its conjugate

    def turned(series: Sequence[ComplexArray]) -> tuple[ComplexArray, ...]:
        """Turn the Fourier series of one shape."""
        size = len(series[-1])  # the highest wavenumber has the most orders
        flat = np.array([_padded(one, size) for one in series])
        by_k = derivative @ (k[:, None] * flat)
        by_angle = np.fft.fftfreq(size, 1 / size) * flat  # i times it is the derivative
        lower, higher = fall * (by_k + by_angle), fall.conjugate() * (by_k - by_angle)
        falling = flat - 1j * (np.roll(lower, -1, axis=1) + np.roll(higher, 1, axis=1))
        halves = (len(one) // 2 for one in series)
        return tuple(np.concatenate((row[:half], row[-half:])) for row, half in zip(falling, halves, strict=True))

    return replace(spectra, series=tuple(map(turned, spectra.series)))


def _derivative(nodes: FloatArray) -> FloatArray:
    """Differentiation matrix at Gauss–Legendre nodes (Berrut & Trefethen, SIAM Rev. 46, 2004)."""
    x, weights = leggauss(len(nodes))
    weights = np.sqrt((1 - x**2) * weights) * (-1.0) ** np.arange(len(x))
    distance = nodes[:, None] - nodes
    np.fill_diagonal(distance, 1.0)
    matrix = weights / weights[:, None] / distance
    np.fill_diagonal(matrix, 0.0)
    np.fill_diagonal(matrix, -matrix.sum(axis=1))
    return np.asarray(matrix)


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
        """Fill in the harmonics about a block of points."""
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
        """Gradients by the waves of one wavenumber."""
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
