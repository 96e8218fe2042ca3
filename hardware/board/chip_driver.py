"""Driver of the converter and the switches behind their two buses: sleep, switch, wake, wait, read, check.

It keeps what is known of the chips: whether the converter sleeps, and which words the switches hold.
"""

from __future__ import annotations

import contextlib
from dataclasses import dataclass

from coilarray.errors import HardwareError
from coilarray.hardware.chips.ldc1614_registers import ASLEEP, DEVICE, MANUFACTURER, register, registers
from coilarray.hardware.scan.reader import RawSample, SampleFault
from coilarray.hardware.scan.settings import ScanSettings
from coilarray.hardware.wire.buses import Clock, RegisterBus, SwitchChain
from coilarray.hardware.wire.faults import BusFault

ATTEMPTS = 3
"""Number of attempts at a step that must not fail."""
BUS_FAULTS = (SampleFault.NOT_ACKNOWLEDGED, SampleFault.BUS_TIMEOUT)
"""Faults of a sample that come from the bus to the converter."""
_ADDRESS = {name: found.address for name, found in registers().items()}
_CONFIGURED = ("RCOUNT0", "OFFSET0", "SETTLECOUNT0", "CLOCK_DIVIDERS0", "ERROR_CONFIG", "CONFIG", "MUX_CONFIG")
_DATA_MSB, _DATA_LSB = _ADDRESS["DATA0_MSB"], _ADDRESS["DATA0_LSB"]
_CLOCK_DIVIDERS, _STATUS, _CONFIG = _ADDRESS["CLOCK_DIVIDERS0"], _ADDRESS["STATUS"], _ADDRESS["CONFIG"]
_DRIVE_CURRENT, _RESET_DEV = _ADDRESS["DRIVE_CURRENT0"], _ADDRESS["RESET_DEV"]
_DRIVE_MASK = register("DRIVE_CURRENT0").field("IDRIVE0").mask  # the chip writes what it likes into the bits below
_DATA_READY, _ERRORS = 0x0040, 0xFF00  # bits of STATUS
_FIXED_DRIVE = register("CONFIG").field("RP_OVERRIDE_EN").mask
_RESET = 0x8000
_RESET_TIME = 2e-3  # s; the data sheet says it of the pin SD and nothing of the register
_LOOK_AGAIN = 1e-3  # s between two looks at STATUS


@dataclass(frozen=True)
class ChipSettings:
    """Settings of a scan as register values and words of the switches; the times are those of `ScanSettings`."""

    names: tuple[str, ...]
    words: tuple[bytes, ...]  # of the switches in each state
    drives: tuple[int, ...]  # register DRIVE_CURRENT0 in each state
    asleep: tuple[tuple[int, int], ...]  # addresses and values of the registers while the converter sleeps
    active: int  # register CONFIG while the converter is awake
    wait: float  # s, until the first look at STATUS
    timeout: float  # s, until giving up
    discard: int  # conversions to throw away
    again: float  # s, from one that is thrown away until the next look
    hash: int

    @staticmethod
    def of(settings: ScanSettings) -> ChipSettings:
        """Encode settings; HardwareError for other registers than the seven of the protocol, or CONFIG asleep."""
        given = dict(settings.registers)
        if sorted(address for address, _ in settings.registers) != sorted(_ADDRESS[name] for name in _CONFIGURED):
            raise HardwareError(f"the settings must have the registers {', '.join(_CONFIGURED)}, each once.")
        if given[_CONFIG] & ASLEEP:
            raise HardwareError("the settings must have CONFIG as it is while the converter is awake.")
        return ChipSettings(
            names=tuple(state.name for state in settings.states),
            words=tuple(state.words for state in settings.states),
            drives=tuple(settings.drive_register(state) for state in settings.states),
            asleep=tuple(sorted((given | {_CONFIG: given[_CONFIG] | ASLEEP}).items())),
            active=given[_CONFIG],
            wait=settings.wait_us * 1e-6,
            timeout=settings.timeout_us * 1e-6,
            discard=settings.discard,
            again=settings.again_us * 1e-6,
            hash=settings.hash,
        )


class ChipDriver:
    """Driver of the converter on a bus and of the switches behind their port; the clock is that of all waits."""

    def __init__(self, bus: RegisterBus, switches: SwitchChain, clock: Clock) -> None:
        self.bus, self.clock = bus, clock
        self._switches = switches
        self._held: bytes | None = None  # words of the switches; None where they are not known
        self._sleep_word = register("CONFIG").reset
        self.asleep = False
        """Whether the converter was put to sleep and not woken since."""

    def identity(self) -> tuple[int, int]:
        """Read the registers MANUFACTURER_ID and DEVICE_ID."""
        return self.bus.read(_ADDRESS["MANUFACTURER_ID"]), self.bus.read(_ADDRESS["DEVICE_ID"])

    def sleep(self, attempts: int = ATTEMPTS) -> None:
        """Put the converter to sleep, freeing the bus between two attempts; BusFault where it never answers."""
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

    def wake(self, settings: ChipSettings, drive: int) -> None:
        """Set the drive current and start converting."""
        self.bus.write(_DRIVE_CURRENT, drive)
        self.asleep = False  # first: the write may be cut off after it was done
        self.bus.write(_CONFIG, settings.active)

    def result(self, settings: ChipSettings) -> RawSample:
        """Wait for the conversions of a converter that was just woken, and read the result of the last.

        Where the converter chose its own drive current, that is read too, before sleep can clear it.
        """
        status = self._ready(settings.wait, settings.timeout)
        for _ in range(settings.discard):
            if status is not None:
                self.bus.read(_DATA_MSB)  # clears its flags
                status = self._ready(settings.again, settings.timeout)
        if status is None:
            return no_sample(SampleFault.NO_RESULT)
        msb, lsb = self.bus.read(_DATA_MSB), self.bus.read(_DATA_LSB)
        drive = None if settings.active & _FIXED_DRIVE else self.bus.read(_DRIVE_CURRENT)
        return RawSample(msb, lsb, status, drive=drive)

    def _ready(self, wait: float, timeout: float) -> int | None:
        """Wait for a result and return STATUS with all errors that it has shown; None where there is no result."""
        start, errors = self.clock.now(), 0
        self.clock.sleep(wait)
        while True:
            passed = self.clock.now() - start  # before the look: a pause of the computer after it says nothing
            status = self.bus.read(_STATUS)
            errors |= status & _ERRORS  # reading clears them
            if status & _DATA_READY:
                return status | errors
            if passed >= timeout:
                return None
            self.clock.sleep(_LOOK_AGAIN)

    def switch(self, words: bytes) -> bool:
        """Send the switches their words; False if the chain returns other words than it was sent before."""
        expected, self._held = self._held, None  # unknown until all of them are through
        returned = self._switches.shift(words)
        self._held = words
        return returned is None or expected is None or returned == expected

    def configure(self, settings: ChipSettings) -> None:
        """Write every register of a sleeping converter and read it back; a reset between two attempts.

        BusFault for a converter that does not answer, is another chip or reads back something else, after all attempts.
        """
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
        """Whether the converter still has its settings: one shows a reset, all of them a corrupted transfer."""
        looked_at = [pair for pair in settings.asleep if thoroughly or pair[0] == _CLOCK_DIVIDERS]
        return all(self.bus.read(address) == value for address, value in looked_at)

    def close(self) -> None:
        """Close both buses. Never raises."""
        for port in (self.bus, self._switches):
            with contextlib.suppress(Exception):
                port.close()

    def _write(self, settings: ChipSettings) -> None:
        found = self.identity()
        if found != (MANUFACTURER, DEVICE):
            raise BusFault(
                f"the chip must be an LDC1614, {MANUFACTURER:04X}/{DEVICE:04X}; got {found[0]:04X}/{found[1]:04X}."
            )
        for address, value in settings.asleep:
            self.bus.write(address, value)
        self._sleep_word = settings.active | ASLEEP
        self.bus.write(_DRIVE_CURRENT, settings.drives[0])
        for address, value in settings.asleep:
            self._require(address, value, 0xFFFF)
        self._require(_DRIVE_CURRENT, settings.drives[0], _DRIVE_MASK)

    def _require(self, address: int, value: int, mask: int) -> None:
        found = self.bus.read(address)
        if (found ^ value) & mask:
            raise BusFault(f"register {register(address).name} must read {value:#06x} as written; got {found:#06x}.")

    def _reset(self) -> None:
        """Reset a converter that may be in the middle of an interrupted transfer."""
        with contextlib.suppress(BusFault):
            self.bus.clear()
            self.bus.write(_RESET_DEV, _RESET)
            self.clock.sleep(_RESET_TIME)
            self._sleep_word = register("CONFIG").reset
            self.sleep()


def no_sample(fault: SampleFault) -> RawSample:
    """Return the sample of a state that could not be measured."""
    return RawSample(0, 0, 0, fault)
