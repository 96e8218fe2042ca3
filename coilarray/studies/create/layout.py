"""Layers, winding, pitch and terminals of a new design: the layout of the fewest layers that does what is asked."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import combinations, product

import shapely

from coilarray.circuit.coupling import design_inductance
from coilarray.design.fab_limits import load_profile
from coilarray.electromagnetics.inductance import inductance_matrix
from coilarray.errors import DesignError
from coilarray.studies.create.decoupling import decoupled_pitch
from coilarray.studies.create.plan import Plan
from coilarray.studies.create.terminals import with_terminals
from coilarray.studies.create.winding import Room, Winding, wind

_FABS = ("oshpark-4-layer", "multi-cb-35um")  # taken where none is named: the first that has enough layers
_TRACE = 0.15e-3  # of traces and gaps, in m: coarser than most houses need
_GAP_STEP, _GAP_MARGIN = 10e-6, 1.05  # gaps are rounded up; turns of polygons come nearer than drawn by some percent
_USUAL_HOLE = 0.4  # of half the coil's width: the hole of a winding for which no inductance is asked
_HOLES = (0.45, 0.6, 0.75, 0.3)  # the same of coils that overlap, in which their neighbours' terminals may lie
_WINDING_LAYERS = (2, 4)
_BESIDE = 1e-3  # m between the terminals of a coil and its neighbour
_PASSES, _CLOSE = 3, 1e-3  # corrections of what is left out of the search for a winding, and when they end


@dataclass(frozen=True)
class Wishes:
    """What a layout is to have: inductance in H, layers, board house, pitch in m, or neighbours that do not couple."""

    inductance: float | None
    layers: int | None
    fab: str | None
    pitch: float | None
    decoupled: bool

    def fab_for(self, layers: int) -> str | None:
        """Return the board house that is named, or the first of the usual ones; None where it lacks layers."""
        for name in _FABS if self.fab is None else (self.fab,):
            most = load_profile(name).rules.max_layers
            if most is None or layers <= most:
                return name
        return None


def lay_out(plan: Plan, wishes: Wishes) -> Plan:
    """Find layers, winding, pitch and terminals; DesignError, one line, where no layout does what is asked."""
    problem = None
    for board in _boards(plan, wishes):
        try:
            wound = replace(board, winding=_winding(board, wishes.inductance))
        except DesignError as error:
            problem = error  # of the most layers: what is out of reach of all
            continue
        for turned in (False, True) if _can_turn(board) else (False,):
            try:
                placed = _placed(replace(wound, turned=turned), wishes)
                return with_terminals(placed, movable=board.sets == 1 and wishes.pitch is None)
            except DesignError as error:
                problem = error
    assert problem is not None  # there is at least one board, or a reason why not
    raise problem


def _boards(plan: Plan, wishes: Wishes) -> Iterator[Plan]:
    """Give the boards to try, those of the fewest layers first.

    Coils side by side need one set of layers; coils that overlap need more, and a wide hole for the terminals of their
    neighbours. DesignError where there is none.
    """
    overlap = wishes.decoupled or (wishes.pitch is not None and wishes.pitch < plan.width)
    some_sets: tuple[int, ...] = (1,)
    if overlap:
        some_sets = (2, 3, 4) if plan.arrangement.lattice in ("linear", "square") else (3, 4)
    if wishes.layers is None:
        each = _WINDING_LAYERS if wishes.inductance is not None else _WINDING_LAYERS[:1]
        pairs = sorted(product(some_sets, each), key=lambda pair: pair[0] * pair[1])
    else:
        pairs = [(sets, wishes.layers // sets) for sets in some_sets if _divides(sets, wishes.layers)]
    if not pairs:
        least = f"1 or a multiple of {2 * some_sets[0]}" if not overlap else f"a multiple of {2 * some_sets[0]}"
        apart = f" for neighbours on {some_sets[0]} different sets of them" if overlap else ""
        raise DesignError(f"layers must be {least}{apart}; got {wishes.layers}.")
    makeable = [(pair, fab) for pair in pairs if (fab := wishes.fab_for(math.prod(pair))) is not None]
    if not makeable:
        most = load_profile(str(wishes.fab)).rules.max_layers
        raise DesignError(f"{math.prod(pairs[0])} copper layers are needed; {wishes.fab} makes at most {most}.")
    for (sets, winding_layers), fab in makeable:
        for hole in _HOLES if overlap else (plan.hole,):
            yield replace(plan, sets=sets, winding_layers=winding_layers, fab=fab, hole=hole)


def _divides(sets: int, layers: int) -> bool:
    return layers > 0 and (layers % (2 * sets) == 0 or layers == sets == 1)


def _can_turn(plan: Plan) -> bool:
    """Whether turned hexagons, which face neighbours with corners, may lie further apart on equal layers."""
    return plan.shape == "hexagon" and plan.sets > 1 and plan.arrangement.lattice in ("hexagonal", "rings")


def _placed(plan: Plan, wishes: Wishes) -> Plan:
    """Find the pitch; DesignError where coils on the same layers overlap then."""
    if wishes.decoupled:
        few = replace(plan, arrangement=plan.arrangement.fewest)
        rough = replace(few, rough=True, elastomer=False)
        pitch = decoupled_pitch(
            plan.width, lambda at: replace(few, pitch=at).design, lambda at: replace(rough, pitch=at).design
        )
        placed = replace(plan, pitch=pitch)
    else:
        placed = replace(plan, pitch=plan.width + plan.lead + _BESIDE if wishes.pitch is None else wishes.pitch)
    if not _are_apart(placed):
        raise DesignError(
            f"coils of {plan.width * 1e3:g} mm at a pitch of {placed.pitch * 1e3:.4g} mm overlap so far that "
            f"{plan.layers} layers do not part them."
        )
    return placed


def _winding(plan: Plan, inductance: float | None) -> Winding:
    """Find turns and trace: of the usual width where that will do, else of the board house's narrowest."""
    radius, rules = min(plan.size) / 2, plan.rules
    closest = math.ceil(rules.min_gap * _GAP_MARGIN / _GAP_STEP) * _GAP_STEP
    hole = max(plan.hole * radius, plan.via_pad * (1.5 if plan.winding_layers < 3 else 2.5) + 2 * closest)
    usual = Room(radius, hole, max(_TRACE, rules.min_trace), max(_TRACE, closest))
    if inductance is None:
        usual = replace(usual, hole=max(_USUAL_HOLE * radius, hole))
        for room in (usual, replace(usual, hole=hole, trace_width=rules.min_trace, gap=closest)):
            if room.most_turns:
                return Winding(room.most_turns, room.trace_width, room.gap)
        inductance = 0.0  # refused with the reason
    try:
        return _wind(plan, inductance, usual)
    except DesignError:
        return _wind(plan, inductance, replace(usual, trace_width=rules.min_trace, gap=closest))


def _wind(plan: Plan, inductance: float, room: Room) -> Winding:
    """Find the winding by a rough model: without sheets, of few segments, screened; and again by what it leaves out."""
    rough, one = replace(plan.one, elastomer=False, rough=True), plan.one
    share = 1.0

    def screened(winding: Winding) -> float:
        return share * float(inductance_matrix(replace(rough, winding=winding).design.array, accuracy="screen")[0, 0])

    for _ in range(_PASSES):
        found = wind(inductance, room, screened)
        full = float(design_inductance(replace(one, winding=found).design)[0][0, 0])
        correction = full / screened(found)
        if abs(correction - 1) < _CLOSE:
            break
        share *= correction
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
