"""Tasks on a Dask cluster, in the only module that imports ``distributed``."""

from __future__ import annotations

import asyncio
import logging
import pickle
import time
from collections.abc import Iterator
from concurrent.futures import CancelledError, Future, ThreadPoolExecutor
from contextlib import closing, contextmanager, suppress
from typing import Any

from coilarray.compute.code_version import code_version
from coilarray.compute.extras import import_extra
from coilarray.compute.workers.pool import IN_FLIGHT, Pool, Task, one_thread_for_good, outcome_of
from coilarray.errors import ClusterError

Client = Any
"""A ``distributed.Client``. Its package is optional, and has no types."""
ANSWER_WITHIN = 10.0
"""Time in s within which a scheduler must answer and have a worker."""
_ALONE = 60.0  # s without any worker after which a run ends; a nanny restarts a worker within a few seconds
_CHECK = 1.0  # s between counts of the workers


@contextmanager
def cluster_pool(address: str) -> Iterator[ClusterPool]:
    """Open a pool of a Dask scheduler's workers.

    It is a context manager, and raises the errors of `connect`.
    """
    _distributed()  # its logs exist from now on
    with _quiet(), closing(ClusterPool(connect(address))) as pool:
        yield pool


def connect(address: str) -> Client:
    """Connect to a Dask scheduler with at least one worker.

    The address is ``tcp://host:port``, or ``tls://host:port`` with the certificates of Dask's configuration. All
    workers must have this version of coilarray. Raises ClusterError for an address of another form, no scheduler that
    answers within `ANSWER_WITHIN`, no worker, or a worker without coilarray or with another version of it, and
    MissingDependencyError without the package ``distributed``.
    """
    dask = _distributed()
    scheme, _, host = address.partition("://")
    name, _, port = host.rpartition(":")
    if scheme not in ("tcp", "tls") or not name or not port.isdecimal() or not 0 < int(port) < 65536:
        raise ClusterError(f"the address of a cluster must be tcp://HOST:PORT; got {address!r}.")
    # a Client alone waits forever for a server that accepts a connection and does not answer
    try:
        with ThreadPoolExecutor(1) as thread:  # a notebook's own thread runs an event loop already
            found = thread.submit(asyncio.run, _identity(address)).result()
    except Exception as error:  # any error from the answer of an unknown server
        reason = "" if isinstance(error, OSError) else f" ({type(error).__name__})"
        raise ClusterError(f"no Dask scheduler answers at {address} within {ANSWER_WITHIN:g} s{reason}.") from None
    if found != "Scheduler":
        raise ClusterError(f"at {address} answers no Dask scheduler but a {found}.")
    try:
        client = dask.Client(address, timeout=ANSWER_WITHIN, set_as_default=False, name="coilarray")
    except OSError as error:
        raise ClusterError(f"cannot connect to the Dask scheduler at {address}: {error}") from None
    try:
        if not client.nthreads():
            client.wait_for_workers(1, timeout=ANSWER_WITHIN)
        _check_versions(client)
    except TimeoutError:
        client.close()
        raise ClusterError(f"the Dask scheduler at {address} has no worker; start one: dask worker {address}") from None
    except BaseException:
        client.close()
        raise
    return client


class ClusterPool(Pool):
    """Workers of a Dask scheduler.

    Tasks of a lost worker are computed again by others. `close` closes the `client`, which `connect` makes, and leaves
    the cluster unchanged.
    """

    def __init__(self, client: Client) -> None:
        super().__init__()
        self._client, self._executor = client, client.get_executor(pure=False)
        self._threads = 1
        self._alone_since: float | None = None
        self._check()

    @property
    def capacity(self) -> int:
        """Number of tasks that may be in flight at once.

        It follows workers that come and go.
        """
        if time.monotonic() - self._checked > _CHECK:
            self._check()
        return IN_FLIGHT * self._threads

    def drop(self) -> None:
        """Forget all tasks in flight, as in `Pool.drop`."""
        super().drop()
        with suppress(Exception):  # a lost scheduler has forgotten the tasks
            self._executor.shutdown(wait=False)
        self._executor = self._client.get_executor(pure=False)

    def close(self) -> None:
        """Close the connection, as in `Pool.close`."""
        self.drop()
        with suppress(Exception):  # of a lost scheduler
            self._client.close(timeout=2)

    def _start(self, task: Task) -> Future[Any]:
        future: Future[Any] = self._executor.submit(compute, code_version(), pickle.dumps((task.function, task.item)))
        return future

    def _check(self) -> None:
        """Count the workers' threads.

        A run continues without any workers, but only for a limited time.
        """
        try:
            if self._client.status != "running":
                raise OSError(self._client.status)
            threads = sum(self._client.nthreads().values())
        except Exception as error:  # comm errors, timeouts and cancellations have no common base
            raise ClusterError(f"the Dask scheduler is lost ({type(error).__name__}).") from None
        self._checked = time.monotonic()
        if threads:
            self._threads, self._alone_since = threads, None
        elif self._alone_since is None:
            self._alone_since = self._checked
        elif self._checked - self._alone_since > _ALONE:
            raise ClusterError(f"all workers of the cluster are lost, and none came back within {_ALONE:g} s.")

    def _next(self) -> Future[Any] | None:
        future = super()._next()
        if future is None:
            self._check()
        return future

    def _result(self, future: Future[Any]) -> Any:
        """Return the outcome of a task, or raise ClusterError."""
        try:
            return future.result()
        except _distributed().KilledWorker:
            raise ClusterError(
                "a task ended several workers of the cluster, one after another; do they have enough memory?"
            ) from None
        except ModuleNotFoundError as error:
            if (error.name or "").partition(".")[0] != "coilarray":
                raise
            raise ClusterError("a worker of the cluster has no coilarray, or another version.") from None
        except CancelledError:
            self._check()
            raise ClusterError("the Dask scheduler is lost, or it has cancelled a task.") from None


def compute(version: str, payload: bytes) -> Any:
    """Compute one task on a worker.

    The worker must have the caller's version of coilarray.
    """
    if version != code_version():
        raise ClusterError(_differs("a worker", code_version(), version))
    one_thread_for_good()
    function, item = pickle.loads(payload)
    return outcome_of(function, item)


def _distributed() -> Any:
    return import_extra("distributed", "Dask clusters", package="distributed", extra="cluster")


async def _identity(address: str) -> str:
    """Ask for the identity of the server at an address.

    Raises TimeoutError if there is no answer.
    """
    dask = _distributed()
    security = dask.Security().get_connection_args("client")
    async with dask.rpc(address, timeout=ANSWER_WITHIN, connection_args=security) as server:
        return str((await asyncio.wait_for(server.identity(), ANSWER_WITHIN))["type"])


def _check_versions(client: Client) -> None:
    """Refuse workers with another coilarray before the first task.

    `compute` checks workers that join later.
    """
    for worker, version in client.run(_version, on_error="return").items():
        if version != code_version():
            raise ClusterError(_differs(f"the worker {worker}", version, code_version()))


def _version() -> str:
    """Return the version of coilarray on this machine.

    It is a function of this module, so that every worker calls its own.
    """
    return code_version()


def _differs(where: str, found: object, wanted: str) -> str:
    """Describe a different version of coilarray at a place.

    `found` may be the error of a worker without coilarray.
    """
    has = f"coilarray {found}" if isinstance(found, str) else f"no coilarray that can be loaded ({found})"
    return f"{where} has {has}; here it is {wanted}: install the same on all machines."


@contextmanager
def _quiet() -> Iterator[None]:
    """Keep Dask's log off the terminal while the block runs.

    Important messages are raised as ClusterError.
    """
    names = [name for name in logging.root.manager.loggerDict if name.partition(".")[0] == "distributed"]
    levels = {name: logging.getLogger(name).level for name in names}
    for name in names:
        logging.getLogger(name).setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        for name, level in levels.items():
            logging.getLogger(name).setLevel(level)
