"""Work of a page: steps in a thread, the newest request first, and jobs in processes.

A process reports its progress, can be stopped, and never outlives the studio.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import pickle
import signal
import threading
import time
import traceback
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing import get_context
from multiprocessing.connection import Connection
from typing import Any, Literal

from coilarray.compute.memory import collect_seldom
from coilarray.compute.workers import starting
from coilarray.errors import CoilarrayError
from coilarray.viz.studio.services import Orders, Tell

Task = Callable[[Any, Tell, Orders], Any]
"""Function of a module. It takes an item, a function to send messages, and the orders of the page, first to stop."""

PATIENCE = 0.5
"""Default time in s for a process to end by itself after `Job.stop`."""

_TOLD = 0.03  # share of a job before which no remaining time is shown
_SOME_MINUTES = 90.0  # s

_STOP = "stop"
_MOST_ORDERS = 100
_GOODBYE = 5.0  # s, longest time for a killed process to end


class Cancelled(Exception):  # noqa: N818 - it is no error
    """Raised by `Tell` in a process of a stopped job."""


@dataclass(frozen=True, eq=False)
class Outcome:
    """End of a job."""

    kind: Literal["done", "failed", "cancelled"]
    result: Any = None
    problem: str = ""


class Job:
    """Task that runs in a process of its own.

    It has a pickled `item`, and starts at once. In a thread of the job, `on_message` is called with every message of
    the task, and `on_end` once with the `Outcome`. After `stop` the process has `patience` seconds to end by itself.
    """

    def __init__(
        self,
        task: Task,
        item: Any,
        on_message: Callable[[Any], None],
        on_end: Callable[[Outcome], None],
        *,
        patience: float = PATIENCE,
    ) -> None:
        context = get_context("spawn")  # OpenMP kills forked children
        self._connection, theirs = context.Pipe()
        self._process = context.Process(
            target=_serve, args=(theirs, pickle.dumps((task, item)), patience), daemon=True, name="coilarray-studio"
        )
        with starting():  # an interrupt goes to the studio, which then ends the job
            self._process.start()
        theirs.close()
        self._patience = patience
        self._stopped = threading.Event()
        self._on_message, self._on_end = on_message, on_end
        self._thread = threading.Thread(target=self._listen, daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Ask the job to end and return at once."""
        if not self._stopped.is_set():
            self._stopped.set()
            with suppress(OSError):
                self._connection.send(_STOP)
            threading.Thread(target=self._end, daemon=True).start()

    def send(self, order: str) -> None:
        """Send an order to the task, see `Orders`."""
        if not self._stopped.is_set():
            with suppress(OSError):
                self._connection.send(order)

    def close(self) -> None:
        """Stop the job, and wait until its process has ended."""
        self.stop()
        self._thread.join(self._patience + 2 * _GOODBYE)

    def _listen(self) -> None:
        """Pass on messages until the process ends."""
        outcome = Outcome("cancelled")
        with suppress(EOFError, OSError):
            while True:
                kind, value = pickle.loads(self._connection.recv_bytes())
                if kind == "end":
                    outcome = value
                    break
                if not self._stopped.is_set():
                    self._on_message(value)
        self._process.join(_GOODBYE)
        self._kill()
        if self._stopped.is_set():
            outcome = Outcome("cancelled")
        elif outcome.kind == "cancelled":
            code = self._process.exitcode
            outcome = Outcome("failed", problem=f"the work ended with exit code {code}; is there memory enough?")
        self._connection.close()
        self._on_end(outcome)

    def _end(self) -> None:
        self._process.join(self._patience)
        self._kill()

    def _kill(self) -> None:
        if self._process.exitcode is None:
            self._process.kill()
            self._process.join(_GOODBYE)


def with_progress(item: Any, tell: Tell, _: Orders) -> Any:
    """Call the function and arguments of an item with a progress function."""
    function, *arguments = item
    return function(*arguments, progress_of(tell))


def progress_of(tell: Tell) -> Callable[[int, int], None]:
    """Make a `coilarray.compute.threads.Progress` that sends (done, total)."""
    return lambda done, total: tell((done, total))


def time_left(part: float, since: float) -> str:
    """Text of the likely remaining time of a job.

    A part of the job, from 0 to 1, is done in some seconds. The text is empty at first.

    Examples
    --------
    >>> time_left(0.01, 3), time_left(0.25, 11), time_left(0.5, 130), time_left(1.0, 130)
    ('', 'about 35 s left', 'about 2 min left', '')
    """
    if not _TOLD < part < 1:
        return ""
    seconds = since * (1 - part) / part
    if seconds < _SOME_MINUTES:
        return f"about {max(5, 5 * round(seconds / 5))} s left"
    return f"about {round(seconds / 60)} min left"


def _serve(connection: Connection, payload: bytes, patience: float) -> None:
    """Run the task in a process that ends with the connection."""
    collect_seldom()
    if hasattr(signal, "SIGTERM"):
        signal.signal(signal.SIGTERM, _leave)
    orders = _Orders()
    stopped = orders.stopped
    lock = threading.Lock()

    def send(kind: str, value: Any) -> None:
        data = pickle.dumps((kind, value))
        with lock, suppress(OSError):
            connection.send_bytes(data)

    def tell(message: Any) -> None:
        if stopped.is_set():
            raise Cancelled
        send("message", message)

    threading.Thread(target=_watch, args=(connection, orders, patience), daemon=True).start()
    try:
        task, item = pickle.loads(payload)
        outcome = Outcome("done", task(item, tell, orders))
    except (Cancelled, SystemExit, KeyboardInterrupt):
        outcome = Outcome("cancelled")
    except CoilarrayError as error:
        outcome = Outcome("failed", problem=str(error))
    except Exception as error:
        traceback.print_exc()
        outcome = Outcome("failed", problem=f"{type(error).__name__}: {error}")
    send("end", outcome)
    connection.close()


class _Orders:
    """Orders to the task of this process, see `coilarray.viz.studio.services.Orders`."""

    def __init__(self) -> None:
        self.stopped = threading.Event()
        self.waiting: deque[str] = deque(maxlen=_MOST_ORDERS)

    def __call__(self) -> bool:
        return self.stopped.is_set()

    def take(self) -> list[str]:
        return [self.waiting.popleft() for _ in range(len(self.waiting))]


def _watch(connection: Connection, orders: _Orders, patience: float) -> None:
    """End the process after a stop or the studio's end."""
    with suppress(EOFError, OSError):
        while (order := connection.recv()) != _STOP:
            orders.waiting.append(order)
    orders.stopped.set()
    time.sleep(patience)
    os._exit(1)


def _leave(number: int, _: object) -> None:
    raise SystemExit(128 + number)


@dataclass(frozen=True, eq=False)
class Step:
    """Single computation."""

    name: str  # a new request replaces a waiting request of the same name
    compute: Callable[[], Any]  # runs in a thread
    show: Callable[[Any], None]  # runs on the page
    fail: Callable[[str], None]  # runs on the page with one line of text
    rest: float = 0.0  # s without a new request before it begins
    patience: float = 3600.0  # s after which it goes first and without rest, although new requests keep coming


class Calculator:
    """Computes the steps of a page one after the other."""

    def __init__(self, threads: Executor) -> None:
        self._threads = threads
        self._todo: dict[str, Step] = {}
        self._asked = 0.0
        self._waiting: dict[str, float] = {}  # start of the wait
        self._wake = asyncio.Event()
        self._task: asyncio.Task[None] | None = None
        self._closed = False

    def ask(self, steps: Sequence[Step]) -> None:
        """Request steps in their order.

        Nothing is done after `close`, because a job of a page may end later than its computations.
        """
        if self._closed:
            return
        kept = {name: step for name, step in self._todo.items() if name not in {one.name for one in steps}}
        self._todo = {step.name: step for step in steps} | kept
        self._asked = self._now()
        for step in steps:
            self._waiting.setdefault(step.name, self._asked)
        self._wake.set()
        if self._task is None or self._task.done():
            self._task = asyncio.get_running_loop().create_task(self._run())

    @property
    def idle(self) -> bool:
        """True if no request is left."""
        return self._task is None or self._task.done()

    def close(self) -> None:
        """Drop all requests, also later ones."""
        self._closed = True
        self._todo.clear()
        if self._task is not None:
            self._task.cancel()

    async def _run(self) -> None:
        """Do the steps until none is left."""
        while self._todo:
            step, wait = self._next()
            if wait > 0:
                self._wake.clear()
                with contextlib.suppress(TimeoutError):
                    await asyncio.wait_for(self._wake.wait(), wait)
                continue
            del self._todo[step.name]
            del self._waiting[step.name]
            await self._do(step)

    def _next(self) -> tuple[Step, float]:
        """Next step, and the time in s before it may begin."""
        now = self._now()
        for step in self._todo.values():
            if now - self._waiting[step.name] > step.patience:
                return step, 0.0
        step = min(self._todo.values(), key=lambda one: one.rest)  # the first of them
        return step, max(0.0, self._asked + step.rest - now)

    async def _do(self, step: Step) -> None:
        """Compute a step, and show its result or its error."""
        try:
            result = await asyncio.get_running_loop().run_in_executor(self._threads, step.compute)
            step.show(result)
        except CoilarrayError as error:
            step.fail(str(error))
        except Exception as error:
            traceback.print_exc()
            step.fail(f"{type(error).__name__}: {error}")

    @staticmethod
    def _now() -> float:
        return asyncio.get_running_loop().time()
