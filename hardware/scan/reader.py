"""The one interface to every kind of board: over a microcontroller, over the buses of this computer, or emulated."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from enum import IntEnum
from typing import Protocol

from coilarray.hardware.scan.settings import ScanSettings


class SampleFault(IntEnum):
    """Why a state of a scan has no words: what the reader of the chips met. The numbers are those of the protocol."""

    NONE = 0
    NOT_ACKNOWLEDGED = 1
    BUS_TIMEOUT = 2
    NO_RESULT = 3
    CONVERTER_RESET = 4
    SWITCHES_DIFFER = 5


@dataclass(frozen=True)
class RawSample:
    """One state of a scan.

    Parameters
    ----------
    msb, lsb : int
        Registers DATA0_MSB, its four error flags included, and DATA0_LSB.
    status : int
        Register STATUS, read once, before the data.
    fault : SampleFault
        Anything but NONE means that the words are 0 and no measurement.
    """

    msb: int
    lsb: int
    status: int
    fault: SampleFault = SampleFault.NONE


@dataclass(frozen=True)
class RawScan:
    """One pass over all states.

    Parameters
    ----------
    sequence : int
        Number of the scan since the stream began, as the board counts; a gap is scans that were lost.
    time : float
        Start of the scan in s by the board's clock, unwrapped; never the time of arrival.
    received : float
        Arrival in s since the epoch, by the computer's clock.
    configuration : int
        16-bit hash of the settings the board measured with (`ScanSettings.hash`).
    boot : int
        Of the session of the board; it changes when the board restarts.
    samples : tuple of RawSample
        In the order of the states of the settings.
    """

    sequence: int
    time: float
    received: float
    configuration: int
    boot: int
    samples: tuple[RawSample, ...]


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
