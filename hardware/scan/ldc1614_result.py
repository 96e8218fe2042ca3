"""What the two data registers and STATUS of an LDC1614 say of one conversion, and whether it is a measurement.

The four flags of a result come only where ERROR_CONFIG asks for them; the codes 0 and 0xFFFFFFF mark a range error even
where it does not. STATUS is read once for each result, before the data: reading it may clear what it says.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Literal

from coilarray.errors import HardwareError
from coilarray.hardware.chips.ldc1614 import CODE_BITS
from coilarray.hardware.chips.ldc1614_registers import decode
from coilarray.hardware.scan.scans import RawSample, SampleFault

Verdict = Literal["good", "doubtful", "bad"]
"""Of a result: good; usable, but beyond what the data sheet promises; no measurement."""

READY = 0x0048
"""STATUS of a result without an error: DRDY and UNREADCONV0."""
ALL_FLAGS = 0xF8FD
"""ERROR_CONFIG that asks for every flag in result and STATUS."""
LARGEST_CODE = (1 << CODE_BITS) - 1
QUARTER = 1 << (CODE_BITS - 2)
"""Code of a quarter of the reference frequency, with no offset; the input must stay below."""

_WORD = 0xFFFF
_UNDER, _OVER, _WATCHDOG, _AMPLITUDE = 1 << 15, 1 << 14, 1 << 13, 1 << 12  # of the upper word
_AMPLITUDE_ASKED = 0x1800  # AH_ERR2OUT and AL_ERR2OUT, both shown in the same bit of the upper word
_OFFSET_STEP = 1 << (CODE_BITS - 16)


class Reason(StrEnum):
    """Why a result is doubtful or bad; the most telling first."""

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


@dataclass(frozen=True)
class Result:
    """The two data registers of a channel.

    Parameters
    ----------
    code : int
        28 bits.
    under_range, over_range, watchdog, amplitude : bool
        The flags, where ERROR_CONFIG asks for them; `amplitude` is too high or too low.
    """

    code: int
    under_range: bool = False
    over_range: bool = False
    watchdog: bool = False
    amplitude: bool = False


def decode_result(msb: int, lsb: int) -> Result:
    """Split DATA0_MSB and DATA0_LSB into code and flags.

    Raises
    ------
    HardwareError
        A word beyond 16 bits.

    Examples
    --------
    >>> result = decode_result(0x1179, 0x82F3)
    >>> hex(result.code), result.amplitude
    ('0x17982f3', True)
    """
    for name, word in (("msb", msb), ("lsb", lsb)):
        if not 0 <= word <= _WORD:
            raise HardwareError(f"{name} must be 0 to 0xFFFF; got {word:#x}.")
    return Result(
        (msb & 0x0FFF) << 16 | lsb, bool(msb & _UNDER), bool(msb & _OVER), bool(msb & _WATCHDOG), bool(msb & _AMPLITUDE)
    )


def encode_result(result: Result) -> tuple[int, int]:
    """Return DATA0_MSB and DATA0_LSB of a result; the inverse of `decode_result`.

    Raises
    ------
    HardwareError
        A code beyond 28 bits.
    """
    if not 0 <= result.code <= LARGEST_CODE:
        raise HardwareError(f"code must be 0 to {LARGEST_CODE:#x}; got {result.code:#x}.")
    flags = (
        (_UNDER, result.under_range), (_OVER, result.over_range),
        (_WATCHDOG, result.watchdog), (_AMPLITUDE, result.amplitude),
    )  # fmt: skip
    return sum(bit for bit, is_set in flags if is_set) | result.code >> 16, result.code & _WORD


def judge(sample: RawSample, *, offset: int = 0, error_config: int = ALL_FLAGS) -> tuple[Verdict, tuple[Reason, ...]]:
    """Tell whether a sample is a measurement.

    Parameters
    ----------
    sample : RawSample
        Of channel 0, alone.
    offset : int
        OFFSET0.
    error_config : int
        ERROR_CONFIG; a flag that it does not ask for was not set by the converter.

    Returns
    -------
    verdict : {"good", "doubtful", "bad"}
        Doubtful: an amplitude outside its range, or an input above a quarter of the reference. Bad: all else.
    reasons : tuple of Reason
        None where it is good.

    Raises
    ------
    HardwareError
        A word beyond 16 bits.

    Examples
    --------
    >>> judge(RawSample(0x0179, 0x82F3, 0x0048))
    ('good', ())
    >>> judge(RawSample(0x2000, 0x0000, 0x0848))[0]
    'bad'
    """
    if sample.fault is not SampleFault.NONE:
        return "bad", (_FAULTS[sample.fault],)
    result = decode_result(sample.msb, sample.lsb)
    reasons = _of_result(result, offset) | _of_status(sample.status)
    if sample.msb & ~_shown(error_config) & 0xF000:
        reasons.add(Reason.IMPOSSIBLE)
    if reasons & {Reason.AMPLITUDE_HIGH, Reason.AMPLITUDE_LOW}:
        reasons.discard(Reason.AMPLITUDE)  # STATUS says it more closely
    ordered = tuple(reason for reason in Reason if reason in reasons)
    if not ordered:
        return "good", ()
    return ("doubtful" if reasons <= _DOUBTFUL else "bad"), ordered


def _of_result(result: Result, offset: int) -> set[Reason]:
    says = {
        Reason.UNDER_RANGE: result.under_range or result.code == 0,
        Reason.OVER_RANGE: result.over_range or result.code == LARGEST_CODE,
        Reason.WATCHDOG: result.watchdog,
        Reason.AMPLITUDE: result.amplitude,
        Reason.ABOVE_QUARTER: result.code != LARGEST_CODE and result.code + offset * _OFFSET_STEP >= QUARTER,
    }
    return {reason for reason, is_said in says.items() if is_said}


def _of_status(status: int) -> set[Reason]:
    if status == READY:  # nearly always
        return set()
    if not 0 <= status <= _WORD:
        raise HardwareError(f"status must be 0 to 0xFFFF; got {status:#x}.")
    try:
        fields = decode("STATUS", status)
    except HardwareError:  # a reserved bit is set
        return {Reason.IMPOSSIBLE}
    says = {
        Reason.UNDER_RANGE: fields["ERR_UR"],
        Reason.OVER_RANGE: fields["ERR_OR"],
        Reason.WATCHDOG: fields["ERR_WD"],
        Reason.AMPLITUDE_HIGH: fields["ERR_AHE"],
        Reason.AMPLITUDE_LOW: fields["ERR_ALE"],
        Reason.ZERO_COUNT: fields["ERR_ZC"],
        Reason.NOT_READY: not (fields["DRDY"] and fields["UNREADCONV0"]),
        Reason.ANOTHER_CHANNEL: (
            fields["ERR_CHAN"] or fields["UNREADCONV1"] or fields["UNREADCONV2"] or fields["UNREADCONV3"]
        ),
    }
    return {reason for reason, is_said in says.items() if is_said}


def _shown(error_config: int) -> int:
    """Return the flags of the upper word that ERROR_CONFIG asks for."""
    amplitude = _AMPLITUDE if error_config & _AMPLITUDE_ASKED else 0
    return error_config & (_UNDER | _OVER | _WATCHDOG) | amplitude
