"""Tasks in processes of this machine."""

from __future__ import annotations

import os
import pickle
import signal
import sys
import traceback
from collections.abc import Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing import get_all_start_methods, get_context, parent_process, resource_tracker
from multiprocessing.context import BaseContext
from threading import Thread, current_thread, main_thread
from typing import Any

from coilarray.compute.memory import collect_seldom
from coilarray.compute.workers.pool import IN_FLIGHT, Pool, Task, one_thread_for_good, outcome_of
from coilarray.errors import ClusterError

_TRIES = 3  # of a task whose process ends


class _Worker:
    """Process with its own executor.

    Only its own tasks are lost with it.
    """

    def __init__(self) -> None:
        environment = dict(os.environ)
        with starting():  # the tracker of shared resources is a process too
            self._executor = ProcessPoolExecutor(1, mp_context=_context(), initializer=_begin, initargs=(environment,))
        self._process: Any = None
        self.pending: set[Future[Any]] = set()

    def submit(self, payload: bytes) -> Future[Any]:
        """Start a task.

        Raises BrokenProcessPool if the process has ended.
        """
        if self._process is None:
            with starting():  # an interrupt is for this process, which then ends the others
                future = self._executor.submit(_perform, payload)
                inside: Any = self._executor
                (self._process,) = inside._processes.values()
                inside._result_queue._writer.close()  # otherwise half a result of a lost process is read forever
        else:
            future = self._executor.submit(_perform, payload)
        self.pending.add(future)
        future.add_done_callback(self.pending.discard)
        return future

    def end(self) -> int:
        """End the process at once, and return its exit code."""
        if self._process is None:
            return 0
        self._process.kill()
        self._executor.shutdown()
        return self._process.exitcode or 0


class LocalPool(Pool):
    """Pool of up to `count` processes of this machine.

    They are started when there is work. A process that ends is replaced, and its tasks are sent again.
    """

    def __init__(self, count: int) -> None:
        super().__init__()
        self._count = count
        self._workers: list[_Worker] = []

    @property
    def capacity(self) -> int:
        """Number of tasks that may be in flight at once."""
        return IN_FLIGHT * self._count

    def close(self) -> None:
        """End all processes at once."""
        self.drop()
        for worker in self._workers:
            worker.end()
        self._workers.clear()

    def _start(self, task: Task) -> Future[Any]:
        """Send a task to the process with the fewest tasks."""
        payload = pickle.dumps((task.function, task.item))
        while True:
            if len(self._workers) < self._count and all(worker.pending for worker in self._workers):
                self._workers.append(_Worker())
            worker = min(self._workers, key=lambda worker: len(worker.pending))
            try:
                future = worker.submit(payload)
            except BrokenProcessPool:
                self._replace(worker)
            else:
                task.worker = worker
                return future

    def _restarted(self, future: Future[Any]) -> bool:
        lost = isinstance(future.exception(), BrokenProcessPool)
        if lost:
            self._replace(self._tasks[future].worker)
        return lost

    def _replace(self, worker: _Worker) -> None:
        """Replace a worker whose process has ended.

        Its tasks are sent again.
        """
        code = worker.end()
        self._workers.remove(worker)
        mine = [future for future, task in self._tasks.items() if task.worker is worker]
        lost = [self._tasks.pop(future) for future in mine if isinstance(future.exception(), BrokenProcessPool)]
        if lost:
            lost[0].losses += 1  # the task that it computed; the other only waited
            if lost[0].losses >= _TRIES:
                self.drop()
                script = 'a script must ask for workers under if __name__ == "__main__".'
                hint = "is there enough memory?" if code < 0 else script
                raise ClusterError(
                    f"a local process ended {_TRIES} times during the same task, with exit code {code}; {hint}"
                ) from None
        for task in lost:
            self._send(task)


def _context() -> BaseContext:
    """Context in which processes are started.

    They are forked from a server process that has loaded the same modules of the package and never computes. OpenMP
    kills the children of a process that has computed. Without such a server every process loads all modules by itself.
    """
    if "forkserver" not in get_all_start_methods():
        return get_context("spawn")
    context = get_context("forkserver")
    context.set_forkserver_preload([name for name in list(sys.modules) if name.startswith("coilarray.")])
    return context


@contextmanager
def starting() -> Iterator[None]:
    """Start processes safely within a ``with`` block.

    The processes never get Ctrl-C, and never import a file of the working folder as a module. Python searches the
    modules of multiprocessing itself in this folder first, and only then takes over this process's path. Its tracker
    silently clears the semaphores of a program that is interrupted while processes start.
    """
    ignored = [os.environ["PYTHONWARNINGS"]] if os.environ.get("PYTHONWARNINGS") else []
    wanted = {"PYTHONSAFEPATH": "1", "PYTHONWARNINGS": ",".join([*ignored, "ignore:resource_tracker"])}
    before = {name: os.environ.get(name) for name in wanted}
    os.environ.update(wanted)
    try:
        with _no_interrupt():
            yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


@contextmanager
def _no_interrupt() -> Iterator[None]:
    """Delay Ctrl-C while the block runs.

    A process that is started in the block never gets it.
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    resource_tracker.ensure_running()  # otherwise it starts with the first process, and unblocks the signal for it
    came: list[int] = []
    # another thread may take the signal in spite of the mask, but only the main thread runs Python's handler
    handler = signal.getsignal(signal.SIGINT)
    here = current_thread() is main_thread() and callable(handler)
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    if here:
        signal.signal(signal.SIGINT, lambda number, frame: came.append(number))
    try:
        yield
    finally:
        if here:
            signal.signal(signal.SIGINT, handler)
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
        if came:
            signal.raise_signal(signal.SIGINT)


def _begin(environment: dict[str, str]) -> None:
    """Prepare a worker process.

    It computes with one thread, and ends with the process that started it. `environment` is the environment of the
    starting process. The process from which it was forked may have an older environment.
    """
    os.environ.clear()
    os.environ.update(environment)
    collect_seldom()
    Thread(target=_end_with_parent, daemon=True).start()
    one_thread_for_good()


def _end_with_parent() -> None:
    parent = parent_process()
    if parent is not None:
        parent.join()
        os._exit(0)


def _perform(payload: bytes) -> Any:
    """Compute one task.

    Its error can be sent to the other process.
    """
    function, item = pickle.loads(payload)
    try:
        return outcome_of(function, item)
    except Exception as error:
        try:
            pickle.loads(pickle.dumps(error))
        except Exception:
            text = "".join(traceback.format_exception(error))
            raise RuntimeError(f"in a worker process:\n{text}") from None
        raise
