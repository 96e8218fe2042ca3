"""Waiting in tests: long for what must come, and by a clock that does not count what a busy computer took away."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TypeVar

PATIENCE = 300.0
"""Seconds for what takes one or two where nobody else computes."""

_TICK = 0.01  # s
_COUNTED = 0.03  # s that one tick counts at most: the rest was taken away

Found = TypeVar("Found")


def until(condition: Callable[[], Found], *, pause: float = 0.02, within: float = PATIENCE) -> Found:
    """Return the first true result of `condition`; a failed assertion if none comes within a time in s.

    It looks less and less often, up to ten times less than at first, as to look takes the processor too.
    """
    end, longest = time.monotonic() + within, 10 * pause
    while True:
        found = condition()
        if found:
            return found
        assert time.monotonic() < end, f"nothing came within {within:.0f} s"
        time.sleep(pause)
        pause = min(1.2 * pause, longest)


def alive(pid: int) -> bool:
    """Whether a process runs; one that has ended may stay as a zombie for a moment."""
    try:
        state = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()[0]
    except (FileNotFoundError, ProcessLookupError):  # the second where it goes while it is read
        return False
    return state not in "ZX"


def computed(pid: int) -> float:
    """Return the processor time of a process in s, in all its threads: how far it is, however busy the computer."""
    fields = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


class _Ticks:
    """Seconds in which this process ran, from a thread that looks at the clock again and again until it is stopped."""

    def __init__(self) -> None:
        self.seconds = 0.0
        self.stopped = threading.Event()
        threading.Thread(target=self._count, name="ticks", daemon=True).start()

    def _count(self) -> None:
        last = time.monotonic()
        while not self.stopped.wait(_TICK):
            now = time.monotonic()
            self.seconds += min(now - last, _COUNTED)
            last = now


@contextmanager
def lasting(seconds: float) -> Iterator[None]:
    """A block that must end within a time in which this process was not stopped, nor starved by others."""
    ticks = _Ticks()
    try:
        yield
    finally:
        ticks.stopped.set()
    took = ticks.seconds
    assert took < seconds + 2 * _TICK, f"took {took:.2f} s, which is more than {seconds:.2f} s"
