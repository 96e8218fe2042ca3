"""What tests give to workers and jobs: functions of a module, which other processes can import."""

import os
import signal
import time
from pathlib import Path

from threadpoolctl import threadpool_info

from coilarray.compute.threads import cores
from coilarray.errors import GeometryError, GoalError, MissingDependencyError
from support.patience import until


def square(x):
    return x * x


def nap(seconds):
    """Sleep; return the process."""
    time.sleep(seconds)
    return os.getpid()


def meet(place):
    """Wait until a number of processes are in a folder, each with this task; return the process."""
    folder, count = place
    Path(folder, str(os.getpid())).touch()
    until(lambda: len(list(Path(folder).iterdir())) >= count)
    return os.getpid()


def refuse_odd(x):
    if x % 2:
        raise GoalError(f"{x} is odd.")
    return {"half": x / 2}


def divide(x):
    return 1 / x


def lack(x):
    raise MissingDependencyError("install it.")


def die_once(item):
    """End the process as the kernel does where memory is short, the first time that the marker is not there."""
    number, marker = item
    if marker is not None and not Path(marker).exists():
        Path(marker).touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return number


def die(x):
    os.kill(os.getpid(), signal.SIGKILL)


def threads(_):
    """Threads of every linear algebra library in this process, and what our own work goes by."""
    counts = [library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas"]
    return counts, os.environ.get("COILARRAY_THREADS"), cores()


def count_to(item, link):
    for k in range(item):
        link(k + 1, item)
    return item * item


def fail(item, link):
    if item == "ours":
        raise GeometryError("the coil must be round; got a square.")
    if item == "gone":
        os._exit(7)
    raise ZeroDivisionError("nothing to divide")


def wait_for_the_word(item, link):
    link.send(os.getpid())
    while "q" not in link.orders():
        time.sleep(0.05)
    Path(item).write_text("at rest", encoding="utf-8")


def never_listen(item, link):
    link.send(os.getpid())
    while True:
        time.sleep(1.0)


def tell_on_and_on(item, link):
    while True:
        link.send(os.getpid())
        time.sleep(0.05)
