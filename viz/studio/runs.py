"""Tab of runs: searches, sweeps and tolerance studies."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np
import xarray as xr
from typing_extensions import TypedDict

from coilarray.compute.display_units import DisplayUnit, value_text
from coilarray.compute.netcdf import save_dataset
from coilarray.compute.store import open_store
from coilarray.compute.threads import Progress
from coilarray.design.keys import entry_unit
from coilarray.design.model import Design, build_design_file
from coilarray.errors import CoilarrayError, DesignError
from coilarray.studies.optimize.derive import NAMES, unfit_goals
from coilarray.studies.optimize.goal import Trial, unbeaten
from coilarray.studies.optimize.run import FILE, read_studies
from coilarray.studies.quantities import QUANTITIES
from coilarray.studies.sweep import RULES, parse_axis, plan_sweep, run_sweep
from coilarray.studies.tolerance import analyse, load_tolerances
from coilarray.studies.tolerance.analysis import default_quantities
from coilarray.viz.studio.job import Link, Step
from coilarray.viz.studio.services import Document
from coilarray.viz.studio.session import Panel, Session, image_of
from coilarray.viz.studio.work import Entry, Work, entries_of, number_of, text_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure


_MOST_SHOWN = 200  # rows of a table
_EVERY = 3.0  # s between two looks for new points
_REST = 0.3  # s without a change before goals are offered
_MOST_TRIALS = 10_000
_SIZE = (4.6, 3.3)  # of the picture in inches, so that its letters are legible beside the board


@dataclass(frozen=True, eq=False)
class Run:
    """Study of a design and a goal."""

    name: str  # of the study; it begins with the name of the design
    objectives: tuple[str, ...]  # names of the scores
    maximized: tuple[bool, ...]  # for each objective
    points: tuple[Trial, ...]  # with a possible board, in the order in which they were written
    tried: int  # number of all points
    refined: int = 0  # number of points that the local solver tried about the best point
    start: int | None = None  # index of the possible board at the start

    @property
    def quantities(self) -> tuple[str, ...]:
        """Names of all quantities, with the objectives first."""
        return tuple(dict.fromkeys(name for point in self.points for name in point.quantities))

    def values(self, name: str) -> list[float]:
        """Values of every point, NaN if a point has none."""
        if name in self.objectives:
            k = self.objectives.index(name)
            return [point.scores[k] for point in self.points]
        return [point.quantities.get(name, point.changes.get(name, float("nan"))) for point in self.points]

    @property
    def numbers(self) -> tuple[str, ...]:
        """Names of the varied entries that are numbers."""
        varied = dict.fromkeys(name for point in self.points for name in point.changes)
        return tuple(name for name in varied if all(isinstance(value, int | float) for value in self.values(name)))

    @property
    def front(self) -> tuple[int, ...]:
        """Indices of the points on the front, without the start."""
        signs = [-1 if maximized else 1 for maximized in self.maximized]
        scores = {k: point.scores for k, point in enumerate(self.points) if point.feasible}
        return tuple(k for k in unbeaten(scores, signs) if k != self.start)


def axis_label(name: str) -> str:
    """Label with unit of a quantity, distance or entry.

    >>> axis_label("array.pitch_mm"), axis_label("worst_k"), axis_label("|effective_inductance_uH[coil2] − 18|")
    ('array.pitch_mm (mm)', 'worst_k', '|effective_inductance_uH[coil2] − 18| (µH)')
    """
    bare = _quantity(name)
    known = QUANTITIES.get(bare.partition("[")[0])
    unit = known.unit if known is not None else entry_unit(bare.rpartition(".")[2])
    return name if unit == "1" else f"{name} ({unit})"


def run_lines(run: Run) -> list[str]:
    """Describe a run in words."""
    kept = sum(point.feasible for point in run.points)
    points = f"{run.tried} point{'' if run.tried == 1 else 's'} computed"
    refined = f", {run.refined} of them to refine the best" if run.refined else ""
    lines = [f"{points}{refined}; {kept} keep{'s' if kept == 1 else ''} all bounds"]
    start = None if run.start is None else run.points[run.start]
    if len(run.objectives) > 1:
        lines.append(f"{len(run.front)} on the front." if run.front else "None is better than the start.")
    else:
        name = run.objectives[0]
        of_start = "" if start is None else f" {value_text(start.scores[0])}"
        broken = "" if start is None or start.feasible else ", which breaks a bound"
        if run.front:
            best = value_text(run.points[run.front[0]].scores[0])
            lines.append(f"The best has {name} {best}" + (f", the start{of_start}{broken}." if of_start else "."))
        elif kept:
            lines.append("None is better than the start" + (f", which has {name}{of_start}." if of_start else "."))
        elif run.points:
            lines.append("None keeps all bounds.")
    for name in run.objectives:
        quantity = _quantity(name)
        base = quantity.partition("[")[0]
        if base in QUANTITIES:
            lines.append(f"{quantity}: {QUANTITIES[base].says}.")
    return lines


def _quantity(name: str) -> str:
    return name.strip("|").partition(" − ")[0]


def run_folders(folder: Path) -> list[str]:
    """Names of a folder's folders that contain a study."""
    try:
        below = sorted(path for path in folder.iterdir() if path.is_dir())
        return [path.name if path != folder else "." for path in (folder, *below) if (path / FILE).is_file()]
    except OSError:
        return []


def read_runs(folder: Path) -> tuple[Run, ...]:
    """Read the studies of a folder with a ``points.jsonl``."""
    return tuple(run_of(name, points) for name, points in read_studies(folder).items())


def run_of(name: str, points: Sequence[Mapping[str, Any]]) -> Run:
    """Return the run of a study's points."""
    names, maximized = [], []
    for objective in points[0]["objectives"]:
        target, quantity = objective["target"], objective["quantity"]
        names.append(quantity if target is None else f"|{quantity} − {target:.6g}|" if target else f"|{quantity}|")
        maximized.append(objective["direction"] == "maximize")
    possible = [point for point in points if not point["reason"]]
    trials = [Trial(**{one.name: point[one.name] for one in fields(Trial)}) for point in possible]
    start = next((k for k, point in enumerate(possible) if point["start"]), None)
    refined = sum(point["kind"] == "polish" for point in points)
    return Run(name, tuple(names), tuple(maximized), tuple(trials), len(points), refined, start)


def search_goal(document: Document, name: str, goal: str, trials: int, folder: Path, progress: Progress) -> str:
    """Search as ``coilarray optimize`` does, into a folder."""
    from coilarray.studies.optimize.derive import derive_goal
    from coilarray.studies.optimize.run import optimize_design, write_optimization

    file = build_design_file(document, name)
    wanted = derive_goal([goal], file).goal
    wanted = wanted.model_copy(update={"search": wanted.search.model_copy(update={"trials": trials})})
    found = optimize_design(file, wanted, folder, progress=lambda done, total, _: progress(done, total))
    write_optimization(found, folder)
    better = len(found.front)
    return f"{goal}: {better or 'no'} better design{'' if better == 1 else 's'} than this one"


class RunsPanel(Panel):
    """Panel with the runs in the folders beside the designs."""

    def __init__(self, session: Session) -> None:
        self._runs: tuple[Run, ...] = ()
        self._folder: Path | None = None  # of the runs that are read
        self._stamp = 0
        self._started: dict[Path, str] = {}  # digests of the designs of this page's searches, by folder
        self._following: asyncio.Task[None] | None = None
        self._offered = ""  # digest of the design with known goals
        values = {
            "run_folders": [], "run_folder": "", "run_names": [], "run_name": "", "run_axes": [], "run_x": "",
            "run_y": "", "run_picture": "", "run_lines": [], "run_of": "", "run_front": [], "run_scores": [],
            "runs_problem": "", "run_goals": _offered({}), "run_goal": next(iter(NAMES)), "run_trials": "40",
        }  # fmt: skip
        super().__init__(
            session, values, "runs_problem", read_runs=self._read, show_run=self._show, take_point=self._take,
            start_run=self._start,
        )  # fmt: skip

    def offer(self) -> None:
        """List fitting runs and goals, if their tab is open."""
        session, work = self._session, self._session.work
        if session.state.tab != "runs":
            return
        session.state.run_folders = run_folders(session.setup.shelf.folder)

        def show(unfit: Mapping[str, str]) -> None:
            if session.is_current(work.design):
                self._offered = work.design.digest
                with session.state as state:
                    state.run_goals = _offered(unfit)
                    if state.run_goal in unfit:
                        state.run_goal = next((name for name in NAMES if name not in unfit), state.run_goal)

        if work.design.digest != self._offered:
            session.scenes.ask([Step("goals", lambda: unfit_goals(work.opened), show, session.say, rest=_REST)])

    def show(self, design: Design) -> None:
        """Mark shown runs that belong to another design."""
        state = self._session.state
        of = str(state.run_name).rpartition("-")[0]
        digest = design.digest if self._folder is None else self._started.get(self._folder, design.digest)
        changed = " – of the design before it was changed" if digest != design.digest else ""
        state.run_of = changed if of in ("", design.name) else " – of another design"

    def _start(self, goal: str, trials: str) -> None:
        """Begin or continue a search, and show its points."""
        session, design = self._session, self._session.work.design
        folder = session.setup.shelf.folder / f"{design.name}-{goal}"
        count = round(number_of("points", trials))
        if goal not in NAMES or not 1 <= count <= _MOST_TRIALS:
            raise DesignError(f"points must be 1 to {_MOST_TRIALS}; got {trials}.")

        def ended(line: str) -> None:
            self._state.file_note = line
            self.offer()
            session.begin(self._read, folder.name)

        item = (session.work.opened.document, design.name, goal, count, folder)
        stopped = partial(ended, f"{goal}: stopped; the points are kept, and Start goes on from them")
        if session.start_bar("search", f"{goal} of {design.name}", search_goal, *item, done=ended, cancelled=stopped):
            self._state.runs_problem = ""
            self._started[folder] = design.digest
            self._follow(folder)

    async def _read(self, name: str) -> None:
        """Read a folder of runs, now and when it changes."""
        folder = self._session.setup.shelf.folder
        if name in run_folders(folder):
            self._state.run_folder = name
            await self._read_folder(folder / name)
            self._follow(folder / name)

    async def _read_folder(self, folder: Path) -> None:
        state = self._state
        self._folder, self._stamp = folder, _stamp(folder)
        try:
            self._runs = await asyncio.to_thread(read_runs, folder)
        except CoilarrayError as error:
            self._session.say(str(error), "runs_problem")
            return
        names = [run.name for run in self._runs]
        with state:
            state.runs_problem, state.run_names = "", names
            state.run_name = state.run_name if state.run_name in names else next(iter(names), "")
        await self._show(state.run_name, state.run_x, state.run_y)

    def _follow(self, folder: Path) -> None:
        """Read a folder again while its search continues."""

        async def follow() -> None:
            while self._state.tab == "runs" or self._state.job["name"] == "search":
                await asyncio.sleep(_EVERY)
                if _stamp(folder) not in (0, self._stamp):
                    await self._read_folder(folder)

        self.close()
        self._following = self._session.begin(follow)

    def close(self) -> None:
        """Stop reading runs."""
        if self._following is not None:
            self._following.cancel()

    async def _show(self, name: str, x: str, y: str) -> None:
        run = next((one for one in self._runs if one.name == name), None)
        if run is None:
            return
        axes = list(dict.fromkeys((*run.objectives, *run.quantities, *run.numbers)))
        telling = [name for name in axes if len(set(run.values(name))) > 1] or axes  # no bound that all points keep
        # Two objectives over each other, or a single objective over a varied entry.
        usual = telling[:2] if len(run.objectives) > 1 or not run.numbers else [run.numbers[0], axes[0]]
        first, second = x if x in axes else usual[0], y if y in axes else usual[-1]
        picture = await asyncio.to_thread(_picture, run, first, second) if run.points else ""
        with self._state as state:
            state.run_name, state.run_axes, state.run_x, state.run_y = run.name, axes, first, second
            state.run_picture, state.run_lines, state.run_scores = picture, run_lines(run), list(run.objectives)
            state.run_front = [
                {
                    "name": point.name, "scores": [value_text(score) for score in point.scores],
                    "entries": _list(point.changes), "quantities": _list(point.quantities),
                }
                for point in (run.points[k] for k in run.front[:_MOST_SHOWN])
            ]  # fmt: skip
            self.show(self._session.work.design)

    def _take(self, name: str) -> None:
        """Set the design's entries to a run's point."""
        points = (point for run in self._runs if run.name == self._state.run_name for point in run.points)
        if (point := next((one for one in points if one.name == name), None)) is not None:
            entries = point.changes
            self._session.change(lambda work: work.document_with(entries), "runs_problem")


def _list(values: Mapping[str, object]) -> str:
    return ", ".join(f"{key} = {value_text(value)}" for key, value in values.items())


def _offered(unfit: Mapping[str, str]) -> list[dict[str, Any]]:
    items = {name: {"subtitle": says, "disabled": False, "lines": "two"} for name, says in NAMES.items()}
    for name, why in unfit.items():
        items[name] = items.pop(name) | {"subtitle": why, "disabled": True, "lines": "three"}
    return [{"value": name, "title": name, "props": props} for name, props in items.items()]


def _stamp(folder: Path) -> int:
    """Time of the last change of a study, or 0."""
    return (folder / FILE).stat().st_mtime_ns if (folder / FILE).is_file() else 0


def _picture(run: Run, x: str, y: str) -> str:
    from coilarray.viz.plots.studies import plot_front
    from coilarray.viz.plots.style import new_axes

    values: Any = list(zip(run.values(x), run.values(y), strict=True))
    two = (x, y) == run.objectives[:2] and len(run.maximized) == 2
    stairs: Any = ("pre" if run.maximized[0] else "post") if two else None
    axes = plot_front(
        values, [point.feasible for point in run.points], run.front, labels=(axis_label(x), axis_label(y)),
        start=None if run.start is None else values[run.start], stairs=stairs, ax=new_axes(*_SIZE),
    )  # fmt: skip
    return image_of(cast("Figure", axes.figure))


_SENT_EVERY = 1.0  # s between two results of a running sweep
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
            session, values, "study_problem", choose_axis=self._choose, start_study=self._start, keep_study=self._keep,
            take_sweep_point=self._take,
        )  # fmt: skip

    def show(self, work: Work, *, anew: bool) -> None:
        """Offer a design's entries, `anew` for other files or coils."""
        state = self._state
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
        entry = next((one for one in entries_of(self._session.work.opened) if one.key == key), None)
        chosen = _NO_AXIS if entry is None else {"key": entry.key, "values": axis_text(entry)}
        axes = self._state.sweep_axes
        self._state.sweep_axes = [{**axis, **chosen} if axis["number"] == number else axis for axis in axes]

    def _start(self, kind: str, axes: list[Axis], quantities: list[str], file: str, boards: str) -> None:
        """Begin a study."""
        session, state, work = self._session, self._state, self._session.work
        item: list[Any] = [work.opened.document, work.design.name]
        task: Any = sweep_entries
        if kind == "sweep":
            item += [[f"{axis['key']}={axis['values']}" for axis in axes if axis["key"]], quantities]
        else:
            task, count = spread_boards, round(number_of("boards", boards))
            if not 0 <= count <= _MOST_BOARDS:
                raise DesignError(f"boards must be 0 to {_MOST_BOARDS}; got {boards}.")
            item += [None if file == _TYPICAL else session.setup.shelf.path(file), quantities, count]

        def show(found: SweepResult | xr.Dataset, ended: bool = True) -> None:
            self._of, self._found = work.design, found
            session.begin(self._draw, work.design, kind, found, ended)

        def cancelled() -> None:
            state.file_note = f"{kind}: stopped; what is computed is kept, and Start goes on from it"

        name, watch = f"{kind} of {work.design.name}", partial(show, ended=False)
        if session.start_bar("study", name, task, *item, done=show, cancelled=cancelled, watch=watch):
            state.study_problem, state.study = "", _NONE
            self._of, self._found = None, None

    async def _draw(self, design: Design, kind: str, found: SweepResult | xr.Dataset, ended: bool) -> None:
        """Show a result, unless there is a later result."""
        picture, problem = await asyncio.to_thread(_picture_of_study, found)
        if found is not self._found:
            return
        if isinstance(found, SweepResult):
            head, rows = sweep_rows(found)
            line = f"{design.name}: {len(rows)} of {len(found.points)} points"
        else:
            head, rows = tolerance_rows(found)
            drawn = found.sizes.get("sample", 0)
            line = f"{design.name}: {drawn} boards drawn, {found.attrs['boards'] - drawn} for the linear part"
        shown = {"kind": kind, "line": line, "picture": picture, "head": head, "ended": ended}
        with self._state as state:
            state.study = {**shown, "rows": rows[:_MOST_SHOWN]}
            state.study_problem = problem or state.study_problem
            state.study_old = design.digest != self._session.work.design.digest

    def _take(self, point: int) -> None:
        """Set the design's entries to a point of the sweep."""
        found = self._found
        if isinstance(found, SweepResult) and 0 <= point < len(found.points):
            entries = found.points[point]
            self._session.change(lambda work: work.document_with(entries), "study_problem")

    def _keep(self) -> None:
        session, found = self._session, self._found
        if found is None or self._of is None:
            return
        kind, values = ("sweep", found.values) if isinstance(found, SweepResult) else ("tolerance", found)
        path = session.may_write(f"{self._of.name}-{kind}.nc")
        if path is not None:
            save_dataset(values, path)
            session.wrote(path, f"wrote {path}")


def _picture_of_study(found: SweepResult | xr.Dataset) -> tuple[str, str]:
    from coilarray.viz.plots.studies import sweep_figure, tolerance_figure

    try:
        return image_of(sweep_figure(found.values) if isinstance(found, SweepResult) else tolerance_figure(found)), ""
    except ValueError as error:  # more panels than a figure has
        return "", str(error)
