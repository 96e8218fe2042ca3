"""Goals that fit any design: by name, by a wish, or from a file, with ranges and bounds from the design."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any

from coilarray.design.model import Design, DesignFile
from coilarray.design.write import as_file
from coilarray.errors import GoalError, NetworkError
from coilarray.geometry import Target
from coilarray.studies.optimize import ranges
from coilarray.studies.optimize.goal import GOALS, RULES, Goal, Variable, check_goal, parse_goal
from coilarray.studies.optimize.ranges import Range, rounded
from coilarray.studies.quantities import Evaluation, canonical, evaluate, request
from coilarray.studies.sweep import UNREAD, Axis

_STEPS = 9  # of a variable with steps in a sweep
_NUMBER = r"([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)"
_QUANTITY = r"([^\[\]<>=]+(?:\[[^\[\]]*\])?)"
_DIRECTED = re.compile(rf"(minimize|maximize)\s+{_QUANTITY}")
_TARGET = re.compile(rf"{_QUANTITY}\s*=\s*{_NUMBER}")
_BOUND = re.compile(rf"{_QUANTITY}\s*(>=|<=|≥|≤)\s*{_NUMBER}")


def parse_wish(text: str) -> dict[str, Any] | None:
    """Read ``minimize QUANTITY``, ``maximize QUANTITY`` or ``QUANTITY=VALUE``, or return None.

    Examples
    --------
    >>> parse_wish("maximize q"), parse_wish("k[coil1,coil2]=0")
    ({'quantity': 'q', 'direction': 'maximize'}, {'quantity': 'k[coil1,coil2]', 'target': 0.0})
    """
    if found := _DIRECTED.fullmatch(text.strip()):
        return {"quantity": found[2].strip(), "direction": found[1]}
    if found := _TARGET.fullmatch(text.strip()):
        return {"quantity": found[1].strip(), "target": float(found[2])}
    return None


def parse_bound(text: str) -> dict[str, Any]:
    """Read ``QUANTITY>=VALUE`` or ``QUANTITY<=VALUE`` as a constraint. Raises GoalError."""
    found = _BOUND.fullmatch(text.strip())
    if found is None:
        raise GoalError(f"--keep must be QUANTITY>=VALUE or QUANTITY<=VALUE; got {text!r}.")
    side = "at_least" if found[2] in (">=", "≥") else "at_most"
    return {"quantity": found[1].strip(), side: float(found[3])}


def variable_of(axis: Axis) -> dict[str, Any]:
    """Return START:STOP, START:STOP:COUNT as steps, or A,B,… as choices, as a variable."""
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


_TABLES = ("variable", "objective", "constraint")


def goal_text(goal: Goal, comments: Mapping[str, str], head: str) -> str:
    """Write a goal as the text of a goal file, with a comment for each table by its place.

    `head` are the lines at the top.
    """
    document = goal.model_dump(mode="json", by_alias=True, exclude_unset=True)
    lines = [*(f"# {line}".rstrip() for line in head.splitlines()), ""]
    lines += [f"{key} = {_value(value)}" for key, value in document.items() if key not in (*_TABLES, "search")]
    for table in _TABLES:
        for k, entries in enumerate(document.get(table, [])):
            lines += ["", f"[[{table}]]"]
            if f"{table}.{k}" in comments:
                lines.append(f"# {comments[f'{table}.{k}']}")
            lines += _entries(entries)
    lines += ["", "[search]", *_entries(document.get("search", {}))]
    return "\n".join(lines) + "\n"


def _entries(table: Mapping[str, Any]) -> list[str]:
    ordered = sorted(table, key=lambda key: key != "quantity")  # the quantity of a bound comes first
    return [f"{key} = {_value(table[key])}" for key in ordered if table[key] is not None]


def _value(value: Any) -> str:
    """Return a plain value as TOML. Inner lists have one line each."""
    if isinstance(value, list) and any(isinstance(part, list) for part in value):
        return "[\n" + "".join(f"    {json.dumps(part, ensure_ascii=False)},\n" for part in value) + "]"
    return json.dumps(value, ensure_ascii=False)


_UNKNOWNS = 3  # of a position: x, y and the depth
_WORSE = 1.005  # of a broken margin: a bound that every design just keeps would lead the local solver astray
_KEPT = -0.001  # mm: margin that the check of the fabrication rules takes as kept
_AREA_MORE, _COVERED_LESS, _Q_LESS = 1.25, 0.95, 0.8  # relative to the present values


@dataclass(frozen=True)
class _Part:
    """Tables of one name or wish in a goal, each with a line about its origin."""

    objectives: list[tuple[dict[str, Any], str]]
    constraints: list[tuple[dict[str, Any], str]]
    watch: list[str] = field(default_factory=list)
    trials: int = 80
    polish: int = 40


@dataclass(frozen=True)
class _Named:
    """Named goal with its condition and changes."""

    title: str
    needs: Callable[[Design], object]  # GoalError for a design that lacks the goal's subject
    variables: Callable[[DesignFile], list[Range]]
    part: Callable[[DesignFile], _Part]


@dataclass(frozen=True)
class DerivedGoal:
    """Goal with a line about the origin of its tables, by places such as "variable.0"."""

    goal: Goal
    comments: Mapping[str, str]

    def text(self, head: str) -> str:
        """Return the goal as a commented file with `head` at its top."""
        return goal_text(self.goal, self.comments, head)


def load_goal(name_or_path: str | Path, design: Design | DesignFile) -> Goal:
    """Read a goal file (TOML), or make one of the goals `NAMES` for the design.

    A file has precedence over a name. Raises GoalError for an unreadable file, an unknown key or a value that is not
    allowed, in one line, and if the goal does not fit the design, for example `decouple` for a single coil.

    Examples
    --------
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
    """Add bounds that every board must keep to a goal.

    The margin of the fabrication rules is kept, or broken no more than by the design. If the goal has a quantity that
    an LDC1614 reads, and the design has such a converter, the converter must be able to read all of it. A bound is left
    out if the goal already treats its quantity. Both are left out for the sampler cmaes, which takes no bounds.
    """
    if goal.search.sampler == "cmaes":
        return goal
    file, names = as_file(design), goal.quantities
    more = [] if any(name.startswith(RULES) for name in names) else [_fab(file)[0]]
    read = any(request(name).quantity.is_read for name in names)
    if read and UNREAD not in names and file.design.readout.converter:
        more.append({"quantity": UNREAD, "at_most": 0.0})
    if not more:
        return goal
    document = goal.model_dump(mode="json", by_alias=True, exclude_unset=True)
    document["constraint"] = [*document.get("constraint", []), *more]
    return check_goal(document)


def is_named(name_or_path: str | Path) -> bool:
    """Whether this is the name of a goal and not a file."""
    return str(name_or_path) in NAMES and not Path(name_or_path).is_file()


def derive_goal(wishes: Sequence[str], design: Design | DesignFile, vary: Sequence[Axis] = ()) -> DerivedGoal:
    """Make a goal for a design from names among `NAMES` or wishes as `parse_wish` reads them.

    Several wishes make a goal with several objectives and all their variables. The axes `vary` replace the variables
    that follow from the wishes. Raises GoalError for a wish that is not valid, and if nothing could be changed.
    """
    file = as_file(design)
    asked = [_named(wish) for wish in wishes]
    for one in asked:
        one.needs(file.design)
    varied = [Range(variable_of(axis), "") for axis in vary] or [each for one in asked for each in one.variables(file)]
    variables = {one.variable["entry"]: one for one in varied}
    if not variables:
        raise GoalError(f"{_nothing_to_vary(wishes, file)}; name entries by --vary or in a goal file.")
    parts = [one.part(file) for one in asked]
    objectives = {table["quantity"]: (table, says) for part in parts for table, says in part.objectives}
    constraints = {table["quantity"]: (table, says) for part in parts for table, says in part.constraints}
    for quantity in objectives:
        constraints.pop(quantity, None)
    single = len(objectives) == 1
    search = {"trials": max(part.trials for part in parts), "seed": 1, "accuracy": "screen"}
    search |= {"polish": parts[0].polish} if single else {"sampler": "nsga2"}
    watch = dict.fromkeys(one for part in parts for one in part.watch)
    document = {
        "schema": 1,
        "title": "; ".join(one.title for one in asked),
        "watch": [one for one in watch if one not in objectives and one not in constraints],
        "variable": [one.variable for one in variables.values()],
        "objective": [table for table, _ in objectives.values()],
        "constraint": [table for table, _ in constraints.values()],
        "search": search,
    }
    comments = {f"variable.{k}": each.says for k, each in enumerate(variables.values()) if each.says}
    comments |= {f"objective.{k}": says for k, (_, says) in enumerate(objectives.values()) if says}
    comments |= {f"constraint.{k}": says for k, (_, says) in enumerate(constraints.values()) if says}
    return DerivedGoal(check_goal(document, ", ".join(wishes)), comments)


def adjusted(derived: DerivedGoal, vary: Sequence[Axis], keep: Sequence[Mapping[str, Any]]) -> DerivedGoal:
    """Return a goal with the variables of `vary`, if any, and further bounds, one for a quantity."""
    if not vary and not keep:
        return derived
    document = derived.goal.model_dump(mode="json", by_alias=True, exclude_unset=True)
    comments = dict(derived.comments)
    if vary:
        document["variable"] = [variable_of(axis) for axis in vary]
        comments = {place: says for place, says in comments.items() if not place.startswith("variable.")}
    if keep:
        given: dict[str, dict[str, Any]] = {}
        for bound in keep:
            key = canonical(bound["quantity"])
            given[key] = {**given.get(key, {}), **bound, "quantity": key}
        old = [(k, one) for k, one in enumerate(document.get("constraint", [])) if one["quantity"] not in given]
        document["constraint"] = [*(one for _, one in old), *given.values()]
        says = {f"constraint.{new}": comments.pop(f"constraint.{k}", "") for new, (k, _) in enumerate(old)}
        comments = {place: text for place, text in comments.items() if not place.startswith("constraint.")}
        comments |= {place: text for place, text in says.items() if text}
    return DerivedGoal(check_goal(document, "--vary and --keep"), comments)


def unfit_goals(design: Design | DesignFile) -> dict[str, str]:
    """Return the names of goals that do not fit, each with the reason in one line.

    Examples
    --------
    >>> from coilarray import load_design
    >>> list(unfit_goals(load_design("starter"))), unfit_goals(load_design("gast_fem"))["decouple"]
    (['range', 'resolution'], 'the design gast_fem has only one coil, and so no coupling.')
    """
    file, reasons = as_file(design), dict[str, str]()
    for name, named in _NAMED.items():
        try:
            named.needs(file.design)
            if not named.variables(file):
                reasons[name] = f"{_nothing_to_vary([name], file)}."
        except GoalError as error:
            reasons[name] = str(error)
    return reasons


def _nothing_to_vary(wishes: Sequence[str], file: DesignFile) -> str:
    return f"{', '.join(wishes)} finds nothing to vary in {file.design.name}"


def _named(wish: str) -> _Named:
    """Return the goal of a name or a wish, for which coils and distances may change."""
    if wish in _NAMED:
        return _NAMED[wish]
    objective = parse_wish(wish)
    if objective is None:
        raise GoalError(
            f"a goal must be one of {', '.join(NAMES)}, or minimize QUANTITY, maximize QUANTITY or QUANTITY=VALUE; "
            f"got {wish!r}."
        )
    objective["quantity"] = canonical(objective["quantity"])
    return _Named(wish, lambda _: None, _sizes, lambda file: _Part([(objective, "")], [_fab(file)]))


def _worst_k(file: DesignFile) -> _Part:
    return _Part(
        [({"quantity": "worst_k", "direction": "minimize"}, "largest |k| of any two coils")],
        [_fab(file), *_areas(file)],
        ["rms_k", "span_mm"],
    )


def _decouple(file: DesignFile) -> _Part:
    """Goal of zero coupling between two neighbours in the middle."""
    near = ranges.neighbours(file.design)
    reason = "two neighbours in the middle"
    if near.share_copper:
        reason += "; they lie on the same copper, where coils cannot overlap until k is zero"
    return _Part(
        [({"quantity": f"k[{','.join(near.names)}]", "target": 0.0}, reason)],
        [_fab(file)],
        ["worst_k", "board_area_mm2"],
        trials=16,
        polish=20,
    )


def _three_states(design: Design) -> None:
    """Refuse a design with fewer states than unknowns."""
    _ = Evaluation(design).indentation  # there must be one
    if len(design.plan) < _UNKNOWNS:
        raise GoalError(
            f"position_error needs {_UNKNOWNS} states of the scan for x, y and the depth; "
            f"{design.name} has {len(design.plan)}."
        )


def _position_error(file: DesignFile) -> _Part:
    """Goal of the least error of x over all coils."""
    return _Part(
        [
            (
                {"quantity": "position_error_mm", "direction": "minimize"},
                "least standard deviation of x over all coils, for δ with the design's noise budget",
            )
        ],
        [_fab(file), *_areas(file)],
        ["depth_error_mm"],
        trials=40,
        polish=0,
    )


def _target(design: Design) -> Target:
    return Evaluation(design).target  # there must be one


def _range(file: DesignFile) -> _Part:
    return _of_target(file, "target_range_mm[{coil}]", "maximize", "δ with the noise budget")


def _resolution(file: DesignFile) -> _Part:
    distances = _target(file.design).distances
    middle = f"{round(distances[len(distances) // 2] * 1e3, 6):g}"
    quantity = f"target_deviation_um[{{coil}},distance_mm={middle}]"
    return _of_target(file, quantity, "minimize", "in the middle of its distances")


def _of_target(file: DesignFile, quantity: str, direction: str, says: str) -> _Part:
    """Change size, turns and traces of the coils. The board does not grow."""
    coil = file.design.array.middle_coil
    board, _ = _areas(file)[0]
    now = evaluate(file.design, ["board_area_mm2"])["board_area_mm2"]
    return _Part(
        [({"quantity": canonical(quantity.format(coil=coil)), "direction": direction}, f"of {coil}; {says}")],
        [_fab(file), ({**board, "at_most": rounded(now, 3, up=True)}, "no more board than it is")],
        [f"q[{coil}]", f"inductance_uH[{coil}]"],
        trials=40,
        polish=0,
    )


def _smallest(file: DesignFile) -> _Part:
    """Minimize the board area; inductance in the middle, coupling and most of Q are kept."""
    design = file.design
    coil = design.array.names[0] if len(design.array.names) == 1 else ranges.neighbours(design).names[0]
    wanted = {f"inductance_uH[{coil}]": (1.0, "at_least", "as much as it is; another one can be asked for here")}
    if len(design.array.names) > 1:
        wanted["worst_k"] = (1.0, "at_most", "no more coupling than it is")
    wanted["q"] = (_Q_LESS, "at_least", "four fifths of what it is, as narrow traces cost Q")
    constraints = [_fab(file)]
    for quantity, (part, side, says) in wanted.items():
        try:
            now = evaluate(design, [quantity])[quantity]
        except NetworkError:  # no converter oscillates with it: nothing to keep
            continue
        constraints.append(({"quantity": quantity, side: rounded(part * now, 3, up=side == "at_most")}, says))
    return _Part(
        [({"quantity": "board_area_mm2", "direction": "minimize"}, "")],
        constraints,
        ["span_mm"],
        trials=100,
        polish=40,
    )


def _distances(file: DesignFile) -> list[Range]:
    """Ranges of the pitch, or of the sizes if each coil has its own place."""
    return ranges.pitch_ranges(file) or ranges.size_ranges(file)


def _sizes(file: DesignFile) -> list[Range]:
    return [*ranges.pitch_ranges(file), *ranges.size_ranges(file), *ranges.turns_ranges(file)]


def _of_traces(file: DesignFile) -> list[Range]:
    return [*ranges.size_ranges(file), *ranges.turns_ranges(file), *ranges.trace_ranges(file)]


def _fab(file: DesignFile) -> tuple[dict[str, Any], str]:
    """Bound of the fabrication margin, with its reason."""
    margin = evaluate(file.design, ["fab_margin_mm"])["fab_margin_mm"]
    if margin < _KEPT:
        least, says = rounded(_WORSE * margin, 3, up=False), "no worse than it is: the design itself breaks a rule"
    else:
        least, says = _KEPT, "no trace, gap or hole nearer to its limit in [fab] than the check takes as kept"
    return {"quantity": "fab_margin_mm", "at_least": least}, says


def _areas(file: DesignFile) -> list[tuple[dict[str, Any], str]]:
    """Bounds of board area and covered area, with their reasons."""
    now = evaluate(file.design, ["board_area_mm2", "covered_mm2"])
    board = rounded(_AREA_MORE * now["board_area_mm2"], 3, up=True)
    covered = rounded(_COVERED_LESS * now["covered_mm2"], 3, up=False)
    return [
        (
            {"quantity": "board_area_mm2", "at_most": board},
            f"a quarter more board than the {now['board_area_mm2']:.0f} mm² that it has",
        ),
        (
            {"quantity": "covered_mm2", "at_least": covered},
            f"a twentieth less than the {now['covered_mm2']:.0f} mm² that its coils cover",
        ),
    ]


_NAMED: Mapping[str, _Named] = {
    "worst_k": _Named(
        "Less coupling between any two coils", ranges.neighbours,
        lambda file: [*_distances(file), *ranges.layer_choices(file)], _worst_k,
    ),
    "decouple": _Named("Neighbours without coupling", ranges.neighbours, _distances, _decouple),
    "position_error": _Named(
        "Positions best resolved", _three_states,
        lambda file: [*ranges.pitch_ranges(file), *ranges.turns_ranges(file), *ranges.termination_choices(file)],
        _position_error,
    ),
    "smallest": _Named(
        "The smallest board for its inductance", lambda _: None,
        lambda file: [
            *ranges.size_ranges(file), *ranges.pitch_ranges(file), *ranges.turns_ranges(file),
            *ranges.trace_ranges(file),
        ],
        _smallest,
    ),
    "range": _Named("Largest range of a target", _target, _of_traces, _range),
    "resolution": _Named("Finest resolution of distance", _target, _of_traces, _resolution),
}  # fmt: skip
NAMES: Mapping[str, str] = {name: named.title for name, named in _NAMED.items()}
"""Goals that fit many designs, by name, each with a description. See `unfit_goals`."""
