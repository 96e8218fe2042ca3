"""Run independent tasks in this process, in local processes, or on a Dask cluster: one interface for all three.

More than one machine
---------------------
Any scheduler and workers of dask.distributed do, started as its own documentation says
(https://docs.dask.org/en/stable/deploying-cli.html), with the same version of coilarray on every machine::

    dask scheduler --port 8786                                           # on one machine
    dask worker tcp://host:8786 --nworkers -1 --nthreads 1               # on every machine that computes
    coilarray sweep gast2020 --vary array.pitch_mm=10:15:11 --cluster tcp://host:8786

The connection carries pickled Python and is neither encrypted nor authenticated by default: use it on a network that
you trust, or set up TLS as Dask says and give ``tls://``. The machine that gives the tasks out keeps the cache; the
workers need no shared folder.

Memory
------
Every worker has at most two tasks in flight: one that it computes, one that waits. A task sent is a few kB, a result
a few numbers, so this process needs no more for many tasks than for few. A worker needs about 0.3 GB for coupling, and
up to 1 GB for responses: give ``dask worker`` no less with ``--memory-limit``.
"""

from __future__ import annotations

from coilarray.workers.pool import IN_FLIGHT, Pool
from coilarray.workers.start import MOST_WORKERS, default_count, workers

__all__ = ["IN_FLIGHT", "MOST_WORKERS", "Pool", "default_count", "workers"]
