"""A new design from a few choices: how many coils, of which shape and size, with which inductance, made by whom."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import combinations, product
from typing import Literal, get_args

import shapely

from coilarray.circuit.coupling import design_inductance
from coilarray.design.fab_limits import load_profile
from coilarray.design.model import DesignFile, build_design_file
from coilarray.design.vary import plain
from coilarray.electromagnetics.inductance import inductance_matrix
from coilarray.errors import DesignError
from coilarray.studies.create.arrangement import read_arrangement
from coilarray.studies.create.decoupling import decoupled_pitch
from coilarray.studies.create.plan import SHAPES, Plan, Shape
from coilarray.studies.create.tank import tank_capacitance
from coilarray.studies.create.terminals import with_terminals
from coilarray.studies.create.winding import Room, Winding, wind

Overlap = Literal["none", "decoupled"]

_TRACE = 0.15e-3  # of traces and gaps, in m: coarser than most houses need
_GAP_STEP, _GAP_MARGIN = 5e-6, 1e-6  # gaps are rounded up, and turns of polygons come a little nearer than drawn
_WIDE_HOLE = 0.4  # of half the coil's width: the hole of a winding for which no inductance is asked
_HOLES = (0.45, 0.6, 0.3)  # the same of coils that overlap, in which their neighbours' terminals may lie
_PASSES = 2
_MOST_SETS = 4  # of layers that neighbours take in turn
_BESIDE = 1e-3  # m between the terminals of a coil and its neighbour
_FABS = ("oshpark-4-layer", "multi-cb-35um")  # taken where none is named: the first that has enough layers


def new_design(
    name: str,
    coils: str = "3",
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
) -> DesignFile:
    """Make a design that a board house can make and a converter can read, from a few choices.

    Parameters
    ----------
    name : str
        Name of the design.
    coils : str
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
        Frequency in Hz of a coil with its tank; by default as `coilarray.studies.tank.tank_capacitance` chooses.
    title : str
        Title in reports; by default it says what the design is.

    Returns
    -------
    DesignFile
        Design and document; `coilarray.design.comments.commented_text` makes a file of it.

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
    _check_choices(shape, size, inductance, pitch, overlap, frequency)
    arrangement = read_arrangement(coils, shape)
    sides = size if isinstance(size, tuple) else (size, size)
    if arrangement.lattice == "single" and (pitch is not None or overlap != "none"):
        raise DesignError("one coil has no neighbours: pitch and overlap are for several.")
    plan = Plan(name, title, arrangement, shape, sides, elastomer)
    found = _laid_out(plan, inductance, layers, fab, pitch, overlap)
    one = found.one
    capacitance = tank_capacitance(lambda value: replace(one, capacitance=value).design, frequency)
    return build_design_file(plain(replace(found, capacitance=capacitance).document), name)


def _check_choices(
    shape: Shape,
    size: float | tuple[float, float],
    inductance: float | None,
    pitch: float | None,
    overlap: Overlap,
    frequency: float | None,
) -> None:
    if shape not in SHAPES:
        raise DesignError(f"shape must be one of {', '.join(SHAPES)}; got {shape!r}.")
    if isinstance(size, tuple) and shape not in ("rectangle", "racetrack"):
        raise DesignError(
            f"size must be one number for a {shape}; got {' × '.join(f'{side * 1e3:g}' for side in size)} mm."
        )
    if overlap not in get_args(Overlap):
        raise DesignError(f"overlap must be none or decoupled; got {overlap!r}.")
    if pitch is not None and overlap != "none":
        raise DesignError("pitch and overlap cannot both be given: the overlap is that of the pitch.")
    sizes = size if isinstance(size, tuple) else (size,)
    lengths = {"size": min(sizes), "pitch": pitch}
    given = [(what, value, 1e3, "mm") for what, value in lengths.items()]
    given += [("inductance", inductance, 1e6, "µH"), ("frequency", frequency, 1e-6, "MHz")]
    for what, number, scale, unit in given:
        if number is not None and not (math.isfinite(number) and number > 0):
            raise DesignError(f"{what} must be positive and finite; got {number * scale:g} {unit}.")


def _laid_out(
    plan: Plan, inductance: float | None, layers: int | None, fab: str | None, pitch: float | None, overlap: Overlap
) -> Plan:
    """Find layers, winding, pitch and terminals.

    Coils side by side need one set of layers. Coils that overlap need more, and a wide hole for the terminals of their
    neighbours; turned hexagons face neighbours with corners, so that those on the same layers lie further apart.
    """
    hexagonal = plan.arrangement.lattice in ("hexagonal", "rings")
    beside = plan.arrangement.lattice == "single" or (overlap == "none" and (pitch is None or pitch >= plan.width))
    some_sets = (1,) if beside else range(3 if hexagonal else 2, _MOST_SETS + 1)
    turns = (False, True) if hexagonal and plan.shape == "hexagon" and not beside else (False,)
    problem = None
    for sets, hole in product(some_sets, (plan.hole,) if beside else _HOLES):
        try:
            wound = _wound(replace(plan, sets=sets, hole=hole), inductance, layers, fab)
        except DesignError as error:
            problem = problem or error
            continue
        for turned in turns:
            try:
                placed = _placed(replace(wound, turned=turned), overlap, pitch)
                return with_terminals(placed, movable=beside and pitch is None)
            except DesignError as error:
                problem = problem or error
    assert problem is not None  # at least one layout was tried
    raise problem


def _placed(plan: Plan, overlap: Overlap, pitch: float | None) -> Plan:
    """Find the pitch; DesignError where coils on the same layers overlap then."""
    if overlap == "decoupled":
        few = replace(plan, arrangement=plan.arrangement.fewest)
        placed = replace(plan, pitch=decoupled_pitch(plan.width, lambda at: replace(few, pitch=at).design))
    else:
        placed = replace(plan, pitch=plan.width + plan.lead + _BESIDE if pitch is None else pitch)
    if not _are_apart(placed):
        raise DesignError(
            f"coils of {plan.width * 1e3:g} mm at a pitch of {placed.pitch * 1e3:g} mm overlap so far that {plan.sets} "
            "sets of layers do not part them."
        )
    return placed


def _wound(plan: Plan, inductance: float | None, layers: int | None, fab: str | None) -> Plan:
    """Find the winding of each coil on a board with so many sets of layers."""
    if layers is not None and (layers < 1 or (layers % (2 * plan.sets) and (layers, plan.sets) != (1, 1))):
        allowed = "1 or a multiple of 2" if plan.sets == 1 else f"a multiple of {2 * plan.sets}"
        sets = "" if plan.sets == 1 else f" for neighbours on {plan.sets} different sets of them"
        raise DesignError(f"layers must be {allowed}{sets}; got {layers}.")
    problem = None
    for winding_layers in (2, 4) if layers is None else (layers // plan.sets,):
        board = replace(plan, winding_layers=winding_layers)
        try:
            board = replace(board, fab=_fab(board.layers, fab))
        except DesignError as error:
            problem = problem or error  # more layers than there are do not tell what is out of reach
            break
        try:
            return replace(board, winding=_winding(board, inductance))
        except DesignError as error:
            problem = error
    assert problem is not None  # at least one number of layers was tried
    raise problem


def _fab(layers: int, wanted: str | None) -> str:
    """Return the board house that makes so many layers: the wanted one, or the first of the usual ones."""
    for name in _FABS if wanted is None else (wanted,):
        most = load_profile(name).rules.max_layers
        if most is None or layers <= most:
            return name
    raise DesignError(f"{layers} copper layers are needed; {wanted} makes at most {most}.")


def _winding(plan: Plan, inductance: float | None) -> Winding:
    """Find turns and trace: of the usual width where that will do, else of the board house's narrowest."""
    radius, rules = min(plan.size) / 2, plan.rules
    closest = math.ceil((rules.min_gap + _GAP_MARGIN) / _GAP_STEP) * _GAP_STEP
    hole = max(plan.hole * radius, plan.via_pad * (1.5 if plan.winding_layers < 3 else 2.5) + 2 * closest)
    usual = Room(radius, hole, max(_TRACE, rules.min_trace), max(_TRACE, closest))
    if inductance is None:
        usual = replace(usual, hole=max(_WIDE_HOLE * radius, hole))
        if usual.most_turns:
            return Winding(usual.most_turns, usual.trace_width, usual.gap)
        inductance = 0.0  # refused with the reason
    try:
        return _wind(plan, inductance, usual)
    except DesignError:
        return _wind(plan, inductance, replace(usual, trace_width=rules.min_trace, gap=closest))


def _wind(plan: Plan, inductance: float, room: Room) -> Winding:
    """Find the winding without sheets, at the accuracy of a screening, and again by what both leave out."""
    bare, one = replace(plan.one, elastomer=False), plan.one
    share, found = 1.0, plan.winding

    def screened(winding: Winding) -> float:
        return share * float(inductance_matrix(replace(bare, winding=winding).design.array, accuracy="screen")[0, 0])

    for _ in range(_PASSES):
        found = wind(inductance, room, screened)
        full = float(design_inductance(replace(one, winding=found).design)[0][0, 0])
        share *= full / screened(found)
    return found


def _are_apart(plan: Plan) -> bool:
    """Whether no two coils on the same layers overlap."""
    if plan.arrangement.lattice == "single":
        return True
    placements = replace(plan, arrangement=plan.arrangement.few, elastomer=False).design.array.placements
    shapes = [shapely.Polygon(place.to_board(place.coil.outline)) for place in placements]
    return not any(
        one.layers == other.layers and shapes[i].distance(shapes[j]) < plan.rules.min_gap
        for (i, one), (j, other) in combinations(enumerate(placements), 2)
    )
