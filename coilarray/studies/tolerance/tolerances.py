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
    """Spread of one kind of error.

    Parameters
    ----------
    distribution : {"normal", "uniform"}
        Distribution of each part.
    board, layer : float
        Standard deviation in SI of the part that all layers of a board share, and of the part of each layer. The parts
        are independent and add up.
    """

    distribution: Distribution = "normal"
    board: float = 0.0
    layer: float = 0.0


@dataclass(frozen=True)
class Positions:
    """Positions of the indenter at which the response is wanted.

    Parameters
    ----------
    x, y : tuple of float
        Positions in m from the map's origin, in rising order. Every x is combined with every y.
    depth : float
        Depth of the indentation in m.
    noise : float, optional
        Standard deviation of δ for weighting readings when they are located. By default it follows from the design's
        noise budget.
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
        Bounds in the unit of the name, infinite for a missing bound.
    """

    quantity: str
    at_least: float = -math.inf
    at_most: float = math.inf

    @property
    def text(self) -> str:
        """Limit in one line of text."""
        low = "" if math.isinf(self.at_least) else f"{self.at_least:g} ≤ "
        high = "" if math.isinf(self.at_most) else f" ≤ {self.at_most:g}"
        return f"{low}{self.quantity}{high}"


@dataclass(frozen=True)
class Tolerances:
    """Tolerance file, read and checked.

    Parameters
    ----------
    spreads : mapping of str to Spread
        Spreads by table. A missing table means no error.
    assumed : mapping of str to str
        Tables that are not given, with the reason for their values.
    quantities : tuple of str
        Names of requested outputs. Empty if the file requests none.
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
    """Independent error of a board.

    It moves one or more errors of the board. It is a part of one kind of error and moves all of them equally.

    Parameters
    ----------
    name : str
        Name for people, such as ``etch, board`` or ``dielectric, layer L1-L2``.
    table : str
        Table of the file that it comes from.
    part : {"board", "layer"}
        ``board`` for an error common to all layers of a board, ``layer`` for an error of a single layer.
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
        Contributors with a spread. The board part and the layer part stay separate even for a single layer or sheet.

    Raises
    ------
    GoalError
        If no error has a spread.

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
