"""Calibration plans: unknown entries, alternatives, and the data to fit.

The bundled ``table_a1`` is a longer example of the TOML files::

    schema = 1

    [[unknown]]
    entry = "imperfections.depth_error_mm"
    low = -0.3
    high = 0.3
    prior_mean = 0.0                # without prior_mean and prior_std flat
    prior_std = 0.1

    [[alternative]]                 # every combination of choices is fitted
    name = "base"
    [[alternative.choice]]
    name = "bonded"
    [[alternative.choice]]
    name = "frictionless"
    set = { "indentation.base" = "frictionless" }
"""

from __future__ import annotations

import itertools
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, field_validator, model_validator

from coilarray.design.keys import Table
from coilarray.design.toml_file import TomlFiles
from coilarray.errors import GoalError, listed, shown

PLANS = TomlFiles("calibration plan", GoalError, "coilarray.studies.calibrate.plans")
"""Files of calibration plans, and the bundled plans."""
Parameter = Literal["A", "B", "x0", "peak"]
"""Parameters of ellipses that may be fitted."""
MOST_COMBINATIONS = 200
"""Largest number of combinations of choices that are fitted."""
FITTED: tuple[Parameter, ...] = ("A", "B", "peak")
"""Parameters of ellipses that are fitted by default."""
LEVELS = tuple(k * 1e-4 for k in range(1, 11))
"""δ of the ellipses that are fitted by default."""
IMPERFECTIONS = {
    "depth_error_mm": 1e-3,
    "tilt_x_mrad": 1e-3,
    "tilt_y_mrad": 1e-3,
    "offset_x_mm": 1e-3,
    "offset_y_mm": 1e-3,
    "drift": 1.0,
    "column_drift": 1.0,
}
"""Unknowns ``imperfections.…`` of the experiment, with their units in SI."""
IMPERFECTION = "imperfections."
"""Prefix of unknowns of the experiment."""


def separated(values: Mapping[str, float]) -> tuple[dict[str, float], dict[str, float]]:
    """Values of the design, and of the experiment without prefix."""
    entries = {key: value for key, value in values.items() if not key.startswith(IMPERFECTION)}
    return entries, {key.removeprefix(IMPERFECTION): value for key, value in values.items() if key not in entries}


class Unknown(Table):
    """``[[unknown]]``: one or several entries with one value, between bounds.

    The prior is flat. With `prior_mean` and `prior_std` it is normal and cut off at the bounds.
    """

    entry: Annotated[
        list[str], Field(min_length=1), BeforeValidator(lambda value: [value] if isinstance(value, str) else value)
    ]
    """Dotted key of the design, or several that share one value."""
    low: float
    """Least value, in the unit of the entry, as all of this table."""
    high: float
    """Largest value."""
    start: float | None = None
    """Value to start from. By default the design's own."""
    prior_mean: float | None = None
    """Mean of a normal prior, by default flat between the bounds."""
    prior_std: Annotated[float, Field(gt=0)] | None = None
    """Its standard deviation."""

    @model_validator(mode="after")
    def _consistent(self) -> Unknown:
        """Require consistent bounds, start, prior and entries."""
        if not self.low < self.high:
            raise ValueError(f"needs low below high; got {self.low:g} and {self.high:g}")
        if self.start is not None and not self.low <= self.start <= self.high:
            raise ValueError(f"needs start from low to high; got {self.start:g}")
        if (self.prior_mean is None) != (self.prior_std is None):
            raise ValueError("needs both prior_mean and prior_std, or neither")
        if self.prior_mean is not None and not self.low <= self.prior_mean <= self.high:
            raise ValueError(f"needs prior_mean from low to high; got {self.prior_mean:g}")
        known = [f"{IMPERFECTION}{name}" for name in IMPERFECTIONS]
        for entry in self.entry:
            if entry.startswith(IMPERFECTION) and entry not in known:
                raise ValueError(f"needs an imperfection of {', '.join(known)}; got {entry}")
        return self

    @property
    def name(self) -> str:
        """First entry of the unknown."""
        return self.entry[0]


class Choice(Table):
    """``[[alternative.choice]]``: entries to set and remove, and own unknowns."""

    name: Annotated[str, Field(min_length=1)]
    """Name of the answer."""
    set: dict[str, Any] = Field(default_factory=dict)
    """Values of the design by their dotted keys."""
    without: list[str] = Field(default_factory=list)
    """Keys of the design that it removes."""
    unknowns: list[Unknown] = Field(alias="unknown", default_factory=list)

    @field_validator("set")
    @classmethod
    def _finite(cls, values: dict[str, Any]) -> dict[str, Any]:
        """Require finite numbers in all values."""
        for key, value in values.items():
            try:
                json.dumps(value, allow_nan=False, default=str)
            except ValueError:
                raise ValueError(f"must have finite numbers for {key}; got {shown(value)}") from None
        return values


class Alternative(Table):
    """``[[alternative]]``: a question with a few answers, each fitted."""

    name: Annotated[str, Field(min_length=1)]
    """Name of the question."""
    choices: list[Choice] = Field(alias="choice", min_length=1)

    @model_validator(mode="after")
    def _different(self) -> Alternative:
        names = [choice.name for choice in self.choices]
        if len(set(names)) != len(names):
            raise ValueError(f"needs choices with different names; got {listed(names)}")
        return self


class DataTable(Table):
    """``[data]``: the fitted part of the measurement, and its noise.

    By default all ``states`` are fitted, and of ellipses A, B and the peak. ``noise = "estimated"``
    takes the deviations as relative, by default for ellipses and for a response without deviations.
    ``noise = "given"`` trusts them. A recording's noise is known as well as its repeats or
    baselines determine it.
    """

    states: Annotated[list[str], Field(min_length=1)] | None = None
    """States whose readings are fitted. By default all."""
    tested: list[str] = Field(default_factory=list)
    """States that are only predicted, to test the fit."""
    parameters: Annotated[list[Parameter], Field(min_length=1)] = Field(default_factory=lambda: list(FITTED))
    """Of ellipses: the parameters that are fitted."""
    levels: Annotated[list[Annotated[float, Field(gt=0)]], Field(min_length=1)] = Field(
        default_factory=lambda: list(LEVELS)
    )
    """Of ellipses: levels of δ."""
    semiaxis_std_mm: Annotated[float, Field(gt=0)] = 0.5
    """Standard deviation of the semiaxes A and B."""
    peak_std: Annotated[float, Field(gt=0)] = 5e-5
    """Standard deviation of the peak of δ."""
    delta_std: Annotated[float, Field(gt=0)] | None = None
    """Standard deviation of δ, if the response has none."""
    noise: Literal["given", "estimated"] | None = None
    """Whether standard deviations are trusted, or their scale is estimated from residuals."""


class Plan(Table):
    """Calibration plan, read by `load_plan`."""

    schema_: Annotated[int, Field(ge=1, le=1)] = Field(alias="schema", default=1)
    """Version of the file format."""
    title: str = ""
    """Title in reports."""
    data: DataTable = DataTable()
    unknowns: list[Unknown] = Field(alias="unknown", default_factory=list)
    alternatives: list[Alternative] = Field(alias="alternative", default_factory=list)

    @model_validator(mode="after")
    def _consistent(self) -> Plan:
        """Require different names and entries in every combination."""
        names = [one.name for one in self.alternatives]
        if len(set(names)) != len(names):
            raise ValueError(f"needs every [[alternative]] to have a name of its own; got {', '.join(names)}")
        count = 1
        for one in self.alternatives:
            count *= len(one.choices)
        if count > MOST_COMBINATIONS:
            raise ValueError(f"needs at most {MOST_COMBINATIONS} combinations of choices; got {count}")
        for choices in self.combinations():
            unknowns = self.unknowns_of(choices)
            if not unknowns:
                raise ValueError("needs at least one [[unknown]] in every combination of choices")
            entries = [entry for unknown in unknowns for entry in unknown.entry]
            twice = next((entry for entry in entries if entries.count(entry) > 1), None)
            if twice is not None:
                raise ValueError(f"names {twice} in more than one [[unknown]]")
            fixed = [key for choice in choices for key in (*choice.set, *choice.without)]
            for key in fixed:
                if key in entries or fixed.count(key) > 1:
                    raise ValueError(f"sets {key} twice: by two choices, or by a choice and an unknown")
        return self

    def combinations(self) -> list[tuple[Choice, ...]]:
        """Return every combination of one choice per alternative."""
        return list(itertools.product(*(one.choices for one in self.alternatives)))

    def unknowns_of(self, choices: tuple[Choice, ...]) -> list[Unknown]:
        """Return the unknowns of the plan, then of the choices."""
        return [*self.unknowns, *(unknown for choice in choices for unknown in choice.unknowns)]


def load_plan(name_or_path: str | Path) -> Plan:
    """Read the calibration plan `name_or_path`, bundled or a file.

    Raises GoalError for an unreadable file, wrong TOML, an unknown key or a value that is not
    allowed, in one line.

    Examples
    --------
    >>> [unknown.name for unknown in load_plan("table_a1").unknowns][:2]
    ['stackup.dielectric_thickness_mm.1', 'elastomer.1.relative_permeability']
    """
    return check_plan(PLANS.parse(PLANS.text(name_or_path), str(name_or_path)), str(name_or_path))


def check_plan(document: Mapping[str, Any], origin: str = "plan") -> Plan:
    """Read a calibration plan from TOML tables."""
    return PLANS.check(Plan, document, origin)


def simple_plan(unknowns: Mapping[str, Any]) -> Plan:
    """Return the plan of unknowns by entry, without priors.

    Each has (low, high) or (low, high, start).
    """
    tables = []
    for entry, values in unknowns.items():
        numbers = [float(value) for value in values]
        if len(numbers) not in (2, 3):
            raise GoalError(f"the unknown {entry} must have low and high, or low, high and start; got {values}.")
        tables.append({"entry": entry, **dict(zip(("low", "high", "start"), numbers, strict=False))})
    return check_plan({"unknown": tables}, "unknowns")
