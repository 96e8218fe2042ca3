"""Work of a page: steps in threads, jobs in processes.

The newest request comes first. A process reports its progress, can be stopped, and never outlives
the studio.
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

QUIT, ZERO = "q", "z"  # orders to a task: end, or measure the baseline again
PATIENCE = 0.5  # default time in s to end after `Job.stop`
_FIRST_PART = 0.03  # share of a job before which no remaining time is shown
_SOME_MINUTES = 90.0  # s
_GOODBYE = 5.0  # s, longest time for a killed process to end


class Cancelled(Exception):  # noqa: N818 - it is no error
    """Raised by `Link.send` in a process of a stopped job."""


class Link:
    """Link of a task to its page, also a `Progress`."""

    def __init__(self, connection: Connection) -> None:
        self._connection, self._sending = connection, threading.Lock()
        self._orders: deque[str] = deque()
        self._stopped = threading.Event()

    def __call__(self, done: int, total: int) -> None:
        """Send the progress of the task."""
        self.send((done, total))

    def send(self, message: Any) -> None:
        """Send a message to the page, or raise `Cancelled`."""
        if self._stopped.is_set():
            raise Cancelled
        self.pass_on("message", message)

    def orders(self) -> str:
        """Take all waiting orders, after a stop always `QUIT`."""
        return QUIT if self._stopped.is_set() else "".join(self._orders.popleft() for _ in range(len(self._orders)))

    def pass_on(self, kind: str, value: Any) -> None:
        """Send a value of a kind to the `Job`."""
        data = pickle.dumps((kind, value))
        with self._sending, suppress(OSError):
            self._connection.send_bytes(data)

    def listen(self, patience: float) -> None:
        """Take orders, and end the process after a stop."""
        with suppress(EOFError, OSError):
            while (order := self._connection.recv()) != QUIT:
                self._orders.append(order)
        self._stopped.set()
        time.sleep(patience)
        os._exit(1)


@dataclass(frozen=True, eq=False)
class Outcome:
    """End of a job."""

    kind: Literal["done", "failed", "cancelled"]
    result: Any = None
    problem: str = ""


class Job:
    """Function of a module that runs in its own process with a `Link`."""

    # In a thread, `on_message` gets every message, and `on_end` once the `Outcome`. A stopped process has `patience`
    # in s to end.

    def __init__(
        self,
        function: Callable[..., Any],
        *arguments: Any,
        on_message: Callable[[Any], None],
        on_end: Callable[[Outcome], None],
        patience: float = PATIENCE,
    ) -> None:
        context = get_context("spawn")  # OpenMP kills forked children
        self._connection, theirs = context.Pipe()
        task = pickle.dumps((function, arguments))
        self._process = context.Process(target=_serve, args=(theirs, task, patience), daemon=True, name="coilarray")
        with starting():  # an interrupt goes to the studio, which then ends the job
            self._process.start()
        theirs.close()
        self._patience = patience
        self._stopped = threading.Event()
        self._on_message, self._on_end = on_message, on_end
        self._thread = threading.Thread(target=self._listen, daemon=True)
        self._thread.start()

    def send(self, order: str) -> None:
        """Send an order of `Link.orders`, nothing after `QUIT`."""
        if not self._stopped.is_set():
            with suppress(OSError):
                self._connection.send(order)
            if order == QUIT:
                self._stopped.set()
                threading.Thread(target=self._end, args=(self._patience,), daemon=True).start()

    def close(self) -> None:
        """Stop the job, and wait until its process has ended."""
        self.send(QUIT)
        self._thread.join(self._patience + 2 * _GOODBYE)

    def _listen(self) -> None:
        outcome = Outcome("cancelled")
        with suppress(EOFError, OSError):
            while True:
                kind, value = pickle.loads(self._connection.recv_bytes())
                if kind == "end":
                    outcome = value
                    break
                if not self._stopped.is_set():
                    self._on_message(value)
        self._end(_GOODBYE)
        if self._stopped.is_set():
            outcome = Outcome("cancelled")
        elif outcome.kind == "cancelled":
            code = self._process.exitcode
            outcome = Outcome("failed", problem=f"the work ended with exit code {code}; is there memory enough?")
        self._connection.close()
        self._on_end(outcome)

    def _end(self, patience: float) -> None:
        self._process.join(patience)
        if self._process.exitcode is None:
            self._process.kill()
            self._process.join(_GOODBYE)


def time_left(part: float, since: float) -> str:
    """Text of the likely remaining time after `since` in s.

    >>> time_left(0.01, 3), time_left(0.25, 11), time_left(0.5, 130), time_left(1.0, 130)
    ('', 'about 35 s left', 'about 2 min left', '')
    """
    if not _FIRST_PART < part < 1:
        return ""
    seconds = since * (1 - part) / part
    if seconds < _SOME_MINUTES:
        return f"about {max(5, 5 * round(seconds / 5))} s left"
    return f"about {round(seconds / 60)} min left"


def _serve(connection: Connection, task: bytes, patience: float) -> None:
    collect_seldom()

    def leave(number: int, _: object) -> None:
        raise SystemExit(128 + number)

    if hasattr(signal, "SIGTERM"):
        signal.signal(signal.SIGTERM, leave)
    link = Link(connection)
    threading.Thread(target=link.listen, args=(patience,), daemon=True).start()
    try:
        function, arguments = pickle.loads(task)
        outcome = Outcome("done", function(*arguments, link))
    except (Cancelled, SystemExit, KeyboardInterrupt):
        outcome = Outcome("cancelled")
    except CoilarrayError as error:
        outcome = Outcome("failed", problem=str(error))
    except Exception as error:
        traceback.print_exc()
        outcome = Outcome("failed", problem=f"{type(error).__name__}: {error}")
    link.pass_on("end", outcome)
    connection.close()


@dataclass(frozen=True, eq=False)
class Step:
    """Single computation."""

    name: str  # a new request replaces a waiting request of the same name
    compute: Callable[[], Any]  # runs in a thread
    show: Callable[[Any], None]  # runs on the page
    fail: Callable[[str], None]  # runs on the page with one line of text
    rest: float = 0.0  # s without a new request before it begins


class Calculator:
    """Computes the steps of a page one after the other, with a `flush` of its state after each."""

    def __init__(self, threads: Executor, flush: Callable[[], object] = lambda: None) -> None:
        self._threads, self._flush = threads, flush
        self._todo: dict[str, Step] = {}
        self._asked = 0.0
        self._wake = asyncio.Event()
        self._task: asyncio.Task[None] | None = None
        self._closed = False

    def ask(self, steps: Sequence[Step]) -> None:
        """Request steps in their order, none after `close`."""
        if self._closed:
            return
        new = {step.name: step for step in steps}
        self._todo = new | {name: step for name, step in self._todo.items() if name not in new}
        self._asked = time.monotonic()
        self._wake.set()
        if self.idle:
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
        while self._todo:
            step = min(self._todo.values(), key=lambda one: one.rest)  # the first of them
            wait = self._asked + step.rest - time.monotonic()
            if wait > 0:
                self._wake.clear()
                with contextlib.suppress(TimeoutError):
                    await asyncio.wait_for(self._wake.wait(), wait)
                continue
            del self._todo[step.name]
            try:
                step.show(await asyncio.get_running_loop().run_in_executor(self._threads, step.compute))
            except CoilarrayError as error:
                step.fail(str(error))
            except Exception as error:
                traceback.print_exc()
                step.fail(f"{type(error).__name__}: {error}")
            self._flush()
