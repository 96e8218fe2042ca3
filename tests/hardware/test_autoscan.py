"""Coils at the channels of a converter: registers by the data sheet, results by channel, faults, freshness and times.

The converter is that of the emulator, in strict mode: any use that the data sheets do not allow raises.
"""

import dataclasses
import itertools
import math
from dataclasses import replace

import pytest
from support.emulated_reader import brown_out, quick_settings, settings_of
from support.quick_coils import plain_board
from support.refusals import refused

from coilarray.design.scan_states import ScanState
from coilarray.errors import HardwareError
from coilarray.hardware.board.direct import DirectReader
from coilarray.hardware.board.self_test import find_drives, self_test
from coilarray.hardware.scan.readings import Reason, SampleFault, read_scan
from coilarray.hardware.scan.settings import ScanSettings
from coilarray.hardware.scan.wiring import load_wiring, parse_wiring, wired_to_channels
from coilarray.hardware.wire.buses import BoardRestarted, BusFault, BusTimeout

CAPACITANCE = 120e-12  # F, of the quick coils
NAMES = ("north", "east", "south", "west")
FOUR = wired_to_channels(NAMES, (0, 1, 2, 3))
TWO = wired_to_channels(NAMES[:2], (0, 1))
ONE = wired_to_channels(NAMES[:1], (2,))
SIX = load_wiring()


def at_channels(wiring, **options):
    """An emulated board without noise, and its reader."""
    board = plain_board(wiring, **{"noise": 0.0, "strict": True, **options})
    return board, DirectReader(board.bus, None, board.clock, kind="emulator", emulated=True)


def configured(wiring, *, settings=None, **options):
    board, reader = at_channels(wiring, **options)
    settings = settings or quick_settings(wiring)
    reader.configure(settings)
    return board, reader, settings


def frequencies(scan, settings):
    """Frequencies in Hz by coil."""
    readings = read_scan(scan, settings, CAPACITANCE)
    assert readings.verdict == "good"
    return {state.name: state.frequency for state in readings.states}


def true(board, wiring):
    """Frequencies of the coils at their channels, to a step of the code: 2⁻²⁸·f_ref is 1e-7 of 2 MHz at most."""
    tanks = {coil: board.true_tank(channel) for coil, channel in zip(wiring.coils, wiring.channels, strict=True)}
    return pytest.approx({coil: tank.frequency for coil, tank in tanks.items()}, rel=1e-7)


def hexadecimal(settings):
    return {f"{address:02X}": f"{value:04X}" for address, value in settings.registers}


# ------------------------------------------------------------------- registers and limits


def test_the_registers_of_two_channels_are_those_of_the_data_sheets_example():
    # section 8.2: fSENSOR 2.4 MHz, Q 10, 40 MHz at CLKIN by 2, RCOUNT 0x04D6, IDRIVE 18; SETTLECOUNT 6 by its rule
    settings = settings_of(TWO, frequency=2.4e6, quality=10.0, clock=40e6, external_clock=True, rcount=0x4D6, drives=18)
    settings = replace(settings, fref_divider=2, settle_count=6)
    assert hexadecimal(settings) == {
        **{"08": "04D6", "09": "04D6", "0C": "0000", "0D": "0000", "10": "0006", "11": "0006", "14": "1002"},
        **{"15": "1002", "19": "F8FD", "1A": "1601", "1B": "820C", "1E": "9000", "1F": "9000"},
    }
    # every channel has its own settling, divider and drive
    wiring = wired_to_channels(["slow", "fast"], (1, 0))
    settings = settings_of(
        wiring, frequency={"slow": 1e6, "fast": 9e6}, quality={"slow": 40.0, "fast": 20.0},
        drives={"slow": 3, "fast": 20}, clock=40e6, external_clock=True,
    )  # fmt: skip
    # ⌈Q f_ref/(16 f)⌉: 40·40/16 = 100 and 20·40/(16·9) = 5.6; from 8.75 MHz on the input is divided by 2
    words = hexadecimal(settings)
    assert (words["10"], words["11"]) == (f"{6:04X}", f"{100:04X}")
    assert (words["14"], words["15"]) == ("2001", "1001")
    assert (words["1E"], words["1F"]) == (f"{20 << 11:04X}", f"{3 << 11:04X}")


def test_json_and_hash_tell_channels_apart():
    settings = settings_of(FOUR, rcount=100)
    assert ScanSettings.from_json(settings.to_json()) == settings
    other = settings_of(wired_to_channels(NAMES, (1, 0, 2, 3)), rcount=100)
    assert other.hash != settings.hash
    switched = settings_of(SIX)
    assert switched.canonical.startswith(b"coilarray1")  # as the firmware has it


# ------------------------------------------------------------------- wiring


def test_a_wiring_file_may_have_channels():
    text = 'schema = 1\n[wiring]\ntitle = "mine"\nchannels = { left = 1, right = 0 }\n'
    wiring = parse_wiring(text, "mine.toml")
    assert (wiring.coils, wiring.channels, wiring.safe_words) == (("left", "right"), (1, 0), b"")
    for old, new, message in (
        ("right = 0", "right = 1", "names the channel 1 twice"),
        ("right = 0", "right = 4", "a channel must be 0 to 3; got 4"),
        ('title = "mine"', 'title = "mine"\ncoils = ["left"]', "coils with devices, or channels of coils; got both"),
    ):
        refused(HardwareError, message, parse_wiring, text.replace(old, new), "mine.toml")


@pytest.mark.parametrize(("state", "message"), [
    (ScanState("s", (("north", -1),)), "no switches that turn north round"),
    (ScanState("s", (("north", 1),), others="open"), "no switches that make east 'open'; it is grounded"),
    (ScanState("s", (("north", 1),), exceptions={"west": "load"}), "no switches that make west 'load'"),
    (ScanState("s", (("north", 1), ("east", 1))), "must measure one coil"),
])  # fmt: skip
def test_a_state_that_needs_switches_is_refused(state, message):
    refused(HardwareError, f"state s.*{message}", FOUR.words, state)


# ------------------------------------------------------------------- results


@pytest.mark.parametrize("wiring", [
    ONE, TWO, FOUR, wired_to_channels(NAMES, (3, 1, 0, 2)), wired_to_channels(NAMES[:2], (3, 0)),
])  # fmt: skip
def test_every_coil_is_measured_at_its_channel(wiring):
    board, reader, settings = configured(wiring)
    assert frequencies(reader.scan(), settings) == true(board, wiring)
    assert [scan.sequence for scan in itertools.islice(reader.scans(), 4)] == [0, 1, 2, 3]
    reader.close()
    assert board.chip.asleep
    assert board.misuse.notes == []


def test_a_scan_that_is_asked_for_is_of_now_although_the_converter_has_gone_on():
    # conversions of 7 ms, so long that no new result comes while an old one is read
    board, reader, settings = configured(TWO, settings=quick_settings(TWO, rcount=20_000))
    stream = reader.scans()
    before = [frequencies(next(stream), settings)["north"] for _ in range(3)][-1]
    board.clock.sleep(1.0)
    board.chip.advance()
    board.world.inductances["north"] *= 1.01
    after = frequencies(reader.scan(), settings)["north"]
    # a result of before, or one that was half counted then, would be 0.25 % off and more; f ∝ 1/√L but for the losses
    assert before / after == pytest.approx(math.sqrt(1.01), rel=1e-4)
    stream.close()


@pytest.mark.parametrize("clock", [35e6, 55e6])
@pytest.mark.parametrize("wiring", [ONE, FOUR])
def test_a_stream_goes_as_fast_as_the_converter(wiring, clock):
    settings = settings_of(wiring, rcount=2000, drives=7)
    board, reader, _ = configured(wiring, settings=settings, oscillator=clock)
    scans = list(itertools.islice(reader.scans(), 40))
    assert all(sample.fault is SampleFault.NONE for scan in scans for sample in scan.samples)
    clocks = 16 * 2000 + 4 + 5 + (16 * settings.settle_count if len(settings.channels) > 1 else 0)
    turn = len(wiring.coils) * (clocks / (clock / settings.fref_divider) + 692e-9)
    # no result is missed, and each is seen within the millisecond of a look
    assert (scans[-1].time - scans[10].time) / 29 == pytest.approx(turn, abs=1.2e-3 / 29)
    assert board.misuse.notes == []


def test_a_computer_that_is_late_gets_the_newest_results_and_their_time():
    board, reader, settings = configured(TWO)
    stream = reader.scans()
    list(itertools.islice(stream, 3))
    board.clock.sleep(5.0)
    now = board.clock.now()
    late = next(stream)
    time = settings.state_time()
    assert now - 3 * (time.settle + time.conversion) < late.time < now
    assert frequencies(late, settings) == true(board, TWO)


@pytest.mark.parametrize("rate", [10.0, 500.0])
def test_the_rate_is_reached(rate):
    settings = settings_of(FOUR, rate=rate, drives=7)
    assert 1 / settings.period() >= rate
    longer = dataclasses.replace(settings, rcount=min(settings.rcount + 1, 0xFFFF))
    assert settings.rcount == 0xFFFF or 1 / longer.period() < rate
    refused(HardwareError, r"rate must be at most \d+.* scans/s of 4 states", settings_of, FOUR, rate=5000.0)


# ------------------------------------------------------------------- faults


def test_errors_belong_to_their_channel():
    # all have 20 Ω: with 35 µH the amplitude 4·R_p·I/π is 0.85 V, with 1 nH there is no resonance
    board, reader, settings = configured(FOUR)
    board.world.inductances.update({"east": 35e-6, "south": 1e-9})
    for _ in range(3):
        readings = {state.name: state for state in read_scan(reader.scan(), settings, CAPACITANCE).states}
        assert [readings[name].verdict for name in NAMES] == ["good", "doubtful", "bad", "good"]
        assert set(readings["east"].reasons) <= {Reason.AMPLITUDE, Reason.AMPLITUDE_LOW}
        assert readings["south"].inductance is None


@pytest.mark.parametrize(("fault", "told"), [
    (BusFault, SampleFault.NOT_ACKNOWLEDGED), (BusTimeout, SampleFault.BUS_TIMEOUT),
])  # fmt: skip
def test_a_transfer_that_fails_costs_the_samples_that_it_was_for_and_three_scans_end_the_stream(fault, told):
    board = plain_board(TWO, noise=0.0, strict=True)
    read, flaky = board.bus.read, set()

    def read_or_not(register):
        if register in flaky:
            raise fault("as the test wants")
        return read(register)

    board.bus.read = read_or_not
    reader = DirectReader(board.bus, None, board.clock, kind="emulator", emulated=True)
    reader.configure(quick_settings(TWO))
    stream = reader.scans()
    next(stream)
    flaky.add(0x02)  # DATA1_MSB
    for _ in range(3):
        assert [sample.fault for sample in next(stream).samples] == [SampleFault.NONE, told]
    refused(BusFault, "state east: the converter did not answer in 3 consecutive scans", next, stream)
    flaky.add(0x18)  # STATUS: nobody knows which results are new
    reader.configure(quick_settings(TWO))
    assert [sample.fault for sample in reader.scan().samples] == [told, told]
    assert board.chip.asleep


def test_a_reset_is_found_in_the_scan_in_which_it_happens():
    board, reader, _ = configured(TWO)
    stream = reader.scans()
    next(stream)
    brown_out(board.chip)
    assert [sample.fault for sample in next(stream).samples] == [SampleFault.CONVERTER_RESET] * 2
    refused(BoardRestarted, "lost its settings", next, stream)
    # settings with switches are for another reader
    _, reader = at_channels(TWO)
    refused(HardwareError, "for 6 switches in a chain", reader.configure, quick_settings())


# ------------------------------------------------------------------- self-test, drive currents


def test_self_test_and_drive_currents_of_channels():
    board, reader, settings = configured(FOUR)
    found = self_test(reader, FOUR, settings)
    assert (found.passed, [check.coil for check in found.coils]) == (True, list(NAMES))
    drives = find_drives(reader, settings)
    assert {name: drive.reasons for name, drive in drives.items()} == dict.fromkeys(NAMES, ())
    board.world.inductances["south"] = 1e-9
    found = self_test(reader, FOUR, settings)
    assert [symptom.partition(":")[0] for symptom in found.symptoms] == ["south at channel 2 does not oscillate"]
    assert "south or a lead of it is broken" in found.findings[0]
