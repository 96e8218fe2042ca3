"""Tab of runs: searches for better designs."""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from coilarray.compute.display_units import true_minus, value_text
from coilarray.compute.threads import Progress
from coilarray.design.model import Design, DesignFile, build_design_file
from coilarray.errors import CoilarrayError, DesignError
from coilarray.studies.optimize.derive import NAMES, adjusted, derive_goal, unfit_goals
from coilarray.studies.optimize.goal import Trial, held_back, unbeaten
from coilarray.studies.optimize.run import FILE, read_studies
from coilarray.studies.quantities import QUANTITIES, evaluate
from coilarray.viz.studio.job import Step
from coilarray.viz.studio.services import Document
from coilarray.viz.studio.session import Panel, Session, image_of
from coilarray.viz.studio.words import (
    MOST_SHOWN,
    NO_PREVIEW,
    axis_label,
    limit_words,
    preview,
    quantity_of,
    unit_of,
    with_unit,
    words,
)
from coilarray.viz.studio.work import number_of, text_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure


_EVERY = 3.0  # s between two looks for new points
_ALLOWED = 1e-3  # mm, margin to within which a limit counts as kept
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
    refused: tuple[str, ...] = ()  # reasons of the points without a board

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


def run_lines(run: Run) -> list[str]:
    """Describe a run in words."""
    kept = sum(point.feasible for point in run.points)
    points = f"{run.tried} point{'' if run.tried == 1 else 's'} computed"
    refined = f", {run.refined} of them to refine the best" if run.refined else ""
    lines = [f"{points}{refined}; {kept} keep{'s' if kept == 1 else ''} all limits"]
    start = None if run.start is None else run.points[run.start]
    if len(run.objectives) > 1:
        lines.append(f"{len(run.front)} on the front." if run.front else "None is better than the start.")
    else:
        name = run.objectives[0]
        of_start = "" if start is None else f" {value_text(start.scores[0])}"
        broken = "" if start is None or start.feasible else ", which breaks a limit"
        if run.front:
            best = value_text(run.points[run.front[0]].scores[0])
            lines.append(f"Best {words(name)}: {best}" + (f"; at the start{of_start}{broken}." if of_start else "."))
        elif kept:
            lines.append("None is better than the start" + (f", with{of_start}." if of_start else "."))
        elif run.points:
            lines.append("None keeps all limits.")
        lines += held_lines(run)
    for name in run.objectives:
        base = quantity_of(name).partition("[")[0]
        if base in QUANTITIES:
            lines.append(f"{words(quantity_of(name))}: {QUANTITIES[base].says}.")
    return lines


def held_lines(run: Run) -> list[str]:
    """Say which limits hold a search back, and what would free it."""
    held, lines = held_back(run.points, maximized=run.maximized[0]), []
    if held:
        nearest, limits = held
        lines.append(
            f"{' and '.join(map(limit_words, limits))} holds it: without this limit {words(run.objectives[0])} reaches "
            f"{value_text(nearest.scores[0])} with {_list(nearest.changes)}."
        )
        if any(limit.startswith("fab_margin_mm") for limit in limits):
            lines.append("What would free it: copper layers of their own for neighbours, or vias over fewer layers.")
    if run.refused and (held or not any(one.feasible for one in run.points) or run.objectives[0].startswith("|k[")):
        reason, count = Counter(run.refused).most_common(1)[0]
        lines.append(f"{count} point{'' if count == 1 else 's'} gave no board, most often: {reason}")
    return lines


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
    refused = tuple(point["reason"] for point in points if point["reason"])
    return Run(name, tuple(names), tuple(maximized), tuple(trials), len(points), refined, start, refused)


def limits_of(file: DesignFile, goal: str) -> list[dict[str, str]]:
    """Limits of a named goal, each with the present value."""
    found = derive_goal([goal], file).goal.constraints
    now = evaluate(file.design, [one.quantity for one in found])
    rows = []
    for one in found:
        for side, value in (("at_least", one.at_least), ("at_most", one.at_most)):
            if value is not None:
                rows.append({
                    "quantity": one.quantity, "words": words(one.quantity), "side": side,
                    "value": true_minus(text_of(value)), "unit": unit_of(one.quantity),
                    "now": _now_text(one.quantity, now[one.quantity]),
                })  # fmt: skip
    return rows


def _now_text(name: str, value: float) -> str:
    """Present value with its unit, in words if a margin is zero."""
    return "now just kept" if name == "fab_margin_mm" and abs(value) < _ALLOWED else f"now {with_unit(name, value)}"


def search_goal(
    document: Document,
    name: str,
    goal: str,
    trials: int,
    limits: Sequence[Mapping[str, Any]],
    folder: Path,
    progress: Progress,
) -> str:
    """Search as ``coilarray optimize`` does, into a folder."""
    from coilarray.studies.optimize.run import optimize_design, write_optimization

    file = build_design_file(document, name)
    wanted = adjusted(derive_goal([goal], file), (), limits).goal
    wanted = wanted.model_copy(update={"search": wanted.search.model_copy(update={"trials": trials})})
    found = optimize_design(file, wanted, folder, progress=lambda done, total, _: progress(done, total))
    write_optimization(found, folder)
    better = len(found.front)
    return f"{NAMES[goal]}: {better or 'no'} better design{'' if better == 1 else 's'} than this one"


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
            "run_limits": [], "preview": NO_PREVIEW,
        }  # fmt: skip
        super().__init__(
            session, values, "runs_problem", read_runs=self._read, show_run=self._show, preview_point=self._preview,
            take_point=self._take, start_run=self._start,
        )  # fmt: skip

    def offer(self) -> None:
        """List fitting runs and goals, if their tab is open."""
        session, state, work = self._session, self._state, self._session.work
        if state.tab != "runs":
            return
        state.run_folders = run_folders(session.setup.shelf.folder)

        def show(unfit: Mapping[str, str]) -> None:
            if session.is_current(work.design):
                self._offered = work.design.digest
                state.run_goals = _offered(unfit)
                if state.run_goal in unfit:
                    state.run_goal = next((name for name in NAMES if name not in unfit), state.run_goal)

        if work.design.digest != self._offered:
            session.scenes.ask([Step("goals", lambda: unfit_goals(work.opened), show, session.say, rest=_REST)])
            self.limit()

    def limit(self) -> None:
        """Offer the limits of the chosen goal."""
        session, work, goal = self._session, self._session.work, str(self._session.state.run_goal)
        if session.state.tab != "runs" or goal not in NAMES:
            return

        def show(limits: list[dict[str, str]]) -> None:
            if session.is_current(work.design) and session.state.run_goal == goal:
                session.state.run_limits = limits

        session.state.run_limits = []
        step = Step("limits", lambda: limits_of(work.opened, goal), show, lambda _: None, rest=_REST)
        session.slow.ask([step])

    def show(self, design: Design) -> None:
        """Mark shown runs that belong to another design."""
        state = self._session.state
        state.preview = NO_PREVIEW
        of = str(state.run_name).rpartition("-")[0]
        digest = design.digest if self._folder is None else self._started.get(self._folder, design.digest)
        changed = " – of the design before it was changed" if digest != design.digest else ""
        state.run_of = changed if of in ("", design.name) else " – of another design"

    def _start(self, goal: str, trials: str, limits: list[dict[str, str]]) -> None:
        session, design = self._session, self._session.work.design
        folder = session.setup.shelf.folder / f"{design.name}-{goal}"
        count = round(number_of("points", trials))
        if goal not in NAMES or not 1 <= count <= _MOST_TRIALS:
            raise DesignError(f"points must be 1 to {_MOST_TRIALS}; got {trials}.")

        def ended(line: str) -> None:
            self._state.file_note = line
            self.offer()
            session.begin(self._read, folder.name)

        bounds = [{"quantity": one["quantity"], one["side"]: number_of(one["words"], one["value"])} for one in limits]
        item = (session.work.opened.document, design.name, goal, count, bounds, folder)
        stopped = partial(ended, f"{NAMES[goal]}: stopped; the points are kept, and Start goes on from them")
        if session.start_bar(
            "search", f"{NAMES[goal]}: {design.name}", search_goal, *item, done=ended, cancelled=stopped
        ):
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
            state.run_name, state.run_x, state.run_y = run.name, first, second
            state.run_axes = [{"value": one, "title": axis_label(one)} for one in axes]
            state.run_picture, state.run_lines = picture, run_lines(run)
            state.run_scores = [axis_label(one) for one in run.objectives]
            state.run_front = [
                {
                    "name": point.name, "scores": [value_text(score) for score in point.scores],
                    "entries": _list(point.changes), "quantities": _list(point.quantities),
                }
                for point in (run.points[k] for k in run.front[:MOST_SHOWN])
            ]  # fmt: skip
            self.show(self._session.work.design)

    def _point(self, name: str) -> tuple[Run, Trial] | None:
        runs = (run for run in self._runs if run.name == self._state.run_name)
        return next(((run, point) for run in runs for point in run.points if point.name == name), None)

    async def _preview(self, name: str) -> None:
        if (found := self._point(name)) is not None:
            run, point = found
            before = {} if run.start is None else run.points[run.start].quantities
            item = self._session.work, point.changes, before, point.quantities, point.violations
            shown = await asyncio.to_thread(preview, *item)
            with self._state as state:
                state.preview = {**NO_PREVIEW, **shown, "name": name, "trigger": "take_point", "point": name}

    def _take(self, name: str) -> None:
        if (found := self._point(name)) is not None:
            entries = found[1].changes
            self._session.change(lambda work: work.document_with(entries), "runs_problem")


def _list(values: Mapping[str, object]) -> str:
    return ", ".join(f"{words(key)} {with_unit(key, value)}" for key, value in values.items())


def _offered(unfit: Mapping[str, str]) -> list[dict[str, Any]]:
    items = {name: {"subtitle": "", "disabled": False, "lines": "one"} for name in NAMES}
    for name, why in unfit.items():
        items[name] = items.pop(name) | {"subtitle": why, "disabled": True, "lines": "three"}
    return [{"value": name, "title": NAMES[name], "props": props} for name, props in items.items()]


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
