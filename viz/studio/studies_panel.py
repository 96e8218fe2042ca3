"""Sweeps and tolerance studies in the tab of runs.

They are started, watched and stopped, and a point can become the design.
"""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import xarray as xr

from coilarray.compute.netcdf import save_dataset
from coilarray.design.model import Design
from coilarray.errors import CoilarrayError, DesignError
from coilarray.viz.studio.entries import entries_of, number_of
from coilarray.viz.studio.job import with_progress
from coilarray.viz.studio.messages import Axis
from coilarray.viz.studio.panel import Panel, image_of
from coilarray.viz.studio.studying import (
    PLAIN,
    SweepRequest,
    SweepResult,
    axis_text,
    spread_boards,
    sweep_entries,
    sweep_rows,
    tolerance_rows,
)
from coilarray.viz.studio.work import Work

if TYPE_CHECKING:
    from coilarray.viz.studio.page import Page

_KINDS = ("optimise", "sweep", "tolerance")
_TYPICAL = "typical values of board houses"
_MOST_SHOWN = 200  # rows
_MOST_BOARDS = 4096
_NONE: Mapping[str, Any] = {"kind": "", "line": "", "picture": "", "head": [], "rows": [], "ended": False}
_NO_AXIS: Mapping[str, Any] = {"key": None, "values": ""}


class StudiesPanel(Panel):
    """Panel with the last sweep or tolerance study."""

    def __init__(self, page: Page) -> None:
        self._of: Design | None = None
        self._found: SweepResult | xr.Dataset | None = None
        self._kept: set[Path] = set()
        values = {
            "run_kinds": list(_KINDS), "run_kind": _KINDS[0], "sweep_keys": [], "sweep_axes": [],
            "tolerance_files": [_TYPICAL], "tolerance_file": _TYPICAL, "tolerance_boards": "64",
            "study_known": list(PLAIN), "study_quantities": [], "study_problem": "", "study": _NONE, "study_old": False,
            "large": "",
            "study_default": {
                "sweep": "quantities; the worst k or L if none", "tolerance": "quantities; L and k of all if none",
            },
        }  # fmt: skip
        super().__init__(
            page, values, choose_axis=self._choose, start_study=self._start, keep_study=self._keep,
            take_sweep_point=self._take,
        )  # fmt: skip

    def show(self, work: Work, *, anew: bool) -> None:
        """Offer the entries of a design.

        `anew` is true if its file or its coils are others.
        """
        state = self._page.state
        state.study_old = self._of is not None and self._of.digest != work.design.digest
        if anew or not state.sweep_axes:
            entries = entries_of(work.opened)
            state.sweep_keys = [entry.key for entry in entries]
            state.sweep_axes = [{"number": number, **_NO_AXIS} for number in (0, 1)]
            first = next((one.key for one in entries if one.key == "array.pitch_mm"), entries[0].key)
            self._choose(0, first)
            files = [name for name in self._page.setup.shelf.names() if name.endswith(".toml")]
            state.tolerance_files = [_TYPICAL, *files]

    def _choose(self, number: int, key: str | None) -> None:
        """Offer values near the present value of an entry."""
        state = self._page.state
        entry = next((one for one in entries_of(self._page.work.opened) if one.key == key), None)
        chosen = _NO_AXIS if entry is None else {"key": entry.key, "values": axis_text(entry)}
        state.sweep_axes = [{**axis, **chosen} if axis["number"] == number else axis for axis in state.sweep_axes]

    def _start(self, kind: str, axes: list[Axis], quantities: list[str], file: str, boards: str) -> None:
        """Begin a study.

        Points and boards that are computed already are found again.
        """
        page, state = self._page, self._page.state
        work = page.work
        names = tuple(str(name) for name in quantities)

        def cancelled() -> None:
            state.file_note = f"{kind}: stopped; what is computed is kept, and Start goes on from it"

        show = partial(self._show, work.design, kind)
        done, watch = partial(show, ended=True), partial(show, ended=False)
        task: Any = sweep_entries
        try:
            if kind == "sweep":
                texts = tuple(f"{axis['key']}={axis['values']}" for axis in axes if axis["key"])
                item: Any = SweepRequest(work.opened.document, work.design.name, texts, names)
            elif kind == "tolerance":
                count = round(number_of("boards", str(boards)))
                if not 0 <= count <= _MOST_BOARDS:
                    raise DesignError(f"boards must be 0 to {_MOST_BOARDS}; got {boards}.")
                path = None if file == _TYPICAL else page.setup.shelf.path(file)
                task = with_progress
                item = (spread_boards, work.opened.document, work.design.name, path, names, count)
            else:
                return
        except CoilarrayError as error:
            state.study_problem = str(error)
            return
        name = f"{kind} of {work.design.name}"
        if page.start_bar("study", name, task, item, done, cancelled=cancelled, watch=watch):
            state.study_problem, state.study = "", _NONE
            self._of, self._found = None, None

    def _show(self, design: Design, kind: str, found: SweepResult | xr.Dataset, *, ended: bool) -> None:
        self._of, self._found = design, found
        self._page.begin(self._draw, design, kind, found, ended)

    async def _draw(self, design: Design, kind: str, found: SweepResult | xr.Dataset, ended: bool) -> None:
        """Show a result, unless there is a later result."""
        picture, problem = await asyncio.to_thread(_picture, found)
        if found is not self._found:
            return
        if isinstance(found, SweepResult):
            head, rows = sweep_rows(found)
            line = f"{design.name}: {len(rows)} of {len(found.points)} points"
        else:
            head, rows = tolerance_rows(found)
            drawn = found.sizes.get("sample", 0)
            line = f"{design.name}: {drawn} boards drawn, {found.attrs['boards'] - drawn} for the linear part"
        with self._page.state as state:
            state.study = {
                "kind": kind, "line": line, "picture": picture, "head": list(head), "ended": ended,
                "rows": [{**asdict(row), "cells": list(row.cells)} for row in rows[:_MOST_SHOWN]],
            }  # fmt: skip
            state.study_problem = problem or state.study_problem
            state.study_old = design.digest != self._page.work.design.digest

    def _take(self, point: int) -> None:
        """Set the design's entries to a point of the sweep."""
        found = self._found
        if isinstance(found, SweepResult) and 0 <= point < len(found.points):
            entries = found.points[point]
            refused = partial(setattr, self._page.state, "study_problem")
            self._page.change(lambda work: work.document_with(entries), refused)

    def _keep(self) -> None:
        """Write all numbers into the folder.

        A file that this page has not written itself is not replaced.
        """
        page, found = self._page, self._found
        if found is None or self._of is None:
            return
        swept = isinstance(found, SweepResult)
        path = page.setup.shelf.folder / f"{self._of.name}-{'sweep' if swept else 'tolerance'}.nc"
        if path.exists() and path not in self._kept:
            page.state.study_problem = f"{path.name} is there already, and not from this page; rename or remove it."
            return
        try:
            save_dataset(found.values if isinstance(found, SweepResult) else found, path)
        except CoilarrayError as error:
            page.state.study_problem = str(error)
            return
        self._kept.add(path)
        page.state.file_note = f"wrote {path}"


def _picture(found: SweepResult | xr.Dataset) -> tuple[str, str]:
    """Draw a result.

    If it has no picture, the reason is given in one line.
    """
    from coilarray.viz.plots.sweep import sweep_figure
    from coilarray.viz.plots.tolerance import tolerance_figure

    try:
        return image_of(sweep_figure(found.values) if isinstance(found, SweepResult) else tolerance_figure(found)), ""
    except ValueError as error:  # more panels than a figure has
        return "", str(error)
