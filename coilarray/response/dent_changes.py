"""Inductance and capacitance changes of all coils by dents.

They are computed before the circuit is solved.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import xarray as xr

from coilarray.compute.arrays import ComplexArray, FloatArray
from coilarray.compute.store import Store, content_key
from coilarray.compute.threads import Progress, ranges
from coilarray.design.model import Design
from coilarray.elastomer.dented_layer import dent_inductance
from coilarray.elastomer.dielectric import dent_capacitance
from coilarray.elastomer.face_shift import shift_inductance
from coilarray.elastomer.scattering import LayerMesh
from coilarray.electromagnetics.flat_stack import Backing
from coilarray.electromagnetics.source import Source
from coilarray.errors import ElastomerError
from coilarray.response.setup import Experiment, Level, indentation_of, together

_POSITIONS = 1000  # in a part of a resumable map, which holds a single depth


def changes_by_dents(
    pressed: Experiment,
    permittivity: float | None,
    mesh: LayerMesh,
    backing: Backing | None,
    parts: str | Path | None,
    progress: Progress | None,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Compute the changes of all coils by dents.

    These are ΔL and ΔR/ω, (depths, places, coils, coils) in H, and ΔC of each coil, (…, coils) in F. The loss is the
    loss in plates. Without plates it is a single zero.
    """
    design, levels, points = pressed.design, pressed.levels, pressed.points
    depths, coils = len(pressed.axes.depth), len(design.array.names)
    change, capacitance_change = np.zeros((depths, len(points), coils, coils)), np.zeros((depths, len(points), coils))
    loss = np.zeros(()) if backing is None else np.zeros_like(change)
    paths = [conductor.vertices for conductor in design.array.conductors()]
    groups = len(together(levels))
    store = None if parts is None else Store(Path(parts))
    steps = _Steps(progress, depths * len(ranges(len(points), _POSITIONS)) * groups)
    for k in range(depths):
        for start, stop in ranges(len(points), _POSITIONS):
            block = [
                replace(level, dents=level.dents[k : k + 1], shares=level.shares[k : k + 1, start:stop])
                for level in levels
            ]
            on_board = points[start:stop]
            # all inputs that decide the numbers of a part
            parts_of = [(level.shares, level.dents[0], level.coarse) for level in block]
            key = content_key(permittivity, mesh, on_board, parts_of, paths, *([] if backing is None else [backing]))
            part = None if store is None else store.get_dataset(key)
            if part is not None:
                for _ in range(groups):
                    steps.next()
            else:
                part = _compute_part(design, block, on_board, permittivity, mesh, backing, steps)
                if store is not None:
                    store.put_dataset(key, part)
            change[k, start:stop] = part.change.values
            if backing is not None:
                loss[k, start:stop] = part.loss.values
            capacitance_change[k, start:stop] = part.capacitance_change.values
    shift = changes_by_bounds(pressed, design.array, mesh, backing)
    change += shift.real
    if backing is not None:
        loss -= shift.imag
    return change, loss, capacitance_change


def changes_by_bounds(
    pressed: Experiment, source: Source, mesh: LayerMesh, backing: Backing | None
) -> ComplexArray | complex:
    """Inductance changes in H by a sample's sides and seat.

    They are ΔL − jΔR/ω, and 0 for a wide sample.
    """
    if pressed.correction is None:
        return 0j
    origin = indentation_of(pressed.design).origin_point
    places = pressed.points - origin
    return shift_inductance(source, pressed.design.sheets, pressed.correction, places, origin, mesh, backing)


def changes_by_levels(
    source: Source,
    levels: Sequence[Level],
    points: FloatArray,
    mesh: LayerMesh,
    backing: Backing | None,
    progress: Progress | None,
) -> FloatArray | ComplexArray:
    """Compute the inductance changes by level samples in H.

    The samples consist of the same sheets. The shape is (depths, places, coils, coils). The change is ΔL, or ΔL − jΔR/ω
    with a backing.
    """
    dents = [dent for level in levels for dent in level.dents]
    accuracy = mesh.coarser() if levels[0].coarse else mesh
    change = dent_inductance(source, dents, points, accuracy, backing=backing, progress=progress)
    parts = change.reshape(len(levels), -1, *change.shape[1:])
    return np.asarray(np.einsum("ldp,ldpij->dpij", [level.shares for level in levels], parts))


def _compute_part(
    design: Design,
    levels: Sequence[Level],
    points: FloatArray,
    permittivity: float | None,
    mesh: LayerMesh,
    backing: Backing | None,
    steps: _Steps,
) -> xr.Dataset:
    """Inductance and capacitance changes of one depth.

    They are given at some places, and beside plates with ΔR/ω in H as ``loss``.
    """
    coils = len(design.array.names)
    change, capacitance_change = np.zeros((len(points), coils, coils)), np.zeros((len(points), coils))
    loss = np.zeros_like(change) if backing is not None else np.zeros(())
    for group in together(levels):
        dented = changes_by_levels(design.array, group, points, mesh, backing, steps.within)[0]
        change += dented.real
        if backing is not None:
            loss -= dented.imag
        if permittivity is not None:
            dents = [level.dents[0] for level in group]
            parts = dent_capacitance(design.array, dents, points, permittivity, mesh)
            capacitance_change += np.einsum("lp,lpi->pi", [level.shares[0] for level in group], parts)
        steps.next()
    if not (np.isfinite(change).all() and np.isfinite(capacitance_change).all()):
        raise ElastomerError("the dented sheets gave numbers that are not finite; please report the design.")
    dims = ("place", "coil", "other")
    part = xr.Dataset({"change": (dims, change), "capacitance_change": (dims[:2], capacitance_change)})
    return part if backing is None else part.assign(loss=(dims, loss))


class _Steps:
    """Counter of map parts for a progress bar.

    It counts in hundredths.
    """

    def __init__(self, progress: Progress | None, parts: int) -> None:
        self._progress, self._total, self._done = progress, 100 * parts, 0

    def within(self, done: int, total: int) -> None:
        """Count within a part."""
        self._report(self._done + 99 * done // total)

    def next(self) -> None:
        """Count a whole part."""
        self._done += 100
        self._report(self._done)

    def _report(self, done: int) -> None:
        if self._progress is not None:
            self._progress(done, self._total)
