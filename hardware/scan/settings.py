"""Settings of a scan as values, registers and JSON, for any board and for the board of a design."""

from __future__ import annotations

import binascii
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from functools import cached_property
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import BeforeValidator, ConfigDict, Field, TypeAdapter, ValidationError

from coilarray.circuit.converter_limits import Limit, drive_for
from coilarray.design.readout import INTERNAL_CLOCK, LARGEST_RCOUNT, conversion_time
from coilarray.design.scan_states import CONVERTER_PIN, ScanState, paper_plan
from coilarray.design.toml_file import first_error
from coilarray.errors import HardwareError, require_positive
from coilarray.hardware.chips import ldc1614
from coilarray.hardware.scan.wiring import Wiring, check_switching, first_repeated

if TYPE_CHECKING:
    from coilarray.circuit.network import Network
    from coilarray.circuit.noise_budget import NoiseBudget
    from coilarray.design.model import Design


SCHEMA = 3  # version of the settings in JSON
MOST_STATES = 255  # largest number of states of a scan
REFERENCE_DRIVE = 6  # IDRIVE for about 33 kΩ, which the coils of the reference board have with 120 pF
LARGEST_DRIVE = 31  # largest IDRIVE
_LONGEST_WORDS = 4096
_PREFIX, _CHANNELS_PREFIX = b"coilarray1", b"coilarray-channels1"
ERROR_CONFIG = 0xF8FD  # register ERROR_CONFIG: every flag is shown in the result and in STATUS
_MARGIN = 1.1  # of the time-out on the slowest clock
_RESTART = 6e-3  # s. The watchdog's restart of a sensor takes 5.2 ms


def _from_hex(text: object) -> bytes:
    if not isinstance(text, str) or len(text) > _LONGEST_WORDS:
        raise ValueError("must be hexadecimal digits")
    return bytes.fromhex(text)


# as in JSON
_Code = Annotated[int, Field(ge=0, le=0xFFFF)]
_Words = Annotated[bytes, BeforeValidator(_from_hex)]
_Clock = Annotated[float, Field(ge=ldc1614.EXTERNAL_CLOCK_RANGE[0], le=ldc1614.INTERNAL_CLOCK_RANGE[1])]
_STRICT = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False)


@dataclass(frozen=True)
class StateTime:
    """Times of the steps of one state, in s.

    `wake`, `settle` and `conversion` are the converter's own. `discarded` are conversions with
    their transfers, and `control` are all transfers except `result`. With RCOUNT 0xFFFF and the
    internal clock by two, six states of waking, converting and reading take 293.6 ms. Gast &
    Zimmermann (2020) print 293.5 ms, which supports these settings but does not prove them.
    """

    wake: float
    settle: float
    conversion: float
    discarded: float
    result: float
    control: float

    @property
    def until_ready(self) -> float:
        """Time in s from leaving sleep to the first result."""
        return self.wake + self.settle + self.conversion

    @property
    def total(self) -> float:
        """Time in s of all steps."""
        return self.until_ready + self.discarded + self.result + self.control


@dataclass(frozen=True)
class StateSettings:
    """One state of the scan, named after its coil."""

    name: str
    words: _Words  # the first byte goes to the far end of the chain
    drive: Annotated[int, Field(ge=0, le=LARGEST_DRIVE)]
    channel: Annotated[int, Field(ge=0, lt=ldc1614.CHANNELS)] = 0  # without switches. It may have its own:
    settle_count: _Code | None = None
    fin_divider: _Code | None = None
    __pydantic_config__ = _STRICT


@dataclass(frozen=True)
class ScanSettings:
    """Settings of a whole scan, made and checked by `scan_settings`.

    The `states` are in the order in which they are measured. `safe_words` ground every end of every
    coil, and `wiring` is the encoded wiring of the switches
    (`coilarray.hardware.scan.wiring.switch_table`). Both are empty for a board without switches.
    `clock` in Hz, nominal or calibrated, comes from the pin CLKIN if `external_clock`, and every
    wait is long enough for the `slowest_clock` in Hz that the converter's own oscillator may have.
    `rcount`, `settle_count`, `fin_divider`, `fref_divider` and `deglitch` are fields of the
    registers RCOUNT, SETTLECOUNT and CLOCK_DIVIDERS of the channels in use, and of MUX_CONFIG.
    `discard` conversions of each state are discarded after waking. With `automatic_drive` the
    converter finds every drive current itself and shows it in INIT_IDRIVE.
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
    deglitch: _Code
    slowest_clock: _Clock = ldc1614.INTERNAL_CLOCK_RANGE[0]
    discard: Annotated[int, Field(ge=0, le=ldc1614.MOST_DISCARDED)] = 0
    automatic_drive: bool = False
    __pydantic_config__ = _STRICT

    def __post_init__(self) -> None:
        devices = len(self.safe_words)
        lengths = {len(state.words) for state in self.states} - {devices}
        if lengths:
            raise HardwareError(f"states must have {devices} words each, as safe_words; got {min(lengths)}.")
        if len(self.wiring) != 8 * devices:
            raise HardwareError(f"the wiring of {devices} devices must have 8 bytes each; got {len(self.wiring)}.")
        measured = [state.channel for state in self.states]
        if not (devices or measured):
            raise HardwareError("a scan must have at least one state; got none.")
        if devices and any(measured):
            raise HardwareError(f"switches join coils to channel 0; got channel {max(measured)}.")
        if not devices and (again := first_repeated(measured)) is not None:
            raise HardwareError(f"a channel measures one coil; channel {again} has more.")

    @property
    def wired(self) -> bool:
        """Whether coils are wired straight to the converter's channels."""
        return not self.safe_words

    @property
    def channels(self) -> tuple[int, ...]:
        """Channels that the converter converts.

        Several are scanned from channel 0 on. A channel among them that no state measures is
        converted as shortly as the converter allows.
        """
        used = {state.channel for state in self.states}
        return tuple(used) if len(used) == 1 else tuple(range(max(used) + 1))

    @property
    def reference(self) -> float:
        """Reference frequency f_ref in Hz."""
        return self.clock / self.fref_divider

    @property
    def slowest_reference(self) -> float:
        """Slowest possible reference frequency in Hz."""
        return (self.clock if self.external_clock else min(self.clock, self.slowest_clock)) / self.fref_divider

    @cached_property
    def registers(self) -> tuple[tuple[int, int], ...]:
        """Addresses and values to write while the converter sleeps."""
        # awake, full current to start
        active = {"SLEEP_MODE_EN": 0, "SENSOR_ACTIVATE_SEL": 0, "REF_CLK_SRC": int(self.external_clock)}
        if not self.automatic_drive:  # programmed current, no correction of the amplitude
            active |= {"RP_OVERRIDE_EN": 1, "AUTO_AMP_DIS": 1}
        mux = {"DEGLITCH": self.deglitch}
        if len(self.channels) > 1:
            mux |= {"AUTOSCAN_EN": 1, "RR_SEQUENCE": len(self.channels) - 2}
        else:
            active |= {"ACTIVE_CHAN": self.channels[0]}
        values = [
            (0x19, ERROR_CONFIG),
            (0x1A, ldc1614.encode("CONFIG", active)),
            (0x1B, ldc1614.encode("MUX_CONFIG", mux)),
        ]
        measured = {state.channel: state for state in self.states}
        for channel in self.channels:
            rcount, settle_count = self._counts(channel)
            state = measured.get(channel)
            dividers = {
                f"FIN_DIVIDER{channel}": self.fin_divider if state is None else self.input_divider(state),
                f"FREF_DIVIDER{channel}": self.fref_divider,
            }
            values += [
                (0x08 + channel, ldc1614.encode(f"RCOUNT{channel}", {f"RCOUNT{channel}": rcount})),
                (0x0C + channel, 0),  # OFFSET
                (0x10 + channel, ldc1614.encode(f"SETTLECOUNT{channel}", {f"SETTLECOUNT{channel}": settle_count})),
                (0x14 + channel, ldc1614.encode(f"CLOCK_DIVIDERS{channel}", dividers)),
            ]
            if self.wired:
                values.append((0x1E + channel, 0 if state is None else self.drive_register(state)))
        return tuple(sorted(values))

    def drive_register(self, state: StateSettings) -> int:
        """Return register DRIVE_CURRENT of the channel of a state."""
        return ldc1614.encode(f"DRIVE_CURRENT{state.channel}", {f"IDRIVE{state.channel}": state.drive})

    def input_divider(self, state: StateSettings) -> int:
        """Return FIN_DIVIDER of the channel of a state."""
        return self.fin_divider if state.fin_divider is None else state.fin_divider

    def period(self, bus_rate: float = ldc1614.BUS_RATE) -> float:
        """Shortest time between scans in s, with an I²C clock of `bus_rate` in Hz."""
        time = self.state_time(bus_rate)
        if self.wired:  # the converter goes on while its results are read
            return max(self.again_us * 1e-6, time.result + time.control)
        # Once per scan a register is read back, which shows whether the converter was reset.
        return len(self.states) * time.total + ldc1614.bus_time(reads=1, rate=bus_rate)

    @property
    def wait_us(self) -> int:
        """Time from waking to looking at STATUS in µs."""
        return math.ceil(self.state_time().until_ready * 1e6)

    @property
    def again_us(self) -> int:
        """Time from a discarded result to STATUS in µs."""
        counts = [self._counts(channel) for channel in self.channels]
        again = sum(ldc1614.next_conversion_time(rcount, self.slowest_reference) for rcount, _ in counts)
        if len(counts) > 1:  # every channel starts its sensor again
            again += sum(ldc1614.settle_time(settle, self.slowest_reference) for _, settle in counts)
        return math.ceil(again * 1e6)

    @property
    def timeout_us(self) -> int:
        """Time from waking to giving up in µs."""
        slowest = self.state_time().until_ready
        if not self.external_clock:
            slowest *= self.slowest_clock / min(self.slowest_clock, ldc1614.INTERNAL_CLOCK_RANGE[0])
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
        if self.wired:  # no microcontroller has such settings
            channels = bytes([len(self.channels), *(state.channel for state in self.states)])
            parts = [_CHANNELS_PREFIX, *parts[1:], channels]
        parts += [bytes([address]) + value.to_bytes(2, "big") for address, value in self.registers]
        parts += [time.to_bytes(4, "big") for time in (self.wait_us, self.timeout_us)]
        if self.discard:
            parts.append(bytes([self.discard]) + self.again_us.to_bytes(4, "big"))
        parts.append(bytes([len(self.states)]))
        parts += [state.words + self.drive_register(state).to_bytes(2, "big") for state in self.states]
        return b"".join(parts)

    def state_time(self, bus_rate: float = ldc1614.BUS_RATE) -> StateTime:
        """Return the times of a state, or of all channels, with an I²C clock of `bus_rate` in Hz."""
        reference, counts = self.slowest_reference, [self._counts(channel) for channel in self.channels]
        settle = sum(ldc1614.settle_time(settle, reference) for _, settle in counts)
        if self.wired:
            states = len(self.states)
            return StateTime(
                wake=ldc1614.WAKE_CYCLES / self.slowest_clock,
                settle=settle,
                conversion=sum(ldc1614.next_conversion_time(rcount, reference) for rcount, _ in counts),
                discarded=self.discard * (self.again_us * 1e-6 + ldc1614.bus_time(reads=1 + states, rate=bus_rate)),
                result=ldc1614.bus_time(reads=2 * states, rate=bus_rate),
                control=ldc1614.bus_time(reads=2, rate=bus_rate),  # STATUS, and the register that shows a reset
            )
        result = ldc1614.bus_time(reads=2, rate=bus_rate)
        return StateTime(
            wake=ldc1614.WAKE_CYCLES / self.slowest_clock,
            settle=settle,
            conversion=conversion_time(self.rcount, reference),
            discarded=self.discard * (ldc1614.next_conversion_time(self.rcount, reference) + result),
            result=result,
            control=ldc1614.bus_time(reads=1, writes=3, rate=bus_rate) + ldc1614.SWITCH_BITS / ldc1614.BUS_RATE,
        )

    def _counts(self, channel: int) -> tuple[int, int]:
        state = next((state for state in self.states if state.channel == channel), None)
        if state is None:
            return ldc1614.smallest_rcount(len(self.channels)), self.settle_count
        return self.rcount, self.settle_count if state.settle_count is None else state.settle_count

    def to_json(self) -> str:
        """Return the settings with their hash as one JSON line."""
        document = {"schema": SCHEMA, "hash": f"{self.hash:04X}", **asdict(self)}
        return json.dumps(document, ensure_ascii=False, default=bytes.hex)

    @classmethod
    def from_json(cls, text: str) -> ScanSettings:
        """Read settings from the JSON `text` of `to_json`.

        >>> from coilarray.hardware.scan.wiring import load_wiring
        >>> settings = scan_settings(load_wiring())
        >>> ScanSettings.from_json(settings.to_json()) == settings
        True
        """
        document: Any = None
        try:
            document = json.loads(text)
            digest, schema = document.pop("hash"), document.pop("schema")
            if schema != SCHEMA:
                raise HardwareError(f"scan settings: schema must be {SCHEMA}; got {str(schema)[:40]!r}.")
            if unknown := document.keys() - {one.name for one in fields(cls)}:
                raise HardwareError(f"scan settings: has no key {min(unknown)!r}.")
            settings = TypeAdapter(cls).validate_json(json.dumps(document))
        except ValidationError as error:  # it is a ValueError too
            raise HardwareError(f"scan settings: {first_error(error, document)}") from None
        except (AttributeError, KeyError, TypeError, ValueError, RecursionError) as error:
            raise HardwareError(f"scan settings: not valid JSON, or a key is missing: {error}.") from None
        if f"{settings.hash:04X}" != digest:
            raise HardwareError(f"scan settings: hash must be {settings.hash:04X}, that of the others; got {digest}.")
        return settings


@dataclass(frozen=True)
class ConverterClock:
    """Clock of a converter.

    Its `frequency` in Hz is measured (calibrated) or at the pin CLKIN, if it is `external`. By
    default it is the typical internal 43.4 MHz. Any converter may have 35 to 55 MHz, so every wait
    is then for 35 MHz, a quarter longer.
    """

    frequency: float | None = None
    external: bool = False

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
    """Tank of a state, by default of the reference board.

    The `frequency` is in Hz, the `quality` factor the largest, for the settling rule, and `drive`
    the code IDRIVE of its drive current, 0 to 31.
    """

    frequency: float = 2e6
    quality: float = 60.0  # a quarter above that of the reference board
    drive: int = REFERENCE_DRIVE

    def __post_init__(self) -> None:
        require_positive("frequency", self.frequency, "", HardwareError)
        require_positive("quality", self.quality, "", HardwareError)
        if isinstance(self.drive, bool) or not isinstance(self.drive, int) or not 0 <= self.drive <= LARGEST_DRIVE:
            raise HardwareError(f"a drive must be an integer from 0 to {LARGEST_DRIVE}; got {self.drive!r}.")


def scan_settings(
    wiring: Wiring,
    plan: Sequence[ScanState] | None = None,
    *,
    sensors: Mapping[str, Sensor] | Sensor | None = None,
    clock: ConverterClock | None = None,
    rate: float | None = None,
    rcount: int | None = None,
    bus_rate: float = ldc1614.BUS_RATE,
    discard: int = 0,
) -> ScanSettings:
    """Make the settings of a scan, with the least times and dividers.

    In every state of the `plan` one coil of the `wiring` is measured, by default each in turn with
    all others grounded. The `sensors` are given by state or for all, by default as of the reference
    board. `clock` is the converter's own oscillator by default.

    A `rate` in scans per second takes the largest RCOUNT that allows it with all transfers at the
    `bus_rate` in Hz, by default the fastest clock of the I²C bus
    (`coilarray.hardware.wire.ports.bus_rate` returns a port's). The work of the computer or the
    microcontroller between transfers is not included. Or the register `rcount` is 5 to 65535, by
    default full resolution. `discard` is the number of conversions to discard after waking, 0 to
    15: users of the FDC2214, which has the same core, report first conversions that are far off,
    which is not verified.

    Raises HardwareError for a state that the wiring cannot make, or a value outside its range or
    against a rule of the data sheet, and NetworkError for a state that no switches could make.

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
    if isinstance(discard, bool) or not isinstance(discard, int) or not 0 <= discard <= ldc1614.MOST_DISCARDED:
        raise HardwareError(f"discard must be an integer from 0 to {ldc1614.MOST_DISCARDED}; got {discard!r}.")
    if not isinstance(sensors, Mapping):
        sensors = dict.fromkeys((state.name for state in states), sensors or Sensor())
    if missing := [state.name for state in states if state.name not in sensors]:
        raise HardwareError(f"the sensor of {missing[0]} must be given; there is none.")
    tanks = [sensors[state.name] for state in states]
    clock = clock or ConverterClock()
    channels = [wiring.channel(state.measured[0][0]) for state in states]
    slowest_clock, fastest_clock = ldc1614.INTERNAL_CLOCK_RANGE
    if clock.frequency is not None and not clock.external:
        slowest_clock, fastest_clock = (clock.frequency * (1 + sign * ldc1614.CLOCK_TOLERANCE) for sign in (-1, 1))
    try:
        fref_divider = ldc1614.reference_divider(clock.hertz, external=clock.external, channels=len(set(channels)))
        slowest, fastest = (
            (clock.hertz if clock.external else oscillator) / fref_divider
            for oscillator in (slowest_clock, fastest_clock)
        )
        dividers = [ldc1614.input_divider(tank.frequency, slowest) for tank in tanks]
        deglitch = max(ldc1614.deglitch_for(tank.frequency) for tank in tanks)
        settle_counts = [ldc1614.settle_count(tank.frequency, tank.quality, fastest) for tank in tanks]
    except ValueError as error:
        raise HardwareError(str(error)) from None
    settings = ScanSettings(
        states=tuple(
            StateSettings(
                state.name,
                wiring.words(state),
                tank.drive,
                channel,
                # Only for a channel of its own: with switches all states share channel 0.
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
        deglitch=deglitch,
        slowest_clock=slowest_clock,
        discard=discard,
    )
    if rate is not None:
        settings = replace(settings, rcount=_rcount_of_rate(settings, rate, bus_rate))
    _check_limits(settings)
    return settings


def _rcount_of_rate(settings: ScanSettings, rate: float, bus_rate: float) -> int:
    require_positive("rate", rate, " scans/s", HardwareError)
    count = len(settings.states)
    least = ldc1614.smallest_rcount(len(settings.channels))
    fastest = 1 / replace(settings, rcount=least).period(bus_rate)
    if rate > fastest:
        raise HardwareError(
            f"rate must be at most {fastest:.4g} scans/s of {count} states on an I²C bus of {bus_rate * 1e-3:g} kHz; "
            f"got {rate:g}."
        )
    # A stream without switches discards conversions only at its start.
    conversions, reference = 1 if settings.wired else 1 + settings.discard, settings.slowest_reference
    overhead = settings.period(bus_rate) / count - conversions * conversion_time(settings.rcount, reference)
    # A duration that is a multiple of a clock must not lose a count by rounding.
    clocks = math.floor((1 / (rate * count) - overhead) / conversions * reference * (1 + 1e-12))
    return min(max((clocks - 4) // 16, least), LARGEST_RCOUNT)


def _check_limits(settings: ScanSettings) -> None:
    clocks = ldc1614.EXTERNAL_CLOCK_RANGE if settings.external_clock else ldc1614.INTERNAL_CLOCK_RANGE
    for limit in (
        Limit("clock (Hz)", settings.clock, *clocks),
        Limit("RCOUNT", settings.rcount, ldc1614.smallest_rcount(len(settings.channels)), LARGEST_RCOUNT),
        Limit("SETTLECOUNT", settings.settle_count, 0, 0xFFFF),
    ):
        if not limit.kept:
            raise HardwareError(limit.refusal)


def board_network(design: Design, *, wired: bool = False) -> Network:
    """Return the circuit of a design, without switches if `wired`."""
    from coilarray.circuit.coupling import design_circuit

    network = design_circuit(design)
    if not wired:
        return network
    switches = replace(design.circuit.switches, on_resistance=0.0)
    if design.circuit.part is not None:  # of whose capacitances the pins of the converter remain
        bus = min(switches.bus_capacitance, CONVERTER_PIN)
        switches = replace(switches, off_capacitance=0.0, terminal_capacitance=0.0, bus_capacitance=bus)
    return replace(network, switches=switches)


def board_budget(design: Design, settings: ScanSettings, *, baseline_scans: int | None = None) -> NoiseBudget:
    """Return the noise budget of all states with a scan's settings."""
    # With `baseline_scans` for L_0 a reading is a single scan. Other values are those of the design's `Readout`.
    from coilarray.circuit.noise_budget import noise_budget  # not needed by the emulator

    readout = replace(
        design.readout,
        rcount=settings.rcount,
        clock=settings.clock,
        external_clock=settings.external_clock,
        reference_divider=settings.fref_divider,
    )
    if baseline_scans is not None:
        readout = replace(readout, averaged_scans=1, baseline_scans=baseline_scans)
    return noise_budget(design, readout=readout, network=board_network(design, wired=settings.wired))


_QUALITY_MARGIN = 1.25  # for the settling time


def design_settings(
    design: Design,
    wiring: Wiring,
    *,
    states: Sequence[str] | None = None,
    rate: float | None = None,
    bus_rate: float = ldc1614.BUS_RATE,
    clock: ConverterClock | None = None,
    drives: Mapping[str, int] | int | None = None,
    discard: int = 0,
) -> ScanSettings:
    """Make settings for the coils of a `design`.

    They are among the coils of the `wiring`. A coil without a channel counts as open. `states` are
    names of the design's scan plan, by default all, or without switches those of wired coils.
    `drives` has IDRIVE by coil or for all, by default from the parallel resistance of every state.
    `rate`, `bus_rate`, `clock` and `discard` are as in `scan_settings`.

    Raises HardwareError as `scan_settings`, for coils that the wiring does not have, and for a coil
    that the converter cannot drive, and NetworkError for a state without a resonance.
    """
    from coilarray.circuit.network import loaded_quality, resonate  # slow, and not needed by the emulator

    names = design.array.names
    unknown = [name for name in wiring.coils if name not in names] if wiring.channels else []
    if unknown:
        raise HardwareError(
            f"the design {design.name} has no coil {unknown[0]!r} of the wiring {wiring.name}; "
            f"there are {', '.join(names)}."
        )
    unknown = [name for name in names if name not in wiring.coils]
    if unknown and not wiring.channels:
        raise HardwareError(
            f"wiring {wiring.name} has no coil {unknown[0]!r} of the design {design.name}; there are "
            f"{', '.join(wiring.coils)}: give the wiring file of this board."
        )
    known = [state.name for state in design.plan]
    for name in states or ():
        if name not in known:
            raise HardwareError(f"the scan of {design.name} has no state {name!r}; there are {', '.join(known)}.")
    if states and len(set(states)) < len(states):
        raise HardwareError(f"states must be named once each; got {', '.join(states)}.")
    plan = tuple(state for state in design.plan if not states or state.name in states)
    if unknown:
        plan = tuple(
            replace(state, exceptions={**state.exceptions, **dict.fromkeys(unknown, "open")})
            for state in plan
            if states or {coil for coil, _ in state.measured} <= set(wiring.coils)
        )
        if not plan:
            raise HardwareError(f"no state of the scan measures {' or '.join(wiring.coils)} alone.")
    network = board_network(design, wired=bool(wiring.channels))
    if isinstance(drives, Mapping) and (strange := [coil for coil in drives if coil not in wiring.coils]):
        raise HardwareError(f"a drive names the coil {strange[0]!r}; there are {', '.join(wiring.coils)}.")
    sensors, states_of_wiring = {}, []
    for state in plan:
        coil, result = state.measured[0][0], resonate(network, state)
        code = drives.get(coil) if isinstance(drives, Mapping) else drives
        if code is None:
            drive = drive_for(result.parallel_resistance)
            if drive is None:
                raise HardwareError(
                    f"the converter has no drive current for {coil}, whose parallel resistance is "
                    f"{result.parallel_resistance * 1e-3:.3g} kΩ; give its IDRIVE."
                )
            code = drive.code
        sensors[state.name] = Sensor(result.frequency, _QUALITY_MARGIN * loaded_quality(network, result), code)
        exceptions = {one: passive for one, passive in state.exceptions.items() if one in wiring.coils}
        states_of_wiring.append(replace(state, exceptions=exceptions))
    return scan_settings(
        wiring, states_of_wiring, sensors=sensors, clock=clock, rate=rate, bus_rate=bus_rate, discard=discard
    )
