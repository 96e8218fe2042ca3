"""Sweeps and tolerance studies in the tab of runs."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from typing_extensions import TypedDict

from coilarray.compute.display_units import DisplayUnit, value_text
from coilarray.compute.netcdf import save_dataset
from coilarray.compute.store import open_store
from coilarray.compute.threads import Progress
from coilarray.design.model import Design, build_design_file
from coilarray.errors import CoilarrayError, DesignError
from coilarray.studies.quantities import QUANTITIES
from coilarray.studies.sweep import RULES, parse_axis, plan_sweep, run_sweep
from coilarray.studies.tolerance import analyse, load_tolerances
from coilarray.studies.tolerance.analysis import default_quantities
from coilarray.viz.studio.entries import Entry, entries_of, number_of, text_of
from coilarray.viz.studio.job import Link
from coilarray.viz.studio.services import Document
from coilarray.viz.studio.session import Panel, Session, image_of
from coilarray.viz.studio.work import Work

_EVERY = 1.0  # s between two results of a running sweep
_STEPS = 5  # number of offered values
_NEAR = 0.2  # range of the offered values to both sides, over the present value
_THREE = DisplayUnit(digits=3, significant=True)


class Axis(TypedDict):
    """Axis of a sweep as on the page."""

    number: int
    key: str | None
    values: str


PLAIN = tuple(name for name, quantity in QUANTITIES.items() if not any(one.required for one in quantity.options))
"""Names of the quantities that need no options."""


@dataclass(frozen=True, eq=False)
class SweepResult:
    """Points of a sweep with their known values."""

    points: tuple[Mapping[str, Any], ...]  # entries that are changed, as for `coilarray.design.vary.vary`
    values: xr.Dataset  # of `coilarray.sweep`


def sweep_entries(
    document: Document, name: str, axes: Sequence[str], quantities: Sequence[str], link: Link
) -> SweepResult:
    """Sweep as ``coilarray sweep`` does, with the same store."""
    file = build_design_file(document, name)
    wanted = quantities or default_quantities(file.design)[:1]
    plan = plan_sweep(file, [parse_axis(text) for text in axes], wanted)
    sent = time.monotonic()

    def watch(so_far: Callable[[], xr.Dataset]) -> None:
        nonlocal sent
        if time.monotonic() - sent > _EVERY:
            link.send(SweepResult(plan.points, so_far()))
            sent = time.monotonic()

    found = run_sweep(plan, 1, open_store(None), progress=link, watch=watch)
    return SweepResult(plan.points, found)


def spread_boards(
    document: Document, name: str, tolerances: Path | None, quantities: Sequence[str], samples: int, progress: Progress
) -> xr.Dataset:
    """Analyse tolerances as ``coilarray tolerance`` does."""
    file = build_design_file(document, name)
    settings: dict[str, Any] = {"quantities": quantities, "samples": samples, "cache": open_store(None)}
    return analyse(file, load_tolerances(tolerances), **settings, progress=progress)


def axis_text(entry: Entry) -> str:
    """Values near an entry's, as ``coilarray sweep --vary`` reads them.

    >>> axis_text(Entry("array.pitch_mm", "pitch", "", "mm", "Array", 13.0, 6.5, 26.0, 0.1))
    '10.4:15.6:5'
    """
    if entry.step == 1.0:  # whole number
        low, high = max(entry.low, entry.value - 2), min(entry.high, entry.value + 2)
        return ",".join(text_of(value) for value in np.arange(low, high + 1))
    width = _NEAR * (abs(entry.value) or entry.high)
    low, high = max(entry.low, entry.value - width), entry.value + width
    return f"{low:.4g}:{high:.4g}:{_STEPS}"


def sweep_rows(result: SweepResult) -> tuple[list[str], list[dict[str, Any]]]:
    """Head and rows of a table of a sweep.

    A row has `cells`, the `point` whose entries can be used, the `reason` why it has no values or
    no board, and whether it has `broken` fabrication rules.
    """
    keys = [str(name) for name in result.values.data_vars if name != "reason"]
    columns = [result.values[key].values.ravel().tolist() for key in keys]
    broken = (result.values[RULES] > 0).values.ravel().tolist()
    rows = []
    for k, reason in enumerate(result.values.reason.values.ravel().tolist()):
        found = [column[k] for column in columns]
        if reason or not np.isnan(found).all():
            values = (*result.points[k].values(), *(None if np.isnan(one) else one for one in found))
            why = reason or ("it breaks fabrication rules" if broken[k] else "")
            cells, point = list(map(value_text, values)), None if reason else k
            rows.append({"cells": cells, "point": point, "reason": why, "broken": broken[k]})
    return [*result.points[0], *keys], rows


def tolerance_rows(result: xr.Dataset) -> tuple[list[str], list[dict[str, Any]]]:
    """Head and rows of a table of a tolerance study."""
    sampled = "sample_deviation" in result
    rows = []
    for k, name in enumerate(result.output.values.tolist()):
        one = result.isel(output=k)
        first = int(np.argmax(one.share.values))
        share = float(one.share[first])
        of = f"{one.contributor.values[first]} ({100 * share:.0f} %)" if share > 0 else "no error"
        (linear,) = _THREE.texts([float(one.linear_deviation)])
        (drawn,) = _THREE.texts([float(one.sample_deviation)]) if sampled else ["–"]
        rows.append([name, value_text(float(one.nominal)), linear, drawn, of])
    if "limit" in result.dims:
        shares = result.sample_yield if "sample_yield" in result else result.linear_yield
        for text, share in zip(result.limit.values.tolist(), shares.values.tolist(), strict=True):
            rows.append([text, "", "", "", f"yield {100 * share:.1f} %"])
    return ["output", "nominal", "σ, linear", "σ, drawn", "most by"], [
        {"cells": cells, "point": None} for cells in rows
    ]


_KINDS = ("optimise", "sweep", "tolerance")
_TYPICAL = "typical values of board houses"
_MOST_SHOWN = 200  # rows
_MOST_BOARDS = 4096
_NONE: Mapping[str, Any] = {"kind": "", "line": "", "picture": "", "head": [], "rows": [], "ended": False}
_NO_AXIS: Mapping[str, Any] = {"key": None, "values": ""}


class StudiesPanel(Panel):
    """Panel with the last sweep or tolerance study."""

    def __init__(self, session: Session) -> None:
        self._of: Design | None = None
        self._found: SweepResult | xr.Dataset | None = None
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
            session, values, choose_axis=self._choose, start_study=self._start, keep_study=self._keep,
            take_sweep_point=self._take,
        )  # fmt: skip

    def show(self, work: Work, *, anew: bool) -> None:
        """Offer a design's entries, `anew` for other files or coils."""
        state = self._session.state
        state.study_old = self._of is not None and self._of.digest != work.design.digest
        if anew or not state.sweep_axes:
            entries = entries_of(work.opened)
            state.sweep_keys = [entry.key for entry in entries]
            state.sweep_axes = [{"number": number, **_NO_AXIS} for number in (0, 1)]
            first = next((one.key for one in entries if one.key == "array.pitch_mm"), entries[0].key)
            self._choose(0, first)
            files = [name for name in self._session.setup.shelf.names() if name.endswith(".toml")]
            state.tolerance_files = [_TYPICAL, *files]

    def _choose(self, number: int, key: str | None) -> None:
        """Offer values near the present value of an entry."""
        state = self._session.state
        entry = next((one for one in entries_of(self._session.work.opened) if one.key == key), None)
        chosen = _NO_AXIS if entry is None else {"key": entry.key, "values": axis_text(entry)}
        state.sweep_axes = [{**axis, **chosen} if axis["number"] == number else axis for axis in state.sweep_axes]

    def _start(self, kind: str, axes: list[Axis], quantities: list[str], file: str, boards: str) -> None:
        """Begin a study."""
        session, state = self._session, self._session.state
        work = session.work
        item: list[Any] = [work.opened.document, work.design.name]

        def cancelled() -> None:
            state.file_note = f"{kind}: stopped; what is computed is kept, and Start goes on from it"

        show = partial(self._show, work.design, kind)
        done, watch = partial(show, ended=True), partial(show, ended=False)
        task: Any = sweep_entries
        try:
            if kind == "sweep":
                item += [[f"{axis['key']}={axis['values']}" for axis in axes if axis["key"]], quantities]
            else:
                task, count = spread_boards, round(number_of("boards", boards))
                if not 0 <= count <= _MOST_BOARDS:
                    raise DesignError(f"boards must be 0 to {_MOST_BOARDS}; got {boards}.")
                item += [None if file == _TYPICAL else session.setup.shelf.path(file), quantities, count]
        except CoilarrayError as error:
            state.study_problem = str(error)
            return
        name = f"{kind} of {work.design.name}"
        if session.start_bar("study", name, task, *item, done=done, cancelled=cancelled, watch=watch):
            state.study_problem, state.study = "", _NONE
            self._of, self._found = None, None

    def _show(self, design: Design, kind: str, found: SweepResult | xr.Dataset, *, ended: bool) -> None:
        self._of, self._found = design, found
        self._session.begin(self._draw, design, kind, found, ended)

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
        with self._session.state as state:
            state.study = {
                "kind": kind, "line": line, "picture": picture, "head": head, "ended": ended,
                "rows": rows[:_MOST_SHOWN],
            }  # fmt: skip
            state.study_problem = problem or state.study_problem
            state.study_old = design.digest != self._session.work.design.digest

    def _take(self, point: int) -> None:
        """Set the design's entries to a point of the sweep."""
        found = self._found
        if isinstance(found, SweepResult) and 0 <= point < len(found.points):
            entries = found.points[point]
            self._session.change(lambda work: work.document_with(entries), "study_problem")

    def _keep(self) -> None:
        """Write all numbers into the folder."""
        session, found = self._session, self._found
        if found is None or self._of is None:
            return
        swept = isinstance(found, SweepResult)
        path = session.may_write(f"{self._of.name}-{'sweep' if swept else 'tolerance'}.nc")
        if path is not None:
            save_dataset(found.values if isinstance(found, SweepResult) else found, path)
            session.wrote(path, f"wrote {path}")


def _picture(found: SweepResult | xr.Dataset) -> tuple[str, str]:
    """Draw a result."""
    from coilarray.viz.plots.sweep import sweep_figure
    from coilarray.viz.plots.tolerance import tolerance_figure

    try:
        return image_of(sweep_figure(found.values) if isinstance(found, SweepResult) else tolerance_figure(found)), ""
    except ValueError as error:  # more panels than a figure has
        return "", str(error)
