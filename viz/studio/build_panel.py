"""Tab in which a design is built.

It has its coils and their places, lattice, layers, leads, sheets and seat.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any

from coilarray.design import fabs
from coilarray.design.model import Design
from coilarray.geometry.values import SIDES
from coilarray.viz.studio import structure
from coilarray.viz.studio.entries import number_of, text_of
from coilarray.viz.studio.panel import Panel
from coilarray.viz.studio.services import Document
from coilarray.viz.studio.work import Work

if TYPE_CHECKING:
    from coilarray.viz.studio.page import Page


_PLACE = ("x_mm", "y_mm", "rotation_deg", "layers")  # keys of a coil
_OWN = "limits of your own"
_BASES = {"bonded": "bonded to the board", "frictionless": "without friction", "seat": "on a soft seat"}


class BuildPanel(Panel):
    """Panel with the structure of a design."""

    def __init__(self, page: Page) -> None:
        values = {
            "build": {"coils": [], "sheets": []}, "placing": {}, "build_problem": "", "build_lattices": [],
            "build_bases": [{"value": base, "title": _BASES[base]} for base in structure.BASES],
            "build_edges": ["none", *SIDES], "build_houses": list(fabs.names()),
        }  # fmt: skip
        page.state.client_only("placing")
        super().__init__(
            page, values, add_coil=lambda: self._change(structure.add_coil), remove_coil=self._remove_coil,
            place_coil=self._place, set_lattice=self._set_lattice, set_layers=self._set_layers,
            set_leads=self._set_leads, set_connector=self._set_connector,
            add_sheet=lambda: self._change(structure.add_sheet), remove_sheet=self._remove_sheet,
            set_base=self._set_base, set_house=self._set_house,
        )  # fmt: skip

    def show(self, work: Work) -> None:
        """Show the structure of a design."""
        document, array = work.opened.document, work.design.array.unrouted
        state = self._page.state
        state.build_problem = ""
        state.build_lattices = [
            _offered(kind, document["array"]["lattice"], len(array.names)) for kind in structure.LATTICES
        ]
        state.build = {
            "coils": [
                {
                    "name": place.name, "x_mm": _shown(place.x * 1e3), "y_mm": _shown(place.y * 1e3),
                    "rotation_deg": _shown(math.degrees(place.rotation)), "layers": " ".join(place.layers),
                }
                for place in array.placements
            ],
            "lattice": document["array"]["lattice"],
            "layers": len(array.stackup.names),
            "leads": all(place.coil.terminal is not None for place in array.placements),
            "house": work.opened.values.get("fab.profile") or _OWN,
            "connector": work.opened.values.get("connector.side", "none"),
            "sheets": [sheet.name for sheet in work.design.sheets],
            "base": document["indentation"].get("base", "bonded") if "indentation" in document else "",
        }  # fmt: skip

    def _remove_coil(self, name: str) -> None:
        self._change(structure.remove_coil, name)

    def _set_lattice(self, kind: str) -> None:
        self._change(structure.set_lattice, kind)

    def _set_layers(self, count: str) -> None:
        self._change(_with_layers, count)

    def _set_leads(self, there: bool) -> None:
        self._change(structure.set_leads, there=there, before=self._page.earlier)

    def _set_connector(self, edge: str) -> None:
        self._change(structure.set_connector, edge, before=self._page.earlier)

    def _set_house(self, house: str) -> None:
        self._change(structure.set_house, house)

    def _remove_sheet(self, index: int) -> None:
        self._change(structure.remove_sheet, index)

    def _set_base(self, base: str) -> None:
        self._change(structure.set_base, base, before=self._page.earlier)

    def _place(self, name: str, key: str, text: str) -> None:
        """Set one part of a coil's placement.

        It is its place in one direction, its rotation, or its copper layers.
        """
        if key not in _PLACE:
            return
        self._change(_with_place, name, key, text)

    def _change(self, function: Callable[..., Document], *arguments: Any, **named: Any) -> None:
        """Change the document of the design.

        An impossible change gives one line and changes nothing.
        """

        def made(work: Work) -> Document:
            return function(work.opened.document, work.design, *arguments, **named)

        self._page.change(made, partial(setattr, self._page.state, "build_problem"))


def _with_place(document: Document, design: Design, name: str, key: str, text: str) -> Document:
    if key == "layers":
        return structure.place_on(document, design, name, text.replace(",", " ").split())
    return structure.place_coil(document, design, name, key, number_of(f"{key} of {name}", text))


def _with_layers(document: Document, design: Design, text: str) -> Document:
    return structure.set_layers(document, design, number_of("copper layers", text))


def _shown(value: float) -> str:
    """Text of a place in mm or °.

    It is rounded to the nanometre as in a file.
    """
    return text_of(round(value, 6) + 0.0)  # avoids −0


def _offered(kind: str, present: str, count: int) -> dict[str, str]:
    """Lattice as an item of a list on the page.

    The item has the number of coils that the lattice has or would have.
    """
    number = count if kind == present else structure.lattice_sizes(kind, count)[1]
    return {"value": kind, "title": f"{kind}, {number} coil{'' if number == 1 else 's'}"}
