"""A scan in physical units: frequency and inductance of every state, or the reason why there is none."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from coilarray.errors import HardwareError
from coilarray.hardware.chips.ldc1614 import code_to_frequency, inductance_from_frequency
from coilarray.hardware.chips.ldc1614_limits import SENSOR_FREQUENCY
from coilarray.hardware.scan.ldc1614_result import Reason, Verdict, decode_result, judge
from coilarray.hardware.scan.scans import RawSample, RawScan
from coilarray.hardware.scan.settings import ScanSettings

_LEAST_QUALITY = 2.0  # from here the lossy form has a root at every frequency of the converter


@dataclass(frozen=True)
class StateReading:
    """One state of a scan.

    Parameters
    ----------
    name : str
        Of the state.
    frequency : float or None
        In Hz; None where the verdict is bad.
    inductance : float or None
        In H; None where the verdict is bad.
    verdict : {"good", "doubtful", "bad"}
        A doubtful value is outside what the data sheet promises.
    reasons : tuple of Reason
        None where it is good.
    """

    name: str
    frequency: float | None
    inductance: float | None
    verdict: Verdict
    reasons: tuple[Reason, ...] = ()


@dataclass(frozen=True)
class ScanReading:
    """One scan.

    Parameters
    ----------
    sequence, time, received, boot
        As of `RawScan`.
    states : tuple of StateReading
        In the order of the settings.
    """

    sequence: int
    time: float
    received: float
    boot: int
    states: tuple[StateReading, ...]

    @property
    def verdict(self) -> Verdict:
        """The worst of its states."""
        verdicts = {state.verdict for state in self.states}
        return "bad" if "bad" in verdicts else "doubtful" if "doubtful" in verdicts else "good"

    @property
    def inductances(self) -> dict[str, float]:
        """Inductances in H by the states' names; bad states are left out."""
        return {state.name: state.inductance for state in self.states if state.inductance is not None}


def read_scan(
    scan: RawScan,
    settings: ScanSettings,
    capacitances: Mapping[str, float] | float,
    *,
    qualities: Mapping[str, float] | float = math.inf,
    clock: float | None = None,
) -> ScanReading:
    """Convert the words of a scan.

    Parameters
    ----------
    scan : RawScan
        As a board returned it.
    settings : ScanSettings
        With which it was measured.
    capacitances : mapping of str to float, or float
        All capacitance across the coil in F, by the state's name or of all states.
    qualities : mapping of str to float, or float
        Quality factor of the tank likewise, at least 2. By default no losses, as in the simulated responses.
    clock : float, optional
        Of the converter in Hz where it is known better than when the settings were made.

    Returns
    -------
    ScanReading

    Raises
    ------
    HardwareError
        A scan that was measured with other settings or has another number of states, a capacitance, quality factor or
        clock that is missing or outside its range, or words beyond 16 bits.

    Examples
    --------
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
            f"scan {scan.sequence} was measured with other settings, {scan.configuration:04X}; "
            f"these are {settings.hash:04X}."
        )
    if len(scan.samples) != len(settings.states):
        raise HardwareError(f"scan {scan.sequence} must have {len(settings.states)} states; got {len(scan.samples)}.")
    if clock is not None and not (math.isfinite(clock) and clock > 0):
        raise HardwareError(f"clock must be positive and finite; got {clock} Hz.")
    reference = settings.reference if clock is None else clock / settings.fref_divider
    states = []
    for state, sample in zip(settings.states, scan.samples, strict=True):
        capacitance, quality = (
            _of(capacitances, state.name, "capacitance"),
            _of(qualities, state.name, "quality factor"),
        )
        if not (math.isfinite(capacitance) and capacitance > 0):
            raise HardwareError(f"the capacitance of {state.name} must be positive and finite; got {capacitance} F.")
        if not quality >= _LEAST_QUALITY:
            raise HardwareError(f"the quality factor of {state.name} must be at least 2; got {quality}.")
        states.append(_read(state.name, sample, settings, reference, capacitance, quality))
    return ScanReading(scan.sequence, scan.time, scan.received, scan.boot, tuple(states))


def _read(
    name: str, sample: RawSample, settings: ScanSettings, reference: float, capacitance: float, quality: float
) -> StateReading:
    verdict, reasons = judge(sample, offset=settings.offset)
    if verdict == "bad":
        return StateReading(name, None, None, verdict, reasons)
    code = decode_result(sample.msb, sample.lsb).code
    frequency = code_to_frequency(code, reference, divider=settings.fin_divider, offset=settings.offset)
    low, high = SENSOR_FREQUENCY
    if not low <= frequency <= high:
        return StateReading(name, None, None, "bad", (*reasons, Reason.NO_SENSOR))
    return StateReading(name, frequency, inductance_from_frequency(frequency, capacitance, quality), verdict, reasons)


def _of(values: Mapping[str, float] | float, state: str, what: str) -> float:
    if not isinstance(values, Mapping):
        return values
    if state not in values:
        raise HardwareError(f"the {what} of {state} must be given; there is none.")
    return values[state]
