"""A new design from a few choices: how many coils, of which shape and size, with which inductance, made by whom."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, Literal, get_args

from coilarray.circuit.coupling import design_inductance
from coilarray.design.bundled import DESIGNS
from coilarray.design.model import DesignFile, build_design_file
from coilarray.design.units import Name, Table
from coilarray.design.vary import plain
from coilarray.errors import DesignError
from coilarray.geometry.values import SIDES, Side
from coilarray.studies.create.arrangement import read_arrangement
from coilarray.studies.create.connector import with_connector
from coilarray.studies.create.layout import Wishes, lay_out, most_on_fewer_layers
from coilarray.studies.create.plan import SHAPES, Plan, Shape
from coilarray.studies.create.tank import tank_capacitance

Overlap = Literal["none", "decoupled"]
_FROM_TO = {
    "size": (0.5e-3, 1.0, 1e3, "mm"), "pitch": (0.5e-3, 1.0, 1e3, "mm"),
    "inductance": (1e-9, 0.1, 1e6, "µH"), "frequency": (1e3, 1e9, 1e-6, "MHz"),
}  # fmt: skip
"""The range of each choice in SI, wider than that of planar coils, and the unit of its option."""
_DIGITS = 3  # of an inductance that is reached


class _Named(Table):
    """What a design file takes for a name, refused before any work."""

    name: Name


def new_design(
    name: str,
    coils: str | int = "3",
    *,
    shape: Shape = "hexagon",
    size: float | tuple[float, float] = 16e-3,
    inductance: float | None = None,
    layers: int | None = None,
    fab: str | None = None,
    pitch: float | None = None,
    overlap: Overlap = "none",
    elastomer: bool = True,
    frequency: float | None = None,
    connector: Side | None = None,
    title: str = "",
) -> DesignFile:
    """Make a design that a board house can make and a converter can read, from a few choices.

    Parameters
    ----------
    name : str
        Name of the design.
    coils : str or int
        ``"1"``, ``"6"`` (a row), ``"4x4"`` (columns by rows), or ``"7-hex"``, ``"19-hex"`` or ``"37-hex"``: rings about
        a centre.
    shape : {"hexagon", "square", "circle", "rectangle", "racetrack"}
        Shape of the coils.
    size : float or tuple of float
        Width in m of a coil's copper: of a hexagon across flats. A rectangle or racetrack has width and height.
    inductance : float, optional
        Inductance in H that a coil is to have, alone and under the flat sheets; turns and trace are found for it. By
        default the turns of a usual trace that fit.
    layers : int, optional
        Copper layers of the board; by default as many as are needed.
    fab : str, optional
        Profile of the board house whose limits are kept, see `coilarray.design.fab_limits.load_profile`; by default one
        that has enough layers.
    pitch : float, optional
        Distance of neighbouring coils in m; by default they lie side by side with room for their terminals.
    overlap : {"none", "decoupled"}
        ``"decoupled"``: neighbours overlap, on layers of their own, by as much as makes their mean coupling zero.
    elastomer : bool
        Lay an elastomer with a magnetic sheet on the board, and an indenter that presses into it.
    frequency : float, optional
        Frequency in Hz of a coil with its tank; by default as `coilarray.studies.create.tank.tank_capacitance` chooses.
    connector : {"right", "top", "left", "bottom"}, optional
        Edge of the board to which the leads of all coils are led; coils may then lie a little further apart.
    title : str
        Title in reports; by default it says what the design is.

    Returns
    -------
    DesignFile
        Design and document; `coilarray.design.save.save_design` makes a commented file of it.

    Raises
    ------
    DesignError
        A choice that is not allowed, or choices that do not go together: an inductance out of reach, more layers than
        the board house has, no room for the terminals.

    Examples
    --------
    >>> pad = new_design("pad", "2", shape="square", size=12e-3, inductance=5e-6, elastomer=False).design
    >>> from coilarray.circuit.coupling import design_inductance
    >>> (design_inductance(pad)[0].diagonal() * 1e6).round(2).tolist()
    [5.0, 5.0]
    """
    check_choices(
        shape=shape, size=size, inductance=inductance, pitch=pitch, overlap=overlap, frequency=frequency,
        connector=connector
    )  # fmt: skip
    DESIGNS.check(_Named, {"name": name}, f"{name}")
    plan, wishes = _planned(
        name, coils, shape=shape, size=size, inductance=inductance, layers=layers, fab=fab, pitch=pitch,
        overlap=overlap, elastomer=elastomer, frequency=frequency, title=title
    )  # fmt: skip
    found = lay_out(plan, wishes)
    one = found.one  # without the way to a connector
    if connector is not None:  # refused before the tank is computed
        found = with_connector(found, connector, movable=found.sets == 1 and pitch is None and found.pitch > 0)
    tank = one if frequency is None else replace(found, connector=None)  # a frequency is met with the switches
    capacitance = tank_capacitance(lambda value: replace(tank, capacitance=value).design, frequency)
    return build_design_file(plain(replace(found, capacitance=capacitance).document), name)


@dataclass(frozen=True)
class Reach:
    """What a board of fewer layers can do: the number of its layers, and the inductance in H."""

    layers: int
    inductance: float


def reach_of_fewer_layers(layers: int, coils: str, **choices: Any) -> Reach | None:
    """Say what fewer than so many layers reach of a wanted inductance, rounded down to three digits.

    The `choices` are those of `new_design` that decide a coil and where it lies, an inductance among them. None where
    no board with fewer layers has a place for the terminals.

    Examples
    --------
    >>> reach_of_fewer_layers(4, "1", shape="square", size=10e-3, inductance=12e-6, elastomer=False).layers
    2
    """
    plan, wishes = _planned("fewer", coils, **choices)
    found = most_on_fewer_layers(plan, wishes, layers)
    if found is None:
        return None
    reached = float(design_inductance(found.one.design)[0][0, 0])
    step = 10.0 ** (math.floor(math.log10(reached)) - _DIGITS + 1)
    return Reach(found.layers, math.floor(reached / step) * step)


def _planned(
    name: str,
    coils: str | int,
    *,
    shape: Shape = "hexagon",
    size: float | tuple[float, float] = 16e-3,
    inductance: float | None = None,
    layers: int | None = None,
    fab: str | None = None,
    pitch: float | None = None,
    overlap: Overlap = "none",
    elastomer: bool = True,
    frequency: float | None = None,
    title: str = "",
) -> tuple[Plan, Wishes]:
    """Return what is decided before the layout, and what it is to have; see `new_design`."""
    arrangement = read_arrangement(coils, shape)
    sides = size if isinstance(size, tuple) else (size, size)
    if arrangement.lattice == "single" and (pitch is not None or overlap != "none"):
        raise DesignError("one coil has no neighbours: pitch and overlap are for several.")
    plan = Plan(name, title, arrangement, shape, sides, elastomer)
    return plan, Wishes(inductance, layers, fab, pitch, overlap == "decoupled", frequency)


def check_choices(
    *,
    shape: Shape = "hexagon",
    size: float | tuple[float, float] = 16e-3,
    inductance: float | None = None,
    pitch: float | None = None,
    overlap: Overlap = "none",
    frequency: float | None = None,
    connector: str | None = None,
) -> None:
    """Refuse choices of `new_design` that can be seen to be impossible before any work: DesignError."""
    if shape not in SHAPES:
        raise DesignError(f"shape must be one of {', '.join(SHAPES)}; got {shape!r}.")
    if isinstance(size, tuple) and shape not in ("rectangle", "racetrack"):
        raise DesignError(
            f"size must be one number for a {shape}; got {' × '.join(f'{side * 1e3:g}' for side in size)} mm."
        )
    if overlap not in get_args(Overlap):
        raise DesignError(f"overlap must be none or decoupled; got {overlap!r}.")
    if connector is not None and connector not in SIDES:
        raise DesignError(f"connector must be one of {', '.join(SIDES)}; got {connector!r}.")
    if pitch is not None and overlap != "none":
        raise DesignError("pitch and overlap cannot both be given: the overlap is that of the pitch.")
    sizes = size if isinstance(size, tuple) else (size,)
    given = [
        *(("size", side) for side in sizes),
        ("pitch", pitch),
        ("inductance", inductance),
        ("frequency", frequency),
    ]
    for what, number in given:
        least, most, scale, unit = _FROM_TO[what]
        if number is not None and not (math.isfinite(number) and number > 0):
            raise DesignError(f"{what} must be positive and finite; got {number * scale:g} {unit}.")
        if number is not None and not least <= number <= most:
            raise DesignError(
                f"{what} must be {least * scale:g} to {most * scale:g} {unit}; got {number * scale:g} {unit}."
            )
