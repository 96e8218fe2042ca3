"""Single keys from the terminal while something else runs."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager


@contextmanager
def pressed_keys() -> Iterator[Callable[[], str]]:
    """Yield a function that returns the newly pressed keys.

    The terminal is as it was when the block is left.
    """
    try:
        watched = sys.stdin.isatty() and sys.stdout.isatty()
    except ValueError:  # closed
        watched = False
    if not watched:
        yield lambda: ""
        return
    if sys.platform == "win32":
        import msvcrt

        def waiting() -> str:
            keys = ""
            while msvcrt.kbhit():
                keys += msvcrt.getwch()
            return keys

        yield waiting
        return
    import os
    import select
    import termios
    import tty

    keyboard = sys.stdin.fileno()

    def ready() -> str:
        keys = b""
        while select.select([keyboard], [], [], 0)[0]:
            more = os.read(keyboard, 64)
            if not more:
                break
            keys += more
        return keys.decode("ascii", errors="ignore")

    before = termios.tcgetattr(keyboard)
    try:
        tty.setcbreak(keyboard)
        yield ready
    finally:
        termios.tcsetattr(keyboard, termios.TCSADRAIN, before)
