"""Buses of a driver, their errors, and ending signals."""

from __future__ import annotations

import contextlib
import signal
import threading
import time
from collections.abc import Callable, Iterator
from types import FrameType
from typing import Any, Protocol

from coilarray.errors import HardwareError


class DeviceLost(HardwareError):  # noqa: N818 - the field's words
    """The port is gone."""


class NoAnswer(HardwareError):  # noqa: N818
    """No valid message came in time."""


class NotABoard(HardwareError):  # noqa: N818
    """The received bytes have no valid record."""


class VersionMismatch(HardwareError):  # noqa: N818
    """The board has another major version of the protocol."""


class CommandRefused(HardwareError):  # noqa: N818
    """The board answered a command with an error."""


class BoardRestarted(HardwareError):  # noqa: N818
    """The board or its converter was reset while measuring."""


class BusFault(HardwareError):  # noqa: N818
    """A chip does not answer or returns wrong values."""


class SwitchFault(HardwareError):  # noqa: N818
    """Switches do not follow their words."""


class BusTimeout(BusFault):
    """A chip or the bus delays a transfer too long."""


_ENDING = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name))
_EXIT_CODE = 128  # plus the number of the signal, as a shell reports it
Handler = Callable[[int, FrameType | None], Any]


@contextlib.contextmanager
def held_signals() -> Iterator[None]:
    """Delay ending signals within a block of the main thread."""
    came: list[int] = []
    try:
        with _handled(lambda number, _: came.append(number), instead_of_any=True):
            yield
    finally:
        for number in came:
            signal.raise_signal(number)


@contextlib.contextmanager
def orderly_termination() -> Iterator[None]:
    """Raise SystemExit on SIGTERM, or when the terminal is closed."""

    def leave(number: int, _: FrameType | None) -> None:
        raise SystemExit(_EXIT_CODE + number)

    with _handled(leave, instead_of_any=False):
        yield


@contextlib.contextmanager
def _handled(handler: Handler, *, instead_of_any: bool) -> Iterator[None]:
    """Handle signals without another handler, or with `instead_of_any` all."""
    before: dict[int, Any] = {}
    try:
        if threading.current_thread() is threading.main_thread():
            for number in _ENDING:
                present = signal.getsignal(number)
                # Python cannot put back None. Ignored signals stay ignored, as nohup requires.
                if present == signal.SIG_DFL or (instead_of_any and present not in (None, signal.SIG_IGN)):
                    before[number] = present
                    signal.signal(number, handler)
        yield
    finally:
        for number, present in before.items():
            signal.signal(number, present)


class RegisterBus(Protocol):
    """I²C to one converter."""

    def read(self, register: int) -> int:
        """Return a register."""

    def write(self, register: int, value: int) -> None:
        """Write a register."""

    def clear(self) -> None:
        """Free a bus that a chip holds low."""

    def close(self) -> None:
        """Close the bus, and never raise."""


class SwitchChain(Protocol):
    """A daisy chain of switches behind a serial port."""

    def shift(self, words: bytes) -> bytes | None:
        """Send one byte per device and latch all together.

        The first byte goes to the far end of the chain. If its end is wired back, the previous
        words are returned.
        """

    def close(self) -> None:
        """Close the port, and never raise."""


class Clock(Protocol):
    """Time of the board."""

    def now(self) -> float:
        """Return the time in s since an arbitrary start."""

    def sleep(self, seconds: float) -> None:
        """Wait."""


class ComputerClock:
    """The computer's own clock."""

    def now(self) -> float:
        """Return the monotonic time in s."""
        return time.monotonic()

    def sleep(self, seconds: float) -> None:
        """Wait."""
        time.sleep(max(seconds, 0.0))
