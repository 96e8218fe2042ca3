"""Panel with sliders and fields of the design.

It opens and saves the file too, and writes the report.
"""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import TYPE_CHECKING, Any

from coilarray.design.export_formats import SUFFIXES, Format
from coilarray.errors import CoilarrayError, DesignError, OutputError
from coilarray.geometry.words import array_words
from coilarray.viz.studio.entries import Entry, entries_of, number_of, text_of
from coilarray.viz.studio.job import with_progress
from coilarray.viz.studio.panel import Panel
from coilarray.viz.studio.searching import write_board
from coilarray.viz.studio.services import Document
from coilarray.viz.studio.structure import on_its_layers
from coilarray.viz.studio.work import Work

if TYPE_CHECKING:
    from coilarray.viz.studio.page import Page


class DesignPanel(Panel):
    """Drawer at the left and buttons at the top."""

    def __init__(self, page: Page) -> None:
        page.state.client_only("texts")
        self._exported: set[Path] = set()
        values = {
            "groups": [], "texts": {}, "errors": {}, "file": "", "title": "", "array_words": "", "changed": False,
            "shelf": [], "save_name": "", "save_title": "", "save_over": "", "open_over": "", "opening": "",
            "file_problem": "", "file_note": "", "open_dialog": False, "save_dialog": False, "report_url": "",
            "can_report": page.setup.services.write_report is not None, "formats": list(SUFFIXES),
        }  # fmt: skip
        super().__init__(
            page, values, enter=self._enter, look_at_shelf=self._look, open_design=self._open, save_design=self._save,
            write_report=self._report, export_board=self._export,
        )  # fmt: skip

    def show(self, work: Work, *, typed: bool) -> None:
        """Show a design.

        `typed` is true if it comes from the fields, which then stay unchanged.
        """
        state = self._page.state
        if not typed:
            entries = entries_of(work.opened)
            state.groups, state.errors = _groups(entries), {}
            state.texts = {entry.key: text_of(entry.value) for entry in entries}
            state.dirty("texts")  # the page may have other texts, which this side does not know
            self._page.server.clear_state_client_cache("texts")
        state.file, state.changed = work.file, work.changed
        state.title = str(work.opened.document.get("title", ""))
        state.array_words = array_words(work.design.array)
        state.trame__title = f"{work.file} – coilarray studio"
        state.report_url = ""

    def _enter(self, key: str, text: str) -> None:
        """Set an entry to a typed value.

        An impossible value gives an error at its field and changes nothing.
        """
        page = self._page
        present = next((one for one in entries_of(page.work.opened) if one.key == key), None)
        if present is not None and key not in page.state.errors and text == text_of(present.value):
            return  # the field was only left; it shows twelve digits of a value that may have more
        page.state.errors = {name: line for name, line in page.state.errors.items() if name != key}

        def refused(line: str) -> None:
            page.state.errors = {**page.state.errors, key: line}

        def made(work: Work) -> Document:
            changed = work.document_with({key: number_of(key, text)})
            return on_its_layers(changed) if key.endswith(".winding_layers") else changed

        page.change(made, refused, entry=key, typed=True)

    def _look(self) -> None:
        self._page.state.shelf = self._page.setup.shelf.names()

    def _open(self, name: str, discarded: str = "") -> None:
        """Open a file.

        If this loses changes, its name must be given a second time, as `discarded`.
        """
        page = self._page
        name = str(name)
        if page.work.changed and name != discarded:
            page.state.file_problem = page.work.unsaved
            page.state.open_over = name
            return
        page.state.file_problem, page.state.opening = "", name
        page.begin(self._read, name)

    async def _read(self, name: str) -> None:
        """Read a file and show its design.

        Reading takes seconds if coils are routed to a connector.
        """
        page = self._page
        try:
            work = await asyncio.to_thread(page.setup.shelf.open, name)
        except CoilarrayError as error:
            with page.state as state:
                state.file_problem, state.opening = str(error), ""
            return
        with page.state as state:
            state.open_dialog, state.open_over, state.opening = False, "", ""
            page.take(work)

    def _save(self, name: str, title: str | None, replaced: str = "") -> None:
        """Save under a name and a title.

        To replace another file, its name must be given again, as `replaced`.
        """
        page = self._page
        name = str(name).strip()
        try:
            if name != replaced and page.setup.shelf.would_lose(page.work, name):
                page.state.file_problem = f"{name} is there already; Replace writes over it."
                page.state.save_over = name
                return
            kept = page.work.keeps_comments
            work = page.setup.shelf.save(page.work.for_file(name, (title or "").strip()), name)
        except (DesignError, OutputError) as error:
            page.state.file_problem = str(error)
            return
        page.state.save_over = ""
        page.state.save_dialog = False
        page.saved(work)
        page.state.file_note = f"saved {page.setup.shelf.path(work.file)}" + (
            "" if kept else "; its comments could not be kept, those of the starter are in their place"
        )

    def _export(self, to: Format) -> None:
        """Write the board into the folder.

        A file that this page has not written itself is not replaced.
        """
        page = self._page
        if to not in SUFFIXES:
            return
        path = page.setup.shelf.folder / f"{page.work.design.name}-{to}{SUFFIXES[to][0]}"
        if path.exists() and path not in self._exported:
            page.state.problem = f"{path.name} is there already, and not from this page; rename or remove it first."
            return

        def done(line: str) -> None:
            self._exported.add(path)
            page.state.file_note = line

        item = (write_board, page.work.opened.document, page.work.design.name, path, to)
        page.start_bar("export", f"{to} of {page.work.design.name}", with_progress, item, done)

    def _report(self) -> None:
        """Write the report into the folder."""
        page = self._page
        write = page.setup.services.write_report
        if write is None:
            return
        design = page.work.design
        folder = page.setup.shelf.folder / f"{design.name}-report"

        def done(result: Path) -> None:
            """Offer the report of the design."""
            if page.work.design.digest == design.digest:
                try:
                    page.state.report_url = f"reports/{page.setup.reports.add(result)}"
                except OSError as error:
                    page.say(f"cannot read {result}: {error.strerror}.")
                page.state.file_note = f"wrote {result}"
            else:
                page.state.file_note = f"wrote {result}, of the design before it was changed"

        item = (write, page.work.opened.document, design.name, folder)
        page.start_bar("report", f"report of {design.name}", with_progress, item, done)


def _groups(entries: tuple[Entry, ...]) -> list[dict[str, Any]]:
    groups: dict[str, list[dict[str, Any]]] = {}
    for entry in entries:
        row = {name: getattr(entry, name) for name in ("key", "label", "meaning", "unit", "low", "high", "step")}
        groups.setdefault(entry.group, []).append(row)
    return [{"title": title, "entries": rows} for title, rows in groups.items()]
