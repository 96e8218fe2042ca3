"""Metal of a design in a scene.

Its plates, its target at every distance, and the eddy currents in them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import xarray as xr

from coilarray.compute.display_units import MM, true_minus
from coilarray.compute.threads import Progress
from coilarray.design.model import Design
from coilarray.errors import MetalError
from coilarray.geometry import FinitePlate
from coilarray.response.target import target_map, target_of
from coilarray.viz.datasets.metal import Eddies
from coilarray.viz.scenes.eddies import (
    WorkingPoint,
    at_their_largest,
    eddies_of_plates,
    eddies_of_target,
    working_point,
)
from coilarray.viz.scenes.metal import (
    Position,
    around_board,
    eddy_parts,
    scale_of_eddies,
    scene_of_plates,
    scene_of_target,
)
from coilarray.viz.scenes.scene import Scene

_STEPS = 9  # least number of positions of the slider of a distance
_NEAR = 0.05  # least relative distance of a position in between from the design's own positions
_SHOWN_STATES = 8  # largest number of states whose δ stand in a line


def scene_of_metal(
    design: Design,
    shown: frozenset[str],
    coil: str,
    coupling: Callable[[], xr.Dataset],
    *,
    current: float,
    terminated: bool,
    distance: float | None = None,
    at: tuple[float, float] | None = None,
    still: bool = False,
    progress: Progress | None = None,
) -> Scene:
    """Scene of plates, target and eddy currents of a design.

    Parameters
    ----------
    design : Design
        The design.
    shown : frozenset of str
        Items of "plates", "target" and "eddies" that are shown. Eddy currents flow in the bodies that are shown.
    coil, coupling, current, terminated
        Measured coil, function that returns the design's coupling, the coil's current in A, and whether the other coils
        are terminated.
    distance : float, optional
        Distance of the target in m at which the slider stands first. The default is the least distance.
    at : tuple of float, optional
        x and y of the target on the board in m. The default is its place nearest to the coil.
    still : bool
        Show the target at this distance alone, as the rest of the scene is made for it.
    progress : callable, optional
        Called with (done, total) as the work goes on.

    Raises
    ------
    MetalError
        If the design has no target, there is no metal for eddy currents, or a case is not computed.
    """
    within = around_board(design.array)
    plates = design.plates if "plates" in shown else ()
    scene = scene_of_plates(plates, within)
    steps = steps_of(design, distance) if "target" in shown else []
    if steps and still:
        steps = steps[:1] if distance is None else [distance]
    place = target_place(design, coil, at) if "target" in shown else (0.0, 0.0)
    numbers = None
    if steps:
        numbers = target_at(design, place, steps, progress=progress)
    of_plates: list[Eddies] = []
    of_target: list[Eddies | None] = [None] * len(steps)
    if "eddies" in shown:
        if not plates and not steps:
            raise MetalError(f"eddy currents need plates or a target in the picture of {design.name}.")
        operation = working_point(design, coupling(), coil, current, terminated=terminated)
        phasors = eddies_of_plates(design, plates, operation, within)
        moved = eddies_of_target(design, place, steps, operation, within)
        shown_now, when = at_their_largest([*phasors, *(one for one in moved if one is not None)])
        of_plates, rest = shown_now[: len(phasors)], iter(shown_now[len(phasors) :])
        of_target = [None if one is None else next(rest) for one in moved]
        scene += Scene(notes=_eddy_notes(design, coil, operation, when, none_in_target=bool(steps) and None in moved))
    scale = scale_of_eddies([*of_plates, *(one for one in of_target if one is not None)])
    for number, one in enumerate(of_plates):
        scene += Scene(eddy_parts(f"eddies of plate {number}", one, scale, within))
    if numbers is None:
        return scene
    target, lines = (
        target_of(design),
        [target_lines(numbers.isel(distance=k, y=0, x=0), coil) for k in range(len(steps))],
    )
    positions = [
        Position(step, (*place, target.height(design.top, step)), one, texts)
        for step, one, texts in zip(steps, of_target, lines, strict=True)
    ]
    first = 0 if distance is None else steps.index(distance)
    return scene + scene_of_target(target.body, positions, within, scale, first)


def target_at(
    design: Design, place: tuple[float, float], distances: Sequence[float], *, progress: Progress | None = None
) -> xr.Dataset:
    """Compute the effect of a target at several distances.

    All lengths are in m.
    """
    x, y = (value - origin for value, origin in zip(place, target_of(design).origin_point, strict=True))
    return target_map(design, distances=distances, x=[x], y=[y], progress=progress)


def target_lines(at: xr.Dataset, coil: str) -> tuple[str, ...]:
    """Describe the effect of a target at one place.

    There is a line about the state of a coil, and a line with the largest other δ.
    """
    states = [str(name) for name in at.state.values]
    first = coil if coil in states else states[0]
    one = at.sel(state=first)
    beside_q = str(at.quality_factor.attrs["long_name"]).partition(",")[2]
    line = (
        f"target at {MM.text(at.distance, '.3')}, {first}: δ = {percent(one.delta)}, "
        f"L = {float(one.effective_inductance) * 1e6:.4g} µH, "
        f"R = {float(one.effective_resistance):.3g} Ω, Q = {float(one.quality_factor):.3g}{beside_q}, "
        f"f = {float(one.frequency) * 1e-6:.4f} MHz"
    )
    others = [name for name in states if name != first]
    if not others:
        return (line,)
    largest = sorted(others, key=lambda name: -abs(float(at.delta.sel(state=name))))[:_SHOWN_STATES]
    shown = [name for name in others if name in largest]
    which = "δ of the others" if shown == others else f"the {len(shown)} largest δ of the others"
    return line, f"{which}: " + ", ".join(f"{name} {percent(at.delta.sel(state=name))}" for name in shown)


def percent(delta: xr.DataArray) -> str:
    """Relative change in % with three digits."""
    return true_minus(f"{float(delta) * 100:+.3g} %")


def steps_of(design: Design, distance: float | None = None) -> list[float]:
    """Distances of the target in m for a slider."""
    target = target_of(design)
    given, wanted = target.distances, [] if distance is None else [distance]
    layers = any(sheet.magnetic for sheet in design.sheets) or bool(design.plates)
    slow = isinstance(target.body, FinitePlate) and layers
    between = np.geomspace(given[0], given[-1], _STEPS).tolist() if 1 < len(given) < _STEPS and not slow else []
    near = {one for one in between if min(abs(one / other - 1) for other in (*given, *wanted)) < _NEAR}
    return sorted({*given, *wanted, *(one for one in between if one not in near)})


def target_place(design: Design, coil: str, at: tuple[float, float] | None) -> tuple[float, float]:
    """Position of the target on the board in m."""
    if at is not None:
        return at
    target, centre = target_of(design), design.array.centres[design.array.names.index(coil)].tolist()
    nearest = []
    for values, origin, middle in zip((target.x, target.y), target.origin_point, centre, strict=True):
        places = np.add(values, origin)
        nearest.append(float(places[np.abs(places - middle).argmin()]))
    return nearest[0], nearest[1]


def _eddy_notes(
    design: Design, coil: str, operation: WorkingPoint, when: str, *, none_in_target: bool
) -> tuple[str, ...]:
    """Describe the shown eddy currents in notes."""
    lines = [
        f"Eddy currents {when}, {operation.frequency * 1e-6:.4g} MHz, {abs(operation.current) * 1e3:g} mA in {coil}, "
        "the currents of the coils as without a target."
    ]
    if none_in_target:
        lines.append("Those in the target are not drawn.")
    return tuple(lines)
