"""Structure of a document: coils, lattice, layers, leads and sheets."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, get_args

from coilarray.design.model import Design
from coilarray.design.vary import no_longer_assumed
from coilarray.errors import DesignError
from coilarray.geometry.array import Lattice, LatticeKind
from coilarray.viz.studio.services import Document
from coilarray.viz.studio.work import number_of

LATTICES = (*get_args(LatticeKind), "free")  # kinds of lattice that an array may have
BASES = {"bonded": "bonded to the board", "frictionless": "without friction", "seat": "on a soft seat"}
"""Possible bases of the lowest sheet, in words."""

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
    rightmost = max(places, key=lambda place: float(place["x_mm"]))
    layers = list(dict.fromkeys(tuple(place["layers"]) for place in places))
    following = layers[(layers.index(tuple(rightmost["layers"])) + 1) % len(layers)]
    lattice = design.array.lattice
    pitch = lattice.pitch if isinstance(lattice, Lattice) and lattice.pitch else _APART * _width(design)
    x = round(rightmost["x_mm"] + pitch * 1e3, 6)
    added = {**rightmost, "name": _free_name("coil", names), "layers": list(following), "x_mm": x}
    made_up = (f"array.placements.{len(places)}.{key}" for key in ("layers", "x_mm"))
    return _changed(document, _free(document, [*places, added]), *made_up)


def remove_coil(document: Document, design: Design, name: str) -> Document:
    """Remove a coil and its own entries."""
    every = _placements(document, design)
    places = [place for place in every if place["name"] != name]
    if not places:
        raise DesignError(f"{name} cannot be removed: an array must have a coil.")
    unused = {place["coil"] for place in every} - {place["coil"] for place in places}
    coils = {shape: table for shape, table in document["coils"].items() if shape not in unused}
    changed = {**_free(document, places), "coils": coils}
    if document["array"]["lattice"] == "free":
        gone = next(k for k, place in enumerate(every) if place["name"] == name)
        document = {**_free(document, places), "assumed": _shifted_reasons(document, "array.placements", gone)}
    return _without_coils(document, changed, design, [one["name"] for one in places])


def place_coil(document: Document, design: Design, name: str, key: str, text: str) -> Document:
    """Set ``x_mm``, ``y_mm``, ``rotation_deg`` or the ``layers`` of a coil."""
    if key == "layers":
        value: Any = text.replace(",", " ").split()
        if not value:
            known = " ".join(document["stackup"]["layers"])
            raise DesignError(f"layers of {name} must be some of {known}; got none.")
    elif key in ("x_mm", "y_mm", "rotation_deg"):
        value = number_of(f"{key} of {name}", text)
    else:
        raise DesignError(f"a coil has no {key!r}.")
    places = _placements(document, design)
    return _changed(
        document, _free(document, [{**place, key: value} if place["name"] == name else place for place in places])
    )


def move_coil(document: Document, design: Design, name: str, x_mm: float, y_mm: float) -> Document:
    """Put a coil at a place, to 0.01 mm."""
    place = {"x_mm": round(x_mm, 2), "y_mm": round(y_mm, 2)}
    places = [{**one, **place} if one["name"] == name else one for one in _placements(document, design)]
    return _changed(document, _free(document, places))


def set_lattice(document: Document, design: Design, kind: str) -> Document:
    """Lay coils of the first shape on a lattice."""
    places, old = _placements(document, design), document["array"]
    if kind not in LATTICES:
        raise DesignError(f"array.lattice must be one of {', '.join(LATTICES)}; got {kind!r}.")
    if kind == "free":
        return _changed(document, _free(document, places))
    sizes, points = lattice_sizes(kind, len(places))
    layers = [list(each) for each in dict.fromkeys(tuple(place["layers"]) for place in places)]
    table = {"lattice": kind, "coil": places[0]["coil"], **sizes}
    table["layers"] = layers[:1] if kind == "single" else layers
    if kind != "single":
        table["pitch_mm"] = old.get("pitch_mm", round(_APART * _width(design) * 1e3, 2))
    table |= {key: old[key] for key in ("direction_deg", "rotation_deg") if key in old}
    names = [place["name"] for place in places][:points]
    while len(names) < points:
        names.append(_free_name("coil", names))
    if names != [f"coil{k + 1}" for k in range(points)]:
        table["names"] = names
    made_up = () if kind == "single" or "pitch_mm" in old else ("array.pitch_mm",)
    return _without_coils(document, {**document, "array": table}, design, names, *made_up)


def lattice_sizes(kind: str, count: int) -> tuple[dict[str, int], int]:
    """Entries and count of a lattice near `count` coils."""
    if kind in ("single", "free"):
        return {}, 1 if kind == "single" else count
    if kind == "linear":
        return {"columns": count}, count
    if kind == "rings":
        of_rings = {n: 3 * n * (n + 1) + 1 for n in range(1, 2 + math.isqrt(count))}
        rings = min(of_rings, key=lambda n: abs(of_rings[n] - count))
        return {"rings": rings}, of_rings[rings]
    if kind == "triangle":
        columns = math.ceil(math.sqrt(2 * count + 0.25) - 0.5)
        return {"columns": columns}, columns * (columns + 1) // 2
    columns = max(1, round(math.sqrt(count)))
    rows = math.ceil(count / columns)
    return {"columns": columns, "rows": rows}, columns * rows


def set_layers(document: Document, _: Design, text: str) -> Document:
    """Set the number of copper layers, keeping the thickness."""
    stackup, number = document["stackup"], number_of("copper layers", text)
    if not (1 <= number <= 64 and number == (count := int(number))):
        raise DesignError(f"copper layers must be a whole number from 1 to 64; got {number:g}.")
    names = list(stackup["layers"])[:count]
    while len(names) < count:
        names.append(_free_name("L", names))
    table = {**stackup, "layers": names}
    usual = {"copper_thickness_um": (35.0, 0), "dielectric_thickness_mm": (0.2, 1), "dielectric_epsilon_r": (4.5, 1)}
    for key, (value, less) in usual.items():
        values = list(stackup.get(key, []))
        table[key] = (values + [values[-1] if values else value] * count)[: count - less]
    before, thick = stackup.get("dielectric_thickness_mm", []), table["dielectric_thickness_mm"]
    if before and thick:
        table["dielectric_thickness_mm"] = [round(each * sum(before) / sum(thick), 4) for each in thick]
    changed = [f"stackup.{key}" for key, values in table.items() if values != stackup.get(key)]
    return on_its_layers(_changed(document, {**document, "stackup": table}, *changed))


def on_its_layers(document: Document) -> Document:
    """Lay coils on as many layers as they have."""
    array, free = document["array"], document["array"]["lattice"] == "free"
    names = list(document["stackup"]["layers"])
    laid = [(place["coil"], tuple(place["layers"])) for place in array["placements"]] if free else [
        (array["coil"], tuple(layers)) for layers in array["layers"]
    ]  # fmt: skip
    new = dict[tuple[str, tuple[str, ...]], list[str]]()
    for shape, layers in dict.fromkeys(laid):
        winding = document["coils"][shape].get("winding_layers", len(layers))
        if not (isinstance(winding, int) and winding > 0):
            return document  # refused later by its key
        if winding > len(names):
            board = f"{len(names)} copper layer{'' if len(names) == 1 else 's'}"
            raise DesignError(f"coils.{shape}.winding_layers is {winding}; the board has {board} only.")
        first = winding * sum(one == shape for one, _ in new) % (len(names) - len(names) % winding)
        kept = len(layers) == winding and set(layers) <= set(names)
        new[shape, layers] = list(layers) if kept else names[first : first + winding]
    if all(list(layers) == found for (_, layers), found in new.items()):
        return document
    if free:
        places = [{**place, "layers": new[one]} for place, one in zip(array["placements"], laid, strict=True)]
        moved = (f"array.placements.{k}.layers" for k, one in enumerate(laid) if list(one[1]) != new[one])
        return _changed(document, {**document, "array": {**array, "placements": places}}, *moved)
    sets = list(map(list, dict.fromkeys(map(tuple, new.values()))))
    return _changed(document, {**document, "array": {**array, "layers": sets}}, "array.layers")


def set_house(document: Document, _: Design, house: str) -> Document:
    """Use the limits of a board house, and no others."""
    return no_longer_assumed({**document, "fab": {"profile": house}}, ["fab"])


def set_leads(document: Document, _: Design, there: bool) -> Document:
    """Give all wound coils leads, or none."""
    coils = dict(document["coils"])
    for shape, table in coils.items():
        if table.get("shape") != "path":
            rest = {key: value for key, value in table.items() if key != "leads"}
            coils[shape] = {**rest, "leads": table.get("leads", {})} if there else rest
    return _changed(document, {**document, "coils": coils})


def set_connector(document: Document, _: Design, edge: str) -> Document:
    """Lead all coils to a connector at an edge."""
    if edge == "none":
        return _changed(document, {key: table for key, table in document.items() if key != "connector"})
    return _changed(document, {**document, "connector": {**document.get("connector", {}), "side": edge}})


def add_sheet(document: Document, _: Design) -> Document:
    """Lay a sheet on top, the first with an indenter."""
    sheets = list(document.get("elastomer", []))
    name = _free_name("sheet", [sheet["name"] for sheet in sheets])
    new = {table: values for table, values in _INDENTED.items() if not sheets and table not in document}
    keys = [f"{table}.{key}" for table, values in new.items() for key in values]
    keys += [f"elastomer.{len(sheets)}.{key}" for key in _SHEET]
    return _changed(document, {**new, **document, "elastomer": [*sheets, {"name": name, **_SHEET}]}, *keys)


def remove_sheet(document: Document, _: Design, index: int) -> Document:
    """Remove a sheet, with the last also the indenter."""
    changed = without_entry(document, "elastomer", index)
    if "elastomer" in changed:
        return changed
    gone = ("indenter", "indentation")
    return _changed(changed, {key: table for key, table in changed.items() if key not in gone})


def without_entry(document: Document, table: str, index: int) -> Document:
    """Remove a table from a list by its number."""
    entries = list(document.get(table, []))
    if not 0 <= index < len(entries):
        raise DesignError(f"{table} must have an entry of number {index}; there are {len(entries)}.")
    del entries[index]
    rest = {key: value for key, value in document.items() if key != table}
    rest |= {table: entries} if entries else {}
    return _changed({**rest, "assumed": _shifted_reasons(document, table, index)}, rest)


def set_base(document: Document, _: Design, base: str) -> Document:
    """Set the base of the lowest sheet."""
    if base not in BASES:
        raise DesignError(f"indentation.base must be one of {', '.join(BASES)}; got {base!r}.")
    if "indentation" not in document:
        raise DesignError("indentation is missing: a base is of sheets that are pressed.")
    table, key = {**document["indentation"], "base": base}, "seat_stiffness_kPa_per_mm"
    if base != "seat":
        table = {entry: value for entry, value in table.items() if not entry.startswith("seat_")}
    elif key not in table:
        return _changed(document, {**document, "indentation": {**table, key: _SEAT}}, f"indentation.{key}")
    return _changed(document, {**document, "indentation": table})


STEPS: Mapping[str, Callable[..., Document]] = {  # functions of the document, the design and arguments, by name
    function.__name__: function
    for function in (
        add_coil, remove_coil, place_coil, set_lattice, set_layers, set_house, set_leads, set_connector, add_sheet,
        remove_sheet, set_base,
    )
}  # fmt: skip


def _placements(document: Document, design: Design) -> list[dict[str, Any]]:
    """Places of all coils as in a file."""
    if document["array"]["lattice"] == "free":
        return [dict(place) for place in document["array"]["placements"]]
    return [
        {
            "name": place.name, "coil": document["array"]["coil"], "layers": list(place.layers),
            "x_mm": round(place.x * 1e3, 6), "y_mm": round(place.y * 1e3, 6),
            "rotation_deg": round(math.degrees(place.rotation), 9),
        }
        for place in design.array.unrouted.placements
    ]  # fmt: skip


def _free(document: Document, places: list[dict[str, Any]]) -> dict[str, Any]:
    return {**document, "array": {"lattice": "free", "placements": places}}


def _without_coils(
    document: Document, changed: dict[str, Any], design: Design, names: Sequence[str], *made_up: str
) -> Document:
    """Remove terminations and origins of coils that are gone."""
    ends = changed.get("circuit", {}).get("terminations", {})
    if set(ends) - set(names):
        kept = {name: end for name, end in ends.items() if name in names}
        changed["circuit"] = {**changed["circuit"], "terminations": kept}
    for key, setup in (("indentation", design.indentation), ("target", design.target)):
        table = changed.get(key, {})
        if setup is not None and table.get("origin", names[0]) not in names:
            rest = {entry: value for entry, value in table.items() if entry != "origin"}
            changed[key] = {**rest, "origin_mm": [round(value * 1e3, 6) for value in setup.origin_point]}
            made_up = (*made_up, f"{key}.origin_mm")
    return _changed(document, changed, *made_up)


def _width(design: Design) -> float:
    """Width of the first coil's outline in m."""
    x = design.array.placements[0].coil.outline[:, 0]
    return float(x.max() - x.min())


def _free_name(word: str, names: Sequence[str]) -> str:
    return next(name for k in range(1, len(names) + 2) if (name := f"{word}{k}") not in names)


def _changed(before: Document, after: Document, *made_up: str) -> Document:
    """Keep reasons of unchanged assumed values, and mark new ones."""
    old, new = dict(_entries(before)), dict(_entries(after))
    reasons = {}
    for key, why in before.get("assumed", {}).items():
        parts = key.split(".")
        above = (".".join(parts[:k]) for k in range(1, len(parts) + 1))
        if old.get(key) == new.get(key) and all(table in new for table in above if table in old):
            reasons[key] = why
    reasons |= dict.fromkeys(made_up, _MADE_UP)
    rest = {key: table for key, table in after.items() if key != "assumed"}
    return rest | ({"assumed": reasons} if reasons else {})


def _shifted_reasons(document: Document, path: str, index: int) -> dict[str, str]:
    """Reasons by key after a list has lost an entry."""
    reasons, begin = {}, f"{path}."
    for key, why in document.get("assumed", {}).items():
        first, dot, end = key.removeprefix(begin).partition(".")
        number = int(first) if key.startswith(begin) else -1
        if number != index:
            reasons[key if number < index else f"{begin}{number - 1}{dot}{end}"] = why
    return reasons


def _entries(table: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """Values and tables of a document by their dotted keys."""
    for key, value in table.items() if isinstance(table, Mapping) else enumerate(table):
        yield f"{path}{key}", value
        if isinstance(value, Mapping | list):
            yield from _entries(value, f"{path}{key}.")
