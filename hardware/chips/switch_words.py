"""Words of switches and the bytes of a daisy chain.

A word has one bit for each switch of a package.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from coilarray.errors import HardwareError, listed, shown

ALL_OPEN = 0x00
"""Word that opens every switch. It is also the state after power-on."""


def switch_word(closed: Iterable[str], bits: Sequence[str]) -> int:
    """Return the word that closes the given switches.

    All other switches are opened. `bits` names the switches from bit 0 to bit 7. An unknown name raises a
    HardwareError.

    >>> from coilarray.design.switch_parts import switch_part
    >>> hex(switch_word(["S1A", "S1B"], switch_part("ADG739").bits))
    '0x11'
    """
    word = ALL_OPEN
    for name in closed:
        if name not in bits:
            raise HardwareError(f"a switch must be one of {', '.join(bits)}; got {name!r}.")
        word |= 1 << bits.index(name)
    return word


def chain_bytes(words: Sequence[int]) -> bytes:
    """Return the bytes to shift into a chain of switches.

    The words are from 0 to 255, with the device next to the computer first. The first byte moves to the far end, so the
    order is reversed. An empty chain or a word beyond a byte raises a HardwareError.

    >>> chain_bytes([0x22, 0x11, 0x11]).hex()
    '111122'
    """
    if not words:
        raise HardwareError("a chain must have at least one device; got none.")
    wrong = [word for word in words if not 0 <= word <= 0xFF]
    if wrong:
        raise HardwareError(f"the word of a switch must be 0 to 255; got {wrong[0]}.")
    return bytes(reversed(words))


def check_bits(bits: Sequence[str], known: Sequence[str]) -> tuple[str, ...]:
    """Return the names of the switches by bit.

    A missing known switch or an unknown switch raises a HardwareError.
    """
    if sorted(bits) != sorted(known):
        got = listed(map(shown, bits)) or "none"
        raise HardwareError(f"bits must name each of {', '.join(known)} once; got {got}.")
    return tuple(bits)
