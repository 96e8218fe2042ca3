"""Change of the inductance matrix by an indentation anywhere.

The energies of `coilarray.elastomer.scattering` are one matrix per harmonic between the incident
patterns. In their principal axes they are

    ΔL_ij = Σ_r s_r a_r(i) a_r(j)

with strengths s_r of the dent and amplitudes a_r(i) that are smooth functions of the offset of coil
i from the indenter. An array of any number of coils needs them once per shape, at the offsets that
occur or on a grid of offsets with splines between.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.interpolate import NdBSpline, make_interp_spline

from coilarray.compute.arrays import FloatArray, IntArray, NumberArray
from coilarray.compute.memory import require_memory
from coilarray.compute.threads import Progress, ranges, run_blocks
from coilarray.constants import MU_0
from coilarray.elastomer.dent import STILL, Dent, Motion
from coilarray.elastomer.scattering import LayerMesh, Scattering, scatter, wavenumber_rule
from coilarray.electromagnetics.field import Source, as_conductors
from coilarray.electromagnetics.flat_stack import (
    Backing,
    CoilSpectra,
    Segments,
    coil_harmonics,
    coil_segments,
    segment_centres,
    segment_spectra,
    turned_spectra,
)
from coilarray.errors import ElastomerError

# dent, wavenumbers, their weights, and the largest displacement in m of a series of dents
Solver = Callable[[Dent, FloatArray, FloatArray, float], Scattering]

_STEPS_PER_CLEARANCE = 3  # of a table, for which the splines err by 1e-5 of the peak
_DEGREE = 5  # of the splines
# pairs of positions, coils and dents, and their offsets, at a time, to bound the memory
_PAIRS, _OFFSETS = 1 << 15, 512
_DISTANCES = 5  # numbers for every position and coil, to find the largest distance


@dataclass(frozen=True, eq=False)
class DentAmplitudes:
    """Strengths (n,) of a dent in H, and amplitudes (offsets, n) by shape."""

    strengths: FloatArray
    amplitudes: tuple[FloatArray, ...]


def dent_amplitudes(
    scattering: Scattering,
    spectra: CoilSpectra,
    offsets: Sequence[FloatArray],
    tolerance: float,
    motion: Motion = STILL,
) -> DentAmplitudes:
    """Compute the amplitudes of coils at given offsets.

    The spectra are for coils turned by the slope of the `motion`. Offsets (offsets, 2) for each
    shape are the indenter's position minus the coil's centre in m. Amplitudes below the
    `tolerance`, a part of the largest, are left out. The energies err by about a tenth of it.
    """
    orders = len(scattering.energies)
    count = sum(len(points) for points in offsets)
    require_memory(24.0 * count * len(spectra.wavenumbers) * orders, f"the field of coils at {count} offsets")
    incident = [np.empty((orders, 2, len(spectra.wavenumbers), len(points))) for points in offsets]

    def fill(block: tuple[int, slice]) -> None:
        shape, rows = block
        incident[shape][..., rows] = incident_waves(spectra, shape, offsets[shape][rows], orders, motion)

    blocks = [(k, slice(*part)) for k, points in enumerate(offsets) for part in ranges(len(points), _OFFSETS)]
    run_blocks(fill, blocks)
    weighted = [patterns * scattering.weights for patterns in scattering.patterns]
    axes, strengths = [], []
    largest = 0.0
    for m in range(orders):
        gram = sum((part @ part.T for waves in incident for part in weighted[m] @ waves[m]), start=np.zeros(()))
        sizes, vectors = np.linalg.eigh(gram)
        largest = max(largest, float(sizes[-1]))
        kept = vectors[:, sizes > tolerance**2 * largest]
        energy = kept.T @ (scattering.energies[m] + scattering.energies[m].T) @ kept / 2
        strength, turned = np.linalg.eigh(energy)
        axes.append((kept @ turned).T @ weighted[m])
        # the integral over the angle, of the harmonics −m and m, for the real and for the imaginary part
        strengths.append(np.tile((2 if m else 1) * 2 * np.pi * MU_0 * strength, 2))
    amplitudes = [np.concatenate([part for m in range(orders) for part in axes[m] @ waves[m]]) for waves in incident]
    return DentAmplitudes(np.concatenate(strengths), tuple(np.ascontiguousarray(values.T) for values in amplitudes))


def offset_grid(extent: float, clearance: float) -> tuple[FloatArray, FloatArray]:
    """Offsets in m along an axis and in pairs (n², 2), fine enough for `clearance`."""
    half = max(int(np.ceil(_STEPS_PER_CLEARANCE * extent / clearance)), _DEGREE)
    axis = np.linspace(-extent, extent, 2 * half + 1)
    return axis, np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1).reshape(-1, 2)


def amplitude_table(axis: FloatArray, amplitudes: FloatArray) -> NdBSpline:
    """Splines through amplitudes on `offset_grid`, of offsets (…, 2) in m."""
    along = make_interp_spline(axis, amplitudes.reshape(len(axis), len(axis), -1), k=_DEGREE, axis=0)
    across = make_interp_spline(axis, along.c, k=_DEGREE, axis=1)
    return NdBSpline((along.t, across.t), np.ascontiguousarray(np.moveaxis(across.c, 0, 1)), _DEGREE)


def incident_waves(
    spectra: CoilSpectra, shape: int, offsets: FloatArray, orders: int, motion: Motion = STILL
) -> FloatArray:
    """Harmonics c_m k/2π of one shape of coil about offsets (n, 2) in m.

    The offsets, as in `coil_harmonics`, are at the dent's position after its `motion`.
    """
    up = motion.lift - offsets @ motion.slope
    waves = coil_harmonics(spectra, shape, offsets + np.array(motion.slope) * motion.pivot, orders - 1)
    waves *= (spectra.wavenumbers / (2 * np.pi))[:, None] * np.exp(-np.outer(spectra.wavenumbers, up))
    return waves


def dent_energies(
    dents: Sequence[Dent],
    positions: npt.ArrayLike,
    coils: Sequence[Segments],
    solve: Solver,
    accuracy: LayerMesh,
    *,
    backing: Backing | None = None,
    progress: Progress | None = None,
) -> NumberArray:
    """Change of the energy between all coils' fields by dents.

    The dents are in the same sheets, their axis at `positions` (positions, 2) in m. The result
    (dents, positions, coils, coils) is ∫ Δμ ∇U_i·∇U_j dV with relative permeabilities. Times μ0 it
    is an inductance. With a `backing`, whose currents count too, the losses are its imaginary part.
    """
    points = np.asarray(positions, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] != 2 or not np.isfinite(points).all():
        raise ElastomerError(f"positions must be finite and of shape (n, 2); got shape {points.shape}.")
    if any(dent.symmetry != "axial" for dent in dents):
        raise ElastomerError("coils in space need dents about an axis; for plane strain there is the line model.")
    if len({(dent.thicknesses, dent.permeabilities) for dent in dents}) > 1:
        raise ElastomerError("dents must be in the same sheets.")
    seen = [list(coils)] if backing is None else backing.seen(coils)
    centres, radius = segment_centres(seen[0])
    number = np.float64 if backing is None else np.complex128
    require_memory(
        np.dtype(number).itemsize * len(points) * len(centres) * (2 * len(dents) * len(centres) + _DISTANCES),
        f"{len(dents)} dents at {len(points)} positions with {len(centres)} coils",
        "compute them in pieces",
    )
    count = sum(coil.count for coil in coils)
    currents = None if backing is None or backing.eddies is None else backing.currents(count)
    change: npt.NDArray[Any] = np.zeros((len(dents), len(points), count, count), dtype=number)
    moving = [index for index, dent in enumerate(dents) if np.isfinite(dent.clearance)]
    if not moving or not len(points):
        return change
    moved = [dents[index] for index in moving]
    extent = float(np.hypot(*(points[:, None] - centres).T).max()) + radius + max(dent.width for dent in moved)
    wavenumbers, weights = wavenumber_rule(min(dent.clearance for dent in moved), extent, accuracy)
    blocks = ranges(len(points), max(1, _PAIRS // (len(centres) * len(moving))))
    total = len(moving) + len(blocks)
    deepest = max(float(np.abs(dent.displacement).max()) for dent in dents)
    shapes: dict[tuple[object, ...], Scattering] = {}  # dents that differ by a motion alone share the solution
    solved = []
    for dent in moved:
        if dent.shape not in shapes:
            shapes[dent.shape] = solve(dent, wavenumbers, weights, deepest)
        solved.append(shapes[dent.shape] if backing is None else shapes[dent.shape].over(backing, dent))
        if progress is not None:
            progress(len(solved), total)
    level = [segment_spectra(images, wavenumbers) for images in seen]
    motions = list(dict.fromkeys(dent.motion for dent in moved))
    turned = {motion.slope: [turned_spectra(spectra, motion.slope) for spectra in level] for motion in motions}
    kinds, kind_of_coil = np.unique([one.shape_of for one in level], axis=1, return_inverse=True)

    def amplitudes_at(task: tuple[FloatArray, int]) -> list[list[NumberArray]]:
        """Amplitudes of every dent's patterns, by harmonic, at offsets in m of a kind of coil."""
        offsets, kind = task
        about: dict[Motion, FloatArray] = {}
        for motion in motions:
            spectra = zip(turned[motion.slope], kinds[:, kind].tolist(), strict=True)
            waves = [incident_waves(one, shape, offsets, accuracy.harmonics + 1, motion) for one, shape in spectra]
            about[motion] = np.concatenate(waves, axis=2)
        return [one.amplitudes(about[dent.motion]) for one, dent in zip(solved, moved, strict=True)]

    factors = 2 * np.pi * np.array([1.0, *[2.0] * accuracy.harmonics])
    for done, (start, stop) in enumerate(blocks, start=1):
        work, place = _distinct(points[start:stop, None] - centres, kind_of_coil.ravel())
        amplitudes = run_blocks(amplitudes_at, work)
        for index, scattering, of_groups in zip(moving, solved, zip(*amplitudes, strict=True), strict=True):
            by_harmonic = [np.concatenate(parts, axis=2) for parts in zip(*of_groups, strict=True)]
            energy = scattering.energy(by_harmonic, place, factors)
            change[index, start:stop] = energy if currents is None else currents.T @ energy @ currents
        if progress is not None:
            progress(len(moving) + done, total)
    return change


def _distinct(offsets: FloatArray, shape_of: IntArray) -> tuple[list[tuple[FloatArray, int]], IntArray]:
    """Find the distinct offsets in m for every shape of coil, near ones first.

    Returns groups of offsets (n, 2) of a shape each, as near ones need fewer angles, and the index
    of each pair's offset (positions, coils) among all groups in turn.
    """
    (x, of_x), (y, of_y) = (
        np.unique(np.round(values, 12), return_inverse=True) for values in np.moveaxis(offsets, -1, 0)
    )
    code = (shape_of * len(x) + of_x.reshape(offsets.shape[:2])) * len(y) + of_y.reshape(offsets.shape[:2])
    _, first, of_pair = np.unique(code, return_index=True, return_inverse=True)
    places, shapes = offsets.reshape(-1, 2)[first], shape_of[first % len(shape_of)]
    near_first = np.lexsort((np.hypot(*places.T), shapes))
    groups = []
    for of_shape in np.split(near_first, np.flatnonzero(np.diff(shapes[near_first])) + 1):
        for start, stop in ranges(len(of_shape), _OFFSETS):
            group = of_shape[start:stop]
            groups.append((places[group], int(shapes[group[0]])))
    return groups, np.argsort(near_first)[of_pair.reshape(code.shape)]


def dent_inductance(
    source: Source,
    dents: Sequence[Dent],
    positions: npt.ArrayLike,
    accuracy: LayerMesh | None = None,
    *,
    backing: Backing | None = None,
    progress: Progress | None = None,
) -> NumberArray:
    """Change of the inductance matrix in H by dented sheets.

    The coils of the `source` are at z ≤ 0, and paths whose ends lie apart are closed by a straight
    line. The `dents` are of the same sheets, for example one for each depth, with their axis at
    `positions` (positions, 2) in m. `accuracy` is that of the field. A `backing` are conducting or
    magnetic layers below the coils and the currents in other metal there, at one frequency.
    `progress` is called with (done, total) as the work goes on. The result (dents, positions,
    coils, coils) is dented minus flat, symmetric, over a backing ΔL − jΔR/ω. Raises ElastomerError
    for positions that are not finite, coils that are not below the sheets, dents of different
    sheets or in plane strain, or a magnetic face that comes too close to the coils.

    The coils' field in harmonics about the indenter (`coilarray.electromagnetics.flat_stack`) is
    scattered by the dent (`coilarray.elastomer.scattering`): ΔL_ij = 2π μ0 Σ_m b_i,m* Γ_m b_j,m
    with b = c_m(k) k dk/2π. Nothing is linearised in the depth. The sheets are taken as laterally
    infinite, and their permeability as unchanged by strain. A backing also reflects the dent's own
    field, but the currents in it are those without the dent. Under tilted sheets, `Dent.motion`,
    each wave is tilted like the wave of a mirrored coil.

    >>> import numpy as np
    >>> r = np.linspace(0, 20e-3, 41)
    >>> shape = -0.5e-3 * np.exp(-((r / 4e-3) ** 2))
    >>> dent = Dent((4e-3, 2e-3), (1.0, 3.0), r, np.column_stack((0 * r, 0.6 * shape, shape)))
    >>> angle = np.linspace(0, 2 * np.pi, 25)
    >>> loop = np.column_stack((8e-3 * np.cos(angle), 8e-3 * np.sin(angle), 0 * angle))
    >>> change = dent_inductance([loop], [dent], [[0, 0], [12e-3, 0]])
    >>> np.round(change[0, :, 0, 0] * 1e12, 2)
    array([25.93,  0.23])
    """
    paths = as_conductors(source)
    highest = max(float(path.vertices[:, 2].max()) for path in paths)
    if highest > 0:
        raise ElastomerError(f"coils must lie at z <= 0, below the sheets; one reaches z = {highest:.4g} m.")
    mesh = accuracy or LayerMesh()

    def solve(dent: Dent, wavenumbers: FloatArray, weights: FloatArray, deepest: float) -> Scattering:
        return scatter(dent, wavenumbers, weights, mesh, deepest)

    return MU_0 * dent_energies(dents, positions, coil_segments(paths), solve, mesh, backing=backing, progress=progress)
