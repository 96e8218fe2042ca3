"""Split work into blocks and run them on threads.

Kernels release the interpreter's lock, so plain threads use every core. Numba's own threading
layers are not used, because they abort when two Python threads meet in one parallel kernel
(workqueue) or when a process forks (OpenMP). Meanwhile the linear algebra libraries get one thread
each, since our small matrices would only wait for each other.
"""

from __future__ import annotations

import os
import sys
import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_EXCEPTION, Future, ThreadPoolExecutor, wait
from contextlib import contextmanager
from functools import cache
from typing import TYPE_CHECKING, Generic, TypeVar

if TYPE_CHECKING:
    from threadpoolctl import ThreadpoolController

Item = TypeVar("Item")
Result = TypeVar("Result")
Progress = Callable[[int, int], None]
"""Called with (done, total) as work goes on."""
Value = TypeVar("Value")


def cores() -> int:
    """Return the number of usable cores, or ``COILARRAY_THREADS``."""
    said = os.environ.get("COILARRAY_THREADS", "")
    if said.isdecimal() and int(said) > 0:
        return int(said)
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def part_of(progress: Progress | None, number: int, parts: int) -> Progress | None:
    """Return the progress of one of several equal parts."""
    if progress is None or parts < 2:
        return progress
    return lambda done, total: progress(number * total + done, parts * total)


def ranges(count: int, size: int) -> list[tuple[int, int]]:
    """Cut 0..count into consecutive (start, stop) of at most `size`."""
    return [(start, min(start + size, count)) for start in range(0, count, size)]


def run_blocks(
    work: Callable[[Item], Result], items: Iterable[Item], *, progress: Progress | None = None
) -> Sequence[Result]:
    """Apply `work` to every item, on one thread per core."""
    todo = list(items)
    if not todo:
        return []
    if cores() == 1:  # threads for many small blocks cost as much as the blocks
        results = []
        with serial_algebra():
            for item in todo:
                results.append(work(item))
                if progress is not None:
                    progress(len(results), len(todo))
        return results
    done = 0
    with serial_algebra(), threads(min(cores(), len(todo))) as pool:
        futures = [pool.submit(work, item) for item in todo]
        if progress is not None:
            pending = set(futures)
            while pending:
                finished, pending = wait(pending, return_when=FIRST_EXCEPTION, timeout=0.2)
                if any(future.exception() is not None for future in finished):
                    break
                done += len(finished)
                progress(done, len(todo))
        return [future.result() for future in futures]


@contextmanager
def threads(count: int) -> Iterator[ThreadPoolExecutor]:
    """Open `count` threads for a ``with`` block.

    After an exception work that has not begun is dropped, and begun work is waited for, except after an
    interrupt.
    """
    pool = ThreadPoolExecutor(max_workers=count)
    try:
        yield pool
    except BaseException as error:
        pool.shutdown(wait=not isinstance(error, KeyboardInterrupt), cancel_futures=True)
        raise
    pool.shutdown()


@contextmanager
def serial_algebra() -> Iterator[None]:
    """Limit the linear algebra to one thread in the block.

    The last bits of results depend on the number of threads. In most builds the limit belongs to
    the whole process, and the first of several blocks that ends may lift it for all.
    """
    with _controller("scipy.linalg" in sys.modules).limit(limits=1, user_api="blas"):
        yield


@cache
def _controller(with_scipy: bool) -> ThreadpoolController:
    from threadpoolctl import ThreadpoolController  # slow to import, and a design is read without it

    return ThreadpoolController()


class Recent(Generic[Value]):
    """Last `size` results by key for all threads."""

    def __init__(self, size: int) -> None:
        self._size = size
        self._lock = threading.Lock()
        self._results: OrderedDict[Hashable, Future[Value]] = OrderedDict()

    def get(self, key: Hashable, compute: Callable[[], Value]) -> Value:
        """Return the result for a key, computed by one thread."""
        with self._lock:
            future = self._results.get(key)
            mine = future is None
            if future is None:
                future = self._results[key] = Future()
            self._results.move_to_end(key)
            while len(self._results) > self._size:
                self._results.popitem(last=False)
        if mine:
            try:
                future.set_result(compute())
            except BaseException as error:
                with self._lock:
                    if self._results.get(key) is future:
                        del self._results[key]
                future.set_exception(error)
        return future.result()
