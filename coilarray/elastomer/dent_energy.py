"""The energy between the fields of all coils that a dent takes or gives, magnetic and electric alike."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from coilarray.compute.arrays import ComplexArray, FloatArray
from coilarray.compute.memory import require_memory
from coilarray.compute.threads import Progress, ranges
from coilarray.elastomer.dent import Dent, Motion
from coilarray.elastomer.scattering import LayerMesh, Scattering, wavenumber_rule
from coilarray.electromagnetics.coil_spectrum import (
    Segments,
    harmonics_about,
    segment_centres,
    segment_spectra,
)
from coilarray.electromagnetics.flat_stack import Backing
from coilarray.errors import ElastomerError

Solver = Callable[[Dent, FloatArray, FloatArray, float], Scattering]
"""Solves a dent for wavenumbers, their weights, and the largest displacement of the series of dents in m."""

_POSITIONS = 128  # at a time, which bounds the memory
_DISTANCES = 5  # numbers for every position and coil, to find the farthest


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
    """Change of the energy between the fields of all coils by dents in the same sheets.

    The axis of the indenter is at `positions` (positions, 2) in m. The result, shape (dents, positions, coils, coils),
    is ∫ Δμ ∇U_i·∇U_j dV with relative material constants, symmetric: times μ0 an inductance, times ε0 a capacitance. It
    is complex with a `backing` below the coils, whose losses are its imaginary part; the currents in that count too.
    ElastomerError for positions that are not finite, dents of different sheets, or in plane strain.
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
    # energies between the fields of currents in phase with those of the coils, and of those a quarter of a period ahead
    parts = None if backing is None or backing.eddies is None else np.hstack((np.eye(count), 1j * np.eye(count)))
    change: npt.NDArray[Any] = np.zeros((len(dents), len(points), count, count), dtype=kind)
    moving = [index for index, dent in enumerate(dents) if np.isfinite(dent.clearance)]
    if not moving or not len(points):
        return change
    clearance = min(dents[index].clearance for index in moving)
    extent = (
        float(np.hypot(*(points[:, None] - centres).T).max()) + radius + max(dents[index].width for index in moving)
    )
    wavenumbers, weights = wavenumber_rule(clearance, extent, mesh)
    blocks = ranges(len(points), _POSITIONS)
    total = len(moving) + len(blocks)
    deepest = max(float(np.abs(dent.displacement).max()) for dent in dents)
    report = progress or (lambda done, total: None)
    shapes: dict[tuple[object, ...], Scattering] = {}  # dents that differ by a motion alone share it
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
    spectra = {
        slope: [segment_spectra(those, wavenumbers, slope) for those in seen]
        for slope in dict.fromkeys(one.slope for one in motions)
    }
    k = np.tile(wavenumbers, len(seen))[:, None, None]
    factors = 2 * np.pi * np.array([1.0, *[2.0] * mesh.harmonics])
    for done, (start, stop) in enumerate(blocks, start=1):
        at = points[start:stop]
        turned: tuple[tuple[float, float], float] | None = None
        for motion, those in motions.items():
            if turned != (motion.slope, motion.pivot):
                turned = motion.slope, motion.pivot
                axis = at + np.array(motion.slope) * motion.pivot
                waves = np.concatenate([harmonics_about(one, axis, mesh.harmonics) for one in spectra[motion.slope]])
                level: npt.NDArray[Any] = np.moveaxis(waves, -1, 0) * (k / (2 * np.pi))
            up = motion.lift + (centres - at[:, None]) @ motion.slope
            incident: npt.NDArray[Any] = np.ascontiguousarray(level * np.exp(-k * up))
            if parts is not None:
                of_coils, in_phase, ahead = np.split(incident, 3, axis=-1)
                incident = np.concatenate((of_coils + in_phase, ahead), axis=-1)
            for index, one in those:
                energy = one.change(incident, factors)
                change[index, start:stop] = energy if parts is None else parts @ energy @ parts.T
        report(len(moving) + done, total)
    return change
