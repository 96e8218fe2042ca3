"""Runs of ``coilarray optimize``, read from their study while they go on or later; nothing is written."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from coilarray.errors import MissingDependencyError, OutputError
from coilarray.studies.optimize.study_file import FILE, quiet

if TYPE_CHECKING:
    from optuna.study import Study
    from optuna.trial import FrozenTrial

_MOST_SHOWN = 200


@dataclass(frozen=True, eq=False)
class RunPoint:
    """One point that a search tried and that can be.

    Parameters
    ----------
    name : str
        Kind and place, as in "search 12".
    quantities : dict of str to float
        By name, in the unit of the name.
    entries : dict of str to object
        Entries of the design that were varied.
    scores : tuple of float
        One for each objective.
    feasible : bool
        Whether it keeps every bound.
    """

    name: str
    quantities: dict[str, float]
    entries: dict[str, Any]
    scores: tuple[float, ...]
    feasible: bool


@dataclass(frozen=True, eq=False)
class Run:
    """One study: a design and a goal.

    Parameters
    ----------
    name : str
        Of the study; begins with that of the design.
    maximized : tuple of bool
        For each objective.
    points : tuple of RunPoint
        That can be, in the order in which they were written.
    tried : int
        How many points there are, those that cannot be included.
    """

    name: str
    maximized: tuple[bool, ...]
    points: tuple[RunPoint, ...]
    tried: int

    @property
    def quantities(self) -> tuple[str, ...]:
        """Names of all quantities, those of the objectives first."""
        names = dict.fromkeys(name for point in self.points for name in point.quantities)
        return tuple(names)

    @property
    def objectives(self) -> tuple[str, ...]:
        """Names of the quantities that are the scores, where that can be told; else "score 1" and so on."""
        return tuple(self._objective(k) for k in range(len(self.maximized)))

    def _objective(self, k: int) -> str:
        for name in self.quantities:
            if self.points and all(point.quantities.get(name) == point.scores[k] for point in self.points):
                return name
        return f"score {k + 1}"

    def values(self, name: str) -> list[float]:
        """Return a quantity or score of every point; NaN where a point has none."""
        if name.startswith("score "):
            k = int(name.removeprefix("score ")) - 1
            return [point.scores[k] for point in self.points]
        return [point.quantities.get(name, float("nan")) for point in self.points]

    @property
    def front(self) -> tuple[int, ...]:
        """Positions in `points` of those that keep all bounds and that no other one beats in all objectives."""
        signs = [-1 if maximized else 1 for maximized in self.maximized]
        costs = {
            k: tuple(s * score for s, score in zip(signs, point.scores, strict=True))
            for k, point in enumerate(self.points)
            if point.feasible
        }
        best: list[int] = []
        # sorted by all costs, a point is beaten by none that comes after it
        for k in sorted(costs, key=lambda k: costs[k]):
            if not any(all(a <= b for a, b in zip(costs[other], costs[k], strict=True)) for other in best):
                best.append(k)
        return tuple(best)


def run_folders(folder: Path) -> list[str]:
    """Return the folders in a folder, itself included, that hold a study: as names, "." for itself."""
    try:
        below = sorted(path for path in folder.iterdir() if path.is_dir())
        return [path.name if path != folder else "." for path in (folder, *below) if (path / FILE).is_file()]
    except OSError:
        return []


def read_runs(folder: Path) -> tuple[Run, ...]:
    """Read all studies of a folder of results.

    Parameters
    ----------
    folder : Path
        With a ``study.db``.

    Returns
    -------
    tuple of Run

    Raises
    ------
    OutputError
        No study there, or a file that is none.
    MissingDependencyError
        No Optuna.
    """
    path = folder / FILE
    if not path.is_file():
        raise OutputError(f"there is no {FILE} in {folder}: coilarray optimize --out {folder} makes one.")
    try:
        import optuna
    except ImportError:
        raise MissingDependencyError(
            "runs of an optimisation need Optuna: pip install 'coilarray[optimize]'."
        ) from None
    from optuna.storages import RDBStorage

    with quiet():
        try:
            storage = RDBStorage(_address(path), skip_compatibility_check=True, skip_table_creation=True)
            try:
                names = optuna.get_all_study_names(storage)
                return tuple(_run(optuna.load_study(study_name=name, storage=storage)) for name in names)
            finally:
                storage.remove_session()
                storage.engine.dispose()
        except Exception:  # Optuna lets through what SQLAlchemy raises, and says little with it
            raise OutputError(f"cannot read {path}: it is no study of an optimisation.") from None


def front_rows(run: Run) -> list[dict[str, Any]]:
    """Return a row for each point of the front: its name, entries and quantities as texts."""
    rows = []
    for k in run.front[:_MOST_SHOWN]:
        point = run.points[k]
        rows.append(
            {
                "name": point.name,
                "entries": ", ".join(f"{key} = {_text(value)}" for key, value in point.entries.items()),
                "quantities": ", ".join(f"{key} = {_text(value)}" for key, value in point.quantities.items()),
            }
        )
    return rows


def _address(path: Path) -> str:
    """Address of a database that is only read: SQLite then waits for no search that writes it.

    Without a journal beside it no search is running, and then not even the files of one are made.
    """
    journal = path.with_name(f"{path.name}-wal").exists()
    return f"sqlite:///file:{path.resolve()}?{'mode=ro' if journal else 'immutable=1'}&uri=true"


def _run(study: Study) -> Run:
    from optuna.study import StudyDirection

    trials = study.get_trials(deepcopy=False)
    maximized = tuple(direction == StudyDirection.MAXIMIZE for direction in study.directions)
    points = tuple(_point(trial) for trial in trials if trial.values is not None)
    return Run(study.study_name, maximized, points, len(trials))


def _point(trial: FrozenTrial) -> RunPoint:
    told = trial.user_attrs.get("point", {})
    violations: Sequence[float] = tuple(trial.constraints.values())
    return RunPoint(
        f"{told.get('kind', 'trial')} {told.get('place', trial.number)}",
        dict(trial.user_attrs.get("quantities", {})),
        {key: _value(value) for key, value in trial.params.items()},
        tuple(trial.values),
        all(violation <= 0 for violation in violations),
    )


def _value(parameter: object) -> Any:
    """Return the entry that a parameter stands for: choices are kept as JSON."""
    if not isinstance(parameter, str):
        return parameter
    try:
        return json.loads(parameter)
    except ValueError:
        return parameter


def _text(value: object) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)
