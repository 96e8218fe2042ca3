"""Fabrication errors of a board, and the design with them.

An error is named ``kind.part``: ``etch.L1``, ``registration_x.L3``, ``dielectric.L1-L2``,
``elastomer.base``. Kinds without parts have a plain name: ``placement_x``, ``permeability``,
``capacitance``. Values are in SI.

==================  ============  ====  ===========================================================
kind                part          unit  effect of a positive error
==================  ============  ====  ===========================================================
etch                copper layer  m     widens every trace, the centre line stays
registration_x, _y  copper layer  m     shifts the copper against the drilled holes
rotation            copper layer  rad   turns the copper about the board's middle, counterclockwise
dielectric          layer pair    1     thickens the dielectric, all layers below sink
copper              copper layer  1     thickens the copper, all layers below sink
placement_x, _y     none          m     true less believed position of elastomer and indenter
permeability        none          1     raises μr of all magnetic sheets
elastomer           sheet         m     thickens the sheet
capacitance         none          1     raises the capacitance of the tank
plate_distance      plate         m     moves the plate away from the coils, or nearer to contact
plate_thickness     plate         1     thickens the plate, its face near the coils stays
conductivity        none          1     raises the conductivity of all plates and of the target
target_tilt_x, _y   none          rad   tilts a target with an outline, which rises towards x or y
==================  ============  ====  ===========================================================

Plates keep their gap to the sheets, or to the underside of the board, as these become thicker. The
ends of every line stay at the drilled holes that join them. Pads, holes and the outline of the
board have no error.
"""

from __future__ import annotations

import cmath
import difflib
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from coilarray.compute.arrays import FloatArray
from coilarray.design.model import Design
from coilarray.errors import DesignError, GeometryError, GoalError
from coilarray.geometry import Array, Coil, FinitePlate, Material, Placement, Plate, Sheet, Target


def error_names(design: Design) -> tuple[str, ...]:
    """Names of all errors that a design can have.

    Layers without copper of a coil have neither etch nor registration.
    """
    layers = design.array.stackup.names
    used = {layer for place in design.array.placements for layer in place.layers}
    names = [
        f"{kind}.{layer}"
        for kind in ("etch", "registration_x", "registration_y", "rotation")
        for layer in layers
        if layer in used
    ]
    names += [f"dielectric.{upper}-{lower}" for upper, lower in pairwise(layers)]
    names += [f"copper.{layer}" for layer in layers]
    if design.indentation is not None:
        names += ["placement_x", "placement_y"]
    if any(sheet.magnetic for sheet in design.sheets):
        names.append("permeability")
    names += [*(f"elastomer.{sheet.name}" for sheet in design.sheets), "capacitance"]
    names += [f"{kind}.{plate.name}" for kind in ("plate_distance", "plate_thickness") for plate in design.plates]
    materials = [plate.material for plate in design.plates]
    materials += [] if design.target is None else [design.target.body.material]
    if any(material.conductivity > 0 for material in materials):
        names.append("conductivity")
    if design.target is not None and isinstance(design.target.body, FinitePlate):
        names += ["target_tilt_x", "target_tilt_y"]
    return tuple(names)


def perturb(design: Design, errors: Mapping[str, float]) -> Design:
    """Return a design with fabrication errors in SI by name.

    Raises GoalError for an error that leaves nothing of a trace, gap or layer.

    >>> from coilarray import load_design
    >>> narrow = perturb(load_design("gast2020"), {"etch.L3": -10e-6})
    >>> [round(float(widths[0]) * 1e6, 6) for widths in narrow.array.placements[0].coil.widths]
    [90.0, 100.0]
    """
    known = error_names(design)
    for name, value in errors.items():
        if name not in known:
            close = difflib.get_close_matches(name, known, n=1)
            hint = f"; did you mean {close[0]}?" if close else f"; it has {', '.join(known)}."
            raise GoalError(f"{design.name} has no error {name!r}{hint}")
        if not math.isfinite(value):
            raise GoalError(f"the error {name} must be finite; got {value}.")
    nonzero = {name: float(errors[name]) for name in known if errors.get(name, 0.0) != 0.0}
    if not nonzero:
        return design
    switches = design.circuit.switches
    tank = _scaled(switches.tank_capacitance, nonzero, "capacitance")
    setup, shift = design.indentation, [nonzero.get(f"placement_{axis}", 0.0) for axis in "xy"]
    if setup is not None and any(shift):
        x, y = setup.origin_point
        setup = replace(setup, origin=None, origin_point=(x + shift[0], y + shift[1]))
    try:
        array = _array(design.array, nonzero)
        sheets = tuple(_sheet(sheet, nonzero) for sheet in design.sheets)
        rise = sum(sheet.thickness for sheet in sheets) - design.top
        sink = array.stackup.thickness - design.array.stackup.thickness
        return replace(
            design,
            array=array,
            sheets=sheets,
            indentation=setup,
            circuit=replace(design.circuit, switches=replace(switches, tank_capacitance=tank)),
            plates=tuple(_plate(plate, design, nonzero, rise, sink) for plate in design.plates),
            target=_target(design.target, nonzero),
        )
    except (DesignError, GeometryError) as error:
        raise GoalError(f"no board can be made with these errors: {error}") from None


def _scaled(value: float, errors: Mapping[str, float], name: str) -> float:
    scaled = value * (1 + errors.get(name, 0.0))
    if scaled <= 0:
        raise GoalError(f"the error {name} must be above −1; got {errors[name]:g}.")
    return scaled


def _sheet(sheet: Sheet, errors: Mapping[str, float]) -> Sheet:
    """Return a sheet with its errors."""
    magnetic = sheet.magnetic
    return replace(
        sheet,
        thickness=sheet.thickness + errors.get(f"elastomer.{sheet.name}", 0.0),
        relative_permeability=_scaled(sheet.relative_permeability, errors, "permeability") if magnetic else 1.0,
    )


def _conducting(material: Material, errors: Mapping[str, float]) -> Material:
    if material.conductivity == 0:
        return material
    return replace(material, conductivity=_scaled(material.conductivity, errors, "conductivity"))


def _plate(
    plate: Plate | FinitePlate, design: Design, errors: Mapping[str, float], rise: float, sink: float
) -> Plate | FinitePlate:
    """Plate with its errors, raised with sheets or board."""
    thickness = _scaled(plate.thickness, errors, f"plate_thickness.{plate.name}")
    changed = replace(plate, thickness=thickness, material=_conducting(plate.material, errors))
    low, high = plate.heights
    above = low >= 0
    gap = low - design.top if above else -design.array.stackup.thickness - high
    # a plate stops where it touches
    away = max(errors.get(f"plate_distance.{plate.name}", 0.0), -max(gap, 0.0))
    if above:
        return changed.lifted(rise + away + low - changed.heights[0])
    return changed.lifted(high - sink - away - changed.heights[1])


def _target(target: Target | None, errors: Mapping[str, float]) -> Target | None:
    """Return a target with its errors."""
    if target is None:
        return None
    body = replace(target.body, material=_conducting(target.body.material, errors))
    turn = complex(*(errors.get(f"target_tilt_{axis}", 0.0) for axis in "xy"))
    if isinstance(body, FinitePlate) and turn:
        tilt = cmath.rect(body.tilt, body.tilt_direction) + turn
        body = replace(body, tilt=abs(tilt), tilt_direction=cmath.phase(tilt))
    return replace(target, body=body)


def _array(array: Array, errors: Mapping[str, float]) -> Array:
    """Return an array with its errors."""

    def thickened(kind: str, parts: Iterable[str], thickness: Sequence[float]) -> tuple[float, ...]:
        names = (f"{kind}.{part}" for part in parts)
        return tuple(value * (1 + errors.get(name, 0.0)) for name, value in zip(names, thickness, strict=True))

    layers = array.stackup.names
    stackup = replace(
        array.stackup,
        copper_thickness=thickened("copper", layers, array.stackup.copper_thickness),
        dielectric_thickness=thickened(
            "dielectric", map("-".join, pairwise(layers)), array.stackup.dielectric_thickness
        ),
    )
    x_min, y_min, x_max, y_max = array.bounds
    middle = np.array([x_min + x_max, y_min + y_max]) / 2
    made: dict[tuple[object, ...], Coil] = {}
    placements = []
    for place in array.placements:
        # coils with equal errors stay one object, so that their inductance is computed once
        turned = any(f"rotation.{layer}" in errors for layer in place.layers)
        key = (id(place.coil), place.layers, place.rotation, (place.x, place.y) if turned else None)
        if key not in made:
            made[key] = _coil(place, errors, middle)
        placements.append(replace(place, coil=made[key]))
    return replace(array, stackup=stackup, placements=tuple(placements))


def _coil(place: Placement, errors: Mapping[str, float], middle: FloatArray) -> Coil:
    """Coil with errors at its placement, in its frame."""
    coil = place.coil
    wider = [errors.get(f"etch.{layer}", 0.0) for layer in place.layers]
    lines = []
    for line, layer in zip(coil.lines, place.layers, strict=True):  # shifted and turned, but not at their ends
        shift = np.array([errors.get(f"registration_{axis}.{layer}", 0.0) for axis in "xy"])
        if angle := errors.get(f"rotation.{layer}", 0.0):
            shift = shift + (place.to_board(line) - middle) @ (_turn(angle) - np.eye(2)).T
        moved = line
        if shift.any():
            moved = line.copy()
            moved[1:-1] += np.broadcast_to(shift @ _turn(place.rotation), line.shape)[
                1:-1
            ]  # v @ R(φ) turns v back by φ
        lines.append(moved)
    return replace(
        coil,
        lines=tuple(lines),
        widths=tuple(widths + change for widths, change in zip(coil.widths, wider, strict=True)),
        # one gap per coil: the pitch of its turns stays, on the mean over its layers
        gap=coil.gap - sum(wider) / len(wider),
    )


def _turn(angle: float) -> FloatArray:
    """Matrix that turns a column by an angle in rad."""
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s], [s, c]])
