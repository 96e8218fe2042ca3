"""Effect of a moved body of any kind on the coils."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from coilarray.compute.arrays import ComplexArray, FloatArray
from coilarray.compute.threads import Progress
from coilarray.electromagnetics.field import Source
from coilarray.electromagnetics.inductance import Accuracy
from coilarray.geometry import Ball, FinitePlate, Plate, Sheet, Target
from coilarray.metal.backing import require_below
from coilarray.metal.ball import ball_inductance
from coilarray.metal.finite_plates import PlateError, moving_plate, outlined_inductance
from coilarray.metal.flat_plates import plate_inductances


def target_inductance(
    source: Source,
    target: Target,
    places: FloatArray,
    distances: Sequence[float],
    frequencies: FloatArray,
    sheets: Sequence[Sheet] = (),
    plates: Sequence[Plate | FinitePlate] = (),
    *,
    accuracy: Accuracy = "full",
    fineness: float = 1.0,
    progress: Progress | None = None,
) -> tuple[ComplexArray, PlateError | None]:
    """Change of the impedance matrix by a target, in H.

    The change (d, p, f, n, n) is ΔZ/(jω) = ΔL − jΔR/ω, with the target minus without. The second
    result are the errors of a finite plate, else None. The target's centre is at `places` (p, 2) in
    m on the board, its nearest point at `distances` in m from the upper face of the sheets, or from
    the board without sheets. `plates` are fixed metal. `accuracy` is of an infinite target,
    `fineness` of the mesh of a finite plate.
    """
    face, body = sum(sheet.thickness for sheet in sheets), target.body
    heights = [target.height(face, distance) for distance in distances]
    if isinstance(body, Ball):
        require_below(plates, "a sphere")
    if isinstance(body, Plate):
        moved = [replace(body, z=z) for z in heights]
        endless = [plate for plate in plates if isinstance(plate, Plate)]
        cases = [endless, *([*endless, one] for one in moved)]
        every = plate_inductances(source, cases, frequencies, sheets, accuracy=accuracy, progress=progress)
        if len(endless) < len(plates):
            outlined = ([*plates], *([*plates, one] for one in moved))
            every = every + [outlined_inductance(source, c, frequencies, sheets, fineness=fineness) for c in outlined]
        return np.repeat((every[1:] - every[0])[:, None], len(places), axis=1), None
    positions = np.array([[x, y, z] for z in heights for x, y in places.tolist()])
    error = None
    if isinstance(body, FinitePlate):
        error = moving_plate(source, body, positions, frequencies, sheets, plates, fineness=fineness, progress=progress)
        change = error.change
    else:
        change = ball_inductance(
            source, body, positions, frequencies, sheets, plates, fineness=fineness, progress=progress
        )
    return change.reshape(len(heights), len(places), *change.shape[1:]), error
