"""Effect of a moved body on the coils, for any kind of body."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from coilarray.compute.arrays import ComplexArray, FloatArray
from coilarray.compute.threads import Progress
from coilarray.electromagnetics.inductance import Accuracy
from coilarray.electromagnetics.source import Source
from coilarray.geometry import Ball, FinitePlate, Plate, Sheet, Target
from coilarray.geometry.target import Body
from coilarray.metal.backing import require_below
from coilarray.metal.ball import ball_inductance
from coilarray.metal.finite_plates import PlateError, moving_plate_error, outlined_inductance
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

    The change is a complex inductance.

    Parameters
    ----------
    source : Source
        The coils.
    target : Target
        The body. Its own places and distances are not used.
    places : ndarray, shape (p, 2)
        Places of its centre on the board in m.
    distances : sequence of float, length d
        Distances in m of its nearest point from the upper face of the sheets, or from the board without sheets.
    frequencies : ndarray, shape (f,)
        Frequencies in Hz, rising.
    sheets : sequence of Sheet
        Sheets on the board, upwards.
    plates : sequence of Plate or FinitePlate
        Fixed metal.
    accuracy : {"full", "screen"}
        Accuracy of an infinite target, see `coilarray.metal.flat_plates.plate_inductance`.
    fineness : float
        Fineness of the mesh of a finite plate, see `coilarray.metal.finite_plates.moving_plate`.
    progress : callable, optional
        Called with (done, total) as the work goes on.

    Returns
    -------
    ndarray of complex, shape (d, p, f, n, n)
        ΔZ/(jω) = ΔL − jΔR/ω in H, with the target minus without.
    PlateError or None
        Errors of a finite plate. None for other bodies.

    Raises
    ------
    MetalError
        A sphere beside plates above the coils, and cases that the solver of the body refuses.
    GeometryError
        A target that reaches into metal, sheets or copper, and cases that the solver of the body refuses.
    """
    face, body = sum(sheet.thickness for sheet in sheets), target.body
    heights = [target.height(face, distance) for distance in distances]
    require_apart(body, plates)
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
        error = moving_plate_error(
            source, body, positions, frequencies, sheets, plates, fineness=fineness, progress=progress
        )
        change = error.change
    else:
        change = ball_inductance(
            source, body, positions, frequencies, sheets, plates, fineness=fineness, progress=progress
        )
    return change.reshape(len(heights), len(places), *change.shape[1:]), error


def require_apart(body: Body, plates: Sequence[Plate | FinitePlate]) -> None:
    """Raise MetalError for a target beside unsupported plates."""
    if isinstance(body, Ball):
        require_below(plates, "a sphere")
