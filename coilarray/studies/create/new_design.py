"""New design from a few choices."""

from __future__ import annotations

from dataclasses import replace

from coilarray.design.bundled import DESIGNS
from coilarray.design.keys import Name, Table
from coilarray.design.model import DesignFile, build_design_file
from coilarray.design.switch_parts import PartName
from coilarray.design.vary import plain
from coilarray.geometry.arcs import Side
from coilarray.studies.create.choices import Choices, Overlap, Shape
from coilarray.studies.create.layout import lay_out, with_connector
from coilarray.studies.create.plan import Plan
from coilarray.studies.create.tank import tank_capacitance


class _Named(Table):
    """Check of a design's name, as in a design file."""

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
    """Make a new design from a few choices.

    A board house can make it and a converter can read it.

    Parameters
    ----------
    name : str
        Name of the design.
    coils : str or int
        ``"1"``, ``"6"`` (a row), ``"4x4"`` (columns by rows), ``"3-hex"`` (a triangle), or
        ``"7-hex"``, ``"19-hex"`` or ``"37-hex"`` (rings about a centre).
    shape : {"hexagon", "square", "circle", "rectangle", "racetrack"}
        Shape of the coils.
    size : float or tuple of float, optional
        Width in m of a coil's copper, 16 mm by default. For a hexagon it is measured across flats,
        for a circle it is the diameter at which its outer edge starts. A rectangle or racetrack has
        width and height, 20 and 12 mm by default.
    inductance : float, optional
        Wanted inductance in H of a coil, alone and under the flat sheets. Turns and trace are found
        for it. By default the winding has as many turns of a usual trace as fit.
    layers : int, optional
        Copper layers of the board. By default as many as are needed, or the layers of the service
        that `fab` names.
    fab : str, optional
        Profile of the board house whose limits are kept, see
        `coilarray.design.fab_limits.load_profile`. By default a house that makes boards with this
        number of layers.
    pitch : float, optional
        Distance of neighbouring coils in m. By default they lie side by side with room for their
        terminals.
    overlap : {"none", "decoupled"}
        ``"decoupled"``: neighbours overlap, on separate layers, so far that their mean coupling is
        zero.
    elastomer : bool
        Lay an elastomer with a magnetic sheet on the board, and an indenter that presses into it.
    frequency : float, optional
        Frequency in Hz of a coil with its tank. By default it is chosen by
        `coilarray.studies.create.tank.tank_capacitance`.
    capacitance : float, optional
        Capacitance in F of the tank, instead of the frequency.
    connector : {"right", "top", "left", "bottom"}, optional
        Edge of the board to which the leads of all coils are routed. Coils may then lie slightly
        further apart.
    switches : {"ADG714", "ADG738", "ADG739"}, optional
        Part that connects one coil after another to the converter and grounds the others. By
        default the switches are ideal.
    title : str
        Title in reports. By default it describes the design.

    Returns
    -------
    DesignFile
        Design and document. `coilarray.design.write.save_design` writes it to a commented file.

    Raises
    ------
    DesignError
        If a choice is not allowed, or choices are contradictory: an inductance out of reach, more
        layers than the board house has, or no room for the terminals.

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
    plan = Plan(name, title, choices.arrangement, shape, choices.sides, elastomer, switches=switches)
    found = lay_out(plan, choices)
    one = found.one  # without the way to a connector
    if connector is not None:  # refused before the tank is computed
        found = with_connector(found, connector, movable=found.sets == 1 and pitch is None and found.pitch > 0)
    if capacitance is None:
        tank = one if frequency is None else replace(found, connector=None)  # a frequency is met with the switches
        capacitance = tank_capacitance(lambda value: replace(tank, capacitance=value).design, frequency)
    return build_design_file(plain(replace(found, capacitance=capacitance).document), name)
