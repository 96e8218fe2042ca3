"""Change of the magnetic or electric energy between the fields of all coils by a dent."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from coilarray.compute.arrays import ComplexArray, FloatArray, IntArray
from coilarray.compute.memory import require_memory
from coilarray.compute.threads import Progress, ranges, run_blocks
from coilarray.elastomer.dent import Dent, Motion
from coilarray.elastomer.dent_amplitudes import incident_waves
from coilarray.elastomer.scattering import LayerMesh, Scattering, wavenumber_rule
from coilarray.electromagnetics.coil_spectrum import (
    Segments,
    segment_centres,
    segment_spectra,
    turned_spectra,
)
from coilarray.electromagnetics.flat_stack import Backing
from coilarray.errors import ElastomerError

# dent, wavenumbers, their weights, and the largest displacement in m of a series of dents
Solver = Callable[[Dent, FloatArray, FloatArray, float], Scattering]

# pairs of positions and coils and dents, and offsets between them, at a time, which bounds the memory
_PAIRS, _OFFSETS = 1 << 15, 512
_DISTANCES = 5  # numbers for every position and coil, to find the largest distance


def dent_energies(
    dents: Sequence[Dent],
    positions: npt.ArrayLike,
    coils: Sequence[Segments],
    solve: Solver,
    mesh: LayerMesh,
    *,
    backing: Backing | None = None,
    progress: Progress | None = None,
) -> FloatArray | ComplexArray:
    """Change of the energy between all coils' fields by dents.

    All dents are in the same sheets. The axis of the indenter is at `positions` (positions, 2) in m. The result, shape
    (dents, positions, coils, coils), is ∫ Δμ ∇U_i·∇U_j dV with relative material constants, symmetric. Times μ0 it is
    an inductance, times ε0 a capacitance. It is complex with a `backing` below the coils, whose losses are its
    imaginary part. The currents in the backing count too. Raises ElastomerError for positions that are not finite,
    dents of different sheets, or in plane strain.
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
    kind = np.float64 if backing is None else np.complex128
    require_memory(
        np.dtype(kind).itemsize * len(points) * len(centres) * (2 * len(dents) * len(centres) + _DISTANCES),
        f"{len(dents)} dents at {len(points)} positions with {len(centres)} coils",
        "compute them in pieces",
    )
    count = sum(coil.count for coil in coils)
    currents = None if backing is None or backing.eddies is None else backing.currents(count)
    change: npt.NDArray[Any] = np.zeros((len(dents), len(points), count, count), dtype=kind)
    moving = [index for index, dent in enumerate(dents) if np.isfinite(dent.clearance)]
    if not moving or not len(points):
        return change
    clearance = min(dents[index].clearance for index in moving)
    extent = (
        float(np.hypot(*(points[:, None] - centres).T).max()) + radius + max(dents[index].width for index in moving)
    )
    wavenumbers, weights = wavenumber_rule(clearance, extent, mesh)
    blocks = ranges(len(points), max(1, _PAIRS // (len(centres) * len(moving))))
    total = len(moving) + len(blocks)
    deepest = max(float(np.abs(dent.displacement).max()) for dent in dents)
    report = progress or (lambda done, total: None)
    shapes: dict[tuple[object, ...], Scattering] = {}  # dents that differ by a motion alone share the solution
    solved = []
    for index in moving:
        shape = dents[index].shape
        if shape not in shapes:
            shapes[shape] = solve(dents[index], wavenumbers, weights, deepest)
        solved.append(shapes[shape] if backing is None else shapes[shape].over(backing, dents[index]))
        report(len(solved), total)
    motions: dict[Motion, list[tuple[int, Scattering]]] = {
        motion: [] for motion in dict.fromkeys(dents[index].motion for index in moving)
    }
    for index, one in zip(moving, solved, strict=True):
        motions[dents[index].motion].append((index, one))
    level_spectra = [segment_spectra(those, wavenumbers) for those in seen]
    spectra = {
        slope: [turned_spectra(one, slope) for one in level_spectra]
        for slope in dict.fromkeys(one.slope for one in motions)
    }
    # coils of one kind have the same shape in all images
    kinds, kind_of = np.unique([one.shape_of for one in next(iter(spectra.values()))], axis=1, return_inverse=True)
    factors = 2 * np.pi * np.array([1.0, *[2.0] * mesh.harmonics])
    for done, (start, stop) in enumerate(blocks, start=1):
        offsets, kind_of_offset, of_pair = _distinct(points[start:stop, None] - centres, kind_of.ravel())

        def amplitudes(
            some: IntArray, offsets: FloatArray = offsets, kind: IntArray = kind_of_offset
        ) -> dict[int, list[FloatArray | ComplexArray]]:
            """Return the amplitudes of every dent at some offsets.

            All offsets are of one kind of coil.
            """
            shapes = kinds[:, kind[some[0]]].tolist()
            found: dict[int, list[FloatArray | ComplexArray]] = {}
            for motion, those in motions.items():
                waves = [
                    incident_waves(one, shape, offsets[some], mesh.harmonics + 1, motion)
                    for one, shape in zip(spectra[motion.slope], shapes, strict=True)
                ]
                found |= {index: one.amplitudes(np.concatenate(waves, axis=2)) for index, one in those}
            return found

        near_first = np.lexsort((np.hypot(*offsets.T), kind_of_offset))  # small offsets need fewer angles
        bounds = np.flatnonzero(np.diff(kind_of_offset[near_first])) + 1
        work = [
            part
            for of_kind in np.split(near_first, bounds)
            for part in np.split(of_kind, range(_OFFSETS, len(of_kind), _OFFSETS))
        ]
        results = run_blocks(amplitudes, work)
        place = np.argsort(np.concatenate(work))[of_pair]
        for index, one in zip(moving, solved, strict=True):
            of_offsets = [np.concatenate(of, axis=2) for of in zip(*(result[index] for result in results), strict=True)]
            energy = one.energy(of_offsets, place, factors)
            change[index, start:stop] = energy if currents is None else currents.T @ energy @ currents
        report(len(moving) + done, total)
    return change


def _distinct(offsets: FloatArray, kind_of: IntArray) -> tuple[FloatArray, IntArray, IntArray]:
    """Find the distinct offsets in m for every kind of coil.

    `offsets` has the shape (positions, coils, 2), and `kind_of` (coils,). Returns the distinct offsets (n, 2), their
    kinds (n,), and the index of each pair's offset (positions, coils).
    """
    (x, of_x), (y, of_y) = (
        np.unique(np.round(values, 12), return_inverse=True) for values in np.moveaxis(offsets, -1, 0)
    )
    code = (kind_of * len(x) + of_x.reshape(offsets.shape[:2])) * len(y) + of_y.reshape(offsets.shape[:2])
    _, first, of_pair = np.unique(code, return_index=True, return_inverse=True)
    return offsets.reshape(-1, 2)[first], kind_of[first % len(kind_of)], of_pair.reshape(code.shape)
