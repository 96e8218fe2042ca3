"""Closure self-test: every single fault of switches, coils and maps is found on an emulated board, and named.

The board has each fault in its own chips (a stuck switch in the chain, a coil that is not in the world, another
netlist); the test knows the wiring as assumed and sees scans.
"""

import dataclasses
import itertools

import pytest
from support.emulated_reader import WIRING, at_rest, quick_settings, reader_of
from support.quick_coils import CoupledCoils, coupled_board
from support.refusals import refused

from coilarray.errors import HardwareError
from coilarray.hardware.board.self_test import find_drives, self_test, single_faults
from coilarray.hardware.scan.wiring import load_wiring
from coilarray.hardware.wire.buses import BusFault

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
def test_boards_with_noise_pass():
    assert all(checked(coupled_board(THREE, seed=seed, noise=5e-7), THREE).passed for seed in range(6))


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


def test_words_that_never_arrive_are_found():
    board = coupled_board(THREE)
    board.chain.readback = False
    board.chain.broken = True
    # maps that let nothing oscillate show the same; the nearest comes first
    assert checked(board, THREE).findings[0] == "no word reaches the switches, or the converter is not joined to them"


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


def test_a_converter_that_does_not_answer_ends_the_test():
    board = refusing(lambda register, count: register == 0x18)
    refused(BusFault, "did not answer in 3 scans; nothing could be tested", checked, board, THREE)
    assert at_rest(board, THREE)


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


def test_a_coil_that_no_current_moves_is_refused():
    world = CoupledCoils(WIRING.coils)
    world.missing.add("coil4")
    reader, message = reader_of(coupled_board(WIRING, world=world)), "coil4 does not oscillate with any drive current: "
    refused(HardwareError, message, find_drives, reader, settings_of(WIRING))
