"""Runs of ``coilarray optimize`` from their study.

They are read during the search or later. Nothing is written.
"""

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
from coilarray.design.keys import entry_unit
from coilarray.errors import OutputError
from coilarray.studies.optimize.goal import unbeaten
from coilarray.studies.optimize.search import FILE, quiet, storage_on
from coilarray.studies.quantities import QUANTITIES

if TYPE_CHECKING:
    from optuna.study import Study
    from optuna.trial import FrozenTrial

_MOST_SHOWN = 200


@dataclass(frozen=True, eq=False)
class RunPoint:
    """Point of a search with a possible board."""

    name: str  # kind and number, as in "search 12"
    quantities: dict[str, float]  # in the unit in the name
    entries: dict[str, Any]  # varied entries of the design
    scores: tuple[float, ...]  # for each objective
    feasible: bool  # keeps every bound
    start: bool  # the search began from this design


@dataclass(frozen=True, eq=False)
class Run:
    """Study of a design and a goal."""

    name: str  # of the study; it begins with the name of the design
    maximized: tuple[bool, ...]  # for each objective
    points: tuple[RunPoint, ...]  # with a possible board, in the order in which they were written
    tried: int  # number of all points
    refined: int = 0  # number of points that the local solver tried about the best point

    @property
    def quantities(self) -> tuple[str, ...]:
        """Names of all quantities, with the objectives first."""
        return tuple(dict.fromkeys(name for point in self.points for name in point.quantities))

    @cached_property
    def objectives(self) -> tuple[str, ...]:
        """Names of the scores.

        A score is named after the quantity that it equals at all points, or whose distance to a value it is.
        """
        return tuple(self._objective(k) for k in range(len(self.maximized)))

    def _objective(self, k: int) -> str:
        """Find the quantity that a score stands for."""
        scores = np.array([point.scores[k] for point in self.points])
        for name in self.quantities if len(scores) else ():
            values = np.array([point.quantities.get(name, math.nan) for point in self.points])
            if np.array_equal(values, scores):
                return name
            for target in (0.0, *(values[0] + sign * scores[0] for sign in (-1, 1))):
                # The distance is known only to rounding.
                if np.allclose(abs(values - target), scores, rtol=1e-9, atol=1e-12 * abs(values).max()):
                    return f"|{name} − {target:.6g}|" if target else f"|{name}|"
        return f"score {k + 1}"

    def values(self, name: str) -> list[float]:
        """Read a value of every point.

        The value is a score, a quantity, or an entry that is a number. It is NaN if a point has no such value.
        """
        if name in self.objectives:
            k = self.objectives.index(name)
            return [point.scores[k] for point in self.points]
        return [point.quantities.get(name, point.entries.get(name, float("nan"))) for point in self.points]

    @property
    def numbers(self) -> tuple[str, ...]:
        """Names of the varied entries that are numbers.

        They are numbers at all points.
        """
        varied = dict.fromkeys(name for point in self.points for name in point.entries)
        return tuple(name for name in varied if all(isinstance(value, int | float) for value in self.values(name)))

    @property
    def start(self) -> int | None:
        """Index of the point from which the search began.

        It is None if this point is unknown or is not a possible board.
        """
        return next((k for k, point in enumerate(self.points) if point.start), None)

    @property
    def front(self) -> tuple[int, ...]:
        """Indices of the points on the front, without the start.

        These points keep all bounds, and no other point beats them in all objectives.
        """
        signs = [-1 if maximized else 1 for maximized in self.maximized]
        scores = {k: point.scores for k, point in enumerate(self.points) if point.feasible}
        return tuple(k for k in unbeaten(scores, signs) if not self.points[k].start)


def axis_label(name: str) -> str:
    """Label of an axis with the unit.

    It names a quantity, a distance to its target, or an entry.

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
    """Describe a run in words.

    The lines give its progress, its results, and the meaning of its scores.
    """
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
    """Quantity of a score.

    The score may be the distance of the quantity to a target.
    """
    return name.strip("|").partition(" − ")[0]


def run_folders(folder: Path) -> list[str]:
    """Names of a folder's folders that contain a study.

    The folder itself has the name ".".
    """
    try:
        below = sorted(path for path in folder.iterdir() if path.is_dir())
        return [path.name if path != folder else "." for path in (folder, *below) if (path / FILE).is_file()]
    except OSError:
        return []


def read_runs(folder: Path) -> tuple[Run, ...]:
    """Read all studies of a folder with a ``study.db``.

    A missing file or a file that is not a study raises an OutputError. Without Optuna it raises a
    MissingDependencyError.
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
        except Exception:  # Optuna passes on errors of SQLAlchemy without useful text
            raise OutputError(f"cannot read {path}: it is no study of an optimisation.") from None


def front_rows(run: Run) -> list[dict[str, Any]]:
    """Rows of the points of the front as texts.

    A row has name, scores, entries and all quantities.
    """
    points = [run.points[k] for k in run.front[:_MOST_SHOWN]]
    return [
        {
            "name": p.name, "scores": [value_text(score) for score in p.scores], "entries": _list(p.entries),
            "quantities": _list(p.quantities),
        }
        for p in points
    ]  # fmt: skip


def _address(path: Path) -> str:
    """Read-only address of a database.

    With it SQLite does not wait for a search that writes the database. Without a journal beside it no search is
    running. Then it is opened as immutable, which creates no files.
    """
    journal = path.with_name(f"{path.name}-wal").exists()
    return f"{path.resolve().as_uri()}?{'mode=ro' if journal else 'immutable=1'}"


def _run(study: Study) -> Run:
    """Read a run from a study."""
    from optuna.study import StudyDirection

    trials = study.get_trials(deepcopy=False)
    maximized = tuple(direction == StudyDirection.MAXIMIZE for direction in study.directions)
    points = tuple(_point(trial) for trial in trials if trial.values is not None)
    refined = sum(trial.user_attrs.get("point", {}).get("kind") == "polish" for trial in trials)
    return Run(study.study_name, maximized, points, len(trials), refined)


def _point(trial: FrozenTrial) -> RunPoint:
    """Read a point from a trial."""
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
    """Value of a parameter.

    Choices are stored as JSON.
    """
    if not isinstance(parameter, str):
        return parameter
    try:
        return json.loads(parameter)
    except ValueError:
        return parameter


def _list(values: Mapping[str, object]) -> str:
    return ", ".join(f"{key} = {value_text(value)}" for key, value in values.items())
