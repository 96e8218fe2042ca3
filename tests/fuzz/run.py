"""Cases of mutated files in worker processes, each with bounds of time and memory, and the table of their outcomes.

A case is a kind and a number; with `SEED` they decide which example is mutated and how. Its outcome is one of

- refused: a `CoilarrayError` in one line of at most 300 characters, for kinds that have keys with a key
- same: an answer equal to that for the file as it was
- changed: another answer, all of whose numbers are finite and which no check of its kind contradicts
- traceback: any other exception, a warning that is not ours included, or a refusal that is not one clear line
- hang: more than 20 s of processor time, or a worker that does not end
- silent: an answer with a number that is not finite where none may be missing, one that contradicts itself, and
  another one than before for a text file with a checksum

What a file says in place of what it said cannot be told from a good file without a checksum: such a case is "changed".
"""

from __future__ import annotations

import argparse
import hashlib
import json
import math
import multiprocessing
import os
import re
import resource
import signal
import sys
import tempfile
import time
import tomllib
import traceback
import warnings
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, is_dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from coilarray.design.keys import Table
from coilarray.errors import CoilarrayError, UnusualValueWarning
from fuzz import mutations
from fuzz.kinds import KINDS, Kind, numbers_of

SEED = 23
"""Of every case; fixed before the first run."""

OUTCOMES = ("refused", "same", "changed", "tracebacks", "hangs", "silent")
"""Columns of the table after the number of cases."""

SECONDS = 20.0
"""Processor time after which a case is a hang."""

LONGEST_MESSAGE = 300
"""Characters of an error, without the path of the file."""

_WALL_SECONDS = 600.0  # without any end: a loop in C that takes no signal, or a worker that died
_MEMORY = 12 << 30  # bytes of address space, of which numba and its libraries take some


_NO_KEYS = (
    "not valid TOML",
    "not valid JSON",
    "UTF-8",
    "has no key '",
    "the file must be a table",
    "it must have kind",
    "its last line, a checksum, is missing",
    "hash must be",  # of all other keys
)


class HangError(BaseException):
    """The case took too long; no handler of the package may keep it."""


@dataclass(frozen=True)
class Outcome:
    """What came of a case: one of `OUTCOMES`, and one line or a traceback that says why."""

    kind: str
    number: int
    outcome: str
    said: str
    seconds: float


class Bench:
    """Reads cases in this process; `folder` keeps the examples, `own` the file of the case."""

    def __init__(self, folder: Path, own: Path | None = None) -> None:
        self._folder, self._own = folder, own or folder
        self._examples: dict[str, list[Path]] = {}
        self._answers: dict[Path, str] = {}

    def examples(self, kind: Kind) -> list[Path]:
        """Good files of a kind, made once."""
        if kind.name not in self._examples:
            folder = self._folder / re.sub(r"\W+", "_", kind.name)
            if folder.is_dir():
                self._examples[kind.name] = sorted(folder.glob(f"*{kind.suffix}"))
            else:
                folder.mkdir()
                self._examples[kind.name] = sorted(kind.examples(folder))
        return self._examples[kind.name]

    def mutated(self, kind: Kind, number: int) -> tuple[Path, bytes]:
        """The example of a case, and its bytes after the mutation."""
        random = np.random.default_rng([SEED, mutations.seed_of(kind.name), number])
        examples = self.examples(kind)
        path = examples[int(random.integers(len(examples)))]
        mutation = kind.mutations[int(random.integers(len(kind.mutations)))]
        return path, mutation(random, path.read_bytes())

    def run(self, name: str, number: int) -> Outcome:
        """Read one mutated file and judge the answer."""
        kind = kind_of(name)
        example, data = self.mutated(kind, number)
        try:
            whole = self._answer_to(kind, example)
        except Exception:
            return Outcome(name, number, "tracebacks", f"of the good {example.name}: {traceback.format_exc()}", 0.0)
        begun = time.process_time()
        outcome, said = self.judge(kind, data, whole)
        return Outcome(name, number, outcome, said, time.process_time() - begun)

    def judge(self, kind: Kind, data: bytes, whole: str = "") -> tuple[str, str]:
        """Read bytes as a file of a kind; the outcome, and what is said of it."""
        path = self._own / f"case{kind.suffix}"
        path.write_bytes(data)
        unraisable: list[str] = []
        sys.unraisablehook = lambda one: unraisable.append(repr(one.exc_value))  # what would go to standard error
        signal.signal(signal.SIGPROF, _stop)
        signal.setitimer(signal.ITIMER_PROF, SECONDS)
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error")
                warnings.simplefilter("ignore", UnusualValueWarning)  # a line beside the result, as it should be
                answer = kind.read(path)
        except CoilarrayError as error:
            said = str(error).replace(str(path), path.name)
            problem = unclear(said, data if kind.keyed else None)
            problem = problem or (f"on standard error: {unraisable[0]}" if unraisable else "")
            return ("tracebacks", f"{problem}: {said!r}") if problem else ("refused", said)
        except HangError:
            return "hangs", "".join(traceback.format_exc())
        except Exception:
            return "tracebacks", "".join(traceback.format_exc())
        finally:
            signal.setitimer(signal.ITIMER_PROF, 0.0)
            sys.unraisablehook = sys.__unraisablehook__
        if unraisable:
            return "tracebacks", f"on standard error: {unraisable[0]}"
        if digest(answer) == whole:
            return "same", ""
        problem = kind.wrong(answer) or _not_finite(kind, answer)
        problem = problem or ("another answer, in spite of the checksum" if kind.sealed and whole else "")
        return ("silent", problem) if problem else ("changed", "")

    def _answer_to(self, kind: Kind, example: Path) -> str:
        """Digest of the answer to a good file."""
        if example not in self._answers:
            case = self._own / f"case{kind.suffix}"
            case.write_bytes(example.read_bytes())
            with warnings.catch_warnings():
                warnings.simplefilter("error")
                warnings.simplefilter("ignore", UnusualValueWarning)  # a line beside the result, as it should be
                answer = kind.read(case)
            problem = kind.wrong(answer) or _not_finite(kind, answer)
            if problem:
                raise AssertionError(f"the good {kind.name} {example.name}: {problem}")
            self._answers[example] = digest(answer)
        return self._answers[example]


def kind_of(name: str) -> Kind:
    """The kind of a name."""
    return next(kind for kind in KINDS if kind.name == name)


def _stop(*_: object) -> None:
    raise HangError


def _not_finite(kind: Kind, answer: Any) -> str:
    for value in numbers_of(answer):
        if math.isinf(value) or (math.isnan(value) and not kind.gaps):
            return f"the answer has {value}"
    return ""


def unclear(message: str, keyed: bytes | None) -> str:
    """Say what is wrong with an error: several lines, too long, empty, or without a key that `names_key` looks for."""
    if not message.strip():
        return "empty"
    if not message.isprintable():
        return "not one printable line"
    if len(message) > LONGEST_MESSAGE:
        return f"{len(message)} characters"
    return "no key" if keyed is not None and not names_key(message, keyed) else ""


def names_key(message: str, data: bytes) -> bool:
    """Whether an error names a key of the file, or one that the file lacks, or says that it is no text of its kind.

    A key is named by its dotted path in the file, with or without the numbers of list entries, as a key of the table
    at such a path, or alone where it stands at the top of the file or cannot be an English word: `gap_mm`. Of a key
    that is not there the message says that it is missing, or has it in brackets as the head of a table.
    """
    if any(text in message for text in _NO_KEYS):
        return True
    said = message.lower()
    paths = {path.lower() for path in _paths_of(_tree_of(data))}
    paths |= {re.sub(r"\.\d+(?=\.|$)", "", path) for path in paths}
    keys = {path.rpartition(".")[2] for path in paths} | _schema_keys()
    known = paths | {key for key in keys if "_" in key}
    words = {word.strip(".-+") for word in re.findall(r"[\w.+-]+", said)}
    words |= {word.rstrip("0123456789") for word in words}  # of registers, which bear the names of keys
    lacking = re.findall(r"([\w.]+) is missing|\[(\w+)\]", said)
    return (
        bool(words & known)
        or any(repr(path) in said for path in paths)  # of any characters
        or any(word.rpartition(".")[0] in paths for word in words if "." in word)
        or any(key.rpartition(".")[2] in _schema_keys() for pair in lacking for key in pair)
    )


@cache
def _schema_keys() -> frozenset[str]:
    found, classes = set(), [Table]
    while classes:
        one = classes.pop()
        classes += one.__subclasses__()
        found |= {(field.alias or name).lower() for name, field in one.model_fields.items()}
    return frozenset(found)


def _tree_of(data: bytes) -> Any:
    """Tables of a TOML or JSON file; empty where it is neither."""
    for read in (tomllib.loads, json.loads):
        try:
            return read(data.decode("utf-8-sig", "replace").replace("\r", "\n"))  # as a file is read
        except (ValueError, RecursionError):
            continue
    return {}


def _paths_of(tree: Any, above: str = "") -> Iterator[str]:
    """Give the dotted path of every key and list entry, below `above`."""
    items = tree.items() if isinstance(tree, dict) else enumerate(tree) if isinstance(tree, list) else ()
    for key, value in items:
        yield f"{above}{key}"
        yield from _paths_of(value, f"{above}{key}.")


def digest(answer: Any) -> str:
    """Hash of an answer: equal numbers, texts and names give equal ones."""
    return hashlib.sha256(_plain(answer).encode("utf-8", "replace")).hexdigest()


def _plain(answer: Any) -> str:
    if isinstance(answer, xr.Dataset):
        attrs = {key: value for key, value in sorted(answer.attrs.items()) if "file" not in key}
        return repr([(str(k), _plain(v.values)) for k, v in sorted(answer.variables.items())]) + _plain(attrs)
    if isinstance(answer, np.ndarray):
        return f"{answer.shape} {answer.tolist()}"
    if is_dataclass(answer) and not isinstance(answer, type):
        return f"{type(answer).__name__} {_plain(vars(answer))}" if hasattr(answer, "__dict__") else repr(answer)
    if isinstance(answer, dict):
        return "{" + ", ".join(f"{key}: {_plain(value)}" for key, value in answer.items()) + "}"
    if isinstance(answer, list | tuple):
        return "[" + ", ".join(map(_plain, answer)) + "]"
    return repr(answer)


_BENCH: list[Bench] = []  # of a worker


def _begin(folder: str) -> None:
    """Limit the memory of a worker, and give it a folder of its own."""
    resource.setrlimit(resource.RLIMIT_AS, (_MEMORY, _MEMORY))
    _BENCH.append(Bench(Path(folder), Path(tempfile.mkdtemp(dir=folder))))


def _run(case: tuple[str, int]) -> Outcome:
    return _BENCH[0].run(*case)


def cases(count: int, kinds: Sequence[Kind] = KINDS, first: int = 0) -> Iterator[tuple[str, int]]:
    """Give the cases of a run: to every kind its share of the count, numbered from `first`."""
    total = sum(kind.share for kind in kinds)
    for kind in kinds:
        for number in range(math.ceil(count * kind.share / total)):
            yield kind.name, first + number


def run_cases(wanted: Sequence[tuple[str, int]], workers: int) -> list[Outcome]:
    """Run cases in processes; where none ends for `_WALL_SECONDS`, those that are left count as hangs."""
    done: list[Outcome] = []
    with tempfile.TemporaryDirectory() as folder:
        bench = Bench(Path(folder))
        for name in dict.fromkeys(name for name, _ in wanted):
            bench.examples(kind_of(name))
        with multiprocessing.get_context("spawn").Pool(workers, _begin, (folder,)) as pool:
            running = pool.imap_unordered(_run, wanted)
            try:
                while len(done) < len(wanted):
                    done.append(running.next(_WALL_SECONDS))
                    if done[-1].outcome in OUTCOMES[3:]:  # a long run may be broken off
                        sys.stderr.write(f"{done[-1].outcome} {done[-1].kind} {done[-1].number}\n")
            except multiprocessing.TimeoutError:
                ended = {(one.kind, one.number) for one in done}
                left = [case for case in wanted if case not in ended]
                done += [Outcome(*case, "hangs", f"none ended in {_WALL_SECONDS:g} s", 0.0) for case in left]
    return done


def table(outcomes: Sequence[Outcome]) -> str:
    """One row a kind, and their sum."""
    counts = {kind.name: Counter(one.outcome for one in outcomes if one.kind == kind.name) for kind in KINDS}
    rows = [("kind", "cases", *OUTCOMES)]
    for name, found in [*counts.items(), ("all", sum(counts.values(), Counter()))]:
        if found:
            rows.append((name, str(found.total()), *(str(found[one]) for one in OUTCOMES)))
    widths = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))]
    return "\n".join(
        " | ".join(
            cell.ljust(w) if k == 0 else cell.rjust(w) for k, (cell, w) in enumerate(zip(row, widths, strict=True))
        )
        for row in rows
    )


def main(argv: Sequence[str] | None = None) -> int:
    """Run the cases of a command line and print the table; 1 where one of its last three columns is not 0."""
    parser = argparse.ArgumentParser(
        prog="python tests/fuzz", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--cases", type=int, default=2000, help="number of cases, shared among the kinds (2000)")
    parser.add_argument("--kind", action="append", help="only this kind; may be repeated")
    parser.add_argument("--first", type=int, default=0, help="number of the first case of every kind (0)")
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1, help="processes (one a core)")
    parser.add_argument("--show", type=int, default=40, help="how many bad cases are shown (40)")
    given = parser.parse_args(argv)
    kinds = [kind for kind in KINDS if given.kind is None or any(part in kind.name for part in given.kind)]
    outcomes = run_cases(list(cases(given.cases, kinds, given.first)), given.workers)
    bad = [one for one in outcomes if one.outcome in OUTCOMES[3:]]
    for one in sorted(bad, key=lambda one: (one.kind, one.number))[: given.show]:
        lines = one.said.strip().splitlines() or [""]
        places = [line.strip() for line in lines if line.strip().startswith('File "') and "coilarray" in line]
        where = f" ({places[-1].split('/')[-1]})" if places else ""
        sys.stdout.write(f"{one.outcome} {one.kind} {one.number}: {lines[-1][:400]}{where}\n")
    sys.stdout.write(table(outcomes) + "\n")
    return 1 if bad else 0
