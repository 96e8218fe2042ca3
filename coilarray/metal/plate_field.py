"""Field and eddy currents of coils between plates without end, on grids: what pictures show.

In flat layers every plane wave of the coils' vertical flux density, B_z = Σ b(z) e^{ik·x}, keeps its pattern in the
plane. In a layer of conductivity σ and permeability µ, b'' = γ² b with γ² = k² + jωµσ; b and b'/µ are continuous. With
q = −µ0 b'/(k b), which is 1 in air without end, a layer of thickness d takes its upper q to its lower one,

    q_l = c (q_u + c tanh γd)/(c + q_u tanh γd),  c = µ0 γ/(k µ),

and ρ = (1 − q)/(1 + q) is the reflection. The rest of the field follows from b: B along the layers is ∇(b'/k²); the
induced E = ẑ × ∇(jω b/k²), so that the current through a layer is K = ẑ × ∇ψ, ψ = jωσ/k² ∫ b dz.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from coilarray.compute.arrays import ComplexArray, FloatArray
from coilarray.constants import MU_0
from coilarray.electromagnetics.coil_spectrum import Segments, coil_segments, gradients_on_grid, segment_spectra
from coilarray.electromagnetics.plane_waves import wave_count, wave_rule
from coilarray.electromagnetics.source import Source
from coilarray.errors import MetalError
from coilarray.geometry import Plate, Sheet

_DECAYS = 12.0  # of the fields at the highest wavenumber, which is left out: 6e-6
_MOST_WAVENUMBERS = 1500
_PERFECT = 1e16  # S/m, for a perfect conductor: at 1 kHz its skin depth is 0.2 µm


@dataclass(frozen=True)
class _Layer:
    """Thickness in m, conductivity in S/m and relative permeability of a layer; its plate by number, None for none."""

    thickness: float
    conductivity: float = 0.0
    permeability: float = 1.0
    plate: int | None = None


@dataclass(frozen=True, eq=False)
class _Side:
    """Layers outwards from the coils, and b of all wavenumbers (k,) in them over that at their inner face.

    `ratios` are q at each layer's outer face over c, of shape (layers, k), `growths` γ in 1/m and `faces` b at its
    inner face; `reflection` is ρ (k,) at the first one.
    """

    layers: tuple[_Layer, ...]
    wavenumbers: FloatArray
    growths: ComplexArray
    ratios: ComplexArray
    faces: ComplexArray
    reflection: ComplexArray

    def at(self, height: float) -> tuple[ComplexArray, ComplexArray]:
        """Return b and its outward derivative in 1/m at a height in m beyond the first face."""
        edges = np.concatenate(([0.0], np.cumsum([layer.thickness for layer in self.layers])))
        number = int(np.searchsorted(edges, height, side="right")) - 1
        if number >= len(self.layers):
            b = self.faces[-1] * np.exp(-self.wavenumbers * (height - edges[-1]))
            return b, -self.wavenumbers * b
        growth, ratio, d = self.growths[number], self.ratios[number], self.layers[number].thickness
        h = height - edges[number]
        out = (1 + ratio) * np.exp(-growth * h)
        back = (1 - ratio) * np.exp(-growth * (2 * d - h))
        b = self.faces[number] / _sum(growth, ratio, d)
        return b * (out + back), b * growth * (back - out)

    def integral(self, number: int) -> ComplexArray:
        """Return ∫ b dz over a layer in m."""
        growth, ratio, d = self.growths[number], self.ratios[number], self.layers[number].thickness
        fall = np.exp(-growth * d)
        return np.asarray(
            self.faces[number] * (1 - fall) * (1 + ratio + (1 - ratio) * fall) / growth / _sum(growth, ratio, d)
        )


def _sum(growth: ComplexArray, ratio: ComplexArray, d: float) -> ComplexArray:
    return np.asarray(1 + ratio + (1 - ratio) * np.exp(-2 * growth * d))


def _side(layers: Sequence[_Layer], k: FloatArray, frequency: float) -> _Side:
    omega = 2 * np.pi * frequency
    growths = np.array(
        [np.sqrt(k**2 + 1j * omega * MU_0 * one.permeability * min(one.conductivity, _PERFECT)) for one in layers]
    ).reshape(len(layers), len(k))
    q = np.ones(len(k), dtype=np.complex128)
    ratios = np.empty_like(growths)
    for number in range(len(layers) - 1, -1, -1):
        growth, layer = growths[number], layers[number]
        c = growth / (k * layer.permeability)
        fall = np.exp(-2 * growth * layer.thickness)
        tanh = (1 - fall) / (1 + fall)
        ratios[number] = q / c
        q = c * (q + c * tanh) / (c + q * tanh)
    faces = [np.ones(len(k), dtype=np.complex128)]
    for growth, ratio, layer in zip(growths, ratios, layers, strict=True):
        faces.append(faces[-1] * 2 * np.exp(-growth * layer.thickness) / _sum(growth, ratio, layer.thickness))
    return _Side(tuple(layers), k, growths, ratios, np.array(faces), (1 - q) / (1 + q))


def _layers(plates: Sequence[Plate], sheets: Sequence[Sheet], lowest: float) -> tuple[list[_Layer], list[_Layer]]:
    """Return the layers upwards from z = 0, and those downwards from the lowest copper at `lowest` in m."""
    bodies = [
        (*plate.heights, _Layer(plate.thickness, plate.material.conductivity, plate.material.relative_permeability, n))
        for n, plate in enumerate(plates)
    ]
    top = 0.0
    for sheet in sheets:
        bodies.append((top, top + sheet.thickness, _Layer(sheet.thickness, 0.0, sheet.relative_permeability)))
        top += sheet.thickness
    above = sorted((body for body in bodies if body[0] >= 0), key=lambda body: body[0])
    below = sorted((body for body in bodies if body[0] < 0), key=lambda body: -body[1])
    up = [(low, high, layer) for low, high, layer in above]
    down = [(lowest - high, lowest - low, layer) for low, high, layer in below]
    return _with_gaps(up), _with_gaps(down)


def _with_gaps(bodies: Sequence[tuple[float, float, _Layer]]) -> list[_Layer]:
    """Put air between bodies that rise outwards from 0."""
    layers: list[_Layer] = []
    for (_, before, _), (low, _, layer) in pairwise([(0.0, 0.0, _Layer(0.0)), *bodies]):
        if low > before:
            layers.append(_Layer(low - before))
        layers.append(layer)
    return layers


@dataclass(frozen=True, eq=False)
class _Waves:
    """Both sides of the coils that carry currents in A, and these coils as seen from each side."""

    up: _Side
    down: _Side
    coils: tuple[list[Segments], list[Segments]]
    currents: ComplexArray
    between: FloatArray  # e^{−kD} between both reference planes

    def amplitudes(self, above: bool) -> tuple[ComplexArray, ComplexArray]:
        """Return b at the first face of a side per wave that the coils send there, and per wave to the other side."""
        own, other = (self.up, self.down) if above else (self.down, self.up)
        total = (1 + own.reflection) / (1 - own.reflection * other.reflection * self.between**2)
        return total, total * other.reflection * self.between


def plate_currents(
    source: Source,
    currents: npt.ArrayLike,
    plates: Sequence[Plate],
    frequency: float,
    x: FloatArray,
    y: FloatArray,
    sheets: Sequence[Sheet] = (),
    *,
    blur: float,
) -> ComplexArray:
    """Eddy currents through the thickness of plates without end.

    Parameters
    ----------
    source : CoilArray, Conductor, polyline or sequence of them
        The n coils, at z ≤ 0 and above the plates below them.
    currents : array_like of complex, shape (n,)
        Currents of the coils in A.
    plates : sequence of Plate
        Plates above and below the coils.
    frequency : float
        Frequency in Hz.
    x, y : ndarray, shapes (nx,), (ny,)
        Places on the board in m.
    sheets : sequence of Sheet
        Magnetic sheets upwards from z = 0.
    blur : float
        Standard deviation in m of the Gaussian over which the currents are averaged: near a plate they repeat every
        single turn.

    Returns
    -------
    ndarray of complex, shape (plates, nx, ny, 2)
        Current per width along x and y in A/m.
    """
    segments = coil_segments(source)
    points = np.concatenate([one.start for one in segments])
    lowest = float(points[:, 2].min())
    nearest = min(max(plate.heights[0], lowest - plate.heights[1]) for plate in plates)
    k, weights = _rule(_extent(points, x, y), min(_DECAYS / max(nearest, 1e-9), np.sqrt(2 * _DECAYS) / blur))
    waves = _waves(segments, currents, plates, sheets, lowest, k, frequency)
    smooth = np.exp(-((k * blur) ** 2) / 2)
    found = np.zeros((len(plates), len(x), len(y), 2), dtype=np.complex128)
    for above, side in ((True, waves.up), (False, waves.down)):
        numbers = [number for number, layer in enumerate(side.layers) if layer.plate is not None]
        profiles = [
            2j * np.pi * frequency * MU_0 * min(side.layers[n].conductivity, _PERFECT) * side.integral(n) / k * smooth
            for n in numbers
        ]
        if numbers:
            psi = _on_grid(waves, above, profiles, [np.zeros_like(k)] * len(numbers), x, y, weights)
            for number, stream in zip(numbers, np.moveaxis(psi, 1, 0), strict=True):
                found[side.layers[number].plate] = np.stack((-stream[1], stream[0]), axis=-1)
    return found


def plate_field(
    source: Source,
    currents: npt.ArrayLike,
    plates: Sequence[Plate],
    frequency: float,
    x: FloatArray,
    y: FloatArray,
    z: FloatArray,
    sheets: Sequence[Sheet] = (),
) -> ComplexArray:
    """Change of B by plates without end and by magnetic sheets, against the coils in free space.

    Parameters
    ----------
    source, currents, plates, frequency, x, y, sheets
        See `plate_currents`.
    z : ndarray, shape (nz,)
        Heights in m: none between the lowest copper and the top of the board, and none at its very faces.

    Returns
    -------
    ndarray of complex, shape (nx, ny, nz, 3)
        Flux density in T, also inside the plates.

    Raises
    ------
    MetalError
        A height beside the copper.
    """
    segments = coil_segments(source)
    points = np.concatenate([one.start for one in segments])
    lowest = float(points[:, 2].min())
    beside = z[(z <= 0) & (z >= lowest)]
    if beside.size:
        raise MetalError(
            f"B beside plates is computed above the board and below its copper at {lowest * 1e3:.4g} mm; "
            f"got a height of {beside[0] * 1e3:.4g} mm."
        )
    beyond = np.where(z > 0, z, lowest - z)
    up, down = _layers(plates, sheets, lowest)
    ways = [
        _least_way(*((up, down) if height > 0 else (down, up)), away)
        for height, away in zip(z.tolist(), beyond.tolist(), strict=True)
    ]
    k, weights = _rule(_extent(points, x, y), _DECAYS / min(ways))
    waves = _waves(segments, currents, plates, sheets, lowest, k, frequency)
    found = np.zeros((len(x), len(y), len(z), 3), dtype=np.complex128)
    for above, side in ((True, waves.up), (False, waves.down)):
        heights = np.flatnonzero(z > 0 if above else z < 0)
        if not heights.size:
            continue
        b, rise = np.moveaxis(np.array([side.at(float(beyond[n])) for n in heights]), 1, 0)
        free = np.exp(-np.outer(beyond[heights], k))
        sign = 1.0 if above else -1.0  # of the derivative over z
        B = _on_grid(
            waves, above, sign * MU_0 * rise / k, MU_0 * k * b, x, y, weights,
            free=(-sign * MU_0 * free, MU_0 * k * free),
        )  # fmt: skip
        found[:, :, heights] = np.moveaxis(B, (0, 1), (3, 2))
    return found


def _waves(
    segments: Sequence[Segments],
    currents: npt.ArrayLike,
    plates: Sequence[Plate],
    sheets: Sequence[Sheet],
    lowest: float,
    k: FloatArray,
    frequency: float,
) -> _Waves:
    up, down = _layers(plates, sheets, lowest)
    amount = np.asarray(currents, dtype=np.complex128)
    carrying = [one for one, current in zip(segments, amount.tolist(), strict=True) if current]
    mirrored = [_mirrored(one, lowest) for one in carrying]
    sides = _side(up, k, frequency), _side(down, k, frequency)
    return _Waves(*sides, (carrying, mirrored), amount[amount != 0], np.exp(k * lowest))


def _mirrored(coil: Segments, lowest: float) -> Segments:
    """Turn a coil upside down: the same currents, seen from below."""
    flip, lift = np.array([1.0, 1.0, -1.0]), np.array([0.0, 0.0, lowest])
    return Segments(coil.start * flip + lift, coil.stop * flip + lift, coil.weights)


def _on_grid(
    waves: _Waves,
    above: bool,
    profiles: Sequence[ComplexArray] | ComplexArray,
    slopes: Sequence[ComplexArray] | Sequence[FloatArray] | ComplexArray,
    x: FloatArray,
    y: FloatArray,
    weights: FloatArray,
    free: tuple[FloatArray, FloatArray] | None = None,
) -> ComplexArray:
    """Sum ∇ along the plane of the waves times `profiles` and the waves times `slopes`, each (n, k), less `free`.

    Shape (3, n, nx, ny), per unit of b at the side's first face.
    """
    total = np.zeros((3, len(profiles), len(x), len(y)), dtype=np.complex128)
    mine, others = waves.amplitudes(above)
    for own, amplitude in ((True, mine), (False, others)):
        along, across = np.asarray(profiles) * amplitude, np.asarray(slopes) * amplitude
        if own and free is not None:
            along, across = along - free[0], across - free[1]
        if not (along.any() or across.any()):
            continue
        spectra = segment_spectra(waves.coils[0 if own == above else 1], waves.up.wavenumbers)
        both = [np.concatenate((one.real, one.imag)) for one in (along, across)]
        real, imaginary = np.split(gradients_on_grid(spectra, x, y, weights, *both), 2, axis=2)
        total += np.tensordot(waves.currents, real + 1j * imaginary, axes=1)
    return total


def _least_way(side: Sequence[_Layer], other: Sequence[_Layer], beyond: float) -> float:
    """Least way in m of a wave from the copper to a place `beyond` it, by way of the nearest body on either side."""
    near, far = (_gap(one) for one in (side, other))
    return beyond if beyond >= near else min(2 * near - beyond, 2 * far + beyond)


def _gap(side: Sequence[_Layer]) -> float:
    """Thickness in m of the air before the first body; inf where there is none."""
    if not side:
        return math.inf
    return side[0].thickness if side[0] == _Layer(side[0].thickness) else 0.0


def _extent(points: FloatArray, x: FloatArray, y: FloatArray) -> float:
    """Largest horizontal distance in m of a place from a coil's corner."""
    ends = np.array([x[[0, -1]], y[[0, -1]]])
    low, high = points[:, :2].min(axis=0), points[:, :2].max(axis=0)
    return float(np.hypot(*np.maximum(ends[:, 1] - low, high - ends[:, 0])))


def _rule(extent: float, highest: float) -> tuple[FloatArray, FloatArray]:
    """Gauss–Legendre nodes and weights in 1/m from 0 to the highest wavenumber that resolve an extent in m."""
    count = wave_count(highest, extent)
    if count > _MOST_WAVENUMBERS:
        raise MetalError(
            f"B at {_DECAYS / highest * 1e3:.3g} mm from the coils on {extent * 1e3:.4g} mm would need {count} "
            f"wavenumbers; {_MOST_WAVENUMBERS} are allowed: choose places farther from the board."
        )
    return wave_rule(highest, count)
