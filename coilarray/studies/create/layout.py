"""Winding, pitch, terminals and connector with the fewest layers."""

import functools
import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import combinations, islice, pairwise, product

import numpy as np
import numpy.typing as npt
import shapely
from scipy.optimize import brentq

from coilarray.circuit.converter_limits import SENSOR_FREQUENCY
from coilarray.circuit.coupling import design_inductance
from coilarray.compute.arrays import FloatArray, IntArray
from coilarray.design.board_tables import ConnectorTable
from coilarray.design.fabs import load_profile
from coilarray.design.model import Design
from coilarray.electromagnetics.inductance import coupling_matrix, inductance_matrix, pair_inductance
from coilarray.electromagnetics.resistance import resistance_matrix
from coilarray.errors import DesignError, GeometryError, RuleViolationError
from coilarray.geometry import Array, Connector, Placement, check_rules, require_rules, route_leads
from coilarray.geometry.arcs import Side
from coilarray.geometry.connector import NoWayError
from coilarray.studies.create.plan import Choices, Plan, Room, Winding, wind

SMALLEST_CAPACITANCE = 100e-12  # smallest capacitance of a tank in F, below which strays would weigh too much
# fractions of the width of a coil between which the sign of its neighbours' coupling is searched
_SAMPLES = (1.0, 0.8, 0.65, 0.5, 0.4)
_FINE_PITCH = 1e-5  # m, to which the pitch of no coupling is given
_ROUGHLY = 2e-3  # of the width: accuracy of the search in the rough model, which the corrections improve
_SLOPE, _CORRECTIONS = 0.01, 2
_FABS = ("oshpark-2-layer", "oshpark-4-layer", "multi-cb-35um")  # the last one makes any number of layers
_TRACE = 0.15e-3  # of traces and gaps, in m: coarser than most houses need
_GAP_STEP, _GAP_MARGIN = 10e-6, 1.05  # gaps are rounded up; turns of polygons come nearer than drawn by some percent
_CORNERED = 0.75  # of half the hole: wider traces of polygons, whose turns slope, would touch at the inner corners
_WIDEST = 5e-3  # m, of traces: a good part of the skin depths at 10 MHz for which the AC resistance holds
_USUAL_HOLE = 0.4  # of half the coil's width: the hole of a winding without a wanted inductance
_HOLES = (0.45, 0.6, 0.75, 0.3)  # the same for coils that overlap, in which their neighbours' terminals may lie
_WINDING_LAYERS = (2, 4)
_BESIDE = 1e-3  # m between the terminals of a coil and its neighbour
_KEPT = 512  # results of single coils
_PASSES, _CLOSE = 3, 1e-3  # corrections of the search for a winding, and the change at which they end
_MOVES, _MOVE = 13, 0.5e-3  # steps, and their length in m, by which coils are moved apart for their terminals
_LONGEST_LEAD, _LEAD_STEP = 1.0, 0.25e-3  # widths of a coil, and m
_SHORT = 1e-9  # m: no lead is a point
_MOST_TRIALS = 3  # of lengths at one start, as rules may break that the quick look does not see
_DISTANCES = (5.0, 6.0, 8.0, 10.0)  # mm from the coils; for several rows from the second on, with room for ways between
_PITCH_STEP = 0.5e-3  # m, to which a roomier pitch is given
_LONGER, _FURTHER = 0.5e-3, 1e-3  # m by which leads get longer and coils lie further apart at each distance


def decoupled_pitch(width: float, design_at: Callable[[float], Design], rough_at: Callable[[float], Design]) -> float:
    """Find the pitch of zero neighbour coupling in m.

    The coupling is the mean of all neighbours, which differ slightly on different pairs of layers.
    The fields inside and around a coil have opposite signs, so neighbours that overlap more couple
    positively. Of several pitches it is the largest, searched with the quicker `rough_at` first.
    """

    @functools.cache
    def rough(pitch: float) -> float:
        array = rough_at(pitch).array
        return float(pair_inductance(array, *_neighbours(array), accuracy="screen").mean())

    for outer, inner in pairwise(part * width for part in _SAMPLES):
        if rough(inner) >= 0:  # side by side they couple negatively
            if rough(outer) > 0:
                continue
            found = float(brentq(rough, inner, outer, xtol=_ROUGHLY * width))
            slope = (rough(found + _SLOPE * width) - rough(found)) / (_SLOPE * width)
            for _ in range(_CORRECTIONS):  # for effects that the rough model leaves out
                design = design_at(found)
                L = design_inductance(design, accuracy="screen")[0]
                found -= float(neighbour_coupling(design).mean() * L.diagonal().mean()) / slope
            if inner - _SLOPE * width <= found <= outer + _SLOPE * width:
                return round(found / _FINE_PITCH) * _FINE_PITCH
    raise DesignError(
        f"neighbours of {width * 1e3:g} mm couple at every pitch from {_SAMPLES[-1] * width * 1e3:.4g} to "
        f"{_SAMPLES[0] * width * 1e3:.4g} mm: their overlap cannot decouple them."
    )


def neighbour_coupling(design: Design) -> FloatArray:
    """Coupling coefficients of all nearest coils, under the flat sheets."""
    k: FloatArray = coupling_matrix(design_inductance(design, accuracy="screen")[0])[_neighbours(design.array)]
    return k


def _neighbours(array: Array) -> tuple[IntArray, IntArray]:
    i, j = np.array(array.neighbours, dtype=np.intp).reshape(-1, 2).T
    return i, j


def lay_out(plan: Plan, choices: Choices) -> Plan:
    """Find layers, winding, pitch and terminals, or raise DesignError."""
    problem = None
    tried = set[Plan]()
    for board in _boards(plan, choices):
        try:
            wound = replace(board, winding=_winding(board, choices), hole=0.0)  # its own hole counts now
            if wound not in tried:  # another hole may have the same winding
                tried.add(wound)
                return _completed(wound, choices)
        except DesignError as error:
            problem = error  # of the most layers, for a choice that no board can reach
    assert problem is not None  # there is at least one board, or a reason why not
    raise problem


def _completed(wound: Plan, choices: Choices) -> Plan:
    problem = _problem(wound)
    if problem is not None:  # more layers than have room for the via pads
        fewer = (replace(wound, winding_layers=n) for n in range(wound.winding_layers - 2, 0, -2))
        most = next((plan.layers for plan in fewer if _problem(plan) is None), None)
        if most is None:
            raise problem
        reason = str(problem).removeprefix(f"{wound.name}: ").removeprefix(f"coils.{wound.shape}: ")
        size = " × ".join(f"{side * 1e3:g}" for side in dict.fromkeys(wound.size))
        raise DesignError(f"layers must be at most {most} for a coil of {size} mm; got {wound.layers}: {reason}")
    # turned hexagons, which face neighbours with corners, may lie further apart on equal layers
    lattice = wound.arrangement.lattice
    can_turn = wound.shape == "hexagon" and wound.sets > 1 and lattice in ("hexagonal", "triangle", "rings")
    for turned in (False, True) if can_turn else (False,):
        try:
            placed = _placed(replace(wound, turned=turned), choices)
            return with_terminals(placed, movable=wound.sets == 1 and choices.pitch is None)
        except DesignError as error:
            problem = error
    assert problem is not None  # at least one orientation was tried
    if choices.pitch is None:
        raise problem
    raise DesignError(
        f"pitch must leave room for coils and terminals, as {_side_by_side(wound) * 1e3:g} mm and more do; got "
        f"{choices.pitch * 1e3:g} mm: {problem}"
    )


def _problem(wound: Plan) -> DesignError | None:
    try:
        _ = wound.one.design
    except DesignError as error:
        return error
    return None


def _side_by_side(plan: Plan) -> float:
    """Return a pitch in m with room for terminals."""
    return plan.width + plan.lead + _BESIDE


def _boards(plan: Plan, choices: Choices) -> Iterator[Plan]:
    """Yield the boards to try, the fewest layers first."""
    # Coils that overlap need more than one set of layers, and a wide hole for the terminals of their neighbours.
    overlap = choices.overlap == "decoupled" or (choices.pitch is not None and choices.pitch < plan.width)
    some_sets: tuple[int, ...] = (1,)
    if overlap:
        some_sets = (2, 3, 4) if plan.arrangement.lattice in ("linear", "square") else (3, 4)
    made = choices.layers_of_fab
    if made is not None and choices.layers not in (None, made):
        raise DesignError(f"layers must be {made}, as {choices.fab} makes boards of {made}; got {choices.layers}.")
    layers = choices.layers if made is None else made
    if layers is None:
        each = _WINDING_LAYERS if choices.inductance is not None else _WINDING_LAYERS[:1]
        pairs = sorted(product(some_sets, each), key=lambda pair: pair[0] * pair[1])
    else:
        pairs = [
            (sets, layers // sets)
            for sets in some_sets
            if layers > 0 and (layers % (2 * sets) == 0 or layers == sets == 1)
        ]
    if not pairs:
        least = f"1 or a multiple of {2 * some_sets[0]}" if not overlap else f"a multiple of {2 * some_sets[0]}"
        apart = f" for neighbours on {some_sets[0]} different sets of them" if overlap else ""
        of = "" if made is None else f" of {choices.fab}"
        raise DesignError(f"layers must be {least}{apart}; got {layers}{of}.")
    for sets, winding_layers in pairs:
        for hole in _HOLES if overlap else (plan.hole,):
            count = sets * winding_layers
            fab = choices.fab or next(name for name in _FABS if load_profile(name).rules.max_layers in (None, count))
            yield replace(plan, sets=sets, winding_layers=winding_layers, fab=fab, hole=hole)


def _placed(plan: Plan, choices: Choices) -> Plan:
    """Find the pitch, without overlaps of coils on a layer."""
    if choices.overlap == "decoupled":
        fewest = replace(plan, arrangement=plan.arrangement.fewest)
        rough = replace(fewest, rough=True, elastomer=False)
        pitch = decoupled_pitch(
            plan.width, lambda at: replace(fewest, pitch=at).design, lambda at: replace(rough, pitch=at).design
        )
        placed = replace(plan, pitch=pitch)
    else:
        placed = replace(plan, pitch=_side_by_side(plan) if choices.pitch is None else choices.pitch)
    few = replace(placed, arrangement=plan.arrangement.few, elastomer=False).design.array.placements
    shapes = [shapely.Polygon(place.to_board(place.coil.outline)) for place in few]
    if any(
        one.layers == other.layers and shapes[i].distance(shapes[j]) < plan.rules.min_gap
        for (i, one), (j, other) in combinations(enumerate(few), 2)
    ):
        raise DesignError(
            f"coils of {plan.width * 1e3:g} mm at a pitch of {placed.pitch * 1e3:.4g} mm overlap so far that "
            f"{plan.layers} layers do not part them."
        )
    return placed


def _winding(plan: Plan, choices: Choices) -> Winding:
    """Find turns and trace, as usual or else the narrowest."""
    radius, rules = min(plan.size) / 2, plan.rules
    closest = math.ceil(rules.min_gap * _GAP_MARGIN / _GAP_STEP) * _GAP_STEP
    hole = max(plan.hole * radius, plan.via_pad * (1.5 if plan.winding_layers < 3 else 2.5) + 2 * closest)
    widest = min(_WIDEST, _CORNERED * hole) if plan.shape in ("hexagon", "square") else _WIDEST
    usual = Room(radius, hole, max(_TRACE, rules.min_trace), max(_TRACE, closest), widest)
    finest = replace(usual, trace_width=rules.min_trace, gap=closest)
    if not finest.most_turns:
        least = math.ceil(2e5 * (finest.hole + 2 * finest.trace_width + finest.gap) * (1 - 1e-9)) / 100  # mm
        raise DesignError(
            f"size must be at least {least:g} mm, for a turn of {finest.trace_width * 1e3:g} mm trace about the holes "
            f"that join {plan.winding_layers} layers; got {min(plan.size) * 1e3:g} mm."
        )
    if choices.inductance is None:
        usual = replace(usual, hole=max(_USUAL_HOLE * usual.radius, usual.hole))
        for room in (usual, finest):
            if room.most_turns:
                return room.fullest
    try:
        return _wind_apart(plan, choices, usual)
    except DesignError:
        return _wind_apart(plan, choices, finest)


def _wind_apart(plan: Plan, choices: Choices, room: Room) -> Winding:
    """Wind with wider gaps if corners of wide traces need."""
    first = found = _wind(plan, choices, room)
    for _ in range(_PASSES):
        array = replace(plan.one, winding=found, elastomer=False).design.array
        margins = [m for m in check_rules(array, plan.rules) if m.rule == "spacing within net"]
        if all(margin.kept for margin in margins):
            return found
        missing = -min(margin.margin for margin in margins)
        room = replace(room, gap=math.ceil((room.gap + _GAP_MARGIN * missing) / _GAP_STEP) * _GAP_STEP)
        found = _wind(plan, choices, room)
    return first  # the gaps of the turns are not the problem


def _wind(plan: Plan, choices: Choices, room: Room) -> Winding:
    """Find the winding with a rough model, and correct it."""
    # The rough model has no sheets and few segments, and is screened. The resistance is at the frequency of the tank
    # that `new_design` likely chooses.
    inductance = choices.inductance or 0.0  # refused with the reason
    usual = 1 / (2 * math.pi * math.sqrt((inductance or 1.0) * SMALLEST_CAPACITANCE))
    frequency = choices.frequency or min(usual, SENSOR_FREQUENCY[1])

    def resistance(winding: Winding) -> float:
        return _rough_resistance(_rough(plan, winding), frequency)

    share, turns = _left_out(_alone(plan, room.fullest)) if room.most_turns else 1.0, None
    for _ in range(_PASSES):

        def corrected(winding: Winding, share: float = share) -> float:
            return share * _rough_inductance(_rough(plan, winding))

        found = wind(inductance, room, corrected, resistance, turns)
        before, share, turns = share, _left_out(_alone(plan, found)), found.turns
        if abs(share / before - 1) < _CLOSE:
            break
    return found


def _alone(plan: Plan, winding: Winding) -> Plan:
    """Return one coil with a winding, equal for equal coils."""
    return replace(plan.one, winding=winding, hole=0.0, pitch=0.0)


def _rough(plan: Plan, winding: Winding) -> Plan:
    """Return a quick model of one coil with a winding."""
    return replace(_alone(plan, winding), elastomer=False, rough=True)


@functools.lru_cache(_KEPT)  # passes, and boards with other holes, ask for the same windings
def _left_out(alone: Plan) -> float:
    """Ratio of a coil's inductance to its quick model's."""
    inductance = float(design_inductance(alone.design, accuracy="screen")[0][0, 0])
    return inductance / _rough_inductance(_rough(alone, alone.winding))


@functools.lru_cache(_KEPT)
def _rough_inductance(rough: Plan) -> float:
    return float(inductance_matrix(rough.design.array, accuracy="screen", allow_overlaps=True)[0, 0])


@functools.lru_cache(_KEPT)
def _rough_resistance(rough: Plan, frequency: float) -> float:
    return float(resistance_matrix(rough.design.array, [frequency]).resistance[0, 0, 0])


def with_terminals(plan: Plan, *, movable: bool) -> Plan:
    """Find the start of the windings and their leads.

    Holes go through the whole board. Holes of coils that overlap must lie in the hole of a
    neighbour's winding or beside all of them. Coils side by side that are `movable` are moved
    apart.
    """

    def candidates() -> Iterator[Plan]:
        moves = _MOVES if movable and plan.sets == 1 and plan.arrangement.lattice != "single" else 1
        for move, start in product(range(moves), range(len(plan.starts))):
            begun = replace(plan, pitch=plan.pitch + move * _MOVE, start=start)
            if plan.sets == 1:
                yield begun
            else:
                yield from (replace(begun, lead=length) for length in islice(_clear_leads(begun), _MOST_TRIALS))

    problem = None
    for tried in candidates():
        try:
            for arrangement in dict.fromkeys((plan.arrangement.few, plan.arrangement)):
                board = replace(tried, arrangement=arrangement, elastomer=False)
                require_rules(board.design.array, board.rules)
        except (RuleViolationError, DesignError) as error:
            problem = problem or error
        else:
            return tried
    raise DesignError(
        "there is no place for terminals that keeps every rule"
        + (f"; in the usual one {problem}" if problem else ": the holes of the neighbours are too small for them.")
    )


def _clear_leads(plan: Plan) -> Iterator[float]:
    """Yield lengths of leads in m that clear other windings."""
    placements = replace(plan, arrangement=plan.arrangement.few, elastomer=False).design.array.placements
    windings = [_windings(place) for place in placements]
    others = [np.concatenate([*windings[:k], *windings[k + 1 :]]) for k in range(len(windings))]
    coil = placements[0].coil
    beside = plan.rules.min_gap + coil.trace_width / 2
    for place, lines in zip(placements, others, strict=True):
        if _nearest(place.to_board(coil.via_points), lines) < beside + plan.via_pad / 2:
            return
    terminals, pad = coil.terminal_points, 0.0 if coil.terminal is None else coil.terminal.pad
    outwards = terminals.mean(axis=0) / float(np.hypot(*terminals.mean(axis=0)))
    alike = [
        [
            line
            for other, own in zip(placements, windings, strict=True)
            if other is not place and set(place.layers) & set(other.layers)
            for line in own
        ]
        for place in placements
    ]
    for longer in np.arange(0.0, _LONGEST_LEAD * plan.width, _LEAD_STEP).tolist():
        ends = terminals + longer * outwards
        leads = [
            np.asarray(
                shapely.linestrings(
                    [place.to_board(np.array(both)) for both in zip(terminals, ends + _SHORT, strict=True)]
                )
            )
            for place in placements
        ]
        if all(
            _nearest(place.to_board(ends), others[k]) >= beside + pad / 2
            and _nearest(
                place.to_board(np.vstack((ends, coil.via_points))), np.concatenate([*leads[:k], *leads[k + 1 :]])
            )
            >= beside + pad / 2
            and np.min(shapely.distance(leads[k][:, None], np.array(alike[k])), initial=np.inf)
            >= beside + coil.trace_width / 2
            for k, place in enumerate(placements)
        ):
            yield plan.lead + longer


def _windings(place: Placement) -> npt.NDArray[np.object_]:
    """Centre lines of a coil without leads, on the board."""
    outline = shapely.Polygon(place.coil.outline).buffer(place.coil.trace_width)
    pieces = shapely.get_parts(shapely.intersection([shapely.LineString(line) for line in place.coil.lines], outline))
    return np.array([shapely.LineString(place.to_board(shapely.get_coordinates(piece))) for piece in pieces])


def _nearest(points: FloatArray, lines: npt.NDArray[np.object_]) -> float:
    return float(np.min(shapely.distance(np.asarray(shapely.points(points))[:, None], lines), initial=np.inf))


def with_connector(plan: Plan, side: Side, *, movable: bool) -> Plan:
    """Find room for all leads to a connector."""
    # Its distance, the length of the leads and, if `movable`, the pitch are increased, unless few coils are routed
    # and fixed neighbours are too near for a lead.
    problem = ""
    several = plan.arrangement.rows > 1 or plan.arrangement.lattice in ("triangle", "rings")
    for k, distance in list(enumerate(_DISTANCES))[several:]:
        further = k * _FURTHER if movable else 0.0
        tried = replace(plan, lead=plan.lead + k * _LONGER, pitch=plan.pitch + further)
        ways = ConnectorTable(side=side, distance_mm=distance)
        try:
            require_rules(route_leads(tried.design.array, Connector(**ways.in_si())), tried.rules)
        except NoWayError as error:
            coils, winding = len(tried.design.array.placements), tried.winding
            upright, size, count = side in ("left", "right"), tried.size, tried.arrangement
            across, passing = (size[-1], count.columns) if upright else (size[0], count.rows)
            # the leads of a whole row pass beside each other
            room = across + tried.lead + passing * (winding.trace_width + winding.gap) + winding.gap
            roomy = math.ceil(room / _PITCH_STEP * (1 - 1e-9)) * _PITCH_STEP
            tight = several and tried.pitch < roomy
            pitch = f"a pitch of about {roomy * 1e3:g} mm" if tight else "another pitch"
            problem = (
                f"connector: at most {error.routed} of {coils} coils can be routed to the {side} edge at a pitch of "
                f"{tried.pitch * 1e3:g} mm; try {pitch}, smaller coils, another side, or no connector."
            )
            if tight and not movable and 2 * error.routed < coils:
                break
        except (GeometryError, RuleViolationError) as error:
            problem = f"connector: {str(error).removeprefix(f'{plan.name}: ')}"
        else:
            return replace(tried, connector=ways.model_dump(exclude_unset=True))
    raise DesignError(problem)
