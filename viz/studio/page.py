"""Page of the studio.

It is a trame server with the values of its session, the panels, and their Vue templates in ``html``.
"""

from __future__ import annotations

import asyncio
import logging
import math
import secrets
import time
import traceback
from collections.abc import Callable, Coroutine, Iterator, Mapping
from concurrent.futures import Executor
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any

from coilarray.design.model import Design
from coilarray.errors import CoilarrayError, shown
from coilarray.viz.studio.build_panel import BuildPanel
from coilarray.viz.studio.calculator import Calculator
from coilarray.viz.studio.design_panel import DesignPanel
from coilarray.viz.studio.job import PATIENCE, Job, Outcome, Task, time_left
from coilarray.viz.studio.live_panel import LivePanel
from coilarray.viz.studio.messages import MessageError, checked
from coilarray.viz.studio.metal_panel import MetalPanel
from coilarray.viz.studio.new_panel import NewPanel
from coilarray.viz.studio.numbers_panel import NumbersPanel
from coilarray.viz.studio.panel import template
from coilarray.viz.studio.report_pages import ReportPages
from coilarray.viz.studio.runs_panel import RunsPanel
from coilarray.viz.studio.scene_panel import ScenePanel
from coilarray.viz.studio.services import Document, Services
from coilarray.viz.studio.shelf import Shelf
from coilarray.viz.studio.studies_panel import StudiesPanel
from coilarray.viz.studio.summary_panel import SummaryPanel
from coilarray.viz.studio.switches_panel import SwitchesPanel
from coilarray.viz.studio.touch_panel import TouchPanel
from coilarray.viz.studio.trail import Trail
from coilarray.viz.studio.work import Work


@dataclass(frozen=True)
class Setup:
    """Constant values that all pages of a studio share."""

    shelf: Shelf
    services: Services
    reports: ReportPages  # written by its pages
    threads: Executor  # computes the steps
    rendering_problem: str | None  # why there is no picture in 3-D


_LOG = logging.getLogger(__name__)
_PARTS = (
    "bar", "drawer", "scene", "summary", "numbers", "build", "switches", "touch", "metal", "runs", "studies", "live",
    "dialogs",
)  # fmt: skip
# Results that a change of the design makes stale.
_FOLLOWING = ("scene", "numbers", "rules", "circuit", "target", "summary")
_NUMBERS_FIRST = 0.015  # s for which the scene waits, as two threads of Python make each other slow
_JOINED = 1.0  # s, changes of a slider within it are undone together
_NOTICED = 0.3  # s after which the page shows that leads are being routed
_NO_JOB: Mapping[str, Any] = {"name": "", "text": "", "part": None, "left": "", "running": False}


@dataclass(frozen=True, eq=False)
class _Change:
    """Change of the design that waits for earlier changes."""

    made: Callable[[Work], Document]
    refused: Callable[[str], None]
    typed: bool


class Page:
    """Open page, which begins with the design `work`."""

    def __init__(self, setup: Setup, work: Work) -> None:
        from trame.app import get_server

        self.setup = setup
        self.key, self.secret = secrets.token_hex(16), secrets.token_hex(16)  # the client makes letters small
        self.work, self._trail, self._changed_at = work, Trail(), -math.inf
        self._changes: dict[object, _Change] = {}  # waiting changes
        self._changing: asyncio.Task[None] | None = None
        self.server: Any = get_server(self.key, client_type="vue3")
        self.server.cli.set_defaults(authKey=self.secret)
        self.state: Any = self.server.state
        # Numbers and scenes wait neither for each other nor for slow steps (circuit, summary, target).
        self.calculator, self.scenes, self.slow = (Calculator(setup.threads) for _ in range(3))
        self._loop = asyncio.get_running_loop()
        self._jobs: dict[str, Job] = {}
        self.endpoint: Any = None  # endpoint of its messages
        self.state.update(
            {
                "problem": "", "job": _NO_JOB, "stale": [], "failures": {}, "shown_accuracy": "", "can_undo": False,
                "can_redo": False, "routing": False,
            }
        )  # fmt: skip
        self.trigger("cancel_job", lambda: self.stop_job(self.state.job["name"]))
        self.trigger("undo", lambda: self._follow_trail(back=True))
        self.trigger("redo", lambda: self._follow_trail(back=False))
        self.scene = ScenePanel(self)
        self.numbers = NumbersPanel(self)
        self.summary = SummaryPanel(self)
        self.build = BuildPanel(self)
        self.switches = SwitchesPanel(self)
        self.touch = TouchPanel(self)
        self.metal = MetalPanel(self)
        self.runs = RunsPanel(self)
        self.studies = StudiesPanel(self)
        self.live = LivePanel(self)
        self.design = DesignPanel(self)
        self.new = NewPanel(self)
        self.state.tab = "live" if setup.services.alone else "numbers"
        for function in (self.redraw, self.runs.offer):
            self.state.change("tab")(lambda function=function, **_: function())
        self.state.change("matrix_of")(lambda **_: self.numbers.draw())
        self._build_layout()
        self.server.controller.on_server_bind.add(self._bind)
        self.server.controller.on_error.add(_log_error)
        self.server.controller.on_exception.add(self._refuse_call)
        self.server.start(
            backend="generic", exec_mode="task", port=0, timeout=0, disable_logging=True, show_connection_info=False,
            open_browser=False,
        )  # fmt: skip
        self.numbers.forget_saved(work)
        self.take(work)

    # ---------------------------------------------------------------- for the server

    async def close(self) -> None:
        """End all computations and processes of the page."""
        from trame.app.core import AVAILABLE_SERVERS
        from trame_vtk.modules.vtk import HELPERS_PER_SERVER

        self.calculator.close()
        self.scenes.close()
        self.slow.close()
        self.runs.close()
        if self._changing is not None:
            self._changing.cancel()
        jobs = list(self._jobs.values())
        for job in jobs:
            job.stop()
        for job in jobs:
            await asyncio.to_thread(job.close)
        self.scene.close()
        await self.server.stop()
        AVAILABLE_SERVERS.pop(self.key, None)
        HELPERS_PER_SERVER.pop(self.key, None)

    # ---------------------------------------------------------------- for the panels

    def trigger(self, name: str, function: Callable[..., Any]) -> None:
        """Let the page call a function or coroutine by name.

        Its errors are shown.
        """
        strict = checked(name, function)

        async def call(*arguments: Any) -> None:
            with self._showing_errors():
                await strict(*arguments)

        self.server.controller.trigger(name)(call)

    def _refuse_call(self, error: Exception) -> None:
        """Show the error of a call of the page.

        An error of our own code also prints a traceback, but an error of the call does not.
        """
        frames = traceback.walk_tb(error.__traceback__)
        if any(str(frame.f_globals.get("__name__")).startswith("coilarray.") for frame, _ in frames):
            traceback.print_exception(error)
        self.say(str(CoilarrayError(f"{type(error).__name__}: {error}")))

    def take(self, work: Work, *, typed: bool = False) -> None:
        """Show another or a changed design.

        `typed` is true if it comes from the fields.
        """
        if work.file != self.work.file:
            self._trail = Trail()
            self._changes.clear()
        elif work is not self.work and not (typed and time.monotonic() - self._changed_at < _JOINED):
            self._trail = self._trail.left(self.work)
        self._changed_at = time.monotonic() if typed else -math.inf
        self._show(work, typed=typed)

    def saved(self, work: Work) -> None:
        """Show that the design is in a file now.

        It may have another name or title.
        """
        same = work.design is self.work.design
        self.work = replace(self.work, file=work.file)  # no other file is opened
        if not same:
            self._show(work, typed=True)
            return
        self.work = work
        self.numbers.forget_saved(work)
        self.design.show(work, typed=True)
        self.redraw()

    def change(
        self,
        made: Callable[[Work], Document],
        refused: Callable[[str], None],
        *,
        entry: str = "",
        typed: bool = False,
    ) -> None:
        """Change the document of the design and show the design.

        `made` makes the new document from the present design. `refused` is called with one line if the change is
        impossible.

        Routing all coils to a connector takes seconds, so it is done beside the page. Changes in the meantime wait for
        it. From several changes of one `entry` only the last is made. `typed` has the same meaning as in `take`.
        """
        change = _Change(made, refused, typed)
        if self._changing is None or self._changing.done():
            try:
                document = made(self.work)
                if "connector" not in document:
                    self._take_change(self.work.with_document(document), change)
                    return
            except CoilarrayError as error:
                refused(str(error))
                return
            self._changing = self.begin(self._route)
        self._changes.pop(entry, None)
        self._changes[entry or change] = change

    async def _route(self) -> None:
        """Make the changes that wait.

        They are dropped if the design is undone or another design is opened meanwhile.
        """

        def say(routing: bool) -> None:
            with self.state:
                self.state.routing = routing

        saying = self._loop.call_later(_NOTICED, say, True)
        try:
            while self._changes:
                change = self._changes.pop(next(iter(self._changes)))
                begun = self.work
                try:
                    work = await asyncio.to_thread(lambda: begun.with_document(change.made(begun)))  # noqa: B023
                except CoilarrayError as error:
                    with self.state:
                        change.refused(str(error))
                    continue
                if self.work.opened.document is begun.opened.document:
                    self._take_change(work.of_file(self.work), change)
        finally:
            saying.cancel()
            say(False)

    def _take_change(self, work: Work, change: _Change) -> None:
        if not change.typed or work.design.digest != self.work.design.digest:
            self.take(work, typed=change.typed)

    @property
    def earlier(self) -> list[Document]:
        """Documents of the design before its changes.

        The last document comes first.
        """
        return [*(work.opened.document for work in reversed(self._trail.before)), self.work.kept]

    def _follow_trail(self, *, back: bool) -> None:
        """Undo the last change, or redo it.

        It shows the design before the last change, or the design that was undone last.
        """
        if self._trail.before if back else self._trail.after:
            self._trail, work = (self._trail.undo if back else self._trail.redo)(self.work)
            self._changed_at = -math.inf
            self._changes.clear()
            self._show(work, typed=False)

    def _show(self, work: Work, *, typed: bool) -> None:
        """Show a design on all panels."""
        opened = work.file != self.work.file
        other = opened or set(work.design.array.names) != set(self.work.design.array.names)
        if work.kept is not self.work.kept:
            self.numbers.forget_saved(work)
        self.work = work
        with self.state:
            if not work.kept and self.state.scene_saved:
                self.scene.show_saved(False)
            self.state.can_undo, self.state.can_redo = bool(self._trail.before), bool(self._trail.after)
            self.build.show(work)
            self.design.show(work, typed=typed)
            self.switches.show(work.design, anew=opened)
            self.touch.show(work.design, anew=other)
            self.metal.show(work.design, anew=other)
            self.live.show(work.design)
            self.runs.show(work.design)
            self.runs.offer()
            self.studies.show(work, anew=other)
            self.numbers.wait()
            self.state.scene_rests = False
            asked = {
                "scene": self.scene.steps(), "target": self.metal.steps(work.design),
                "summary": self.setup.services.summarize is not None,
            }  # fmt: skip
            self.state.stale = [name for name in _FOLLOWING if asked.get(name, True)]
            self.state.failures = {}
            self._say_accuracy()
        self.follow()

    def follow(self) -> None:
        """Compute everything that depends on the design."""
        if self.setup.services.alone:
            return
        design, numbers = self.work.design, self.numbers
        self.redraw(after=_NUMBERS_FIRST)
        self.calculator.ask([numbers.rough(design), numbers.rules(design), numbers.full(design)])
        self.slow.ask(self.metal.steps(design))

    def redraw(self, *, after: float = 0.0, moving: bool = False) -> None:
        """Compute the scene of the current tab again.

        It begins after `after` seconds. The shown scene is marked as stale until then. A `moving` scene is not marked,
        because it is always a little late.
        """
        if not moving:
            self.scene.expect()
        self.scenes.ask([replace(step, rest=after, patience=after) for step in self.scene.steps()])

    def is_current(self, design: Design) -> bool:
        """Check if a design is the current design."""
        return design is self.work.design

    def arrived(self, name: str, design: Design) -> None:
        """Remove the marks of stale or failed results.

        They are removed if the results belong to the current design. The shown accuracy of all results is updated.
        """
        if self.is_current(design):
            self.state.stale = [one for one in self.state.stale if one != name]
            self.state.failures = {one: why for one, why in self.state.failures.items() if one != name}
        self._say_accuracy()

    def failed(self, name: str, design: Design, problem: str) -> None:
        """Show that results of the current design will not come.

        The message is beside the picture, so it is visible in any tab.
        """
        with self.state:
            self.arrived(name, design)
            if self.is_current(design):
                self.state.failures = {**self.state.failures, name: problem}
                self._say_accuracy()

    def say(self, problem: str) -> None:
        """Show one line above the page.

        An empty line removes it.
        """
        with self.state:
            self.state.problem = problem

    def start_job(
        self,
        name: str,
        task: Task,
        item: Any,
        *,
        on_message: Callable[[Any], None],
        on_end: Callable[[Outcome], None],
        patience: float = PATIENCE,
    ) -> bool:
        """Start a `Job`.

        If a job of this name still runs, the result is False. `on_message` and `on_end` are called on the page.
        """
        if name in self._jobs:
            return False

        def ended(outcome: Outcome) -> None:
            self._jobs.pop(name, None)
            with self.state:
                on_end(outcome)

        def message(value: Any) -> None:
            with self.state:
                on_message(value)

        self._jobs[name] = Job(task, item, self._on_loop(message), self._on_loop(ended), patience=patience)
        return True

    def start_bar(
        self,
        name: str,
        text: str,
        task: Task,
        item: Any,
        done: Callable[[Any], None],
        failed: Callable[[str], None] | None = None,
        cancelled: Callable[[], None] = lambda: None,
        watch: Callable[[Any], None] = lambda message: None,
    ) -> bool:
        """Start a job with a progress bar.

        At its end exactly one of `done`, `failed` and `cancelled` is called. Without `failed` a failure is shown above
        the page, in whatever tab is open by then. Messages other than (done, total) go to `watch`.
        """
        begun = time.monotonic()

        def heard(message: Any) -> None:
            (progress if isinstance(message, tuple) else watch)(message)

        def progress(message: tuple[int, int] | None = None) -> None:
            part = None if message is None or not message[1] else round(100 * message[0] / message[1], 1)
            left = "" if part is None else time_left(part / 100, time.monotonic() - begun)
            self.state.job = {"name": name, "text": text, "part": part, "left": left, "running": True}

        def ended(outcome: Outcome) -> None:
            """Remove the bar and pass on the outcome."""
            self.state.job = _NO_JOB
            if outcome.kind == "done":
                done(outcome.result)
            elif outcome.kind == "failed":
                (failed or (lambda problem: self.say(f"{text}: {problem}")))(outcome.problem)
            else:
                cancelled()

        started = self.start_job(name, task, item, on_message=heard, on_end=ended)
        if started:
            self.say("")
            progress()
        return started

    def begin(self, work: Callable[..., Coroutine[Any, Any, None]], *arguments: Any) -> asyncio.Task[None]:
        """Start a coroutine on the page, and show its errors."""

        async def shown() -> None:
            with self._showing_errors():
                await work(*arguments)

        return self._loop.create_task(shown())

    def tell_job(self, name: str, order: str) -> None:
        """Send an order to a job."""
        if name in self._jobs:
            self._jobs[name].send(order)

    def stop_job(self, name: str) -> None:
        """Ask a job to end."""
        if name in self._jobs:
            self._jobs[name].stop()

    def _say_accuracy(self) -> None:
        """Show the accuracy of the numbers.

        "full accuracy" is shown only if all shown numbers belong to the current design.
        """
        stale, accuracy = self.state.stale, self.state.accuracy
        if self.state.failures:
            self.state.shown_accuracy = "not computed"
        elif "numbers" in stale or accuracy not in ("screen", "full"):
            self.state.shown_accuracy = "computing"
        elif accuracy == "screen":
            self.state.shown_accuracy = "rough"
        else:
            self.state.shown_accuracy = (
                "computing" if {"rules", "circuit", "target", "summary"} & set(stale) else "full accuracy"
            )

    def _bind(self, server: Any) -> None:
        self.endpoint = server["ws"]

    def _on_loop(self, function: Callable[[Any], None]) -> Callable[[Any], None]:
        """Let another thread call a function on the page's loop."""

        def shown(value: Any) -> None:
            with self._showing_errors():
                function(value)

        def call(value: Any) -> None:
            if not self._loop.is_closed():
                self._loop.call_soon_threadsafe(shown, value)

        return call

    @contextmanager
    def _showing_errors(self) -> Iterator[None]:
        """Show an error of the block on the page.

        No other code would see it.
        """
        try:
            yield
        except MessageError as error:
            self.say(str(error))
        except Exception as error:
            traceback.print_exc()
            self.say(f"{type(error).__name__}: {error}")

    def _build_layout(self) -> None:
        """Build the page from its HTML parts."""
        from trame.ui.vuetify3 import VAppLayout

        text = template("page")
        for name in _PARTS:
            text = text.replace(f"<!-- {name} -->", template(name))
        with VAppLayout(self.server) as layout:
            layout.root.add_child(text.replace("<!-- view -->", self.scene.html))


def _log_error(message: Any) -> None:
    """Log an error of the page's scripts in one line.

    The error may contain anything.
    """
    _LOG.warning("coilarray: the page of the studio reports %s", shown(message))
