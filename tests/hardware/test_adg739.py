"""ADG739: words of switches, and bytes of a chain whose far end is sent first."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from coilarray.errors import HardwareError
from coilarray.hardware.chips.adg739 import ALL_OPEN, SWITCHES, chain_bytes, switch_word

orders = st.permutations(SWITCHES)


@pytest.mark.parametrize(
    ("closed", "word"),
    [
        # facts: ground both, measure, measure reversed, float, ground one end
        (("S1A", "S1B"), 0x11),
        (("S2A", "S2B"), 0x22),
        (("S3A", "S3B"), 0x44),
        ((), ALL_OPEN),
        (("S1A",), 0x01),
        (("S1B",), 0x10),
        (("S4B",), 0x80),
    ],
)
def test_words(closed, word):
    assert switch_word(closed) == word


@pytest.mark.slow
@given(st.sets(st.sampled_from(SWITCHES)), orders)
def test_each_switch_has_its_own_bit(closed, bits):
    word = switch_word(closed, bits)
    assert word.bit_count() == len(closed)
    assert closed == {name for bit, name in enumerate(bits) if word >> bit & 1}


@pytest.mark.slow
@given(st.lists(st.integers(0, 0xFF), min_size=1, max_size=12))
def test_chain_shifts_like_a_register(words):
    """A chain of shift registers, bit by bit, most significant first: each device ends with its own word."""
    held = [0] * len(words)  # the device next to the computer first
    for byte in chain_bytes(words):
        for bit in range(7, -1, -1):
            carried = byte >> bit & 1
            for k, value in enumerate(held):
                held[k], carried = (value << 1 & 0xFF) | carried, value >> 7
    assert held == words


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: switch_word(["S5A"]), "a switch must be one of S1A, .*; got 'S5A'"),
        (lambda: switch_word([], SWITCHES[:7]), "bits must name each of .* once; got S1A, .*S3B"),
        (lambda: switch_word([], ()), "got none"),
        (lambda: switch_word([], ("S1A",) * 8), "bits must name each of S1A"),
        (lambda: chain_bytes([]), "a chain must have at least one device; got none"),
        (lambda: chain_bytes([0x11, 300]), "the word of a switch must be 0 to 255; got 300"),
    ],
)
def test_refused(call, message):
    with pytest.raises(HardwareError, match=message):
        call()
