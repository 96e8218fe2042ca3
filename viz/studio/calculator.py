"""What follows from a design, step by step beside the page: always of the newest wish, the quick steps first."""

from __future__ import annotations

import asyncio
import contextlib
import traceback
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from typing import Any

from coilarray.errors import CoilarrayError


@dataclass(frozen=True, eq=False)
class Step:
    """One thing to be computed.

    Parameters
    ----------
    name : str
        What it is; a new wish of the same name replaces one that has not begun.
    compute : callable
        Run in a thread; takes nothing.
    show : callable
        Run on the page with the result.
    fail : callable
        Run on the page with one line where it cannot be computed.
    rest : float
        Time in s without a new wish that it waits for.
    patience : float
        Time in s after which it is done before others, although new wishes keep coming.
    """

    name: str
    compute: Callable[[], Any]
    show: Callable[[Any], None]
    fail: Callable[[str], None]
    rest: float = 0.0
    patience: float = 3600.0


class Calculator:
    """Does the steps of one page, one after the other.

    Parameters
    ----------
    threads : Executor
        Where steps are computed.
    """

    def __init__(self, threads: Executor) -> None:
        self._threads = threads
        self._todo: dict[str, Step] = {}
        self._asked = 0.0
        self._waiting: dict[str, float] = {}  # since when
        self._wake = asyncio.Event()
        self._task: asyncio.Task[None] | None = None

    def ask(self, steps: Sequence[Step]) -> None:
        """Wish for steps, in the order in which they are to be done; what was wished for and not begun is replaced."""
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
        """Whether there is nothing left to do."""
        return self._task is None or self._task.done()

    def close(self) -> None:
        """Do nothing more."""
        self._todo.clear()
        if self._task is not None:
            self._task.cancel()

    async def _run(self) -> None:
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
        """Return the step to be done next, and how long to wait before looking again."""
        now = self._now()
        late = [one for one in self._todo.values() if now - self._waiting[one.name] > one.patience]
        for step in (*late, *self._todo.values()):
            wait = self._asked + step.rest - now
            if wait <= 0:
                return step, 0.0
        step = min(self._todo.values(), key=lambda one: one.rest)
        return step, self._asked + step.rest - now

    async def _do(self, step: Step) -> None:
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
