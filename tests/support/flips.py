"""Damaged files: one is refused, reads as before, or is computed anew; it never becomes something else."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from coilarray.errors import CoilarrayError


def flipped(path: Path, read: Callable[[], Any], count: int, *, seed: int = 0) -> Counter[str]:
    """Flip one bit at a time of a file, spread over all of it, and count as `damaged`."""
    data = path.read_bytes()
    generator = np.random.default_rng(seed)
    bounds = np.linspace(0, 8 * len(data), count + 1)
    bits = generator.uniform(bounds[:-1], bounds[1:]).astype(int).tolist()
    return damaged(path, read, ((f"bit {bit}", _with_bit(data, bit)) for bit in bits))


def _with_bit(data: bytes, bit: int) -> bytes:
    changed = bytearray(data)
    changed[bit // 8] ^= 1 << bit % 8
    return bytes(changed)


def cuts(data: bytes, most: int) -> Iterator[tuple[str, bytes]]:
    """Cut a file at every place, or at so many spread over it and at each of the last twenty bytes."""
    places = set(np.linspace(0, len(data) - 1, most).astype(int).tolist()) | set(range(len(data))[-20:])
    for place in sorted(places):
        yield f"cut at {place}", data[:place]


def wrong_lines(data: bytes) -> Iterator[tuple[str, bytes]]:
    """Drop each line of a file and double it, and swap it with the next other one and with another one further on."""
    lines = data.splitlines(keepends=True)
    for k, line in enumerate(lines):
        yield f"without line {k + 1}", b"".join(lines[:k] + lines[k + 1 :])
        yield f"line {k + 1} twice", b"".join([*lines[:k], line, *lines[k:]])
        for other in (k + 1, k + len(lines) // 2):
            if other < len(lines) and lines[other] != line:
                swapped = [*lines[:k], lines[other], *lines[k + 1 : other], line, *lines[other + 1 :]]
                yield f"lines {k + 1} and {other + 1} swapped", b"".join(swapped)


def damaged(path: Path, read: Callable[[], Any], changes: Iterable[tuple[str, bytes]]) -> Counter[str]:
    """Change a file in one way after the other and count what `read` makes of it, by "refused", "same" and "anew".

    `read` returns all that enters a result, to be compared with ==, and None for a file whose content is computed anew.
    `changes` are names of changes and what the file then is. Fails at the first of which nobody would know: by another
    result, or by an error that is not the package's. The file is as before in the end, and so is its folder.
    """
    before = {one: one.read_bytes() for one in path.parent.iterdir() if one.is_file()}
    expected = read()
    assert expected is not None
    counts: Counter[str] = Counter()
    for name, data in changes:
        _restore(path.parent, before)
        path.write_bytes(data)
        try:
            found = read()
        except CoilarrayError:
            counts["refused"] += 1
            continue
        except Exception as error:
            raise AssertionError(f"{name} of {path.name}: {type(error).__name__}: {error}") from error
        assert found is None or found == expected, f"{name} of {path.name} gives another result in silence"
        counts["anew" if found is None else "same"] += 1
    _restore(path.parent, before)
    assert read() == expected
    return counts


def _restore(folder: Path, before: dict[Path, bytes]) -> None:
    """Write the files of a folder as they were, and delete others."""
    for one in folder.iterdir():
        if one.is_file() and one not in before:
            one.unlink()
    for one, data in before.items():
        if not one.exists() or one.read_bytes() != data:
            one.write_bytes(data)
