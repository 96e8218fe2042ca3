"""Computations of a page in a thread, step by step.

The newest request is computed, quick steps first.
"""

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
    """Single computation."""

    name: str  # a new request replaces a waiting request of the same name
    compute: Callable[[], Any]  # runs in a thread
    show: Callable[[Any], None]  # runs on the page
    fail: Callable[[str], None]  # runs on the page with one line of text
    rest: float = 0.0  # s without a new request before it begins
    patience: float = 3600.0  # s after which it goes first and without rest, although new requests keep coming


class Calculator:
    """Computes the steps of a page one after the other.

    They run in an executor.
    """

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

        Requests of the same names that have not begun are replaced. Nothing is done after `close`, because a job of a
        page may end later than its computations.
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
        """Choose the next step.

        The time in s before it may begin is returned too.
        """
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
