"""Runs of ``coilarray optimize``, read from their study during the search or later; nothing is written."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from coilarray.compute.display_units import value_text
from coilarray.compute.extras import import_extra
from coilarray.design.units import entry_unit
from coilarray.errors import OutputError
from coilarray.studies.optimize.study_file import FILE, is_whole, quiet, storage_on
from coilarray.studies.optimize.trials import unbeaten
from coilarray.studies.quantities import QUANTITIES

if TYPE_CHECKING:
    from optuna.study import Study
    from optuna.trial import FrozenTrial

_MOST_SHOWN = 200


@dataclass(frozen=True, eq=False)
class RunPoint:
    """One point of a search with a possible board."""

    name: str  # kind and number, as in "search 12"
    quantities: dict[str, float]  # in the unit in the name
    entries: dict[str, Any]  # varied ones of the design
    scores: tuple[float, ...]  # one for each objective
    feasible: bool  # keeps every bound
    start: bool  # is the design from which the search began


@dataclass(frozen=True, eq=False)
class Run:
    """One study of a design and a goal."""

    name: str  # of the study; it begins with that of the design
    maximized: tuple[bool, ...]  # for each objective
    points: tuple[RunPoint, ...]  # with a possible board, in the order in which they were written
    tried: int  # number of all points
    refined: int = 0  # of which the local solver tried, about the best one

    @property
    def quantities(self) -> tuple[str, ...]:
        """Names of all quantities, those of the objectives first."""
        return tuple(dict.fromkeys(name for point in self.points for name in point.quantities))

    @cached_property
    def objectives(self) -> tuple[str, ...]:
        """Names of the scores: the quantity that each is at all points, or whose distance to a value it is."""
        return tuple(self._objective(k) for k in range(len(self.maximized)))

    def _objective(self, k: int) -> str:
        scores = np.array([point.scores[k] for point in self.points])
        for name in self.quantities if len(scores) else ():
            values = np.array([point.quantities.get(name, math.nan) for point in self.points])
            if np.array_equal(values, scores):
                return name
            for target in (0.0, *(values[0] + sign * scores[0] for sign in (-1, 1))):
                # the distance is known to rounding only
                if np.allclose(abs(values - target), scores, rtol=1e-9, atol=1e-12 * abs(values).max()):
                    return f"|{name} − {target:.6g}|" if target else f"|{name}|"
        return f"score {k + 1}"

    def values(self, name: str) -> list[float]:
        """Return a score, a quantity, or an entry that is a number of every point; NaN where a point has none."""
        if name in self.objectives:
            k = self.objectives.index(name)
            return [point.scores[k] for point in self.points]
        return [point.quantities.get(name, point.entries.get(name, float("nan"))) for point in self.points]

    @property
    def numbers(self) -> tuple[str, ...]:
        """Names of the varied entries that are numbers at all points."""
        varied = dict.fromkeys(name for point in self.points for name in point.entries)
        return tuple(name for name in varied if all(isinstance(value, int | float) for value in self.values(name)))

    @property
    def start(self) -> int | None:
        """Index of the point from which the search began; None where it is not known or no possible board."""
        return next((k for k, point in enumerate(self.points) if point.start), None)

    @property
    def front(self) -> tuple[int, ...]:
        """Indices of the points, but for the start, that keep all bounds and that no other beats in all objectives."""
        signs = [-1 if maximized else 1 for maximized in self.maximized]
        scores = {k: point.scores for k, point in enumerate(self.points) if point.feasible}
        return tuple(k for k in unbeaten(scores, signs) if not self.points[k].start)


def axis_label(name: str) -> str:
    """Return the name of a quantity, a distance to its target, or an entry, with its unit.

    Examples
    --------
    >>> axis_label("array.pitch_mm"), axis_label("worst_k"), axis_label("|effective_inductance_uH[coil2] − 18|")
    ('array.pitch_mm (mm)', 'worst_k', '|effective_inductance_uH[coil2] − 18| (µH)')
    """
    bare = _quantity(name)
    known = QUANTITIES.get(bare.partition("[")[0])
    unit = known.unit if known is not None else entry_unit(bare.rpartition(".")[2])
    return name if unit == "1" else f"{name} ({unit})"


def run_lines(run: Run) -> list[str]:
    """Say in words how far a run has come, what it has found, and what its scores are."""
    kept = sum(point.feasible for point in run.points)
    points = f"{run.tried} point{'' if run.tried == 1 else 's'} computed"
    refined = f", {run.refined} of them to refine the best" if run.refined else ""
    lines = [f"{points}{refined}; {kept} keep{'s' if kept == 1 else ''} all bounds"]
    start = None if run.start is None else run.points[run.start]
    if len(run.objectives) > 1:
        lines.append(f"{len(run.front)} on the front." if run.front else "None is better than the start.")
    else:
        name = run.objectives[0]
        of_start = "" if start is None else f" {value_text(start.scores[0])}"
        broken = "" if start is None or start.feasible else ", which breaks a bound"
        if run.front:
            best = value_text(run.points[run.front[0]].scores[0])
            lines.append(f"The best has {name} {best}" + (f", the start{of_start}{broken}." if of_start else "."))
        elif kept:
            lines.append("None is better than the start" + (f", which has {name}{of_start}." if of_start else "."))
        elif run.points:
            lines.append("None keeps all bounds.")
    for name in run.objectives:
        quantity = _quantity(name)
        base = quantity.partition("[")[0]
        if base in QUANTITIES:
            lines.append(f"{quantity}: {QUANTITIES[base].says}.")
    return lines


def _quantity(name: str) -> str:
    """Return the quantity of a score that may be its distance to a target."""
    return name.strip("|").partition(" − ")[0]


def run_folders(folder: Path) -> list[str]:
    """Return the names of the folders in a folder that contain a study, "." for the folder itself."""
    try:
        below = sorted(path for path in folder.iterdir() if path.is_dir())
        return [path.name if path != folder else "." for path in (folder, *below) if (path / FILE).is_file()]
    except OSError:
        return []


def read_runs(folder: Path) -> tuple[Run, ...]:
    """Read all studies of a folder with a ``study.db``.

    OutputError where there is none or the file is no study; MissingDependencyError without Optuna.
    """
    path = folder / FILE
    if not path.is_file():
        raise OutputError(f"there is no {FILE} in {folder}: coilarray optimize --out {folder} makes one.")
    optuna = import_extra("optuna", "studies of an optimisation", package="Optuna", extra="optimize")

    with quiet():
        try:
            storage = storage_on(_address(path), as_it_is=True)
            try:
                names = optuna.get_all_study_names(storage)
                return tuple(_run(optuna.load_study(study_name=name, storage=storage)) for name in names)
            finally:
                storage.remove_session()
                storage.engine.dispose()
        except Exception:  # Optuna passes on the errors of SQLAlchemy, which have no useful text
            raise OutputError(f"cannot read {path}: it is no study of an optimisation.") from None


def front_rows(run: Run) -> list[dict[str, Any]]:
    """Return a row for each point of the front: its name, scores, entries and all quantities as texts."""
    points = [run.points[k] for k in run.front[:_MOST_SHOWN]]
    return [
        {
            "name": p.name, "scores": [value_text(score) for score in p.scores], "entries": _list(p.entries),
            "quantities": _list(p.quantities),
        }
        for p in points
    ]  # fmt: skip


def _address(path: Path) -> str:
    """Return a read-only address of a database, with which SQLite does not wait for a search that writes it.

    Without a journal beside it no search is running; it is then opened as immutable, which creates no files.
    """
    journal = path.with_name(f"{path.name}-wal").exists()
    return f"{path.resolve().as_uri()}?{'mode=ro' if journal else 'immutable=1'}"


def _run(study: Study) -> Run:
    from optuna.study import StudyDirection

    trials = [trial for trial in study.get_trials(deepcopy=False) if is_whole(trial)]
    maximized = tuple(direction == StudyDirection.MAXIMIZE for direction in study.directions)
    points = tuple(_point(trial) for trial in trials if trial.values is not None)
    refined = sum(trial.user_attrs.get("point", {}).get("kind") == "polish" for trial in trials)
    return Run(study.study_name, maximized, points, len(trials), refined)


def _point(trial: FrozenTrial) -> RunPoint:
    known = trial.user_attrs.get("point", {})
    violations: Sequence[float] = tuple(trial.constraints.values())
    return RunPoint(
        f"{known.get('kind', 'trial')} {known.get('place', trial.number)}",
        dict(trial.user_attrs.get("quantities", {})),
        dict(trial.user_attrs.get("changes") or {key: _value(value) for key, value in trial.params.items()}),
        tuple(trial.values),
        all(violation <= 0 for violation in violations),
        known.get("start", False),
    )


def _value(parameter: object) -> Any:
    """Return the value of a parameter; choices are stored as JSON."""
    if not isinstance(parameter, str):
        return parameter
    try:
        return json.loads(parameter)
    except ValueError:
        return parameter


def _list(values: Mapping[str, object]) -> str:
    return ", ".join(f"{key} = {value_text(value)}" for key, value in values.items())
