"""The interface to every kind of board, and what it returns: raw scans, nothing converted.

The board may be a microcontroller, chips on the buses of this computer, or an emulation.
"""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass
from enum import IntEnum
from typing import Protocol

from coilarray.hardware.scan.settings import ScanSettings


class SampleFault(IntEnum):
    """Why a state of a scan has no result. The numbers are those of the protocol."""

    NONE = 0
    NOT_ACKNOWLEDGED = 1
    BUS_TIMEOUT = 2
    NO_RESULT = 3
    CONVERTER_RESET = 4
    SWITCHES_DIFFER = 5


@dataclass(frozen=True)
class RawSample:
    """One state of a scan: registers DATA0_MSB, its four error flags included, DATA0_LSB, and STATUS, read before them.

    With a fault the words are 0 and no measurement. `drive` is register DRIVE_CURRENT0 as read while the converter was
    awake, where it chose its own drive current; else None.
    """

    msb: int
    lsb: int
    status: int
    fault: SampleFault = SampleFault.NONE
    drive: int | None = None


@dataclass(frozen=True)
class RawScan:
    """One pass over all states.

    Parameters
    ----------
    sequence : int
        Number of the scan since the stream began, counted by the board; a gap means lost scans.
    time, received : float
        Start in s by the board's clock, unwrapped, and arrival in s since the epoch by the computer's.
    configuration : int
        16-bit hash of the settings the board measured with (`ScanSettings.hash`).
    boot : int
        Number of the board's session; it changes when the board restarts.
    samples : tuple of RawSample
        Samples in the order of the states of the settings.
    """

    sequence: int
    time: float
    received: float
    configuration: int
    boot: int
    samples: tuple[RawSample, ...]


@dataclass(frozen=True)
class Identity:
    """Identity of the board at a port.

    `kind` describes it: "XMC 2Go, firmware 1.0", "I²C bus 1", "emulator". Where it is `emulated`, every output for
    people says so. `manufacturer` and `device` are the registers MANUFACTURER_ID and DEVICE_ID of the converter, and
    `boot` is the number of the board's session.
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
        """Identity of the board."""

    def configure(self, settings: ScanSettings) -> None:
        """Write settings and read them back; unsafe ones are refused."""

    def scan(self) -> RawScan:
        """Measure every state once.

        Returns
        -------
        RawScan
            Words of all states, as the converter gave them.
        """

    def scans(self, interval: float = 0.0) -> Generator[RawScan]:
        """Scan until the generator is closed, once every `interval` in s, or as fast as possible for 0.

        Yields
        ------
        RawScan
            Words of all states, as the converter gave them.
        """

    def peek(self, address: int) -> int:
        """Read the register at an `address` (0 to 127) of the converter, which must not be scanning.

        Returns
        -------
        int
            The word of 16 bits.
        """

    def rest(self) -> None:
        """Ground all coils and put the converter to sleep."""

    def close(self) -> None:
        """Put the board to rest, if it still answers, and close the port. Never raises; may be called again."""
