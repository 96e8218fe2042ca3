"""Sliders and fields of the design, and its file: open, save, and the report."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from coilarray.errors import CoilarrayError, DesignError, OutputError
from coilarray.viz.studio.entries import Entry, entries_of, text_of
from coilarray.viz.studio.job import Outcome, progress_of
from coilarray.viz.studio.services import Stopped, Tell
from coilarray.viz.studio.work import Work

if TYPE_CHECKING:
    from coilarray.viz.studio.page import Page

_REPORT = "report"


class DesignPanel:
    """The drawer at the left, and the buttons at the top.

    Parameters
    ----------
    page : Page
        Whose.
    """

    def __init__(self, page: Page) -> None:
        self._page = page
        state = page.state
        state.client_only("texts")
        state.update(
            {
                "groups": [], "texts": {}, "errors": {}, "file": "", "title": "", "changed": False, "shelf": [],
                "save_name": "", "save_over": "", "file_problem": "", "file_note": "",
                "open_dialog": False, "save_dialog": False, "report_url": "",
                "can_report": page.setup.services.write_report is not None,
            }
        )  # fmt: skip
        for name, function in (
            ("enter", self._enter),
            ("look_at_shelf", self._look),
            ("open_design", self._open),
            ("save_design", self._save),
            ("write_report", self._report),
        ):
            page.trigger(name, function)

    def show(self, work: Work, *, typed: bool) -> None:
        """Show a design.

        Parameters
        ----------
        work : Work
            What is worked on now.
        typed : bool
            Whether it comes from the fields themselves: they are then left as they are, for someone is typing there.
        """
        state = self._page.state
        if not typed:
            entries = entries_of(work.opened)
            state.groups, state.errors = _groups(entries), {}
            state.save_name = work.file if work.file.endswith(".toml") else f"{work.file}.toml"
            state.texts = {entry.key: text_of(entry.value) for entry in entries}
            state.dirty("texts")  # the page may hold others, which this side does not know
            self._page.server.clear_state_client_cache("texts")
        state.file, state.changed = work.file, work.changed
        state.title = work.design.title or work.design.name
        state.trame__title = f"{work.design.name} – coilarray studio"
        state.report_url = ""

    def _enter(self, key: str, text: str) -> None:
        """Set an entry to what was typed or slid to; where that cannot be, say so at its field and change nothing."""
        page = self._page
        try:
            work = page.work.with_entry(key, str(text))
        except CoilarrayError as error:
            page.state.errors = {**page.state.errors, key: str(error)}
            return
        page.state.errors = {name: line for name, line in page.state.errors.items() if name != key}
        if work.design.digest != page.work.design.digest:
            page.take(work, typed=True)

    def _look(self) -> None:
        self._page.state.shelf = self._page.setup.shelf.names()

    def _open(self, name: str) -> None:
        page = self._page
        try:
            work = page.setup.shelf.open(name)
        except CoilarrayError as error:
            page.state.file_problem = str(error)
            return
        page.state.open_dialog = False
        page.take(work)

    def _save(self, name: str, replaced: str = "") -> None:
        """Save under a name; a file that would be lost is to be named once more, as the one that is replaced."""
        page = self._page
        name = str(name).strip()
        try:
            if name != replaced and page.setup.shelf.would_lose(page.work, name):
                page.state.file_problem = f"{name} is there already; Replace writes over it."
                page.state.save_over = name
                return
            work = page.setup.shelf.save(page.work, name)
        except (DesignError, OutputError) as error:
            page.state.file_problem = str(error)
            return
        page.state.save_over = ""
        page.state.save_dialog = False
        page.work = work
        page.state.file, page.state.changed = work.file, False
        page.state.file_note = f"saved {page.setup.shelf.path(work.file)}"

    def _report(self) -> None:
        page = self._page
        write = page.setup.services.write_report
        if write is None:
            return
        design = page.work.design
        folder = page.setup.shelf.folder / f"{design.name}-report"
        text = f"report of {design.name}"

        def ended(outcome: Outcome) -> None:
            page.end_progress()
            if outcome.kind == "done":
                made = Path(outcome.result)
                page.state.report_url = f"files/{made.parent.name}/{made.name}"
                page.state.file_note = f"wrote {made}"
            elif outcome.kind == "failed":
                page.state.problem = outcome.problem

        if page.start_job(
            _REPORT,
            _write_report,
            (write, page.work.opened.document, design.name, folder),
            on_message=lambda message: page.show_progress(_REPORT, text, message),
            on_end=ended,
        ):
            page.show_progress(_REPORT, text)


def _write_report(item: Any, tell: Tell, _: Stopped) -> Path:
    write, document, name, folder = item
    page: Path = write(document, name, folder, progress_of(tell))
    return page


def _groups(entries: tuple[Entry, ...]) -> list[dict[str, Any]]:
    groups: dict[str, list[dict[str, Any]]] = {}
    for entry in entries:
        groups.setdefault(entry.group, []).append(
            {
                "key": entry.key, "label": entry.label, "unit": entry.unit, "low": entry.low, "high": entry.high,
                "step": entry.step,
            }
        )  # fmt: skip
    return [{"title": title, "entries": rows} for title, rows in groups.items()]
