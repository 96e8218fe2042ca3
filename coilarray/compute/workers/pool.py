"""Base of all pools of workers, on an executor of `concurrent.futures`, and the simplest pool: this process."""

from __future__ import annotations

import os
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future
from contextlib import ExitStack, closing, contextmanager, suppress
from dataclasses import dataclass
from functools import cache
from queue import Empty, SimpleQueue
from typing import Any, TypeVar

from coilarray.compute.threads import cores, serial_algebra
from coilarray.errors import ClusterError, CoilarrayError, MissingDependencyError

Item = TypeVar("Item")
Result = TypeVar("Result")

IN_FLIGHT = 2
"""Largest number of tasks per worker: one that it computes and one that waits, so that it is never idle."""
_LOOK = 1.0  # s
MOST_WORKERS = 1024
"""Largest number of local processes."""
# read by the linear algebra when it is loaded, and by coilarray.compute.threads
_THREAD_VARIABLES = ("COILARRAY_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")
_LIMITS = ExitStack()  # keeps a worker's limit of threads for as long as its process lives


@dataclass(eq=False)
class Task:
    """Task in flight with function, argument and worker.

    It also has the caller's tag, and counts how often its worker was lost.
    """

    tag: int
    function: Callable[[Any], Any]
    item: Any
    worker: Any = None
    losses: int = 0


class Pool(ABC):
    """Pool of workers that runs tasks.

    It is made by `coilarray.compute.workers.workers`. Most callers need only `run`. `submit` and `collect` are for a
    caller that decides on the next task from earlier results.
    """

    def __init__(self) -> None:
        self._tasks: dict[Future[Any], Task] = {}
        self._done: SimpleQueue[Future[Any]] = SimpleQueue()

    @property
    @abstractmethod
    def capacity(self) -> int:
        """Number of tasks that may be in flight at once."""

    @abstractmethod
    def _start(self, task: Task) -> Future[Any]:
        """Give a task to an executor."""

    def _restarted(self, future: Future[Any]) -> bool:
        """Start a task again if its worker was lost.

        Otherwise return False.
        """
        return False

    def _result(self, future: Future[Any]) -> Any:
        """Return the outcome of a finished task."""
        return future.result()

    def _next(self) -> Future[Any] | None:
        """Wait for a finished task, but not long.

        If another thread takes an interrupt, it does not end the wait.
        """
        with suppress(Empty):
            return self._done.get(timeout=_LOOK)
        return None

    def close(self) -> None:
        """End processes and connections at once."""
        self.drop()

    @property
    def in_flight(self) -> int:
        """Number of tasks submitted and not yet collected."""
        return len(self._tasks)

    @property
    def full(self) -> bool:
        """Whether a task must be collected before the next."""
        return self.in_flight >= self.capacity

    def submit(self, tag: int, function: Callable[[Any], Any], item: Any) -> None:
        """Start a task, identified by `tag` when collected."""
        self._send(Task(tag, function, item))

    def collect(self) -> tuple[int, Any]:
        """Wait for a task, and return its tag and outcome.

        The outcome is as in `run`.
        """
        while self._tasks:
            future = self._next()
            if future in self._tasks and not self._restarted(future):  # otherwise nothing yet, or it was dropped
                return self._tasks.pop(future).tag, self._result(future)
        raise IndexError("no task is in flight.")

    def drop(self) -> None:
        """Forget all tasks in flight.

        Running computations continue, and their outcomes are discarded.
        """
        self._tasks.clear()

    def run(self, function: Callable[[Item], Result], items: Iterable[Item]) -> Iterator[tuple[int, Result | str]]:
        """Apply a function to every item.

        Outcomes come as they are ready.

        Parameters
        ----------
        function : callable
            Function of one item that returns no str. It must be defined in a module, so that other processes find it.
            Items and results are pickled.
        items : iterable
            Inputs of the tasks, read as workers become free, `IN_FLIGHT` for each worker ahead.

        Yields
        ------
        index : int
            Number of the item, from 0.
        outcome : object
            Result of the function, or the one line of the CoilarrayError that it raised.

        Raises
        ------
        ClusterError
            If a task's worker was lost three times, the scheduler was lost, or no worker is left.
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

    def _send(self, task: Task) -> None:
        future = self._start(task)
        self._tasks[future] = task
        future.add_done_callback(self._done.put)


class InProcess(Pool):
    """Pool that computes a task in this process when submitted."""

    capacity = 1

    def _start(self, task: Task) -> Future[Any]:
        """Compute a task, and return its finished future."""
        future: Future[Any] = Future()
        try:
            future.set_result(outcome_of(task.function, task.item))
        except Exception as error:
            future.set_exception(error)
        return future


def outcome_of(function: Callable[[Any], Any], item: Any) -> Any:
    """Return the result of a function, or its error line.

    The line is the message of a CoilarrayError. A missing library is raised as an error.
    """
    try:
        return function(item)
    except (ClusterError, MissingDependencyError):
        raise
    except CoilarrayError as error:
        return str(error)


@contextmanager
def one_thread() -> Iterator[None]:
    """Compute with one thread while the block runs.

    This covers the linear algebra and the blocks of `coilarray.compute.threads`.
    """
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


@cache
def one_thread_for_good() -> None:
    """Compute with one thread from now on.

    It is for a worker process.
    """
    _LIMITS.enter_context(one_thread())


@contextmanager
def workers(count: int = 1, cluster: str | None = None) -> Iterator[Pool]:
    """Open a pool of workers for a ``with`` block.

    The workers end with the block, however it is left. Every worker computes with one thread. Results do not depend on
    the kind or number of workers. They agree to the last bit on machines of one kind, and to rounding elsewhere.

    Parameters
    ----------
    count : int
        Number of local processes. With 1 the tasks are computed in this process. Local processes load the calling
        script, which must open the pool under ``if __name__ == "__main__":``.
    cluster : str, optional
        Address of a Dask scheduler, ``tcp://host:port``, whose workers are used instead.

    Yields
    ------
    Pool

    Raises
    ------
    ClusterError
        If the count is outside 1 to 1024, the address is wrong, no scheduler or worker answers within 10 s, or workers
        have another version of coilarray.
    MissingDependencyError
        If a cluster is requested and the package ``distributed`` is not installed.

    Examples
    --------
    >>> import math
    >>> with workers() as pool:
    ...     for index, root in pool.run(math.sqrt, [4.0, 9.0]):
    ...         print(index, root)
    0 2.0
    1 3.0
    """
    if isinstance(count, bool) or not isinstance(count, int) or not 1 <= count <= MOST_WORKERS:
        raise ClusterError(f"the number of workers must be 1 to {MOST_WORKERS}; got {count!r}.")
    if cluster is not None:
        from coilarray.compute.workers.cluster import cluster_pool

        with cluster_pool(cluster) as remote:
            yield remote
    elif count > 1:
        from coilarray.compute.workers.processes import LocalPool

        with closing(LocalPool(count)) as local:
            yield local
    else:
        with one_thread():
            yield InProcess()


def default_count() -> int:
    """Return the default number of local processes.

    There is one for each core that this process may use.
    """
    return min(cores(), MOST_WORKERS)
