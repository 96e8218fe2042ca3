"""What a body that is moved over the board does to the coils, whichever body it is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt
import shapely

from coilarray.compute.threads import Progress
from coilarray.electromagnetics.source import Source
from coilarray.errors import MetalError
from coilarray.geometry import FinitePlate, Plate, Sheet, Target
from coilarray.metal.ball import ball_inductance
from coilarray.metal.finite_plates import moving_plate
from coilarray.metal.flat_plates import plate_inductances

_PIECES = 90  # of the rims of a plate in a mesh of the fineness 1
_OF_ARM, _OF_GAP = 0.25, 1.0  # largest piece: of the largest circle's radius in the plate, and of the gap
_FINEST = 4.0

FloatArray = npt.NDArray[np.float64]
ComplexArray = npt.NDArray[np.complex128]


def target_inductance(
    source: Source,
    target: Target,
    places: FloatArray,
    distances: Sequence[float],
    frequencies: FloatArray,
    sheets: Sequence[Sheet] = (),
    plates: Sequence[Plate | FinitePlate] = (),
    *,
    progress: Progress | None = None,
) -> ComplexArray:
    """Change of the impedance matrix of coils by a target, as a complex inductance.

    Parameters
    ----------
    source : Source
        The coils.
    target : Target
        The body; its own places and distances do not count.
    places : ndarray, shape (p, 2)
        Places of its centre on the board in m.
    distances : sequence of float, length d
        Distances in m of its nearest point from the upper face of the sheets, or of the board without.
    frequencies : ndarray, shape (f,)
        Frequencies in Hz, rising.
    sheets : sequence of Sheet
        Sheets on the board, upwards.
    plates : sequence of Plate or FinitePlate
        Metal that stays where it is.
    progress : callable, optional
        Called with (done, total) as the work goes on.

    Returns
    -------
    ndarray of complex, shape (d, p, f, n, n)
        ΔZ/(jω) = ΔL − jΔR/ω in H, with the target less without.

    Raises
    ------
    MetalError
        A body together with sheets or plates with which it is not computed, and what the solver of the body refuses.
    """
    face, body = sum(sheet.thickness for sheet in sheets), target.body
    heights = [target.height(face, distance) for distance in distances]
    if isinstance(body, Plate):
        endless = [plate for plate in plates if isinstance(plate, Plate)]
        if len(endless) < len(plates):
            raise MetalError(
                "a target without end beside plates with an outline is not computed: leave one of them out."
            )
        cases = [endless, *([*endless, replace(body, z=z)] for z in heights)]
        without, *changes = plate_inductances(source, cases, frequencies, sheets, progress=progress)
        return np.repeat((np.array(changes) - without)[:, None], len(places), axis=1)
    if plates:
        raise MetalError(
            f"a target with an end beside plates is not computed; got {', '.join(plate.name for plate in plates)}."
        )
    positions = np.array([[x, y, z] for z in heights for x, y in places.tolist()])
    if isinstance(body, FinitePlate):
        gap = face + distances[0]  # from the copper at z = 0
        fineness = _fineness(body, gap)
        change = moving_plate(source, body, positions, frequencies, sheets, fineness=fineness, progress=progress)
    else:
        change = ball_inductance(source, body, positions, frequencies, sheets, progress=progress)
    return change.reshape(len(heights), len(places), *change.shape[1:])


def _fineness(plate: FinitePlate, gap: float) -> float:
    """Fineness of the mesh of a plate at a gap in m: its triangles must resolve its arms, and the field at the gap."""
    outline = shapely.Polygon(plate.outline.exterior, plate.outline.holes)
    arm = float(shapely.maximum_inscribed_circle(outline).length)
    finest = min(_OF_ARM * arm, _OF_GAP * gap)
    return min(max(outline.length / _PIECES / finest, 1.0), _FINEST)
