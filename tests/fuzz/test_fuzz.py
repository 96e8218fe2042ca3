"""A short run over every kind of file, and the harness itself; ``python tests/fuzz --cases 20000`` is the long one."""

from __future__ import annotations

import json

import numpy as np
import pytest
import tomli_w

pytest.importorskip("resource", reason="limits of time and memory as Unix has them")

from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from coilarray.errors import CoilarrayError
from fuzz import mutations
from fuzz import run as module
from fuzz.kinds import KINDS, Kind
from fuzz.mutations import bytes_changed
from fuzz.run import OUTCOMES, Bench, cases, names_key, run_cases, table, unclear

GOOD = OUTCOMES[:3]
CASES = 3
"""Of a kind, times its share: a quarter of a minute of processor time in all."""

_LEAF = st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8)
_TREE = st.recursive(
    _LEAF, lambda one: st.lists(one, max_size=3) | st.dictionaries(st.text(max_size=8), one, max_size=3)
)


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    """The bench with the good files of every kind."""
    return Bench(tmp_path_factory.mktemp("fuzz"))


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
def test_mutated_files_are_refused_or_read(bench, kind):
    """The first cases of the long run."""
    bad = [one for k in range(CASES * kind.share) if (one := bench.run(kind.name, k)).outcome not in GOOD]
    assert not bad, bad[0]


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
def test_any_bytes_are_refused_or_read(bench, kind):
    @settings(max_examples=6, database=None, deadline=None, suppress_health_check=list(HealthCheck))
    @given(data=st.binary(max_size=60) | st.text(max_size=60).map(str.encode) | _TREE.map(lambda one: _text(kind, one)))
    def tried(data):
        outcome, said = bench.judge(kind, data)
        assert outcome in GOOD, said

    tried()


def _text(kind, tree):
    if kind.suffix == ".toml":
        try:
            return tomli_w.dumps(tree).encode() if isinstance(tree, dict) else b"a = 1"
        except (TypeError, ValueError):  # TOML has no nothing
            return b""
    return json.dumps(tree).encode("utf-8", "replace")


def _of(read, **more):
    return Kind("made up", ".txt", lambda folder: [], (bytes_changed,), read, **more)


def _raise(error):
    def read(path):
        raise error

    return read


def _loop(path):
    while True:
        path.name.split(".")


@pytest.mark.parametrize(
    ("kind", "outcome", "said"),
    [
        (_of(lambda path: path.read_text()), "changed", ""),
        (_of(lambda path: {"a": [1.0, float("inf")]}), "silent", "the answer has inf"),
        (_of(lambda path: float("nan")), "silent", "the answer has nan"),
        (_of(lambda path: float("nan"), gaps=True), "changed", ""),
        (_of(lambda path: 1.0, wrong=lambda answer: "no"), "silent", "no"),
        (_of(_raise(CoilarrayError("file: x must be 1."))), "refused", "file: x must be 1."),
        (_of(_raise(CoilarrayError("x" * 301))), "tracebacks", "301 characters"),
        (_of(_raise(CoilarrayError(""))), "tracebacks", "empty"),
        (_of(_raise(CoilarrayError("file: bad value.")), keyed=True), "tracebacks", "no key"),
        (_of(_raise(KeyError("x"))), "tracebacks", "KeyError"),
        (_of(_loop), "hangs", "HangError"),
    ],
)
def test_what_is_judged(bench, monkeypatch, kind, outcome, said):
    monkeypatch.setattr(module, "SECONDS", 0.2)
    found, why = bench.judge(kind, b"x = 1")
    assert found == outcome
    assert said in why


def test_an_error_is_one_printable_line():
    assert str(CoilarrayError("a\nb\x1b[31m\u202ec")) == "a b�[31m�c"
    assert len(str(CoilarrayError("x" * 10_000))) <= 501
    assert unclear("two\nlines", None)


@pytest.mark.parametrize(
    ("message", "named"),
    [
        ("coils.a.gap_mm must be a number; got 'x'.", True),
        ("elastomer.0.thickness_mm must be at most 1.", True),
        ("elastomer.thickness_mm must be at most 1.", True),
        ("thickness_mm must be at most 1.", True),
        ("coils.a.turns is missing.", True),  # of a table that is there
        ("schema is missing.", True),
        ("needs the table [indenter] too.", True),
        ("has no key 'x'; allowed are y.", True),
        ("array needs columns.", True),
        ("something is wrong.", False),
        ("the shape of the coil has no gap and a name is wrong.", False),  # English words that are keys elsewhere
        ("base must be thinner.", False),
        ("its min_trace_mm is too small.", False),  # a key that the file does not have
        ("answer is missing.", False),
    ],
)
def test_what_names_a_key(message, named):
    data = b'[coils.a]\ngap_mm = 1\n[array]\npitch_mm = 2\n[[elastomer]]\nname = "base"\nthickness_mm = 2\n'
    assert names_key(f"file.toml: {message}", data) == named


@pytest.mark.parametrize(
    ("message", "named"),
    [
        ("coils.a.gap_mm must be a number; got 'x'.", True),
        ("coils.a.turns must be whole with that gap.", True),  # of the same table
        ("the table coils.a cannot be.", True),  # which holds it
        ("coils.b.turns must be whole.", False),
        ("array.pitch_mm must be larger.", False),
        ("array.coil must be b; got 'wide'.", True),  # quotes what has changed
    ],
)
def test_the_key_that_is_named_has_to_do_with_the_change(message, named):
    before = b"[coils.a]\ngap_mm = 1\nturns = 3\n[coils.b]\nturns = 3\n[array]\npitch_mm = 2\ncoil = 'a'\n"
    data = before.replace(b"gap_mm = 1", b"gap_mm = 'wide'")
    assert names_key(f"file.toml: {message}", data)
    assert names_key(f"file.toml: {message}", data, before) == named


def test_a_case_is_decided_by_its_number(tmp_path):
    first, second = (Bench(tmp_path / name) for name in ("a", "b"))
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
    kind = next(one for one in KINDS if one.name == "goal")
    assert [first.mutated(kind, k)[1] for k in range(20)] == [second.mutated(kind, k)[1] for k in range(20)]
    assert len({first.mutated(kind, k)[1] for k in range(20)}) > 15


def test_a_mutation_leaves_nothing_behind():
    """What one case puts into a tree is not what another one gets."""
    before = repr(mutations.VALUES)
    for number in range(2000):
        random = np.random.default_rng([1, number])
        mutations.toml_changed(random, b"a = [1, 2]\n[b]\nc = [[1], [2, 3]]\n")
    assert repr(mutations.VALUES) == before


@pytest.mark.slow
def test_the_table_counts_every_case():
    chosen = [kind for kind in KINDS if kind.name in ("goal", "temperature")]
    wanted = list(cases(12, chosen))
    outcomes = run_cases(wanted, 1)
    rows = [[cell.strip() for cell in line.split("|")] for line in table(outcomes).splitlines()]
    assert rows[0] == ["kind", "cases", *OUTCOMES]
    assert [row[0] for row in rows[1:]] == ["goal", "temperature", "all"]
    assert int(rows[-1][1]) == len(wanted) == sum(map(int, rows[-1][2:]))
    assert rows[-1][-3:] == ["0", "0", "0"]
