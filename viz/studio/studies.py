"""Tab of runs: sweeps and tolerance studies."""

from __future__ import annotations

import asyncio
import itertools
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
from coilarray.compute.netcdf import load_part, save_dataset
from coilarray.compute.store import open_store
from coilarray.compute.threads import Progress
from coilarray.design.model import Design, build_design_file
from coilarray.errors import DesignError
from coilarray.studies.quantities import QUANTITIES
from coilarray.studies.sweep import RULES, parse_axis, plan_sweep, run_sweep
from coilarray.studies.tolerance import analyse, load_tolerances
from coilarray.studies.tolerance.analysis import default_quantities
from coilarray.viz.studio.job import Link
from coilarray.viz.studio.services import Document
from coilarray.viz.studio.session import Panel, Session, image_of
from coilarray.viz.studio.words import MOST_SHOWN, NO_PREVIEW, axis_label, preview, words
from coilarray.viz.studio.work import Entry, Work, entries_of, number_of, text_of

_SENT_EVERY = 1.0  # s between two results of a running sweep
_STEPS = 5  # number of offered values
_NEAR = 0.2  # range of the offered values to both sides, over the present value
_THREE = DisplayUnit(digits=3, significant=True)


class Axis(TypedDict):
    """Axis of a sweep as on the page."""

    number: int
    key: str | None
    first: str
    last: str
    count: str
    unit: str


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
        if time.monotonic() - sent > _SENT_EVERY:
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


def axis_of(entry: Entry) -> dict[str, str]:
    """Values near an entry's, from the first to the last in some steps.

    >>> axis_of(Entry("array.pitch_mm", "pitch", "", "mm", "Array", 13.0, 6.5, 26.0, 0.1))
    {'first': '10.4', 'last': '15.6', 'count': '5', 'unit': 'mm'}
    """
    if entry.step == 1.0:  # whole number
        low, high = max(entry.low, entry.value - 2), min(entry.high, entry.value + 2)
        count = round(high - low) + 1
    else:
        width, count = _NEAR * (abs(entry.value) or entry.high), _STEPS
        low, high = max(entry.low, entry.value - width), entry.value + width
    return {"first": f"{low:.4g}", "last": f"{high:.4g}", "count": str(count), "unit": entry.unit}


def _swept(axis: Axis) -> str:
    """Axis as ``coilarray sweep --vary`` reads it."""
    first, last = (number_of(f"{end} value", text) for end, text in (("first", axis["first"]), ("last", axis["last"])))
    count = round(number_of("number of values", axis["count"]))
    if first == last or count == 1:
        return f"{axis['key']}={text_of(first)}"
    return f"{axis['key']}={text_of(first)}:{text_of(last)}:{count}"


def sweep_rows(result: SweepResult) -> tuple[list[str], list[dict[str, Any]]]:
    """Head and rows of a table of a sweep."""
    # A row has `cells`, the `point` that can be taken, the `reason` without values, and whether rules are `broken`.
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
    return [axis_label(name) for name in (*result.points[0], *keys)], rows


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
        rows.append([axis_label(name), value_text(float(one.nominal)), linear, drawn, of])
    if "limit" in result.dims:
        shares = result.sample_yield if "sample_yield" in result else result.linear_yield
        for text, share in zip(result.limit.values.tolist(), shares.values.tolist(), strict=True):
            rows.append([text, "", "", "", f"yield {100 * share:.1f} %"])
    return ["output", "nominal", "σ, linear", "σ, drawn", "most by"], [
        {"cells": cells, "point": None} for cells in rows
    ]


_KINDS = ("optimise", "sweep", "tolerance")
_TYPICAL = "typical values of board houses"
_MOST_BOARDS = 4096
_MOST_KEPT = 1000  # kept studies of a kind
_MOST_BARS = 12  # outputs in the picture, those that scatter most; the table has all
_NONE: Mapping[str, Any] = {"kind": "", "line": "", "picture": "", "head": [], "rows": [], "ended": False}
_NO_AXIS: Mapping[str, Any] = {"key": None, "first": "", "last": "", "count": "", "unit": ""}


class StudiesPanel(Panel):
    """Panel with the last sweep or tolerance study."""

    def __init__(self, session: Session) -> None:
        self._of: Design | None = None
        self._found: SweepResult | xr.Dataset | None = None
        values = {
            "run_kinds": list(_KINDS), "run_kind": _KINDS[0], "sweep_keys": [], "sweep_axes": [],
            "tolerance_files": [_TYPICAL], "tolerance_file": _TYPICAL, "tolerance_boards": "64",
            "study_known": [{"value": name, "title": axis_label(name)} for name in PLAIN], "study_quantities": [],
            "study_problem": "", "study": _NONE, "study_old": False, "study_files": [], "large": "",
            "study_default": {
                "sweep": "numbers to compute; the largest k or L if none",
                "tolerance": "numbers to compute; L and k of all coils if none",
            },
        }  # fmt: skip
        super().__init__(
            session, values, "study_problem", choose_axis=self._choose, start_study=self._start,
            preview_sweep_point=self._preview, take_sweep_point=self._take, find_studies=self._find,
            open_study=self._open,
        )  # fmt: skip

    def show(self, work: Work, *, anew: bool) -> None:
        """Offer a design's entries, `anew` for other files or coils."""
        state = self._state
        state.study_old = self._of is not None and self._of.digest != work.design.digest
        if anew or not state.sweep_axes:
            entries = entries_of(work.opened)
            state.sweep_keys = [
                {"value": one.key, "title": f"{one.group}: {one.label}{f' ({one.unit})' if one.unit else ''}"}
                for one in entries
            ]
            state.sweep_axes = [{"number": number, **_NO_AXIS} for number in (0, 1)]
            first = next((one.key for one in entries if one.key == "array.pitch_mm"), entries[0].key)
            self._choose(0, first)
            files = [name for name in self._session.setup.shelf.names() if name.endswith(".toml")]
            state.tolerance_files = [_TYPICAL, *files]

    def _choose(self, number: int, key: str | None) -> None:
        """Offer values near the present value of an entry."""
        entry = next((one for one in entries_of(self._session.work.opened) if one.key == key), None)
        chosen = _NO_AXIS if entry is None else {"key": entry.key, **axis_of(entry)}
        axes = self._state.sweep_axes
        self._state.sweep_axes = [{**axis, **chosen} if axis["number"] == number else axis for axis in axes]

    def _start(self, kind: str, axes: list[Axis], quantities: list[str], file: str, boards: str) -> None:
        session, state, work = self._session, self._state, self._session.work
        item: list[Any] = [work.opened.document, work.design.name]
        task: Any = sweep_entries
        if kind == "sweep":
            item += [[_swept(axis) for axis in axes if axis["key"]], quantities]
        else:
            task, count = spread_boards, round(number_of("boards", boards))
            if not 0 <= count <= _MOST_BOARDS:
                raise DesignError(f"boards must be 0 to {_MOST_BOARDS}; got {boards}.")
            item += [None if file == _TYPICAL else session.setup.shelf.path(file), quantities, count]

        def show(found: SweepResult | xr.Dataset, ended: bool = True) -> None:
            self._of, self._found = work.design, found
            if ended:
                state.study = {**_NONE, "kind": kind, "line": "The picture is drawn …"}
                self._save_found()
            session.begin(self._draw, work.design, kind, found, ended)

        def cancelled() -> None:
            state.file_note = f"{kind}: stopped; what is computed is kept, and Start goes on from it"

        name, watch = f"{kind} of {work.design.name}", partial(show, ended=False)
        if session.start_bar("study", name, task, *item, done=show, cancelled=cancelled, watch=watch):
            state.study_problem, state.study = "", _NONE
            self._of, self._found = None, None

    async def _draw(
        self, design: Design, kind: str, found: SweepResult | xr.Dataset, ended: bool, name: str = ""
    ) -> None:
        """Show a result, unless there is a later result."""
        picture, problem = await asyncio.to_thread(_picture_of_study, found)
        if found is not self._found:
            return
        if isinstance(found, SweepResult):
            head, rows = sweep_rows(found)
            line = f"{name or design.name}: {len(rows)} of {len(found.points)} points"
        else:
            head, rows = tolerance_rows(found)
            drawn = found.sizes.get("sample", 0)
            line = f"{name or design.name}: {drawn} boards drawn, {found.attrs['boards'] - drawn} for the linear part"
        shown = {"kind": kind, "line": line, "picture": picture, "head": head, "ended": ended}
        with self._state as state:
            state.study = {**shown, "rows": rows[:MOST_SHOWN]}
            state.study_problem = problem or state.study_problem
            state.study_old = design.digest != self._session.work.design.digest

    def _take(self, point: int) -> None:
        found = self._found
        if isinstance(found, SweepResult) and 0 <= point < len(found.points):
            entries = found.points[point]
            self._session.change(lambda work: work.document_with(entries), "study_problem")

    async def _preview(self, point: int) -> None:
        found = self._found
        if isinstance(found, SweepResult) and 0 <= point < len(found.points):
            names = [str(name) for name in found.values.data_vars if name != "reason"]
            after = {name: float(found.values[name].values.ravel()[point]) for name in names}
            known = {name: value for name, value in after.items() if not np.isnan(value)}
            shown = await asyncio.to_thread(preview, self._session.work, found.points[point], {}, known, {})
            with self._state as state:
                state.preview = {
                    **NO_PREVIEW, **shown, "name": f"point {point + 1}", "trigger": "take_sweep_point", "point": point,
                }  # fmt: skip

    def _save_found(self) -> None:
        """Keep the numbers of an ended study, so that it is found again."""
        found, of = self._found, self._of
        if found is None or of is None:
            return
        kind, values = ("sweep", found.values) if isinstance(found, SweepResult) else ("tolerance", found)
        folder = self._session.setup.shelf.folder
        names = (f"{of.name}-{kind}{f'-{k}' if k > 1 else ''}.nc" for k in range(1, _MOST_KEPT))
        path = next((folder / name for name in names if not (folder / name).exists()), None)
        if path is not None:
            save_dataset(values, path)
            self._session.wrote(path, f"kept in {path.name}")

    def _find(self) -> None:
        self._state.study_files = self._session.setup.shelf.files(".nc")

    async def _open(self, name: str) -> None:
        session, state = self._session, self._state
        values = await asyncio.to_thread(read_study, session.setup.shelf.file(name, (".nc",)))
        kind = "tolerance" if "output" in values.dims else "sweep"
        self._found = found = values if kind == "tolerance" else SweepResult(points_of(values), values)
        self._of = session.work.design
        with state:
            state.run_kind, state.study = kind, {**_NONE, "kind": kind, "line": "The picture is drawn …"}
        await self._draw(session.work.design, kind, found, ended=True, name=name)


def read_study(path: Path) -> xr.Dataset:
    """Read a kept sweep or tolerance study, or raise DesignError."""
    found = load_part(path)
    if found is None or not ({"output", "contributor"} <= set(found.dims) or "reason" in found):
        raise DesignError(f"{path.name} is no kept sweep or tolerance study.")
    return found


def points_of(values: xr.Dataset) -> tuple[dict[str, Any], ...]:
    """Entries of every point of a sweep, in the order of its values."""
    names = [str(name) for name in values.reason.dims]
    axes = [values[name].values.tolist() for name in names]
    return tuple(dict(zip(names, one, strict=True)) for one in itertools.product(*axes))


def _picture_of_study(found: SweepResult | xr.Dataset) -> tuple[str, str]:
    from coilarray.viz.plots.studies import sweep_figure, tolerance_figure

    try:
        if isinstance(found, SweepResult):
            labelled = found.values.copy(deep=False)
            for name in labelled.variables:
                labelled[name].attrs["long_name"] = words(str(name))
            return image_of(sweep_figure(labelled)), ""
        spread = np.abs(found.linear_deviation / found.nominal).fillna(0.0)
        most = found.output.values[np.argsort(-spread.values, kind="stable")[:_MOST_BARS]].tolist()
        named = found.sel(output=[one for one in found.output.values.tolist() if one in most])
        return image_of(tolerance_figure(named.assign_coords(output=list(map(words, named.output.values))))), ""
    except ValueError as error:  # more panels than a figure has
        return "", str(error)
