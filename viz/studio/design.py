"""File, fields and structure of a design, and new designs."""

from __future__ import annotations

import asyncio
import math
import secrets
from collections.abc import Callable, Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, get_args

from coilarray.compute.threads import Progress
from coilarray.design import fabs
from coilarray.design.boards import boards_words
from coilarray.design.export import SUFFIXES, Format, board_targets, export
from coilarray.design.model import DesignFile, build_design
from coilarray.errors import CoilarrayError, DesignError, OutputError
from coilarray.geometry.arcs import SIDES
from coilarray.studies.create.plan import Choices, Shape, read_arrangement, read_size
from coilarray.viz.studio import structure
from coilarray.viz.studio.job import Step
from coilarray.viz.studio.services import Document
from coilarray.viz.studio.session import Panel, Session
from coilarray.viz.studio.work import MOST_COILS, Work, entries_of, feasible_range, number_of, text_of, work_on

_FORMATS = {  # formats of boards in words
    "kicad": "KiCad project", "gerber": "Gerber and drill files, for the board house", "dxf": "DXF drawing",
    "step": "STEP solid, for mechanical design", "svg": "SVG drawing",
}  # fmt: skip


class DesignPanel(Panel):
    """Drawer at the left and buttons at the top."""

    def __init__(self, session: Session, saved: Callable[[Work], None]) -> None:
        session.state.client_only("texts")
        self._saved = saved  # shows a design that is in a file now
        values = {
            "groups": [], "texts": {}, "errors": {}, "file": "", "title": "", "array_words": "", "changed": False,
            "shelf": [], "save_name": "", "save_title": "", "save_over": "", "open_over": "", "opening": "",
            "file_problem": "", "file_note": "", "open_dialog": False, "save_dialog": False, "report_url": "",
            "can_report": session.setup.services.write_report is not None, "feasible": {},
            "formats": [{"value": name, "title": _FORMATS.get(name, name)} for name in SUFFIXES],
        }  # fmt: skip
        self._entered = ""  # key of the field that was changed last
        super().__init__(
            session, values, "file_problem", enter=self._enter, look_at_shelf=self._look, open_design=self._open,
            save_design=self._save, write_report=self._report, export_board=self._export,
            find_feasible=self._find_feasible,
        )  # fmt: skip

    def show(self, work: Work, *, typed: bool) -> None:
        """Show a design, `typed` if from the fields, which stay."""
        state = self._state
        if not typed:
            groups: dict[str, list[dict[str, Any]]] = {}
            for entry in entries_of(work.opened):
                groups.setdefault(entry.group, []).append(asdict(entry))
            state.groups = [{"title": title, "entries": rows} for title, rows in groups.items()]
            state.texts = {row["key"]: text_of(row["value"]) for rows in groups.values() for row in rows}
            state.errors = {}
            state.dirty("texts")  # the page may have other texts, which this side does not know
            self._session.server.clear_state_client_cache("texts")
        state.file, state.changed = work.file, work.changed
        state.title = str(work.opened.document.get("title", ""))
        state.array_words = boards_words(work.design)
        state.trame__title = f"{work.file} – coilarray studio"
        state.report_url = ""
        # the range of an entry does not depend on its own value
        state.feasible = {key: ends for key, ends in state.feasible.items() if typed and key == self._entered}

    def _find_feasible(self, key: str) -> None:
        """Find the values of an entry with which there is a board."""
        session, work = self._session, self._session.work
        entry = next((one for one in entries_of(work.opened) if one.key == key), None)

        def show(ends: tuple[float, float]) -> None:
            if session.is_current(work.design):
                self._state.feasible = {**self._state.feasible, key: ends}

        if entry is not None:
            step = Step("feasible", lambda: feasible_range(work, entry), show, lambda _: None)
            session.slow.ask([step])

    def _enter(self, key: str, text: str) -> None:
        session, errors = self._session, self._state.errors
        present = next((one for one in entries_of(session.work.opened) if one.key == key), None)
        if present is not None and key not in errors and text == text_of(present.value):
            return  # the field was only left; it shows twelve digits of a value that may have more
        self._state.errors = {name: line for name, line in errors.items() if name != key}

        def made(work: Work) -> Document:
            changed = work.document_with({key: number_of(key, text)})
            return structure.on_its_layers(changed) if key.endswith(".winding_layers") else changed

        self._entered = key
        session.change(made, entry=key)

    def _look(self) -> None:
        self._state.shelf = self._session.setup.shelf.names()

    async def _open(self, name: str, discarded: str = "") -> None:
        """Open a file, and lose changes if `discarded` names it."""
        session, state = self._session, self._state
        if session.work.changed and name != discarded:
            state.file_problem, state.open_over = session.work.unsaved, name
            return
        with state:
            state.file_problem, state.opening = "", name
        try:
            work = await asyncio.to_thread(session.setup.shelf.open, name)
        finally:
            state.opening = ""
        state.open_dialog, state.open_over = False, ""
        session.take(work)

    def _save(self, name: str, title: str | None, replaced: str = "") -> None:
        """Save with a title, over another file if `replaced`."""
        shelf, name, work = self._session.setup.shelf, name.strip(), self._session.work
        if name != replaced and shelf.would_lose(work, name):
            self._state.save_over = name
            raise OutputError(f"{name} is there already; Replace writes over it.")
        same = name.removesuffix(".toml") == work.file.removesuffix(".toml")
        called = work.called(work.design.name if same else name.removesuffix(".toml"), (title or "").strip())
        work = shelf.save(called, name)
        self._state.save_over, self._state.save_dialog = "", False
        self._saved(work)
        self._state.file_note = f"saved {shelf.path(name)}"

    def _export(self, to: Format) -> None:
        session, design, folder = self._session, self._session.work.design, self._session.setup.shelf.folder
        path = folder / f"{design.name}-{to}{SUFFIXES[to][0]}"
        places = list(dict.fromkeys((path, *board_targets(design, path, to))))
        if None in [session.may_write(str(place.relative_to(folder))) for place in places]:
            return

        def done(line: str) -> None:
            for place in places:
                session.wrote(place, line)

        item = session.work.opened.document, design.name, path, to
        session.start_bar("export", f"{to} of {design.name}", write_board, *item, done=done)

    def _report(self) -> None:
        session, design, write = self._session, self._session.work.design, self._session.setup.services.write_report
        if write is None:
            return

        def done(result: Path) -> None:
            self._state.file_note = f"wrote {result}"
            if session.work.design.digest == design.digest:
                key = secrets.token_hex(16)
                session.setup.reports[key] = result
                self._state.report_url = f"reports/{key}"
            else:
                self._state.file_note += ", of the design before it was changed"

        item = session.work.opened.document, design.name, session.setup.shelf.folder / f"{design.name}-report"
        session.start_bar("report", f"report of {design.name}", write, *item, done=done)


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
        super().__init__(session, values, "new_problem", make_design=self._make)

    def _make(self, texts: dict[str, str | bool | None], discard: bool = False) -> None:
        """Make a design, and lose changes only to `discard` them."""
        session, state, begun = self._session, self._state, self._session.work
        name = str(texts.get("name", "")).strip().removesuffix(".toml")
        state.new_over = begun.changed and not discard
        path = session.setup.shelf.path(f"{name}.toml")
        if path.exists():
            raise DesignError(f"{path.name} is there already; give the new design another name.")
        if state.new_over:
            raise DesignError(begun.unsaved)
        choices = choices_of(texts)

        def failed(problem: str) -> None:
            state.new_problem, state.new_dialog = problem, True

        def done(file: DesignFile) -> None:
            if session.work is not begun and session.work.changed:  # meanwhile
                state.new_over = True
                failed(session.work.unsaved)
                return
            try:
                session.take(replace(work_on(file, path.name), kept={}))
            except CoilarrayError as error:
                failed(str(error))

        state.new_problem, item = "", (make_design, name, choices)
        state.new_dialog = not session.start_bar("new", f"new design {name}", *item, done=done, failed=failed)


def choices_of(texts: Mapping[str, Any]) -> dict[str, Any]:
    """Arguments of `coilarray.studies.create.new_design` from texts, sizes in mm."""
    given = {key: str(texts.get(key, "")).strip() for key in _FIRST}
    arrangement = read_arrangement(given["coils"], given["shape"])
    if arrangement.columns * arrangement.rows > MOST_COILS:
        raise DesignError(f"coils must be at most {MOST_COILS} for the studio to follow; got {given['coils']}.")
    choices: dict[str, Any] = {"coils": given["coils"], "shape": given["shape"], "size": read_size(given["size"])}
    for key, scale in (("inductance", 1e-6), ("pitch", 1e-3), ("layers", 1)):
        if given[key]:
            choices[key] = number_of(key, given[key]) * scale
    if "layers" in choices:
        if choices["layers"] != round(choices["layers"]):
            raise DesignError(f"layers must be a whole number; got {given['layers']}.")
        choices["layers"] = round(choices["layers"])
    if given["connector"] not in ("", "none"):
        choices["connector"] = given["connector"]
    if texts.get("decoupled"):
        choices["overlap"] = "decoupled"
    if not texts.get("elastomer", True):
        choices["elastomer"] = False
    return choices


class BuildPanel(Panel):
    """Panel with the structure of a design."""

    def __init__(self, session: Session) -> None:
        values = {
            "build": {"coils": [], "sheets": []}, "placing": {}, "build_problem": "", "build_lattices": [],
            "build_bases": [{"value": base, "title": title} for base, title in structure.BASES.items()],
            "build_edges": ["none", *SIDES], "build_houses": list(fabs.names()),
        }  # fmt: skip
        session.state.client_only("placing")
        super().__init__(session, values, build=self._build, move_coil=self._move)

    def show(self, work: Work) -> None:
        """Show the structure of a design."""
        document, array, state = work.opened.document, work.design.array.unrouted, self._state
        lattice, count = document["array"]["lattice"], len(array.names)
        state.build_problem, lattices = "", []
        for kind in structure.LATTICES:
            number = count if kind == lattice else structure.lattice_sizes(kind, count)[1]
            lattices.append({"value": kind, "title": f"{kind}, {number} coil{'' if number == 1 else 's'}"})
        state.build_lattices = lattices
        state.build = {
            "coils": [
                {
                    "name": place.name, "x_mm": _rounded(place.x * 1e3), "y_mm": _rounded(place.y * 1e3),
                    "rotation_deg": _rounded(math.degrees(place.rotation)), "layers": " ".join(place.layers),
                }
                for place in array.placements
            ],
            "lattice": lattice,
            "layers": len(array.stackup.names),
            "leads": all(place.coil.terminal is not None for place in array.placements),
            "house": work.opened.values.get("fab.profile") or "limits of your own",
            "connector": work.opened.values.get("connector.side", "none"),
            "sheets": [sheet.name for sheet in work.design.sheets],
            "base": document["indentation"].get("base", "bonded") if "indentation" in document else "",
        }  # fmt: skip

    def _build(self, step: str, *arguments: str | int | bool) -> None:
        """Change the design's document by one of the `structure.STEPS`."""
        function = structure.STEPS.get(step)
        if function is not None:
            self._session.change(lambda work: function(work.opened.document, work.design, *arguments), "build_problem")

    def _move(self, name: str, x_mm: float, y_mm: float, drag: str) -> None:
        """Put a coil at a place, where all places of a drag are one step of undo."""
        place = name, x_mm, y_mm
        self._session.change(
            lambda work: structure.move_coil(work.opened.document, work.design, *place), "build_problem", joined=drag
        )


def _rounded(value: float) -> str:
    return text_of(round(value, 6) + 0.0)  # avoids −0


# These run in processes of their own, and are therefore functions of a module with plain arguments.


def make_design(name: str, choices: Mapping[str, Any], _: Progress) -> DesignFile:
    """Make a design."""
    from coilarray.studies.create.new_design import new_design

    return new_design(name, **choices)


def write_board(document: Document, name: str, path: Path, to: Format, _: Progress) -> str:
    """Write the board for fabrication or another program."""
    written = export(build_design(document, name), path, to).files
    return f"wrote {path}" if len(written) == 1 else f"wrote {len(written)} files into {path}"
