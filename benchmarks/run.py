"""Measure accuracy and speed, print two tables, keep the figures, and renew the README's tables on request.

    python benchmarks/run.py [--readme]

Figures go to benchmarks/results.json; the exit code is 1 where a goal is missed.
Speeds are of this machine in this run; compare ratios, not seconds.
"""

from __future__ import annotations

import json
import os
import platform
import re
import sys
from dataclasses import asdict
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path

import accuracy
import elastomer
import first_compile
import large_response
import localize
import peers
import protocol
import speed
import studio
import sweep

HERE = Path(__file__).parent
README = HERE.parent / "README.md"


def _accuracy_table(results: list[accuracy.Accuracy]) -> str:
    lines = ["| quantity | reference | rows | largest deviation | limit |", "| --- | --- | --- | --- | --- |"]
    lines += [f"| {r.quantity} | `{r.table}` | {r.rows} | {r.worst:.0e} | {r.limit:.0e} |" for r in results]
    return "\n".join(lines)


def _speed_table(results: list[speed.Speed]) -> str:
    lines = ["| figure | value | in the same run | goal |", "| --- | --- | --- | --- |"]
    lines += [f"| {r.what} | {r.value:.3g} {r.unit} | {r.note} | {r.goal} |" for r in results]
    return "\n".join(lines)


def _renew(text: str, name: str, table: str) -> str:
    """Replace what stands between the markers of one table."""
    pattern = re.compile(rf"(<!-- {name}: [^>]*-->\n).*?(<!-- end {name} -->)", re.DOTALL)
    renewed, count = pattern.subn(lambda match: match.group(1) + table + "\n" + match.group(2), text)
    if count != 1:
        raise SystemExit(f"README.md must have one place for the {name} table; it has {count}")
    return renewed


def main() -> None:
    """Measure, print, keep."""
    accuracies = [*accuracy.measure(), *elastomer.accuracies()]
    speeds = [*speed.measure(), *elastomer.speeds(), *localize.figures(), *sweep.figures()]
    speeds += [*peers.kernels(), *peers.large_arrays(), *large_response.figures(), *first_compile.figures()]
    speeds += [*protocol.figures(), *studio.figures()]
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
    }
    (HERE / "results.json").write_text(json.dumps(results, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    if "--readme" in sys.argv[1:]:
        text = README.read_text(encoding="utf-8")
        for name, table in tables.items():
            text = _renew(text, name, table)
        README.write_text(text, encoding="utf-8")
    missed = [result for result in (*accuracies, *speeds) if not result.kept]
    if missed:
        raise SystemExit(f"goals missed: {missed}")


if __name__ == "__main__":
    main()
