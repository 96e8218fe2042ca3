"""Distributions of fabrication errors, and the outputs and limits of the boards."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from coilarray.design.model import Design
from coilarray.errors import GoalError
from coilarray.studies.tolerance.perturb import error_names

Distribution = Literal["normal", "uniform"]

UNITS: Mapping[str, str] = {
    "etch": "m", "registration": "m", "rotation": "rad", "dielectric": "1", "copper": "1", "placement": "m",
    "permeability": "1", "elastomer": "m", "capacitance": "1", "plate_distance": "m", "plate_thickness": "1",
    "conductivity": "1", "target_tilt": "rad",
}  # fmt: skip
"""SI units of the errors by the tables of a file."""

KINDS: Mapping[str, tuple[str, ...]] = {
    table: (f"{table}_x", f"{table}_y") if table in ("registration", "placement", "target_tilt") else (table,)
    for table in UNITS
}
"""Errors of `coilarray.studies.tolerance.perturb` by the tables of a file."""


@dataclass(frozen=True)
class Spread:
    """How far one kind of error scatters.

    Parameters
    ----------
    distribution : {"normal", "uniform"}
        Distribution of each part.
    board, layer : float
        Standard deviation of the part that all layers of a board share, and of the part of each layer, in SI; the
        parts are independent and add up.
    """

    distribution: Distribution = "normal"
    board: float = 0.0
    layer: float = 0.0


@dataclass(frozen=True)
class Positions:
    """Where the indenter presses when the response is asked for.

    Parameters
    ----------
    x, y : tuple of float
        Rising, in m from the map's origin; every x with every y.
    depth : float
        Depth of the indentation in m.
    noise : float, optional
        Standard deviation of δ with which readings are weighted when they are located; that of the design's noise
        budget by default.
    """

    x: tuple[float, ...]
    y: tuple[float, ...]
    depth: float
    noise: float | None = None


@dataclass(frozen=True)
class Limit:
    """Bounds that a good board keeps.

    Parameters
    ----------
    quantity : str
        Name of an output.
    at_least, at_most : float
        Bounds in the unit of the name; infinite where there is none.
    """

    quantity: str
    at_least: float = -math.inf
    at_most: float = math.inf

    @property
    def text(self) -> str:
        """The limit in one line."""
        low = "" if math.isinf(self.at_least) else f"{self.at_least:g} ≤ "
        high = "" if math.isinf(self.at_most) else f" ≤ {self.at_most:g}"
        return f"{low}{self.quantity}{high}"


@dataclass(frozen=True)
class Tolerances:
    """A tolerance file, read and checked.

    Parameters
    ----------
    spreads : mapping of str to Spread
        Spreads by table; a missing table means no error.
    assumed : mapping of str to str
        Tables that are not given, with the reason for their values.
    quantities : tuple of str
        Names of outputs that the file asks for; empty if it asks for none.
    positions : Positions or None
        Positions where the response is wanted.
    limits : tuple of Limit
        Limits of the outputs.
    """

    spreads: Mapping[str, Spread]
    assumed: Mapping[str, str] = field(default_factory=dict)
    quantities: tuple[str, ...] = ()
    positions: Positions | None = None
    limits: tuple[Limit, ...] = ()


@dataclass(frozen=True)
class Contributor:
    """One independent error: a part of one kind of error that moves one or more errors of the board alike.

    Parameters
    ----------
    name : str
        Name for people: ``etch, board``, ``dielectric, layer L1-L2``.
    table : str
        Table of the file that it comes from.
    part : {"board", "layer"}
        ``board`` for an error common to all layers of a board, ``layer`` for one of its own for each.
    targets : tuple of str
        Errors of `coilarray.studies.tolerance.perturb.perturb` to which it is added.
    distribution : {"normal", "uniform"}
        Distribution, with mean zero.
    deviation : float
        Standard deviation in SI.
    """

    name: str
    table: str
    part: Literal["board", "layer"]
    targets: tuple[str, ...]
    distribution: Distribution
    deviation: float


def contributors(design: Design, tolerances: Tolerances) -> tuple[Contributor, ...]:
    """Independent errors of a design's boards.

    Parameters
    ----------
    design : Design
        Design with the layers and sheets.
    tolerances : Tolerances
        Spreads of the errors.

    Returns
    -------
    tuple of Contributor
        Contributors with a spread. The board part and the layer part stay separate even where there is a single layer
        or sheet.

    Raises
    ------
    GoalError
        No error has a spread.

    Examples
    --------
    >>> from coilarray import load_design
    >>> alone = Tolerances({"dielectric": Spread(board=0.02, layer=0.03)})
    >>> [one.name for one in contributors(load_design("gast_fem"), alone)]
    ['dielectric, board', 'dielectric, layer L1-L2']
    """
    names = error_names(design)
    found = []
    for table, kinds in KINDS.items():
        spread = tolerances.spreads.get(table, Spread())
        for kind in kinds:
            targets = tuple(name for name in names if name == kind or name.startswith(f"{kind}."))
            how = spread.distribution
            if spread.board > 0 and targets:
                found.append(Contributor(f"{kind}, board", table, "board", targets, how, spread.board))
            for target in targets if spread.layer > 0 else ():
                name = f"{kind}, layer {target.removeprefix(f'{kind}.')}"
                found.append(Contributor(name, table, "layer", (target,), how, spread.layer))
    if not found:
        raise GoalError(f"no error of {design.name} has a spread; at least one must be above 0.")
    return tuple(found)
