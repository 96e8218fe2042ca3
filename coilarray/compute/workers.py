"""Executors for independent tasks, from processes to a cluster.

Studies take a number of local processes or any `concurrent.futures.Executor`, such as
``Client.get_executor()`` of Dask or the executor of mpi4py. Results agree to the last bit on
machines of one kind, and to rounding elsewhere.
"""

import logging
import os
import pickle
import signal
import sys
import time
import uuid
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    CancelledError,
    Executor,
    Future,
    ProcessPoolExecutor,
    ThreadPoolExecutor,
    wait,
)
from contextlib import ExitStack, contextmanager, nullcontext, suppress
from functools import cache
from multiprocessing import get_context, parent_process, resource_tracker
from threading import Thread, current_thread, main_thread
from typing import Any

from coilarray.compute.extras import import_extra
from coilarray.compute.memory import collect_seldom
from coilarray.compute.store import code_version
from coilarray.compute.threads import serial_algebra
from coilarray.errors import ClusterError, CoilarrayError, MissingDependencyError

MOST_WORKERS = 1024
"""Largest number of local processes."""
ANSWER_WITHIN = 10.0
"""Time in s within which a scheduler must answer and have a worker."""
_IN_FLIGHT = 2  # tasks for each worker: the task that it computes and a task that waits
_MANY_IN_FLIGHT = 1000  # the same for all workers, if their number is unknown
_LOOK = 1.0  # s between looks at a cluster
_ALONE = 60.0  # s without any worker after which a run ends. A nanny restarts a worker within a few seconds
# read by the linear algebra when it is loaded, and by coilarray.compute.threads
_THREAD_VARIABLES = ("COILARRAY_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")
_LIMITS = ExitStack()  # keeps a worker's limit of threads for as long as its process lives
_HERE = uuid.uuid4().hex  # differs on every machine


@contextmanager
def open_executor(workers: int | Executor = 1) -> Iterator[Executor]:
    """Open an executor for a ``with`` block.

    Local processes end with the block, and a given executor stays open. With 1 the tasks are
    computed here when they are submitted. Local processes load the calling script, which must open
    the executor under ``if __name__ == "__main__":``.
    """
    if isinstance(workers, Executor):
        with one_thread() if isinstance(workers, ThreadPoolExecutor) else nullcontext():
            yield workers
        return
    if isinstance(workers, bool) or not isinstance(workers, int) or not 1 <= workers <= MOST_WORKERS:
        raise ClusterError(f"the number of workers must be 1 to {MOST_WORKERS}; got {workers!r}.")
    if workers == 1:
        with one_thread():
            yield _ThisProcess()
        return
    processes = _Processes(workers)
    try:
        yield processes
    finally:
        processes.end()


@contextmanager
def dask_executor(address: str) -> Iterator[Executor]:
    """Connect to a Dask scheduler at ``tcp://host:port``.

    With ``tls://`` the certificates of Dask's configuration are used. ClusterError is raised if no
    scheduler or no worker answers within `ANSWER_WITHIN`.
    """
    dask = import_extra("distributed", "Dask clusters", package="distributed", extra="cluster")
    scheme, _, host = address.partition("://")
    name, _, port = host.rpartition(":")
    if scheme not in ("tcp", "tls") or not name or not port.isdecimal() or not 0 < int(port) < 65536:
        raise ClusterError(f"the address of a cluster must be tcp://HOST:PORT; got {address!r}.")
    with _quiet():
        try:
            client = dask.Client(address, timeout=ANSWER_WITHIN, set_as_default=False, name="coilarray")
        except OSError:
            raise ClusterError(f"no Dask scheduler answers at {address} within {ANSWER_WITHIN:g} s.") from None
        try:
            try:
                client.wait_for_workers(1, timeout=ANSWER_WITHIN)
            except TimeoutError:
                line = f"the Dask scheduler at {address} has no worker; start one: dask worker {address}"
                raise ClusterError(line) from None
            yield client.get_executor(pure=False)
        finally:
            with suppress(Exception):  # of a lost scheduler
                client.close(timeout=2)


def outcomes(executor: Executor, function: Callable[[Any], Any], items: Iterable[Any]) -> Iterator[tuple[int, Any]]:
    """Yield every item's number and outcome when it is done.

    An outcome is the result of the function, which is no text, or the line of its CoilarrayError.
    Items are read as workers become free. Tasks that have not begun are cancelled on closing.
    """
    todo = enumerate(items)
    pending: dict[Future[Any], int] = {}
    here, client = isinstance(executor, _ThisProcess), getattr(executor, "_client", None)
    count = getattr(executor, "_max_workers", None)
    # here an item is read when all items before it are done
    most = 1 if here else _MANY_IN_FLIGHT if count is None else _IN_FLIGHT * count
    alone_since: float | None = None
    try:
        while True:
            while len(pending) < most and (following := next(todo, None)) is not None:
                number, item = following
                try:
                    task = (
                        executor.submit(_outcome, function, item)
                        if here
                        else executor.submit(_perform, pickle.dumps((function, item)), code_version(), _this_process())
                    )
                except BrokenExecutor:
                    raise _lost() from None
                pending[task] = number
            if not pending:
                return
            done, _ = wait(pending, timeout=_LOOK, return_when=FIRST_COMPLETED)
            if client is not None and not done:
                alone_since = None if _workers_of(client) else alone_since or time.monotonic()
                if alone_since is not None and time.monotonic() - alone_since > _ALONE:
                    raise ClusterError(f"all workers of the cluster are lost, and none came back within {_ALONE:g} s.")
            for future in sorted(done, key=pending.__getitem__):
                yield pending.pop(future), _result(future)
    finally:
        for future in pending:
            future.cancel()


def _this_process() -> str:
    """Identify this process on all machines, forked or not."""
    return f"{_HERE} {os.getpid()}"


def _perform(payload: bytes, version: str, home: str) -> Any:
    """Compute one task with one thread and the same version."""
    if home != _this_process():
        if version != code_version():
            raise ClusterError(
                f"a worker has coilarray {code_version()}; here it is {version}: install the same on all machines."
            )
        _one_thread_for_good()
    return _outcome(*pickle.loads(payload))


def _outcome(function: Callable[[Any], Any], item: Any) -> Any:
    try:
        return function(item)
    except (ClusterError, MissingDependencyError):
        raise
    except CoilarrayError as error:
        return str(error)


def _result(future: Future[Any]) -> Any:
    try:
        return future.result()
    except BrokenExecutor:
        raise _lost() from None
    except CancelledError:
        raise ClusterError("the Dask scheduler is lost, or a task was cancelled.") from None
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] != "coilarray":
            raise
        raise ClusterError("a worker has no coilarray, or another version: install the same on all machines.") from None
    except Exception as error:
        if type(error).__name__ != "KilledWorker":  # of Dask, which may be absent
            raise
        raise ClusterError("a task ended several workers, one after another; do they have enough memory?") from None


def _lost() -> ClusterError:
    return ClusterError(
        "a worker process has ended; is there enough memory? A script must ask for workers under "
        'if __name__ == "__main__".'
    )


def _workers_of(client: Any) -> int:
    """Count the workers of Dask's scheduler, or raise ClusterError."""
    try:
        if client.status != "running":
            raise OSError(client.status)
        return len(client.nthreads())
    except Exception as error:  # comm errors, timeouts and cancellations have no common base
        raise ClusterError(f"the Dask scheduler is lost ({type(error).__name__}).") from None


class _ThisProcess(Executor):
    """Executor that computes each task when it is submitted."""

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        future: Future[Any] = Future()
        try:
            future.set_result(fn(*args, **kwargs))
        except Exception as error:
            future.set_exception(error)
        return future


class _Processes(ProcessPoolExecutor):
    """Local processes, each started when there is work for it."""

    def __init__(self, count: int) -> None:
        count = min(count, 61) if sys.platform == "win32" else count  # which waits for no more at once
        with starting():  # the tracker of shared resources is a process too
            super().__init__(count, mp_context=get_context("spawn"), initializer=_begin)  # OpenMP kills forked children

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        with starting():
            return super().submit(fn, *args, **kwargs)

    def end(self) -> None:
        """End all processes, as `kill_workers` from Python 3.14 on."""
        processes = list((self._processes or {}).values())
        self.shutdown(wait=False, cancel_futures=True)
        for process in processes:
            process.kill()
        for process in processes:
            process.join()


def _begin() -> None:
    """Prepare a local process, which ends with its parent."""
    collect_seldom()
    parent = parent_process()

    def end() -> None:
        if parent is not None:
            parent.join()
            os._exit(0)

    Thread(target=end, daemon=True).start()


@contextmanager
def starting() -> Iterator[None]:
    """Start processes safely within a ``with`` block.

    They never get Ctrl-C, during which Python's tracker silently clears semaphores, and never import a
    file of the working folder, in which Python looks for multiprocessing first.
    """
    ignored = [os.environ["PYTHONWARNINGS"]] if os.environ.get("PYTHONWARNINGS") else []
    wanted = {"PYTHONSAFEPATH": "1", "PYTHONWARNINGS": ",".join([*ignored, "ignore:resource_tracker"])}
    with _environment(wanted), _no_interrupt():
        yield


@contextmanager
def _no_interrupt() -> Iterator[None]:
    """Delay Ctrl-C, which new processes in the block never get."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    resource_tracker.ensure_running()  # otherwise it starts with the first process, and unblocks the signal for it
    came: list[int] = []
    # Another thread may take the signal, but only the main thread runs Python's handler.
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


@contextmanager
def one_thread() -> Iterator[None]:
    """Compute with one thread while the block runs."""
    with _environment(dict.fromkeys(_THREAD_VARIABLES, "1")):
        import scipy.linalg  # noqa: F401 - loads every library there is to limit

        with serial_algebra():
            yield


@cache
def _one_thread_for_good() -> None:
    _LIMITS.enter_context(one_thread())


@contextmanager
def _environment(wanted: dict[str, str]) -> Iterator[None]:
    """Set variables of the environment while the block runs."""
    before = {name: os.environ.get(name) for name in wanted}
    os.environ.update(wanted)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


@contextmanager
def _quiet() -> Iterator[None]:
    """Keep Dask's log off the terminal while the block runs."""
    names = [name for name in logging.root.manager.loggerDict if name.partition(".")[0] == "distributed"]
    levels = {name: logging.getLogger(name).level for name in names}
    for name in names:
        logging.getLogger(name).setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        for name, level in levels.items():
            logging.getLogger(name).setLevel(level)
