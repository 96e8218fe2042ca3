"""What every pool of workers does, and the simplest one: this process."""

from __future__ import annotations

import os
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import Any, TypeVar

from coilarray.errors import ClusterError, CoilarrayError, MissingDependencyError

Item = TypeVar("Item")
Result = TypeVar("Result")

IN_FLIGHT = 2
"""Tasks that one worker has at most: one that it computes and one that waits, so that it is never idle."""
# read by the linear algebra when it is loaded, and by coilarray.compute.threads
_THREAD_VARIABLES = ("COILARRAY_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")


class Pool(ABC):
    """Something that runs tasks; `workers` makes one.

    `run` is all that most callers need. `submit` and `collect` are for a caller that decides on the next task when it
    knows earlier results.
    """

    @property
    @abstractmethod
    def capacity(self) -> int:
        """Tasks that may be in flight at once."""

    @property
    @abstractmethod
    def in_flight(self) -> int:
        """Tasks submitted and not yet collected."""

    @abstractmethod
    def submit(self, tag: int, function: Callable[[Any], Any], item: Any) -> None:
        """Give out one task; `tag` names it when it is collected."""

    @abstractmethod
    def collect(self) -> tuple[int, Any]:
        """Wait for a task in flight, and return its tag and outcome as `run` does."""

    @abstractmethod
    def drop(self) -> None:
        """Forget all tasks in flight."""

    @abstractmethod
    def close(self) -> None:
        """End processes and connections, at once."""

    @property
    def full(self) -> bool:
        """Whether a task must be collected before the next one is submitted."""
        return self.in_flight >= self.capacity

    def run(self, function: Callable[[Item], Result], items: Iterable[Item]) -> Iterator[tuple[int, Result | str]]:
        """Apply a function to every item; outcomes come as they are ready.

        Parameters
        ----------
        function : callable
            Defined in a module, so that other processes find it; it takes one item and returns no text. Items and
            results travel pickled.
        items : iterable
            Read as there is room, `IN_FLIGHT` a worker ahead.

        Yields
        ------
        index : int
            Of the item, from 0.
        outcome : object
            What the function returned, or the one line of the CoilarrayError that it raised.

        Raises
        ------
        ClusterError
            Lost workers: a task whose process ended three times, a scheduler or all workers gone.
        Exception
            Any other error of the function.
        """
        todo = enumerate(items)
        try:
            while True:
                while self.full:
                    yield self.collect()
                following = next(todo, None)
                if following is None:
                    break
                self.submit(following[0], function, following[1])
            while self.in_flight:
                yield self.collect()
        finally:
            self.drop()


class InProcess(Pool):
    """Computes a task when it is collected."""

    capacity = 1

    def __init__(self) -> None:
        self._tasks: deque[tuple[int, Callable[[Any], Any], Any]] = deque()

    @property
    def in_flight(self) -> int:
        """See `Pool.in_flight`."""
        return len(self._tasks)

    def submit(self, tag: int, function: Callable[[Any], Any], item: Any) -> None:
        """See `Pool.submit`."""
        self._tasks.append((tag, function, item))

    def collect(self) -> tuple[int, Any]:
        """See `Pool.collect`."""
        tag, function, item = self._tasks.popleft()
        return tag, outcome_of(function, item)

    def drop(self) -> None:
        """See `Pool.drop`."""
        self._tasks.clear()

    def close(self) -> None:
        """See `Pool.close`."""
        self.drop()


def outcome_of(function: Callable[[Any], Any], item: Any) -> Any:
    """Return what a function returns, or the line of its CoilarrayError; a library that is missing is an error."""
    try:
        return function(item)
    except (ClusterError, MissingDependencyError):
        raise
    except CoilarrayError as error:
        return str(error)


@contextmanager
def one_thread() -> Iterator[None]:
    """Compute with one thread while the block runs: the linear algebra and the blocks of our own work."""
    from coilarray.compute.threads import serial_algebra

    before = {name: os.environ.get(name) for name in _THREAD_VARIABLES}
    os.environ.update(dict.fromkeys(_THREAD_VARIABLES, "1"))
    import scipy.linalg  # noqa: F401 - loads every library there is to limit

    try:
        with serial_algebra():
            yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
