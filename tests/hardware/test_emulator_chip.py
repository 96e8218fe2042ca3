"""The emulated LDC1614 against the data sheet: registers, timing, results, flags, and what goes wrong.

Numbers that are compared with stand here as the data sheet (Texas Instruments SNOSCY9A) prints them, or follow from its
equations 6 and 7 and table 42; the emulator's own constants are not used.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from coilarray.hardware.chips.ldc1614 import registers
from coilarray.hardware.emulator import board
from coilarray.hardware.emulator.board import VirtualClock
from coilarray.hardware.emulator.ldc1614_chip import WATCHDOG, EmulatedBus, Ldc1614, Misuse, Resonator, UndocumentedUse
from coilarray.hardware.wire.buses import BusFault, BusTimeout

CLOCK = 43.4e6
REFERENCE = CLOCK / 2
RESETS = {
    **dict.fromkeys(range(0x08), 0x0000), **dict.fromkeys(range(0x08, 0x0C), 0x0080),
    **dict.fromkeys(range(0x0C, 0x1A), 0x0000), 0x1A: 0x2801, 0x1B: 0x020F, 0x1C: 0x0000,
    **dict.fromkeys(range(0x1E, 0x22), 0x0000), 0x7E: 0x5449, 0x7F: 0x3055,
}  # fmt: skip
# currents in µA and smallest and largest R_p in kΩ, table 42, every fifth row
DRIVES = {0: (16, 60.0, 90.0), 5: (32, 29.5, 42.8), 10: (72, 13.1, 20.4), 15: (146, 6.46, 9.69),
          20: (297, 3.17, 4.61), 25: (635, 1.48, 2.19), 31: (1563, 0.60, 0.90)}  # fmt: skip
GOOD = Resonator(2e6, 16e3, 20.0)  # 1.47 V with IDRIVE 10
DRIVE = 10 << 11
ASLEEP, AWAKE, EXTERNAL = 0x3401, 0x1401, 0x0200


@dataclass
class Bench:
    """What is connected to the chip: anything, by channel and time."""

    sensors: dict = field(default_factory=lambda: {0: GOOD})
    noise: float = 0.0
    clkin: float | None = None

    def sensor(self, channel, time):
        found = self.sensors.get(channel)
        return found(time) if callable(found) else found

    def clock_of(self, time, *, external):
        return (self.clkin or 0.0) if external else CLOCK


class Chip:
    """A chip on a bench, with the registers that most tests need."""

    def __init__(self, *, strict=True, seed=0, **bench):
        self.clock = VirtualClock()
        self.bench = Bench(**bench)
        self.misuse = Misuse(strict)
        options = {"misuse": self.misuse, "seed": seed}
        self.chip = Ldc1614(self.clock, self.bench, **options)
        self.read, self.write, self.wait = self.chip.read, self.chip.write, self.clock.sleep

    def wake(self, config=AWAKE, *, wait=0.0, **registers):
        """Return itself after a time awake."""
        given = {**channels(0, OFFSET=0), "ERRORS": 0xF8FD, "MUX": 0x020C, **registers}
        addresses = {"RCOUNT": 0x08, "OFFSET": 0x0C, "SETTLE": 0x10, "DIVIDERS": 0x14, "DRIVE": 0x1E}
        self.write(0x1A, config | 0x2000)
        for name, value in given.items():
            single = {"ERRORS": 0x19, "MUX": 0x1B}
            self.write(single[name] if name in single else addresses[name[:-1]] + int(name[-1]), value)
        self.write(0x1A, config)
        self.wait(wait)
        return self

    def converted(self, config=AWAKE, **registers):
        """Return itself after one result of the usual length."""
        return self.wake(config, wait=conversion() * 1.01, **registers)

    def code(self):
        msb = self.read(0x00)
        return (msb & 0x0FFF) << 16 | self.read(0x01)

    def result(self, **registers):
        """Wake, wait for one result, return STATUS, the flags and the code."""
        self.wake(wait=conversion(registers.get("RCOUNT0", 1000)) * 1.001, **registers)
        status = self.read(0x18)
        msb = self.read(0x00)
        return status, msb >> 12, (msb & 0x0FFF) << 16 | self.read(0x01)


def channels(*numbers, **other):
    """Registers of some channels, as those of channel 0 are by default."""
    values = {"RCOUNT": 1000, "SETTLE": 40, "DIVIDERS": 0x1002, "DRIVE": DRIVE, **other}
    return {f"{name}{k}": value for k in numbers for name, value in values.items()}


def conversion(rcount=1000, settle=40, reference=REFERENCE, clock=CLOCK):
    """Time from waking to the first result: sections 7.5, 8.1.4 and equation 7."""
    return 16384 / clock + 16 * settle / reference + (16 * rcount + 4) / reference


def test_reset_values_and_that_nothing_else_is_there():
    chip = Chip(strict=False)
    assert {address: chip.read(address) for address in RESETS} == RESETS
    assert set(chip.chip.table) == set(RESETS)
    named = {"RCOUNT0": 0x08, "OFFSET0": 0x0C, "SETTLECOUNT0": 0x10, "CLOCK_DIVIDERS3": 0x17, "CONFIG": 0x1A}
    assert {name: entry.address for name, entry in registers().items() if name in named} == named
    # data is read while the chip sleeps, and every LSB after its MSB: nothing else is misused
    assert all("slept" in note for note in chip.misuse.notes)


@pytest.mark.parametrize("address", [0x1D, 0x22, 0x7D, 0xFF])
def test_undocumented_registers_more_than_16_bits_and_changes_while_it_is_awake_are_refused(address):
    chip = Chip().wake()
    for changed in (0x08, 0x1B, 0x1E):
        with pytest.raises(UndocumentedUse, match="while the chip was active"):
            chip.write(changed, chip.chip.registers[changed])
    with pytest.raises(UndocumentedUse, match="CONFIG was changed"):
        chip.write(0x1A, AWAKE | 0x4000)
    chip.write(0x1A, ASLEEP)
    with pytest.raises(ValueError, match="0 to 0xFFFF"):
        chip.write(0x08, 0x10000)
    with pytest.raises(UndocumentedUse, match="not documented"):
        chip.read(address)
    with pytest.raises(UndocumentedUse, match="not documented"):
        chip.write(address, 0)


@pytest.mark.parametrize(("address", "value"), [
    (0x1A, 0x2800), (0x1A, 0x2901), (0x1A, 0x2803), (0x1B, 0x000F), (0x1B, 0x021F), (0x19, 0x0100), (0x19, 0x0002),
    (0x14, 0x1402), (0x1E, 0x0001), (0x1C, 0x8001),
])  # fmt: skip
def test_reserved_bits_must_be_written_as_they_are(address, value):
    with pytest.raises(UndocumentedUse, match="reserved bits"):
        Chip().write(address, value)


@given(st.sampled_from(sorted(set(RESETS) - {0x1A, 0x1C})), st.integers(0, 0xFFFF))
def test_what_is_written_is_read_back_but_for_what_cannot_be(address, value):
    chip = Chip(strict=False)
    chip.write(address, value)
    mask = 0xF800 if 0x1E <= address <= 0x21 else 0xFFFF
    if address < 8 or address in (0x18, 0x7E, 0x7F):
        mask = 0
    assert chip.chip.registers[address] == (RESETS[address] & ~mask | value & mask)
    assert mask or "read-only" in chip.misuse.notes[0]


def ready_at(chip, seconds, config=AWAKE, **registers):
    """Wake; the first result must come after this time and not before."""
    chip.wake(config, wait=seconds - 1e-9, **registers)
    assert not chip.chip.interrupt
    chip.wait(2e-9)
    assert chip.read(0x18) == 0x0048


@pytest.mark.parametrize("rcount", [5, 1000, 0xFFFF])
@pytest.mark.parametrize("settle", [0, 1, 2, 20, 64])
def test_the_first_result_comes_when_the_data_sheet_says(rcount, settle):
    chip = Chip(sensors={0: replace(GOOD, quality_factor=2.0)})
    # the shortest settling takes 32 cycles
    ready_at(chip, conversion(rcount, max(settle, 2)), RCOUNT0=rcount, SETTLE0=settle)


def test_the_wake_up_runs_on_the_internal_clock_and_the_conversion_on_the_chosen_one():
    chip = Chip(clkin=40e6)
    ready_at(chip, conversion(reference=20e6), AWAKE | EXTERNAL)
    assert chip.code() == round(2e6 / 20e6 * 2**28)


def test_conversions_follow_each_other():
    chip = Chip().wake(wait=conversion() + 1e-9)
    one = (16 * 1000 + 4) / REFERENCE
    gap = 692e-9 + 5 / REFERENCE  # the data sheet gives it for the change of channels
    for _ in range(10):
        assert chip.read(0x18) & 0x40
        chip.wait(one + gap - 2e-9)
        assert not chip.read(0x18) & 0x40
        chip.wait(2e-9)
    # two channels take turns, and data is ready after both
    chip = Chip(strict=False, sensors={0: GOOD, 1: replace(GOOD, frequency=3e6)})
    chip.wake(wait=conversion() + 1e-9, MUX=0x820C, **channels(1))
    assert chip.read(0x18) == 0x0008
    turn = conversion() - 16384 / CLOCK
    chip.wait(turn + 692e-9 + 5 / REFERENCE)
    assert chip.read(0x18) == 0x004C
    codes = [(chip.read(2 * k) & 0xFFF) << 16 | chip.read(2 * k + 1) for k in range(2)]
    assert codes == [round(f / REFERENCE * 2**28) for f in (2e6, 3e6)]


@example(2e6, 1, 1, 0, 1000)
@given(st.floats(1e4, 5e6), *(st.integers(*ends) for ends in ((1, 15), (1, 20), (0, 0xFFFF), (10, 0xFFFF))))
def test_every_code_is_equation_6(frequency, fin, fref, offset, rcount):
    chip = Chip(strict=False, sensors={0: replace(GOOD, frequency=frequency)})
    divider = 1 + fref
    chip.wake(DIVIDERS0=fin << 12 | divider, OFFSET0=offset, RCOUNT0=rcount, MUX=0x020D)
    reference = CLOCK / divider
    chip.wait(conversion(rcount, reference=reference) * 1.0001)
    exact = (frequency / (fin * reference) - offset / 2**16) * 2**28
    # half a code, and what 1e-15 of the largest number of the sum makes
    assert abs(chip.code() - min(max(exact, 0), 2**28 - 1)) <= 0.5 + 1e-6


def test_the_lsb_belongs_to_the_msb_that_was_read_before_it():
    before, after = 2.0e6, 2.0005e6
    chip = Chip(sensors={0: lambda time: replace(GOOD, frequency=before if time < conversion() else after)})
    chip.wake(wait=conversion() + 1e-6)
    msb = chip.read(0x00)
    chip.wait(5 * conversion())  # other results come between the two reads
    assert (msb & 0xFFF) << 16 | chip.read(0x01) == round(before / REFERENCE * 2**28)
    assert chip.code() == round(after / REFERENCE * 2**28)


def test_the_noise_is_what_is_stated_and_the_same_for_the_same_seed():
    # 400 codes: their standard deviation is known to 3.5 %, four times that is the tolerance
    for rcount in (0xFFFF, 0x0FFF):
        chip = Chip(noise=1e-6, seed=3).wake(wait=conversion(rcount), RCOUNT0=rcount)
        codes = []
        for _ in range(400):
            chip.wait((16 * rcount + 4 + 5) / REFERENCE + 1e-6)
            codes.append(chip.code())
        spread = 1e-6 * math.sqrt(0xFFFF / rcount)
        assert np.std(codes) / np.mean(codes) == pytest.approx(spread, rel=0.15)
        assert np.mean(codes) == pytest.approx(0x17982F3, rel=4 * spread / 20)
    first, same, other = (Chip(noise=1e-5, seed=seed).result() for seed in (1, 1, 2))
    assert first == same
    assert first[2] != other[2]


# cause, flags in DATA0_MSB, bits in STATUS, bits of ERROR_CONFIG that show the flags and the status bits
CAUSES = {
    "offset above the ratio: under-range": ({"OFFSET0": 0x4000}, {0: GOOD}, 0b1000, 0x2000, 0x8000, 0x80),
    "reference below the sensor: over-range": (
        {"DIVIDERS0": 0x1020, "SETTLE0": 10}, {0: GOOD}, 0b0100, 0x1000, 0x4000, 0x40),
    "no sensor, long conversion: watchdog": ({"RCOUNT0": 0xFFFF}, {0: None}, 0b1011, 0x2A00, 0xA800, 0xA8),
    "no sensor, short conversion: no edges": ({"RCOUNT0": 100}, {0: None}, 0b1001, 0x2300, 0x8800, 0x8C),
    "drive far too weak: it stops": ({"RCOUNT0": 100, "DRIVE0": 0}, {0: GOOD}, 0b1001, 0x2300, 0x8800, 0x8C),
    "drive too weak: low amplitude": ({"DRIVE0": 7 << 11}, {0: GOOD}, 0b0001, 0x0200, 0x0800, 0x08),
    "drive too strong: high amplitude": ({"DRIVE0": 14 << 11}, {0: GOOD}, 0b0001, 0x0400, 0x1000, 0x10),
    "input filter below the sensor: no edges": ({"MUX": 0x0209}, {0: GOOD}, 0b1000, 0x2100, 0x8000, 0x84),
}  # fmt: skip


def provoked(cause, errors, **options):
    registers, sensors, *_ = CAUSES[cause]
    chip = Chip(sensors=sensors, strict=False, **options)  # most of the causes are misuse
    divider = registers.get("DIVIDERS0", 0x1002) & 0x3FF
    chip.wake(**{**registers, "ERRORS": errors})
    chip.wait(16384 / CLOCK + (16 * registers.get("RCOUNT0", 1000) + 4 + 16 * 40) * divider / CLOCK)
    return chip


@pytest.mark.parametrize("cause", CAUSES)
def test_every_flag_has_its_cause_and_its_gate(cause):
    _, _, flags, status, out, interrupt = CAUSES[cause]
    chip = provoked(cause, 0xF8FD)
    assert (chip.chip.interrupt, chip.read(0x18)) == (True, status | 0x48)
    assert chip.read(0x00) >> 12 == flags
    # nothing shows with all gates closed, or with those of the others alone; UNREADCONV needs none
    for gates in (0x0000, 0xF8FD & ~(out | interrupt | 1)):
        chip = provoked(cause, gates)
        assert (chip.chip.interrupt, chip.read(0x18), chip.read(0x00) >> 12) == (False, 0x0008, 0)
    # its own alone show it
    assert provoked(cause, out).read(0x00) >> 12 == flags
    assert provoked(cause, interrupt).read(0x18) == status | 0x0008


def test_the_watchdog_comes_after_its_time_and_again():
    chip = Chip(sensors={0: None}).wake(wait=16384 / CLOCK + WATCHDOG - 1e-6, RCOUNT0=0xFFFF)
    assert not chip.chip.interrupt
    for _ in range(5):
        chip.wait(2e-6)
        assert chip.read(0x18) & 0x0840 == 0x0840
        chip.wait(WATCHDOG - 2e-6)
    chip = Chip(sensors={0: None, 1: GOOD})  # no watchdog while channels take turns
    chip.wake(wait=1.0, MUX=0x820C, RCOUNT0=0xFFFF, **channels(1))
    assert chip.read(0x18) & 0x0800 == 0


def test_status_names_the_first_channel_and_forgets_the_second():
    weak = replace(GOOD, parallel_resistance=12e3)
    strong = replace(GOOD, parallel_resistance=25e3)
    chip = Chip(sensors={0: GOOD, 1: weak, 2: strong}).wake(wait=3 * conversion() * 1.01, MUX=0xA20C, **channels(1, 2))
    # frozen when channel 1 was done: low amplitude of channel 1, results of channels 0 and 1, data not ready yet
    assert chip.read(0x18) == 1 << 14 | 0x0200 | 0x000C
    # the error of channel 2 is lost in STATUS but not in its data
    assert chip.read(0x18) & 0x3F00 == 0
    assert chip.read(0x04) >> 12 == 0b0001


@pytest.mark.parametrize("by", ["status", "data"])
def test_an_error_goes_when_status_or_the_data_of_its_channel_is_read(by):
    chip = provoked("drive too weak: low amplitude", 0xF8FD)
    chip.read(0x18 if by == "status" else 0x00)
    assert not chip.chip.interrupt or by == "data"  # DATA0_MSB leaves data ready
    assert chip.read(0x18) & 0x3F00 == 0


def test_unread_and_ready():
    chip = Chip().converted()
    assert (chip.read(0x18), chip.read(0x18)) == (0x0048, 0x0008)
    chip.read(0x00)
    assert chip.read(0x18) == 0
    chip = Chip().converted(AWAKE | 0x80)  # the interrupt pin can be switched off
    assert (chip.chip.interrupt, chip.read(0x18)) == (False, 0x0048)
    # sleep clears results and errors
    chip = Chip(strict=False, sensors={0: replace(GOOD, parallel_resistance=9e3)})  # too small an amplitude
    chip.wake(wait=conversion() * 1.1)
    assert chip.chip.interrupt
    chip.write(0x1A, ASLEEP)
    assert (chip.read(0x18), chip.read(0x00), chip.read(0x01)) == (0, 0, 0)
    assert not chip.chip.interrupt
    # a sensor that had no time to settle is called weak
    chip = Chip(strict=False)
    assert chip.result(SETTLE0=13)[0] == 0x0248
    chip.wait(conversion())
    assert chip.read(0x18) == 0x0048  # it has settled meanwhile


@pytest.mark.parametrize("code", DRIVES)
def test_the_chip_finds_a_drive_that_the_table_allows(code):
    microamperes, low, high = DRIVES[code]
    # equation 12, rounded to three digits: at the ends of a row the amplitude is 1.2 and 1.8 V
    for end, amplitude, rel in ((low, 1.2, 0.03), (high, 1.8, 0.05)):
        assert Resonator(2e6, end * 1e3, 10.0).amplitude(microamperes * 1e-6) == pytest.approx(amplitude, rel=rel)
    R = 1e3 * math.sqrt(low * high)
    # drive and amplitude left to the chip
    chip = Chip(sensors={0: replace(GOOD, parallel_resistance=R)}).converted(0x0001, DRIVE0=0)
    assert chip.read(0x18) & 0x3F00 == 0
    found = chip.chip.registers[0x1E]
    assert found & 0xF83F == 0  # only INIT_IDRIVE is written by the chip
    # the rows overlap: its own or the next one
    assert found >> 6 in (code - 1, code, code + 1)
    chip.converted(DRIVE0=found >> 6 << 11)  # it stays when it is written to IDRIVE
    assert (chip.chip.registers[0x1E], chip.read(0x18)) == (found >> 6 << 11, 0x0048)


@pytest.mark.parametrize(("registers", "config", "bench", "said"), [
    ({"DIVIDERS0": 0x1000}, AWAKE, {}, "divider 0"),
    ({"DIVIDERS0": 0x1001}, AWAKE, {}, "at most 3.5e"),
    ({"RCOUNT0": 4}, AWAKE, {}, "RCOUNT0 is 4"),
    ({"SETTLE0": 13}, AWAKE, {}, "needs 14"),  # ⌈20·21.7/(16·2)⌉
    ({"MUX": 0x020B}, AWAKE, {}, "DEGLITCH"),  # 33 MHz in the application table, not in the register's
    ({}, AWAKE | EXTERNAL, {}, "CLKIN is grounded"),
    ({"DIVIDERS0": 0x1001}, AWAKE | EXTERNAL, {"clkin": 40e6}, "at most 3.5e"),
    ({}, AWAKE | EXTERNAL, {"clkin": 1.9e6}, "CLKIN has 1.9e"),
    ({"DIVIDERS0": 0x1001}, AWAKE | EXTERNAL, {"clkin": 34.9e6, "sensors": {0: replace(GOOD, frequency=8.8e6)}},
     "input of channel 0 is 0.252 of the reference"),
    ({"DIVIDERS0": 0x1006}, AWAKE, {}, "must be below a quarter"),
    ({"OFFSET0": 6041}, AWAKE, {}, "below the sensor's 6040"),  # 2 MHz are 6040.2 steps of 21.7 MHz/2¹⁶
    ({"SETTLE0": 2000}, AWAKE, {"sensors": {0: replace(GOOD, frequency=900.0, quality_factor=1.0)}}, "1 kHz to 10 MHz"),
    ({"MUX": 0x820C, "SETTLE0": 3}, AWAKE, {}, "more than 3"),
    ({"MUX": 0x820C, "RCOUNT0": 8}, AWAKE, {}, "RCOUNT0 is 8"),
    ({"MUX": 0x820C}, AWAKE | 0x40, {}, "HIGH_CURRENT_DRV"),
])  # fmt: skip
def test_what_must_not_be_converted_with(registers, config, bench, said):
    chip = Chip(**bench)
    with pytest.raises(UndocumentedUse, match=said):  # noqa: PT012 - some show only when the sensor runs
        chip.wake(config, wait=0.1, **registers)
        chip.read(0x18)


def test_status_is_read_after_the_interrupt_and_data_before_sleep():
    """The data sheet: after conversions start in active mode, the first read of STATUS comes after INTB is asserted."""
    chip = Chip(strict=False).wake(wait=conversion() - 1e-6)
    assert (chip.read(0x18), chip.read(0x18), len(chip.misuse.notes)) == (0, 0, 2)
    chip.wait(2e-6)
    assert (chip.read(0x18), len(chip.misuse.notes)) == (0x0048, 2)
    assert all("before INTB" in note for note in chip.misuse.notes)
    for _ in range(3):  # later looks are free, until it wakes again
        chip.read(0x18)
    chip.write(0x1A, ASLEEP)
    chip.read(0x18)
    assert len(chip.misuse.notes) == 2
    chip.write(0x1A, AWAKE)
    chip.read(0x18)
    assert len(chip.misuse.notes) == 3
    chip.write(0x1A, ASLEEP)
    chip.read(0x01)
    assert "DATA0_LSB was read while the chip slept" in chip.misuse.notes[3]


def on_a_bus():
    chip = Chip()
    return chip, EmulatedBus(chip.chip, chip.clock)


def test_faults_of_the_bus():
    chip, bus = on_a_bus()
    bus.refuse(2)
    for _ in range(2):
        with pytest.raises(BusFault, match="did not acknowledge register 0x7e"):
            bus.read(0x7E)
    assert bus.read(0x7E) == 0x5449
    bus.hold()
    for _ in range(3):
        with pytest.raises(BusTimeout, match="held down"):
            bus.write(0x08, 5)
    assert chip.chip.registers[0x08] == 0x0080
    bus.clear()
    bus.flip(0, 15)
    assert (bus.read(0x7E), bus.read(0x7E), bus.read(0x7E)) == (0x5448, 0xD449, 0x5449)
    bus.flip(0)
    bus.write(0x1B, 0x020C)
    assert bus.read(0x1B) == 0x020D
    # transfers take their time
    chip, bus = on_a_bus()
    bus.read(0x7E)
    assert chip.clock.now() == pytest.approx(120e-6)  # 48 bits at 400 kHz
    bus.write(0x08, 5)
    assert chip.clock.now() == pytest.approx(120e-6 + 95e-6)  # 38 bits


def test_a_paced_clock_counts_short_waits_exactly_and_keeps_pace(monkeypatch):
    """A computer whose waits take 0.2 ms longer, and that computes for 1 ms in between: the board's second is one."""
    real = [100.0]

    def late(seconds):
        real[0] += seconds + 0.2e-3

    # not in the module `time` itself, which threads of other tests look at
    monkeypatch.setattr(board, "time", SimpleNamespace(monotonic=lambda: real[0], sleep=late))
    clock = board.PacedClock()
    for _ in range(1000):
        clock.sleep(0.1e-3)
    assert clock.now() == pytest.approx(100.1, abs=1e-9)
    assert real[0] == pytest.approx(clock.now(), abs=1.3e-3)  # what is ahead, and a wait that was late
    for _ in range(10):
        real[0] += 1e-3
        clock.sleep(2e-3)
    assert clock.now() == pytest.approx(100.12, abs=1e-9)
    real[0] += 5.0  # it was busy: the time is gone, for the board too
    assert clock.now() == pytest.approx(105.12, abs=0.06)
