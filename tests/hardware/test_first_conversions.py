"""First conversions after sleep: how many are off, how far, and what is recommended, on emulated boards."""

import dataclasses

import pytest
from support.coupled_coils import CoupledCoils, coupled_board
from support.emulated_reader import WIRING, at_rest, plain, quick_settings, reader_of

from coilarray.hardware.board.first_conversions import DISCARDS, first_conversions

SETTINGS = quick_settings(rcount=0x2000, clock=43.4e6)
CODE = 2.05e6 / 21.7e6 * 2**28  # of the fastest coil, 50 µH; the others have up to 5 % less


def test_a_board_without_the_effect_throws_nothing_away():
    board, told = plain(noise=1.4e-7), []
    found = first_conversions(reader_of(board), SETTINGS, progress=lambda *step: told.append(step))
    assert (found.recommended, found.settled, found.order_matters) == (0, True, False)
    assert set(found.offsets) == set(found.backwards) == set(WIRING.coils)
    # noise of 4e-7 a conversion, three of each: their difference is 3e-7 on average
    assert max(abs(one) for row in found.offsets.values() for one in row) < found.noticeable < 4e-6
    assert told == [(k, 7) for k in range(1, 8)]
    assert at_rest(board)


@pytest.mark.parametrize(("first", "recommended"), [(30.0, 0), (300.0, 2), (40_000.0, 8)])
def test_what_is_thrown_away_leaves_no_noticeable_offset(first, recommended):
    """A quarter is left after each conversion: 40 000 codes after four are 156, or 6e-6, and after eight none."""
    board = plain(first_offset=first)
    found = first_conversions(reader_of(board), SETTINGS)
    assert (found.recommended, found.settled) == (recommended, True)
    assert found.noticeable == 2e-6
    for offsets in found.offsets.values():
        wanted = [first / 4**discard / CODE for discard in DISCARDS]
        # f is 0 to 5 % smaller than the one of CODE; a code is 4e-8
        assert offsets == pytest.approx(wanted, rel=0.06, abs=1e-7)


def test_noise_hides_small_offsets():
    noisy = first_conversions(reader_of(plain(noise=1e-5, first_offset=300.0)), SETTINGS)
    assert noisy.noticeable > 5e-5
    assert noisy.recommended == 0


def test_what_does_not_settle_is_told():
    board = plain()
    reader = reader_of(board)
    scan, discard = reader.scan, [0]
    configure = reader.configure

    def configured(settings):
        discard[0] = settings.discard
        configure(settings)

    def drifting():  # the more is thrown away the lower the code, without end
        found = scan()
        samples = tuple(dataclasses.replace(one, lsb=max(one.lsb - 500 * discard[0], 0)) for one in found.samples)
        return dataclasses.replace(found, samples=samples)

    reader.configure, reader.scan = configured, drifting
    found = first_conversions(reader, SETTINGS)
    assert (found.recommended, found.settled) == (15, False)


def test_a_state_that_feels_the_one_before_it():
    board = plain()
    board.conditions.first_offset = 100.0
    shift, number = board.switches.shift, {}

    def shifted(words):  # the fourth coil is measured after the third or the fifth
        for k, state in enumerate(SETTINGS.states):
            if words == state.words:
                number["before"], number["now"] = number.get("now"), k
        board.conditions.first_offset = 1e5 if number.get("now") == 3 and number.get("before") == 4 else 0.0
        return shift(words)

    board.switches.shift = shifted
    found = first_conversions(reader_of(board), SETTINGS)
    assert found.recommended == 0
    assert found.order_matters
    assert [name for name, change in found.backwards.items() if abs(change) > found.noticeable] == ["coil4"]


def test_a_coil_that_does_not_oscillate_is_left_out():
    world = CoupledCoils(WIRING.coils)
    world.missing.add("coil4")
    settings = quick_settings(rcount=0x2000, drives=8, quality=150.0)
    found = first_conversions(reader_of(coupled_board(WIRING, world=world)), settings)
    assert set(found.offsets) == set(found.backwards) == set(WIRING.coils) - {"coil4"}
    world.missing.update(WIRING.coils)
    found = first_conversions(reader_of(coupled_board(WIRING, world=world)), settings)
    assert (found.offsets, found.backwards, found.recommended) == ({}, {}, 0)
