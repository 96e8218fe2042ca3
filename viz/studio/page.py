"""One page: a trame server of its own with the values of its session, and the panels that fill it."""

from __future__ import annotations

import asyncio
import inspect
import secrets
import traceback
from collections.abc import Callable, Mapping
from concurrent.futures import Executor
from dataclasses import dataclass
from typing import Any

from coilarray.design.model import Design
from coilarray.viz.studio.board_panel import BoardPanel
from coilarray.viz.studio.calculator import Calculator
from coilarray.viz.studio.design_panel import DesignPanel
from coilarray.viz.studio.job import PATIENCE, Job, Outcome, Task
from coilarray.viz.studio.layout import build_layout
from coilarray.viz.studio.numbers_panel import NumbersPanel
from coilarray.viz.studio.runs_panel import RunsPanel
from coilarray.viz.studio.scene_panel import ScenePanel
from coilarray.viz.studio.services import Services
from coilarray.viz.studio.shelf import Shelf
from coilarray.viz.studio.switches_panel import SwitchesPanel
from coilarray.viz.studio.touch_panel import TouchPanel
from coilarray.viz.studio.work import Work


@dataclass(frozen=True)
class Setup:
    """What all pages of a studio share; none of it changes.

    Parameters
    ----------
    shelf : Shelf
        Where designs are.
    services : Services
        What comes from outside.
    threads : Executor
        Where steps are computed.
    rendering_problem : str or None
        Why there is no picture in three dimensions.
    """

    shelf: Shelf
    services: Services
    threads: Executor
    rendering_problem: str | None


class Page:
    """One open page.

    Parameters
    ----------
    setup : Setup
        Of the studio.
    work : Work
        Design that it begins with.
    """

    def __init__(self, setup: Setup, work: Work) -> None:
        from trame.app import get_server

        self.setup = setup
        self.key, self.secret = secrets.token_hex(16), secrets.token_hex(16)  # the client makes all letters small
        self.work = work
        self.server: Any = get_server(self.key, client_type="vue3")
        self.server.cli.set_defaults(authKey=self.secret)
        self.state: Any = self.server.state
        self.calculator = Calculator(setup.threads)
        self._loop = asyncio.get_running_loop()
        self._jobs: dict[str, Job] = {}
        self._endpoint: Any = None
        self.state.problem = ""
        self.state.job = _no_job()
        self.trigger("cancel_job", self._cancel)
        self.scene = ScenePanel(self)
        self.numbers = NumbersPanel(self)
        self.switches = SwitchesPanel(self)
        self.touch = TouchPanel(self)
        self.runs = RunsPanel(self)
        self.board = BoardPanel(self)
        self.design = DesignPanel(self)
        self.state.tab = "numbers"
        self.state.change("tab")(lambda tab, **_: self.redraw())
        build_layout(self)
        self.server.controller.on_server_bind.add(self._bind)
        self.server.start(
            backend="generic", exec_mode="task", port=0, timeout=0, disable_logging=True, show_connection_info=False,
            open_browser=False,
        )  # fmt: skip
        self.take(work)

    # ---------------------------------------------------------------- for the server

    @property
    def endpoint(self) -> Any:
        """Where the page's messages go in and out."""
        return self._endpoint

    async def close(self) -> None:
        """End everything that the page has begun; no process is left."""
        from trame.app.core import AVAILABLE_SERVERS
        from trame_vtk.modules.vtk import HELPERS_PER_SERVER

        self.calculator.close()
        self.runs.close()
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
        """Let the page call a function, of a coroutine or not, by a name; what goes wrong in it stands on the page."""

        async def call(*arguments: Any) -> None:
            try:
                result = function(*arguments)
                if inspect.isawaitable(result):
                    await result
            except Exception as error:
                traceback.print_exc()
                self.say(f"{type(error).__name__}: {error}")

        self.server.controller.trigger(name)(call)

    def take(self, work: Work, *, typed: bool = False) -> None:
        """Work on another design, or on the same one changed; `typed` where the fields themselves changed it."""
        other = set(work.design.array.names) != set(self.work.design.array.names) or work.file != self.work.file
        self.work = work
        with self.state:
            self.design.show(work, typed=typed)
            self.switches.show(work.design)
            self.touch.show(work.design, anew=other)
            self.board.show(work.design)
            self.numbers.wait()
            self.state.scene_rests = False
        self.follow()

    def follow(self) -> None:
        """Compute all that follows from the design."""
        design = self.work.design
        self.calculator.ask(
            [
                self.numbers.rough(design),
                *self.scene.steps(),
                self.numbers.rules(design),
                self.numbers.full(design),
                self.numbers.solve(design),
            ]
        )

    def redraw(self) -> None:
        """Make the scene of the present tab anew."""
        self.calculator.ask(self.scene.steps())

    def is_current(self, design: Design) -> bool:
        """Whether something is of the design as it is now."""
        return design is self.work.design

    def say(self, problem: str) -> None:
        """Show one line that concerns the whole page; empty takes it away."""
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
        """Begin long work beside the page; False where work of that name is still going on.

        Parameters
        ----------
        name : str
            One job of a name at a time.
        task, item, patience
            As in `coilarray.viz.studio.job.Job`.
        on_message, on_end : callable
            Called on the page.
        """
        if name in self._jobs:
            return False

        def ended(outcome: Outcome) -> None:
            self._jobs.pop(name, None)
            with self.state:
                on_end(outcome)

        def told(message: Any) -> None:
            with self.state:
                on_message(message)

        self._jobs[name] = Job(task, item, self._on_loop(told), self._on_loop(ended), patience=patience)
        return True

    def stop_job(self, name: str) -> None:
        """Tell a job to end."""
        if name in self._jobs:
            self._jobs[name].stop()

    def show_progress(self, name: str, text: str, message: tuple[int, int] | None = None) -> None:
        """Show how far the job with a bar is; None for no number yet."""
        part = None if message is None or not message[1] else round(100 * message[0] / message[1], 1)
        self.state.job = {"name": name, "text": text, "part": part, "running": True}

    def end_progress(self) -> None:
        """Take the bar away."""
        self.state.job = _no_job()

    def _cancel(self) -> None:
        self.stop_job(self.state.job["name"])

    def _bind(self, server: Any) -> None:
        self._endpoint = server["ws"]

    def _on_loop(self, function: Callable[[Any], None]) -> Callable[[Any], None]:
        def call(value: Any) -> None:
            if not self._loop.is_closed():
                self._loop.call_soon_threadsafe(function, value)

        return call


def _no_job() -> Mapping[str, Any]:
    return {"name": "", "text": "", "part": None, "running": False}
