"""Measure accuracy and speed, print two tables, keep the figures, and renew those of docs/benchmarks.md on request.

Figures go to benchmarks/results.json; the exit code is 1 where a goal is missed.
Speeds are of this machine in this run; compare ratios, not seconds.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import re
import subprocess
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path
from typing import TypeVar

import accuracy
import elastomer
import first_compile
import large_response
import localize
import measured
import metal
import peers
import protocol
import space
import speed
import studio
import sweep

from coilarray.errors import CoilarrayError

HERE = Path(__file__).parent
PAGE = HERE.parent / "docs" / "benchmarks.md"


def _accuracy_table(results: list[accuracy.Accuracy]) -> str:
    lines = ["| quantity | reference | rows | largest deviation | limit |", "| --- | --- | --- | --- | --- |"]
    lines += [f"| {r.quantity} | `{r.table}` | {r.rows} | {r.worst:.0e} | {r.limit:.0e} |" for r in results]
    return "\n".join(lines)


def _speed_table(results: list[speed.Speed]) -> str:
    lines = ["| figure | value | in the same run | goal |", "| --- | --- | --- | --- |"]
    lines += [
        f"| {r.what} | {r.value:{'.0f' if r.value >= 1000 else '.3g'}} {r.unit} | {r.note} | {r.goal}"
        f"{'' if r.kept else ': missed'} |"
        for r in results
    ]
    return "\n".join(lines)


def _renew(text: str, name: str, table: str) -> str:
    """Replace what stands between the markers of one table."""
    pattern = re.compile(rf"(<!-- {name}: [^>]*-->\n).*?(<!-- end {name} -->)", re.DOTALL)
    renewed, count = pattern.subn(lambda match: match.group(1) + table + "\n" + match.group(2), text)
    if count != 1:
        raise SystemExit(f"docs/benchmarks.md must have one place for the {name} table; it has {count}")
    return renewed


ACCURACIES: dict[str, Callable[[], Iterable[accuracy.Accuracy]]] = {
    "accuracy": accuracy.measure,
    "elastomer-accuracy": elastomer.accuracies,
    "metal-accuracy": metal.accuracies,
    "measured": measured.accuracies,
    "space-accuracy": space.accuracies,
}
SPEEDS: dict[str, Callable[[], Iterable[speed.Speed | None]]] = {
    "speed": speed.measure,
    "elastomer": elastomer.speeds,
    "localize": localize.figures,
    "metal": metal.figures,
    "sweep": sweep.figures,
    "space": space.figures,
    "kernels": peers.kernels,
    "fasthenry": peers.fasthenry,
    "large-arrays": peers.large_arrays,
    "large-response": large_response.figures,
    "first-compile": first_compile.figures,
    "protocol": protocol.figures,
    "studio": studio.figures,
}


_Figure = TypeVar("_Figure", accuracy.Accuracy, speed.Speed)


def _renewed(
    measures: Mapping[str, Callable[[], Iterable[_Figure | None]]],
    chosen: list[str],
    kept: list[_Figure],
    key: Callable[[_Figure], object],
    failed: list[str],
) -> list[_Figure]:
    """All figures: those of the chosen benchmarks measured now; the others, those that failed, and None, as kept."""
    measured: list[_Figure | None] = []
    for name, measure in measures.items():
        if name in chosen:
            try:
                measured += measure()
            except (subprocess.CalledProcessError, CoilarrayError) as error:  # the figures of the others are not lost
                failed.append(f"{name}: {error}")
                measured.append(None)
    now = [figure for figure in measured if figure is not None]
    if set(measures) <= set(chosen) and now == measured:
        return now
    by_key = {key(figure): figure for figure in now}
    figures = [by_key.pop(key(figure), figure) for figure in kept]
    return [*figures, *by_key.values()]


def main() -> None:
    """Measure, print, keep."""
    names = [*ACCURACIES, *SPEEDS]
    parser = argparse.ArgumentParser(description=__doc__, epilog="python benchmarks/run.py --only kernels large-arrays")
    parser.add_argument("--tables", action="store_true", help="renew the two tables of docs/benchmarks.md")
    parser.add_argument(
        "--only", nargs="+", choices=names, default=names, metavar="NAME", help=f"of: {', '.join(names)}"
    )
    arguments = parser.parse_args()
    kept_file = HERE / "results.json"
    kept = json.loads(kept_file.read_text(encoding="utf-8"))
    only, failed, old = arguments.only, list[str](), [accuracy.Accuracy(**r) for r in kept["accuracy"]]
    accuracies = _renewed(ACCURACIES, only, old, lambda r: (r.quantity, r.table), failed)
    speeds = _renewed(SPEEDS, only, [speed.Speed(**r) for r in kept["speed"]], lambda r: r.what, failed)
    tables = {"accuracy": _accuracy_table(accuracies), "speed": _speed_table(speeds)}
    for table in tables.values():
        print(table, end="\n\n")
    results = {
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "coilarray": metadata.version("coilarray"),
        "python": platform.python_version(),
        "processor_cores": len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count(),
        "accuracy": [asdict(result) for result in accuracies],
        "speed": [asdict(result) for result in speeds],
        "measured": [asdict(coil) for coil in measured.coils()] if "measured" in only else kept["measured"],
    }
    kept_file.write_text(json.dumps(results, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    if arguments.tables:
        text = PAGE.read_text(encoding="utf-8")
        for name, table in tables.items():
            text = _renew(text, name, table)
        PAGE.write_text(text, encoding="utf-8")
    missed = [getattr(one, "what", "") or one.quantity for one in (*accuracies, *speeds) if not one.kept]
    if missed or failed:
        raise SystemExit("\n".join([f"goals missed: {'; '.join(missed)}"] * bool(missed) + failed))


if __name__ == "__main__":
    main()
