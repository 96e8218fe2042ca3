"""Open a pool of workers of the kind that is asked for."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing, contextmanager

from coilarray.compute.threads import cores
from coilarray.compute.workers.pool import InProcess, Pool, one_thread
from coilarray.compute.workers.processes import LocalPool
from coilarray.errors import ClusterError

MOST_WORKERS = 1024
"""Local processes at most."""


@contextmanager
def workers(count: int = 1, cluster: str | None = None) -> Iterator[Pool]:
    """Open a pool of workers for the length of a ``with`` block; it ends with the block, however that is left.

    Every worker computes with one thread. Results do not depend on the kind or number of workers: not in the last bit
    on machines of one kind, and else but for rounding.

    Parameters
    ----------
    count : int
        Local processes; 1 computes in this process. They are started afresh ("spawn"): a script that asks for more
        than one must do so under ``if __name__ == "__main__":``.
    cluster : str, optional
        Address of a Dask scheduler, ``tcp://host:port``; its workers are used instead.

    Yields
    ------
    Pool

    Raises
    ------
    ClusterError
        A count that is not 1 to 1024; a wrong address; no scheduler or no worker that answers within 10 s; another
        version of coilarray there.
    MissingDependencyError
        A cluster without the package ``distributed``.

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
        with closing(LocalPool(count)) as local:
            yield local
    else:
        with one_thread():
            yield InProcess()


def default_count() -> int:
    """Return the number of local processes where none is asked for: one a core that this process may use."""
    return min(cores(), MOST_WORKERS)
