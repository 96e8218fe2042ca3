"""Variables as entries, parameters of Optuna, and unit box.

A parameter is named by its entry. For a choice it is the choice as JSON text, which Optuna can
always store. For a number with steps it counts the steps.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from pydantic import ValidationError

from coilarray.design.model import Design, DesignFile
from coilarray.design.tables import Document
from coilarray.design.toml_file import first_error
from coilarray.design.vary import vary_document
from coilarray.design.write import as_file
from coilarray.errors import DesignError, GoalError
from coilarray.studies.optimize.goal import Goal, Variable

if TYPE_CHECKING:
    from optuna.distributions import BaseDistribution

_DIGITS = 15
_DECIMALS = {"mm": 3, "um": 0}  # of a length that a board house can make: 1 µm
_LEAST_STEPS = 10  # between bounds; closer bounds are meant for a finer search
_ON_GRID = 1e-9  # of a step: how near to a step a value must be to stand on it


@dataclass(frozen=True)
class Axis:
    """Variable of a goal with its design value.

    `choices` are JSON texts, empty for a number. `low`, `high` and `step` are in the unit of the
    entry, with a step of None for any value. `start` is None if the design has no value.
    """

    entry: str
    choices: tuple[str, ...] = ()
    low: float = 0.0
    high: float = 1.0
    step: float | None = None
    log: bool = False
    whole: bool = False
    start: Any = None

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
    """Check the variables of a goal against a design.

    Raises GoalError for an unknown entry, or a bound or choice that the design file cannot have.
    Impossible geometries are found only in the search.
    """
    file = as_file(design)
    return tuple(_axis(variable, f"variable.{k}", file) for k, variable in enumerate(goal.variables))


def changes_of(axes: Sequence[Axis], parameters: Mapping[str, Any]) -> dict[str, Any]:
    """Return the entries that parameters stand for."""
    return {axis.entry: axis.value(parameters[axis.entry]) for axis in axes}


def start_parameters(axes: Sequence[Axis]) -> dict[str, Any] | None:
    """Parameters of the design, None if outside the bounds."""
    parameters = {axis.entry: axis.parameter(axis.start) for axis in axes}
    return None if None in parameters.values() else parameters


def _axis(variable: Variable, key: str, file: DesignFile) -> Axis:
    """Make the axis of a variable, checked against the design."""
    start = value_of(file, variable.entry)
    if variable.choices is not None:
        for choice in variable.choices:
            _check(file, variable.entry, choice, f"{key}.choices")
        return Axis(variable.entry, tuple(json.dumps(choice) for choice in variable.choices), start=start)
    low, high = variable.low, variable.high
    assert low is not None  # checked by the table
    assert high is not None
    _check(file, variable.entry, low, f"{key}.low")
    _check(file, variable.entry, high, f"{key}.high")
    whole = isinstance(start, int) and not isinstance(start, bool)
    if start is None:  # the entry's type is found from the values that it refuses
        whole = (
            low.is_integer()
            and high.is_integer()
            and not _allowed(file, variable.entry, low + 0.5 * min(1.0, high - low))
        )
    step = variable.step
    if whole:
        for name, number in (("low", low), ("high", high), ("step", step or 1.0)):
            if not number.is_integer():
                raise GoalError(f"{key}.{name} must be a whole number, as {variable.entry} is; got {number:g}.")
    return Axis(variable.entry, (), low, high, step, variable.log, whole, start)


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
    """Refuse a value that the entry cannot have."""
    try:
        document = vary_document(file.document, {entry: value})
        Document.model_validate(document)
    except DesignError as error:
        raise GoalError(f"{key}: {error}") from None
    except ValidationError as error:
        raise GoalError(f"{key}: {first_error(error, document, Document)}") from None


def _allowed(file: DesignFile, entry: str, value: Any) -> bool:
    try:
        _check(file, entry, value, entry)
    except GoalError:
        return False
    return True
