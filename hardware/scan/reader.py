"""Interface to every kind of board, and its raw scans.

Nothing is converted. The board may be a microcontroller, chips on the buses of this computer, or an emulation.
"""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass
from enum import IntEnum
from typing import Protocol

from coilarray.hardware.scan.settings import ScanSettings


class SampleFault(IntEnum):
    """Reasons why a state of a scan has no result.

    The numbers are defined by the protocol.
    """

    NONE = 0
    NOT_ACKNOWLEDGED = 1
    BUS_TIMEOUT = 2
    NO_RESULT = 3
    CONVERTER_RESET = 4
    SWITCHES_DIFFER = 5


@dataclass(frozen=True)
class RawSample:
    """Registers of one state of a scan.

    They are DATA0_MSB with its four error flags, DATA0_LSB, and STATUS, which is read before them. With a fault the
    words are 0 and no measurement. `drive` is register DRIVE_CURRENT0, read while the converter was awake, if it chose
    its own drive current. Otherwise it is None.
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
        Number of the scan since the stream began, counted by the board. A gap means lost scans.
    time, received : float
        Start in s by the board's clock, unwrapped, and arrival in s since the epoch by the computer's clock.
    configuration : int
        16-bit hash of the settings the board measured with (`ScanSettings.hash`).
    boot : int
        Number of the board's session. It changes when the board restarts.
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

    `kind` describes it: "XMC 2Go, firmware 1.0", "I²C bus 1", "emulator". If it is `emulated`, every output for people
    states it. `manufacturer` and `device` are the registers MANUFACTURER_ID and DEVICE_ID of the converter. `boot` is
    the number of the board's session.
    """

    kind: str
    emulated: bool
    manufacturer: int
    device: int
    boot: int


class Reader(Protocol):
    """A board that can be configured and scanned.

    All methods raise a HardwareError of `wire.faults`.
    """

    @property
    def identity(self) -> Identity:
        """Identity of the board."""

    def configure(self, settings: ScanSettings) -> None:
        """Write settings and read them back.

        Unsafe settings are refused.
        """

    def scan(self) -> RawScan:
        """Measure every state once.

        Returns
        -------
        RawScan
            Words of all states, as the converter gave them.
        """

    def scans(self, interval: float = 0.0) -> Generator[RawScan]:
        """Scan until the generator is closed.

        A scan runs once every `interval` in s, or as fast as possible for 0.

        Yields
        ------
        RawScan
            Words of all states, as the converter gave them.
        """

    def peek(self, address: int) -> int:
        """Read a register of the converter.

        The `address` is 0 to 127. The converter must not be scanning.

        Returns
        -------
        int
            The word of 16 bits.
        """

    def rest(self) -> None:
        """Ground all coils and put the converter to sleep."""

    def close(self) -> None:
        """Put the board to rest and close the port.

        The board is put to rest only if it still answers. The method never raises and may be called again.
        """
