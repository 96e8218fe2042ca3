"""What can happen to lines on a wire, and a serial line at the level of its bits."""

from __future__ import annotations

import random
from collections.abc import Callable
from dataclasses import dataclass, field


def at_another_rate(data: bytes, ratio: float) -> bytes:
    """Bytes that a receiver takes from a line whose rate is `ratio` times its own: start bit, eight bits, stop bit."""
    levels = [1] * 12
    for byte in data:
        levels += [0, *(byte >> bit & 1 for bit in range(8)), 1]
    levels += [1] * 12
    taken, start = bytearray(), 1
    while True:
        edge = next((k for k in range(start, len(levels)) if levels[k - 1] and not levels[k]), None)
        if edge is None:
            return bytes(taken)
        middles = [int(edge + (bit + 1.5) * ratio) for bit in range(8)]
        taken.append(sum(levels[min(place, len(levels) - 1)] << bit for bit, place in enumerate(middles)))
        start = max(int(edge + 9.5 * ratio), edge + 1)


@dataclass(frozen=True)
class Damaged:
    """A line as it comes out of a fault.

    `lost` is whether nothing is left of the line; `next_too` whether the line after it may go with it.
    """

    data: bytes
    lost: bool = True
    next_too: bool = False
    later: bytes = b""
    """Comes after the next line."""


OTHER_RATES = [0.5, 2.0, 12.0, 1.2, 0.8]
Damage = Callable[[bytes, random.Random], Damaged]


def flipped(line: bytes, noise: random.Random) -> Damaged:
    """Any bits of one or two bytes."""
    data = bytearray(line)
    while data == line:
        for _ in range(noise.randint(1, 2)):
            place = noise.randrange(len(line) - 1)
            data[place] ^= noise.choice([1 << noise.randrange(8), noise.randint(1, 255)])
    return Damaged(bytes(data))


def digit_changed(line: bytes, noise: random.Random) -> Damaged:
    """One hexadecimal digit of a word becomes another: what only the checksum can see."""
    places = [place for place in range(32, len(line) - 6) if line[place : place + 1] not in (b",", b".", b"!")]
    place = noise.choice(places)
    digit = noise.choice([d for d in b"0123456789ABCDEF" if d != line[place]])
    return Damaged(line[:place] + bytes([digit]) + line[place + 1 :])


def _moved(line: bytes, noise: random.Random, sign: int) -> Damaged:
    """A line that goes on one to four bytes later or earlier than it was left."""
    count = noise.randint(1, 4)
    place = noise.randrange(len(line) - 1 - count)
    left, on = (place, place + count) if sign > 0 else (place + count, place)
    return Damaged(line[:left] + line[on:])


def inserted(line: bytes, noise: random.Random) -> Damaged:
    """One to four bytes that nobody sent, whatever they are."""
    place = noise.randrange(1, len(line) - 1)
    return Damaged(line[:place] + noise.randbytes(noise.randint(1, 4)) + line[place:])


def swapped(line: bytes, noise: random.Random) -> Damaged:
    """Two bytes change places."""
    first = second = 0
    while line[first] == line[second]:
        first, second = sorted(noise.sample(range(len(line) - 1), 2))
    data = bytearray(line)
    data[first], data[second] = data[second], data[first]
    return Damaged(bytes(data))


def noisy(line: bytes, noise: random.Random) -> Damaged:
    """Any bytes come before the line, and it runs into them."""
    garbage = bytes(noise.choice([byte for byte in range(256) if byte != 10]) for _ in range(noise.randint(1, 40)))
    return Damaged(garbage + line)


DAMAGES: dict[str, Damage] = {
    "flipped": flipped, "digit_changed": digit_changed, "inserted": inserted, "swapped": swapped, "noisy": noisy,
    # one to four bytes are missing, or come twice
    "dropped": lambda line, noise: _moved(line, noise, 1),
    "repeated": lambda line, noise: _moved(line, noise, -1),
    # only the beginning arrives, and what follows runs into it; only the end does; nothing does
    "begun": lambda line, noise: Damaged(line[: noise.randrange(1, len(line) - 1)], next_too=True),
    "ended": lambda line, noise: Damaged(line[noise.randrange(1, len(line) - 1) :]),
    "missing": lambda line, noise: Damaged(b""),
    # the whole line arrives twice, or after the one that follows it
    "twice": lambda line, noise: Damaged(line + line, lost=False),
    "late": lambda line, noise: Damaged(b"", later=line),
    # a line without end comes before it
    "endless": lambda line, noise: Damaged(b"S" * noise.randint(513, 3000) + line),
    # it arrives at another rate than it was sent at
    "other_rate": lambda line, noise: Damaged(at_another_rate(line, noise.choice(OTHER_RATES)), next_too=True),
}  # fmt: skip


@dataclass
class FaultyLine:
    """The line from board to computer, which damages every second or third scan of a stream, then none."""

    damage: Damage
    faults: int
    noise: random.Random
    done: int = 0
    lost: set[int] = field(default_factory=set)
    perhaps: set[int] = field(default_factory=set)
    sound_until: int = -1
    later: bytes = b""

    def __call__(self, line: bytes) -> bytes:
        """The hook `to_computer` of the firmware's host."""
        if not line.startswith(b"S"):
            return line
        number = int(line[1:9], 16)
        later, self.later = self.later, b""
        if self.done >= self.faults or number <= self.sound_until or self.noise.random() < 0.3:
            return line + later
        damaged = self.damage(line, self.noise)
        self.done += 1
        if damaged.lost:
            self.lost.add(number)
        if damaged.next_too:
            self.perhaps.add(number + 1)
        self.sound_until = number + 1 + damaged.next_too
        self.later = damaged.later
        return damaged.data + later
