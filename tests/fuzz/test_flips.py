"""Every kind of file that is written and read back, a bit flipped, cut, or lines lost: no result changes in silence."""

from collections import Counter

import numpy as np
import pytest

from coilarray.errors import CoilarrayError, LocalizeError
from fuzz.kinds import KINDS, read_readings
from fuzz.run import digest

WRITTEN = {kind.name: kind for kind in KINDS if kind.name == "recording" or kind.sealed or kind.name == "ellipse model"}


def examples(tmp_path, name):
    """Good files of a kind, with a reader that gives a digest of all that is read, or raises."""
    kind = WRITTEN[name]

    def read(path):
        if kind.suffix != ".csv":
            return digest(kind.read(path))
        found = read_readings(str(path))
        for one in found:
            if isinstance(one, LocalizeError):
                raise one
        return digest(found)

    return [(path, lambda path=path: read(path)) for path in kind.write_examples(tmp_path)]


def cuts(data, most):
    """Cut a file at places spread over it and at each of the last twenty bytes."""
    places = set(np.linspace(0, len(data) - 1, most).astype(int).tolist()) | set(range(len(data))[-20:])
    for place in sorted(places):
        yield f"cut at {place}", data[:place]


def flips(data, count):
    """Flip one bit at a time, spread over all of a file."""
    bounds = np.linspace(0, 8 * len(data), count + 1)
    for bit in np.random.default_rng(0).uniform(bounds[:-1], bounds[1:]).astype(int).tolist():
        changed = bytearray(data)
        changed[bit // 8] ^= 1 << bit % 8
        yield f"bit {bit}", bytes(changed)


def wrong_lines(data):
    """Drop each line of a file and double it, and swap it with the next other one and with another one further on."""
    lines = data.splitlines(keepends=True)
    for k, line in enumerate(lines):
        yield f"without line {k + 1}", b"".join(lines[:k] + lines[k + 1 :])
        yield f"line {k + 1} twice", b"".join([*lines[:k], line, *lines[k:]])
        for other in (k + 1, k + len(lines) // 2):
            if other < len(lines) and lines[other] != line:
                swapped = [*lines[:k], lines[other], *lines[k + 1 : other], line, *lines[other + 1 :]]
                yield f"lines {k + 1} and {other + 1} swapped", b"".join(swapped)


def damaged(path, read, changes):
    """Change a file in one way after the other; it is refused, or reads as before. Count both."""
    before = {one: one.read_bytes() for one in path.parent.iterdir() if one.is_file()}
    expected, counts = read(), Counter()
    for name, data in changes:
        for one in set(path.parent.iterdir()) - before.keys():
            one.unlink()
        for one, whole in before.items():
            one.write_bytes(whole)
        path.write_bytes(data)
        try:
            assert read() == expected, f"{name} gives another result in silence"
        except CoilarrayError:
            counts["refused"] += 1
        else:
            counts["same"] += 1
    return counts


@pytest.mark.slow
@pytest.mark.parametrize("name", WRITTEN)
def test_no_flipped_bit_and_no_cut_changes_a_result_in_silence(tmp_path, name):
    for path, read in examples(tmp_path, name):
        data = path.read_bytes()
        assert damaged(path, read, [*flips(data, 50), *cuts(data, 20)])["refused"] > 10
        path.write_bytes(data)


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name, kind in WRITTEN.items() if kind.sealed])
def test_every_line_that_is_lost_doubled_or_swapped_and_every_cut_is_refused(tmp_path, name):
    ((path, read),) = examples(tmp_path, name)
    data = path.read_bytes()
    counts = damaged(path, read, wrong_lines(data))
    assert counts.keys() == {"refused"}
    assert counts.total() > 3 * data.count(b"\n") - 12
    path.write_bytes(data)
    assert damaged(path, read, cuts(data, 300)).keys() == {"refused"}


def test_lines_of_an_ellipse_model(tmp_path):
    ((path, read),) = examples(tmp_path, "ellipse model")
    assert damaged(path, read, wrong_lines(path.read_bytes()))["refused"] > 100  # a key may stand there twice
