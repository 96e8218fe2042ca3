"""New design from a few choices, with the capacitance of its tank."""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace

import xarray as xr

from coilarray.circuit.converter_limits import Limit, channels_of, check_channel
from coilarray.circuit.coupling import design_inductance, scan_design
from coilarray.circuit.matching import standard_value
from coilarray.design.bundled import DESIGNS
from coilarray.design.keys import Name, Table
from coilarray.design.model import Design, DesignFile, build_design_file
from coilarray.design.scan_states import PartName
from coilarray.design.vary import plain
from coilarray.errors import DesignError, NetworkError
from coilarray.geometry.arcs import Side
from coilarray.studies.create.layout import SMALLEST_CAPACITANCE, lay_out, with_connector
from coilarray.studies.create.plan import Choices, Overlap, Plan, Shape

_DECADES = 5
_SERIES = (1.0, 1.5, 2.2, 3.3, 4.7, 6.8)  # E6
_SHARE_OF_SELF_RESONANCE = 0.5  # well below the converter's limit of 0.8
_STEPS, _MET, _DIGITS = 10, 1e-4, 3
_CLOSE = 0.01  # of the wanted frequency: required accuracy of a standard capacitance


def tank_capacitance(with_capacitance: Callable[[float], Design], frequency: float | None = None) -> float:
    """Choose the capacitance of the tank in F.

    For a `frequency` in Hz, on the mean of the coils, it is the nearest of the series E24 within 1
    %, otherwise exact with three digits. By default it is the smallest of E6 from 100 pF that keeps
    the converter's limits, or breaks the fewest, at no more than half the coil's self-resonance.
    Frequency and quality factor are then as high as possible.
    """
    if frequency is not None:
        return _for_frequency(with_capacitance, frequency)
    fewest, best = math.inf, SMALLEST_CAPACITANCE
    series = (
        float(f"{value * SMALLEST_CAPACITANCE * 10**decade:.2g}") for decade in range(_DECADES) for value in _SERIES
    )
    for capacitance in series:
        try:
            scan = scan_design(with_capacitance(capacitance), elastomer=False, accuracy="screen")
        except NetworkError:  # too much for the losses of the coil: nothing resonates with more either
            break
        broken = len(broken_limits(scan, _SHARE_OF_SELF_RESONANCE))
        if broken < fewest:
            fewest, best = broken, capacitance
        if not broken:
            break
    return best


def broken_limits(scan: xr.Dataset, share_of_self_resonance: float = 1.0) -> list[tuple[str, Limit]]:
    """List the LDC1614's broken limits with the states, none without a converter."""
    broken: list[tuple[str, Limit]] = []
    for state, *values in channels_of(scan):
        share = Limit("frequency over self-resonance", values[0] / values[-1], 0, share_of_self_resonance)
        limits = (share, *check_channel(*values))
        broken += [(state, limit) for limit in limits if not limit.kept]
    return broken


def is_standard(capacitance: float) -> bool:
    """Whether a capacitance in F belongs to the series E24."""
    return math.isclose(capacitance, standard_value(capacitance), rel_tol=1e-6)


def _for_frequency(with_capacitance: Callable[[float], Design], frequency: float) -> float:
    def reached(capacitance: float) -> float:
        scan = scan_design(with_capacitance(capacitance), elastomer=False, accuracy="screen")
        return float(scan.frequency.mean())

    inductance = float(
        design_inductance(with_capacitance(SMALLEST_CAPACITANCE), accuracy="screen")[0].diagonal().mean()
    )
    wanted = capacitance = 1 / ((2 * math.pi * frequency) ** 2 * inductance)
    slope, before, short_before = 1.0, 0.0, 0.0
    for _ in range(_STEPS):  # a secant: winding and switches add capacitance, and losses lower the frequency
        try:
            short = wanted - 1 / ((2 * math.pi * reached(capacitance)) ** 2 * inductance)
        except NetworkError:
            break
        if abs(short) <= _MET * wanted:
            standard = standard_value(capacitance)
            with suppress(NetworkError):  # it may be too much for the losses, unlike the exact value
                if abs(reached(standard) / frequency - 1) <= _CLOSE:
                    return standard
            return float(f"{capacitance:.{_DIGITS}g}")
        if before:
            slope = (short_before - short) / (capacitance - before)
        before, short_before = capacitance, short
        capacitance += short / slope
        if capacitance <= 0:
            break
    raise DesignError(
        f"a coil of {inductance * 1e6:.4g} µH cannot oscillate at {frequency * 1e-6:g} MHz: the capacitance of its "
        "winding is too large for that, or its losses are."
    )


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
    """Make a new design, which a board house can make and a converter can read, from a few choices.

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
        Width in m of a coil's copper, 16 mm by default: of a hexagon across flats, of a circle the
        diameter at which its outer edge starts. Rectangles and racetracks have width and height.
    inductance : float, optional
        Wanted inductance in H of a coil, alone and under the flat sheets. By default the winding
        has as many turns of a usual trace as fit.
    layers : int, optional
        Copper layers of the board. By default as many as are needed, or the layers of the service
        that `fab` names.
    fab : str, optional
        Profile of the board house whose limits are kept, by default one that makes boards with this
        number of layers.
    pitch : float, optional
        Distance of neighbouring coils in m. By default they lie side by side with room for their
        terminals.
    overlap : {"none", "decoupled"}
        ``"decoupled"``: neighbours overlap on separate layers, so that their mean coupling is zero.
    elastomer : bool
        Lay an elastomer with a magnetic sheet on the board, and an indenter that presses into it.
    frequency : float, optional
        Frequency in Hz of a coil with its tank, by default chosen by `tank_capacitance`.
    capacitance : float, optional
        Capacitance in F of the tank, instead of the frequency.
    connector : {"right", "top", "left", "bottom"}, optional
        Edge of the board to which all leads are routed. Coils may then lie slightly further apart.
    switches : {"ADG714", "ADG738", "ADG739"}, optional
        Part that connects one coil after another and grounds the others, by default ideal.
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
