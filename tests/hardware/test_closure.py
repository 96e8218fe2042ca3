"""Rules of switching on the bytes of the settings, against the same rules on the names of the wiring."""

from __future__ import annotations

import dataclasses
import functools
import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.emulated_reader import quick_settings
from support.named_switching import check_words

from coilarray.errors import HardwareError
from coilarray.hardware.scan.settings import ScanSettings
from coilarray.hardware.scan.wiring import load_wiring

BOARDS = [(wiring, quick_settings(wiring)) for wiring in map(load_wiring, ("six_coils", "six_coils_4"))]


def refuses(check, argument):
    try:
        check(argument)
    except HardwareError:
        return True
    return False


@pytest.mark.slow
@pytest.mark.parametrize(("wiring", "settings"), BOARDS)
@given(data=st.data())
def test_words_are_refused_where_the_wiring_refuses_them(wiring, settings, data):
    # words between two legal ones, with a few bits changed, so that both answers come often
    legal = st.sampled_from([state.words for state in settings.states] + [wiring.safe_words, wiring.open_words])
    words = bytearray(data.draw(st.sampled_from(pair)) for pair in zip(data.draw(legal), data.draw(legal), strict=True))
    for _ in range(data.draw(st.integers(0, 3))):
        words[data.draw(st.integers(0, len(words) - 1))] ^= 1 << data.draw(st.integers(0, 7))
    changed = dataclasses.replace(settings, states=(dataclasses.replace(settings.states[0], words=bytes(words)),))
    refused = refuses(ScanSettings.check_switching, changed)
    assert refused == refuses(functools.partial(check_words, wiring), bytes(words))


@pytest.mark.parametrize(("wiring", "settings"), BOARDS)
def test_two_coils_on_the_converter_are_refused(wiring, settings):
    # a coil that is measured instead of grounded changes the same bits whatever the others do
    changes = [bytes(a ^ b for a, b in zip(state.words, wiring.safe_words, strict=True)) for state in settings.states]
    for first, second in itertools.combinations(changes, 2):
        words = bytes(s ^ a ^ b for s, a, b in zip(wiring.safe_words, first, second, strict=True))
        changed = dataclasses.replace(settings, states=(dataclasses.replace(settings.states[0], words=words),))
        with pytest.raises(HardwareError, match="to INA at once"):
            changed.check_switching()


@pytest.mark.parametrize(("wiring", "settings"), BOARDS)
def test_no_other_safe_words_pass_that_differ_in_one_switch(wiring, settings):
    settings.check_switching()
    for device in range(len(wiring.safe_words)):
        for bit in range(8):
            words = bytearray(wiring.safe_words)
            words[device] ^= 1 << bit
            with pytest.raises(HardwareError, match="the safe words"):
                dataclasses.replace(settings, safe_words=bytes(words)).check_switching()
