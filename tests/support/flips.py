"""Flipped bits: a file with one of them is refused, reads as before, or is computed anew; never something else."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from coilarray.errors import CoilarrayError


def flipped(path: Path, read: Callable[[], Any], count: int, *, seed: int = 0) -> Counter[str]:
    """Flip one bit at a time of a file and count what `read` makes of it, by "refused", "same" and "anew".

    `read` returns all that enters a result, to be compared with ==, and None for a file whose content is computed anew.
    The bits are spread over the whole file. Fails at the first flip of which nobody would know: by another result, or
    by an error that is not the package's. The file is as before in the end, and so is its folder.
    """
    data, before = path.read_bytes(), {one: one.read_bytes() for one in path.parent.iterdir() if one.is_file()}
    expected = read()
    assert expected is not None
    generator = np.random.default_rng(seed)
    bounds = np.linspace(0, 8 * len(data), count + 1)
    counts: Counter[str] = Counter()
    for bit in generator.uniform(bounds[:-1], bounds[1:]).astype(int).tolist():
        _restore(path.parent, before)
        changed = bytearray(data)
        changed[bit // 8] ^= 1 << bit % 8
        path.write_bytes(changed)
        try:
            found = read()
        except CoilarrayError:
            counts["refused"] += 1
            continue
        except Exception as error:
            raise AssertionError(f"bit {bit} of {path.name}: {type(error).__name__}: {error}") from error
        assert found is None or found == expected, f"bit {bit} of {path.name} gives another result in silence"
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
