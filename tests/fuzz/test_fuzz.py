"""A short run over every kind of file; ``python tests/fuzz --cases 20000`` is the long one."""

import pytest

pytest.importorskip("resource", reason="limits of time and memory as Unix has them")

from coilarray.errors import CoilarrayError
from fuzz import run as module
from fuzz.kinds import KINDS, Kind
from fuzz.mutations import bytes_changed
from fuzz.run import OUTCOMES, Bench, cases, names_key, run_cases, table

CASES = 2
"""Of a kind, times its share: ten seconds of processor time in all."""


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    """The bench with the good files of every kind."""
    return Bench(tmp_path_factory.mktemp("fuzz"))


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
def test_mutated_files_are_refused_or_read(bench, kind):
    """The first cases of the long run."""
    bad = [one for k in range(CASES * kind.share) if (one := bench.run(kind.name, k)).outcome not in OUTCOMES[:3]]
    assert not bad, bad[0]
    assert bench.mutated(kind, 0) == bench.mutated(kind, 0)  # a case is decided by its number


def _raise(error):
    def read(path):
        raise error

    return read


def _loop(path):
    while True:
        path.name.split(".")


@pytest.mark.parametrize(
    ("read", "outcome", "said", "more"),
    [
        (lambda path: path.read_text(), "changed", "", {}),
        (lambda path: {"a": [1.0, float("inf")]}, "silent", "the answer has inf", {}),
        (lambda path: float("nan"), "changed", "", {"gaps": True}),
        (lambda path: 1.0, "silent", "no", {"wrong": lambda answer: "no"}),
        (_raise(CoilarrayError("file: x must be 1.")), "refused", "file: x must be 1.", {"keyed": True}),
        (_raise(CoilarrayError("x" * 301)), "tracebacks", "301 characters", {}),
        (_raise(CoilarrayError("file: bad value.")), "tracebacks", "no key", {"keyed": True}),
        (_raise(KeyError("x")), "tracebacks", "KeyError", {}),
        (_loop, "hangs", "HangError", {}),
    ],
)
def test_what_is_judged(bench, monkeypatch, read, outcome, said, more):
    monkeypatch.setattr(module, "SECONDS", 0.2)
    found, why = bench.judge(Kind("made up", ".txt", lambda folder: [], (bytes_changed,), read, **more), b"x = 1")
    assert found == outcome
    assert said in why


@pytest.mark.parametrize(
    ("message", "named"),
    [
        ("coils.a.gap_mm must be a number; got 'x'.", True),
        ("elastomer.0.thickness_mm must be at most 1.", True),
        ("thickness_mm must be at most 1.", True),
        ("coils.a.turns is missing.", True),  # of a table that is there
        ("needs the table [indenter] too.", True),
        ("something is wrong.", False),
        ("the shape of the coil has no gap and a name is wrong.", False),  # English words that are keys elsewhere
    ],
)
def test_what_names_a_key(message, named):
    data = b'[coils.a]\ngap_mm = 1\n[array]\npitch_mm = 2\n[[elastomer]]\nname = "base"\nthickness_mm = 2\n'
    assert names_key(f"file.toml: {message}", data) == named


@pytest.mark.slow
def test_the_table_counts_every_case():
    wanted = list(cases(6, [kind for kind in KINDS if kind.name in ("goal", "temperature")]))
    rows = [[cell.strip() for cell in line.split("|")] for line in table(run_cases(wanted, 1)).splitlines()]
    assert rows[0] == ["kind", "cases", *OUTCOMES]
    assert [row[0] for row in rows[1:]] == ["goal", "temperature", "all"]
    assert int(rows[-1][1]) == len(wanted) == sum(map(int, rows[-1][2:]))
    assert rows[-1][-3:] == ["0", "0", "0"]
