"""ADG739: eight switches, one bit each, and the bytes of a daisy chain of them.

The order of the bits is an assumption, since the data sheet of this part was not available; it is therefore an
argument, and a self-test that closes one switch after the other must confirm it. Drivers of sibling parts, which close
switches of the same number in A and B with the words 0x11 and 0x88, support it.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from coilarray.errors import HardwareError

SWITCHES = ("S1A", "S2A", "S3A", "S4A", "S1B", "S2B", "S3B", "S4B")
"""Names of the switches from bit 0 to bit 7, as assumed. S1A joins the pins S1A and DA, S1B the pins S1B and DB."""
ALL_OPEN = 0x00
"""Word that opens every switch; also the state after power-on."""


def switch_word(closed: Iterable[str], bits: Sequence[str] = SWITCHES) -> int:
    """Return the word that closes these switches and opens all others; `bits` names those from bit 0 to bit 7.

    HardwareError for a name that is none of the switches, or bits that are not the eight of them.

    >>> hex(switch_word(["S1A", "S1B"]))
    '0x11'
    """
    order, word = check_bits(bits), ALL_OPEN
    for name in closed:
        if name not in order:
            raise HardwareError(f"a switch must be one of {', '.join(order)}; got {name!r}.")
        word |= 1 << order.index(name)
    return word


def chain_bytes(words: Sequence[int]) -> bytes:
    """Return the bytes to shift into a chain: words of 0 to 255, the device next to the computer first.

    The first byte moves to the far end, so the order is reversed. HardwareError for no word, or one beyond a byte.

    >>> chain_bytes([0x22, 0x11, 0x11]).hex()
    '111122'
    """
    if not words:
        raise HardwareError("a chain must have at least one device; got none.")
    wrong = [word for word in words if not 0 <= word <= 0xFF]
    if wrong:
        raise HardwareError(f"the word of a switch must be 0 to 255; got {wrong[0]}.")
    return bytes(reversed(words))


def check_bits(bits: Sequence[str]) -> tuple[str, ...]:
    """Return the eight names; HardwareError for a switch that is missing, named twice or unknown."""
    if sorted(bits) != sorted(SWITCHES):
        raise HardwareError(f"bits must name each of {', '.join(SWITCHES)} once; got {', '.join(bits) or 'none'}.")
    return tuple(bits)
