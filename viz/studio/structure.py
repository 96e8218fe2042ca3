"""Structure of a design in its document: coils, places and lattice, layers, leads and sheets."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from functools import reduce
from operator import getitem
from typing import Any, get_args

from coilarray.design.fab_limits import load_profile
from coilarray.design.model import Design
from coilarray.design.vary import no_longer_assumed
from coilarray.errors import DesignError
from coilarray.geometry.array import LatticeKind
from coilarray.viz.studio.services import Document

LATTICES = (*get_args(LatticeKind), "free")
"""Kinds of lattice that an array may have."""

BASES = ("bonded", "frictionless", "seat")
"""Possible bases of the lowest sheet."""

_SHEET: Mapping[str, float] = {"thickness_mm": 1.0, "relative_permeability": 1.0, "youngs_modulus_kPa": 100.0}
_INDENTED: Mapping[str, Mapping[str, Any]] = {
    "indenter": {"shape": "hemisphere", "radius_mm": 2.0},
    "indentation": {"depths_mm": [0.3]},
}
_SEAT = 1000.0  # kPa/mm
_MADE_UP = "set by the studio"  # reason for values that nobody has chosen
_APART = 1.25  # pitch from a first coil to a second, in widths of the coil


def add_coil(document: Document, design: Design) -> Document:
    """Add a coil beside the rightmost coil."""
    places = _placements(document, design)
    names = [place["name"] for place in places]
    k = next(k for k in range(1, len(names) + 2) if f"coil{k}" not in names)
    rightmost = max(places, key=lambda place: float(place["x_mm"]))
    layers = list(dict.fromkeys(tuple(place["layers"]) for place in places))
    following = layers[(layers.index(tuple(rightmost["layers"])) + 1) % len(layers)]
    lattice = design.array.lattice
    pitch = lattice.pitch if lattice is not None and lattice.pitch else _APART * _width(design)
    x = round(rightmost["x_mm"] + pitch * 1e3, 6)
    added = {**rightmost, "name": f"coil{k}", "layers": list(following), "x_mm": x}
    made_up = (f"array.placements.{len(places)}.{key}" for key in ("layers", "x_mm"))
    return _made_up(_free(document, [*places, added]), *made_up)


def remove_coil(document: Document, design: Design, name: str) -> Document:
    """Remove a coil and its own entries."""
    every = _placements(document, design)
    places = [place for place in every if place["name"] != name]
    if not places:
        raise DesignError(f"{name} cannot be removed: an array must have a coil.")
    changed = _without_coils(_free(document, places), design, [place["name"] for place in places])
    unused = {place["coil"] for place in every} - {place["coil"] for place in places}
    coils = {shape: table for shape, table in document["coils"].items() if shape not in unused}
    return no_longer_assumed({**changed, "coils": coils}, [f"coils.{shape}" for shape in unused])


def place_coil(document: Document, design: Design, name: str, key: str, value: float) -> Document:
    """Set ``x_mm``, ``y_mm`` or ``rotation_deg`` of a coil."""
    new = {key: value}
    places = _placements(document, design)
    return _free(document, [{**place, **new} if place["name"] == name else place for place in places])


def place_on(document: Document, design: Design, name: str, layers: Sequence[str]) -> Document:
    """Lay a coil on other copper layers."""
    if not layers:
        known = " ".join(document["stackup"]["layers"])
        raise DesignError(f"layers of {name} must be some of {known}; got none.")
    on = {"layers": list(layers)}
    places = _placements(document, design)
    return _free(document, [{**place, **on} if place["name"] == name else place for place in places])


def set_lattice(document: Document, design: Design, kind: str) -> Document:
    """Lay coils of the first shape on a lattice."""
    if kind == "free":
        return _free(document, _placements(document, design))
    places, old = _placements(document, design), document["array"]
    if kind not in LATTICES:
        raise DesignError(f"array.lattice must be one of {', '.join(LATTICES)}; got {kind!r}.")
    sizes, points = lattice_sizes(kind, len(places))
    layers = list(dict.fromkeys(tuple(place["layers"]) for place in places))
    pitch = old.get("pitch_mm", round(_APART * _width(design) * 1e3, 2))
    table = {"lattice": kind, "coil": places[0]["coil"], **sizes} | ({} if kind == "single" else {"pitch_mm": pitch})
    table["layers"] = [list(each) for each in (layers[:1] if kind == "single" else layers)]
    table |= {key: old[key] for key in ("direction_deg", "rotation_deg") if key in old}
    usual = [f"coil{k + 1}" for k in range(points)]
    names = [place["name"] for place in places][:points]
    names += [name for name in (*usual, *(f"coil{points + k + 1}" for k in range(points))) if name not in names]
    names = names[:points]
    if names != usual:
        table["names"] = names
    changed = _renamed(
        {**document, "array": table},
        lambda key: key if key[:6] != "array." or (key[6:] in old and old[key[6:]] == table.get(key[6:])) else None,
    )
    changed = _without_coils(changed, design, names)
    return changed if kind == "single" or "pitch_mm" in old else _made_up(changed, "array.pitch_mm")


def lattice_sizes(kind: str, count: int) -> tuple[dict[str, int], int]:
    """Entries and number of coils of a lattice.

    The lattice of the kind has about `count` coils. The second result is its exact number of coils.

    Examples
    --------
    >>> lattice_sizes("square", 7), lattice_sizes("rings", 16), lattice_sizes("single", 3)
    (({'columns': 3, 'rows': 3}, 9), ({'rings': 2}, 19), ({}, 1))
    """
    if kind in ("single", "free"):
        return {}, 1 if kind == "single" else count
    if kind == "linear":
        return {"columns": count}, count
    if kind == "rings":
        rings = min(range(1, 2 + math.isqrt(count)), key=lambda n: abs(_in_rings(n) - count))
        return {"rings": rings}, _in_rings(rings)
    if kind == "triangle":
        columns = math.ceil(math.sqrt(2 * count + 0.25) - 0.5)
        return {"columns": columns}, columns * (columns + 1) // 2
    columns = max(1, round(math.sqrt(count)))
    rows = math.ceil(count / columns)
    return {"columns": columns, "rows": rows}, columns * rows


def _in_rings(rings: int) -> int:
    """Count the coils in rings of hexagons about one coil."""
    return 3 * rings * (rings + 1) + 1


def set_layers(document: Document, _: Design, number: float) -> Document:
    """Set the number of copper layers of a board of the same thickness."""
    stackup = document["stackup"]
    names = list(stackup["layers"])
    if not (1 <= number <= 64 and number == (count := int(number))):
        raise DesignError(f"copper layers must be a whole number from 1 to 64; got {number:g}.")
    free = (name for k in range(1, 2 * count + len(names) + 1) if (name := f"L{k}") not in names)
    names = [*names, *(next(free) for _ in range(count - len(names)))][:count]
    table = {**stackup, "layers": names}
    usual = {"copper_thickness_um": (35.0, 0), "dielectric_thickness_mm": (0.2, 1), "dielectric_epsilon_r": (4.5, 1)}
    for key, (value, less) in usual.items():
        values = list(stackup.get(key, []))
        table[key] = (values + [values[-1] if values else value] * count)[: count - less]
    before, thick = stackup.get("dielectric_thickness_mm", []), table["dielectric_thickness_mm"]
    if before and thick:
        table["dielectric_thickness_mm"] = [round(each * sum(before) / sum(thick), 4) for each in thick]
    changed = [key for key, values in table.items() if values != list(stackup.get(key, []))[: len(values)]]
    return on_its_layers(_made_up({**document, "stackup": table}, *(f"stackup.{key}" for key in changed)))


def on_its_layers(document: Document) -> dict[str, Any]:
    """Lay coils on as many layers as they have, or raise DesignError."""
    array, free = document["array"], document["array"]["lattice"] == "free"
    names = list(document["stackup"]["layers"])
    laid = [(place["coil"], tuple(place["layers"])) for place in array["placements"]] if free else [
        (array["coil"], tuple(layers)) for layers in array["layers"]
    ]  # fmt: skip
    new = dict[tuple[str, tuple[str, ...]], list[str]]()
    for shape, layers in dict.fromkeys(laid):
        winding = document["coils"][shape].get("winding_layers", len(layers))
        if not (isinstance(winding, int) and winding > 0):
            return dict(document)  # refused later by its key
        if winding > len(names):
            board = f"{len(names)} copper layer{'' if len(names) == 1 else 's'}"
            raise DesignError(f"coils.{shape}.winding_layers is {winding}; the board has {board} only.")
        first = winding * sum(one == shape for one, _ in new) % (len(names) - len(names) % winding)
        kept = len(layers) == winding and set(layers) <= set(names)
        new[shape, layers] = list(layers) if kept else names[first : first + winding]
    if all(list(layers) == found for (_, layers), found in new.items()):
        return dict(document)
    if free:
        places = [{**place, "layers": new[one]} for place, one in zip(array["placements"], laid, strict=True)]
        moved = (f"array.placements.{k}.layers" for k, one in enumerate(laid) if list(one[1]) != new[one])
        return _made_up({**document, "array": {**array, "placements": places}}, *moved)
    sets = list(map(list, dict.fromkeys(map(tuple, new.values()))))
    return _made_up({**document, "array": {**array, "layers": sets}}, "array.layers")


def set_house(document: Document, _: Design, house: str) -> Document:
    """Use the limits of a board house, and no others."""
    changed = no_longer_assumed({**document, "fab": {"profile": house}}, ["fab"])
    rules, copper = load_profile(house).rules, list(document["stackup"]["copper_thickness_um"])
    limits = [rules.most_copper(k, len(copper)) for k in range(len(copper))]
    made = [one if most is None else min(one, round(most * 1e6, 6)) for one, most in zip(copper, limits, strict=True)]
    if made == copper:
        return changed
    stackup = {**document["stackup"], "copper_thickness_um": made}
    return _assumed({**changed, "stackup": stackup}, {"stackup.copper_thickness_um": f"the most that {house} makes"})


def set_leads(document: Document, _: Design, *, there: bool, before: Sequence[Document] = ()) -> Document:
    """Give wound coils leads as in the first document `before` with any, or none."""
    coils, reasons = dict(document["coils"]), dict[str, str]()
    for shape, table in coils.items():
        if table.get("shape") == "path" or (there and "leads" in table):
            continue
        leads, why = _as_before(before, "coils", shape, "leads")
        coils[shape] = {key: value for key, value in table.items() if key != "leads"} | (
            {"leads": leads} if there else {}
        )
        reasons |= why
    changed = {**document, "coils": coils}
    if there:
        return _assumed(changed, reasons)
    return _renamed(changed, lambda key: None if re.match(r"coils\..*\.leads\.", key) else key)


def set_connector(document: Document, _: Design, edge: str, *, before: Sequence[Document] = ()) -> Document:
    """Lead all coils to a connector at an edge.

    Its other entries are taken from the document, or from the first of `before` that had a connector. The edge
    ``"none"`` removes the connector.
    """
    if edge == "none":
        rest = {key: table for key, table in document.items() if key != "connector"}
        return no_longer_assumed(rest, ["connector"])
    table, reasons = _as_before((document, *before), "connector")
    rest = {key: why for key, why in reasons.items() if key != "connector.side"}
    return _assumed({**document, "connector": {**table, "side": edge}}, rest)


def add_sheet(document: Document, _: Design) -> Document:
    """Add a sheet on top of the others."""
    sheets = list(document.get("elastomer", []))
    names = [sheet["name"] for sheet in sheets]
    name = next(name for k in range(1, len(names) + 2) if (name := f"sheet{k}") not in names)
    new = {table: values for table, values in _INDENTED.items() if not sheets and table not in document}
    keys = [f"{table}.{key}" for table, values in new.items() for key in values]
    keys += [f"elastomer.{len(sheets)}.{key}" for key in _SHEET]
    return _made_up({**new, **document, "elastomer": [*sheets, {"name": name, **_SHEET}]}, *keys)


def remove_sheet(document: Document, _: Design, index: int) -> Document:
    """Remove a sheet by its number from below."""
    changed = without_entry(document, "elastomer", index)
    if "elastomer" in changed:
        return changed
    gone = ("indenter", "indentation")
    return no_longer_assumed({key: table for key, table in changed.items() if key not in gone}, gone)


def without_entry(document: Document, table: str, index: int) -> Document:
    """Remove a table from a list by its number."""
    entries = list(document.get(table, []))
    if not 0 <= index < len(entries):
        raise DesignError(f"{table} must have an entry of number {index}; there are {len(entries)}.")
    del entries[index]

    def renamed(key: str) -> str | None:
        parts = key.split(".")
        if parts[0] != table:
            return key
        k = int(parts[1])
        return None if k == index else ".".join([table, str(k - (k > index)), *parts[2:]])

    rest = {key: value for key, value in document.items() if key != table}
    return _renamed({**document, table: entries} if entries else rest, renamed)


def set_base(document: Document, _: Design, base: str, *, before: Sequence[Document] = ()) -> Document:
    """Set the base of the lowest sheet, on a seat as `before` if it had one."""
    if base not in BASES:
        raise DesignError(f"indentation.base must be one of {', '.join(BASES)}; got {base!r}.")
    if "indentation" not in document:
        raise DesignError("indentation is missing: a base is of sheets that are pressed.")
    table = {key: value for key, value in document["indentation"].items() if not key.startswith("seat_")}
    seat, reasons = _as_before((document, *before), "indentation", start="seat_") if base == "seat" else ({}, {})
    chosen = [f"indentation.{key}" for key in ("base", *(key for key in document["indentation"] if key[:5] == "seat_"))]
    changed = no_longer_assumed({**document, "indentation": {**table, "base": base, **seat}}, chosen)
    if base != "seat" or seat:
        return _assumed(changed, reasons)
    key = "seat_stiffness_kPa_per_mm"
    return _made_up({**changed, "indentation": {**changed["indentation"], key: _SEAT}}, f"indentation.{key}")


def _as_before(before: Sequence[Document], *path: str, start: str = "") -> tuple[dict[str, Any], dict[str, str]]:
    """Entries that begin with `start` in the first document with any."""
    for document in before:
        try:
            table = reduce(getitem, path, document)
        except KeyError:
            continue
        found = {key: value for key, value in table.items() if key.startswith(start)}
        if found or not start:
            begin = ".".join((*path, start))
            return found, {key: why for key, why in document.get("assumed", {}).items() if key.startswith(begin)}
    return {}, {}


def _placements(document: Document, design: Design) -> list[dict[str, Any]]:
    """Places of all coils as in a file."""
    if document["array"]["lattice"] == "free":
        return [dict(place) for place in document["array"]["placements"]]
    array = design.array.unrouted
    return [
        {
            "name": place.name, "coil": document["array"]["coil"], "layers": list(place.layers),
            "x_mm": round(place.x * 1e3, 6), "y_mm": round(place.y * 1e3, 6),
            "rotation_deg": round(math.degrees(place.rotation), 9),
        }
        for place in array.placements
    ]  # fmt: skip


def _free(document: Document, places: list[dict[str, Any]]) -> dict[str, Any]:
    """Give every coil its own place."""
    old = document["array"].get("placements", [])
    numbers = {place["name"]: k for k, place in enumerate(places)}

    def renamed(key: str) -> str | None:
        """Rename the key of an assumption to the new place."""
        table, *rest = key.split(".")
        if table != "array":
            return key
        if rest[0] != "placements":
            return None
        was, entry = old[int(rest[1])], rest[2]
        k = numbers.get(was["name"])
        same = k is not None and places[k].get(entry) == was.get(entry)
        return f"array.placements.{k}.{entry}" if same else None

    return _renamed({**document, "array": {"lattice": "free", "placements": places}}, renamed)


def _without_coils(document: Document, design: Design, names: Sequence[str]) -> dict[str, Any]:
    """Remove the terminations of coils that are gone."""
    changed, gone = dict(document), list[str]()
    ends = document.get("circuit", {}).get("terminations", {})
    if set(ends) - set(names):
        kept = {name: end for name, end in ends.items() if name in names}
        changed["circuit"] = {**document["circuit"], "terminations": kept}
        gone += [f"circuit.terminations.{name}" for name in ends if name not in names]
    moved = dict[str, str]()
    for key, setup in (("indentation", design.indentation), ("target", design.target)):
        table = document.get(key, {})
        if setup is not None and table.get("origin", names[0]) not in names:
            rest = {entry: value for entry, value in table.items() if entry != "origin"}
            changed[key] = {**rest, "origin_mm": [round(value * 1e3, 6) for value in setup.origin_point]}
            moved[f"{key}.origin"] = f"{key}.origin_mm"
    return no_longer_assumed(_renamed(changed, lambda key: moved.get(key, key)), gone)


def _width(design: Design) -> float:
    """Width of the first coil's outline in m."""
    x = design.array.placements[0].coil.outline[:, 0]
    return float(x.max() - x.min())


def _made_up(document: Document, *keys: str) -> dict[str, Any]:
    """Mark values by their keys as set by the studio."""
    return _assumed(document, dict.fromkeys(keys, _MADE_UP))


def _assumed(document: Document, reasons: Mapping[str, str]) -> dict[str, Any]:
    """Add the reasons why values are assumed, by their keys."""
    every = {**document.get("assumed", {}), **reasons}
    return {**document, **({"assumed": every} if every else {})}


def _renamed(document: Document, renamed: Callable[[str], str | None]) -> dict[str, Any]:
    """Rename the keys of assumptions, or leave them out."""
    reasons = {new: why for key, why in document.get("assumed", {}).items() if (new := renamed(key)) is not None}
    rest = {key: table for key, table in document.items() if key != "assumed"}
    return rest | ({"assumed": reasons} if reasons else {})
