"""What plates below the coils send back up to the sheets: infinite ones, and the currents in those with an outline."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from coilarray.electromagnetics.coil_spectrum import Segments
from coilarray.electromagnetics.flat_stack import Backing
from coilarray.electromagnetics.source import Source
from coilarray.errors import MetalError
from coilarray.geometry import FinitePlate, Plate, Sheet
from coilarray.metal.finite_plates import EddyCurrents, eddy_currents_over
from coilarray.metal.flat_plates import stack_below

_SAME_PLACE = 1e-9  # of the plate's size
_SHORT = 1e-3  # of the plate's size: pieces that stand for the current at one point


def require_below(plates: Sequence[Plate | FinitePlate]) -> None:
    """Refuse plates beside which no indentation is computed: MetalError."""
    floor = max((plate.heights[1] for plate in plates if isinstance(plate, Plate) and plate.z < 0), default=-np.inf)
    for k, plate in enumerate(plates):
        name = f"plate.{k} {plate.name!r}"
        if plate.heights[1] > 0:
            raise MetalError(
                f"an indentation is computed beside plates below the coils; {name} lies above the sheets, in the way "
                "of the indenter: leave it out, or give it a z_mm below the board."
            )
        if isinstance(plate, FinitePlate) and plate.material.relative_permeability != 1:
            raise MetalError(
                f"an indentation is computed beside plates with an outline that are not magnetic; {name} has "
                f"a relative permeability of {plate.material.relative_permeability:g}: give it shape = "
                '"plate", which is infinite, or another material.'
            )
        if isinstance(plate, FinitePlate) and plate.heights[0] < floor:
            raise MetalError(
                f"an indentation is computed beside plates with an outline above the infinite ones; {name} reaches "
                f"down to {plate.heights[0] * 1e3:.4g} mm, an infinite one up to {floor * 1e3:.4g} mm: raise its z_mm."
            )


def backings_of(
    source: Source,
    plates: Sequence[Plate | FinitePlate],
    frequencies: Sequence[float],
    sheets: Sequence[Sheet],
    *,
    fineness: float = 1.0,
) -> list[Backing]:
    """Return what plates below the coils send back up at each of the frequencies in Hz; empty where there are none.

    The `fineness` is that of the mesh of `coilarray.metal.finite_plates.moving_plate`. MetalError for plates beside
    which no indentation is computed, and the errors of `coilarray.metal.finite_plates.eddy_currents`.
    """
    require_below(plates)
    face, layers = stack_below([plate for plate in plates if isinstance(plate, Plate)])
    if any(isinstance(plate, FinitePlate) for plate in plates):
        currents = eddy_currents_over(source, plates, frequencies, sheets, fineness=fineness)
        return [Backing(face, layers, f, _pieces(one)) for f, one in zip(frequencies, currents, strict=True)]
    return [Backing(face, layers, f) for f in frequencies] if layers else []


def backing_of(
    source: Source,
    plates: Sequence[Plate | FinitePlate],
    frequency: float,
    sheets: Sequence[Sheet],
    *,
    fineness: float = 1.0,
) -> Backing | None:
    """`backings_of` at one frequency in Hz; None where there are no plates."""
    return next(iter(backings_of(source, plates, [frequency], sheets, fineness=fineness)), None)


def _pieces(currents: Sequence[EddyCurrents]) -> Segments:
    """Short pieces along x and y in the middles of all edges, whose rule integrates quadratic fields exactly."""
    middles, moments = [], []
    for one in currents:
        corners = one.corners
        areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2
        middles.append((corners + np.roll(corners, -1, axis=1)).reshape(-1, 3) / 2)
        moments.append(np.repeat(one.density * areas[:, None] / 3, 3, axis=1)[..., :2])
    points, moment = np.concatenate(middles), np.concatenate(moments, axis=1)
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
