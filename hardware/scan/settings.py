"""Settings of a board for a scan, and their hash.

The hash ties a reading to the settings.
"""

from __future__ import annotations

import binascii
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cache, cached_property

from coilarray.design.readout import INTERNAL_CLOCK
from coilarray.design.scan_states import ScanState, paper_plan
from coilarray.errors import HardwareError, require_positive
from coilarray.hardware.chips.converters import FAMILIES, Family
from coilarray.hardware.chips.ldc1614 import (
    BUS_RATE,
    CHANNELS,
    INTERNAL_CLOCK_RANGE,
    LARGEST_RCOUNT,
    MOST_DISCARDED,
    StateTime,
    bus_time,
    conversion_time,
    internal_clock_range,
    next_conversion_time,
    rcount_for,
    settle_time,
    state_time,
)
from coilarray.hardware.chips.ldc1614_limits import (
    check_clock,
    deglitch_for,
    input_divider,
    reference_divider,
    smallest_rcount,
)
from coilarray.hardware.chips.ldc1614_limits import settle_count as settle_count_of
from coilarray.hardware.chips.ldc1614_registers import check_value, encode
from coilarray.hardware.scan.closure import check_switching
from coilarray.hardware.scan.settings_file import MOST_STATES, SCHEMA, settings_values
from coilarray.hardware.scan.wiring import Wiring, first_repeated

FULL_RESOLUTION = LARGEST_RCOUNT
"""RCOUNT of the longest conversion."""
REFERENCE_DRIVE = 6
"""IDRIVE for about 33 kΩ, which the coils of the reference board have with 120 pF."""
_LARGEST_DRIVE = 31
_PREFIX, _SCANNING_PREFIX = b"coilarray1", b"coilarray-channels1"
_MARGIN = 1.1  # of the time-out on the slowest clock
_RESTART = 6e-3  # s; the watchdog's restart of a sensor takes 5.2 ms


@dataclass(frozen=True)
class StateSettings:
    """One state of the scan.

    By default it has the name of the measured coil. Its IDRIVE code is 0 to 31. `words` has the byte of each device
    while the state is measured. The first byte goes to the far end of the chain. Without switches `words` is empty, and
    the coil is at a `channel` of the converter, 0 to 3. Such a channel may have its own settling time and input
    divider, which are None if the values of the scan apply.
    """

    name: str
    words: bytes
    drive: int
    channel: int = 0
    settle_count: int | None = None
    fin_divider: int | None = None


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
        Encoded wiring of the switches, as `coilarray.hardware.scan.closure.switch_table` reads it.
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

    states: tuple[StateSettings, ...]
    safe_words: bytes
    wiring: bytes
    clock: float
    external_clock: bool
    rcount: int
    settle_count: int
    fin_divider: int
    fref_divider: int
    offset: int
    deglitch: int
    slowest_clock: float = INTERNAL_CLOCK_RANGE[0]
    discard: int = 0
    scanned: int = 1
    family: Family = "LDC"

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
        """Whether coils are wired straight to the converter's channels.

        The board then has no switches.
        """
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
        """Addresses and values to write while the converter sleeps.

        The addresses are ascending. CONFIG has the active value. A field that its register does not take raises a
        HardwareError.
        """
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
        """Return register DRIVE_CURRENT of the channel of a state.

        Returns
        -------
        int
            The word of 16 bits.
        """
        return encode(f"DRIVE_CURRENT{state.channel}", {f"IDRIVE{state.channel}": state.drive})

    def input_divider(self, state: StateSettings) -> int:
        """Return FIN_DIVIDER of the channel of a state.

        Returns
        -------
        int
            The divider, 1 or more.
        """
        return self.fin_divider if state.fin_divider is None else state.fin_divider

    @property
    def state_time(self) -> StateTime:
        """Times of the steps of one state.

        They hold for the slowest possible clock and an I²C bus of 400 kHz. Without switches they are the times of all
        states together.
        """
        return self._state_time(BUS_RATE)

    @property
    def period(self) -> float:
        """Shortest time from scan to scan in s.

        It includes all work of the buses, on an I²C bus of 400 kHz.
        """
        return self.period_on(BUS_RATE)

    def period_on(self, bus_rate: float) -> float:
        """Shortest time between scans on an I²C bus in s.

        It runs from scan to scan. The clock of the bus is `bus_rate` in Hz, positive and finite.

        Returns
        -------
        float
            Time in s.
        """
        time = self._state_time(bus_rate)
        if self.wired:  # the converter goes on while its results are read
            return max(self.again_us * 1e-6, time.result + time.control)
        # Once per scan a register is read back, which shows whether the converter was reset.
        return len(self.states) * time.total + bus_time(reads=1, rate=bus_rate)

    @property
    def wait_us(self) -> int:
        """Time from waking to looking at STATUS in µs.

        This first look must come after the pin INTB was asserted.
        """
        return math.ceil(self.state_time.until_ready * 1e6)

    @property
    def again_us(self) -> int:
        """Time from a discarded result to STATUS in µs.

        It runs from reading the result to the next look at STATUS.
        """
        reference, counts = self.slowest_reference, [self._counts(channel) for channel in self.channels]
        again = sum(next_conversion_time(rcount, reference) for rcount, _ in counts)
        if self.scanned > 1:  # every channel starts its sensor again
            again += sum(settle_time(settle, reference) for _, settle in counts)
        return math.ceil(again * 1e6)

    @property
    def timeout_us(self) -> int:
        """Time from waking to giving up in µs.

        The time after a discarded result is the same. It allows for the slowest clock of all converters and one restart
        of the sensor.
        """
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
        """CRC-16/CCITT-FALSE of all data sent to the board.

        `hardware/firmware/PROTOCOL.md` defines it.
        """
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
        """Compute the times of a state's steps.

        Without switches the times of all states together are returned.
        """
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
        """Return the state that a channel measures.

        It is the first of the states that switches connect to the channel, or None for no state.
        """
        return next((state for state in self.states if state.channel == channel), None)

    def _counts(self, channel: int) -> tuple[int, int]:
        """Return RCOUNT and SETTLECOUNT of a channel."""
        state = self._measured(channel)
        if state is None:
            return smallest_rcount(self.scanned, self.family), self.settle_count
        return self.rcount, self.settle_count if state.settle_count is None else state.settle_count

    def _channel_registers(self, channel: int) -> list[tuple[int, int]]:
        """Return addresses and values of a channel.

        Its drive current is included only if it is always the same.
        """
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
        """Return the settings with their hash as one JSON line.

        `from_json` reads it.

        Returns
        -------
        str
            One line of JSON.
        """
        document = {"schema": SCHEMA, "hash": f"{self.hash:04X}", **asdict(self)}
        return json.dumps(document, ensure_ascii=False, default=bytes.hex)

    @classmethod
    def from_json(cls, text: str) -> ScanSettings:
        """Read settings from the JSON of `to_json`.

        Returns
        -------
        ScanSettings
            The same settings.

        Raises
        ------
        HardwareError
            Invalid text, a value outside its range, or settings that do not match the given hash.

        Examples
        --------
        >>> from coilarray.hardware.scan.wiring import load_wiring
        >>> settings = scan_settings(load_wiring())
        >>> ScanSettings.from_json(settings.to_json()) == settings
        True
        """
        given, digest = settings_values(text)
        states = tuple(StateSettings(**state) for state in given.pop("states"))
        settings = ScanSettings(states=states, **given)
        if f"{settings.hash:04X}" != digest:
            raise HardwareError(f"scan settings: hash must be {settings.hash:04X}, that of the others; got {digest}.")
        return settings


@cache  # every result is judged with it
def error_config(family: Family) -> int:
    """Return register ERROR_CONFIG of a family of converters.

    Every error is reported.

    >>> hex(error_config("LDC")), hex(error_config("FDC"))
    ('0xf8fd', '0x3821')
    """
    return encode("ERROR_CONFIG", dict.fromkeys(FAMILIES[family].reported, 1))


# awake, programmed drive current, full current to start, no correction of the amplitude
_ACTIVE = {"SLEEP_MODE_EN": 0, "RP_OVERRIDE_EN": 1, "SENSOR_ACTIVATE_SEL": 0, "AUTO_AMP_DIS": 1}


def scan_settings(
    wiring: Wiring,
    plan: Sequence[ScanState] | None = None,
    *,
    rate: float | None = None,
    rcount: int | None = None,
    bus_rate: float = BUS_RATE,
    clock: float | None = None,
    external_clock: bool = False,
    undivided: bool = False,
    family: Family = "LDC",
    frequency: Mapping[str, float] | float = 2e6,
    quality: Mapping[str, float] | float = 60.0,
    drives: Mapping[str, int] | int = REFERENCE_DRIVE,
    settle_count: int | None = None,
    fin_divider: int | None = None,
    fref_divider: int | None = None,
    offset: int = 0,
    deglitch: int | None = None,
    discard: int = 0,
) -> ScanSettings:
    """Make the settings of a scan.

    They are checked against the rules of the data sheet.

    Parameters
    ----------
    wiring : Wiring
        Wiring of the board's switches, or of its coils to the channels of the converter.
    plan : sequence of ScanState, optional
        States in which one coil is measured. Each coil in turn with all others grounded by default.
    rate : float, optional
        Scans per second to reach, all transfers on the buses included, with the largest RCOUNT that allows it. The work
        of the computer or the microcontroller between two transfers is not included.
    rcount : int, optional
        Register RCOUNT, 5 to 65535. Full resolution by default. Not together with `rate`.
    bus_rate : float
        Clock of the I²C bus in Hz, on which `rate` depends. The fastest clock that the converter allows by default.
        `coilarray.hardware.wire.ports.bus_rate` returns the clock of a port.
    clock : float, optional
        Clock of the converter in Hz, measured (calibrated) or at the pin CLKIN. By default the typical internal 43.4
        MHz. Any converter may have 35 to 55 MHz, so every wait is then for 35 MHz, a quarter longer.
    external_clock : bool
        Whether the clock comes from the pin CLKIN.
    undivided : bool
        Whether the reference is the clock itself in cases in which a single channel would need a divider. The converter
        then scans a second channel too, briefly, with which the data sheet allows a reference of 55 MHz, or 40 MHz from
        CLKIN, instead of 35 MHz. A conversion of the same resolution takes half as long. Not verified on a device.
    family : {"LDC", "FDC"}
        Family of the converter.
    frequency : mapping of str to float, or float
        Frequency of the sensors in Hz, by state or of all.
    quality : mapping of str to float, or float
        Largest quality factor of the sensors likewise, for the settling rule. By default a quarter above the reference
        board's quality factor.
    drives : mapping of str to int, or int
        IDRIVE of each measured coil, or of all.
    settle_count, fin_divider, fref_divider, deglitch : int, optional
        Register fields. By default the least values that the rules allow.
    offset : int
        Register OFFSET0.
    discard : int
        Number of conversions to discard after waking, 0 to 15. Users of the FDC2214, which has the same core, report
        first conversions that are far off. This is not verified. The self-test of a board measures the number that it
        needs.

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
    names = [state.name for state in states]
    frequencies, qualities = _of_each("frequency", frequency, names), _of_each("quality", quality, names)
    if external_clock and clock is None:
        raise HardwareError("an external clock needs its frequency.")
    for name, value in (("bus_rate", bus_rate), ("clock", INTERNAL_CLOCK if clock is None else clock)):
        require_positive(name, value, "", HardwareError)
    if isinstance(discard, bool) or not isinstance(discard, int) or not 0 <= discard <= MOST_DISCARDED:
        raise HardwareError(f"discard must be an integer from 0 to {MOST_DISCARDED}; got {discard!r}.")
    channels = [wiring.channel(state.measured[0][0]) for state in states]
    slowest_clock, fastest_clock = internal_clock_range(None if external_clock else clock)
    clock = INTERNAL_CLOCK if clock is None else clock
    try:
        scanned = _scanned(channels, undivided=undivided and reference_divider(clock, external=external_clock) > 1)
        if fref_divider is None:
            fref_divider = reference_divider(clock, external=external_clock, channels=scanned)
        if fref_divider < 1:
            raise HardwareError(f"fref_divider must be 1 to 1023; got {fref_divider}.")
        slowest, fastest = (
            (clock if external_clock else oscillator) / fref_divider for oscillator in (slowest_clock, fastest_clock)
        )
        dividers = [_at_least("fin_divider", fin_divider, input_divider(one, slowest)) for one in frequencies]
        deglitch = _at_least("deglitch", deglitch, max(deglitch_for(one) for one in frequencies))
        settle_counts = [
            _at_least("settle_count", settle_count, settle_count_of(one, factor, fastest))
            for one, factor in zip(frequencies, qualities, strict=True)
        ]
    except ValueError as error:
        raise HardwareError(str(error)) from None
    if offset and not FAMILIES[family].has_offset:
        raise HardwareError(f"offset must be 0, as an FDC has no register for it; got {offset}.")
    least = min(one / divider for one, divider in zip(frequencies, dividers, strict=True)) / fastest
    if not 0 <= offset / (1 << 16) < least:
        raise HardwareError(
            f"offset must be 0 to less than {least * (1 << 16):.0f}, the code of the sensor itself; got {offset}."
        )
    settings = ScanSettings(
        states=tuple(
            StateSettings(
                state.name,
                wiring.words(state),
                _drive(drives, state.measured[0][0]),
                channel,
                # Only for a channel of its own: with switches all states share the registers of channel 0.
                settle if wiring.channels and settle != max(settle_counts) else None,
                divider if wiring.channels and divider != max(dividers) else None,
            )
            for state, channel, settle, divider in zip(states, channels, settle_counts, dividers, strict=True)
        ),
        safe_words=wiring.safe_words,
        wiring=wiring.encode(),
        clock=float(clock),
        external_clock=external_clock,
        rcount=FULL_RESOLUTION if rcount is None else rcount,
        settle_count=max(settle_counts),
        fin_divider=max(dividers),
        fref_divider=fref_divider,
        offset=offset,
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


def _of_each(name: str, values: Mapping[str, float] | float, states: Sequence[str]) -> list[float]:
    """Return a value for each state, all positive and finite."""
    if isinstance(values, Mapping) and (missing := [state for state in states if state not in values]):
        raise HardwareError(f"the {name} of {missing[0]} must be given; there is none.")
    each = [values[state] if isinstance(values, Mapping) else values for state in states]
    for value in each:
        require_positive(name, value, "", HardwareError)
    return each


def _scanned(channels: Sequence[int], *, undivided: bool) -> int:
    """Count the channels that the converter scans.

    The states are at the given channels.
    """
    return max(*channels, 1) + 1 if undivided or len(set(channels)) > 1 else 1


def _at_least(name: str, value: int | None, least: int) -> int:
    if value is None:
        return least
    if value < least:
        raise HardwareError(f"{name} must be at least {least} for this frequency and quality; got {value}.")
    return value


def _drive(drives: Mapping[str, int] | int, coil: str) -> int:
    """Return the checked IDRIVE of a coil."""
    drive = drives if isinstance(drives, int) else drives.get(coil)
    if drive is None:
        raise HardwareError(f"drives must name every measured coil; got none for {coil}.")
    if isinstance(drive, bool) or not isinstance(drive, int) or not 0 <= drive <= _LARGEST_DRIVE:
        raise HardwareError(f"the drive of {coil} must be an integer from 0 to {_LARGEST_DRIVE}; got {drive!r}.")
    return drive


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
