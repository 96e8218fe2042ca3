"""Files of an optimization: CSV, JSON and designs."""

from __future__ import annotations

import csv
import io
import json
import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from coilarray.circuit.coupling import provenance
from coilarray.compute.files import make_folder, write_text
from coilarray.design.model import DesignFile
from coilarray.design.vary import vary_chosen
from coilarray.design.write import file_text
from coilarray.studies.optimize.goal import Trial
from coilarray.studies.optimize.run import Optimization

_DESIGN_NAME = re.compile(r"best\.toml|pareto_\d{2,}\.toml")


def write_optimization(result: Optimization, folder: str | Path) -> tuple[Path, ...]:
    """Write the files of an optimization into a folder.

    Designs of an earlier search, listed in its ``result.json``, are removed. Raises OutputError. No
    file is left half-written.

    Returns
    -------
    tuple of Path
        ``trials.csv``, ``result.json`` and the designs: ``best.toml``, or ``pareto_01.toml`` and so
        on in the order of the first objective.
    """
    folder = Path(folder)
    make_folder(folder)
    names = design_names(result)
    texts = {
        "trials.csv": trials_csv(result),
        "result.json": json.dumps(result_data(result), indent=1, allow_nan=False) + "\n",
        **{
            name: trial_text(result.file, trial, Path(name).stem)
            for name, trial in zip(names, result.front, strict=True)
        },
    }
    try:
        front = json.loads((folder / "result.json").read_text(encoding="utf-8"))["front"]
        before = [str(design["file"]) for design in front]
    except (OSError, ValueError, TypeError, KeyError, RecursionError):  # no such file, or of another program
        before = []
    for old in before:
        if old not in texts and _DESIGN_NAME.fullmatch(old):
            (folder / old).unlink(missing_ok=True)
    for name, text in texts.items():
        write_text(folder / name, text)
    return tuple(folder / name for name in texts)


def design_names(result: Optimization) -> tuple[str, ...]:
    """Names of the design files in the front's order."""
    if len(result.goal.objectives) == 1:
        return ("best.toml",) * len(result.front)
    return tuple(f"pareto_{k + 1:02d}.toml" for k in range(len(result.front)))


def trial_text(file: DesignFile, trial: Trial, label: str) -> str:
    """Design file of a trial, named after design and `label`.

    Entries that were chosen are no longer marked as assumed.
    """
    design = file.design
    document = vary_chosen(file.document, trial.changes)
    document["name"] = f"{design.name}-{label}"
    document["title"] = f"{design.title or design.name} – {label}"
    found = ", ".join(f"{key} = {value:.6g}" for key, value in trial.quantities.items())
    text = file_text(replace(file, document=document))
    return f"# {design.name} as changed by coilarray optimize ({trial.name}): {found}\n\n{text}"


def trials_csv(result: Optimization) -> str:
    """All trials as CSV, the start first."""
    entries = [variable.entry for variable in result.goal.variables]
    quantities = result.goal.quantities
    best = {(trial.kind, trial.place) for trial in result.front}
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(["kind", "place", "accuracy", "feasible", "front", *entries, *quantities, "reason"])
    for trial in (result.start, *result.trials):
        about = (trial.kind, trial.place, trial.accuracy, trial.feasible, (trial.kind, trial.place) in best)
        values = (result.values(trial)[entry] for entry in entries)
        cells = (json.dumps(value) if isinstance(value, list) else value for value in values)
        writer.writerow([*about, *cells, *(trial.quantities.get(key, "") for key in quantities), trial.reason])
    return buffer.getvalue()


def result_data(result: Optimization) -> dict[str, Any]:
    """Return the data that `write_optimization` writes as JSON."""
    goal = result.goal
    return {
        "schema": 1,
        "provenance": provenance(result.design),
        "goal": goal.model_dump(mode="json", by_alias=True, exclude_none=True),
        "sampler": goal.sampler,
        "trials": len(result.trials),
        "found": result.found,
        "polish_problem": result.polish_problem,
        "start_inside": result.start_inside,
        "start": _record(result.start, result.values(result.start)),
        "front": [
            {"file": name, **_record(trial, trial.changes)}
            for name, trial in zip(design_names(result), result.front, strict=True)
        ],
    }


def _record(trial: Trial, values: Mapping[str, Any]) -> dict[str, Any]:
    return {
        "trial": trial.name,
        "accuracy": trial.accuracy,
        "feasible": trial.feasible,
        "entries": dict(values),
        "quantities": dict(trial.quantities),
        "violations": dict(trial.violations),
        "reason": trial.reason,
    }
