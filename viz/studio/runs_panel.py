"""Tab of optimisation runs.

It shows their points as they arrive and the Pareto front, and makes any point the new design.
"""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from coilarray.design.model import Design
from coilarray.errors import CoilarrayError, DesignError
from coilarray.studies.optimize.derive import NAMES, unfit_goals
from coilarray.studies.optimize.search import FILE
from coilarray.viz.studio.calculator import Step
from coilarray.viz.studio.entries import number_of
from coilarray.viz.studio.job import with_progress
from coilarray.viz.studio.panel import Panel, image_of
from coilarray.viz.studio.runs import Run, axis_label, front_rows, read_runs, run_folders, run_lines
from coilarray.viz.studio.searching import search_goal

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from coilarray.viz.studio.page import Page

_EVERY = 3.0  # s
_REST = 0.3  # s without a change before goals are offered
_MOST_TRIALS = 10_000
_SIZE = (4.6, 3.3)  # of the picture in inches, so that its letters are legible beside the board


class RunsPanel(Panel):
    """Panel with the runs in the folders beside the designs."""

    def __init__(self, page: Page) -> None:
        self._runs: tuple[Run, ...] = ()
        self._name = ""  # of the folder that is read, as the state of the page may contain any text
        self._stamp: tuple[int, ...] = ()
        self._started: dict[str, str] = {}  # digests of the designs of this page's searches, by folder
        self._watching: asyncio.Task[None] | None = None
        self._starting: asyncio.Task[None] | None = None
        values = {
            "run_folders": [], "run_folder": "", "run_names": [], "run_name": "", "run_axes": [], "run_x": "",
            "run_y": "", "run_picture": "", "run_lines": [], "run_of": "", "run_front": [], "run_scores": [],
            "runs_problem": "",
            "run_goals": _offered({}), "run_goal": next(iter(NAMES)), "run_trials": "40",
        }  # fmt: skip
        self._offered = ""  # digest of the design with known goals
        super().__init__(
            page, values, look_for_runs=self._look, read_runs=self._read, show_run=self._show, take_point=self._take,
            start_run=self._start,
        )  # fmt: skip

    def offer(self) -> None:
        """Find the goals that fit, if their tab is open.

        For 64 coils this takes a while.
        """
        page = self._page
        work = page.work
        if page.state.tab == "runs" and work.design.digest != self._offered:

            def find() -> tuple[Design, Mapping[str, str]]:
                return work.design, unfit_goals(work.opened)

            page.scenes.ask([Step("goals", find, self._show_goals, page.say, rest=_REST)])

    def _show_goals(self, found: tuple[Design, Mapping[str, str]]) -> None:
        """Show the goals that fit the design."""
        design, unfit = found
        if self._page.is_current(design):
            self._offered = design.digest
            with self._page.state as state:
                state.run_goals = _offered(unfit)
                if state.run_goal in unfit:
                    state.run_goal = next((name for name in NAMES if name not in unfit), state.run_goal)

    def show(self, design: Design) -> None:
        """Mark shown runs that belong to another design."""
        state = self._page.state
        of, digest = str(state.run_name).rpartition("-")[0], self._started.get(self._name, design.digest)
        changed = " – of the design before it was changed" if digest != design.digest else ""
        state.run_of = changed if of in ("", design.name) else " – of another design"

    def _look(self) -> None:
        state = self._page.state
        state.run_folders = run_folders(self._page.setup.shelf.folder)
        state.runs_problem = "" if state.run_folders else (
            f"no folder in {self._page.setup.shelf.folder} holds a {FILE}; coilarray optimize makes one."
        )  # fmt: skip

    def _start(self, goal: str, trials: str) -> None:
        """Begin a search for a better design, or continue it.

        Its points are shown as they arrive.
        """
        page, state = self._page, self._page.state
        design = page.work.design
        folder = page.setup.shelf.folder / f"{design.name}-{goal}"
        try:
            count = round(number_of("points", str(trials)))
            if goal not in NAMES or not 1 <= count <= _MOST_TRIALS:
                raise DesignError(f"points must be 1 to {_MOST_TRIALS}; got {trials}.")
        except CoilarrayError as error:
            state.runs_problem = str(error)
            return

        def ended(line: str) -> None:
            state.file_note = line
            if folder.name in run_folders(folder.parent):
                page.begin(self._read, folder.name)

        item = (search_goal, page.work.opened.document, design.name, goal, count, folder)
        stopped = partial(ended, f"{goal}: stopped; the points are kept, and Start goes on from them")
        if page.start_bar("search", f"{goal} of {design.name}", with_progress, item, ended, cancelled=stopped):
            state.runs_problem = ""
            self._started[folder.name] = design.digest
            self._starting = page.begin(self._read_first, folder)

    async def _read_first(self, folder: Path) -> None:
        """Show a search from its first points on."""
        while not (folder / FILE).is_file() and self._page.state.job["running"]:
            await asyncio.sleep(_EVERY)
        await asyncio.sleep(_EVERY)
        if (folder / FILE).is_file():
            await self._read(folder.name)

    async def _read(self, name: str) -> None:
        """Read a folder of runs.

        It is read again while its search continues.
        """
        state = self._page.state
        if name not in run_folders(self._page.setup.shelf.folder):
            return
        folder = self._page.setup.shelf.folder / name
        self._name, self._stamp = name, _stamp(folder)
        try:
            self._runs = await asyncio.to_thread(read_runs, folder)
        except CoilarrayError as error:
            with state:
                state.runs_problem = str(error)
            return
        with state:
            state.runs_problem = ""
            state.run_folder = name
            state.run_names = [run.name for run in self._runs]
            if state.run_name not in state.run_names:
                state.run_name = state.run_names[0] if state.run_names else ""
        await self._show(state.run_name, state.run_x, state.run_y)
        if self._watching is None or self._watching.done():
            self._watching = self._page.begin(self._follow)

    async def _follow(self) -> None:
        """Read the runs again while their search continues.

        This ends when their tab is closed.
        """
        while self._page.state.tab == "runs":
            await asyncio.sleep(_EVERY)
            if _stamp(self._page.setup.shelf.folder / self._name) != self._stamp:
                await self._read(self._name)

    def close(self) -> None:
        """Stop reading runs."""
        for task in (self._watching, self._starting):
            if task is not None:
                task.cancel()

    async def _show(self, name: str, x: str, y: str) -> None:
        """Show a run over two axes."""
        run = next((one for one in self._runs if one.name == name), None)
        if run is None:
            return
        axes = list(dict.fromkeys((*run.objectives, *run.quantities, *run.numbers)))
        telling = [name for name in axes if len(set(run.values(name))) > 1] or axes  # no bound that all points keep
        # Two objectives over each other, or a single objective over a varied entry.
        usual = telling[:2] if len(run.objectives) > 1 or not run.numbers else [run.numbers[0], axes[0]]
        first = x if x in axes else usual[0]
        second = y if y in axes else usual[-1]
        picture = await asyncio.to_thread(_picture, run, first, second) if run.points else ""
        state = self._page.state
        with state:
            state.run_name, state.run_axes, state.run_x, state.run_y = run.name, axes, first, second
            state.run_picture = picture
            state.run_lines = run_lines(run)
            state.run_front, state.run_scores = front_rows(run), list(run.objectives)
            self.show(self._page.work.design)

    def _take(self, name: str) -> None:
        """Set the design's entries to a run's point."""
        run = next((one for one in self._runs if one.name == self._page.state.run_name), None)
        point = None if run is None else next((one for one in run.points if one.name == name), None)
        if point is not None:
            entries = point.entries
            refused = partial(setattr, self._page.state, "runs_problem")
            self._page.change(lambda work: work.document_with(entries), refused)


def _offered(unfit: Mapping[str, str]) -> list[dict[str, Any]]:
    """All goals as the page lists them.

    Goals that fit the design come first. Each has a description, or the reason why it does not fit.
    """
    items = {name: {"subtitle": says, "disabled": False, "lines": "two"} for name, says in NAMES.items()}
    for name, why in unfit.items():
        items[name] = items.pop(name) | {"subtitle": why, "disabled": True, "lines": "three"}
    return [{"value": name, "title": name, "props": props} for name, props in items.items()]


def _stamp(folder: Path) -> tuple[int, ...]:
    """Read the times of the last changes of a study.

    They are the times of the study in a folder and of its journal.
    """
    times = []
    for name in (FILE, f"{FILE}-wal"):
        try:
            times.append((folder / name).stat().st_mtime_ns)
        except OSError:
            times.append(0)
    return tuple(times)


def _picture(run: Run, x: str, y: str) -> str:
    """Draw the points over two quantities.

    The image is a data URL.
    """
    from coilarray.viz.plots.optimize import plot_front
    from coilarray.viz.plots.style import new_axes

    values: Any = list(zip(run.values(x), run.values(y), strict=True))
    two = (x, y) == run.objectives[:2] and len(run.maximized) == 2
    stairs: Any = ("pre" if run.maximized[0] else "post") if two else None
    axes = plot_front(
        values, [point.feasible for point in run.points], run.front, labels=(axis_label(x), axis_label(y)),
        start=None if run.start is None else values[run.start], stairs=stairs, ax=new_axes(*_SIZE),
    )  # fmt: skip
    return image_of(cast("Figure", axes.figure))
