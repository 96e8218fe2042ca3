"""Packages of switches in a daisy chain, and their port.

The port shifts words into the packages.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

from coilarray.errors import HardwareError
from coilarray.hardware.scan.switching import (
    SWITCHES,
    Net,
    SwitchTable,
    WiredSwitch,
    closed_switches,
)
from coilarray.hardware.wire.buses import Clock, reversed_bits

_FALLING_EDGE_MODES = (1, 2)  # SPI modes in which data are stable at the falling edge, where the chip samples them


class EmulatedChain:
    """A daisy chain of packages behind one shift register.

    The first device is at the far end of the chain and gets the first byte. `before_change` and `after_change` are
    called when switches move. `readback` means that the end of the chain is wired back to the computer.

    A bit is shifted in at every falling edge of the clock. When SYNC rises, each package latches its last eight bits.
    After power-up all switches are open. Only power-up resets a package.
    """

    def __init__(
        self,
        devices: SwitchTable,
        *,
        before_change: Callable[[], None] = lambda: None,
        after_change: Callable[[], None] = lambda: None,
        readback: bool = True,
    ) -> None:
        self.devices = devices
        self.readback = readback
        self.latches = 0
        self.bit_order = list(range(SWITCHES))
        """Bit of the word that moves each switch of the netlist. Change it to emulate a board with another map."""
        self._before_change, self._after_change = before_change, after_change
        self._stuck: dict[tuple[int, int], bool] = {}
        self._register = 0  # the far end of the chain first
        self._words = bytes(len(self.devices))

    def power_up(self) -> None:
        """Restore the supply."""
        self._before_change()
        self._register, self._words = 0, bytes(len(self.devices))
        self._after_change()

    @property
    def words(self) -> bytes:
        """Words that the packages latched last, in sending order."""
        return self._words

    def closed(self) -> tuple[WiredSwitch, ...]:
        """Return the conducting switches, including switches stuck closed."""
        return closed_switches(self.devices, self._words, stuck=self._stuck, bit_order=self.bit_order)

    def commanded(self) -> tuple[WiredSwitch, ...]:
        """Return the switches that conduct if none is stuck."""
        return closed_switches(self.devices, self._words, bit_order=self.bit_order)

    def transfer(self, data: bytes, *, mode: int = 1, lsb_first: bool = False) -> bytes | None:
        """Shift bytes in with SYNC low, then let SYNC rise.

        The bytes that left the far end are returned, or None if it is not wired back. In the SPI modes 0 and 3 data
        change at the edge at which the chip samples them, so the chip takes the bit before. The chip expects the most
        significant bit first.
        """
        count = SWITCHES * len(data)
        sent = int.from_bytes(reversed_bits(data) if lsb_first else data)
        if mode not in _FALLING_EDGE_MODES:
            sent >>= 1
        through = self._register << count | sent
        self._register = through & (1 << SWITCHES * len(self.devices)) - 1
        self._latch()
        if not self.readback:
            return None
        came = (through >> SWITCHES * len(self.devices)).to_bytes(len(data))
        return reversed_bits(came) if lsb_first else came

    def stick(self, device: int, bit: int, state: Literal["open", "closed"]) -> None:
        """Break a switch, which then stays in this state."""
        self._before_change()
        self._stuck[device, bit] = state == "closed"
        self._after_change()

    def heal(self) -> None:
        """Repair all switches."""
        self._before_change()
        self._stuck.clear()
        self._after_change()

    def find(self, coil: int, end: int, net: Net) -> tuple[int, int]:
        """Return device and bit of a switch."""
        for device, switches in enumerate(self.devices):
            for bit, switch in enumerate(switches):
                if switch == WiredSwitch((coil, end), net):
                    return device, bit
        raise HardwareError(f"no switch joins end {end} of coil {coil} to {net}.")

    def _latch(self) -> None:
        """Latch the register and move the switches."""
        words = self._register.to_bytes(len(self.devices))
        self.latches += 1
        if words != self._words:
            self._before_change()
            self._words = words
            self._after_change()


class EmulatedSwitches:
    """Serial port between a driver and the emulated chain."""

    def __init__(self, chain: EmulatedChain, clock: Clock, *, speed: float = 8e6) -> None:
        self.chain, self.clock, self.speed = chain, clock, speed
        self.mode = 1
        """SPI mode. Change it to emulate a port with another mode."""
        self.lsb_first = False
        """Bit order. Change it to emulate a port with the wrong order."""
        self.broken = False
        """Whether the data line is broken, so that the chain receives zeros."""

    def shift(self, words: bytes) -> bytes | None:
        """Send one byte per device and latch all of them."""
        self.clock.sleep(8 * len(words) / self.speed)
        sent = bytes(len(words)) if self.broken else words
        return self.chain.transfer(sent, mode=self.mode, lsb_first=self.lsb_first)

    def close(self) -> None:
        """Release the port."""
