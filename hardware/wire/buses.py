"""Buses and clock of a driver on this computer.

The module defines the two buses of a board, the transfer of bytes over them, and the clock.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from typing import Protocol

from coilarray.errors import HardwareError

_FASTEST = 30e6  # Hz; of the ADG739, not verified


class RegisterBus(Protocol):
    """I²C to one converter."""

    def read(self, register: int) -> int:
        """Return a register."""

    def write(self, register: int, value: int) -> None:
        """Write a register."""

    def clear(self) -> None:
        """Free a bus that a chip holds low."""

    def close(self) -> None:
        """Close the bus. Never raises."""


class SwitchChain(Protocol):
    """A daisy chain of switches behind a serial port."""

    def shift(self, words: bytes) -> bytes | None:
        """Send one byte per device and latch all together.

        The first byte goes to the far end of the chain. The words that the chain held before are returned if its end is
        wired back, else None.
        """

    def close(self) -> None:
        """Close the port. Never raises."""


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


@dataclass(frozen=True)
class ShiftSettings:
    """Settings of the transfers to the switches.

    The defaults suit the reference board, as far as is known.
    """

    mode: int = 1  # SPI mode, 0 to 3
    speed: float = 1e6  # clock in Hz, at most 30 MHz. It has no effect on a host that sets the pins individually
    least_significant_first: bool = False  # whether the lowest bit of a byte is sent first
    readback: bool = False  # whether the end of the chain is wired back to the host

    def __post_init__(self) -> None:
        if self.mode not in range(4):
            raise HardwareError(f"the mode of SPI must be 0 to 3; got {self.mode}.")
        if not (math.isfinite(self.speed) and 0 < self.speed <= _FASTEST):
            raise HardwareError(f"the speed of SPI must be positive and at most {_FASTEST:g} Hz; got {self.speed} Hz.")

    @property
    def idle_high(self) -> bool:
        """Whether the clock idles high: CPOL."""
        return bool(self.mode & 2)

    @property
    def second_edge(self) -> bool:
        """Whether a bit is read at the second edge: CPHA."""
        return bool(self.mode & 1)

    def ordered(self, data: bytes) -> bytes:
        """Return the bytes in the order of bits."""
        return reversed_bits(data) if self.least_significant_first else data


def reversed_bits(data: bytes) -> bytes:
    """Return the bytes with reversed bits."""
    return bytes(int(f"{byte:08b}"[::-1], 2) for byte in data)
