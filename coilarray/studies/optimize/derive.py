"""Goals that fit any design, by name, wish or file, with ranges of its entries.

The design itself lies in every range, so a search never has to leave out its start.
"""

import itertools
import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit

from coilarray.design.model import Design, DesignFile
from coilarray.design.write import as_file
from coilarray.errors import GoalError, NetworkError
from coilarray.studies.optimize.goal import GOALS, RULES, Goal, Variable, parse_goal
from coilarray.studies.quantities import Evaluation, canonical, evaluate, request
from coilarray.studies.sweep import UNREAD, Axis

_MOST_CHOICES = 12  # of copper layers; more would need more points than a search has
_WIDER, _SMALLER = 1.25, 0.6  # relative to the present pitch or size
_OVERLAP = 0.5  # of the distance at which coils touch: nearer coils are nearly one coil
_TURNS_LESS, _TURNS_MORE = 0.4, 0.3  # of the turns
_STEPS = 9  # of a variable with steps in a sweep
_NUMBER = r"([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)"
_QUANTITY = r"([^\[\]<>=]+(?:\[[^\[\]]*\])?)"
_DIRECTED = re.compile(rf"(minimize|maximize)\s+{_QUANTITY}")
_TARGET = re.compile(rf"{_QUANTITY}\s*=\s*{_NUMBER}")
_BOUND = re.compile(rf"{_QUANTITY}\s*(>=|<=|≥|≤)\s*{_NUMBER}")
_TABLES = ("variable", "objective", "constraint")
_WORSE = 1.005  # of a broken margin: a bound that every design just keeps would lead the local solver astray
_KEPT = -0.001  # mm: margin that the check of the fabrication rules takes as kept
_AREA_MORE, _COVERED_LESS, _Q_LESS = 1.25, 0.95, 0.8  # relative to the present values
_SEVERAL = "named goals are for one board, and {} has several: give a goal file, or --goal and --vary."


@dataclass(frozen=True)
class Row:
    """Table of a goal file, with its origin."""

    table: dict[str, Any]
    says: str


@dataclass(frozen=True)
class Pair:
    """Two coils with distance and touching distance in m."""

    names: tuple[str, str]
    distance: float
    touching: float
    share_copper: bool  # whether they share copper layers


def pairs(design: Design) -> list[Pair]:
    """All pairs of coils, the nearest first, from the middle."""
    places = design.array.placements
    middle = (design.array.centres.min(axis=0) + design.array.centres.max(axis=0)) / 2
    found, outlines = [], {place.name: place.to_board(place.coil.outline) - (place.x, place.y) for place in places}
    for one, other in itertools.combinations(places, 2):
        away = np.array([other.x - one.x, other.y - one.y])
        distance = float(np.hypot(*away))
        off = float(np.hypot(*((one.x + other.x) / 2 - middle[0], (one.y + other.y) / 2 - middle[1])))
        shares = bool(set(one.layers) & set(other.layers))
        ahead, behind = (outlines[place.name] @ (away / (distance or 1.0)) for place in (one, other))
        pair = Pair((one.name, other.name), distance, float(ahead.max() - behind.min()), shares)
        found.append((round(distance * 1e9), shares, round(off * 1e9), pair))
    return [pair for *_, pair in sorted(found, key=lambda known: known[:3])]


def neighbours(design: Design) -> Pair:
    """Two neighbours in the middle, if possible on different copper."""
    known = pairs(design)
    if not known:
        raise GoalError(f"the design {design.name} has only one coil, and so no coupling.")
    near = known[: len(design.array.neighbours)]
    return next((pair for pair in near if not pair.share_copper), near[0])


def pitch_ranges(file: DesignFile) -> list[Row]:
    """Range of the pitch of a lattice of several coils."""
    design, pitch = file.design, file.values.get("array.pitch_mm")
    known = pairs(design)
    if not isinstance(pitch, int | float) or not known:
        return []
    gap = design.rules.min_gap
    # a distance between two coils is the pitch times a constant ratio
    apart = max((pitch * (one.touching + gap) / one.distance for one in known if one.share_copper), default=0.0)
    near = neighbours(design)
    closest = pitch * _OVERLAP * near.touching / near.distance
    why = "coils on the same copper would meet" if apart > closest else "neighbours would be all but one coil"
    low, why = max(apart, closest), f"nearer, {why}"
    return [_between("array.pitch_mm", pitch, low, _WIDER * pitch, f"{why}; up to a quarter more than it is")]


def size_ranges(file: DesignFile) -> list[Row]:
    """Ranges of spirals' outer sizes that do not touch."""
    design = file.design
    room = min(
        ((one.distance - design.rules.min_gap) / one.touching for one in pairs(design) if one.share_copper),
        default=_WIDER,
    )
    if "array.pitch_mm" in file.values:
        room = _WIDER  # the lattice makes room
    more, why = min(_WIDER, room), "three fifths of that to a quarter more, as far as there is room"
    return [_between(key, size, _SMALLER * size, more * size, why) for key, size in _of_coils(file, "outer_")]


def distance_ranges(file: DesignFile) -> list[Row]:
    """Range of the pitch, or of the sizes if each coil has its own place."""
    return pitch_ranges(file) or size_ranges(file)


def turns_ranges(file: DesignFile) -> list[Row]:
    """Ranges of all turns per layer in whole steps."""
    ranges = []
    for key, turns in _of_coils(file, "turns_per_layer"):
        low = turns - min(max(1, round(_TURNS_LESS * turns)), math.ceil(turns) - 1)
        high = turns + max(1, round(_TURNS_MORE * turns))
        ranges.append(
            Row({"entry": key, "low": low, "high": high, "step": 1}, f"{turns:g} as it is, and whole turns around it")
        )
    return ranges


def trace_ranges(file: DesignFile) -> list[Row]:
    """Ranges of trace widths and gaps down to [fab]."""
    rules = file.design.rules
    limits = (("trace_width_mm", rules.min_trace * 1e3), ("gap_mm", rules.min_gap * 1e3))
    return [
        Row({"entry": key, "low": round(limit, 9), "high": value}, "from the limit of [fab] to what it is")
        for name, limit in limits
        for key, value in _of_coils(file, name)
        if value > limit * (1 + 1e-6)
    ]


def layer_choices(file: DesignFile) -> list[Row]:
    """Possible sets of copper layers, which coils take in turn."""
    sets = file.values.get("array.layers")
    if not isinstance(sets, list) or len(sets) < 2 or len(file.design.array.names) < 2:
        return []
    names, size = file.design.array.stackup.names, len(sets[0])
    used = [layer for one in sets for layer in one]
    if len(set(used)) < len(used) or any(len(one) != size for one in sets):
        return []
    choices, now = [sets], sorted(map(sorted, sets))
    for choice in _disjoint(names, size, len(sets)):
        if sorted(map(sorted, choice)) != now:
            choices.append(choice)
        if len(choices) > _MOST_CHOICES:
            return []
    if len(choices) == 1:
        return []
    return [Row({"entry": "array.layers", "choices": choices}, "as it is, and the other ways to share the layers")]


def termination_choices(file: DesignFile) -> list[Row]:
    """Possible terminations of unmeasured coils, if there are several."""
    key = "circuit.default_termination"
    now = file.values.get(key)
    if now not in ("short", "open") or len(file.design.array.names) < 2:
        return []
    return [Row({"entry": key, "choices": ["short", "open"]}, f"what closes the passive coils; {now} as it is")]


def rounded(value: float, digits: int, *, up: bool) -> float:
    """Round a number up or down to some digits.

    >>> rounded(13.28, 3, up=True), rounded(-0.0123, 1, up=False)
    (13.3, -0.02)
    """
    if value == 0:
        return 0.0
    unit = 10.0 ** (math.floor(math.log10(abs(value))) - digits + 1)
    steps = (math.ceil if up else math.floor)(round(value / unit, 6))
    return float(f"{steps * unit:.12g}")


def _between(key: str, now: float, low: float, high: float, why: str) -> Row:
    """Make a range of three digits with the present value."""
    ends = {"low": min(rounded(low, 3, up=True), now), "high": max(rounded(high, 3, up=True), now)}
    return Row({"entry": key, **ends}, f"{now:g} as it is; {why}")


def _of_coils(file: DesignFile, begins: str) -> list[tuple[str, float]]:
    """Numbers of used spirals, by keys that begin with `begins`."""
    used = {place.coil.name for place in file.design.array.placements}
    return [
        (key, float(value))
        for key, value in file.values.items()
        for name in used
        if key.startswith(f"coils.{name}.{begins}")
        and f"coils.{name}.turns_per_layer" in file.values
        and isinstance(value, int | float)
    ]


def _disjoint(names: tuple[str, ...], size: int, count: int) -> Iterator[list[list[str]]]:
    """Yield the ways to choose disjoint sets of layers."""
    if count == 0:
        yield []
        return
    for first in itertools.combinations(range(len(names)), size):
        for rest in _disjoint(  # every set begins after the set before, so no way is repeated
            tuple(n for k, n in enumerate(names) if k > first[0] and k not in first), size, count - 1
        ):
            yield [[names[k] for k in first], *rest]


def parse_bound(text: str) -> dict[str, Any]:
    """Read ``QUANTITY>=VALUE`` or ``QUANTITY<=VALUE`` as a constraint."""
    found = _BOUND.fullmatch(text.strip())
    if found is None:
        raise GoalError(f"--keep must be QUANTITY>=VALUE or QUANTITY<=VALUE; got {text!r}.")
    side = "at_least" if found[2] in (">=", "≥") else "at_most"
    return {"quantity": found[1].strip(), side: float(found[3])}


def variable_of(axis: Axis) -> dict[str, Any]:
    """Read START:STOP, START:STOP:COUNT as steps, or A,B,… as choices."""
    values = axis.values
    if axis.interval:
        return {"entry": axis.key, "low": values[0], "high": values[1]}
    steps = {round(b - a, 9) for a, b in pairwise(values)} if axis.numeric else set()
    if axis.numeric and len(values) > 2 and len(steps) == 1 and min(steps) > 0:
        return {"entry": axis.key, "low": values[0], "high": values[-1], "step": steps.pop()}
    return {"entry": axis.key, "choices": list(values)}


def axis_of(variable: Variable) -> Axis:
    """Return a variable as an axis of a sweep."""
    if variable.choices is not None:
        return Axis(variable.entry, tuple(variable.choices))
    assert variable.low is not None  # checked by the table
    assert variable.high is not None
    if variable.step is None:
        return Axis(variable.entry, (variable.low, variable.high), interval=True)
    count = round((variable.high - variable.low) / variable.step)
    places = {round(count * k / (_STEPS - 1)) for k in range(_STEPS)}
    return Axis(variable.entry, tuple(variable.low + variable.step * place for place in sorted(places)))


@dataclass(frozen=True)
class DerivedGoal:
    """Goal with its tables' origin by kind and entry."""

    goal: Goal
    comments: Mapping[tuple[str, str], str]

    def text(self, head: str) -> str:
        """Return the goal as a commented file, headed by `head`."""
        document = tomlkit.document()
        for line in head.splitlines():
            document.add(tomlkit.comment(line))
        document.add(tomlkit.nl())
        for kind, value in self.goal.model_dump(mode="json", by_alias=True, exclude_unset=True).items():
            if kind not in _TABLES:
                document.add(kind, value)
                continue
            rows = tomlkit.aot()
            for table in value:
                row = tomlkit.table()
                if (kind, _name(table)) in self.comments:
                    row.add(tomlkit.comment(self.comments[kind, _name(table)]))
                for key in sorted(table, key=lambda key: key != "quantity"):  # of a bound it comes first
                    if table[key] is not None:
                        row.add(key, table[key])
                rows.append(row)
            document.add(kind, rows)
        return tomlkit.dumps(document)


def _name(table: Mapping[str, Any]) -> str:
    return str(table.get("entry") or table["quantity"])


@dataclass(frozen=True)
class _Part:
    objective: Row
    constraints: list[Row]
    watch: list[str] = field(default_factory=list)
    trials: int = 80
    polish: int = 40


@dataclass(frozen=True)
class _Named:
    title: str
    needs: Callable[[Design], object]  # GoalError for a design that lacks the goal's subject
    kinds: Sequence[Callable[[DesignFile], list[Row]]]
    part: Callable[[DesignFile], _Part]

    def variables(self, file: DesignFile) -> list[Row]:
        return [row for kind in self.kinds for row in kind(file)]


def load_goal(name_or_path: str | Path, design: Design | DesignFile) -> Goal:
    """Read a goal file (TOML), or make a named goal.

    `name_or_path` is the path of a file, which has precedence, or a name. Raises GoalError for an
    unreadable file, an unknown key or a value that is not allowed, in one line, and if the goal
    does not fit the `design`, for example `decouple` for a single coil.

    >>> from coilarray import load_design
    >>> [variable.entry for variable in load_goal("worst_k", load_design("starter")).variables]
    ['array.pitch_mm', 'array.layers']
    """
    if is_named(name_or_path):
        return derive_goal([str(name_or_path)], design).goal
    if not Path(name_or_path).suffix and not Path(name_or_path).is_file():
        raise GoalError(f"there is no goal {str(name_or_path)!r}: it must be a file or one of {', '.join(NAMES)}.")
    return parse_goal(GOALS.text(name_or_path), str(name_or_path))


def keeping_rules(goal: Goal, design: Design | DesignFile) -> Goal:
    """Add bounds that every board must keep, unless the goal has them."""
    # The margin of the rules is kept, or broken no more than by the design, and an LDC1614 reads the quantities.
    file, names = as_file(design), goal.quantities
    more = [] if any(name.startswith(RULES) for name in names) else [_fab(file).table]
    read = any(request(name).quantity.is_read for name in names)
    if read and UNREAD not in names and file.design.readout.is_judged:
        more.append({"quantity": UNREAD, "at_most": 0.0})
    if not more:
        return goal
    document = goal.model_dump(mode="json", by_alias=True, exclude_unset=True)
    document["constraint"] = [*document.get("constraint", []), *more]
    return GOALS.check(Goal, document, "goal")


def is_named(name_or_path: str | Path) -> bool:
    """Whether this is a goal's name, not a file."""
    return str(name_or_path) in NAMES and not Path(name_or_path).is_file()


def derive_goal(wishes: Sequence[str], design: Design | DesignFile, vary: Sequence[Axis] = ()) -> DerivedGoal:
    """Make a design's goal of all `wishes`, some of which may be `NAMES`."""
    # Its variables are those of all, or the axes `vary`. GoalError for a bad wish, or if nothing could be changed.
    file = as_file(design)
    if file.design.boards and (not vary or any(wish in _NAMED for wish in wishes)):
        raise GoalError(_SEVERAL.format(file.design.name))
    asked = [_named(wish) for wish in wishes]
    for one in asked:
        one.needs(file.design)
    variables = [Row(variable_of(axis), "") for axis in vary] or [row for one in asked for row in one.variables(file)]
    if not variables:
        nothing = f"{', '.join(wishes)} finds nothing to vary in {file.design.name}"
        raise GoalError(f"{nothing}; name entries by --vary or in a goal file.")
    parts = [one.part(file) for one in asked]
    objectives = _by_name([part.objective for part in parts])
    constraints = _by_name([row for part in parts for row in part.constraints if _name(row.table) not in objectives])
    rows = dict(zip(_TABLES, (_by_name(variables), objectives, constraints), strict=True))
    search = {"trials": max(part.trials for part in parts), "seed": 1, "accuracy": "screen"}
    search |= {"polish": parts[0].polish} if len(objectives) == 1 else {"sampler": "nsga2"}
    watch = dict.fromkeys(one for part in parts for one in part.watch)
    document = {
        "schema": 1,
        "title": "; ".join(one.title for one in asked),
        "watch": [one for one in watch if one not in objectives and one not in constraints],
        **{kind: [row.table for row in named.values()] for kind, named in rows.items()},
        "search": search,
    }
    comments = {(kind, name): row.says for kind, named in rows.items() for name, row in named.items() if row.says}
    return DerivedGoal(GOALS.check(Goal, document, ", ".join(wishes)), comments)


def _by_name(rows: Sequence[Row]) -> dict[str, Row]:
    return {_name(row.table): row for row in rows}


def adjusted(derived: DerivedGoal, vary: Sequence[Axis], keep: Sequence[Mapping[str, Any]]) -> DerivedGoal:
    """Return a goal with other variables and further bounds."""
    if not vary and not keep:
        return derived
    document = derived.goal.model_dump(mode="json", by_alias=True, exclude_unset=True)
    if vary:
        document["variable"] = [variable_of(axis) for axis in vary]
    given: dict[str, dict[str, Any]] = {}
    for bound in keep:
        key = canonical(bound["quantity"])
        given[key] = {**given.get(key, {}), **bound, "quantity": key}
    others = [one for one in document.get("constraint", []) if one["quantity"] not in given]
    document["constraint"] = [*others, *given.values()]
    comments = {
        (kind, name): says
        for (kind, name), says in derived.comments.items()
        if not ((kind == "variable" and vary) or (kind == "constraint" and name in given))
    }
    return DerivedGoal(GOALS.check(Goal, document, "--vary and --keep"), comments)


def unfit_goals(design: Design | DesignFile) -> dict[str, str]:
    """Names of goals that do not fit, with reasons."""
    file, reasons = as_file(design), dict[str, str]()
    if file.design.boards:
        return dict.fromkeys(_NAMED, _SEVERAL.format(file.design.name))
    for name, named in _NAMED.items():
        try:
            named.needs(file.design)
            if not named.variables(file):
                reasons[name] = f"{name} finds nothing to vary in {file.design.name}."
        except GoalError as error:
            reasons[name] = str(error)
    return reasons


def _named(wish: str) -> _Named:
    if wish in _NAMED:
        return _NAMED[wish]
    if found := _DIRECTED.fullmatch(wish.strip()):
        objective = {"quantity": canonical(found[2].strip()), "direction": found[1]}
    elif found := _TARGET.fullmatch(wish.strip()):
        objective = {"quantity": canonical(found[1].strip()), "target": float(found[2])}
    else:
        raise GoalError(
            f"a goal must be one of {', '.join(NAMES)}, or minimize QUANTITY, maximize QUANTITY or QUANTITY=VALUE; "
            f"got {wish!r}."
        )
    kinds = (pitch_ranges, size_ranges, turns_ranges)
    return _Named(wish, lambda _: None, kinds, lambda file: _Part(Row(objective, ""), [_fab(file)]))


def _worst_k(file: DesignFile) -> _Part:
    objective = Row({"quantity": "worst_k", "direction": "minimize"}, "largest |k| of any two coils")
    return _Part(objective, [_fab(file), *_areas(file)], ["rms_k", "span_mm"])


def _decouple(file: DesignFile) -> _Part:
    near = neighbours(file.design)
    reason = "two neighbours in the middle"
    if near.share_copper:
        reason += "; they lie on the same copper, where coils cannot overlap until k is zero"
    objective = Row({"quantity": f"k[{','.join(near.names)}]", "target": 0.0}, reason)
    return _Part(objective, [_fab(file)], ["worst_k", "board_area_mm2"], trials=16, polish=20)


def _three_states(design: Design) -> None:
    _ = Evaluation(design).indentation  # there must be one
    if len(design.plan) < 3:
        raise GoalError(
            f"position_error needs 3 states of the scan for x, y and the depth; {design.name} has {len(design.plan)}."
        )


def _position_error(file: DesignFile) -> _Part:
    says = "least standard deviation of x over all coils, for δ with the design's noise budget"
    objective = Row({"quantity": "position_error_mm", "direction": "minimize"}, says)
    return _Part(objective, [_fab(file), *_areas(file)], ["depth_error_mm"], trials=40, polish=0)


def _a_target(design: Design) -> None:
    _ = Evaluation(design).target


def _of_target(file: DesignFile, *, finest: bool) -> _Part:
    coil = file.design.array.middle_coil
    if finest:
        distances = Evaluation(file.design).target.distances
        middle = f"{round(distances[len(distances) // 2] * 1e3, 6):g}"
        quantity, direction = f"target_deviation_um[{coil},distance_mm={middle}]", "minimize"
        says = "in the middle of its distances"
    else:
        quantity, direction, says = f"target_range_mm[{coil}]", "maximize", "δ with the noise budget"
    now = evaluate(file.design, ["board_area_mm2"])["board_area_mm2"]
    board = Row({"quantity": "board_area_mm2", "at_most": rounded(now, 3, up=True)}, "no more board than it is")
    objective = Row({"quantity": canonical(quantity), "direction": direction}, f"of {coil}; {says}")
    return _Part(objective, [_fab(file), board], [f"q[{coil}]", f"inductance_uH[{coil}]"], trials=40, polish=0)


def _smallest(file: DesignFile) -> _Part:
    design = file.design
    coil = design.array.names[0] if len(design.array.names) == 1 else neighbours(design).names[0]
    wanted = {f"inductance_uH[{coil}]": (1.0, "at_least", "as much as it is; another one can be asked for here")}
    if len(design.array.names) > 1:
        wanted["worst_k"] = (1.0, "at_most", "no more coupling than it is")
    wanted["q"] = (_Q_LESS, "at_least", "four fifths of what it is, as narrow traces cost Q")
    bounds = [_fab(file)]
    for quantity, (part, side, says) in wanted.items():
        with suppress(NetworkError):  # no converter oscillates with it: nothing to keep
            now = evaluate(design, [quantity])[quantity]
            bounds.append(Row({"quantity": quantity, side: rounded(part * now, 3, up=side == "at_most")}, says))
    return _Part(Row({"quantity": "board_area_mm2", "direction": "minimize"}, ""), bounds, ["span_mm"], trials=100)


def _fab(file: DesignFile) -> Row:
    margin = evaluate(file.design, ["fab_margin_mm"])["fab_margin_mm"]
    if margin < _KEPT:
        least, says = rounded(_WORSE * margin, 3, up=False), "no worse than it is: the design itself breaks a rule"
    else:
        least, says = _KEPT, "no trace, gap or hole nearer to its limit in [fab] than the check takes as kept"
    return Row({"quantity": "fab_margin_mm", "at_least": least}, says)


def _areas(file: DesignFile) -> list[Row]:
    board, covered = evaluate(file.design, ["board_area_mm2", "covered_mm2"]).values()
    return [
        Row(
            {"quantity": "board_area_mm2", "at_most": rounded(_AREA_MORE * board, 3, up=True)},
            f"a quarter more board than the {board:.0f} mm² that it has",
        ),
        Row(
            {"quantity": "covered_mm2", "at_least": rounded(_COVERED_LESS * covered, 3, up=False)},
            f"a twentieth less than the {covered:.0f} mm² that its coils cover",
        ),
    ]


_TRACES = (size_ranges, turns_ranges, trace_ranges)
_NAMED: Mapping[str, _Named] = {
    "worst_k": _Named("Less coupling between any two coils", neighbours, (distance_ranges, layer_choices), _worst_k),
    "decouple": _Named("Neighbours without coupling", neighbours, (distance_ranges,), _decouple),
    "position_error": _Named(
        "Positions best resolved", _three_states, (pitch_ranges, turns_ranges, termination_choices), _position_error
    ),
    "smallest": _Named(
        "The smallest board for its inductance",
        lambda _: None,
        (size_ranges, pitch_ranges, turns_ranges, trace_ranges),
        _smallest,
    ),
    "range": _Named("Largest range of a target", _a_target, _TRACES, partial(_of_target, finest=False)),
    "resolution": _Named("Finest resolution of distance", _a_target, _TRACES, partial(_of_target, finest=True)),
}
NAMES: Mapping[str, str] = {name: named.title for name, named in _NAMED.items()}
"""Goals that fit many designs, by name, with descriptions."""
