"""Driver of the converter and the switches on their buses.

It runs the steps sleep, switch, wake, wait, read and check. It stores the known state of the chips: whether the
converter sleeps, and which words the switches hold.
"""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from dataclasses import dataclass

from coilarray.errors import HardwareError
from coilarray.hardware.chips.ldc1614 import CHANNELS
from coilarray.hardware.chips.ldc1614_registers import ASLEEP, DEVICE, MANUFACTURER, register, registers
from coilarray.hardware.scan.readings import RawSample, SampleFault, ready_status
from coilarray.hardware.scan.settings import ScanSettings
from coilarray.hardware.wire.buses import BusFault, BusTimeout, Clock, RegisterBus, SwitchChain

ATTEMPTS = 3
"""Number of attempts at a step that must not fail."""
BUS_FAULTS = (SampleFault.NOT_ACKNOWLEDGED, SampleFault.BUS_TIMEOUT)
"""Faults of a sample that come from the bus to the converter."""
_ADDRESS = {name: found.address for name, found in registers().items()}
_OF_ALL = ("ERROR_CONFIG", "CONFIG", "MUX_CONFIG")
_OF_A_CHANNEL = ("RCOUNT", "SETTLECOUNT", "CLOCK_DIVIDERS")
_DATA_MSB, _DATA_LSB = ([_ADDRESS[f"DATA{channel}_{half}"] for channel in range(CHANNELS)] for half in ("MSB", "LSB"))
_STATUS, _CONFIG, _RESET_DEV = _ADDRESS["STATUS"], _ADDRESS["CONFIG"], _ADDRESS["RESET_DEV"]
_CLOCK_DIVIDERS, _DRIVE_CURRENTS = (
    [_ADDRESS[f"{name}{channel}"] for channel in range(CHANNELS)] for name in ("CLOCK_DIVIDERS", "DRIVE_CURRENT")
)
_DRIVE_MASK = register("DRIVE_CURRENT0").field("IDRIVE0").mask  # the chip writes any value into the bits below
_DATA_READY, _ERRORS, _ERROR_FLAGS = 0x0040, 0xFF00, 0x3F00  # bits of STATUS
_FIXED_DRIVE = register("CONFIG").field("RP_OVERRIDE_EN").mask
_RESET = 0x8000
_RESET_TIME = 2e-3  # s; the data sheet gives it for the pin SD and no time for the register
LOOK_AGAIN = 1e-3
"""Time in s between two looks at STATUS."""


@dataclass(frozen=True)
class ChipSettings:
    """Settings of a scan as register values and switch words."""

    names: tuple[str, ...]
    channels: tuple[int, ...]  # of the states
    scanning: bool  # whether the converter scans several channels
    words: tuple[bytes, ...]  # of the switches in each state
    drives: tuple[int, ...]  # register DRIVE_CURRENT0 in each state; empty if coils are wired to channels
    asleep: tuple[tuple[int, int], ...]  # addresses and values of the registers while the converter sleeps
    active: int  # register CONFIG while the converter is awake
    wait: float  # s, until the first look at STATUS
    timeout: float  # s, until giving up
    discard: int  # conversions to discard
    again: float  # s, from a discarded conversion until the next look
    turn: float  # s, from result to result of a converter that stays awake, with its nominal clock
    hash: int

    @staticmethod
    def of(settings: ScanSettings) -> ChipSettings:
        """Encode settings of a scan."""
        given = dict(settings.registers)
        needed = [*_OF_ALL, *(f"{name}{channel}" for name in _OF_A_CHANNEL for channel in settings.channels)]
        if len(given) < len(settings.registers) or not {_ADDRESS[name] for name in needed} <= given.keys():
            raise HardwareError(f"the settings must have the registers {', '.join(needed)}, each once.")
        if given[_CONFIG] & ASLEEP:
            raise HardwareError("the settings must have CONFIG as it is while the converter is awake.")
        return ChipSettings(
            names=tuple(state.name for state in settings.states),
            channels=tuple(state.channel for state in settings.states),
            scanning=len(settings.channels) > 1,
            words=tuple(state.words for state in settings.states),
            drives=() if settings.wired else tuple(settings.drive_register(state) for state in settings.states),
            asleep=tuple(sorted((given | {_CONFIG: given[_CONFIG] | ASLEEP}).items())),
            active=given[_CONFIG],
            wait=settings.wait_us * 1e-6,
            timeout=settings.timeout_us * 1e-6,
            discard=settings.discard,
            again=settings.again_us * 1e-6,
            turn=settings.again_us * 1e-6 * settings.slowest_reference / settings.reference,
            hash=settings.hash,
        )


class ChipDriver:
    """Driver of the converter on a bus and the switches."""

    def __init__(self, bus: RegisterBus, switches: SwitchChain, clock: Clock) -> None:
        self.bus, self.clock = bus, clock
        self._switches = switches
        self._held: bytes | None = None  # words of the switches; None if they are not known
        self._sleep_word = register("CONFIG").reset
        self.asleep = False
        """Whether the converter was put to sleep and not woken since."""
        self.ready_at = 0.0
        """Time in s by the clock at which results were last seen to be ready."""
        self.came = False
        """Whether they became ready between two looks. Otherwise the first look found them."""

    def identity(self) -> tuple[int, int]:
        """Read the registers MANUFACTURER_ID and DEVICE_ID."""
        return self.bus.read(_ADDRESS["MANUFACTURER_ID"]), self.bus.read(_ADDRESS["DEVICE_ID"])

    def sleep(self, attempts: int = ATTEMPTS) -> None:
        """Put the converter to sleep."""
        while True:
            attempts -= 1
            try:
                self.bus.write(_CONFIG, self._sleep_word)
            except BusFault:
                if not attempts:
                    raise
                with contextlib.suppress(BusFault):
                    self.bus.clear()
            else:
                self.asleep = True
                return

    def wake(self, settings: ChipSettings, drive: int | None = None) -> None:
        """Start converting."""
        if drive is not None:
            self.bus.write(_DRIVE_CURRENTS[0], drive)
        self.asleep = False  # first, because the write may be cut off after it was done
        self.bus.write(_CONFIG, settings.active)

    def results(self, settings: ChipSettings, wait: float | None = None) -> tuple[RawSample, ...]:
        """Wait for the next results of all channels.

        Each result is read once if states share a channel. The first look at STATUS comes after `wait` in s. Without
        `wait`, the converter was just woken, and its first conversions are discarded according to the settings. If no
        result is read, the samples have a fault. If the converter chose its own drive current, this current is read
        too, before sleep can clear it.
        """
        channels = tuple(dict.fromkeys(settings.channels))
        looks = self._ready(settings.wait if wait is None else wait, settings.timeout)
        for _ in range(settings.discard if wait is None else 0):
            if looks is not None:
                for channel in channels:
                    self.bus.read(_DATA_MSB[channel])  # clears its flags
                looks = self._ready(settings.again, settings.timeout)
        if looks is None:
            return (no_sample(SampleFault.NO_RESULT),) * len(channels)
        return tuple(self._sample(settings, channel, looks) for channel in channels)

    def _ready(self, wait: float, timeout: float) -> list[int] | None:
        """Wait until results are ready."""
        start, looks = self.clock.now(), []
        self.clock.sleep(wait)
        while True:
            passed = self.clock.now() - start  # before the look, so that a later pause of the computer does not count
            looks.append(self.bus.read(_STATUS))
            if looks[-1] & _DATA_READY:
                self.ready_at, self.came = start + passed, len(looks) > 1
                return looks
            if passed >= timeout:
                return None
            self.clock.sleep(LOOK_AGAIN)

    def _sample(self, settings: ChipSettings, channel: int, looks: Sequence[int]) -> RawSample:
        """Read the result of a channel.

        Reading STATUS clears its errors, so all looks count.
        """
        try:
            msb, lsb = self.bus.read(_DATA_MSB[channel]), self.bus.read(_DATA_LSB[channel])
            drive = None if settings.active & _FIXED_DRIVE else self.bus.read(_DRIVE_CURRENTS[channel])
        except BusFault as fault:
            if not settings.scanning:
                raise
            return no_sample(fault_of(fault))
        if not settings.scanning:
            errors = 0
            for look in looks:
                errors |= look & _ERRORS
            return RawSample(msb, lsb, looks[-1] | errors, drive=drive)
        # The bits of unread results freeze with an error of any channel. DRDY shows that all channels have a new
        # result.
        status = ready_status(channel)
        for look in looks:
            if look & _ERROR_FLAGS and look >> 14 == channel:
                status |= look & _ERRORS
        return RawSample(msb, lsb, status, drive=drive)

    def switch(self, words: bytes) -> bool:
        """Send the switches their words."""
        expected, self._held = self._held, None  # unknown until all of them are through
        returned = self._switches.shift(words)
        self._held = words
        return returned is None or expected is None or returned == expected

    def configure(self, settings: ChipSettings) -> None:
        """Write all registers of a sleeping converter and verify them."""
        for attempts_left in reversed(range(ATTEMPTS)):
            try:
                self._write(settings)
            except BusFault:
                if not attempts_left:
                    raise
                self._reset()
            else:
                return

    def hold(self, settings: ChipSettings, *, thoroughly: bool) -> bool:
        """Check whether the converter still has its settings.

        One register shows a reset. All registers show a corrupted transfer.
        """
        pairs = settings.asleep if thoroughly else [pair for pair in settings.asleep if pair[0] in _CLOCK_DIVIDERS][:1]
        return all((self.bus.read(address) ^ value) & _mask(address) == 0 for address, value in pairs)

    def close(self) -> None:
        """Close both buses. Never raises."""
        for port in (self.bus, self._switches):
            with contextlib.suppress(Exception):
                port.close()

    def _write(self, settings: ChipSettings) -> None:
        """Write the settings once and read them back."""
        found = self.identity()
        if found != (MANUFACTURER, DEVICE):
            raise BusFault(
                f"the chip must be an LDC1614 or one of its kind, {MANUFACTURER:04X}/{DEVICE:04X}; "
                f"got {found[0]:04X}/{found[1]:04X}."
            )
        for address, value in settings.asleep:
            self.bus.write(address, value)
        self._sleep_word = settings.active | ASLEEP
        drives = [(_DRIVE_CURRENTS[0], drive) for drive in settings.drives[:1]]
        for address, value in drives:
            self.bus.write(address, value)
        for address, value in (*settings.asleep, *drives):
            self._require(address, value)

    def _require(self, address: int, value: int) -> None:
        found = self.bus.read(address)
        if (found ^ value) & _mask(address):
            raise BusFault(f"register {register(address).name} must read {value:#06x} as written; got {found:#06x}.")

    def _reset(self) -> None:
        """Reset a converter after a possibly interrupted transfer."""
        with contextlib.suppress(BusFault):
            self.bus.clear()
            self.bus.write(_RESET_DEV, _RESET)
            self.clock.sleep(_RESET_TIME)
            self._sleep_word = register("CONFIG").reset
            self.sleep()


def _mask(address: int) -> int:
    """Return the bits of a register that read back unchanged."""
    return _DRIVE_MASK if address in _DRIVE_CURRENTS else 0xFFFF


def fault_of(fault: BusFault) -> SampleFault:
    """Return the sample fault of a failed transfer."""
    return SampleFault.BUS_TIMEOUT if isinstance(fault, BusTimeout) else SampleFault.NOT_ACKNOWLEDGED


def no_sample(fault: SampleFault) -> RawSample:
    """Return the sample of a state without a measurement."""
    return RawSample(0, 0, 0, fault)
