"""Quantities, requests, and intermediate results of one design."""

from __future__ import annotations

import difflib
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Literal, TypeAlias

import numpy as np
import xarray as xr

from coilarray.circuit.board_circuit import board_circuit
from coilarray.circuit.coupling import design_circuit, design_inductance, scan_design
from coilarray.compute.arrays import FloatArray
from coilarray.design.boards import check_boards
from coilarray.design.model import Design, Indentation
from coilarray.electromagnetics.inductance import Accuracy, coupling_matrix
from coilarray.errors import GoalError, MetalError
from coilarray.geometry import Margin, Target
from coilarray.response.interpolation import coil_extent
from coilarray.response.map import Imperfections, response_map
from coilarray.response.setup import no_indentation, target_of
from coilarray.response.target import target_map

Rectangle = tuple[float, float, float, float]
_CONTACT_ENDS = 4.0  # depths above the tip of an indenter, beyond which it never touches (coilarray.elastomer.contact)
Value: TypeAlias = str | float | tuple[str, ...] | tuple[float, ...]

Cost: TypeAlias = Literal["geometry", "coupling", "circuit", "target", "response", "table"]
"""Most expensive result that a quantity needs.

It is shapes alone, inductances, the circuit of every state, a target at some distances, an
indentation at some places, or an indentation at a whole table of places and depths.
"""
_EXAMPLES = {"coil": "coil1", "coils": "coil1,coil2"}  # of required options, in the form used in brackets


@dataclass(frozen=True, eq=False)
class Evaluation:
    """Intermediate results of a design at an `Accuracy`."""

    design: Design
    accuracy: Accuracy = "full"
    _maps: dict[tuple[tuple[float | str, ...], ...], xr.Dataset] = field(default_factory=dict, init=False, repr=False)
    unread: list[int] = field(default_factory=list, init=False, repr=False)
    """Numbers of used values that the converter cannot read."""

    def taken(self, found: xr.Dataset) -> xr.Dataset:
        """Return a dataset, and note values that are not readable."""
        if "readable" in found:
            self.unread.append(int((~found.readable).sum()))
        return found

    @cached_property
    def margins(self) -> tuple[Margin, ...]:
        """Margins of the fabrication rules."""
        return check_boards(self.design)

    @cached_property
    def inductance(self) -> FloatArray:
        """Inductances (coils, coils) in H under the flat sheets."""
        return design_inductance(self.design, accuracy=self.accuracy)[0]

    @cached_property
    def coupling(self) -> FloatArray:
        """Coupling coefficients, shape (coils, coils)."""
        return coupling_matrix(self.inductance)

    @cached_property
    def scan(self) -> xr.Dataset:
        """All states of the scan in which the converter oscillates."""
        return self.taken(scan_design(self.design, elastomer=False, accuracy=self.accuracy))

    @cached_property
    def own_states(self) -> dict[str, int]:
        """First state of each coil alone, by coil."""
        states: dict[str, int] = {}
        for k, state in enumerate(self.design.plan):
            if len(state.measured) == 1:
                states.setdefault(state.measured[0][0], k)
        return states

    @property
    def indentation(self) -> Indentation:
        """Indentation of the design, or GoalError."""
        if self.design.indentation is None:
            raise GoalError(no_indentation(self.design))
        return self.design.indentation

    def depth(self, given_mm: float | None) -> float:
        """Return the depth in m, by default the design's first."""
        return self.indentation.depths[0] if given_mm is None else given_mm * 1e-3

    def response(self, depths: FloatArray, x: FloatArray, y: FloatArray) -> xr.Dataset:
        """Response at depths and places from the map's origin."""
        key: tuple[tuple[float | str, ...], ...] = tuple(tuple(np.atleast_1d(axis).tolist()) for axis in (depths, x, y))
        if key not in self._maps:
            circuit = Imperfections(network=design_circuit(self.design, accuracy=self.accuracy))
            found = response_map(self.design, depths=depths, x=x, y=y, imperfections=circuit, accuracy="auto")
            self._maps[key] = self.taken(found)
        return self._maps[key]

    @property
    def target(self) -> Target:
        """Target of the design, or GoalError."""
        try:
            return target_of(self.design)
        except MetalError as error:
            raise GoalError(str(error)) from None

    def distance(self, given_mm: float | None) -> float:
        """Return the target's distance in m, by default the least."""
        return self.target.distances[0] if given_mm is None else given_mm / 1e3

    def target_map(self, distances: Sequence[float], x: float, y: float) -> xr.Dataset:
        """Effect of the target at distances and a place."""
        key = (tuple(distances), (x,), (y,), ("target",))
        if key not in self._maps:
            network = design_circuit(self.design, accuracy=self.accuracy)
            self._maps[key] = target_map(
                self.design, distances=list(distances), x=[x], y=[y], network=network, accuracy=self.accuracy
            )
        return self._maps[key]

    def coil(self, name: str) -> int:
        """Index of a coil, or GoalError."""
        names = self.design.coil_names
        if name not in names:
            raise GoalError(f"the design {self.design.name} has no coil {name!r}; there are {', '.join(names)}.")
        return names.index(name)

    def state_of(self, coil: str) -> int:
        """Index of a coil's first state alone, or GoalError."""
        self.coil(coil)
        if coil not in self.own_states:
            raise GoalError(f"the scan of {self.design.name} has no state that measures {coil} alone.")
        return self.own_states[coil]

    def centre(self, coil: str) -> tuple[float, float]:
        """Return a coil's centre in m from the map's origin."""
        x, y = self.design.array.centres[self.coil(coil)] - self.indentation.origin_point
        return float(x), float(y)

    def window(self, depth: float, beyond: float = 0.0) -> Rectangle:
        """Range of the indenter: x_min, x_max, y_min, y_max in m."""
        # from the map's origin, up to `beyond` the coils' outlines, the contact inside the sample or GoalError
        least, greatest = self.indentation.reachable(_CONTACT_ENDS * depth)
        low, high = coil_extent(self.design)
        low, high = np.maximum(low - beyond, least), np.minimum(high + beyond, greatest)
        if not (low < high).all():
            raise GoalError(f"the sample of {self.design.name} leaves no room for the indenter over the coils.")
        return float(low[0]), float(high[0]), float(low[1]), float(high[1])


@dataclass(frozen=True)
class Option:
    """Option of a quantity."""

    name: str
    must_be: str  # allowed values
    read: Callable[[Any], Value | None]  # value of a text or a TOML value, or None
    says: str  # its meaning
    required: bool = False
    bare: bool = False  # whether a text has it without its name


@dataclass(frozen=True)
class Quantity:
    """Number of a design to optimize, limit or tabulate."""

    name: str  # ends with the unit
    unit: str  # "1" for pure numbers
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


def read_rectangle(given: Any) -> tuple[float, ...] | None:
    """Read x_min, x_max, y_min, y_max from a list or text."""
    parts = given.split(":") if isinstance(given, str) else given
    if not isinstance(parts, list | tuple) or len(parts) != 4:
        return None
    numbers = [number for part in parts if (number := read_number(part)) is not None]
    return tuple(numbers) if len(numbers) == 4 and numbers[0] < numbers[1] and numbers[2] < numbers[3] else None


def read_number(given: Any, above: float = -math.inf) -> float | None:
    """Read a finite number above another one."""
    if isinstance(given, bool) or not isinstance(given, str | int | float):
        return None
    try:
        number = float(given)
    except (ValueError, OverflowError):
        return None
    return number if math.isfinite(number) and number > above else None


def read_positive(given: Any) -> float | None:
    """Read a number above zero."""
    return read_number(given, above=0.0)
