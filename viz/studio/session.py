"""State, design, computations, jobs and errors of an open page."""

from __future__ import annotations

import asyncio
import inspect
import io
import math
import secrets
import time
import traceback
from abc import ABC, abstractmethod
from collections.abc import Callable, Coroutine, Iterator, Mapping
from concurrent.futures import Executor
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from pydantic import ConfigDict, ValidationError, validate_call

from coilarray.compute.table import data_url
from coilarray.design.model import Design
from coilarray.errors import CoilarrayError, shown
from coilarray.viz.studio.job import PATIENCE, QUIT, Calculator, Job, Outcome, time_left
from coilarray.viz.studio.services import Document, Services
from coilarray.viz.studio.work import Shelf, Work

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_JOINED = 1.0  # s, changes of a slider within it are undone together
_LONGEST = 200  # designs that can be undone
_SENT = 4  # turns of the loop after which a flushed state is on its way
_NO_JOB: Mapping[str, Any] = {"name": "", "text": "", "part": None, "left": "", "running": False}
_SETTLED = frozenset({  # functions of the page that take the design with all waiting changes
    "start_run", "start_study", "write_report", "export_board", "save_design", "open_design", "make_design",
    "compute_table", "respond", "start_board",
})  # fmt: skip
_STRICT = ConfigDict(strict=True, allow_inf_nan=False)


@dataclass(frozen=True)
class Setup:
    """Constant values that all pages of a studio share."""

    shelf: Shelf
    services: Services
    reports: dict[str, Path]  # written by its pages, by keys that nobody can guess
    threads: Executor  # computes the steps
    rendering_problem: str | None  # why there is no picture in 3-D


class _Change(NamedTuple):
    """Change of the design that waits for earlier changes."""

    made: Callable[[Work], Document]
    problem: str
    entry: str
    joined: str


class Session(ABC):
    """State, design and work of a page's panels."""

    scene: Any  # panel with the picture

    def __init__(self, setup: Setup, work: Work) -> None:
        from trame.app import get_server

        self.setup = setup
        self.key, self.secret = secrets.token_hex(16), secrets.token_hex(16)  # the client makes letters small
        self.work, self._changed_at, self._changed_what = work, -math.inf, ""
        self._before: list[Work] = []  # earlier designs, and undone designs, the next one last
        self._after: list[Work] = []
        self._changes: dict[object, _Change] = {}  # waiting changes
        self._changing: asyncio.Task[None] | None = None
        self.server: Any = get_server(self.key, client_type="vue3")
        self.server.cli.set_defaults(authKey=self.secret)
        self.state: Any = self.server.state
        # Numbers and scenes wait neither for each other nor for slow steps.
        self.calculator, self.scenes, self.slow = (Calculator(setup.threads, self.state.flush) for _ in range(3))
        self._loop = asyncio.get_running_loop()
        self._jobs: dict[str, Job] = {}
        self._written: set[Path] = set()
        self.state.update({
            "problem": "", "job": _NO_JOB, "stale": [], "failures": {}, "shown_accuracy": "", "accuracy": "",
            "can_undo": False, "can_redo": False, "routing": False,
        })  # fmt: skip
        self.trigger("cancel_job", lambda: self.tell_job(self.state.job["name"]))
        self.trigger("undo", lambda: self._step(self._before, self._after))
        self.trigger("redo", lambda: self._step(self._after, self._before))

    @abstractmethod
    def _show(self, work: Work, *, typed: bool) -> None:
        """Show a design on all panels."""

    @abstractmethod
    def redraw(self, *, moving: bool = False) -> None:
        """Compute the current scene again, as stale unless it is `moving`."""

    async def close(self) -> None:
        """End all computations and processes."""
        for calculator in (self.calculator, self.scenes, self.slow):
            calculator.close()
        if self._changing is not None:
            self._changing.cancel()
        jobs = list(self._jobs.values())
        for job in jobs:
            job.send(QUIT)
        for job in jobs:
            await asyncio.to_thread(job.close)

    def take(self, work: Work, *, typed: bool = False, joined: str = "") -> None:
        """Show a design, `typed` if it comes from the fields."""
        # Changes that follow each other soon, or have the same word `joined`, are one step of undo.
        what = joined or ("fields" if typed else "")
        if work.file != self.work.file:
            self._changes.clear()
        soon = bool(joined) or time.monotonic() - self._changed_at < _JOINED
        if work is not self.work and not (what and what == self._changed_what and soon):
            self._before.append(self.work)
            del self._before[:-_LONGEST]
            self._after.clear()
        self._changed_at, self._changed_what = time.monotonic(), what
        self._show(work, typed=typed)

    def change(self, made: Callable[[Work], Document], problem: str = "", *, entry: str = "", joined: str = "") -> None:
        """Show the design with the document of `made`."""
        # An error is the state's `problem`, or that of the field of an `entry`. Changes are made one after the
        # other, of one entry or `joined` by one word only the last.
        change, name = _Change(made, problem, entry, joined), entry or joined
        self._changes.pop(name, None)
        self._changes[name or change] = change
        if self._changing is None or self._changing.done():
            self._changing = self.begin(self._make_changes)

    async def _make_changes(self) -> None:
        """Make waiting changes, unless another design is shown meanwhile."""
        while self._changes:
            change = self._changes.pop(next(iter(self._changes)))
            begun = self.work
            try:
                document = change.made(begun)
                if "connector" in document:  # to route all coils to it takes seconds
                    with self.state:
                        self.state.routing = True
                    work = await asyncio.to_thread(begun.with_document, document)
                else:
                    work = begun.with_document(document)
            except CoilarrayError as error:
                with self.state as state:
                    if change.entry:
                        state.errors = {**state.errors, change.entry: str(error)}
                    else:
                        state[change.problem] = str(error)
                continue
            finally:
                with self.state:
                    self.state.routing = False
            self.scene.show(work.design)
            for _ in range(_SENT):  # the rest takes much longer
                await asyncio.sleep(0)
            same, typed = self.work.opened.document is begun.opened.document, bool(change.entry)
            if same and not (typed and work.design.digest == begun.design.digest):
                self.take(work.of_file(self.work), typed=typed, joined=change.joined)

    def _step(self, there: list[Work], back: list[Work]) -> None:
        if there:
            back.append(self.work)
            self._changed_at = -math.inf
            self._changes.clear()
            self._show(there.pop(), typed=False)

    def renamed(self, old: Work, saved: Work) -> None:
        """Let earlier and later designs of a file belong to the file that it is saved as."""
        for steps in (self._before, self._after):
            steps[:] = [one.of_file(saved) if one.file == old.file else one for one in steps]

    def is_current(self, design: Design) -> bool:
        """Check if a design is the current design."""
        return design is self.work.design

    def arrived(self, name: str, design: Design) -> None:
        """Remove the marks of stale or failed results."""
        if self.is_current(design):
            self.state.stale = [one for one in self.state.stale if one != name]
            self.state.failures = {one: why for one, why in self.state.failures.items() if one != name}
        self._say_accuracy()

    def failed(self, name: str, design: Design, problem: str) -> None:
        """Show in any tab that results will not come."""
        with self.state:
            self.arrived(name, design)
            if self.is_current(design):
                self.state.failures = {**self.state.failures, name: problem}
                self._say_accuracy()

    def _say_accuracy(self) -> None:
        """Show the accuracy, "full accuracy" if all numbers are current."""
        stale, accuracy = self.state.stale, self.state.accuracy
        if self.state.failures:
            shown = "not computed"
        elif "numbers" in stale or accuracy not in ("screen", "full"):
            shown = "computing"
        elif accuracy == "screen":
            shown = "rough"
        else:
            shown = "computing" if {"rules", "circuit", "target", "summary"} & set(stale) else "full accuracy"
        self.state.shown_accuracy = shown

    def say(self, problem: str, place: str = "problem") -> None:
        """Show a line above the page or at another place, or none if empty."""
        with self.state as state:
            state[place] = problem

    def trigger(self, name: str, function: Callable[..., Any], problem: str = "problem") -> None:
        """Let the page call a function, whose errors are the `problem`."""
        strict = validate_call(config=_STRICT)(function)

        async def call(*arguments: Any) -> None:
            with self.showing_errors(problem):
                if name in _SETTLED and self._changing is not None:
                    await self._changing
                try:
                    result = strict(*arguments)
                    if inspect.isawaitable(result):
                        await result
                except ValidationError as error:
                    first = error.errors(include_url=False, include_context=False)[0]
                    place = ".".join(map(str, first["loc"]))
                    self.say(f"{name}: {place}: {first['msg']}; got {shown(first['input'])}.")

        self.server.controller.trigger(name)(call)

    def may_write(self, name: str) -> Path | None:
        """Path of a file to write, None if not ours."""
        path = self.setup.shelf.folder / name
        if path.exists() and path not in self._written:
            self.say(f"{name} is there already, and not from this page; rename or remove it first.")
            return None
        return path

    def wrote(self, path: Path, line: str) -> None:
        """Note a file that the page wrote, and may replace."""
        self._written.add(path)
        self.state.file_note = line

    def begin(self, work: Callable[..., Coroutine[Any, Any, None]], *arguments: Any) -> asyncio.Task[None]:
        """Start a coroutine on the page, and show its errors."""

        async def shown() -> None:
            with self.showing_errors():
                await work(*arguments)

        return self._loop.create_task(shown())

    @property
    def busy(self) -> bool:
        """True if a job runs that goes on without its page, as a board does not."""
        return bool(set(self._jobs) - {"board"})

    def start_job(
        self,
        name: str,
        function: Callable[..., Any],
        *arguments: Any,
        on_message: Callable[[Any], None],
        on_end: Callable[[Outcome], None],
        patience: float = PATIENCE,
    ) -> bool:
        """Start a `Job` that calls the page, once per name."""
        if name in self._jobs:
            return False

        def ended(outcome: Outcome) -> None:
            self._jobs.pop(name, None)
            on_end(outcome)

        message, end = self._on_loop(on_message), self._on_loop(ended)
        self._jobs[name] = Job(function, *arguments, on_message=message, on_end=end, patience=patience)
        return True

    def start_bar(
        self,
        name: str,
        text: str,
        function: Callable[..., Any],
        *arguments: Any,
        done: Callable[[Any], None],
        failed: Callable[[str], None] | None = None,
        cancelled: Callable[[], None] = lambda: None,
        watch: Callable[[Any], None] = lambda message: None,
    ) -> bool:
        """Start a job with a progress bar."""
        # One of `done`, `failed` and `cancelled` is called at its end. Without `failed` a failure is shown above the
        # page. Messages other than (done, total) go to `watch`.
        begun = time.monotonic()

        def heard(message: Any) -> None:
            if not isinstance(message, tuple):
                watch(message)
                return
            part = round(100 * message[0] / message[1], 1) if message[1] else None
            left = "" if part is None else time_left(part / 100, time.monotonic() - begun)
            self.state.job = {"name": name, "text": text, "part": part, "left": left, "running": True}

        def ended(outcome: Outcome) -> None:
            self.state.job = _NO_JOB
            if outcome.kind == "done":
                done(outcome.result)
            elif outcome.kind == "failed":
                (failed or (lambda problem: self.say(f"{text}: {problem}")))(outcome.problem)
            else:
                cancelled()

        started = self.start_job(name, function, *arguments, on_message=heard, on_end=ended)
        if started:
            self.say("")
            heard((0, 0))
        return started

    def tell_job(self, name: str, order: str = QUIT) -> None:
        """Send an order to a job, by default to end."""
        if name in self._jobs:
            self._jobs[name].send(order)

    def _on_loop(self, function: Callable[[Any], None]) -> Callable[[Any], None]:
        """Let another thread call a function on the page's loop."""

        def shown(value: Any) -> None:
            with self.showing_errors(), self.state:
                function(value)

        def call(value: Any) -> None:
            if not self._loop.is_closed():
                self._loop.call_soon_threadsafe(shown, value)

        return call

    @contextmanager
    def showing_errors(self, place: str = "problem") -> Iterator[None]:
        """Show an error of the block on the page."""
        try:
            yield
        except CoilarrayError as error:
            self.say(str(error), place)
        except Exception as error:
            traceback.print_exc()
            self.say(f"{type(error).__name__}: {error}")


class Panel:
    """Panel of a page: first values, place of its errors, functions by name."""

    def __init__(
        self, session: Session, values: Mapping[str, Any], problem: str = "problem", **triggers: Callable[..., Any]
    ) -> None:
        self._session, self._state = session, session.state
        session.state.update(values)
        for name, function in triggers.items():
            session.trigger(name, function, problem)


def template(name: str) -> str:
    """Part of the page from the folder ``html``."""
    return resources.files("coilarray.viz.studio").joinpath("html", f"{name}.html").read_text(encoding="utf-8")


def image_of(figure: Figure) -> str:
    """Figure as a drawing, sharp at any size, in a data URL."""
    from coilarray.viz.plots.style import save  # imported late, as Matplotlib loads slowly

    buffer = io.BytesIO()
    save(figure, buffer, format="svg", bbox_inches="tight")
    return data_url(buffer.getvalue(), "svg+xml")
