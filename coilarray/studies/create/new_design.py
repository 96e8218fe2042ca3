"""A new design from a few choices: how many coils, of which shape and size, with which inductance, made by whom."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from coilarray.circuit.coupling import design_inductance
from coilarray.design.bundled import DESIGNS
from coilarray.design.model import DesignFile, build_design_file
from coilarray.design.switch_parts import PartName
from coilarray.design.units import Name, Table
from coilarray.design.vary import plain
from coilarray.geometry.values import Side
from coilarray.studies.create.choices import Choices, Overlap, Shape
from coilarray.studies.create.connector import with_connector
from coilarray.studies.create.layout import lay_out, most_on_fewer_layers
from coilarray.studies.create.plan import Plan
from coilarray.studies.create.tank import tank_capacitance

_DIGITS = 3  # of an inductance that is reached


class _Named(Table):
    """What a design file takes for a name, refused before any work."""

    name: Name


def new_design(
    name: str,
    coils: str | int = Choices.coils,
    *,
    shape: Shape = Choices.shape,
    size: float | tuple[float, float] | None = Choices.size,
    inductance: float | None = Choices.inductance,
    layers: int | None = Choices.layers,
    fab: str | None = Choices.fab,
    pitch: float | None = Choices.pitch,
    overlap: Overlap = Choices.overlap,
    elastomer: bool = Choices.elastomer,
    frequency: float | None = Choices.frequency,
    capacitance: float | None = Choices.capacitance,
    connector: Side | None = Choices.connector,
    switches: PartName | None = Choices.switches,
    title: str = Choices.title,
) -> DesignFile:
    """Make a design that a board house can make and a converter can read, from a few choices.

    Parameters
    ----------
    name : str
        Name of the design.
    coils : str or int
        ``"1"``, ``"6"`` (a row), ``"4x4"`` (columns by rows), ``"3-hex"`` (a triangle), or ``"7-hex"``, ``"19-hex"`` or
        ``"37-hex"``: rings about a centre.
    shape : {"hexagon", "square", "circle", "rectangle", "racetrack"}
        Shape of the coils.
    size : float or tuple of float, optional
        Width in m of a coil's copper, of a hexagon across flats, of a circle the diameter at which its outer edge
        starts; 16 mm by default. A rectangle or racetrack has width and height; 20 and 12 mm by default.
    inductance : float, optional
        Inductance in H that a coil is to have, alone and under the flat sheets; turns and trace are found for it. By
        default the turns of a usual trace that fit.
    layers : int, optional
        Copper layers of the board; by default as many as are needed, or those of the service that `fab` names.
    fab : str, optional
        Profile of the board house whose limits are kept, see `coilarray.design.fab_limits.load_profile`; by default one
        that makes boards of so many layers.
    pitch : float, optional
        Distance of neighbouring coils in m; by default they lie side by side with room for their terminals.
    overlap : {"none", "decoupled"}
        ``"decoupled"``: neighbours overlap, on layers of their own, by as much as makes their mean coupling zero.
    elastomer : bool
        Lay an elastomer with a magnetic sheet on the board, and an indenter that presses into it.
    frequency : float, optional
        Frequency in Hz of a coil with its tank; by default as `coilarray.studies.create.tank.tank_capacitance` chooses.
    capacitance : float, optional
        Capacitance in F of the tank, instead.
    connector : {"right", "top", "left", "bottom"}, optional
        Edge of the board to which the leads of all coils are routed; coils may then lie a little further apart.
    switches : {"ADG714", "ADG738", "ADG739"}, optional
        Part that connects one coil after another to the converter and grounds the others; by default ideal switches.
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
    >>> (design_inductance(pad)[0].diagonal() * 1e6).round(1).tolist()
    [5.0, 5.0]
    """
    choices = Choices(
        coils=coils, shape=shape, size=size, inductance=inductance, layers=layers, fab=fab, pitch=pitch,
        overlap=overlap, elastomer=elastomer, frequency=frequency, capacitance=capacitance, connector=connector,
        switches=switches, title=title
    )  # fmt: skip
    DESIGNS.check(_Named, {"name": name}, f"{name}")
    found = lay_out(_planned(name, choices), choices)
    one = found.one  # without the way to a connector
    if connector is not None:  # refused before the tank is computed
        found = with_connector(found, connector, movable=found.sets == 1 and pitch is None and found.pitch > 0)
    if capacitance is None:
        tank = one if frequency is None else replace(found, connector=None)  # a frequency is met with the switches
        capacitance = tank_capacitance(lambda value: replace(tank, capacitance=value).design, frequency)
    return build_design_file(plain(replace(found, capacitance=capacitance).document), name)


@dataclass(frozen=True)
class Reach:
    """What a board of fewer layers can do: the number of its layers, and the inductance in H."""

    layers: int
    inductance: float


def reach_of_fewer_layers(layers: int, choices: Choices) -> Reach | None:
    """Say what fewer than so many layers reach of a chosen inductance, rounded down to three digits.

    None where no board with fewer layers has a place for the terminals.

    Examples
    --------
    >>> reach_of_fewer_layers(4, Choices("1", "square", 10e-3, inductance=12e-6, elastomer=False)).layers
    2
    """
    found = most_on_fewer_layers(_planned("fewer", choices), choices, layers)
    if found is None:
        return None
    reached = float(design_inductance(found.one.design)[0][0, 0])
    step = 10.0 ** (math.floor(math.log10(reached)) - _DIGITS + 1)
    return Reach(found.layers, math.floor(reached / step) * step)


def _planned(name: str, choices: Choices) -> Plan:
    """Return what is decided before the layout."""
    plan = Plan(name, choices.title, choices.arrangement, choices.shape, choices.sides, choices.elastomer)
    return replace(plan, switches=choices.switches)
