"""Design of a page: its file, its fields, its structure, and new designs."""

from __future__ import annotations

import asyncio
import math
import secrets
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, get_args

from coilarray.compute.threads import Progress
from coilarray.design import fabs
from coilarray.design.export import SUFFIXES, Format, export
from coilarray.design.model import Design, DesignFile, build_design
from coilarray.errors import CoilarrayError, DesignError, OutputError
from coilarray.geometry.arcs import SIDES
from coilarray.geometry.array import array_words
from coilarray.studies.create.choices import Choices, Shape, read_arrangement, read_size
from coilarray.viz.studio import structure
from coilarray.viz.studio.entries import Entry, entries_of, number_of, text_of
from coilarray.viz.studio.services import Document
from coilarray.viz.studio.session import Panel, Session
from coilarray.viz.studio.work import MOST_COILS, Work, work_on


class DesignPanel(Panel):
    """Drawer at the left and buttons at the top."""

    def __init__(self, session: Session, saved: Callable[[Work], None]) -> None:
        session.state.client_only("texts")
        self._saved = saved  # shows a design that is in a file now
        self._exported: set[Path] = set()
        values = {
            "groups": [], "texts": {}, "errors": {}, "file": "", "title": "", "array_words": "", "changed": False,
            "shelf": [], "save_name": "", "save_title": "", "save_over": "", "open_over": "", "opening": "",
            "file_problem": "", "file_note": "", "open_dialog": False, "save_dialog": False, "report_url": "",
            "can_report": session.setup.services.write_report is not None, "formats": list(SUFFIXES),
        }  # fmt: skip
        super().__init__(
            session, values, enter=self._enter, look_at_shelf=self._look, open_design=self._open,
            save_design=self._save, write_report=self._report, export_board=self._export,
        )  # fmt: skip

    def show(self, work: Work, *, typed: bool) -> None:
        """Show a design.

        `typed` is true if it comes from the fields, which then stay unchanged.
        """
        state = self._session.state
        if not typed:
            entries = entries_of(work.opened)
            state.groups, state.errors = _groups(entries), {}
            state.texts = {entry.key: text_of(entry.value) for entry in entries}
            state.dirty("texts")  # the page may have other texts, which this side does not know
            self._session.server.clear_state_client_cache("texts")
        state.file, state.changed = work.file, work.changed
        state.title = str(work.opened.document.get("title", ""))
        state.array_words = array_words(work.design.array)
        state.trame__title = f"{work.file} – coilarray studio"
        state.report_url = ""

    def _enter(self, key: str, text: str) -> None:
        """Set an entry to a typed value."""
        session = self._session
        present = next((one for one in entries_of(session.work.opened) if one.key == key), None)
        if present is not None and key not in session.state.errors and text == text_of(present.value):
            return  # the field was only left; it shows twelve digits of a value that may have more
        session.state.errors = {name: line for name, line in session.state.errors.items() if name != key}

        def refused(line: str) -> None:
            session.state.errors = {**session.state.errors, key: line}

        def made(work: Work) -> Document:
            changed = work.document_with({key: number_of(key, text)})
            return structure.on_its_layers(changed) if key.endswith(".winding_layers") else changed

        session.change(made, refused, entry=key, typed=True)

    def _look(self) -> None:
        self._session.state.shelf = self._session.setup.shelf.names()

    def _open(self, name: str, discarded: str = "") -> None:
        """Open a file, and lose changes if `discarded` names it."""
        session = self._session
        name = str(name)
        if session.work.changed and name != discarded:
            session.state.file_problem = session.work.unsaved
            session.state.open_over = name
            return
        session.state.file_problem, session.state.opening = "", name
        session.begin(self._read, name)

    async def _read(self, name: str) -> None:
        """Read a file and show its design."""
        session = self._session
        try:
            work = await asyncio.to_thread(session.setup.shelf.open, name)
        except CoilarrayError as error:
            with session.state as state:
                state.file_problem, state.opening = str(error), ""
            return
        with session.state as state:
            state.open_dialog, state.open_over, state.opening = False, "", ""
            session.take(work)

    def _save(self, name: str, title: str | None, replaced: str = "") -> None:
        """Save under a name and a title, over another file if `replaced` names it."""
        session = self._session
        name = str(name).strip()
        try:
            if name != replaced and session.setup.shelf.would_lose(session.work, name):
                session.state.file_problem = f"{name} is there already; Replace writes over it."
                session.state.save_over = name
                return
            kept = session.work.keeps_comments
            work = session.setup.shelf.save(session.work.for_file(name, (title or "").strip()), name)
        except (DesignError, OutputError) as error:
            session.state.file_problem = str(error)
            return
        session.state.save_over = ""
        session.state.save_dialog = False
        self._saved(work)
        session.state.file_note = f"saved {session.setup.shelf.path(work.file)}" + (
            "" if kept else "; its comments could not be kept, the meanings of the keys are in their place"
        )

    def _export(self, to: Format) -> None:
        """Write the board into the folder."""
        session = self._session
        if to not in SUFFIXES:
            return
        path = session.setup.shelf.folder / f"{session.work.design.name}-{to}{SUFFIXES[to][0]}"
        if path.exists() and path not in self._exported:
            session.state.problem = f"{path.name} is there already, and not from this page; rename or remove it first."
            return

        def done(line: str) -> None:
            self._exported.add(path)
            session.state.file_note = line

        name = session.work.design.name
        document = session.work.opened.document
        session.start_bar("export", f"{to} of {name}", write_board, document, name, path, to, done=done)

    def _report(self) -> None:
        """Write the report into the folder."""
        session = self._session
        write = session.setup.services.write_report
        if write is None:
            return
        design = session.work.design
        folder = session.setup.shelf.folder / f"{design.name}-report"

        def done(result: Path) -> None:
            """Offer the report of the design."""
            if session.work.design.digest == design.digest:
                key = secrets.token_hex(16)
                session.setup.reports[key] = result
                session.state.report_url = f"reports/{key}"
                session.state.file_note = f"wrote {result}"
            else:
                session.state.file_note = f"wrote {result}, of the design before it was changed"

        document = session.work.opened.document
        session.start_bar("report", f"report of {design.name}", write, document, design.name, folder, done=done)


def _groups(entries: tuple[Entry, ...]) -> list[dict[str, Any]]:
    groups: dict[str, list[dict[str, Any]]] = {}
    for entry in entries:
        row = {name: getattr(entry, name) for name in ("key", "label", "meaning", "unit", "low", "high", "step")}
        groups.setdefault(entry.group, []).append(row)
    return [{"title": title, "entries": rows} for title, rows in groups.items()]


_FIRST = {
    "name": "mine", "coils": str(Choices.coils), "shape": Choices.shape, "size": f"{Choices().sides[0] * 1e3:g}",
    "inductance": "", "layers": "", "pitch": "", "connector": "none",
    "decoupled": Choices.overlap == "decoupled", "elastomer": Choices.elastomer,
}  # fmt: skip


class NewPanel(Panel):
    """Dialog for a new design."""

    def __init__(self, session: Session) -> None:
        values = {
            "new_dialog": False, "new_shapes": list(get_args(Shape)), "new_edges": ["none", *SIDES],
            "choice": _FIRST, "new_problem": "", "new_over": False,
        }  # fmt: skip
        super().__init__(session, values, make_design=self._make)

    def _make(self, texts: Mapping[str, Any], discard: bool = False) -> None:
        """Make a design, and lose changes only to `discard` them."""
        session, state = self._session, self._session.state
        name = str(texts.get("name", "")).strip().removesuffix(".toml")
        try:
            path = session.setup.shelf.path(f"{name}.toml")
        except OutputError:
            state.new_problem = f"name must have letters, digits, _ . + and, not first, - only; got {name[:60]!r}."
            return
        if path.exists():
            state.new_problem = f"{path.name} is there already; give the new design another name."
            return
        state.new_over = bool(session.work.changed) and not discard
        if state.new_over:
            state.new_problem = session.work.unsaved
            return
        try:
            choices = choices_of(texts)
        except CoilarrayError as error:
            state.new_problem = str(error)
            return

        begun = session.work

        def failed(problem: str) -> None:
            state.new_problem, state.new_dialog = problem, True

        def done(file: DesignFile) -> None:
            """Show the new design."""
            if session.work is not begun and session.work.changed:  # meanwhile
                state.new_over = True
                failed(session.work.unsaved)
                return
            try:
                session.take(replace(work_on(file, path.name), kept={}))
            except CoilarrayError as error:
                failed(str(error))

        state.new_problem = ""
        state.new_dialog = not session.start_bar(
            "new", f"new design {name}", make_design, name, choices, done=done, failed=failed
        )


def choices_of(texts: Mapping[str, Any]) -> dict[str, Any]:
    """Choices for a new design from texts of the page.

    They are arguments of `coilarray.studies.create.new_design`. The sizes in the texts are in mm.

    Examples
    --------
    >>> choices_of({"coils": "4x4", "shape": "rectangle", "size": "20×12", "inductance": "18"})
    {'coils': '4x4', 'shape': 'rectangle', 'size': (0.02, 0.012), 'inductance': 1.8e-05}
    """
    given = {key: str(texts.get(key, "")).strip() for key in _FIRST}
    arrangement = read_arrangement(given["coils"], given["shape"])
    if arrangement.columns * arrangement.rows > MOST_COILS:
        raise DesignError(f"coils must be at most {MOST_COILS} for the studio to follow; got {given['coils']}.")
    choices: dict[str, Any] = {"coils": given["coils"], "shape": given["shape"], "size": read_size(given["size"])}
    for key, scale in (("inductance", 1e-6), ("pitch", 1e-3)):
        if given[key]:
            choices[key] = number_of(key, given[key]) * scale
    if given["layers"]:
        layers = number_of("layers", given["layers"])
        if layers != round(layers):
            raise DesignError(f"layers must be a whole number; got {given['layers']}.")
        choices["layers"] = round(layers)
    if given["connector"] not in ("", "none"):
        choices["connector"] = given["connector"]
    if texts.get("decoupled"):
        choices["overlap"] = "decoupled"
    if not texts.get("elastomer", True):
        choices["elastomer"] = False
    return choices


def make_design(name: str, choices: Mapping[str, Any], _: Progress) -> DesignFile:
    """Make a design in a process of its own."""
    from coilarray.studies.create.new_design import new_design

    return new_design(name, **choices)


_PLACE = ("x_mm", "y_mm", "rotation_deg", "layers")  # keys of a coil
_OWN = "limits of your own"
_BASES = {"bonded": "bonded to the board", "frictionless": "without friction", "seat": "on a soft seat"}


class BuildPanel(Panel):
    """Panel with the structure of a design."""

    def __init__(self, session: Session) -> None:
        values = {
            "build": {"coils": [], "sheets": []}, "placing": {}, "build_problem": "", "build_lattices": [],
            "build_bases": [{"value": base, "title": _BASES[base]} for base in structure.BASES],
            "build_edges": ["none", *SIDES], "build_houses": list(fabs.names()),
        }  # fmt: skip
        session.state.client_only("placing")
        super().__init__(
            session, values, add_coil=lambda: self._change(structure.add_coil), remove_coil=self._remove_coil,
            place_coil=self._place, set_lattice=self._set_lattice, set_layers=self._set_layers,
            set_leads=self._set_leads, set_connector=self._set_connector,
            add_sheet=lambda: self._change(structure.add_sheet), remove_sheet=self._remove_sheet,
            set_base=self._set_base, set_house=self._set_house,
        )  # fmt: skip

    def show(self, work: Work) -> None:
        """Show the structure of a design."""
        document, array = work.opened.document, work.design.array.unrouted
        state = self._session.state
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
        self._change(structure.set_leads, there=there)

    def _set_connector(self, edge: str) -> None:
        self._change(structure.set_connector, edge)

    def _set_house(self, house: str) -> None:
        self._change(structure.set_house, house)

    def _remove_sheet(self, index: int) -> None:
        self._change(structure.remove_sheet, index)

    def _set_base(self, base: str) -> None:
        self._change(structure.set_base, base)

    def _place(self, name: str, key: str, text: str) -> None:
        """Set one part of a coil's placement."""
        if key not in _PLACE:
            return
        self._change(_with_place, name, key, text)

    def _change(self, function: Callable[..., Document], *arguments: Any, **named: Any) -> None:
        """Change the document of the design."""

        def made(work: Work) -> Document:
            return function(work.opened.document, work.design, *arguments, **named)

        self._session.change(made, partial(setattr, self._session.state, "build_problem"))


def _with_place(document: Document, design: Design, name: str, key: str, text: str) -> Document:
    if key == "layers":
        return structure.place_on(document, design, name, text.replace(",", " ").split())
    return structure.place_coil(document, design, name, key, number_of(f"{key} of {name}", text))


def _with_layers(document: Document, design: Design, text: str) -> Document:
    return structure.set_layers(document, design, number_of("copper layers", text))


def _shown(value: float) -> str:
    """Text of a place in mm or °."""
    return text_of(round(value, 6) + 0.0)  # avoids −0


def _offered(kind: str, present: str, count: int) -> dict[str, str]:
    """Lattice as an item of a list on the page."""
    number = count if kind == present else structure.lattice_sizes(kind, count)[1]
    return {"value": kind, "title": f"{kind}, {number} coil{'' if number == 1 else 's'}"}


def write_board(document: Document, name: str, path: Path, to: Format, _: Progress) -> str:
    """Write the board for fabrication or another program."""
    written = export(build_design(document, name), path, to).files
    return f"wrote {path}" if len(written) == 1 else f"wrote {len(written)} files into {path}"
