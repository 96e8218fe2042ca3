"""Run independent tasks in this process, in local processes, or on a Dask cluster, with one interface for all three.

More than one machine
---------------------
Any scheduler and workers of dask.distributed can be used. They are started as in its documentation
(https://docs.dask.org/en/stable/deploying-cli.html), with the same coilarray and its extra ``cluster`` installed on
every machine::

    dask scheduler --port 8786                                   # on one machine
    dask worker tcp://host:8786 --nworkers -1 --nthreads 1       # on every machine that computes: one worker a core
    coilarray sweep gast2020 --vary array.pitch_mm=10:15:11 --quantity worst_k --cluster tcp://host:8786

Workers may come and go while a sweep runs. Only the machine that distributes the tasks keeps the store of points. The
others need no shared folder, and each keeps its own compiled kernels. The connection carries pickled Python and is
neither encrypted nor authenticated by default. Use it on a network that you trust, or set up TLS as in Dask's
documentation and give ``tls://``.

Memory
------
A worker has at most two tasks in flight, one that it computes and one that waits. A task is a few kB, a design file and
some names, and its result is some numbers, so memory does not grow with the number of points. For the six coils of
gast2020 a worker needs 0.25 GB for shapes and couplings, 0.3 GB for the circuit, 0.4 GB for responses and 0.5 GB for
the error of positions. A worker of Dask needs 0.1 GB more. Dask ends a worker that exceeds its ``--memory-limit``, by
default its share of the machine.
"""

from __future__ import annotations

from coilarray.compute.workers.pool import IN_FLIGHT, MOST_WORKERS, Pool, default_count, workers

__all__ = ["IN_FLIGHT", "MOST_WORKERS", "Pool", "default_count", "workers"]
