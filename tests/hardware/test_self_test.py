"""Closure self-test: every single fault of switches, coils and maps is found on an emulated board, and named.

The board has each fault in its own chips (a stuck switch in the chain, a coil that is not in the world, another
netlist); the test knows the wiring as assumed and sees scans.
"""

import dataclasses
import itertools

import pytest
from support.coupled_coils import CoupledCoils, coupled_board
from support.emulated_reader import WIRING, at_rest, quick_settings, reader_of
from support.refusals import refused

from coilarray.errors import HardwareError
from coilarray.hardware.board.drive_codes import find_drives
from coilarray.hardware.board.fault_model import Fault, single_faults, trials
from coilarray.hardware.board.self_test import self_test
from coilarray.hardware.scan.closure import check_switching, switch_table
from coilarray.hardware.scan.readings import Reason
from coilarray.hardware.scan.wiring import load_wiring
from coilarray.hardware.wire.faults import BusFault, SwitchFault

THREE = dataclasses.replace(WIRING, name="three", coils=WIRING.coils[:3], devices=WIRING.devices[:3])
FOUR_DEVICES = load_wiring("six_coils_4")
on_boards = pytest.mark.parametrize("wiring", [WIRING, THREE, FOUR_DEVICES], ids=lambda wiring: wiring.name)


def settings_of(wiring):
    return quick_settings(wiring, drives=8, quality=150.0)  # 52 µA into 36 kΩ: 1.6 V


def checked(board, wiring, **options):
    return self_test(reader_of(board, wiring=wiring), wiring, settings_of(wiring), **options)


def with_order(wiring, order):
    devices = tuple(dataclasses.replace(one, bits=tuple(one.bits[k] for k in order)) for one in wiring.devices)
    return dataclasses.replace(wiring, devices=devices)


@on_boards
def test_a_good_board_passes(wiring):
    board = coupled_board(wiring)
    result = checked(board, wiring)
    assert (result.passed, result.findings, result.symptoms) == (True, (), ())
    assert at_rest(board, wiring)
    assert [check.coil for check in result.coils] == list(wiring.coils)
    for k, check in enumerate(result.coils):
        # a neighbour, whose inductance falls by k² = 0.0025 when this one is shorted: its frequency rises by half that
        assert abs(wiring.coils.index(check.felt_by) - k) == 1
        assert check.rises["both"] == pytest.approx(1.25e-3, rel=0.02)
        assert max(abs(check.rises["a"]), abs(check.rises["b"])) < 5e-6
        assert (check.turned is None) == (wiring is FOUR_DEVICES)


@pytest.mark.slow
def test_what_cannot_be_noticed_is_told():
    untested = checked(coupled_board(THREE), THREE).untested
    # the row of coils looks the same from both ends; that of a coil is no matter
    assert untested[0] == "the chain of devices is wired the other way round"
    assert all("the other way round" in text for text in untested)
    assert checked(coupled_board(FOUR_DEVICES), FOUR_DEVICES).untested == ()


@pytest.mark.slow
def test_boards_with_noise_pass():
    assert all(checked(coupled_board(THREE, seed=seed, noise=5e-7), THREE).passed for seed in range(6))


@on_boards
def test_trials_are_legal_for_every_board(wiring):
    for trial in itertools.chain.from_iterable(trials(wiring)):
        check_switching(wiring.encode(), wiring.safe_words, [("trial", trial.words)])


SWITCHES = [
    pytest.param(wiring, device, switch, id=f"{wiring.name}-{device.name}.{switch.name}")
    for wiring in (THREE, FOUR_DEVICES)
    for device in wiring.devices
    for switch in device.switches
    if switch.terminal.coil in (("coil1", "coil2") if wiring is THREE else ("coil6",))  # at an end, and between two
]


@pytest.mark.slow
@pytest.mark.parametrize("how", ["open", "closed"])
@pytest.mark.parametrize(("wiring", "device", "switch"), SWITCHES)
def test_a_switch_that_is_stuck_is_named(wiring, device, switch, how):
    board = coupled_board(wiring)
    coil, end = wiring.coils.index(switch.terminal.coil), "ab".index(switch.terminal.end)
    board.chain.stick(*board.chain.find(coil, end, switch.net), how)
    result = checked(board, wiring)
    assert f"{device.name}.{switch.name} ({switch.terminal} to {switch.net}) stays {how}" in result.findings
    assert not result.passed
    # what else explains it concerns the same coil, in the same way
    assert all(f"({switch.terminal.coil}." in text and text.endswith(f"stays {how}") for text in result.findings)
    assert len(result.findings) <= 2


@pytest.mark.slow
@on_boards
@pytest.mark.parametrize("what", ["missing", "shorted"])
@pytest.mark.parametrize("at", [0, 1, -1])
def test_a_coil_that_is_missing_or_shorted_is_named(wiring, what, at):
    world, coil = CoupledCoils(wiring.coils), wiring.coils[at]
    getattr(world, what).add(coil)
    result = checked(coupled_board(wiring, world=world), wiring)
    assert set(result.findings) == {f"{coil} or a lead of it is broken", f"{coil} is shorted"}
    check = result.coils[at]
    assert (check.frequency, check.turned) == (None, None)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("wiring", "order"),
    [
        # highest first, each half turned, interleaved, and three pairs exchanged
        *((THREE, order) for order in ("76543210", "32107654", "04152637", "73625140")),
        *((THREE, order) for order in ("10234567", "06234517", "01254367")),
        *((FOUR_DEVICES, order) for order in ("73625140", "06234517")),
    ],
)
def test_a_wrong_bit_map_is_found(wiring, order):
    actual = with_order(wiring, [int(bit) for bit in order])
    result = checked(coupled_board(actual), wiring)
    assert not result.passed
    suspects = {fault.text: fault for fault in single_faults(wiring)}
    assert actual.encode() in {suspects[text].wiring.encode() for text in result.findings}
    # and with the map that was found, the board passes
    right = next(text for text in result.findings if suspects[text].wiring.encode() == actual.encode())
    assert checked(coupled_board(actual), suspects[right].wiring).passed


def test_a_wrong_bit_map_that_nobody_thought_of_is_not_passed():
    actual = with_order(WIRING, (5, 0, 3, 1, 7, 2, 6, 4))
    result = checked(coupled_board(actual), WIRING)
    assert not result.passed
    assert "coil1 does not oscillate with all others grounded" in result.symptoms


def test_words_that_never_arrive_are_found():
    board = coupled_board(THREE)
    board.chain.readback = False
    board.switches.broken = True
    # maps that let nothing oscillate show the same; the nearest comes first
    assert checked(board, THREE).findings[0] == "no word reaches the switches, or the converter is not joined to them"


def test_a_wrong_mode_of_spi_is_found_and_at_once_where_the_chain_is_wired_back():
    board = coupled_board(WIRING)
    board.switches.mode = 0
    board.chain.readback = False
    assert "words arrive one clock late: another mode of SPI is needed" in checked(board, WIRING).findings
    board.chain.readback = True
    refused(SwitchFault, "does not return the words that it was sent; no switch", checked, board, WIRING)


def test_a_chain_that_is_turned_round_is_found_where_the_coils_are_in_another_order_than_the_devices():
    # in the row the coils stand as 1, 3, 2: who feels whom tells
    other = dataclasses.replace(THREE, coils=("coil1", "coil3", "coil2"))
    turned = dataclasses.replace(other, devices=other.devices[::-1])
    result = checked(coupled_board(turned, world=CoupledCoils(other.coils)), other)
    assert result.passed or "the chain of devices is wired the other way round" in result.findings


def test_two_faults_are_not_passed():
    board = coupled_board(WIRING)
    board.chain.stick(*board.chain.find(0, 0, "INA"), "open")
    board.chain.stick(*board.chain.find(4, 1, "ground"), "closed")
    result = checked(board, WIRING)
    assert not result.passed
    silent = "does not oscillate with all others grounded"
    wanted = {f"coil1 {silent}", f"coil5, turned round, {silent}"}
    assert wanted | {"coil6 feels a short where end a alone of coil5 is grounded"} <= set(result.symptoms)


def refusing(when):
    """A board of three coils whose converter does not acknowledge some reads, and their count at each."""
    board, count = coupled_board(THREE), itertools.count(1)
    read = board.bus.read

    def read_or_not(register):
        if when(register, next(count)):
            board.bus.refuse()
        return read(register)

    board.bus.read = read_or_not
    return board


def test_a_few_transfers_that_fail_do_not_matter():
    told = []
    board = refusing(lambda register, count: count % 60 == 0)
    assert checked(board, THREE, progress=lambda *step: told.append(step)).passed
    assert told == [(k + 1, 4) for k in range(4)]


def test_a_converter_that_does_not_answer_ends_the_test():
    board = refusing(lambda register, count: register == 0x18)
    refused(BusFault, "did not answer in 3 scans; nothing could be tested", checked, board, THREE)
    assert at_rest(board, THREE)


def test_predictions_of_a_good_board():
    good = Fault("", THREE)
    scan = {trial: good.predict(trial.words) for trial in itertools.chain.from_iterable(trials(THREE))}
    for trial, sight in scan.items():
        assert sight.oscillates == (trial.coil is not None)
        if trial.rest == "ground":
            assert sight.shorted == set(THREE.coils) - {trial.coil}
        else:
            assert sight.shorted == ({trial.other} if trial.grounded == "both" else set())


def test_a_pin_that_leads_to_ground_through_a_coil_is_not_predicted():
    table, switch = switch_table(THREE.encode()), ((1, 0), "INA")  # coil2.a to INA
    place = next((device, bits.index(switch)) for device, bits in enumerate(table) if switch in bits)
    leaky = Fault("", THREE, stuck={place: True})
    alone, *pairs = next(group for group in trials(THREE) if group[0].coil == "coil1" and group[-1].other)
    by_ends = {trial.grounded: leaky.predict(trial.words) for trial in pairs if trial.other == "coil2"}
    assert leaky.predict(alone.words).oscillates
    assert (by_ends["a"].oscillates, by_ends["b"].oscillates, by_ends["both"].oscillates) == (False, None, False)


def test_the_drive_of_every_coil_is_found():
    board = coupled_board(WIRING, world=CoupledCoils(WIRING.coils, resistance=12.0))
    reader = reader_of(board)
    drives = find_drives(reader, settings_of(WIRING))
    assert at_rest(board)
    for name, found in drives.items():
        k = WIRING.coils.index(name)
        # R_p = L/(R C); table 42 has 36 to 37 kΩ in the rows 4 (33.7 to 49.7) to 6 (23.6 to 36.9)
        resistance = 52e-6 * (1 + 0.004 * k) * (1 - 2 * 0.0025) / (12 * 120e-12)
        assert 35e3 < resistance < 38e3
        assert (found.reasons, found.code) == ((), found.proposed)
        assert found.code in (4, 5, 6)


def test_a_wrong_proposal_is_no_hindrance():
    board = coupled_board(WIRING)
    reader = reader_of(board)
    right = find_drives(reader, settings_of(WIRING))
    read = board.bus.read
    for proposed in (0, 31 << 6):
        board.bus.read = lambda register, proposed=proposed: (
            proposed if register == 0x1E and not board.chip.asleep else read(register)
        )
        found = find_drives(reader, settings_of(WIRING))
        assert {drive.proposed for drive in found.values()} == {proposed >> 6}
        assert {drive.reasons for drive in found.values()} == {()}
        for name in WIRING.coils:
            assert (found[name].code <= right[name].code) if not proposed else (found[name].code == right[name].code)


def test_the_proposal_is_read_while_the_converter_is_awake():
    """The emulator clears INIT_IDRIVE in sleep: read asleep, it proposed 0 for every coil."""
    board = coupled_board(WIRING)
    asleep, read = [], board.bus.read

    def reading(register):
        if register == 0x1E:
            asleep.append(board.chip.asleep)
        return read(register)

    board.bus.read = reading
    drives = find_drives(reader_of(board), settings_of(WIRING))
    assert all(found.proposed == found.code > 0 for found in drives.values())
    assert asleep.count(False) == len(WIRING.coils)  # the others are of reading back what was written


def test_a_coil_that_no_current_moves_is_refused():
    world = CoupledCoils(WIRING.coils)
    world.missing.add("coil4")
    reader, message = reader_of(coupled_board(WIRING, world=world)), "coil4 does not oscillate with any drive current: "
    refused(HardwareError, message, find_drives, reader, settings_of(WIRING))


def test_a_coil_of_which_no_code_is_good_gets_the_largest_that_is_not_too_high():
    # R_p = L/(R C) = 470 Ω: even the largest current, 1.56 mA, makes 0.94 V only
    board = coupled_board(THREE, world=CoupledCoils(THREE.coils, capacitance=1e-9, resistance=110.0))
    board.misuse.strict = False
    drives = find_drives(reader_of(board, wiring=THREE), settings_of(THREE))
    assert {drive.code for drive in drives.values()} == {31}
    assert all(drive.reasons == (Reason.AMPLITUDE_LOW,) for drive in drives.values())
