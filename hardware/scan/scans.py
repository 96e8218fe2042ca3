"""What a board returns of one scan, as its chips said it: raw words, nothing converted."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum


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
