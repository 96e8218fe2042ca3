"""Designs as documents.

The tables of a design file are read back by `coilarray.design.model.build_design`.
"""

from __future__ import annotations

import math
import re
import textwrap
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from coilarray.design.circuit_table import OF_PART, PASSIVE, CircuitTable
from coilarray.design.fab_limits import FabTable
from coilarray.design.model import Circuit, Design, DesignFile, Indentation, build_design_file, design_of
from coilarray.design.places_table import map_positions
from coilarray.design.plates import flat_entries, material_entries
from coilarray.design.readout import Readout, ReadoutTable
from coilarray.design.tables import SCHEMA, ConnectorTable, half_side
from coilarray.design.units import SCALES, Table
from coilarray.geometry import (
    Ball,
    Coil,
    CoilArray,
    Cone,
    FabRules,
    FinitePlate,
    FlatPunch,
    Lattice,
    Leads,
    Plate,
    PlatedHole,
    RoundedSpiral,
    Seat,
    Sheet,
    Spiral,
    Stackup,
    Target,
    Unevenness,
    Wound,
    apothem_from_size,
    hull_outline,
)
from coilarray.geometry.sheet import KPA_PER_MM
from coilarray.geometry.spiral import Winding
from coilarray.geometry.values import SIDES

_NOT_IN_NAMES = re.compile(r"[^A-Za-z0-9_.+-]+")
# A list of plain values as tomli-w writes it, one value per line.
_FLAT_LIST = re.compile(r"\[\n\s*([^\[\]{}\n]+(?:,\n\s*[^\[\]{}\n]+)*),\n\s*\]")
_HEADER = re.compile(r"^\[(?!\[)", re.MULTILINE)
_LISTS_OF_NAMES = re.compile(r"""\[\n(?:\s*\["[^\[\]\n]*\],\n)+\s*\]""")
_LONGEST_LINE = 120
_TURNED = 1e-12  # rad
_PICOMETRE = 1e-12
_PLACES = ("lines_mm", "outline_mm", "corners_mm", "holes_mm", "x_mm", "y_mm", "z_mm")
_VIA = ("drill_mm", "pad_mm", "plating_um")
_MM, _UM, _PF, _DEG = (SCALES[unit] for unit in ("mm", "um", "pF", "deg"))
_WORDS = {passive: word for word, passive in PASSIVE.items()}


def design_document(design: Design | DesignFile) -> dict[str, Any]:
    """Return the tables of a design file for a design.

    Parameters
    ----------
    design : Design or DesignFile
        Read from a file or made in Python.

    Returns
    -------
    dict
        Plain tables, lists and values with all their digits. Entries of the circuit and of the board house are written
        only if they differ from the default. Placements are a lattice if `CoilArray.lattice` gives them, else free.
        Coils are wound shapes if `Coil.wound` defines them, else paths. Names that a file cannot have are changed by
        `design_names`.

    Examples
    --------
    >>> from coilarray import load_design
    >>> from coilarray.design.model import build_design
    >>> design = load_design("gast2020")
    >>> document = design_document(design)
    >>> document["array"]["pitch_mm"], build_design(document).digest == design.digest
    (13.28, True)
    """
    design = design_of(design)
    array, connector = _before_connector(design.array)
    names, layers = design_names(array.names), design_names(array.stackup.names)
    shapes = shape_names(array)
    coils = {shape: place.coil for shape, place in zip(shapes, array.placements, strict=True)}
    document: dict[str, Any] = {"schema": SCHEMA, "name": design_names([design.name])[design.name]}
    if design.title not in ("", design.name):
        document["title"] = design.title
    if design.source:
        document["source"] = design.source
    if connector is not None:
        document["connector"] = connector
    document |= {
        "stackup": _stackup_table(array.stackup, layers),
        "coils": {shape: _coil_table(coil) for shape, coil in coils.items()},
        "array": _array_table(array, shapes, names, layers),
        "board": {"margin_mm": _entry(array.board_margin, _MM), "through_holes": array.through_holes},
    }
    if design.sheets:
        document["elastomer"] = _sheet_tables(design.sheets)
        if design.indentation is not None:
            document["indenter"] = _indenter_table(design.indentation)
            document["indentation"] = _indentation_table(design.indentation, names)
    if design.plates:
        document["plate"] = _plate_tables(design.plates)
    if design.target is not None:
        document["target"] = _target_table(design.target, names)
    document["circuit"] = _circuit_table(design.circuit, names)
    document["readout"] = _readout_table(design.readout)
    if design.circuit.scan:
        document["scan"] = list(_scan_tables(design.circuit, names))
    document["field"] = {"height_mm": _entry(design.field_height, _MM)}
    document["fab"] = _fab_table(design.rules)
    return {key: table for key, table in document.items() if table != {}}


def _before_connector(array: CoilArray) -> tuple[CoilArray, dict[str, Any] | None]:
    """Return an array before its leads were routed.

    The connector's table is returned with it. The table is None without a connector.
    """
    led = array.routing
    if led is None or led.placements != array.placements:
        return array, None  # the placements have been changed since
    table = {"side": led.connector.side} | _entries(led.connector, *list(ConnectorTable.model_fields)[1:])
    stackup, margin, through = array.stackup, array.board_margin, array.through_holes
    return replace(led.array, stackup=stackup, board_margin=margin, through_holes=through), table


def as_file(design: Design | DesignFile) -> DesignFile:
    """Return a design with a document.

    A file is returned unchanged. A design gets its `design_document`.
    """
    if isinstance(design, DesignFile):
        return design
    return replace(build_design_file(design_document(design), design.name), design=design)


def design_text(design: Design, assumed: Mapping[str, str] | None = None) -> str:
    """Return the TOML text of a design.

    Places are rounded to 1 nm, and other numbers to 12 digits. Placements that share a `Coil` share its table, see
    `shape_names`. `assumed` has dotted keys of the design whose values are assumed, with the reason. ``coils.*.KEY``
    stands for every shape, and ``coils.NAME.KEY`` for the shape of the coil NAME.
    """
    document = _rounded(design_document(design))
    shapes = shape_names(design.array)
    reasons = _assumed_table(assumed or {}, dict(zip(design.array.names, shapes, strict=True)), list(document["coils"]))
    return document_text(document | ({"assumed": reasons} if reasons else {}))


def document_text(document: Mapping[str, Any]) -> str:
    """Return the TOML text of a document.

    Lists of plain values are on one line. Every table of a list has a header.
    """
    import tomli_w

    def is_tables(value: object) -> bool:
        return isinstance(value, list) and bool(value) and all(isinstance(item, dict) for item in value)

    plain = {key: value for key, value in document.items() if not (isinstance(value, dict) or is_tables(value))}
    blocks = [tomli_w.dumps(plain)] if plain else []
    for key, value in document.items():
        if is_tables(value):  # tomli-w writes short tables on one line
            blocks += [f"[[{key}]]\n" + _HEADER.sub(f"[{key}.", tomli_w.dumps(table)) for table in value]
        elif key not in plain:
            blocks.append(tomli_w.dumps({key: value}))
    return _LISTS_OF_NAMES.sub(_short, _FLAT_LIST.sub(_on_one_line, "\n".join(blocks)))


def shape_names(array: CoilArray) -> list[str]:
    """Return the name of each placement's coil table.

    It is the coil's own name, else shape1, shape2, … All names of different tables differ.
    """
    found: dict[int, str] = {}
    for place in array.placements:
        if id(place.coil) not in found:
            name = place.coil.name or f"shape{len(found) + 1}"
            found[id(place.coil)] = _different(name, found.values())
    return [found[id(place.coil)] for place in array.placements]


def design_names(names: Iterable[str]) -> dict[str, str]:
    """Return an allowed name of a design for each name.

    Allowed are letters, digits, _ . + and, not first, -. All names are different.

    Examples
    --------
    >>> design_names(["/coil 1", "coil_1", "Top"])
    {'/coil 1': 'coil_1', 'coil_1': 'coil_1_2', 'Top': 'Top'}
    """
    found: dict[str, str] = {}
    for name in names:
        found[name] = _different(name, found.values())
    return found


def _different(name: str, taken: Iterable[str]) -> str:
    """Return an allowed name that is not taken."""
    allowed = _NOT_IN_NAMES.sub("_", name.lstrip("/")).lstrip("-") or "_"
    different, n, others = allowed, 1, set(taken)
    while different in others:
        n += 1
        different = f"{allowed}_{n}"
    return different


def _stackup_table(stackup: Stackup, layers: Mapping[str, str]) -> dict[str, Any]:
    """Table of the stack-up."""
    return {
        "layers": [layers[name] for name in stackup.names],
        "copper_thickness_um": [_entry(value, _UM) for value in stackup.copper_thickness],
        "dielectric_thickness_mm": [_entry(value, _MM) for value in stackup.dielectric_thickness],
        "dielectric_epsilon_r": [float(value) for value in stackup.epsilon_r],
    }


def _coil_table(coil: Coil) -> dict[str, Any]:
    shape = None if coil.wound is None else _shape_table(coil.wound.spiral)
    return _path_table(coil) if coil.wound is None or shape is None else shape | _wound_table(coil.wound)


def _wound_table(of: Wound) -> dict[str, Any]:
    """Table entries of a wound coil."""
    table: dict[str, Any] = {
        "turns_per_layer": float(of.spiral.turns),
        "winding_layers": of.winding_layers,
        **_entries(of.spiral, "trace_width_mm", "gap_mm"),
        "winding": of.spiral.winding,
        "return_lead": of.return_lead,
        "via": _entries(of.via, *_VIA),
    }
    return table if of.leads is None else table | {"leads": _leads_table(of.leads, of.via)}


def _shape_table(spiral: Winding) -> dict[str, Any] | None:
    """Shape and sizes of a winding.

    The result is None for a rectangle that is not along x and y, which a file can only trace.
    """
    if isinstance(spiral, Spiral):
        rule = {"winding_rule": spiral.winding_rule}
        return _polygon_table(spiral.sides, spiral.outer_apothem) | _entries(spiral, "first_corner_deg") | rule
    assert isinstance(spiral, RoundedSpiral)  # no other kind exists
    start = _entry(spiral.direction, _DEG)
    if spiral.is_circle:
        return {
            "shape": "circle",
            "outer_diameter_mm": _entry(spiral.extent, _MM),
            "first_corner_deg": start,
        }
    quarter = round(spiral.direction / (math.pi / 2)) % 4
    if spiral.sides == 4 and abs(math.remainder(spiral.direction, math.pi / 2)) < _TURNED:
        sizes = (spiral.extent, spiral.breadth) if quarter % 2 == 0 else (spiral.breadth, spiral.extent)
        table = {
            "shape": "racetrack" if spiral.is_racetrack else "rectangle",
            "outer_width_mm": _entry(sizes[0], _MM),
            "outer_height_mm": _entry(sizes[1], _MM),
            "first_side": SIDES[quarter],
            "winding_rule": spiral.winding_rule,
        }
        return table if spiral.is_racetrack else table | _entries(spiral, "corner_radius_mm")
    if spiral.extent != spiral.breadth or not spiral.corner_radius:
        return None
    half = half_side(spiral.sides, spiral.winding)
    corner = _number((spiral.direction - half) / _DEG, spiral.direction, lambda entry: entry * _DEG + half, places=True)
    table = _polygon_table(spiral.sides, spiral.extent / 2) | _entries(spiral, "corner_radius_mm")
    return table | {"first_corner_deg": corner, "winding_rule": spiral.winding_rule}


def _polygon_table(sides: int, apothem: float) -> dict[str, Any]:
    """Sides and size of a polygon.

    The size is across flats or across corners, whichever has fewer digits.
    """
    sizes = {}
    for across, size in (("flats", 2 * apothem), ("corners", 2 * apothem / math.cos(math.pi / sides))):
        sizes[f"outer_across_{across}_mm"] = _number(
            size * 1e3,
            apothem,
            lambda entry, across=across: apothem_from_size(entry * _MM, sides, across=across),  # type: ignore[misc]
        )
    key = min(sizes, key=lambda key: len(repr(sizes[key])))
    return {"shape": "polygon", "sides": sides, key: sizes[key]}


def _leads_table(leads: Leads, via: PlatedHole) -> dict[str, float]:
    own = ("pad_mm", "drill_mm") if leads.terminal.plating == via.plating else ("pad_mm", "drill_mm", "plating_um")
    return _entries(leads, "length_mm", "spacing_mm") | _entries(leads.terminal, *own)


def _path_table(coil: Coil) -> dict[str, Any]:
    """Table of a coil as paths."""
    widths = [[_entry(width, _MM) for width in line.tolist()] for line in coil.widths]
    uniform = {width for line in widths for width in line}
    table: dict[str, Any] = {
        "shape": "path",
        "lines_mm": [_points(line.tolist()) for line in coil.lines],
        "trace_width_mm": uniform.pop() if len(uniform) == 1 else widths,
        "gap_mm": _entry(coil.gap, _MM),
        "terminals": coil.terminal is not None,
    }
    if coil.terminal is not None:
        table["terminal_pad_mm"] = _entry(coil.terminal.pad, _MM)
        table["terminal_drill_mm"] = _entry(coil.terminal.drill, _MM)
        if coil.terminal.plating != coil.via.plating:
            table["terminal_plating_um"] = _entry(coil.terminal.plating, _UM)
    hull = hull_outline(coil)
    if hull.shape != coil.outline.shape or not np.allclose(hull, coil.outline, rtol=0, atol=_PICOMETRE):
        table["outline_mm"] = _points(coil.outline.tolist())
    return table | {"via": _entries(coil.via, *_VIA)}


def _points(points: Sequence[Sequence[float]]) -> list[list[float]]:
    return [[_place(x), _place(y)] for x, y in points]


def _array_table(
    array: CoilArray, shapes: Sequence[str], names: Mapping[str, str], layers: Mapping[str, str]
) -> dict[str, Any]:
    """Table of an array as a lattice or free placements."""
    lattice = array.lattice
    if lattice is not None and _is_on(lattice, array):
        table: dict[str, Any] = {
            "lattice": lattice.kind,
            "coil": shapes[0],
            **_lattice_size(lattice),
            **_entries(lattice, "direction_deg", "rotation_deg"),
            "layers": [[layers.get(layer, layer) for layer in each] for each in lattice.layers],
        }
        if lattice.layer_shift is not None:
            table["layer_shift_per_row"] = lattice.layer_shift
        if lattice.names is not None:
            table["names"] = [names[name] for name in lattice.names]
        return table
    return {
        "lattice": "free",
        "placements": [
            {
                "name": names[place.name],
                "coil": shape,
                "layers": [layers[layer] for layer in place.layers],
                **_entries(place, "x_mm", "y_mm", "rotation_deg", places=True),
            }
            for shape, place in zip(shapes, array.placements, strict=True)
        ],
    }


def _lattice_size(lattice: Lattice) -> dict[str, Any]:
    if lattice.kind == "single":
        return {}
    count = {"rings": lattice.rings} if lattice.rings else {"columns": lattice.columns, "rows": lattice.rows}
    return count | _entries(lattice, "pitch_mm")


def _is_on(lattice: Lattice, array: CoilArray) -> bool:
    """Check whether a lattice gives the placements of an array."""
    coil = array.placements[0].coil
    points = lattice.placements(coil)
    if len(array.placements) != len(points) or any(p.coil is not coil for p in array.placements):
        return False
    return all(
        (one.name, one.layers) == (other.name, other.layers)
        and max(abs(one.x - other.x), abs(one.y - other.y), abs(one.rotation - other.rotation)) < 1e-3 * _PICOMETRE
        for one, other in zip(points, array.placements, strict=True)
    )


def _sheet_tables(sheets: Sequence[Sheet]) -> list[dict[str, Any]]:
    """Tables of the elastomer sheets."""
    names = design_names(sheet.name for sheet in sheets)
    return [
        {
            "name": names[sheet.name],
            **_entries(sheet, "thickness_mm"),
            "relative_permeability": float(sheet.relative_permeability),
            **_entries(sheet, "youngs_modulus_kPa"),
            "poissons_ratio": float(sheet.poissons_ratio),
        }
        for sheet in sheets
    ]


def _plate_tables(plates: Sequence[Plate | FinitePlate]) -> list[dict[str, Any]]:
    """Tables of the plates."""
    names = design_names(plate.name for plate in plates)
    tables = []
    for plate in plates:
        table = {"name": names[plate.name], **flat_entries(plate, _entry, _place)}
        if isinstance(plate, FinitePlate):
            x, y, z = plate.centre
            table |= {"x_mm": _place(x), "y_mm": _place(y), "z_mm": _place(z - plate.thickness / 2)}
        else:
            table["z_mm"] = _place(plate.z)
        tables.append(table)
    return tables


def _indenter_table(setup: Indentation) -> dict[str, Any]:
    """Table of the indenter."""
    indenter = setup.indenter
    table: dict[str, Any] = {"shape": indenter.name.replace(" ", "_")}
    if isinstance(indenter, Cone):
        table["half_angle_deg"] = _entry(indenter.half_angle, _DEG)
    if math.isfinite(indenter.radius):
        table["radius_mm"] = _entry(indenter.radius, _MM)
    if isinstance(indenter, Cone | FlatPunch) and indenter.edge_radius is not None:
        table["edge_radius_mm"] = _entry(indenter.edge_radius, _MM)
    return table if setup.material is None else table | material_entries(setup.material, _entry)


def _uneven(seat: Unevenness) -> dict[str, Any]:
    """Return the keys that differ from an even seat."""
    (stiffer_x, stiffer_y), (wider_x, wider_y) = seat.stiffness_slope, seat.gap_slope
    keys = {
        "seat_stiffness_slope_x_per_mm": _entry(stiffer_x, 1e3),
        "seat_stiffness_slope_y_per_mm": _entry(stiffer_y, 1e3),
        "seat_gap_slope_x_mm_per_mm": wider_x,
        "seat_gap_slope_y_mm_per_mm": wider_y,
        "seat_lifts": seat.lifts,
        "seat_weight_Pa": seat.weight,
    }
    return {key: value for key, value in keys.items() if value}


def _indentation_table(setup: Indentation, names: Mapping[str, str]) -> dict[str, Any]:
    """Table of the indentation."""
    table: dict[str, Any] = {"strain": setup.strain}
    if isinstance(setup.base, Seat):
        table |= {"base": "seat", "seat_stiffness_kPa_per_mm": _entry(setup.base.stiffness, KPA_PER_MM)}
        if setup.base.shear:
            table["seat_shear_kPa_per_mm"] = _entry(setup.base.shear, KPA_PER_MM)
    else:
        table["base"] = setup.base
    table |= _uneven(setup.unevenness)
    table["depths_mm"] = [_entry(depth, _MM) for depth in setup.depths]
    table |= _places(setup, names)
    if setup.sample_radius is not None:
        table["sample_radius_mm"] = _entry(setup.sample_radius, _MM)
    if setup.sample_bounds is not None:
        x_min, y_min, x_max, y_max = map(_place, setup.sample_bounds)
        table |= {"sample_x_mm": [x_min, x_max], "sample_y_mm": [y_min, y_max]}
    if setup.ellipse_bounds is not None:
        x_min, y_min, x_max, y_max = map(_place, setup.ellipse_bounds)
        table |= {"ellipse_x_mm": [x_min, x_max], "ellipse_y_mm": [y_min, y_max]}
    return table


def _target_table(target: Target, names: Mapping[str, str]) -> dict[str, Any]:
    """Table of the target."""
    body = target.body
    if isinstance(body, Ball):
        table = {
            "shape": "sphere",
            "diameter_mm": _entry(body.radius, _MM / 2),
            **material_entries(body.material, _entry),
        }
    else:
        table = {"shape": "plate", **flat_entries(body, _entry, _place)}
    table["distances_mm"] = [_number(1e3 * v, v, lambda mm: mm / 1e3) for v in target.distances]
    return table if isinstance(body, Plate) else table | _places(target, names)


def _places(setup: Indentation | Target, names: Mapping[str, str]) -> dict[str, Any]:
    """Keys of the positions of a map and their origin."""
    table: dict[str, Any]
    x, y = ([_number(1e3 * v, v, lambda mm: mm / 1e3, places=True) for v in row] for row in (setup.x, setup.y))
    step = next((round(row[1] - row[0], 9) for row in (x, y) if len(row) > 1), 1.0)
    if (setup.x, setup.y) == setup.over_array:
        table = {} if setup.step is None else {"step_mm": _entry(setup.step, _MM)}
    elif _is_regular(x, step) and _is_regular(y, step):
        table = {"x_mm": [x[0], x[-1]], "y_mm": [y[0], y[-1]], "step_mm": step}
    else:
        table = {"x_positions_mm": x, "y_positions_mm": y}
    if setup.origin is not None:
        table["origin"] = names[setup.origin]
    elif any(setup.origin_point):
        table["origin_mm"] = [_place(value) for value in setup.origin_point]
    return table


def _is_regular(row: Sequence[float], step: float) -> bool:
    """Check whether positions form a range with a step.

    The positions are in mm.
    """
    if step <= 0 or round((row[-1] - row[0]) / step) != len(row) - 1:
        return False
    positions = np.array(map_positions((row[0], row[-1]), step))
    return np.allclose(positions, np.array(row) / 1e3, rtol=0, atol=1e-3 * _PICOMETRE)


def _circuit_table(circuit: Circuit, names: Mapping[str, str]) -> dict[str, Any]:
    """Table of the circuit without defaults."""
    switches = circuit.switches
    table = {
        "capacitance_pF": _entry(switches.tank_capacitance, _PF),
        "short_resistance_ohm": 2.0 * switches.on_resistance,
        "resistivity_ohm_m": circuit.resistivity,
        "switch_off_capacitance_pF": _entry(switches.off_capacitance, _PF),
        **_entries(switches, "terminal_capacitance_pF", "bus_capacitance_pF", "lead_inductance_nH"),
        "tank": switches.tank_at,
        "elastomer_permittivity": float(circuit.elastomer_permittivity),
        "default_termination": _WORDS[circuit.default_termination],
        "terminations": {names[coil]: _WORDS[passive] for coil, passive in circuit.terminations.items()},
    }
    short = _without_defaults(table, CircuitTable())
    if circuit.part is None:
        return short
    # Beside a part even a default has a meaning: the part's value does not count.
    return {key: value for key, value in table.items() if key in short or key in OF_PART} | {"switches": circuit.part}


def _readout_table(readout: Readout) -> dict[str, Any]:
    table = ReadoutTable.of(readout).model_dump(exclude_none=True)
    return _without_defaults(table, ReadoutTable())


def _scan_tables(circuit: Circuit, names: Mapping[str, str]) -> Iterator[dict[str, Any]]:
    """Yield the tables of the scan's states."""
    states = design_names(state.name for state in circuit.scan)
    for state in circuit.scan:
        yield {
            "name": states[state.name],
            "measure": [f"{'-' if sense < 0 else ''}{names[coil]}" for coil, sense in state.measured],
            "connection": state.connection,
            "others": state.others,
            "exceptions": {names[coil]: passive for coil, passive in state.exceptions.items()},
            "load_ohm": float(state.load_resistance),
        }


def _fab_table(rules: FabRules) -> dict[str, Any]:
    keys = (key for key in FabTable.model_fields if key != "profile")
    return _without_defaults(_entries(rules, *keys), FabTable())


def _assumed_table(assumed: Mapping[str, str], of_coil: Mapping[str, str], shapes: list[str]) -> dict[str, str]:
    """Table of assumed values with the keys of the file."""
    table: dict[str, str] = {}
    for key, reason in assumed.items():
        owners = [name for name in of_coil if key.startswith(f"coils.{name}.")]
        if key.startswith("coils.*."):
            table |= {f"coils.{shape}.{key.removeprefix('coils.*.')}": reason for shape in shapes}
        elif owners:
            name = max(owners, key=len)
            table[f"coils.{of_coil[name]}.{key.removeprefix(f'coils.{name}.')}"] = reason
        else:
            table[key] = reason
    return table


def _without_defaults(entries: Mapping[str, Any], table: Table) -> dict[str, Any]:
    default = table.model_dump()
    return {key: value for key, value in entries.items() if value != default[key]}


def _entries(of: object, *keys: str, places: bool = False) -> dict[str, Any]:
    """Return entries whose keys are names of attributes.

    Most keys have a unit. Entries that are None are left out.
    """
    found = {}
    for key in keys:
        name, _, unit = key.rpartition("_")
        value = getattr(of, name if unit in SCALES else key)
        if unit in SCALES and isinstance(value, tuple):
            value = [_entry(side, SCALES[unit]) for side in value]
        elif unit in SCALES and value is not None:
            value = _entry(value, SCALES[unit], places=places)
        if value is not None:
            found[key] = value
    return found


def _entry(value: float, unit: float, *, places: bool = False) -> float:
    """Return the entry that is read as a value.

    The value is `unit` times the entry. For `places` zero is not a special value.
    """
    return _number(value / unit, value, lambda entry: entry * unit, places=places)


def _place(value: float) -> float:
    return _entry(value, _MM, places=True)


def _number(guess: float, value: float, read: Callable[[float], float], *, places: bool = False) -> float:
    """Return the entry that is read as a value.

    It is near a guess, and `read` converts it to the value. It is the shortest exact entry, or the nearest if no entry
    is exact. About every fortieth value has no exact entry, because numbers in mm lie less densely than numbers in m.
    The nearest entry agrees to all digits that count for `Design.digest`.
    """
    for digits in (12, 15, 16, 17):
        entry = float(f"{guess:.{digits}g}")
        if read(entry) == value:
            return entry + 0.0  # no minus zero
    for entry in (math.nextafter(guess, math.inf), math.nextafter(guess, -math.inf)):
        if read(entry) == value:
            return entry
    return guess if places else guess * (float(f"{value:.14g}") / value)


def _rounded(value: Any, key: str = "") -> Any:
    """Round places to 1 nm and numbers to 12 digits."""
    if isinstance(value, dict):
        return {name: _rounded(item, name) for name, item in value.items()}
    if isinstance(value, list):
        return [_rounded(item, key) for item in value]
    if not isinstance(value, float):
        return value
    return (round(value, 6) if key in _PLACES else float(f"{value:.12g}")) + 0.0


def _on_one_line(match: re.Match[str]) -> str:
    text = "[" + ", ".join(item.strip() for item in match[1].split(",\n")) + "]"
    return text if len(text) <= _LONGEST_LINE else "\n".join(textwrap.wrap(text, _LONGEST_LINE))


def _short(match: re.Match[str]) -> str:
    text = "[" + " ".join(line.strip() for line in match[0].splitlines()[1:-1]).rstrip(",") + "]"
    return text if len(text) <= _LONGEST_LINE // 2 else match[0]
