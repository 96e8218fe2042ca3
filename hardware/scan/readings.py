"""Raw scans of a board, and readings in physical units.

The four flags of a result come only if ERROR_CONFIG enables them. The codes 0 and 0xFFFFFFF mark a
range error even if it does not. STATUS is read once for each result, before the data, because
reading may clear it.
"""

from __future__ import annotations

import math
from collections.abc import Generator, Mapping
from dataclasses import dataclass
from enum import IntEnum, StrEnum
from typing import Literal, Protocol

from coilarray.circuit.converter_limits import SENSOR_FREQUENCY
from coilarray.errors import HardwareError, require_positive
from coilarray.hardware.chips.ldc1614 import CHANNELS, CODE_BITS, code_to_frequency, decode, inductance_from_frequency
from coilarray.hardware.scan.settings import ScanSettings


class SampleFault(IntEnum):
    """Reasons why a state of a scan has no result."""

    NONE = 0
    NOT_ACKNOWLEDGED = 1
    BUS_TIMEOUT = 2
    NO_RESULT = 3
    CONVERTER_RESET = 4
    SWITCHES_DIFFER = 5


@dataclass(frozen=True)
class RawSample:
    """Registers of one state of a scan, 0 with a fault."""

    msb: int  # DATA0_MSB with the four error flags
    lsb: int
    status: int  # as read before the data
    fault: SampleFault = SampleFault.NONE
    drive: int | None = None  # DRIVE_CURRENT0, if the converter chose its own drive current


@dataclass(frozen=True)
class RawScan:
    """One pass over all states.

    `sequence` is counted by the board since the stream began. `time` is the start in s by the
    board's clock, and `received` the arrival in s since the epoch. `configuration`
    is `ScanSettings.hash`, `boot` changes when the board restarts, and `samples` are in the order of
    the states.
    """

    sequence: int  # counted by the board since the stream began
    time: float  # of its start in s by the board's clock
    received: float  # arrival in s since the epoch
    configuration: int  # `ScanSettings.hash`
    boot: int  # changes when the board restarts
    samples: tuple[RawSample, ...]  # in the order of the states


@dataclass(frozen=True)
class Identity:
    """Identity of the board at a port.

    `kind` is a description such as "XMC 2Go, firmware 1.0". Outputs tell if it is `emulated`.
    `manufacturer` and `device` are registers of the converter. `boot` is the number of the board's
    session.
    """

    kind: str  # such as "XMC 2Go, firmware 1.0"
    emulated: bool
    manufacturer: int  # identity registers of the converter
    device: int
    boot: int  # number of the board's session


class Reader(Protocol):
    """A board that can be configured and scanned."""

    @property
    def identity(self) -> Identity:
        """Identity of the board."""

    def configure(self, settings: ScanSettings) -> None:
        """Write settings and read them back."""

    def scan(self) -> RawScan:
        """Measure every state once."""

    def scans(self, interval: float = 0.0) -> Generator[RawScan]:
        """Scan until the generator is closed.

        A scan runs once every `interval` in s, or as fast as possible for 0.
        """

    def rest(self) -> None:
        """Ground all coils and put the converter to sleep."""

    def close(self) -> None:
        """Put the board to rest and close the port."""


Verdict = Literal["good", "doubtful", "bad"]
"""Quality of a result: good, outside the data sheet's specification, or no measurement."""

LARGEST_CODE = (1 << CODE_BITS) - 1
QUARTER = 1 << (CODE_BITS - 2)
"""Code of a quarter of the reference frequency, without offset. The input must stay below."""

_DATA_READY, _UNREAD = 0x0040, 0x000F
_LEAST_QUALITY = 2.0  # from this value on the lossy form has a root at every frequency of the converter


class Reason(StrEnum):
    """Reasons why a result is doubtful or bad."""

    NOT_ACKNOWLEDGED = "the converter did not answer"
    BUS_TIMEOUT = "the bus hung"
    NO_RESULT = "no result in time"
    CONVERTER_RESET = "the converter was reset"
    SWITCHES_DIFFER = "the switches do not hold their words"

    IMPOSSIBLE = "bits that the converter cannot have set"
    ANOTHER_CHANNEL = "a result or error of another channel"
    NOT_READY = "no new result"
    WATCHDOG = "watchdog: the sensor does not oscillate"
    ZERO_COUNT = "zero count: no cycle of the sensor was seen"
    UNDER_RANGE = "under-range"
    OVER_RANGE = "over-range"
    NO_SENSOR = "a frequency that no sensor of the converter may have, outside 1 kHz to 10 MHz"

    ABOVE_QUARTER = "input not below a quarter of the reference"
    AMPLITUDE_HIGH = "amplitude above 1.8 V"
    AMPLITUDE_LOW = "amplitude below 1.2 V"
    AMPLITUDE = "amplitude outside 1.2 to 1.8 V"


_DOUBTFUL = frozenset({Reason.AMPLITUDE, Reason.AMPLITUDE_HIGH, Reason.AMPLITUDE_LOW, Reason.ABOVE_QUARTER})
_FAULTS = {fault: Reason[fault.name] for fault in SampleFault if fault is not SampleFault.NONE}
# Flags of the upper word, and fields of STATUS.
_FLAGS = {Reason.UNDER_RANGE: 1 << 15, Reason.OVER_RANGE: 1 << 14, Reason.WATCHDOG: 1 << 13, Reason.AMPLITUDE: 1 << 12}
_STATUS = {
    Reason.UNDER_RANGE: "ERR_UR",
    Reason.OVER_RANGE: "ERR_OR",
    Reason.WATCHDOG: "ERR_WD",
    Reason.AMPLITUDE_HIGH: "ERR_AHE",
    Reason.AMPLITUDE_LOW: "ERR_ALE",
    Reason.ZERO_COUNT: "ERR_ZC",
}


def judge(sample: RawSample, channel: int = 0) -> tuple[Verdict, tuple[Reason, ...]]:
    """Judge whether a sample of a channel is a measurement.

    It is doubtful for an amplitude outside its range or an input above a quarter of the reference.

    >>> judge(RawSample(0x0179, 0x82F3, 0x0048))
    ('good', ())
    >>> judge(RawSample(0x2000, 0x0000, 0x0848))[0]
    'bad'
    """
    if sample.fault is not SampleFault.NONE:
        return "bad", (_FAULTS[sample.fault],)
    code = _code(sample)
    reasons = {reason for reason, flag in _FLAGS.items() if sample.msb & flag} | _of_status(sample.status, channel)
    if code == 0:
        reasons.add(Reason.UNDER_RANGE)
    if code == LARGEST_CODE:
        reasons.add(Reason.OVER_RANGE)
    elif code >= QUARTER:
        reasons.add(Reason.ABOVE_QUARTER)
    if reasons & {Reason.AMPLITUDE_HIGH, Reason.AMPLITUDE_LOW}:
        reasons.discard(Reason.AMPLITUDE)  # STATUS is more precise
    ordered = tuple(reason for reason in Reason if reason in reasons)
    if not ordered:
        return "good", ()
    return ("doubtful" if reasons <= _DOUBTFUL else "bad"), ordered


def _code(sample: RawSample) -> int:
    return (sample.msb & 0x0FFF) << 16 | sample.lsb


def ready_status(channel: int) -> int:
    """Return STATUS of a good result of a channel."""
    return _DATA_READY | 1 << CHANNELS - 1 - channel


def _of_status(status: int, channel: int) -> set[Reason]:
    ready = ready_status(channel)
    if status == ready:  # nearly always
        return set()
    try:
        fields = decode("STATUS", status)
    except HardwareError:  # a reserved bit is set
        return {Reason.IMPOSSIBLE}
    reasons = {reason for reason, name in _STATUS.items() if fields[name]}
    if status & _UNREAD & ~ready or (fields["ERR_CHAN"] != channel and (reasons or fields["ERR_CHAN"])):
        reasons.add(Reason.ANOTHER_CHANNEL)
    return reasons if status & ready == ready else reasons | {Reason.NOT_READY}


@dataclass(frozen=True)
class StateReading:
    """One state of a scan in physical units."""

    name: str
    frequency: float | None  # Hz, None if the verdict is bad
    inductance: float | None  # H, likewise
    verdict: Verdict
    reasons: tuple[Reason, ...] = ()


@dataclass(frozen=True)
class ScanReading:
    """One scan with the readings of its `states`.

    `sequence`, `time`, `received` and `boot` are copied from its `RawScan`. `temperature` is in °C.
    """

    sequence: int  # as in its `RawScan`, like the next three
    time: float
    received: float
    boot: int
    states: tuple[StateReading, ...]
    temperature: float | None = None  # °C

    @property
    def verdict(self) -> Verdict:
        """Worst verdict of the states."""
        verdicts = {state.verdict for state in self.states}
        return "bad" if "bad" in verdicts else "doubtful" if "doubtful" in verdicts else "good"

    @property
    def inductances(self) -> dict[str, float]:
        """Inductances in H by the states' names."""
        return {state.name: state.inductance for state in self.states if state.inductance is not None}


def read_scan(
    scan: RawScan,
    settings: ScanSettings,
    capacitances: Mapping[str, float] | float,
    *,
    qualities: Mapping[str, float] | float = math.inf,
    clock: float | None = None,
    temperature: float | None = None,
) -> ScanReading:
    """Convert the words of a scan to frequencies and inductances.

    The `scan` was measured with the `settings`. `capacitances` are the total across the coil in F,
    by the name of the state or for all, and `qualities` the quality factors of the tanks likewise,
    at least 2, by default without losses, as in the simulated responses. `clock` is the converter's
    in Hz, if it is known better than when the settings were made. The board's `temperature` in °C
    is only copied.

    Returns frequency in Hz and inductance in H of every state, and the errors that the converter
    reported. Raises HardwareError for a scan of other settings or states, or a value that is
    missing or outside its range.

    >>> from coilarray.hardware.scan.settings import scan_settings
    >>> from coilarray.hardware.scan.wiring import load_wiring
    >>> settings = scan_settings(load_wiring())
    >>> sample, dead = RawSample(0x0179, 0x82F3, 0x0048), RawSample(0x2000, 0x0000, 0x0848)
    >>> scan = RawScan(0, 0.0, 0.0, settings.hash, 1, (sample, dead, *[sample] * 4))
    >>> states = read_scan(scan, settings, 120e-12).states
    >>> f"{states[0].frequency:.0f} Hz, {states[0].inductance * 1e6:.2f} µH"
    '2000000 Hz, 52.77 µH'
    >>> states[1].inductance, states[1].verdict, str(states[1].reasons[0])
    (None, 'bad', 'watchdog: the sensor does not oscillate')
    """
    if scan.configuration != settings.hash:
        raise HardwareError(
            f"scan {scan.sequence} was measured with the settings {scan.configuration:04X}, not with "
            f"{settings.hash:04X}."
        )
    if len(scan.samples) != len(settings.states):
        raise HardwareError(f"scan {scan.sequence} must have {len(settings.states)} states; got {len(scan.samples)}.")
    if clock is not None:
        require_positive("clock", clock, " Hz", HardwareError)
    reference = settings.reference if clock is None else clock / settings.fref_divider
    low, high = SENSOR_FREQUENCY
    states = []
    for state, sample in zip(settings.states, scan.samples, strict=True):
        capacitance = _of(capacitances, state.name, "capacitance")
        quality = _of(qualities, state.name, "quality factor")
        require_positive(f"the capacitance of {state.name}", capacitance, " F", HardwareError)
        if not quality >= _LEAST_QUALITY:
            raise HardwareError(f"the quality factor of {state.name} must be at least 2; got {quality}.")
        verdict, reasons = judge(sample, state.channel)
        frequency = inductance = None
        if verdict != "bad":
            frequency = code_to_frequency(_code(sample), reference, divider=settings.input_divider(state))
            if low <= frequency <= high:
                inductance = inductance_from_frequency(frequency, capacitance, quality)
            else:
                frequency, verdict, reasons = None, "bad", (*reasons, Reason.NO_SENSOR)
        states.append(StateReading(state.name, frequency, inductance, verdict, reasons))
    return ScanReading(scan.sequence, scan.time, scan.received, scan.boot, tuple(states), temperature)


def _of(values: Mapping[str, float] | float, state: str, what: str) -> float:
    if not isinstance(values, Mapping):
        return values
    if state not in values:
        raise HardwareError(f"the {what} of {state} must be given; there is none.")
    return values[state]
