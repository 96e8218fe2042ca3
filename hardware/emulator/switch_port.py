"""The serial port between a driver and the emulated chain of switches."""

from __future__ import annotations

from coilarray.hardware.emulator.adg739_chain import Adg739Chain
from coilarray.hardware.wire.buses import Clock


class EmulatedSwitches:
    """A chain of switches: a `coilarray.hardware.wire.buses.SwitchChain`.

    Parameters
    ----------
    chain : Adg739Chain
        What is moved.
    clock : Clock
        Time of the board; shifting takes its time.
    speed : float
        In Hz.
    """

    def __init__(self, chain: Adg739Chain, clock: Clock, *, speed: float = 8e6) -> None:
        self.chain = chain
        self.clock = clock
        self.speed = speed
        self.mode = 1
        """Of SPI; to be changed where a port with another mode is to be tried."""
        self.lsb_first = False
        """Bit order; to be changed where a port with the wrong one is to be tried."""
        self.broken = False
        """Whether the data line is broken: the chain then gets zeros."""

    def shift(self, words: bytes) -> bytes | None:
        """Send one byte for each device, the first to the far end, and latch them all at once."""
        self.clock.sleep(8 * len(words) / self.speed)
        return self.chain.transfer(
            bytes(len(words)) if self.broken else words, mode=self.mode, lsb_first=self.lsb_first
        )

    def close(self) -> None:
        """Let go of the port."""
