"""Description of a design in words from its values."""

from __future__ import annotations

from coilarray.compute.display_units import MM, display_unit
from coilarray.compute.table import html_card, html_table
from coilarray.design.model import Design, DesignFile
from coilarray.fabrication.drawings import array_picture
from coilarray.geometry.array import array_facts

_DIGITS = 12  # of a hash


def metal_words(design: Design) -> str:
    """Return the plates and the target in words, if any.

    >>> from coilarray import load_design
    >>> metal_words(load_design("proximity")), metal_words(load_design("gast2020"))
    ('an aluminium plate as target', '')
    """
    found = [f"the plate {plate.name} of {plate.material.words}" for plate in design.plates]
    if design.target is not None:
        material = design.target.body.material.words
        article = "an" if material[0] in "aeiou" else "a"
        found.append(f"{article} {material} {design.target.kind} as target")
    return " and ".join([", ".join(found[:-1]), found[-1]] if len(found) > 1 else found)


def design_facts(design: Design) -> list[tuple[str, str]]:
    """Return a design as rows of names and values."""
    setup, switches = design.indentation, design.circuit.switches
    tank = display_unit("F").text(switches.tank_capacitance, ".4")
    sheets = [f"{sheet.name} {MM.text(sheet.thickness, '.4')}" for sheet in design.sheets]
    depths = [] if setup is None else [f"{depth:g}" for depth in MM.of(setup.depths).round(6)]
    rows = [
        *array_facts(design.array),
        ("elastomer", ", ".join(sheets)),
        ("pressed by", "" if setup is None else f"{setup.indenter.name}, {', '.join(depths)} mm deep"),
        ("metal", metal_words(design)),
        ("circuit", f"tank of {tank}, states of a scan: {len(design.plan)}"),
        ("source", design.source),
        ("hash", design.digest[:_DIGITS]),
    ]
    return [(what, text) for what, text in rows if text]


def file_facts(file: DesignFile) -> list[tuple[str, str]]:
    """Return the number of given values, and the assumed values."""
    assumed = [key for key in file.values if key in file.assumed]
    given = sum(key in file.given and key not in file.assumed for key in file.values)
    counts = f"{given} given, {len(file.values) - given - len(assumed)} by default, {len(assumed)} assumed"
    return [("values", counts), *([("assumed", ", ".join(assumed))] if assumed else [])]


def design_html(design: Design, more: list[tuple[str, str]] | None = None) -> str:
    """Return a design, with more rows, for a notebook."""
    title = f"{design.name}: {design.title}" if design.title not in ("", design.name) else design.name
    rows = [*design_facts(design), *(more or [])]
    return html_card(title, array_picture(design.array, title), html_table((), rows))
