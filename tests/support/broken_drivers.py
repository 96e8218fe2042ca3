"""A small right driver for an emulated board, and drivers that are wrong in one way each, as drivers in use are.

They are written against the data sheets alone and share nothing with the package's own driver. `findings` judges one of
them on boards that are sound, broken and unusual.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any

from coilarray.hardware.chips.converters import CONVERTERS
from coilarray.hardware.emulator import Conditions, EmulatedBoard, OpenPoints, Oscillator, VirtualClock
from coilarray.hardware.scan.wiring import load_wiring
from coilarray.hardware.wire.faults import BusFault
from support.quick_coils import series_tank

COILS = ("coil1", "coil2", "coil3", "coil4", "coil5", "coil6")
WIRING = load_wiring()
SAFE = b"\x11" * 6
RCOUNT = 2000
CAPACITANCE = 120e-12
# R_p from 21 to 11 kΩ: no one current suits all
TANKS = {name: ((50 + k) * 1e-6, 20.0 + 4 * k) for k, name in enumerate(COILS)}
DRIVES = dict(zip(COILS, (8, 9, 10, 10, 11, 12), strict=True))


class TwoSizes:
    """Coils that differ in inductance and losses."""

    def check(self, place):
        """Allow every place."""

    def resonator(self, state, place, temperature):
        if len(state.measured) != 1:
            return None
        L, R = TANKS[state.measured[0][0]]
        return series_tank(L, CAPACITANCE, R)


@dataclass(frozen=True)
class Reading:
    """Frequency in Hz, or None where it is no measurement; and what was found wrong."""

    frequency: float | None
    reasons: frozenset[str] = field(default_factory=frozenset)


class RightDriver:
    """Six coils in turn on channel 0, the others grounded; the converter sleeps while the switches move."""

    clock = 43.4e6
    rcount, offset, settle = RCOUNT, 0, 64
    errors, mux, dividers, awake = 0xF8FD, 0x020C, 0x1002, 0x1401

    def __init__(self, board: EmulatedBoard, clock: float = 43.4e6) -> None:
        self.board = board
        self.true_clock = clock

    def read(self, register: int) -> int:
        return self.board.bus.read(register)

    def write(self, register: int, value: int) -> None:
        self.board.bus.write(register, value)

    def configure(self) -> None:
        self.board.switches.shift(SAFE)
        self.sleep()
        for register, value in self.registers():
            self.write(register, value)

    def registers(self) -> Iterator[tuple[int, int]]:
        values = (self.rcount, self.offset, self.settle, self.dividers, self.errors, self.mux)
        yield from zip((0x08, 0x0C, 0x10, 0x14, 0x19, 0x1B), values, strict=True)

    def scan(self) -> dict[str, Reading]:
        found = {}
        for coil in COILS:
            try:
                found[coil] = self.measure(coil)
            except BusFault:
                found[coil] = Reading(None, frozenset({"bus"}))
                self.board.bus.clear()
        self.rest()
        return found

    def measure(self, coil: str) -> Reading:
        self.sleep()
        self.switch(coil)
        self.write(0x1E, self.drive(coil) << 11)
        self.wake()
        return self.result()

    def drive(self, coil: str) -> int:
        return DRIVES[coil]

    def sleep(self) -> None:
        self.write(0x1A, 0x2801)

    def wake(self) -> None:
        self.write(0x1A, self.awake)

    def switch(self, coil: str) -> None:
        self.board.switches.shift(bytes(6))
        self.board.switches.shift(bytes(0x22 if name == coil else 0x11 for name in reversed(COILS)))

    @property
    def reference(self) -> float:
        return self.true_clock / 2

    def wait(self, share: float = 1.001) -> None:
        cycles = 16 * (self.rcount + self.settle) + 4
        self.board.clock.sleep(share * (cycles / self.reference + 16384 / self.true_clock))

    def result(self) -> Reading:
        self.wait()
        for _ in range(100):
            status = self.read(0x18)
            if status & 0x40:
                return self.convert(status, *self.data())
            self.board.clock.sleep(50e-6)
        return Reading(None, frozenset({"no result"}))

    def data(self) -> tuple[int, int]:
        msb = self.read(0x00)
        return msb, self.read(0x01)

    def convert(self, status: int, msb: int, lsb: int) -> Reading:
        reasons = {name for name, bit in (("under", 15), ("over", 14), ("watchdog", 13)) if msb >> bit & 1}
        reasons |= {"no edges"} if status & 0x0100 else set()
        code = self.code(msb, lsb)
        if code in (0, 0xFFFFFFF):
            reasons |= {"end of range"}
        if reasons:
            return Reading(None, frozenset(reasons))
        doubts = frozenset({"amplitude"} if msb >> 12 & 1 else ())
        return Reading(self.frequency(code), doubts)

    def code(self, msb: int, lsb: int) -> int:
        return (msb & 0x0FFF) << 16 | lsb

    def frequency(self, code: int) -> float:
        return self.reference * (code / 2**28 + self.offset / 2**16)

    def rest(self) -> None:
        self.sleep()
        self.board.switches.shift(SAFE)


BROKEN: dict[str, tuple[type[RightDriver], str]] = {}
"""Broken drivers by what is wrong with them, and what must be found of each, as a regular expression: a driver that is
caught for another reason does not count."""


def broken(wrong: str, finding: str, **changes: Any) -> None:
    """Add a driver with other attributes or methods than the right one."""
    BROKEN[wrong] = (type("BrokenDriver", (RightDriver,), changes), finding)


def shift_words(driver, coils, word=0x22, order=COILS[::-1]):
    driver.board.switches.shift(bytes(word if name in coils else 0x11 for name in order))


def swapped(value):
    return value >> 8 | (value & 0xFF) << 8


def single_precision(driver, msb, lsb):
    return int(struct.unpack("f", struct.pack("f", RightDriver.code(driver, msb, lsb)))[0])


OFF = "sound: coil. is off by"
broken("Registers read as SMBus words, least significant byte first", "sound: coil. is refused: no result",
       read=lambda self, register: swapped(RightDriver.read(self, register)))  # fmt: skip
broken("Registers written as SMBus words", "sound: CONFIG was written with 0x0128: reserved bits",
       write=lambda self, register, value: RightDriver.write(self, register, swapped(value)))  # fmt: skip
broken("LSB taken for MSB", OFF, code=lambda self, msb, lsb: lsb << 16 & 0xFFFFFFF | msb)
broken("Halves joined as if they were bytes", OFF, code=lambda self, msb, lsb: (msb & 0x0FFF) << 8 | lsb)
broken("The four flags taken for a part of the number", r"a weak oscillation: [\d.e+]+ Hz",
       code=lambda self, msb, lsb: msb << 16 | lsb)  # fmt: skip
broken("Flags expected that were never switched on", "a weak oscillation: not named", errors=0x0001)
broken("LSB read before MSB, which latches it", "sound: DATA0_LSB was read without DATA0_MSB",
       data=lambda self: (self.read(0x01), self.read(0x00))[::-1])  # fmt: skip
broken("CLOCK_DIVIDERS not written, whose reset value is reserved", "sound: CLOCK_DIVIDERS0 holds a divider 0",
       registers=lambda self: (pair for pair in RightDriver.registers(self) if pair[0] != 0x14))  # fmt: skip
broken("IDRIVE of the first coil for every coil", "sound: coil[4-6] is doubted: amplitude",
       drive=lambda self, coil: DRIVES[COILS[0]])  # fmt: skip
broken("40 MHz whatever the chip has", OFF, reference=20e6)
broken("The typical frequency taken for every chip's", "slow clock: coil. is off by",
       frequency=lambda self, code: 21.7e6 * code / 2**28)  # fmt: skip
broken("All four channels configured because the identity is that of a chip with four; others have it too",
       "two channels: .* not documented",
       registers=lambda self: (*RightDriver.registers(self), *((0x08 + k, RCOUNT) for k in range(4))))  # fmt: skip
broken("28 bits in a float of 24", OFF, code=single_precision)
broken("OFFSET used and not added again", OFF,
       offset=0x0100, frequency=lambda self, code: self.reference * code / 2**28)  # fmt: skip
broken("OFFSET multiplied by the reference twice", OFF, offset=0x0100,
       frequency=lambda self, code: self.reference * (code / 2**28 + self.offset * self.reference / 2**16))  # fmt: skip
broken("A fixed settling time that knows nothing of Q", "sound: SETTLECOUNT0 is 4; this sensor needs", settle=4)
broken("The nearest input filter in place of the next higher one", "sound: coil. is refused: .*no edges", mux=0x0209)
broken("CONFIG put together from its named fields alone", "sound: CONFIG was written with 0x1400: reserved bits",
       awake=0x1400)  # fmt: skip
broken("The chip put to sleep before the data is fetched, which sleep clears",
       "sound: DATA0_MSB was read while the chip slept",
       data=lambda self: (self.sleep(), RightDriver.data(self))[1])  # fmt: skip
broken("STATUS asked for from early on, before the interrupt", "sound: STATUS was read after waking before INTB",
       wait=lambda self: RightDriver.wait(self, 0.9))  # fmt: skip
broken("Converter and switches left as they are", "sound: not left at rest", rest=lambda self: None)
broken("The next coil is joined before the last one is disconnected", "sound: coil[2-6] is refused",
       switch=lambda self, coil: shift_words(self, (coil, COILS[max(COILS.index(coil) - 1, 0)])))  # fmt: skip
broken("The ground of the measured coil stays closed", "sound: the words .* make a circuit that is short",
       switch=lambda self, coil: shift_words(self, (coil,), 0x33))  # fmt: skip
broken(
    "The first byte taken for the nearest device", OFF,
    switch=lambda self, coil: (self.board.switches.shift(bytes(6)), shift_words(self, (coil,), order=COILS)),
)  # fmt: skip
broken("The internal clock undivided, which one channel does not allow", "sound: the reference of channel 0 is",
       dividers=0x1001, reference=property(lambda self: self.true_clock))  # fmt: skip


def found_as(finding: str) -> Callable[[type[RightDriver]], type[RightDriver]]:
    """Add a class of a broken driver, whose docstring says what is wrong."""

    def add(driver: type[RightDriver]) -> type[RightDriver]:
        BROKEN[driver.__doc__ or ""] = (driver, finding)
        return driver

    return add


@found_as("sound: DRIVE_CURRENT0 was written while the chip was active")
class ConfigNotLast(RightDriver):
    """Woken first, the drive set after that."""

    def measure(self, coil):
        self.sleep()
        self.switch(coil)
        self.wake()
        self.write(0x1E, self.drive(coil) << 11)
        return self.result()


@found_as("status clears unread: coil. is refused: nothing unread")
class StatusReadTwice(RightDriver):
    """STATUS read once for data ready and once more for the rest, which the first read may have cleared."""

    def result(self):
        self.wait()
        while not self.read(0x18) & 0x40:
            self.board.clock.sleep(50e-6)
        status = self.read(0x18)
        return self.convert(status, *self.data()) if status & 0x08 else Reading(None, frozenset({"nothing unread"}))


@found_as("sound: coil[2-6] is off by")
class FirstResultAfterSwitching(RightDriver):
    """Switches move under a converter that is awake, and its next result is used."""

    def configure(self):
        super().configure()
        self.write(0x1E, self.drive(COILS[2]) << 11)

    def measure(self, coil):
        self.switch(coil)
        if coil == COILS[0]:
            self.wake()
        return self.result()

    def wait(self):
        """Do not wait longer than until data is ready."""


@found_as("slow clock: coil. is refused")
class NeverLooksWhetherReady(RightDriver):
    """Reads after a fixed time for the typical clock."""

    def result(self):
        self.board.clock.sleep(16 * RCOUNT / 21.7e6 + 0.5e-3)
        return self.convert(0x48, *self.data())


@found_as("not acknowledged: not named")
class BusErrorsAsNumbers(RightDriver):
    """A read that fails gives an error code in place of the value."""

    def read(self, register):
        try:
            self.last = super().read(register)
        except BusFault:
            self.board.bus.clear()
            return self.failed()
        return self.last

    def failed(self):
        return 0x0123


@found_as("not acknowledged: not named")
class SwallowsBusErrors(BusErrorsAsNumbers):
    """A read that fails gives the last value."""

    def failed(self):
        return getattr(self, "last", 0)


@found_as("sound: coil. is refused")
class WrongModeOfSpi(RightDriver):
    """The default mode of the microcontroller's library."""

    def __init__(self, board, clock=43.4e6):
        super().__init__(board, clock)
        board.switches.mode = 0


def a_board(**options) -> EmulatedBoard:
    conditions = Conditions(Oscillator(options.pop("clock", 43.4e6)), noise=0.0)
    return EmulatedBoard(COILS, WIRING.encode(), TwoSizes(), clock=VirtualClock(), conditions=conditions, **options)


def wrong_values(driver: RightDriver, scan: dict[str, Reading]) -> Iterator[str]:
    """Readings that are not the true frequency to a code, or not called good."""
    step = driver.true_clock / 2 / 2**28
    for coil, reading in scan.items():
        true = TwoSizes().resonator(SimpleNamespace(measured=((coil, 1),)), None, 25.0).frequency
        if reading.frequency is None:
            yield f"{coil} is refused: {', '.join(sorted(reading.reasons))}"
        elif abs(reading.frequency - true) > 0.500001 * step:
            yield f"{coil} is off by {(reading.frequency - true) / step:.3g} codes"
        elif reading.reasons:
            yield f"{coil} is doubted: {', '.join(sorted(reading.reasons))}"


def findings(kind: type[RightDriver]) -> list[str]:
    """What is wrong with a driver; empty for a right one."""
    return [*_on_sound_boards(kind), *_on_broken_boards(kind)]


def _on_sound_boards(kind: type[RightDriver]) -> Iterator[str]:
    boards = {
        "sound": a_board(), "slow clock": a_board(clock=35e6), "fast clock": a_board(clock=55e6),
        "status clears unread": a_board(open_points=OpenPoints(status_clears_unread=True)),
        "status without gates": a_board(open_points=OpenPoints(status_gated=False, flags_clear_on_read=False)),
        "two channels": a_board(converter=CONVERTERS["LDC1612"]), "no read back": a_board(readback=False),
    }  # fmt: skip
    for name, board in boards.items():
        driver = kind(board, board.conditions.oscillator.frequency)
        driver.configure()
        for _ in range(2):
            yield from (f"{name}: {wrong}" for wrong in wrong_values(driver, driver.scan()))
        yield from (f"{name}: {note}" for note in board.misuse.notes)
        if not board.chip.asleep or board.chain.words != SAFE:
            yield f"{name}: not left at rest"


def _on_broken_boards(kind: type[RightDriver]) -> Iterator[str]:
    board = a_board()
    driver = kind(board)
    driver.configure()
    board.chain.stick(*board.chain.find(2, 0, "INA"), "open")
    scan = driver.scan()
    if scan["coil3"].frequency is not None:
        yield "a coil that is not there: a number"
    if {"no edges", "under"}.isdisjoint(scan["coil3"].reasons):
        yield "a coil that is not there: not named"
    board.chain.heal()
    yield from (f"after a broken switch: {wrong}" for wrong in wrong_values(driver, driver.scan()))
    weak = a_board()
    tank = series_tank(50e-6, CAPACITANCE, 45.0)
    weak.world.resonator = lambda state, place, temperature: tank
    driver = kind(weak)
    driver.configure()
    for reading in driver.scan().values():
        if "amplitude" not in reading.reasons:
            yield "a weak oscillation: not named"
        elif reading.frequency is None or abs(reading.frequency / tank.frequency - 1) > 1e-6:
            yield f"a weak oscillation: {reading.frequency} Hz"  # doubtful, not useless
    for transaction in range(6, 16):
        board = a_board()
        driver = kind(board)
        driver.configure()
        driver.scan()
        _refuse_later(board, transaction)
        scan = driver.scan()
        if not any("bus" in reading.reasons for reading in scan.values()):
            yield f"transaction {transaction} not acknowledged: not named"
        yield from (
            f"transaction {transaction} not acknowledged: {wrong}"
            for wrong in wrong_values(driver, {coil: r for coil, r in scan.items() if "bus" not in r.reasons})
        )


def _refuse_later(board: EmulatedBoard, transactions: int) -> None:
    """Let one transaction fail after some others."""
    bus, left = board.bus, [transactions]
    read, write = bus.read, bus.write

    def counted(call):
        def inner(*arguments):
            left[0] -= 1
            if left[0] == 0:
                bus.refuse()
            return call(*arguments)

        return inner

    bus.read, bus.write = counted(read), counted(write)
