"""Exceptions of the package, and checks of numbers."""

from __future__ import annotations

import math
from collections.abc import Iterable
from numbers import Integral

_LONGEST = 500  # characters of an error, a path of 200 included
_END = 150  # characters after the cut
_SHOWN = 80  # characters of a value
LARGEST = 1e30
"""Largest allowed number: its sixth power, in the kernels, stays within the range of float64."""
_LISTED = 120  # characters of a list of names


class CoilarrayError(Exception):
    r"""Base of all errors that this package raises on purpose.

    A text is one line of printable characters, cut in the middle beyond 500.

    >>> str(CoilarrayError("x must be a number; got a\nb."))
    'x must be a number; got a b.'
    """

    def __init__(self, text: object = "") -> None:
        line = str(text)
        if not line.isprintable():
            line = "".join(one if one.isprintable() else "�" for one in " ".join(line.split()))
        if len(line) > _LONGEST:
            line = f"{line[: _LONGEST - _END]}…{line[-_END:]}"
        super().__init__(line)


def shown(value: object) -> str:
    """Write a value for a message, cut if long."""
    text = repr(value)
    return text if len(text) <= _SHOWN else f"{text[:_SHOWN]}…"


def listed(names: Iterable[str]) -> str:
    """Write names as a list for a message.

    A long list has its first names and their number.

    >>> listed(["x", "y"]), listed(["quantity"] * 50)[-43:]
    ('x, y', 'quantity, quantity, quantity, … (50 in all)')
    """
    every = list(names)
    text = ", ".join(every)
    if len(text) <= _LISTED:
        return text
    first = text[:_LISTED].rpartition(", ")[0] or text[:_SHOWN]
    return f"{first}, … ({len(every)} in all)"


class GeometryError(CoilarrayError, ValueError):
    """A shape that cannot exist."""


class DesignError(CoilarrayError, ValueError):
    """A design file that cannot be read."""


class RuleViolationError(CoilarrayError):
    """A design that breaks a fabrication rule."""


class NetworkError(CoilarrayError, ValueError):
    """A circuit without a solution, or an unknown state."""


class ElastomerError(CoilarrayError, ValueError):
    """An impossible indentation, or a contact that does not converge."""


class MetalError(CoilarrayError, ValueError):
    """A metal or ferrite body whose effect is not computed."""


class LocalizeError(CoilarrayError, ValueError):
    """A response or reading that gives no position."""


class BoardError(CoilarrayError, ValueError):
    """A board file that is unreadable or holds no coil."""


class GoalError(CoilarrayError, ValueError):
    """An impossible quantity, goal, sweep or tolerance."""


class ClusterError(CoilarrayError):
    """Workers that do not answer or were lost for good."""


class HardwareError(CoilarrayError):
    """A failing board, port, wiring, setting or recording."""


class OutputError(CoilarrayError):
    """A result that cannot be written."""


class DamagedError(CoilarrayError):
    """A file whose checksum shows that its content was changed."""


class UnusualValueWarning(UserWarning):
    """A possible value, yet a thousandfold off the usual."""


class MemoryLimitError(CoilarrayError, MemoryError):
    """Work that needs more memory than is allowed."""


class MissingDependencyError(CoilarrayError):
    """A missing library or system package that a command needs."""


def require_positive(what: str, value: float, unit: str = " m", error: type[Exception] = GeometryError) -> None:
    """Raise an error unless 0 < value ≤ `LARGEST`.

    `unit` follows the value in the message. With " mm" a value in m is shown in mm.
    """
    _require_number(what, value, error)
    if not 0 < value <= LARGEST:
        shown = f"{value * 1e3:g}" if unit == " mm" else f"{value}"
        raise error(f"{what} must be positive and {_bound(value)}; got {shown}{unit}.")


def require_finite(what: str, *values: float, error: type[CoilarrayError] = GeometryError) -> None:
    """Raise an error unless values are finite, up to `LARGEST`."""
    for value in values:
        _require_number(what, value, error)
        if not abs(value) <= LARGEST:
            raise error(f"{what} must be {_bound(value)}; got {value}.")


def require_whole(what: str, value: object, least: int) -> None:
    """Raise GeometryError unless a value is a whole number from `least`."""
    if isinstance(value, bool) or not isinstance(value, Integral) or value < least:
        raise GeometryError(f"{what} must be a whole number of at least {least}; got {shown(value)}.")


def _require_number(what: str, value: object, error: type[Exception]) -> None:
    """Raise an error for texts and lists in place of a number."""
    if isinstance(value, (str, bytes, list, tuple, dict, type(None))):
        raise error(f"{what} must be a number; got {shown(value)}.")


def _bound(value: float) -> str:
    """Say in words the bound of a number."""
    return "of a size up to 1e30" if LARGEST < abs(value) < math.inf else "finite"
