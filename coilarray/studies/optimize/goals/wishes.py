"""Wishes, bounds and variables in the syntax of the command line."""

from __future__ import annotations

import re
from itertools import pairwise
from typing import Any

from coilarray.errors import GoalError
from coilarray.studies.optimize.goal import Variable
from coilarray.studies.sweep import Axis

_STEPS = 9  # of a variable with steps in a sweep
_NUMBER = r"([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)"
_QUANTITY = r"([^\[\]<>=]+(?:\[[^\[\]]*\])?)"
_DIRECTED = re.compile(rf"(minimize|maximize)\s+{_QUANTITY}")
_TARGET = re.compile(rf"{_QUANTITY}\s*=\s*{_NUMBER}")
_BOUND = re.compile(rf"{_QUANTITY}\s*(>=|<=|≥|≤)\s*{_NUMBER}")


def parse_wish(text: str) -> dict[str, Any] | None:
    """Read a wish as an objective.

    The form is ``minimize QUANTITY``, ``maximize QUANTITY`` or ``QUANTITY=VALUE``. None for any other text.

    Examples
    --------
    >>> parse_wish("maximize q"), parse_wish("k[coil1,coil2]=0")
    ({'quantity': 'q', 'direction': 'maximize'}, {'quantity': 'k[coil1,coil2]', 'target': 0.0})
    """
    if found := _DIRECTED.fullmatch(text.strip()):
        return {"quantity": found[2].strip(), "direction": found[1]}
    if found := _TARGET.fullmatch(text.strip()):
        return {"quantity": found[1].strip(), "target": float(found[2])}
    return None


def parse_bound(text: str) -> dict[str, Any]:
    """Read a bound as a constraint.

    The form is ``QUANTITY>=VALUE`` or ``QUANTITY<=VALUE``. Raises GoalError for any other text.

    Examples
    --------
    >>> parse_bound("span_mm >= 80")
    {'quantity': 'span_mm', 'at_least': 80.0}
    """
    found = _BOUND.fullmatch(text.strip())
    if found is None:
        raise GoalError(f"--keep must be QUANTITY>=VALUE or QUANTITY<=VALUE; got {text!r}.")
    side = "at_least" if found[2] in (">=", "≥") else "at_most"
    return {"quantity": found[1].strip(), side: float(found[3])}


def variable_of(axis: Axis) -> dict[str, Any]:
    """Return an axis of the command line as a variable.

    The axis is START:STOP, START:STOP:COUNT as steps, or A,B,… as choices.
    """
    values = axis.values
    if axis.interval:
        return {"entry": axis.key, "low": values[0], "high": values[1]}
    steps = {round(b - a, 9) for a, b in pairwise(values)} if axis.numeric else set()
    if axis.numeric and len(values) > 2 and len(steps) == 1 and min(steps) > 0:
        return {"entry": axis.key, "low": values[0], "high": values[-1], "step": steps.pop()}
    return {"entry": axis.key, "choices": list(values)}


def axis_of(variable: Variable) -> Axis:
    """Return a variable as an axis of a sweep."""
    if variable.choices is not None:
        return Axis(variable.entry, tuple(variable.choices))
    assert variable.low is not None  # checked by the table
    assert variable.high is not None
    if variable.step is None:
        return Axis(variable.entry, (variable.low, variable.high), interval=True)
    count = round((variable.high - variable.low) / variable.step)
    places = {round(count * k / (_STEPS - 1)) for k in range(_STEPS)}
    return Axis(variable.entry, tuple(variable.low + variable.step * place for place in sorted(places)))
