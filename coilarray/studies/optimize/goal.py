"""Goal files (TOML, ``schema = 1``), judged points, and variables as parameters of Optuna.

A parameter is named by its entry. For a choice it is the choice as JSON text, which Optuna can
always store. For a number with steps it counts the steps.
"""

from __future__ import annotations

import itertools
import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
import xarray as xr
from pydantic import BeforeValidator, Field, ValidationError, model_validator

from coilarray.design.keys import Bounds, Table
from coilarray.design.model import Design, DesignFile
from coilarray.design.tables import Document
from coilarray.design.toml_file import TomlFiles, first_error
from coilarray.design.vary import vary_document
from coilarray.design.write import as_file
from coilarray.electromagnetics.inductance import Accuracy
from coilarray.errors import DesignError, GoalError
from coilarray.studies.quantities import canonical
from coilarray.studies.sweep import UNREAD, Sweep, is_read, keeps_rules

if TYPE_CHECKING:
    from optuna.distributions import BaseDistribution


GOALS = TomlFiles("goal", GoalError)  # reader of goal files
_POLISH = 60  # evaluations of the local solver by default
_WHOLE_STEPS = 1e-9  # of a step: tolerance of a range for a whole number of steps
_MOST_STEPS = 1e9
_ROUNDING = 1e-9  # of a bound: less is not a violation
Sampler = Literal["tpe", "nsga2", "random"]

_SCORE_ROUNDING = 1e-9  # of a score: less is not a gain
RULES = ("fab_margin_mm", "fab_broken")  # quantities by which a goal treats the fabrication rules
_DIGITS = 15
_DECIMALS = {"mm": 3, "um": 0}  # of a length that a board house can make: 1 µm
_LEAST_STEPS = 10  # between bounds; closer bounds are meant for a finer search
_ON_GRID = 1e-9  # of a step: how near to a step a value must be to stand on it


def _key(asked: Any) -> str:
    try:
        return canonical(asked)
    except GoalError as error:
        raise ValueError(f"cannot be: {str(error).rstrip('.')}") from None


QuantityKey = Annotated[str, BeforeValidator(_key)]
"""A quantity of `coilarray.studies.quantities`, as its canonical text."""


class Variable(Table):
    """``[[variable]]``: an entry that may change, between bounds or among choices."""

    entry: Annotated[str, Field(min_length=1)]
    """Dotted key of the design, such as array.pitch_mm."""
    low: float | None = None
    """Least value, in the unit of the entry, like all values."""
    high: float | None = None
    """Largest value."""
    step: Annotated[float, Field(gt=0)] | None = None
    """Step between the values, by default any value."""
    log: bool = False
    """Whether values are spread evenly on a logarithmic scale."""
    choices: Annotated[list[Any], Field(min_length=2)] | None = None
    """Instead of bounds: the values that it may have."""

    @model_validator(mode="after")
    def _consistent(self) -> Variable:
        if self.choices is not None:
            if (self.low, self.high, self.step) != (None, None, None) or self.log:
                raise ValueError("needs either low and high or choices, not both")
            try:
                texts = [json.dumps(choice, allow_nan=False) for choice in self.choices]
            except (TypeError, ValueError):
                raise ValueError("needs choices that are numbers, texts, true, false or lists of them") from None
            if len({json.dumps(_plain(choice)) for choice in self.choices}) != len(texts):
                raise ValueError(f"needs choices that differ; got {', '.join(texts)}")
            return self
        if self.low is None or self.high is None:
            raise ValueError("needs low and high, or choices")
        if not self.low < self.high:
            raise ValueError(f"needs low below high; got {self.low:g} and {self.high:g}")
        if self.log and self.low <= 0:
            raise ValueError(f"needs low above 0 with log = true; got {self.low:g}")
        if self.log and self.step is not None:
            raise ValueError("may have step or log, not both")
        if self.step is not None:
            steps = (self.high - self.low) / self.step
            if not steps <= _MOST_STEPS:
                raise ValueError(f"needs at most {_MOST_STEPS:g} steps from low to high; got step = {self.step:g}")
            if abs(steps - round(steps)) > _WHOLE_STEPS * max(1.0, steps):
                raise ValueError(f"needs a whole number of steps of {self.step:g} from low to high; got {steps:g}")
        return self


def _plain(choice: Any) -> Any:
    """Choice with whole numbers in one form, 12 for 12.0."""
    if isinstance(choice, list):
        return [_plain(part) for part in choice]
    return int(choice) if isinstance(choice, float) and choice.is_integer() else choice


class Objective(Table):
    """``[[objective]]``: a quantity with a direction or a target."""

    quantity: QuantityKey
    """Quantity of the design. `coilarray optimize --list-quantities` lists them."""
    direction: Literal["minimize", "maximize"] | None = None
    """Whether it is minimised or maximised."""
    target: float | None = None
    """Instead of a direction, the value to reach, in its unit."""

    @model_validator(mode="after")
    def _one_wish(self) -> Objective:
        if (self.direction is None) == (self.target is None):
            raise ValueError('needs exactly one of direction = "minimize" or "maximize" and target = a number')
        return self

    @property
    def maximized(self) -> bool:
        """Whether larger scores are better."""
        return self.direction == "maximize"

    @property
    def wish(self) -> str:
        """Wish in words, such as "minimize rms_k"."""
        if self.target is not None:
            return f"bring {self.quantity} to {self.target:g}"
        return f"{self.direction} {self.quantity}"

    def score(self, value: float) -> float:
        """Return the quantity, or its distance to the target."""
        return value if self.target is None else abs(value - self.target)


class Constraint(Bounds):
    """``[[constraint]]``: bounds that a quantity must keep."""

    quantity: QuantityKey
    """Quantity of the design that must keep the bounds."""

    @property
    def wish(self) -> str:
        """Bounds in words, such as "span_mm ≥ 89.4"."""
        bounds = [
            f"{sign} {bound:g}" for sign, bound in (("≥", self.at_least), ("≤", self.at_most)) if bound is not None
        ]
        return f"{self.quantity} {' and '.join(bounds)}"

    def violations(self, value: float) -> dict[str, float]:
        """Relative violation of each bound, ≤ 0 if kept."""
        broken = {}
        for sign, relation, bound in ((1, ">=", self.at_least), (-1, "<=", self.at_most)):
            if bound is not None:
                excess = sign * (bound - value) / (abs(bound) or 1.0)  # so that different units add up
                broken[f"{self.quantity} {relation} {bound!r}"] = 0.0 if abs(excess) < _ROUNDING else excess
        return broken


class Search(Table):
    """``[search]``: number of points, sampler, random seed and accuracy.

    ``accuracy = "screen"`` computes the inductances of the sampler's points faster. The local
    solver's points and the chosen designs are always computed in full accuracy.
    """

    trials: Annotated[int, Field(ge=1, le=1_000_000)] = 200
    """Number of designs to try."""
    sampler: Sampler | None = None
    """Method that chooses them, by default tpe, for several objectives nsga2."""
    seed: Annotated[int, Field(ge=0, le=2**32 - 1)] = 0
    """Seed of the random numbers: the same tries the same designs."""
    batch: Annotated[int, Field(ge=1, le=10_000)] = 8
    """Number of designs chosen together, for workers to share."""
    population: Annotated[int, Field(ge=2, le=10_000)] = 24
    """Number of designs in a generation of nsga2."""
    polish: Annotated[int, Field(ge=0, le=100_000)] | None = None
    """Evaluations of the local solver, which refines the best design of one objective."""
    accuracy: Accuracy = "full"
    """Accuracy of the inductances in the search, full for chosen designs."""


class Goal(Table):
    """Goal of a search, read by `parse_goal`."""

    schema_: Annotated[int, Field(ge=1, le=1)] = Field(alias="schema")
    """Version of the file format."""
    title: str = ""
    """Title in reports."""
    variables: list[Variable] = Field(alias="variable", min_length=1)
    objectives: list[Objective] = Field(alias="objective", min_length=1)
    constraints: list[Constraint] = Field(alias="constraint", default_factory=list)
    watch: list[QuantityKey] = Field(default_factory=list)
    """Further quantities to compute and list."""
    search: Search = Search()

    @model_validator(mode="after")
    def _consistent(self) -> Goal:
        for one, other in itertools.permutations([variable.entry for variable in self.variables], 2):
            if one == other or other.startswith(f"{one}."):
                raise ValueError(f"names the entry {one} in more than one variable")
        wanted = [objective.quantity for objective in self.objectives]
        if len(set(wanted)) != len(wanted):
            raise ValueError(f"needs a different quantity in every objective; got {', '.join(wanted)}")
        return self

    @property
    def sampler(self) -> Sampler:
        """Sampler, by default tpe, and nsga2 for several objectives."""
        return self.search.sampler or ("tpe" if len(self.objectives) == 1 else "nsga2")

    @property
    def polish(self) -> int:
        """Evaluations of the local solver, none for several objectives."""
        if self.search.polish is not None:
            return self.search.polish
        return _POLISH if len(self.objectives) == 1 else 0

    @property
    def quantities(self) -> tuple[str, ...]:
        """Every wanted, constrained or watched quantity, without repeats."""
        keys = [wish.quantity for wish in self.objectives] + [limit.quantity for limit in self.constraints] + self.watch
        return tuple(dict.fromkeys(keys))

    def scores(self, values: Mapping[str, float]) -> tuple[float, ...]:
        """Score of every objective, from quantities by name."""
        return tuple(objective.score(values[objective.quantity]) for objective in self.objectives)

    def violations(self, values: Mapping[str, float]) -> dict[str, float]:
        """Violation of every bound as text, from quantities by name."""
        return {
            key: excess
            for constraint in self.constraints
            for key, excess in constraint.violations(values[constraint.quantity]).items()
        }

    def searched(self) -> dict[str, Any]:
        """Everything that determines the points of the search."""
        whole = self.model_dump(mode="json", by_alias=True, exclude={"title", "watch"})
        del whole["search"]["trials"], whole["search"]["polish"]
        whole["search"]["sampler"] = self.sampler
        return whole


def parse_goal(text: str, origin: str = "goal") -> Goal:
    """Read a goal from TOML text, which messages call `origin`."""
    return GOALS.check(Goal, GOALS.parse(text, origin), origin)


@dataclass(frozen=True)
class Trial:
    """Evaluated point of a search."""

    kind: Literal["start", "search", "polish"]  # the design outside the bounds, the sampler, or the local solver
    place: int  # number of this kind
    changes: Mapping[str, Any]
    quantities: Mapping[str, float]
    scores: tuple[float, ...]
    violations: Mapping[str, float]
    reason: str = ""  # why there are no numbers
    accuracy: Accuracy = "full"

    @property
    def feasible(self) -> bool:
        """Whether the point is possible and keeps every bound."""
        return not self.reason and all(violation <= 0 for violation in self.violations.values())

    @property
    def name(self) -> str:
        """Kind and place, such as "search 12"."""
        return self.kind if self.kind == "start" else f"{self.kind} {self.place}"


def trial_of(
    goal: Goal,
    kind: Literal["start", "search", "polish"],
    place: int,
    changes: Mapping[str, Any],
    outcome: Mapping[str, float] | str,
    accuracy: Accuracy = "full",
) -> Trial:
    """Judge a point by its outcome."""
    if isinstance(outcome, str):
        return Trial(kind, place, changes, {}, (), {}, outcome, accuracy)
    values = {key: float(outcome[key]) for key in goal.quantities if key in outcome}
    return Trial(kind, place, changes, values, goal.scores(values), goal.violations(values), accuracy=accuracy)


def held_back(trials: Iterable[Trial], *, maximized: bool = False) -> tuple[Trial, list[str]] | None:
    """Return the best refused trial, with the limits that it breaks.

    None if a trial that keeps every limit is as good. The first score counts.
    """
    sign = -1 if maximized else 1
    scored = [one for one in trials if one.scores]
    kept = min((sign * one.scores[0] for one in scored if one.feasible), default=math.inf)
    better = [one for one in scored if not one.feasible and sign * one.scores[0] < kept]
    if not better:
        return None
    nearest = min(better, key=lambda one: sign * one.scores[0])
    return nearest, [limit for limit, violation in nearest.violations.items() if violation > 0]


def front_of(trials: Sequence[Trial], goal: Goal) -> tuple[Trial, ...]:
    """Feasible trials that no other beats, of one objective the first best."""
    signs = [-1 if objective.maximized else 1 for objective in goal.objectives]
    scores = {k: trial.scores for k, trial in enumerate(trials) if trial.feasible}
    return tuple(trials[k] for k in unbeaten(scores, signs))


def unbeaten(scores: Mapping[int, Sequence[float]], signs: Sequence[int]) -> list[int]:
    """Numbers of the Pareto front, where a sign of −1 marks a maximum."""
    costs = {k: [sign * score for sign, score in zip(signs, of, strict=True)] for k, of in scores.items()}
    front: list[int] = []
    for k in sorted(costs, key=lambda k: costs[k]):  # sorted by all costs, a point is not beaten by a later point
        if not any(all(a <= b for a, b in zip(costs[other], costs[k], strict=True)) for other in front):
            front.append(k)
    return front


def better_than(start: Trial, trials: Sequence[Trial], goal: Goal) -> tuple[Trial, ...]:
    """Pareto front of the trials that beat the start."""
    # It is complete if the start breaks a bound.
    found = [trial for trial in front_of((start, *trials), goal) if trial.kind != "start"]
    if not start.feasible:
        return tuple(found)
    signs = np.array([-1 if objective.maximized else 1 for objective in goal.objectives])
    before = np.array(start.scores)
    least = _SCORE_ROUNDING * np.abs(before)
    return tuple(trial for trial in found if (signs * (before - np.array(trial.scores)) > least).any())


def best_points(plan: Sweep, result: xr.Dataset, goal: Goal) -> tuple[Trial, ...]:
    """Best point of a sweep, or Pareto front."""
    # Points that break fabrication rules or that no converter can read are left out, unless the goal treats them.
    free = any(name.startswith(RULES) for name in goal.quantities)
    kept, read = (of(result).values.ravel().tolist() for of in (keeps_rules, is_read))
    any_read = UNREAD in goal.quantities
    columns = {key: result[key].values.ravel().tolist() for key in goal.quantities}
    reasons = result.reason.values.ravel().tolist()
    trials = []
    for k, changes in enumerate(plan.points):
        values = {key: column[k] for key, column in columns.items()}
        reason = reasons[k] or ("" if all(map(math.isfinite, values.values())) else "it lacks a quantity.")
        reason = reason or ("" if free or kept[k] else "it breaks fabrication rules.")
        reason = reason or ("" if any_read or read[k] else "no LDC1614 can read it.")
        trials.append(trial_of(goal, "search", k, changes, reason or values, plan.accuracy))
    return front_of(trials, goal)


@dataclass(frozen=True)
class Axis:
    """Variable of a goal, in the unit of its entry."""

    entry: str
    choices: tuple[str, ...] = ()  # JSON texts, empty for a number
    low: float = 0.0
    high: float = 1.0
    step: float | None = None  # None for any value
    log: bool = False
    whole: bool = False
    start: Any = None  # None if the design has no value

    @property
    def continuous(self) -> bool:
        """Whether any value between the bounds is allowed."""
        return not self.choices and not self.whole and self.step is None

    @property
    def _decimals(self) -> int | None:
        """Decimals of a length, None for others and close bounds."""
        names = [part for part in self.entry.split(".") if not part.isdecimal()]
        decimals = _DECIMALS.get(names[-1].rpartition("_")[2])
        return decimals if decimals is not None and self.high - self.low > _LEAST_STEPS * 10.0**-decimals else None

    def distribution(self) -> BaseDistribution:
        """Return the variable as Optuna has it."""
        from optuna.distributions import CategoricalDistribution, FloatDistribution, IntDistribution

        if self.choices:
            return CategoricalDistribution(self.choices)
        if self.whole:
            return IntDistribution(int(self.low), int(self.high), self.log, int(self.step or 1))
        if self.step is not None:
            return IntDistribution(0, round((self.high - self.low) / self.step))
        return FloatDistribution(self.low, self.high, self.log)

    def parameter(self, value: Any) -> Any:
        """Parameter of a value, None if it is impossible."""
        if self.choices:
            return next((text for text in self.choices if json.loads(text) == value), None)
        if not isinstance(value, int | float) or isinstance(value, bool) or not self.low <= value <= self.high:
            return None
        if self.step is not None:
            steps = (value - self.low) / self.step
            if abs(steps - round(steps)) > _ON_GRID:
                return None
            return int(value) if self.whole else round(steps)
        if self.whole:
            return int(value) if float(value).is_integer() else None
        return float(value)

    def value(self, parameter: Any) -> Any:
        """Value of a parameter, lengths rounded to 1 µm."""
        if self.choices:
            return json.loads(parameter)
        if self.step is not None and not self.whole:
            number = float(f"{self.low + parameter * self.step:.{_DIGITS}g}")  # 11.3, not 11.299999999999999
            return min(max(number, self.low), self.high)
        if not self.whole and parameter != self.start and (decimals := self._decimals) is not None:
            return min(max(round(parameter, decimals), self.low), self.high)
        return parameter

    def at(self, part: float) -> float:
        """Parameter of a continuous variable at a fraction."""
        part = min(max(part, 0.0), 1.0)
        if self.log:
            return float(min(max(self.low * (self.high / self.low) ** part, self.low), self.high))
        return self.low + part * (self.high - self.low)

    def part(self, parameter: float) -> float:
        """Return the inverse of `at` for a continuous variable."""
        if self.log:
            return math.log(parameter / self.low) / math.log(self.high / self.low)
        return (parameter - self.low) / (self.high - self.low)


def axes_of(goal: Goal, design: Design | DesignFile) -> tuple[Axis, ...]:
    """Check the variables of a goal against a design, or raise GoalError."""
    # Impossible geometries are found only in the search.
    file, axes = as_file(design), []
    for number, variable in enumerate(goal.variables):
        key, entry, start = f"variable.{number}", variable.entry, value_of(file, variable.entry)
        if variable.choices is not None:
            for choice in variable.choices:
                _check(file, entry, choice, f"{key}.choices")
            axes.append(Axis(entry, tuple(json.dumps(choice) for choice in variable.choices), start=start))
            continue
        low, high, step = variable.low, variable.high, variable.step
        assert low is not None  # checked by the table
        assert high is not None
        _check(file, entry, low, f"{key}.low")
        _check(file, entry, high, f"{key}.high")
        whole = isinstance(start, int) and not isinstance(start, bool)
        if start is None and low.is_integer() and high.is_integer():
            try:  # the entry's type is found from the values that it refuses
                _check(file, entry, low + 0.5 * min(1.0, high - low), entry)
            except GoalError:
                whole = True
        for name, value in (("low", low), ("high", high), ("step", step or 1.0)):
            if whole and not value.is_integer():
                raise GoalError(f"{key}.{name} must be a whole number, as {entry} is; got {value:g}.")
        axes.append(Axis(entry, (), low, high, step, variable.log, whole, start))
    return tuple(axes)


def changes_of(axes: Sequence[Axis], parameters: Mapping[str, Any]) -> dict[str, Any]:
    """Return the entries that parameters stand for."""
    return {axis.entry: axis.value(parameters[axis.entry]) for axis in axes}


def start_parameters(axes: Sequence[Axis]) -> dict[str, Any] | None:
    """Parameters of the design, None if outside the bounds."""
    parameters = {axis.entry: axis.parameter(axis.start) for axis in axes}
    return None if None in parameters.values() else parameters


def value_of(file: DesignFile, entry: str) -> Any:
    """Value of an entry, or of a place of it."""
    if entry in file.values:
        return file.values[entry]
    whole, _, place = entry.rpartition(".")
    values = file.values.get(whole)
    if isinstance(values, list) and place.isdecimal() and int(place) < len(values):
        return values[int(place)]
    return None


def _check(file: DesignFile, entry: str, value: Any, key: str) -> None:
    try:
        document = vary_document(file.document, {entry: value})
        Document.model_validate(document)
    except DesignError as error:
        raise GoalError(f"{key}: {error}") from None
    except ValidationError as error:
        raise GoalError(f"{key}: {first_error(error, document, Document)}") from None
