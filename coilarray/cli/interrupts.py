"""Ctrl-C during a computation that does not return to Python."""

from __future__ import annotations

import os
import signal
import socket
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from threading import Event, Thread
from typing import NoReturn

INTERRUPTED = 130
"""Exit code of an interrupted program."""

_MESSAGE = b"coilarray: interrupted\n"
_PATIENCE = 2.0  # s for a computation to return to Python
_heard = Event()  # of the block that lasts


@contextmanager
def ending_on_interrupt() -> Iterator[None]:
    """End on Ctrl-C if a library does not return.

    Otherwise KeyboardInterrupt is raised as usual. Files stay whole, as each gets its name in one
    step. It does nothing if another program handles Ctrl-C itself.
    """
    if signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        yield
        return
    global _heard  # noqa: PLW0603
    heard = _heard = Event()  # its own: the thread of a block that has ended may still look at it
    read_end, write_end = socket.socketpair()
    write_end.setblocking(False)  # as set_wakeup_fd demands

    def raise_interrupt(number: int, frame: object) -> NoReturn:
        heard.set()
        raise KeyboardInterrupt

    def watch() -> None:
        with read_end:
            while came := read_end.recv(1):
                if came[0] == signal.SIGINT and not heard.wait(_PATIENCE):
                    with suppress(OSError):
                        os.write(2, _MESSAGE)
                    os._exit(INTERRUPTED)

    signal.signal(signal.SIGINT, raise_interrupt)
    before = signal.set_wakeup_fd(write_end.fileno(), warn_on_full_buffer=False)
    Thread(target=watch, daemon=True).start()
    try:
        yield
    finally:
        signal.set_wakeup_fd(before)
        signal.signal(signal.SIGINT, signal.default_int_handler)
        write_end.close()
        _heard = Event()


def was_interrupted() -> bool:
    """Whether Ctrl-C came, even if a library raised another exception."""
    return _heard.is_set()


def end_interrupted() -> NoReturn:
    """End the program at once, without waiting for threads."""
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, AttributeError):
            stream.flush()
    os._exit(INTERRUPTED)
