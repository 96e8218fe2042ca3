"""Run independent tasks in this process, in local processes, or on a Dask cluster: one interface for all three.

More than one machine
---------------------
Any scheduler and workers of dask.distributed do, started as its own documentation says
(https://docs.dask.org/en/stable/deploying-cli.html), with the same coilarray installed on every machine, by
``pip install 'coilarray[cluster]'``::

    dask scheduler --port 8786                                   # on one machine
    dask worker tcp://host:8786 --nworkers -1 --nthreads 1       # on every machine that computes: one worker a core
    coilarray sweep gast2020 --vary array.pitch_mm=10:15:11 --quantity worst_k --cluster tcp://host:8786

Workers may come and go while a sweep runs. The machine that gives the tasks out keeps the cache of points; the others
need no shared folder, and each keeps its own compiled kernels. The connection carries pickled Python and is neither
encrypted nor authenticated by default: use it on a network that you trust, or set up TLS as Dask says and give
``tls://``.

Memory
------
A worker has at most two tasks in flight, one that it computes and one that waits; a task is a design file and some
names, a few kB, and its result some numbers. So this process needs no more for many points than for few. For the six
coils of gast2020 a worker needs 0.25 GB for shapes and couplings, 0.3 GB for the circuit, 0.4 GB for responses and
0.5 GB for the error of positions, a worker of Dask 0.1 GB more. It does not grow with the number of points. Dask ends a
worker that exceeds its ``--memory-limit``, by default its share of the machine. Blocks of field volumes and of large
matrices (`coilarray.circuit.field_volume`, `coilarray.electromagnetics.large_matrix`) come back with 13 MB and 0.5 MB;
they go to the file as they come.
"""

from __future__ import annotations

from coilarray.compute.workers.pool import IN_FLIGHT, Pool
from coilarray.compute.workers.start import MOST_WORKERS, default_count, workers

__all__ = ["IN_FLIGHT", "MOST_WORKERS", "Pool", "default_count", "workers"]
