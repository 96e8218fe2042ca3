"""All quantities by name, and their values for a design."""

import difflib
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from types import MappingProxyType
from typing import Any

import numpy as np
import shapely
import xarray as xr
from scipy.interpolate import CubicSpline

from coilarray.circuit.converter_limits import DRIVE_WINDOW, channels_of, check_channel
from coilarray.circuit.ports import solve_ports
from coilarray.compute.arrays import FloatArray
from coilarray.design.model import Design, one_board
from coilarray.electromagnetics.inductance import Accuracy
from coilarray.errors import GoalError, listed, shown
from coilarray.geometry import Plate
from coilarray.localize.forward import forward_model
from coilarray.localize.identifiability import identifiability
from coilarray.paper.distortion import DELTAS, ellipse_curves
from coilarray.response.dataset import from_board
from coilarray.response.interpolation import even_row
from coilarray.response.target import FACTOR, ranges_of
from coilarray.studies.quantities.evaluation import (
    Evaluation,
    Option,
    Quantity,
    Request,
    read_name,
    read_number,
    read_pair,
    read_positive,
    read_rectangle,
)

LENGTH_RULES = (  # rules whose margin is a length
    "trace width", "spacing within net", "clearance", "annular ring", "drill", "hole spacing", "edge clearance",
    "copper thickness", "board size",
)  # fmt: skip
FARTHEST = 9.0  # margin in limits above which a distance is not measured
COIL = Option("coil", "the name of a coil", read_name, "which coil", required=True, bare=True)
"""Name of one coil, which is required."""


def coil_or(says: str) -> Option:
    """Option for a coil's name that is not required."""
    return Option("coil", COIL.must_be, read_name, f"which coil; {says} by default", bare=True)


def _board_area(evaluation: Evaluation, options: Mapping[str, Any]) -> float:
    x_min, y_min, x_max, y_max = one_board(evaluation.design, "board_area_mm2").array.bounds
    return (x_max - x_min) * (y_max - y_min) * 1e6


def _covered(evaluation: Evaluation, options: Mapping[str, Any]) -> float:
    placements = one_board(evaluation.design, "covered_mm2").array.placements
    shapes = [shapely.Polygon(place.to_board(place.coil.outline)) for place in placements]
    return float(shapely.area(shapely.union_all(shapes))) * 1e6


def _fab_margin(evaluation: Evaluation, options: Mapping[str, Any]) -> float:
    wanted = options.get("rule")
    margins = [m.margin * 1e3 for m in evaluation.margins if m.unit == "m" and wanted in (None, m.rule)]
    rules = evaluation.design.rules
    limits = {"clearance": rules.min_gap, "spacing within net": rules.min_gap, "hole spacing": rules.min_hole_spacing}
    if wanted in limits:  # distances far beyond the limit are not listed
        margins.append(FARTHEST * limits[wanted] * 1e3)
    if not margins:
        raise GoalError(f"the rules of {evaluation.design.name} do not limit its {wanted}.")
    return min(margins)


def _pairs(evaluation: Evaluation) -> FloatArray:
    count = len(evaluation.design.coil_names)
    if count < 2:
        raise GoalError(f"the design {evaluation.design.name} has only one coil, and so no coupling.")
    return np.asarray(evaluation.coupling[np.triu_indices(count, 1)])


def _link(evaluation: Evaluation) -> xr.Dataset:
    if not any(port.resistance is not None for port in evaluation.design.circuit.ports):
        raise GoalError(f"{evaluation.design.name} has no circuit.ports with a source or a load.")
    return solve_ports(evaluation.design, accuracy=evaluation.accuracy).isel(frequency=0)


def _link_efficiency(evaluation: Evaluation, options: Mapping[str, Any]) -> float:
    solved = _link(evaluation)
    if "efficiency" not in solved:
        raise GoalError(f"the circuit.ports of {evaluation.design.name} need a source_ohm and a load_ohm.")
    return float(solved.efficiency.min())


def _link_reflection(evaluation: Evaluation, options: Mapping[str, Any]) -> float:
    solved = _link(evaluation)
    return float(np.diagonal(np.hypot(solved.s_real, solved.s_imag)).max())


def _of_state(name: str, unit: str, variable: str, scale: float, says: str) -> Quantity:

    def of_state(evaluation: Evaluation, options: Mapping[str, Any]) -> float:
        return float(evaluation.scan[variable].values[evaluation.state_of(options["coil"])]) * scale

    return Quantity(name, unit, "circuit", says, of_state, (COIL,))


def _quality(evaluation: Evaluation, options: Mapping[str, Any]) -> float:
    quality = evaluation.scan.quality_factor.values
    return float(quality[evaluation.state_of(options["coil"])] if "coil" in options else quality.min())


def _drive_margin(evaluation: Evaluation, options: Mapping[str, Any]) -> float:
    if not evaluation.design.readout.is_judged:
        raise GoalError(f'no converter drives {evaluation.design.name}, which has readout.converter = "none".')
    margins = []
    for _, *state in channels_of(evaluation.scan):
        window = next(limit for limit in check_channel(*state) if limit.name == DRIVE_WINDOW)
        margins.append(min(window.value / window.low - 1, 1 - window.value / window.high))
    return min(margins)


def _unread(evaluation: Evaluation, options: Mapping[str, Any]) -> float:
    if not evaluation.unread and evaluation.design.readout.is_judged:
        _ = evaluation.scan  # which updates the count
    return float(sum(evaluation.unread))


COILS = (  # quantities by rising cost
    Quantity("board_area_mm2", "mm²", "geometry", "area of the rectangular board", _board_area),
    Quantity("span_mm", "mm", "geometry", "extent of the windings' outlines along x",
             lambda one, _: float(np.ptp(one_board(one.design, "span_mm").array.outline_bounds[::2])) * 1e3),
    Quantity("covered_mm2", "mm²", "geometry", "area within the outline of at least one winding", _covered),
    Quantity(
        "fab_margin_mm", "mm", "geometry",
        "smallest margin of the fabrication rules about lengths, negative where broken; the check takes more than "
        "-0.001 as kept", _fab_margin,
        (Option("rule", f"one of {', '.join(LENGTH_RULES)}",
                lambda given: read_name(given) if given in LENGTH_RULES else None,
                "this rule alone; distances count up to nine times their limit. All by default", bare=True),),
    ),
    Quantity(
        "fab_broken", "1", "geometry",
        "number of broken fabrication rules, layers and nets apart; counts and ratios too",
        lambda evaluation, _: float(sum(not margin.kept for margin in evaluation.margins)),
    ),
    Quantity(
        "rms_k", "1", "coupling", "root mean square of the coupling coefficients of all pairs",
        lambda evaluation, _: float(np.sqrt(np.mean(_pairs(evaluation) ** 2))),
    ),
    Quantity(
        "worst_k", "1", "coupling", "largest |k| of all pairs",
        lambda evaluation, _: float(np.abs(_pairs(evaluation)).max()),
    ),
    Quantity(
        "k", "1", "coupling", "coupling coefficient of one pair, with its sign",
        lambda evaluation, options: float(evaluation.coupling[tuple(map(evaluation.coil, options["coils"]))]),
        (Option("coils", "the names of two coils", read_pair, "which pair", required=True, bare=True),),
    ),
    Quantity(
        "inductance_uH", "µH", "coupling", "self-inductance with sheets and plates, others open",
        lambda evaluation, options: float(evaluation.inductance.diagonal()[evaluation.coil(options["coil"])]) * 1e6,
        (COIL,),
    ),
    Quantity(
        "link_efficiency", "1", "coupling",
        "power in a load over that which enters at a source of circuit.ports, least of all pairs", _link_efficiency,
    ),
    Quantity("link_reflection", "1", "coupling", "|S| at the ports of the link's frequency, largest", _link_reflection),
    _of_state(
        "effective_inductance_uH", "µH", "effective_inductance", 1e6,
        "inductance of a measured coil, its neighbours terminated as the scan has them",
    ),
    _of_state("effective_resistance_ohm", "Ω", "effective_resistance", 1.0,
              "AC resistance of a measured coil at its resonance"),
    _of_state("parallel_resistance_kohm", "kΩ", "parallel_resistance", 1e-3,
              "R_p of a measured coil with the tank at its resonance"),
    _of_state("frequency_MHz", "MHz", "frequency", 1e-6, "resonance of a measured coil with the tank"),
    _of_state("self_resonance_MHz", "MHz", "state_self_resonance", 1e-6,
              "self-resonance of a measured coil, without the tank"),
    Quantity("q", "1", "circuit", "quality factor of a measured coil with AC resistance", _quality,
             (coil_or("the worst state"),)),
    Quantity(
        "srf_margin", "1", "circuit", "self-resonance over frequency, worst state",
        lambda evaluation, _: float((evaluation.scan.state_self_resonance / evaluation.scan.frequency).min()),
    ),
    Quantity(
        "drive_margin", "1", "circuit",
        "relative distance of R_p to the nearer end of the LDC1614's window of 1 to 100 kΩ, worst state; negative "
        "outside", _drive_margin,
    ),
    Quantity(
        "converter_unread", "1", "circuit",
        "number of values that no LDC1614 can read, of those that the other quantities come from, or of the states",
        _unread,
    ),
)  # fmt: skip


_STEPS = 8  # positions of a line in the thickness of all sheets
# Against half the spacing and twice the depths the medians of σ_x are accurate to 1 % and the
# medians of σ_h to 3 % , and from one mesh to the next they scatter by less.
_TABLE_STEPS = 6  # positions of the table in the thickness of all sheets
_DEPTHS = (0.85, 1.0, 1.15)  # of the table, relative to the requested depth; δ = 0 at the depth 0 too
_PLACES = (40, 20)  # of the median; even numbers leave out the middle line of a board, where y is not determined
_DEPTH = Option("depth_mm", "a number of mm above 0", read_positive, "how deep; the design's first depth by default")
_DISTANCE = Option(
    "distance_mm", "a number of mm above 0", read_positive, "how far; the design's least distance by default"
)
_PLACE = tuple(
    Option(f"{axis}_mm", "a number of mm", read_number, f"{axis} of the target on the board; over the coil by default")
    for axis in "xy"
)
_OVER = (_DISTANCE, *_PLACE)


def _noise(of: str) -> Option:
    says = f"standard deviation of {of}; by default that of the noise budget"
    return Option("noise", "a number above 0", read_positive, says)


def _peak_delta(evaluation: Evaluation, options: Mapping[str, Any]) -> float:
    depth = evaluation.depth(options.get("depth_mm"))
    if "coil" in options:
        state, (x, y) = evaluation.state_of(options["coil"]), evaluation.centre(options["coil"])
        return float(_line(evaluation, y, depth, x)(x)[state])
    centres = evaluation.design.array.centres - evaluation.indentation.origin_point
    x, y = ((centres.min(axis=0) + centres.max(axis=0)) / 2).tolist()
    return float(_line(evaluation, y, depth, x)(x).max())


def _response_width(evaluation: Evaluation, options: Mapping[str, Any]) -> float:
    name = options["coil"]
    state, (x, y) = evaluation.state_of(name), evaluation.centre(name)
    line = _line(evaluation, y, evaluation.depth(options.get("depth_mm")), x)
    delta = CubicSpline(line.x, line(line.x)[:, state], extrapolate=False)
    turning = delta.derivative().roots()
    tops = delta(turning[np.isfinite(turning)])  # a spline that is zero somewhere has roots there that are NaN
    if not tops.size or tops.max() <= 0:
        raise GoalError(f"{name} of {evaluation.design.name} has no response with a peak.")
    half = float(tops.max()) / 2
    if max(delta(line.x[[0, -1]])) >= half:
        raise GoalError(f"δ of {name} does not fall to half its peak on both sides within the sample.")
    return float(np.ptp(delta.solve(half))) * 1e3


def _x0_distortion(evaluation: Evaluation, options: Mapping[str, Any]) -> float:
    setup, given = evaluation.indentation.in_ellipse_window(), options.get("coil")
    if given is not None:
        evaluation.state_of(given)  # refused before the map is computed
    response = evaluation.response(np.array(setup.depths[:1]), np.array(setup.x), np.array(setup.y))
    coils: list[str] = [] if given is None else [given]
    near = np.diff(response.y.values).min(initial=np.inf) / 2
    if given is None:  # those on the x axis that peak inside the map
        for name, state in evaluation.own_states.items():
            hill = response.delta.values[0, :, :, state]
            row, column = np.unravel_index(int(np.argmax(hill)), hill.shape)
            within = 0 < row < hill.shape[0] - 1 and 0 < column < hill.shape[1] - 1
            if within and abs(evaluation.centre(name)[1]) <= near:
                coils.append(name)
    if not coils:
        raise GoalError(
            f"no coil of {evaluation.design.name} is on the x axis of its map with the largest δ inside the map."
        )
    states = [str(response.state.values[evaluation.state_of(coil)]) for coil in coils]
    curves = ellipse_curves(response, states, DELTAS)
    rms = []
    for coil, x0 in zip(coils, curves.determined_x0, strict=True):
        there = x0[np.isfinite(x0)] - evaluation.centre(coil)[0]
        if there.size:
            rms.append(math.sqrt(float(np.mean(there**2))) * 1e3)
    if not rms:
        raise GoalError(f"the map of {evaluation.design.name} has no ellipses between δ = 1e-4 and 1e-3.")
    return max(rms)


def _line(evaluation: Evaluation, y: float, depth: float, through: float) -> CubicSpline:
    """Spline of δ over x in m up to `through`."""
    thickness = evaluation.design.top
    low, high, _, _ = evaluation.window(depth, beyond=thickness)
    if not low <= through <= high:
        raise GoalError(
            f"the indenter at x = {through * 1e3:.4g} mm is outside the sample of {evaluation.design.name}."
        )
    x = np.linspace(low, high, math.ceil(_STEPS * (high - low) / thickness) + 4)
    response = evaluation.response(np.array([depth]), x, np.array([y]))
    return CubicSpline(x, response.delta.values[0, 0])


def _median(evaluation: Evaluation, options: Mapping[str, Any], name: str) -> float:
    """Median over a region of the standard deviation in mm."""
    depth = evaluation.depth(options.get("depth_mm"))
    given = options.get("region_mm")
    if given is None:
        x_min, x_max, y_min, y_max = evaluation.window(_DEPTHS[-1] * depth)
    else:
        edges, origin = [edge * 1e-3 for edge in given], evaluation.indentation.origin_point
        (x_min, x_max), (y_min, y_max) = from_board(edges[:2], origin[0]), from_board(edges[2:], origin[1])
    step = evaluation.design.top / _TABLE_STEPS
    table = evaluation.response(depth * np.array(_DEPTHS), even_row(x_min, x_max, step), even_row(y_min, y_max, step))
    x, y = (  # the middles of equal parts
        low + (high - low) * (np.arange(count) + 0.5) / count
        for low, high, count in zip((x_min, y_min), (x_max, y_max), _PLACES, strict=True)
    )
    bound = identifiability(forward_model(table), depth, noise=options.get("noise"), x=x, y=y)
    median = float(np.median(bound[name].values)) * 1e3
    if math.isinf(median):
        raise GoalError(
            f"the readings of {evaluation.design.name} do not determine the position and depth of the indenter."
        )
    return median


def _with_target(name: str, unit: str, variable: str, scale: float, says: str) -> Quantity:

    def with_target(evaluation: Evaluation, options: Mapping[str, Any]) -> float:
        at = evaluation.taken(_over(evaluation, options, [evaluation.distance(options.get("distance_mm"))]))
        return scale * float(at[variable].item())

    return Quantity(name, unit, "target", f"{says}, with the target at a distance", with_target, (COIL, *_OVER))


def _ranges(
    evaluation: Evaluation, options: Mapping[str, Any], wanted: float | None = None
) -> tuple[xr.Dataset, xr.Dataset]:
    distances = sorted({*evaluation.target.distances, *([] if wanted is None else [wanted])})
    if len(distances) < 2:
        raise GoalError(
            f"range and deviation need at least two distances of the target; {evaluation.design.name} has one."
        )
    known = _over(evaluation, options, distances)
    return known, ranges_of(known, options.get("noise", known.attrs["sigma"]))


def _target_range(evaluation: Evaluation, options: Mapping[str, Any]) -> float:
    value = float(_ranges(evaluation, options)[1].range.item())
    if math.isnan(value):
        raise GoalError(
            f"{options['coil']} of {evaluation.design.name} does not detect the target at any distance that the "
            "converter reads."
        )
    return value * 1e3


def _deviation(evaluation: Evaluation, options: Mapping[str, Any]) -> float:
    distance = evaluation.distance(options.get("distance_mm"))
    known, found = _ranges(evaluation, options, distance)
    value = float(found.distance_deviation.values[np.abs(known.distance.values - distance).argmin(), 0])
    if math.isnan(value):
        raise GoalError(
            f"the converter does not read {options['coil']} of {evaluation.design.name} with the target at "
            f"{distance * 1e3:g} mm, or at no other of its distances."
        )
    return value * 1e6


def _over(evaluation: Evaluation, options: Mapping[str, Any], distances: Sequence[float]) -> xr.Dataset:
    """Map of a coil's state at distances and a place."""
    name, target = options["coil"], evaluation.target
    state = evaluation.state_of(name)
    place = evaluation.design.array.centres[evaluation.coil(name)]
    if isinstance(target.body, Plate):
        place = np.array(target.origin_point)
    at = [options.get("x_mm"), options.get("y_mm")]
    places = [float(middle) if given is None else given * 1e-3 for middle, given in zip(place, at, strict=True)]
    (x,), (y,) = (from_board([one], origin) for one, origin in zip(places, target.origin_point, strict=True))
    return evaluation.target_map(distances, x, y).isel(state=[state])


_REGION = (
    Option("region_mm", "[x_min, x_max, y_min, y_max] in mm, rising", read_rectangle,
           "where on the board; over the outlines of all coils by default"),
    _DEPTH, _noise("every δ"),
)  # fmt: skip
_TARGET_NOISE = _noise("δ in a reading")
RESPONSES = (  # quantities by rising cost
    _with_target("target_delta", "1", "delta", 1.0, "relative change of a coil's inductance"),
    _with_target("target_inductance_uH", "µH", "effective_inductance", 1e6, "inductance of a measured coil"),
    _with_target("target_resistance_ohm", "Ω", "effective_resistance", 1.0, "AC resistance of a measured coil"),
    _with_target("target_frequency_MHz", "MHz", "frequency", 1e-6, "resonance of a measured coil with the tank"),
    _with_target("target_q", "1", "quality_factor", 1.0, "quality factor of a measured coil"),
    _with_target("target_parallel_resistance_kohm", "kΩ", "parallel_resistance", 1e-3, "R_p of a measured coil"),
    Quantity(
        "target_range_mm", "mm", "target",
        f"distance at which |δ| of a coil has fallen to {FACTOR:g} times the noise; the design's last one where it "
        "has not", _target_range, (COIL, *_PLACE, _TARGET_NOISE),
    ),
    Quantity(
        "target_deviation_um", "µm", "target", "standard deviation of a distance from one reading", _deviation,
        (COIL, *_OVER, _TARGET_NOISE),
    ),
    Quantity(
        "peak_delta", "1", "response",
        "δ of a coil pressed at its centre, or the largest δ pressed at the middle of the array", _peak_delta,
        (coil_or("the array"), _DEPTH),
    ),
    Quantity(
        "response_width_mm", "mm", "response",
        "distance along x, through the coil's centre, of the first and the last place with half the maximum of δ",
        _response_width, (COIL, _DEPTH),
    ),
    Quantity(
        "x0_distortion_mm", "mm", "response",
        "root mean square over δ = 1e-4 to 1e-3 of fitted x0 less the coil's centre, where determined, in its map",
        _x0_distortion, (coil_or("the worst of those in the map"),),
    ),
    Quantity(
        "position_error_mm", "mm", "table",
        "least standard deviation of x, the depth unknown too: Cramér–Rao bound, median over a region",
        lambda evaluation, options: _median(evaluation, options, "sigma_x"), _REGION,
    ),
    Quantity(
        "depth_error_mm", "mm", "table",
        "least standard deviation of the depth: Cramér–Rao bound, median over a region",
        lambda evaluation, options: _median(evaluation, options, "sigma_h"), _REGION,
    ),
)  # fmt: skip


QUANTITIES: Mapping[str, Quantity] = MappingProxyType({one.name: one for one in (*COILS, *RESPONSES)})
"""Every quantity by its name, the cheap quantities first."""
_TEXT = re.compile(r"([^\[\]]*)(?:\[([^\[\]]*)\])?")


_SYMBOLS = {"L": "inductance_uH", "f": "frequency_MHz", "R": "effective_resistance_ohm", "δ": "peak_delta"}
"""Quantities by their letters in reports, for hints."""


def request(asked: str | Mapping[str, Any]) -> Request:
    """Read a quantity with options from a text or table.

    Missing coils of a design are found when it is evaluated.

    >>> request({"quantity": "k", "coils": ["coil1", "coil2"]}).key
    'k[coil1,coil2]'
    >>> request("position_error_mm[noise=0.00001,depth_mm=1.0]").key
    'position_error_mm[depth_mm=1,noise=1e-05]'
    """
    if isinstance(asked, Mapping):
        options = dict(asked)
        name = options.pop("quantity", None)
        return _quantity(name).asked(options)
    if not isinstance(asked, str) or (found := _TEXT.fullmatch(asked.strip())) is None:
        raise GoalError(f"a quantity must be a name, with options in brackets, such as k[coil1,coil2]; got {asked!r}.")
    quantity = _quantity(found[1].strip())
    return quantity.asked({} if found[2] is None else _options(quantity, found[2]))


def canonical(asked: str | Mapping[str, Any]) -> str:
    """Canonical text of a request, the key of `evaluate`."""
    return request(asked).key


def evaluate(
    design: Design, asked: Iterable[str | Mapping[str, Any]], *, accuracy: Accuracy = "full"
) -> dict[str, float]:
    """Compute quantities of a design by key, always finite.

    >>> from coilarray import load_design
    >>> found = evaluate(load_design("gast2020"), ["worst_k", "k[coil1,coil3]", "span_mm"])
    >>> {key: round(value, 3) for key, value in found.items()}
    {'worst_k': 0.081, 'k[coil1,coil3]': -0.027, 'span_mm': 89.4}
    """
    requests = [request(one) for one in asked]
    evaluation = Evaluation(design, accuracy)
    return {one.key: one.value(evaluation) for one in requests}


def _quantity(name: object) -> Quantity:
    if isinstance(name, str) and name in QUANTITIES:
        return QUANTITIES[name]
    if not name:
        raise GoalError(f"the name of a quantity is missing; there are {listed(QUANTITIES)}.")
    text = str(name).casefold()
    within = [key for key in QUANTITIES if text == key.casefold() or (len(text) > 2 and text in key.casefold())]
    close = within or difflib.get_close_matches(text, list(QUANTITIES), n=1)
    meant = sorted(close, key=lambda key: (key.startswith("target_"), len(key)))[:3]
    meant = [_SYMBOLS[str(name)]] if str(name) in _SYMBOLS else meant
    hint = f"; did you mean {', '.join(meant)}?" if meant else "."
    known = f"coilarray optimize --list-quantities shows all {len(QUANTITIES)}."
    raise GoalError(f"there is no quantity {shown(name)}{hint} {known}")


def _options(quantity: Quantity, text: str) -> dict[str, Any]:
    """Options of the text in brackets, the bare without name."""
    options: dict[str, Any] = {}
    nameless: list[str] = []
    for part in (part.strip() for part in text.split(",")):
        name, equals, value = (piece.strip() for piece in part.partition("="))
        if not equals:
            nameless.append(part)
        elif name in options:
            raise GoalError(f"{quantity.name}: {name} must be given once; got {text!r}.")
        else:
            options[name] = value
    bare = [option.name for option in quantity.options if option.bare]
    if nameless:
        if not bare or bare[0] in options:
            raise GoalError(f"{quantity.name}: options must be given as name=value; got {nameless[0]!r}.")
        options[bare[0]] = nameless if len(nameless) > 1 else nameless[0]
    return options
