"""The two buses of a board and the time between their words: what a driver that runs on this computer needs."""

from __future__ import annotations

import time
from typing import Protocol


class RegisterBus(Protocol):
    """I²C to one converter: 16-bit registers, most significant byte first."""

    def read(self, register: int) -> int:
        """Return a register; BusFault where the chip does not answer."""

    def write(self, register: int, value: int) -> None:
        """Write a register; BusFault where the chip does not answer."""

    def clear(self) -> None:
        """Free a bus that a chip holds down: nine clocks and a stop."""

    def close(self) -> None:
        """Let go of the bus. Never raises."""


class SwitchChain(Protocol):
    """A daisy chain of switches behind a serial port."""

    def shift(self, words: bytes) -> bytes | None:
        """Send one byte for each device, the first byte to the far end of the chain, and latch them all at once.

        Returns
        -------
        bytes or None
            What the chain held before, where its end is wired back; None where it is not.
        """

    def close(self) -> None:
        """Let go of the port. Never raises."""


class Clock(Protocol):
    """Time of the board."""

    def now(self) -> float:
        """Return the time in s since an arbitrary start; never steps back."""

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
