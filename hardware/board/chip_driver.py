"""The converter and the switches behind their two buses, step by step: sleep, switch, wake, wait, read, check.

What is known of them is kept here: whether the converter sleeps, and which words the switches hold.
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
"""How often something is tried that must not fail."""
BUS_FAULTS = (SampleFault.NOT_ACKNOWLEDGED, SampleFault.BUS_TIMEOUT)
"""Faults of a sample that the bus to the converter has."""
_ADDRESS = {name: found.address for name, found in registers().items()}
_CONFIGURED = ("RCOUNT0", "OFFSET0", "SETTLECOUNT0", "CLOCK_DIVIDERS0", "ERROR_CONFIG", "CONFIG", "MUX_CONFIG")
_DATA_MSB, _DATA_LSB = _ADDRESS["DATA0_MSB"], _ADDRESS["DATA0_LSB"]
_CLOCK_DIVIDERS, _STATUS, _CONFIG = _ADDRESS["CLOCK_DIVIDERS0"], _ADDRESS["STATUS"], _ADDRESS["CONFIG"]
_DRIVE_CURRENT, _RESET_DEV = _ADDRESS["DRIVE_CURRENT0"], _ADDRESS["RESET_DEV"]
_DRIVE_MASK = register("DRIVE_CURRENT0").field("IDRIVE0").mask  # the chip writes what it likes into the bits below
_DATA_READY, _ERRORS = 0x0040, 0xFF00  # bits of STATUS
_RESET = 0x8000
_RESET_TIME = 2e-3  # s; the data sheet says it of the pin SD and nothing of the register
_LOOK_AGAIN = 1e-3  # s between two looks at STATUS


@dataclass(frozen=True)
class Orders:
    """Settings as the chips are told them.

    Parameters
    ----------
    names : tuple of str
        Of the states.
    words, drives : tuple
        Of the switches, and DRIVE_CURRENT0, in each state.
    asleep : tuple of (int, int)
        Registers, the converter asleep.
    active : int
        CONFIG awake.
    wait, timeout : float
        From waking to the first look at STATUS and to giving up, in s.
    hash : int
        Of the settings.
    """

    names: tuple[str, ...]
    words: tuple[bytes, ...]
    drives: tuple[int, ...]
    asleep: tuple[tuple[int, int], ...]
    active: int
    wait: float
    timeout: float
    hash: int

    @staticmethod
    def of(settings: ScanSettings) -> Orders:
        """Take the orders from settings.

        Raises
        ------
        HardwareError
            Other registers than the seven of the protocol, or CONFIG asleep.
        """
        given = dict(settings.registers)
        if sorted(address for address, _ in settings.registers) != sorted(_ADDRESS[name] for name in _CONFIGURED):
            raise HardwareError(f"the settings must have the registers {', '.join(_CONFIGURED)}, each once.")
        if given[_CONFIG] & ASLEEP:
            raise HardwareError("the settings must have CONFIG as it is while the converter is awake.")
        return Orders(
            names=tuple(state.name for state in settings.states),
            words=tuple(state.words for state in settings.states),
            drives=tuple(settings.drive_register(state) for state in settings.states),
            asleep=tuple(sorted((given | {_CONFIG: given[_CONFIG] | ASLEEP}).items())),
            active=given[_CONFIG],
            wait=settings.wait_us * 1e-6,
            timeout=settings.timeout_us * 1e-6,
            hash=settings.hash,
        )


class Chips:
    """Converter and switches of one board.

    Parameters
    ----------
    bus : RegisterBus
        To the converter.
    switches : SwitchChain
        To the switches.
    clock : Clock
        By which it waits.
    """

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
        """Put the converter to sleep; between two attempts the bus is freed.

        Raises
        ------
        BusFault
            It did not answer in any of the attempts.
        """
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

    def wake(self, orders: Orders, drive: int) -> None:
        """Set the drive current and start converting."""
        self.bus.write(_DRIVE_CURRENT, drive)
        self.asleep = False  # first: the write may be cut off after it was done
        self.bus.write(_CONFIG, orders.active)

    def result(self, orders: Orders) -> RawSample:
        """Wait for the conversion of a converter that was just woken, and read it."""
        woken, errors = self.clock.now(), 0
        self.clock.sleep(orders.wait)
        while True:
            passed = self.clock.now() - woken  # before the look: a pause of the computer after it says nothing
            status = self.bus.read(_STATUS)
            errors |= status & _ERRORS  # reading clears them
            if status & _DATA_READY:
                msb, lsb = self.bus.read(_DATA_MSB), self.bus.read(_DATA_LSB)
                return RawSample(msb, lsb, status | errors)
            if passed >= orders.timeout:
                return no_sample(SampleFault.NO_RESULT)
            self.clock.sleep(_LOOK_AGAIN)

    def switch(self, words: bytes) -> bool:
        """Give the switches their words; False where the chain returns others than it was given before."""
        expected, self._held = self._held, None  # unknown until all of them are through
        returned = self._switches.shift(words)
        self._held = words
        return returned is None or expected is None or returned == expected

    def configure(self, orders: Orders) -> None:
        """Write every register of a sleeping converter and read it back; a reset between two attempts.

        Raises
        ------
        BusFault
            A converter that does not answer, is another chip or reads back something else, after all attempts.
        """
        for attempts_left in reversed(range(ATTEMPTS)):
            try:
                self._write(orders)
            except BusFault:
                if not attempts_left:
                    raise
                self._reset()
            else:
                return

    def hold(self, orders: Orders, *, thoroughly: bool) -> bool:
        """Whether the converter still has its settings: one register tells a reset, all of them a spoilt transfer."""
        looked_at = [pair for pair in orders.asleep if thoroughly or pair[0] == _CLOCK_DIVIDERS]
        return all(self.bus.read(address) == value for address, value in looked_at)

    def close(self) -> None:
        """Let go of both buses. Never raises."""
        for port in (self.bus, self._switches):
            with contextlib.suppress(Exception):
                port.close()

    def _write(self, orders: Orders) -> None:
        found = self.identity()
        if found != (MANUFACTURER, DEVICE):
            raise BusFault(
                f"the chip must be an LDC1614, {MANUFACTURER:04X}/{DEVICE:04X}; got {found[0]:04X}/{found[1]:04X}."
            )
        for address, value in orders.asleep:
            self.bus.write(address, value)
        self._sleep_word = orders.active | ASLEEP
        self.bus.write(_DRIVE_CURRENT, orders.drives[0])
        for address, value in orders.asleep:
            self._require(address, value, 0xFFFF)
        self._require(_DRIVE_CURRENT, orders.drives[0], _DRIVE_MASK)

    def _require(self, address: int, value: int, mask: int) -> None:
        found = self.bus.read(address)
        if (found ^ value) & mask:
            raise BusFault(f"register {register(address).name} must read {value:#06x} as written; got {found:#06x}.")

    def _reset(self) -> None:
        """Begin anew with a converter that may be in the middle of a transfer that was cut off."""
        with contextlib.suppress(BusFault):
            self.bus.clear()
            self.bus.write(_RESET_DEV, _RESET)
            self.clock.sleep(_RESET_TIME)
            self._sleep_word = register("CONFIG").reset
            self.sleep()


def no_sample(fault: SampleFault) -> RawSample:
    """Return a state without words."""
    return RawSample(0, 0, 0, fault)
