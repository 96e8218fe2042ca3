"""Quantities, and requests as ``k[coil1,coil2]`` or as a table."""

from __future__ import annotations

import difflib
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

from coilarray.circuit.board_circuit import board_circuit
from coilarray.errors import GoalError
from coilarray.studies.quantities.evaluation import Evaluation

Value: TypeAlias = str | float | tuple[str, ...] | tuple[float, ...]

Cost: TypeAlias = Literal["geometry", "coupling", "circuit", "target", "response", "table"]
"""Most expensive result that a quantity needs.

It is shapes alone, inductances, the circuit of every state, a target at some distances, an
indentation at some places, or an indentation at a whole table of places and depths.
"""
_EXAMPLES = {"coil": "coil1", "coils": "coil1,coil2"}  # of required options, in the form used in brackets


@dataclass(frozen=True)
class Option:
    """Option of a quantity.

    `read` returns the value of a text or a TOML value, or None. `must_be` describes allowed values,
    `says` the meaning. A `bare` option stands in a text without its name.
    """

    name: str
    must_be: str
    read: Callable[[Any], Value | None]
    says: str
    required: bool = False
    bare: bool = False


@dataclass(frozen=True)
class Quantity:
    """Number of a design to optimize, limit or tabulate.

    Its name ends with the unit, "1" for pure numbers.
    """

    name: str
    unit: str
    cost: Cost
    says: str
    compute: Callable[[Evaluation, Mapping[str, Any]], float]
    options: tuple[Option, ...] = ()

    @property
    def is_read(self) -> bool:
        """Whether a converter must read it, unlike shapes and inductances."""
        return self.cost not in ("geometry", "coupling")

    def asked(self, given: Mapping[str, Any]) -> Request:
        """Request with options, or GoalError for others than it has."""
        known = {option.name: option for option in self.options}
        for name in given:
            if name not in known:
                takes = f"it takes {', '.join(known)}" if known else "it takes none"
                close = difflib.get_close_matches(str(name), known, n=1)
                hint = f"; did you mean {close[0]}?" if close else f"; {takes}."
                raise GoalError(f"{self.name} has no option {name!r}{hint}")
        options: dict[str, Value] = {}
        for option in self.options:  # in their order, so that equal requests have equal keys
            if option.name in given:
                value = option.read(given[option.name])
                if value is None:
                    raise GoalError(f"{self.name}: {option.name} must be {option.must_be}; got {given[option.name]!r}.")
                options[option.name] = value
            elif option.required:
                names = _EXAMPLES.get(option.name) if option.bare else None
                hint = f": write {self.name}[{names}]" if names else ""
                raise GoalError(f"{self.name} needs the option {option.name}, {option.must_be}{hint}.")
        return Request(self, options)


@dataclass(frozen=True, eq=False)
class Request:
    """Quantity with the given options in its own order."""

    quantity: Quantity
    options: Mapping[str, Value]

    @property
    def coils(self) -> list[str]:
        """Names of the requested coils."""
        named = [self.options[option] for option in ("coil", "coils") if option in self.options]
        return [str(name) for value in named for name in (value if isinstance(value, tuple) else (value,))]

    @property
    def key(self) -> str:
        """Canonical text, equal for equal requests, such as ``k[coil1,coil2]``."""
        bare = {option.name for option in self.quantity.options if option.bare}
        parts = [_text(value) if name in bare else f"{name}={_text(value)}" for name, value in self.options.items()]
        return f"{self.quantity.name}[{','.join(parts)}]" if parts else self.quantity.name

    def value(self, evaluation: Evaluation) -> float:
        """Compute the quantity, or GoalError if the design lacks it."""
        number = float(self.quantity.compute(evaluation, self.options))
        if not math.isfinite(number):
            circuit = board_circuit(evaluation.design, accuracy=evaluation.accuracy)
            missing = circuit.windings.capacitance[1] if self.quantity.cost == "circuit" else ""
            why = f" without the {missing}" if missing else "."
            raise GoalError(f"{self.key} of {evaluation.design.name} is not finite: {number}{why}")
        return number


def _text(value: Value) -> str:
    if isinstance(value, str):
        return value
    if isinstance(value, float):
        return repr(value).removesuffix(".0")
    return ("," if isinstance(value[0], str) else ":").join(_text(part) for part in value)


def read_name(given: Any) -> str | None:
    """Read the name of a coil or a rule."""
    return given if isinstance(given, str) and given else None


def read_pair(given: Any) -> tuple[str, ...] | None:
    """Read two different names."""
    if not isinstance(given, list | tuple) or len(given) != 2 or given[0] == given[1]:
        return None
    return tuple(given) if all(read_name(name) for name in given) else None


def read_positive(given: Any) -> float | None:
    """Read a number above zero."""
    number = read_number(given)
    return number if number is not None and number > 0 else None


def read_rectangle(given: Any) -> tuple[float, ...] | None:
    """Read x_min, x_max, y_min, y_max from a list or text."""
    parts = given.split(":") if isinstance(given, str) else given
    if not isinstance(parts, list | tuple) or len(parts) != 4:
        return None
    numbers = [number for part in parts if (number := read_number(part)) is not None]
    return tuple(numbers) if len(numbers) == 4 and numbers[0] < numbers[1] and numbers[2] < numbers[3] else None


def read_number(given: Any) -> float | None:
    """Read a finite number."""
    if isinstance(given, bool) or not isinstance(given, str | int | float):
        return None
    try:
        number = float(given)
    except (ValueError, OverflowError):
        return None
    return number if math.isfinite(number) else None
