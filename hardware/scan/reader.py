"""The one interface to every kind of board: over a microcontroller, over the buses of this computer, or emulated."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Protocol

from coilarray.hardware.scan.scans import RawScan
from coilarray.hardware.scan.settings import ScanSettings


@dataclass(frozen=True)
class Identity:
    """What answers at a port.

    Parameters
    ----------
    kind : str
        For people: "XMC 2Go, firmware 1.0", "I²C bus 1", "emulator".
    emulated : bool
        True where no real board is behind it; then every line that a person reads says so.
    manufacturer, device : int
        Registers MANUFACTURER_ID and DEVICE_ID of the converter.
    boot : int
        Of the session of the board.
    """

    kind: str
    emulated: bool
    manufacturer: int
    device: int
    boot: int


class Reader(Protocol):
    """A board that can be configured and scanned. All methods raise a HardwareError of `wire.faults`."""

    @property
    def identity(self) -> Identity:
        """What answers."""

    def configure(self, settings: ScanSettings) -> None:
        """Write settings and read them back; refuses what would be unsafe."""

    def scan(self) -> RawScan:
        """Measure every state once."""

    def scans(self, interval: float = 0.0) -> Iterator[RawScan]:
        """Scan without end, one each `interval` in s or as fast as it goes; closing the iterator stops the board."""

    def peek(self, address: int) -> int:
        """Read a register of the converter; not while it scans."""

    def rest(self) -> None:
        """Ground all coils and put the converter to sleep."""

    def close(self) -> None:
        """Rest, as far as the board still answers, and let go of the port. Never raises; may be called again."""
