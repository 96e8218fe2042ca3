"""Settings of a board for a scan, as values, registers and JSON.

The hash of the settings ties a reading to them.
"""

from __future__ import annotations

import binascii
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from functools import cache, cached_property
from typing import Annotated, Any

from pydantic import BeforeValidator, ConfigDict, Field, TypeAdapter, ValidationError

from coilarray.design.readout import INTERNAL_CLOCK, LARGEST_RCOUNT
from coilarray.design.scan_states import ScanState, paper_plan
from coilarray.design.toml_file import first_error
from coilarray.errors import HardwareError, require_positive
from coilarray.hardware.chips.ldc1614 import (
    BUS_RATE,
    CHANNELS,
    EXTERNAL_CLOCK_RANGE,
    FAMILIES,
    INTERNAL_CLOCK_RANGE,
    MOST_DISCARDED,
    Family,
    StateTime,
    bus_time,
    check_clock,
    conversion_time,
    deglitch_for,
    input_divider,
    internal_clock_range,
    next_conversion_time,
    rcount_for,
    reference_divider,
    settle_count,
    settle_time,
    smallest_rcount,
    state_time,
)
from coilarray.hardware.chips.ldc1614_registers import check_value, encode
from coilarray.hardware.scan.switching import check_switching
from coilarray.hardware.scan.wiring import Wiring, first_repeated

SCHEMA = 2
"""Version of the settings in JSON."""
MOST_STATES = 255
"""Largest number of states of a scan."""
REFERENCE_DRIVE = 6
"""IDRIVE for about 33 kΩ, which the coils of the reference board have with 120 pF."""
_LARGEST_DRIVE = 31
_LONGEST_WORDS = 4096
_PREFIX, _SCANNING_PREFIX = b"coilarray1", b"coilarray-channels1"
_MARGIN = 1.1  # of the time-out on the slowest clock
_RESTART = 6e-3  # s; the watchdog's restart of a sensor takes 5.2 ms


def _from_hex(text: object) -> bytes:
    if not isinstance(text, str) or len(text) > _LONGEST_WORDS:
        raise ValueError("must be hexadecimal digits")
    return bytes.fromhex(text)


# as in JSON
_Code = Annotated[int, Field(ge=0, le=0xFFFF)]
_Words = Annotated[bytes, BeforeValidator(_from_hex)]
_Clock = Annotated[float, Field(ge=EXTERNAL_CLOCK_RANGE[0], le=INTERNAL_CLOCK_RANGE[1])]
_STRICT = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False)


@dataclass(frozen=True)
class StateSettings:
    """One state of the scan.

    By default it has the name of the measured coil. Its IDRIVE code is 0 to 31. `words` has the byte of each device
    while the state is measured. The first byte goes to the far end of the chain. Without switches `words` is empty, and
    the coil is at a `channel` of the converter, 0 to 3. Such a channel may have its own settling time and input
    divider, which are None if the values of the scan apply.
    """

    name: str
    words: _Words
    drive: Annotated[int, Field(ge=0, le=_LARGEST_DRIVE)]
    channel: Annotated[int, Field(ge=0, lt=CHANNELS)] = 0
    settle_count: _Code | None = None
    fin_divider: _Code | None = None
    __pydantic_config__ = _STRICT


@dataclass(frozen=True)
class ScanSettings:
    """Settings of a whole scan.

    `coilarray.hardware.scan.settings.scan_settings` makes and checks them.

    Parameters
    ----------
    states : tuple of StateSettings
        States in the order in which they are measured.
    safe_words : bytes
        Words that ground every end of every coil. Empty for a board without switches.
    wiring : bytes
        Encoded wiring of the switches, as `coilarray.hardware.scan.switching.switch_table` reads it.
    clock : float
        Clock of the converter in Hz, nominal or calibrated.
    external_clock : bool
        Whether the clock comes from the pin CLKIN.
    rcount, settle_count, fin_divider, fref_divider, offset, deglitch : int
        Fields of the registers RCOUNT, SETTLECOUNT, CLOCK_DIVIDERS, OFFSET of the channels in use, and of MUX_CONFIG.
    slowest_clock : float
        Slowest frequency in Hz that the converter's internal oscillator may have. Every wait is long enough for it.
    discard : int
        Number of conversions of each state that are discarded after waking.
    scanned : int
        Number of channels that the converter scans by itself, from channel 0 on. 1 for a single channel, converted all
        the time. A scanned channel that no state measures is converted as shortly as the converter allows.
    family : {"LDC", "FDC"}
        Family of the converter.
    """

    states: Annotated[tuple[StateSettings, ...], Field(min_length=1, max_length=MOST_STATES)]
    safe_words: _Words
    wiring: _Words
    clock: _Clock
    external_clock: bool
    rcount: _Code
    settle_count: _Code
    fin_divider: _Code
    fref_divider: Annotated[int, Field(ge=1, le=0x3FF)]
    offset: _Code
    deglitch: _Code
    slowest_clock: _Clock = INTERNAL_CLOCK_RANGE[0]
    discard: Annotated[int, Field(ge=0, le=MOST_DISCARDED)] = 0
    scanned: Annotated[int, Field(ge=1, le=CHANNELS)] = 1
    family: Family = "LDC"
    __pydantic_config__ = _STRICT

    def __post_init__(self) -> None:
        """Raise HardwareError for inconsistent settings."""
        devices = len(self.safe_words)
        lengths = {len(state.words) for state in self.states} - {devices}
        if lengths:
            raise HardwareError(f"states must have {devices} words each, as safe_words; got {min(lengths)}.")
        if len(self.wiring) != 8 * devices:
            raise HardwareError(f"the wiring of {devices} devices must have 8 bytes each; got {len(self.wiring)}.")
        if not 1 <= self.scanned <= CHANNELS:
            raise HardwareError(f"a converter scans 1 to {CHANNELS} channels; got {self.scanned}.")
        measured = [state.channel for state in self.states]
        if not (devices or measured):
            raise HardwareError("a scan must have at least one state; got none.")
        if devices and any(measured):
            raise HardwareError(f"switches join coils to channel 0; got channel {max(measured)}.")
        if not devices and (again := first_repeated(measured)) is not None:
            raise HardwareError(f"a channel measures one coil; channel {again} has more.")
        if any(channel not in self.channels for channel in measured):
            raise HardwareError(f"channel {max(measured)} must be among those that are scanned, {self.scanned}.")

    @property
    def wired(self) -> bool:
        """Whether coils are wired straight to the converter's channels."""
        return not self.safe_words

    @property
    def channels(self) -> tuple[int, ...]:
        """Channels that the converter converts."""
        return tuple(range(self.scanned)) if self.scanned > 1 else (self.states[0].channel,)

    @property
    def reference(self) -> float:
        """Reference frequency f_ref in Hz."""
        return self.clock / self.fref_divider

    @property
    def slowest_reference(self) -> float:
        """Slowest possible reference frequency in Hz."""
        return (self.clock if self.external_clock else min(self.clock, self.slowest_clock)) / self.fref_divider

    @property
    def registers(self) -> tuple[tuple[int, int], ...]:
        """Addresses and values to write while the converter sleeps."""
        active = _ACTIVE | {"REF_CLK_SRC": int(self.external_clock)}
        mux = {"DEGLITCH": self.deglitch}
        if self.scanned > 1:
            mux |= {"AUTOSCAN_EN": 1, "RR_SEQUENCE": self.scanned - 2}
        else:
            active |= {"ACTIVE_CHAN": self.channels[0]}
        values = [
            (0x19, error_config(self.family)),
            (0x1A, encode("CONFIG", active)),
            (0x1B, encode("MUX_CONFIG", mux)),
        ]
        for channel in self.channels:
            values += self._channel_registers(channel)
        return tuple(sorted(values))

    def drive_register(self, state: StateSettings) -> int:
        """Return register DRIVE_CURRENT of the channel of a state."""
        return encode(f"DRIVE_CURRENT{state.channel}", {f"IDRIVE{state.channel}": state.drive})

    def input_divider(self, state: StateSettings) -> int:
        """Return FIN_DIVIDER of the channel of a state."""
        return self.fin_divider if state.fin_divider is None else state.fin_divider

    @property
    def state_time(self) -> StateTime:
        """Times of the steps of one state."""
        return self._state_time(BUS_RATE)

    @property
    def period(self) -> float:
        """Shortest time from scan to scan in s."""
        return self.period_on(BUS_RATE)

    def period_on(self, bus_rate: float) -> float:
        """Shortest time between scans in s on an I²C bus with the clock `bus_rate` in Hz."""
        time = self._state_time(bus_rate)
        if self.wired:  # the converter goes on while its results are read
            return max(self.again_us * 1e-6, time.result + time.control)
        # Once per scan a register is read back, which shows whether the converter was reset.
        return len(self.states) * time.total + bus_time(reads=1, rate=bus_rate)

    @property
    def wait_us(self) -> int:
        """Time from waking to looking at STATUS in µs."""
        return math.ceil(self.state_time.until_ready * 1e6)

    @property
    def again_us(self) -> int:
        """Time from a discarded result to STATUS in µs."""
        reference, counts = self.slowest_reference, [self._counts(channel) for channel in self.channels]
        again = sum(next_conversion_time(rcount, reference) for rcount, _ in counts)
        if self.scanned > 1:  # every channel starts its sensor again
            again += sum(settle_time(settle, reference) for _, settle in counts)
        return math.ceil(again * 1e6)

    @property
    def timeout_us(self) -> int:
        """Time from waking to giving up in µs."""
        slowest = self.state_time.until_ready
        if not self.external_clock:
            slowest *= self.slowest_clock / min(self.slowest_clock, INTERNAL_CLOCK_RANGE[0])
        return math.ceil((_MARGIN * slowest + _RESTART) * 1e6)

    def check_switching(self) -> None:
        """Refuse words that make a forbidden connection."""
        if self.wired:
            return
        check_switching(self.wiring, self.safe_words, [(state.name, state.words) for state in self.states])

    @cached_property  # it is compared with the hash of every scan
    def hash(self) -> int:
        """CRC-16/CCITT-FALSE of all data sent to the board."""
        return binascii.crc_hqx(self.canonical, 0xFFFF)

    @property
    def canonical(self) -> bytes:
        """Bytes from which the hash is computed."""
        parts = [_PREFIX, bytes([len(self.safe_words)]), self.wiring, self.safe_words]
        if self.wired or self.scanned > 1:  # no microcontroller has such settings
            parts = [_SCANNING_PREFIX, *parts[1:], bytes([self.scanned, *(state.channel for state in self.states)])]
        parts += [bytes([address]) + value.to_bytes(2, "big") for address, value in self.registers]
        parts += [time.to_bytes(4, "big") for time in (self.wait_us, self.timeout_us)]
        if self.discard:
            parts.append(bytes([self.discard]) + self.again_us.to_bytes(4, "big"))
        parts.append(bytes([len(self.states)]))
        parts += [state.words + self.drive_register(state).to_bytes(2, "big") for state in self.states]
        return b"".join(parts)

    def _state_time(self, bus_rate: float) -> StateTime:
        """Compute the times of a state's steps."""
        time = state_time(
            self.rcount, self.settle_count, self.slowest_reference,
            internal_clock=self.slowest_clock, bus_rate=bus_rate, discard=self.discard,
        )  # fmt: skip
        if not self.wired and self.scanned == 1:
            return time
        reference, counts = self.slowest_reference, [self._counts(channel) for channel in self.channels]
        measured = {state.channel for state in self.states}
        time = replace(
            time,
            settle=sum(settle_time(settle, reference) for _, settle in counts),
            conversion=sum(next_conversion_time(rcount, reference) for rcount, _ in counts),
            discarded=self.discard * (self.again_us * 1e-6 + bus_time(reads=1 + len(measured), rate=bus_rate)),
        )
        if not self.wired:
            return time
        return replace(
            time,
            result=bus_time(reads=2 * len(self.states), rate=bus_rate),
            control=bus_time(reads=2, rate=bus_rate),  # STATUS, and the register that shows a reset
        )

    def _measured(self, channel: int) -> StateSettings | None:
        """Return the state that a channel measures."""
        return next((state for state in self.states if state.channel == channel), None)

    def _counts(self, channel: int) -> tuple[int, int]:
        """Return RCOUNT and SETTLECOUNT of a channel."""
        state = self._measured(channel)
        if state is None:
            return smallest_rcount(self.scanned, self.family), self.settle_count
        return self.rcount, self.settle_count if state.settle_count is None else state.settle_count

    def _channel_registers(self, channel: int) -> list[tuple[int, int]]:
        """Return addresses and values of a channel."""
        rcount, settle_count = self._counts(channel)
        state = self._measured(channel)
        dividers = {
            f"FIN_DIVIDER{channel}": self.fin_divider if state is None else self.input_divider(state),
            f"FREF_DIVIDER{channel}": self.fref_divider,
        }
        values = [
            (0x08 + channel, encode(f"RCOUNT{channel}", {f"RCOUNT{channel}": rcount})),
            (0x10 + channel, encode(f"SETTLECOUNT{channel}", {f"SETTLECOUNT{channel}": settle_count})),
            (0x14 + channel, encode(f"CLOCK_DIVIDERS{channel}", dividers)),
        ]
        if FAMILIES[self.family].has_offset:
            values.append((0x0C + channel, encode(f"OFFSET{channel}", {f"OFFSET{channel}": self.offset})))
        if state is None:
            values.append((0x1E + channel, 0))
        elif self.wired:
            values.append((0x1E + channel, self.drive_register(state)))
        return values

    def to_json(self) -> str:
        """Return the settings with their hash as one JSON line."""
        document = {"schema": SCHEMA, "hash": f"{self.hash:04X}", **asdict(self)}
        return json.dumps(document, ensure_ascii=False, default=bytes.hex)

    @classmethod
    def from_json(cls, text: str) -> ScanSettings:
        """Read settings from the JSON `text` of `to_json`.

        Examples
        --------
        >>> from coilarray.hardware.scan.wiring import load_wiring
        >>> settings = scan_settings(load_wiring())
        >>> ScanSettings.from_json(settings.to_json()) == settings
        True
        """
        document: Any = None
        try:
            document = json.loads(text)
            digest = document.pop("hash")
            if document.pop("schema") != SCHEMA:
                raise HardwareError(f"scan settings: schema must be {SCHEMA}.")
            if unknown := document.keys() - {one.name for one in fields(cls)}:
                raise HardwareError(f"scan settings: has no key {min(unknown)!r}.")
            settings = _adapter().validate_json(json.dumps(document))
        except ValidationError as error:  # it is a ValueError too
            raise HardwareError(f"scan settings: {first_error(error, document)}") from None
        except KeyError as error:
            raise HardwareError(f"scan settings: {error.args[0]} is missing.") from None
        except (AttributeError, TypeError, ValueError, RecursionError) as error:
            raise HardwareError(f"scan settings: not valid JSON: {error}.") from None
        if f"{settings.hash:04X}" != digest:
            raise HardwareError(f"scan settings: hash must be {settings.hash:04X}, that of the others; got {digest}.")
        return settings


@cache
def _adapter() -> TypeAdapter[ScanSettings]:
    return TypeAdapter(ScanSettings)


@cache  # every result is judged with it
def error_config(family: Family) -> int:
    """Return register ERROR_CONFIG of a family of converters."""
    return encode("ERROR_CONFIG", dict.fromkeys(FAMILIES[family].reported, 1))


# awake, programmed drive current, full current to start, no correction of the amplitude
_ACTIVE = {"SLEEP_MODE_EN": 0, "RP_OVERRIDE_EN": 1, "SENSOR_ACTIVATE_SEL": 0, "AUTO_AMP_DIS": 1}


@dataclass(frozen=True)
class ConverterClock:
    """Clock of a converter.

    Parameters
    ----------
    frequency : float, optional
        Frequency in Hz, measured (calibrated) or at the pin CLKIN. By default the typical internal 43.4 MHz. Any
        converter may have 35 to 55 MHz, so every wait is then for 35 MHz, a quarter longer.
    external : bool
        Whether the clock comes from the pin CLKIN.
    undivided : bool
        Whether the reference is the clock itself in cases in which a single channel would need a divider. The converter
        then scans a second channel too, briefly, with which the data sheet allows a reference of 55 MHz, or 40 MHz from
        CLKIN, instead of 35 MHz. A conversion of the same resolution takes half as long. Not verified on a device.
    """

    frequency: float | None = None
    external: bool = False
    undivided: bool = False

    def __post_init__(self) -> None:
        if self.external and self.frequency is None:
            raise HardwareError("an external clock needs its frequency.")
        require_positive("clock", self.hertz, "", HardwareError)

    @property
    def hertz(self) -> float:
        """Frequency in Hz, known or typical."""
        return INTERNAL_CLOCK if self.frequency is None else float(self.frequency)


@dataclass(frozen=True)
class Sensor:
    """Tank of a state, with the values of the reference board by default.

    Parameters
    ----------
    frequency : float
        Frequency in Hz.
    quality : float
        Largest quality factor, for the settling rule.
    drive : int
        Code IDRIVE of its drive current, 0 to 31.
    """

    frequency: float = 2e6
    quality: float = 60.0  # a quarter above that of the reference board
    drive: int = REFERENCE_DRIVE

    def __post_init__(self) -> None:
        require_positive("frequency", self.frequency, "", HardwareError)
        require_positive("quality", self.quality, "", HardwareError)
        if isinstance(self.drive, bool) or not isinstance(self.drive, int) or not 0 <= self.drive <= _LARGEST_DRIVE:
            raise HardwareError(f"a drive must be an integer from 0 to {_LARGEST_DRIVE}; got {self.drive!r}.")


def scan_settings(
    wiring: Wiring,
    plan: Sequence[ScanState] | None = None,
    *,
    sensors: Mapping[str, Sensor] | Sensor | None = None,
    clock: ConverterClock | None = None,
    rate: float | None = None,
    rcount: int | None = None,
    bus_rate: float = BUS_RATE,
    family: Family = "LDC",
    discard: int = 0,
) -> ScanSettings:
    """Make the settings of a scan.

    They are checked against the rules of the data sheet. Settling times, dividers and the input filter have the least
    values that these rules allow.

    Parameters
    ----------
    wiring : Wiring
        Wiring of the board's switches, or of its coils to the channels of the converter.
    plan : sequence of ScanState, optional
        States in which one coil is measured. Each coil in turn with all others grounded by default.
    sensors : mapping of str to Sensor, or Sensor, optional
        Frequency, quality factor and drive current by state, or of all states. Those of the reference board by default.
    clock : ConverterClock, optional
        Clock of the converter. Its own oscillator by default.
    rate : float, optional
        Scans per second to reach, all transfers on the buses included, with the largest RCOUNT that allows it. The work
        of the computer or the microcontroller between two transfers is not included.
    rcount : int, optional
        Register RCOUNT, 5 to 65535. Full resolution by default. Not together with `rate`.
    bus_rate : float
        Clock of the I²C bus in Hz, on which `rate` depends. The fastest clock that the converter allows by default.
        `coilarray.hardware.wire.ports.bus_rate` returns the clock of a port.
    family : {"LDC", "FDC"}
        Family of the converter.
    discard : int
        Number of conversions to discard after waking, 0 to 15. Users of the FDC2214, which has the same core, report
        first conversions that are far off. This is not verified.

    Returns
    -------
    ScanSettings
        The settings, checked against the rules of the data sheet.

    Raises
    ------
    HardwareError
        A state that the wiring cannot make, or a value that is outside its range or breaks a rule of the data sheet.
    NetworkError
        A state that no switches could make.

    Examples
    --------
    >>> from coilarray.hardware.scan.wiring import load_wiring
    >>> settings = scan_settings(load_wiring())
    >>> [f"{address:02X}={value:04X}" for address, value in settings.registers]
    ['08=FFFF', '0C=0000', '10=0034', '14=1002', '19=F8FD', '1A=1401', '1B=020C']
    """
    states = tuple(paper_plan(wiring.coils) if plan is None else plan)
    if not 1 <= len(states) <= MOST_STATES:
        raise HardwareError(f"a scan must have 1 to {MOST_STATES} states; got {len(states)}.")
    if (twice := first_repeated([state.name for state in states])) is not None:
        raise HardwareError(f"the states of a scan must have different names; got {twice!r} twice.")
    if rate is not None and rcount is not None:
        raise HardwareError(f"give rate or rcount, not both; got {rate} and {rcount}.")
    require_positive("bus_rate", bus_rate, "", HardwareError)
    if isinstance(discard, bool) or not isinstance(discard, int) or not 0 <= discard <= MOST_DISCARDED:
        raise HardwareError(f"discard must be an integer from 0 to {MOST_DISCARDED}; got {discard!r}.")
    tanks = [_of_state(sensors, state.name) for state in states]
    clock = clock or ConverterClock()
    channels = [wiring.channel(state.measured[0][0]) for state in states]
    slowest_clock, fastest_clock = internal_clock_range(None if clock.external else clock.frequency)
    try:
        undivided = clock.undivided and reference_divider(clock.hertz, external=clock.external) > 1
        scanned = max(*channels, 1) + 1 if undivided or len(set(channels)) > 1 else 1
        fref_divider = reference_divider(clock.hertz, external=clock.external, channels=scanned)
        slowest, fastest = (
            (clock.hertz if clock.external else oscillator) / fref_divider
            for oscillator in (slowest_clock, fastest_clock)
        )
        dividers = [input_divider(tank.frequency, slowest) for tank in tanks]
        deglitch = max(deglitch_for(tank.frequency) for tank in tanks)
        settle_counts = [settle_count(tank.frequency, tank.quality, fastest) for tank in tanks]
    except ValueError as error:
        raise HardwareError(str(error)) from None
    settings = ScanSettings(
        states=tuple(
            StateSettings(
                state.name,
                wiring.words(state),
                tank.drive,
                channel,
                # Only for a channel of its own: with switches all states share the registers of channel 0.
                settle if wiring.channels and settle != max(settle_counts) else None,
                divider if wiring.channels and divider != max(dividers) else None,
            )
            for state, tank, channel, settle, divider in zip(
                states, tanks, channels, settle_counts, dividers, strict=True
            )
        ),
        safe_words=wiring.safe_words,
        wiring=wiring.encode(),
        clock=clock.hertz,
        external_clock=clock.external,
        rcount=LARGEST_RCOUNT if rcount is None else rcount,
        settle_count=max(settle_counts),
        fin_divider=max(dividers),
        fref_divider=fref_divider,
        offset=0,
        deglitch=deglitch,
        slowest_clock=slowest_clock,
        discard=discard,
        scanned=scanned,
        family=family,
    )
    if rate is not None:
        settings = replace(settings, rcount=_rcount_of_rate(settings, rate, bus_rate))
    _check_limits(settings)
    return settings


def _of_state(sensors: Mapping[str, Sensor] | Sensor | None, state: str) -> Sensor:
    if not isinstance(sensors, Mapping):
        return sensors or Sensor()
    if state not in sensors:
        raise HardwareError(f"the sensor of {state} must be given; there is none.")
    return sensors[state]


def _rcount_of_rate(settings: ScanSettings, rate: float, bus_rate: float) -> int:
    """Return the largest RCOUNT that reaches a rate."""
    require_positive("rate", rate, " scans/s", HardwareError)
    count = len(settings.states)
    least = smallest_rcount(settings.scanned, settings.family)
    fastest = 1 / replace(settings, rcount=least).period_on(bus_rate)
    if rate > fastest:
        raise HardwareError(
            f"rate must be at most {fastest:.4g} scans/s of {count} states on an I²C bus of {bus_rate * 1e-3:g} kHz; "
            f"got {rate:g}."
        )
    # At full resolution no transfers between two scans take longer than the conversions. A stream without switches
    # discards conversions only at its start.
    conversions, reference = 1 if settings.wired else 1 + settings.discard, settings.slowest_reference
    overhead = settings.period_on(bus_rate) / count - conversions * conversion_time(settings.rcount, reference)
    return max(rcount_for((1 / (rate * count) - overhead) / conversions, reference), least)


def _check_limits(settings: ScanSettings) -> None:
    """Refuse settings that break a rule of the data sheet."""
    limits = check_clock(
        settings.clock, settings.fref_divider, external=settings.external_clock, rcount=settings.rcount,
        settle_count=settings.settle_count, channels=settings.scanned, family=settings.family,
    )  # fmt: skip
    for limit in limits:
        if not limit.kept:
            raise HardwareError(limit.refusal)
    for address, value in settings.registers:
        check_value(address, value)
    most = FAMILIES[settings.family].largest_input_divider
    if settings.fin_divider > most:
        raise HardwareError(f"fin_divider must be 1 to {most}; got {settings.fin_divider}.")
