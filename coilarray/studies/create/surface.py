"""Coils on a surface whose neighbours do not couple."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.optimize import least_squares

from coilarray.compute.arrays import FloatArray
from coilarray.electromagnetics.inductance import coupling_matrix, inductance_matrix, pair_inductance, self_inductance
from coilarray.errors import DesignError
from coilarray.geometry import Conductor, Stackup, SurfaceLattice
from coilarray.geometry.conductor import SingleCoil
from coilarray.geometry.surface import neighbours
from coilarray.geometry.surface_array import levels, resized, sizes_by_distance

_START = 1.4  # of the distance of neighbours, a little more than flat circles need, as on curved surfaces
_STEP = 0.01  # of the mean distance, or of a size: difference for slopes
_MOVED, _SIZED = 0.02, 0.1  # coupling that weighs as much as a move by the mean distance, and as another size
_EVALUATIONS, _ROUNDS = 10, 3
_MET = 1e-3  # relative change of the sum of squares at which the search ends


def decoupled_lattice(lattice: SurfaceLattice, coil: SingleCoil, stackup: Stackup) -> SurfaceLattice:
    """Move and resize coils on a surface until neighbours decouple.

    Neighbours overlap as far as their coupling needs to vanish. Where their number and places do
    not allow that for all, the squares of the couplings become least. Coils without a common border
    keep a small negative coupling. Coils count as thin filaments, which changes k by some 1e-4.

    The search starts from the places and sizes of the `lattice`, without sizes from 1.4 times the
    mean distance to the neighbours. Places in triangles, few with other than six neighbours,
    decouple best. `coil` is the shape of the coils, `stackup` the layers of each board. Raises
    DesignError for a single coil.
    """
    surface, count = lattice.surface, len(lattice.points)
    pairs = np.array(neighbours(surface, lattice.points), dtype=np.intp).reshape(-1, 2).T
    if not pairs.size:
        raise DesignError(f"coils to decouple must be several; got {count}.")
    mean = float(np.linalg.norm(lattice.points[pairs[0]] - lattice.points[pairs[1]], axis=1).mean())
    first = (
        lattice
        if lattice.sizes is not None
        else replace(lattice, sizes=sizes_by_distance(surface, lattice.points, _START))
    )
    axes = np.array([pose.rotation for pose in first.poses([coil.coil()] * count, stackup)])[:, :, :2]
    sizes = np.asarray(first.sizes)
    weights = np.repeat((_MOVED, _MOVED, _SIZED), count)

    def at(change: FloatArray, on: tuple[int, ...]) -> SurfaceLattice:
        """Lattice after moves along x and y of each coil over the mean distance, and logarithms of sizes."""
        x, y, grown = change.reshape(3, count)
        moved = first.points + mean * (x[:, None] * axes[:, :, 0] + y[:, None] * axes[:, :, 1])
        return replace(first, points=surface.nearest(moved)[0], sizes=sizes * np.exp(grown), levels=on)

    def paths(change: FloatArray, on: tuple[int, ...]) -> tuple[Conductor, ...]:
        return at(change, on).conductors(coil, stackup)

    def couplings(change: FloatArray, on: tuple[int, ...]) -> FloatArray:
        there = paths(change, on)
        root = np.sqrt(self_inductance(there))
        M = pair_inductance(_filaments(there), pairs[0], pairs[1])
        return np.append(M / (root[pairs[0]] * root[pairs[1]]), weights * change)

    def slopes(change: FloatArray, on: tuple[int, ...]) -> FloatArray:
        there = paths(change, on)
        root = np.sqrt(self_inductance(there))
        every = list(there)
        for kind in range(3):
            step = np.zeros((3, count))
            step[kind] = _STEP
            every += paths(change + step.ravel(), on)
        one, other = np.concatenate((pairs, pairs[::-1]), axis=1)
        row = np.tile(np.arange(pairs.shape[1]), 2)
        filaments = _filaments(every)
        before = pair_inductance(filaments, one, other)
        found = np.zeros((pairs.shape[1], 3 * count))
        for kind in range(3):
            after = pair_inductance(filaments, (1 + kind) * count + one, other)
            found[row, kind * count + one] = (after - before) / (_STEP * root[one] * root[other])
        return np.vstack((found, np.diag(weights)))

    change, on = np.zeros(3 * count), _levels(first, coil)
    for _ in range(_ROUNDS):
        solved = least_squares(couplings, change, slopes, max_nfev=_EVALUATIONS, ftol=_MET, xtol=_MET, args=(on,))
        change, before = solved.x, on
        on = _levels(at(change, on), coil)
        if on == before:
            break
    return at(change, on)


def lattice_coupling(lattice: SurfaceLattice, coil: SingleCoil, stackup: Stackup) -> tuple[float, float]:
    """Find the largest |k|, dimensionless, of neighbours, and of all other pairs.

    `lattice`, `coil` and `stackup` are as in `decoupled_lattice`.
    """
    k = np.abs(coupling_matrix(inductance_matrix(lattice.conductors(coil, stackup), allow_overlaps=True)))
    near = np.zeros_like(k, dtype=np.bool_)
    for pair in neighbours(lattice.surface, lattice.points):
        near[pair] = near[pair[::-1]] = True
    far = ~near & ~np.eye(len(k), dtype=np.bool_)
    return float(k[near].max(initial=0.0)), float(k[far].max(initial=0.0))


def _filaments(paths: list[Conductor] | tuple[Conductor, ...]) -> list[Conductor]:
    return [Conductor(path.vertices) for path in paths]


def _levels(lattice: SurfaceLattice, coil: SingleCoil) -> tuple[int, ...]:
    outlines = [resized(coil.coil(), size).outline for size in np.asarray(lattice.sizes).tolist()]
    return tuple(levels(lattice.points, np.array([np.hypot(*outline.T).max() for outline in outlines])))
