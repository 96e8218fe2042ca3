"""ADG739 packages in a daisy chain: eight switches each, behind one shift register through all of them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

from coilarray.errors import HardwareError
from coilarray.hardware.scan.closure import SWITCHES, Net, SwitchTable, WiredSwitch, closed_switches

FALLING_EDGE_MODES = (1, 2)
"""Modes of SPI in which data is stable at the falling edge, where the chip takes it."""


class Adg739Chain:
    """The chain.

    Parameters
    ----------
    devices : tuple of tuple of WiredSwitch or None
        Switches as `coilarray.hardware.scan.closure.switch_table` returns them: the first device is at the far end of
        the chain and gets the first byte.
    before_change, after_change : callable
        Called before and after switches move.
    readback : bool
        Whether the end of the chain is wired back to the computer.

    Notes
    -----
    A bit goes in at every falling edge of the clock; when SYNC rises, each package takes its last eight. After power-up
    all switches are open. Nothing but power resets a package.
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
        """Bit of the word that moves each switch of the netlist: to be changed where the true map is another one."""
        self._before_change, self._after_change = before_change, after_change
        self._stuck: dict[tuple[int, int], bool] = {}
        self._register = 0  # the far end of the chain first
        self._words = bytes(len(self.devices))

    def power_up(self) -> None:
        """Let the supply come back: register empty, all switches open."""
        self._before_change()
        self._register = 0
        self._words = bytes(len(self.devices))
        self._after_change()

    @property
    def words(self) -> bytes:
        """What the packages were told last, in the order of sending."""
        return self._words

    def closed(self) -> tuple[WiredSwitch, ...]:
        """Switches that conduct, the stuck ones as they are."""
        return closed_switches(self.devices, self._words, stuck=self._stuck, bit_order=self.bit_order)

    def commanded(self) -> tuple[WiredSwitch, ...]:
        """Switches that would conduct if none were stuck."""
        return closed_switches(self.devices, self._words, bit_order=self.bit_order)

    def transfer(self, data: bytes, *, mode: int = 1, lsb_first: bool = False) -> bytes | None:
        """Shift bytes in with SYNC low, then let it rise.

        Parameters
        ----------
        data : bytes
            Any number of them.
        mode : int
            Of SPI, 0 to 3. In 0 and 3 data changes at the very edge at which the chip takes it, and what it takes is
            the bit before.
        lsb_first : bool
            The bit order, which should be the other one.

        Returns
        -------
        bytes or None
            What came out of the far end; None where it is not wired back.
        """
        count = SWITCHES * len(data)
        sent = int.from_bytes(_turned(data) if lsb_first else data)
        if mode not in FALLING_EDGE_MODES:
            sent >>= 1
        through = self._register << count | sent
        self._register = through & (1 << SWITCHES * len(self.devices)) - 1
        self._latch()
        if not self.readback:
            return None
        came = (through >> SWITCHES * len(self.devices)).to_bytes(len(data))
        return _turned(came) if lsb_first else came

    def stick(self, device: int, bit: int, state: Literal["open", "closed"]) -> None:
        """Break a switch: it stays open or closed whatever it is told.

        Parameters
        ----------
        device, bit : int
            Its place in the order of the words, and in the word.
        state : {"open", "closed"}
            How it stays.
        """
        self._before_change()
        self._stuck[device, bit] = state == "closed"
        self._after_change()

    def heal(self) -> None:
        """Mend all switches."""
        self._before_change()
        self._stuck.clear()
        self._after_change()

    def find(self, coil: int, end: int, net: Net) -> tuple[int, int]:
        """Device and bit of the switch from an end of a coil to a net.

        Raises
        ------
        HardwareError
            There is none.
        """
        for device, switches in enumerate(self.devices):
            for bit, switch in enumerate(switches):
                if switch == WiredSwitch((coil, end), net):
                    return device, bit
        raise HardwareError(f"no switch joins end {end} of coil {coil} to {net}.")

    def _latch(self) -> None:
        words = self._register.to_bytes(len(self.devices))
        self.latches += 1
        if words != self._words:
            self._before_change()
            self._words = words
            self._after_change()


def _turned(data: bytes) -> bytes:
    """Return the bytes with their bits in the other order."""
    return bytes(int(f"{byte:08b}"[::-1], 2) for byte in data)
