"""Exceptions of the package, each of which says in one line what to change, and checks of numbers."""

from __future__ import annotations

import math
from collections.abc import Iterable

_LONGEST = 500  # characters of an error, a path of 200 included
_END = 150  # of them behind what is cut out
_SHOWN = 80  # characters of a value
LARGEST = 1e30
"""Of any number: powers of it, up to the sixth in the kernels, stay within the range of float64."""
_LISTED = 120  # characters of a list of names


class CoilarrayError(Exception):
    r"""Base of every error that this package raises on purpose; the command line prints it in one line.

    Whatever a bad file puts into the text, it is one line of printable characters, and what is longer than 500 is cut
    in the middle.

    Examples
    --------
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
    """Write a value for a message, cut where it is long."""
    text = repr(value)
    return text if len(text) <= _SHOWN else f"{text[:_SHOWN]}…"


def listed(names: Iterable[str]) -> str:
    """Write names as a list for a message; of a long one the first, and how many there are.

    Examples
    --------
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
    """A shape that cannot exist: what, which value, what is allowed."""


class DesignError(CoilarrayError, ValueError):
    """A design file that cannot be read: the file, the key, what was given, what is allowed."""


class RuleViolationError(CoilarrayError):
    """A design that breaks a fabrication rule: layer, feature and margin."""


class NetworkError(CoilarrayError, ValueError):
    """A circuit that has no solution, or a state that names what is not there: which state, which coil."""


class ElastomerError(CoilarrayError, ValueError):
    """An indentation that cannot be, or a contact that does not converge: what, which value, what is allowed."""


class MetalError(CoilarrayError, ValueError):
    """A body of metal or ferrite whose effect is not computed: which value, what is allowed."""


class LocalizeError(CoilarrayError, ValueError):
    """A response or reading that gives no position: which coil or value, what is allowed."""


class BoardError(CoilarrayError, ValueError):
    """A board file that cannot be read or holds no coil: the file, the place in it, and the reason."""


class GoalError(CoilarrayError, ValueError):
    """A quantity, goal, sweep or tolerance that cannot be: which name or value, what is allowed."""


class ClusterError(CoilarrayError):
    """Workers that do not answer or were lost for good: which address or process, and what to do."""


class HardwareError(CoilarrayError):
    """A port, wiring, setting or recording that cannot be used, or a board that fails: which one, and what was met."""


class OutputError(CoilarrayError):
    """A result that cannot be written: the path and the reason."""


class DamagedError(CoilarrayError):
    """A file whose content is not what this package wrote, as its checksum shows: which file."""


class UnusualValueWarning(UserWarning):
    """A value that is possible, but a thousand times more or less than usual: which one, and the likely one."""


class MemoryLimitError(CoilarrayError, MemoryError):
    """Work needs more memory than is allowed. The message names both."""


class MissingDependencyError(CoilarrayError):
    """A library or system package that a command needs and the machine lacks; the text names it."""


def require_positive(what: str, value: float, unit: str = " m", error: type[Exception] = GeometryError) -> None:
    """Raise an error unless a value is positive and at most `LARGEST`; `unit` stands behind it, " mm" of one in m."""
    if not 0 < value <= LARGEST:
        shown = f"{value * 1e3:g}" if unit == " mm" else f"{value}"
        raise error(f"{what} must be positive and {_bound(value)}; got {shown}{unit}.")


def require_finite(what: str, *values: float, error: type[CoilarrayError] = GeometryError) -> None:
    """Raise an error unless all values are finite, up to `LARGEST`."""
    for value in values:
        if not abs(value) <= LARGEST:
            raise error(f"{what} must be {_bound(value)}; got {value}.")


def _bound(value: float) -> str:
    """Say what a number that is beyond every limit must be."""
    return "of a size up to 1e30" if LARGEST < abs(value) < math.inf else "finite"
