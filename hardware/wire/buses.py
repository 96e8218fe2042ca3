"""The two buses of a board, how bytes go over them, and the clock: what a driver that runs on this computer needs."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from typing import Protocol

from coilarray.errors import HardwareError

_FASTEST = 30e6  # Hz; of the ADG739, not verified


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


@dataclass(frozen=True)
class ShiftSettings:
    """Form of the transfers. The default is what the switches of the reference board need, as far as is known.

    Parameters
    ----------
    mode : int
        Of SPI, 0 to 3. The switches take a bit at the falling edge of the clock: 1, or 2 where it idles high.
    speed : float
        Of the clock in Hz; without effect where a host sets the pins one by one.
    least_significant_first : bool
        The order of the bits of a byte, which is the other one by default.
    readback : bool
        Whether the end of the chain is wired back, so that the host can compare.

    Raises
    ------
    HardwareError
        Another mode, or a speed that is not positive or above 30 MHz.
    """

    mode: int = 1
    speed: float = 1e6
    least_significant_first: bool = False
    readback: bool = False

    def __post_init__(self) -> None:
        if self.mode not in range(4):
            raise HardwareError(f"the mode of SPI must be 0 to 3; got {self.mode}.")
        if not (math.isfinite(self.speed) and 0 < self.speed <= _FASTEST):
            raise HardwareError(f"the speed of SPI must be positive and at most {_FASTEST:g} Hz; got {self.speed} Hz.")

    @property
    def idle_high(self) -> bool:
        """Whether the clock rests at high: CPOL."""
        return bool(self.mode & 2)

    @property
    def second_edge(self) -> bool:
        """Whether a bit is taken at the second edge of its clock: CPHA."""
        return bool(self.mode & 1)

    def ordered(self, data: bytes) -> bytes:
        r"""Return bytes so that a host that sends the highest bit first sends them in this order; its own inverse.

        Examples
        --------
        >>> ShiftSettings(least_significant_first=True).ordered(b"\x01").hex()
        '80'
        """
        if not self.least_significant_first:
            return data
        return bytes(int(f"{byte:08b}"[::-1], 2) for byte in data)
