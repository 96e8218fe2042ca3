"""Fields that plates below the coils reflect up."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from coilarray.compute.arrays import ComplexArray, FloatArray
from coilarray.electromagnetics.field import Source
from coilarray.electromagnetics.flat_stack import Backing, PassedWaves, Segments, mirrored_segments
from coilarray.errors import MetalError
from coilarray.geometry import FinitePlate, Plate, Sheet
from coilarray.metal.coupled_plates import EddyCurrents, LayeredAir, SolvedPlates
from coilarray.metal.finite_plates import AnyPlates, eddy_currents, solve_outlined
from coilarray.metal.flat_plates import stack_below

_SAME_PLACE = 1e-9  # of the plate's size
_SHORT = 1e-3  # of the plate's size: length of the pieces that carry the current at one point


def require_below(plates: AnyPlates, what: str = "an indentation") -> None:
    """Raise MetalError for plates above the coils beside a body, `what`."""
    for k, plate in enumerate(plates):
        name = f"plate.{k} {plate.name!r}"
        if plate.heights[1] > 0:
            raise MetalError(
                f"{what} is computed only beside plates below the coils; {name} lies above them: leave it out, or "
                "give it a z_mm below the board."
            )


def backings_of(
    source: Source, plates: AnyPlates, frequencies: Sequence[float], sheets: Sequence[Sheet], *, fineness: float = 1.0
) -> tuple[list[Backing], SolvedPlates | None]:
    """Return the reflections by plates below the coils, by frequency, and its solved finite plates.

    Without plates the list is empty. Magnetic finite plates are not among the solved ones. The
    `fineness` is as in `coilarray.metal.finite_plates.moving_plate`.
    """
    require_below(plates, "an indentation or a sphere")
    endless = [plate for plate in plates if isinstance(plate, Plate)]
    stack, outlines = stack_below(endless), [plate for plate in plates if isinstance(plate, FinitePlate)]
    if not outlines:
        return [Backing(stack.face, stack.layers, f) for f in frequencies] if stack.layers else [], None
    if any(plate.material.relative_permeability != 1 for plate in outlines):
        outlined = None
        currents = eddy_currents(source, plates, frequencies, sheets, fineness=fineness, alone=True)
    else:
        outlined = solve_outlined(source, plates, frequencies, sheets, fineness=fineness)
        currents = outlined.eddy_currents()
    backings = [
        Backing(stack.face, stack.layers, f, *_seen_from_above(LayeredAir.between(endless, (), np.array([f])), one))
        for f, one in zip(frequencies, currents, strict=True)
    ]
    return backings, outlined


@dataclass(frozen=True, eq=False)
class _Share:
    """Share of the waves that reaches the highest gap.

    It goes through layers by one of four ways. As a part of a map's key it is no function.
    """

    air: LayeredAir
    gap: int
    way: int

    def __call__(self, wavenumbers: FloatArray) -> ComplexArray:
        return np.asarray(self.air.weights(wavenumbers, self.gap, len(self.air.layers))[self.way][0])


def _seen_from_above(air: LayeredAir, currents: Sequence[EddyCurrents]) -> tuple[Segments, tuple[PassedWaves, ...]]:
    """Return the currents above, and the waves passed by layers."""
    gaps = [air.gap(float(z.min()), float(z.max()), "a plate") for z in (one.corners[..., 2] for one in currents)]
    pieces = [_pieces(one) for one in currents]
    start, stop = (np.concatenate(ends) for ends in zip(*((one.start, one.stop) for one in pieces), strict=True))

    def weights_in(gap: int) -> FloatArray:
        return np.concatenate([one.weights * (own == gap) for one, own in zip(pieces, gaps, strict=True)])

    highest = len(air.layers)
    passed = []
    for gap in sorted(set(gaps) - {highest}):
        behind = Segments(start, stop, weights_in(gap))
        floor = air.gap_faces(gap)[0]
        passed.append(PassedWaves(behind, _Share(air, gap, 2)))
        if math.isfinite(floor):  # also the reflection by the next layer below
            (mirrored,) = mirrored_segments([behind], floor)
            passed.append(PassedWaves(mirrored, _Share(air, gap, 1)))
    return Segments(start, stop, weights_in(highest)), tuple(passed)


def _pieces(currents: EddyCurrents) -> Segments:
    """Short pieces along x and y, exact for quadratic fields."""
    corners = currents.corners
    areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2
    points = (corners + np.roll(corners, -1, axis=1)).reshape(-1, 3) / 2
    moment = np.repeat(currents.density * areas[:, None] / 3, 3, axis=1)[..., :2]
    size = float(np.ptp(points[:, :2], axis=0).max())
    _, first, number = np.unique(
        np.round(points / (_SAME_PLACE * size)), axis=0, return_index=True, return_inverse=True
    )  # edges of two triangles
    sums = np.zeros((len(first), 2 * len(moment), 2))
    np.add.at(sums, number.ravel(), np.concatenate((moment.real, moment.imag)).swapaxes(0, 1))
    at, half = points[first], _SHORT * size / 2
    steps = [half * np.eye(3)[axis] for axis in (0, 1)]
    return Segments(
        np.concatenate([at - step for step in steps]),
        np.concatenate([at + step for step in steps]),
        np.concatenate((sums[..., 0], sums[..., 1])) / (2 * half),
    )
