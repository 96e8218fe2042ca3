"""Spread over boards around the design, and randomly drawn boards.

With the outputs q, the errors e of the board and independent contributors c that move the errors
equally,

    q ≈ q₀ + Σ_c J_c c,   J_c = Σ_(e moved by c) ∂q/∂e,   var q = Σ_c (J_c σ_c)².

Positions are found with the response table of the nominal board. The board reads δ + Δδ. Near the
truth the table has the likelihood of a linear model with J = ∂δ/∂(x, y, depth). With the covariance
Σ of the noise its maximum is shifted by (JᵀΣ⁻¹J)⁻¹ JᵀΣ⁻¹ Δδ. Unknowns that the reading hardly
determines, such as y on the middle line of a symmetric board, are left out of J, so they are taken
as known.
"""

import math
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from itertools import combinations, product
from typing import Any

import numpy as np
import xarray as xr
from scipy.stats import binomtest

from coilarray.circuit.coupling import provenance
from coilarray.compute.arrays import BoolArray, FloatArray
from coilarray.compute.memory import require_memory
from coilarray.compute.store import Store
from coilarray.compute.threads import Progress
from coilarray.compute.workers import open_executor
from coilarray.design.model import Design, DesignFile, build_design
from coilarray.design.write import as_file
from coilarray.electromagnetics.inductance import Accuracy
from coilarray.errors import GoalError, LocalizeError
from coilarray.localize.forward import ForwardModel, forward_model, require_states, table_for, table_grid, whitening_of
from coilarray.localize.identifiability import covariance_of, fisher_information
from coilarray.localize.inverse import locate_all
from coilarray.response.interpolation import PARAMETERS
from coilarray.studies.quantities import QUANTITIES, Evaluation, canonical, request
from coilarray.studies.sweep import Outcome, run_cached
from coilarray.studies.tolerance.tolerances import (
    UNITS,
    Contributor,
    Limit,
    Positions,
    Tolerances,
    contributors,
    draw,
    errors_of,
    perturb,
)

UNREAD = "unread values"  # name of an outcome that is not an output
LEAST_SAMPLES = 8  # smallest number of boards for a sampled spread
_MOST_OF_ALL_PAIRS = 7  # coils, of which all pairs still make a readable table
_LEAST_KNOWN = 0.5  # of the thickness of all sheets, a length over which δ changes much and nothing is linear
_STEP = 0.5  # half width of the central differences in standard deviations
_LINEAR_SAMPLES = 1 << 16  # of the linear model, for its yield: errs by less than 1e-3
_ENOUGH = 32  # values whose fourth moment is known to better than its own size, in a normal distribution
_CENTRAL = (2.5, 97.5)  # percentiles between which 95 % of the boards lie


def default_quantities(design: Design) -> tuple[str, ...]:
    """Names of all inductances, and of all or neighbours' couplings."""
    coils = design.coil_names
    few = len(coils) <= _MOST_OF_ALL_PAIRS or bool(design.boards)
    of = combinations(range(len(coils)), 2) if few else sorted(design.array.neighbours)
    pairs = tuple(f"k[{coils[i]},{coils[j]}]" for i, j in of)
    return (*(("worst_k", "rms_k") if pairs else ()), *(f"inductance_uH[{coil}]" for coil in coils), *pairs)


@dataclass(frozen=True)
class Outputs:
    """Outputs by canonical names: quantities, and δ at positions."""

    quantities: tuple[str, ...]
    positions: Positions | None = None
    accuracy: Accuracy = "screen"

    def names(self, design: Design) -> tuple[str, ...]:
        """Names of quantities, then of δ by place and state."""
        states = [state.name for state in design.plan]
        deltas = [f"delta[{state},{place}]" for place in self.places() for state in states]
        return (*self.quantities, *deltas)

    def places(self) -> tuple[str, ...]:
        """Positions as they appear in names of outputs."""
        at = self.positions
        if at is None:
            return ()

        def mm(length: float) -> str:
            return f"{round(length * 1e3, 6):g}"  # to the nanometre

        return tuple(f"x_mm={mm(x)},y_mm={mm(y)},depth_mm={mm(at.depth)}" for y, x in product(at.y, at.x))


def evaluate_board(item: Mapping[str, Any]) -> dict[str, float]:
    """Compute the outputs of one board, on a worker."""
    # `UNREAD` among them is the number of values that no converter can read.
    document, outputs = item["document"], item["outputs"]
    board = perturb(build_design(document, document["name"]), item["errors"])
    evaluation = Evaluation(board, outputs.accuracy)
    values = {name: request(name).value(evaluation) for name in outputs.quantities}
    if (at := outputs.positions) is not None:
        response = evaluation.response(np.array([at.depth]), np.array(at.x), np.array(at.y))
        names = outputs.names(board)[len(outputs.quantities) :]
        values |= dict(zip(names, response.delta.values[0].ravel().tolist(), strict=True))
    return {**values, UNREAD: float(sum(evaluation.unread))}


def analyse(
    design: Design | DesignFile,
    tolerances: Tolerances,
    *,
    quantities: Sequence[str] = (),
    samples: int = 64,
    seed: int = 0,
    accuracy: Accuracy = "screen",
    table: xr.Dataset | None = None,
    workers: int | Executor = 1,
    cache: Store | None = None,
    progress: Progress | None = None,
) -> xr.Dataset:
    """Compute the spread of quantities over boards of a design with errors.

    `quantities` are by default of the `tolerances`, otherwise `default_quantities`, and of the
    limits. `samples` is the number of drawn boards, 0 or at least 8, with `seed` as in `draw`. The
    `accuracy` ``screen`` shifts values by 1e-4 of L and 5e-5 in k, the same for all boards, so
    their spread is accurate to 1 %. `table` is the response table for locating positions, from
    `table_for`, by default computed. `workers` are a number of local processes or an executor.
    `cache` keeps the boards. `progress` is called with (done, total). Raises GoalError if
    `check_analysis` refuses the arguments, or a board next to the nominal board is impossible, and
    CoilarrayError if the nominal board cannot be solved.

    The result is over ``output``, quantities in the units of their names, δ by place and state and
    shifts of the located position in mm, and over ``contributor``, the errors:

    - ``nominal`` and ``linear_deviation`` of each output.
    - ``effect`` of one standard deviation and ``share`` of the variance (contributor, output).
    - ``deviation``, ``unit``, ``table``, ``part`` and ``distribution`` of each contributor, with a
      reason.
    - With samples ``error`` (sample, contributor) and ``value`` (sample, output), NaN if a board
      has no value or a reading has no position, with the cause in ``failure``; ``sample_mean``,
      ``sample_deviation`` with its standard error, its ``ratio`` to the linear deviation, and
      ``percentiles``. ``unread`` marks boards that no converter reads.
    - For each ``limit`` and last for all together ``linear_yield`` and, with samples,
      ``sample_yield`` with its interval. A board that cannot be made keeps no limit, and a board
      that no converter can read none on read quantities. The linear model includes neither effect.

    >>> from coilarray import load_design
    >>> from coilarray.studies.tolerance import Spread, Tolerances
    >>> thickness = Tolerances({"dielectric": Spread(board=0.02)})
    >>> result = analyse(load_design("gast_fem"), thickness, samples=0)
    >>> result.output.item(), round(float(result.linear_deviation[0] / result.nominal[0]), 5)
    ('inductance_uH[coil1]', 0.00051)
    """
    file = as_file(design)
    design = file.design
    found, outputs, limits, drawn = _asked(design, tolerances, quantities, samples, seed, accuracy)
    if table is None:
        _check_places(design, outputs)
    shifts, outs = None, outputs.names(design)
    names = outs
    if outputs.positions is not None:
        model = forward_model(table_for(design) if table is None else table)
        shifts = shifts_at(model, outputs.positions, _LEAST_KNOWN * design.top)
        names = (*outs, *shifts.names(outputs.places()))
    _check_limits(limits, names)

    variances: dict[str, float] = {}
    for one in found:
        for target in one.targets:
            variances[target] = variances.get(target, 0.0) + one.deviation**2
    steps = {target: _STEP * math.sqrt(variance) for target, variance in variances.items()}
    around = [{name: sign * step} for name, step in steps.items() for sign in (1.0, -1.0)]
    boards = [{}, *around, *(errors_of(found, row) for row in drawn)]
    bare = replace(outputs, positions=outputs.positions and replace(outputs.positions, noise=None))
    items = [{"document": file.document, "errors": errors, "outputs": bare} for errors in boards]
    outcomes: list[Outcome] = [""] * len(boards)
    with open_executor(workers) as executor:
        for k, outcome in run_cached(evaluate_board, items, executor, cache, progress=progress, total=len(boards)):
            if k == 0 and isinstance(outcome, str):
                raise GoalError(outcome)  # no board at all
            outcomes[k] = outcome
    near, taken = outcomes[: 1 + len(around)], outcomes[1 + len(around) :]
    rows = []
    for outcome, errors in zip(near, boards, strict=False):
        if isinstance(outcome, str):
            ((name, value),) = errors.items()
            raise GoalError(
                f"the board with {name} {value:+.3g}, one standard deviation or less, cannot be made: {outcome}"
            )
        rows.append([outcome[name] for name in outs])
    nominal, beside = np.array(rows[0]), np.array(rows[1:])  # above and below of each step in turn
    slopes = (beside[::2] - beside[1::2]) / (2 * np.array(list(steps.values())))[:, None]
    moved = np.zeros((len(found), len(steps)))
    for k, one in enumerate(found):
        moved[k, [list(steps).index(target) for target in one.targets]] = one.deviation
    effects = np.asarray(moved @ slopes)  # J_c σ_c
    sampled = np.array([[np.nan] * len(nominal) if isinstance(o, str) else [o[name] for name in outs] for o in taken])
    sampled = sampled.reshape(samples, len(nominal))
    located: dict[str, str] = {}
    if shifts is not None:
        nominal, effects, sampled, located = _with_shifts(shifts, outputs, nominal, effects, sampled)
    result = _linear_part(names, found, tolerances, nominal, effects)
    if samples:
        failures = [outcome if isinstance(outcome, str) else "" for outcome in taken]
        result = result.merge(_sampled_part(result, drawn, sampled, failures))
    unread = [not isinstance(one, str) and one.get(UNREAD, 0.0) > 0 for one in (near[0], *taken)]
    if limits:
        result = result.merge(
            _yields(limits, names, found, nominal, effects, sampled, np.array(unread[1:], dtype=bool))
        )
    if any(unread):
        words = {"long_name": "whether no converter can read the board"}
        result = result.assign(unread=("sample", np.array(unread[1:], dtype=np.bool_), words)) if samples else result
        located["not_read"] = (
            f"{'the' if unread[0] else 'not the'} nominal board, {sum(unread[1:])} of {samples} drawn ones"
        )
    about = {"seed": seed, "accuracy": accuracy, "boards": len(boards)}
    return result.assign_attrs({**provenance(design), **about, **located})


def check_analysis(
    design: Design | DesignFile,
    tolerances: Tolerances,
    *,
    quantities: Sequence[str] = (),
    samples: int = 64,
    seed: int = 0,
    accuracy: Accuracy = "screen",
    with_table: bool = False,
) -> None:
    """Check the arguments of `analyse`, within milliseconds."""
    # No table or board is computed, so `analyse` finds more errors. Without a response table, positions must lie in
    # the table that will be computed.
    design = as_file(design).design
    _, outputs, limits, _ = _asked(design, tolerances, quantities, samples, seed, accuracy)
    shifts = [f"shift_{parameter}_mm[{place}]" for place in outputs.places() for parameter in PARAMETERS]
    _check_limits(limits, (*outputs.names(design), *shifts))
    if not with_table:
        _check_places(design, outputs)


def _asked(
    design: Design, tolerances: Tolerances, quantities: Sequence[str], samples: int, seed: int, accuracy: Accuracy
) -> tuple[Sequence[Contributor], Outputs, list[Limit], FloatArray]:
    if 0 < samples < LEAST_SAMPLES:
        raise GoalError(f"samples must be 0 or at least {LEAST_SAMPLES}; got {samples}.")
    found = contributors(design, tolerances)
    asked = tuple(quantities) or tolerances.quantities or default_quantities(design)
    limits = list(tolerances.limits)
    by_name = []
    for k, limit in enumerate(limits):
        if limit.quantity.partition("[")[0].strip() in QUANTITIES:  # otherwise δ or a shift
            limits[k] = replace(limit, quantity=canonical(limit.quantity))
            by_name.append(limits[k].quantity)
    at = tolerances.positions
    if at is not None and design.indentation is None:
        raise GoalError(f"positions need [indenter] and [indentation], which the design {design.name} does not have.")
    requests = {one.key: one for one in map(request, [*asked, *by_name])}
    nominal = Evaluation(design, accuracy)
    for coil in (coil for one in requests.values() for coil in one.coils):
        nominal.coil(coil)
    if at is not None:
        states, places = len(design.plan), len(at.x) * len(at.y)
        needed = 8.0 * len(PARAMETERS) * states * places**2  # of `Shifts.matrix`
        require_memory(needed, f"the matrix of shifts at {places} positions", "take fewer")
    return found, Outputs(tuple(requests), at, accuracy), limits, draw(found, samples, seed)


def _check_limits(limits: Sequence[Limit], names: Sequence[str]) -> None:
    for limit in limits:
        if limit.quantity not in names:
            raise GoalError(f"the limit {limit.text} does not name an output; there are {', '.join(names)}.")


def _check_places(design: Design, outputs: Outputs) -> None:
    at = outputs.positions
    if at is None:
        return
    depths, x, y = table_grid(design)
    for name, values, grid in (("x", at.x, x), ("y", at.y, y), ("depth", (at.depth,), depths)):
        low, high = grid[0] * 1e3, grid[-1] * 1e3
        for value in values:
            if not grid[0] <= value <= grid[-1]:
                raise LocalizeError(
                    f"{name} must be {low:g} to {high:g} mm, in the table of {design.name}; got {value * 1e3:g}."
                )
    require_states([state.name for state in design.plan], len(PARAMETERS), "scan")


@dataclass(frozen=True, eq=False)
class Shifts:
    """Shifts of located positions by errors of the board."""

    model: ForwardModel
    points: FloatArray  # (places, 3), the true x, y and depth in m
    noise: float | None  # standard deviation of δ
    determined: tuple[tuple[int, ...], ...]  # indices of x, y and depth that a reading determines, by place

    def names(self, places: Sequence[str]) -> tuple[str, ...]:
        """Names of the outputs, place by place."""
        pairs = [
            (PARAMETERS[axis], place) for place, axes in zip(places, self.determined, strict=True) for axis in axes
        ]
        return tuple(f"shift_{parameter}_mm[{place}]" for parameter, place in pairs)

    def undetermined(self, places: Sequence[str]) -> tuple[str, ...]:
        """Undetermined unknowns like ``y at x_mm=0,y_mm=0,depth_mm=1``."""
        unknowns = range(self.model.unknowns)
        missing = [[PARAMETERS[axis] for axis in unknowns if axis not in axes] for axes in self.determined]
        return tuple(f"{', '.join(axes)} at {place}" for place, axes in zip(places, missing, strict=True) if axes)

    def matrix(self) -> FloatArray:
        """Shifts in mm per Δδ (shifts, places · states)."""
        states = len(self.model.states)
        rows = []
        for k, (point, axes) in enumerate(zip(self.points, self.determined, strict=True)):
            weights = whitening_of(self.model, self.noise, self.model.delta(point), point)
            inverse = np.linalg.pinv(weights.slopes(self.model.jacobian(point)[:, list(axes)]))
            for row in inverse @ weights.slopes(np.eye(states)) * 1e3:
                rows.append(np.zeros(len(self.points) * states))
                rows[-1][k * states : (k + 1) * states] = row
        return np.array(rows).reshape(-1, len(self.points) * states)

    def located(self, changes: FloatArray) -> tuple[FloatArray, int]:
        """Locate readings with the real solver.

        `changes` (n, places · states) is Δδ of n boards relative to the board without errors. The
        first result is the located minus the true position in mm (n, shifts), for the mode next to
        the truth, NaN without a mode. The second is the number of positions that are ``"found"``,
        not on the border of the table or beyond noise.
        """
        states = len(self.model.states)
        shifts, found = [], 0
        for k, (point, axes) in enumerate(zip(self.points, self.determined, strict=True)):
            readings = self.model.delta(point) + changes[:, k * states : (k + 1) * states]
            locations = locate_all(self.model, readings, noise=self.noise)
            found += sum(location.verdict == "found" for location in locations)
            there = np.full((len(changes), len(axes)), np.nan)
            for row, location in zip(there, locations, strict=True):
                if location.modes:
                    away = np.array([[mode.x, mode.y, mode.depth] for mode in location.modes]) - point
                    nearest = away[np.argmin(np.hypot(away[:, 0], away[:, 1]))]
                    row[:] = nearest[list(axes)] * 1e3
            shifts.append(there)
        return np.hstack(shifts), found


def shifts_at(model: ForwardModel, positions: Positions, largest: float) -> Shifts:
    """Prepare to locate readings at positions within the table."""
    # Unknowns with more than `largest` in m by noise are left out, the least known first.
    points = np.array([(x, y, positions.depth) for y, x in product(positions.y, positions.x)])
    require_states(model.states, model.unknowns, "scan")
    determined = []
    for information in fisher_information(model, points, positions.noise):
        axes = list(range(len(information)))
        while axes:
            among = information[np.ix_(axes, axes)]
            deviations = np.sqrt(np.diag(covariance_of(among)))
            if deviations.max() <= largest:
                break
            # all infinite if the information is singular: then the worst unknown taken alone is left out
            known = np.isfinite(deviations).all()
            del axes[int(np.argmax(deviations) if known else np.argmin(np.diag(among)))]
        determined.append(tuple(axes))
    return Shifts(model, points, positions.noise, tuple(determined))


def _with_shifts(
    shifts: Shifts, outputs: Outputs, nominal: FloatArray, effects: FloatArray, sampled: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, dict[str, str]]:
    first, by_delta = len(outputs.quantities), shifts.matrix()
    matrix = np.hstack((np.zeros((len(by_delta), first)), by_delta))
    good = np.isfinite(sampled).all(axis=1)
    located = np.full((len(sampled), len(by_delta)), np.nan)
    located[good], found = shifts.located(sampled[good, first:] - nominal[first:])
    readings, unknown = int(good.sum()) * len(shifts.points), shifts.undetermined(outputs.places())
    attributes = {"found": f"{found} of {readings} readings", "undetermined": "; ".join(unknown)}
    effects = np.hstack((effects, effects @ matrix.T))
    return np.append(nominal, np.zeros(len(by_delta))), effects, np.hstack((sampled, located)), attributes


def _linear_part(
    names: Sequence[str], found: Sequence[Contributor], tolerances: Tolerances, nominal: FloatArray, effects: FloatArray
) -> xr.Dataset:
    both, single, of_error = ("contributor", "output"), ("output",), ("contributor",)
    variance = (effects**2).sum(axis=0)
    shares = np.divide(effects**2, variance, out=np.zeros_like(effects), where=variance > 0)
    return xr.Dataset(
        {
            "nominal": (single, nominal, {"long_name": "nominal value"}),
            "linear_deviation": (single, np.sqrt(variance), {"long_name": "σ, linear"}),
            "effect": (both, effects, {"long_name": "effect of 1 σ"}),
            "share": (both, shares, {"units": "1", "long_name": "share of the linearised variance"}),
            "deviation": (of_error, [one.deviation for one in found], {"long_name": "standard deviation"}),
            "unit": (of_error, [UNITS[one.table] for one in found]),
            "table": (of_error, [one.table for one in found]),
            "part": (of_error, [one.part for one in found]),
            "distribution": (of_error, [one.distribution for one in found]),
            "assumed": (of_error, [tolerances.assumed.get(one.table, "") for one in found]),
        },
        coords={"output": list(names), "contributor": [one.name for one in found]},
    )


def _sampled_part(linear: xr.Dataset, drawn: FloatArray, values: FloatArray, failures: Sequence[str]) -> xr.Dataset:
    single, names, expected = ("output",), linear.output.values.tolist(), linear.linear_deviation.values
    # a board without a position still has its other outputs
    columns = [column[np.isfinite(column)] for column in values.T]
    short = [name for name, column in zip(names, columns, strict=True) if len(column) < LEAST_SAMPLES]
    if short:
        reason = next((failure for failure in failures if failure), "no reading gives a position")
        raise GoalError(f"fewer than {LEAST_SAMPLES} of {len(values)} boards have {short[0]}: {reason}")
    deviation = np.array([column.std(ddof=1) for column in columns])
    error = np.array([float(deviation_error(column)) for column in columns])
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio, ratio_error = (np.where(expected > 0, of / expected, np.nan) for of in (deviation, error))
    return xr.Dataset(
        {
            "error": (("sample", "contributor"), drawn, {"long_name": "drawn errors in SI"}),
            "value": (("sample", "output"), values),
            "failure": ("sample", np.array(failures, dtype=object)),
            "sample_mean": (single, [column.mean() for column in columns], {"long_name": "mean of the drawn boards"}),
            "sample_deviation": (single, deviation, {"long_name": "σ of the drawn boards"}),
            "sample_deviation_error": (single, error, {"long_name": "standard error of σ"}),
            "ratio": (single, ratio, {"units": "1", "long_name": "ratio of both σ"}),
            "ratio_error": (single, ratio_error, {"units": "1", "long_name": "± ratio"}),
            "percentiles": (("percentile", "output"), np.array([np.percentile(c, _CENTRAL) for c in columns]).T),
        },
        coords={"percentile": list(_CENTRAL)},
    )


def deviation_error(values: FloatArray) -> FloatArray:
    """Return standard errors of sampled standard deviations (n, …).

    var(s²) = (μ₄ − s⁴ (n − 3)/(n − 1))/n for any fourth central moment μ₄, and ds = ds²/2s. The
    lower limit is s/√(2(n − 1)) of a normal distribution (Kendall & Stuart, The Advanced Theory of
    Statistics, vol. 1, ch. 10), for too few values for μ₄. It is rather too large for Sobol points.
    """
    n = len(values)
    variance = values.var(axis=0, ddof=1)
    fourth = ((values - values.mean(axis=0)) ** 4).mean(axis=0)
    of_variance = np.sqrt(np.maximum(fourth - variance**2 * (n - 3) / (n - 1), 0.0) / n)
    deviation = np.sqrt(variance)
    error = np.divide(of_variance, 2 * deviation, out=np.zeros_like(deviation), where=deviation > 0)
    return np.asarray(error if n >= _ENOUGH else np.maximum(error, deviation / np.sqrt(2 * (n - 1))))


def kept(limits: Sequence[Limit], names: Sequence[str], values: FloatArray) -> BoolArray:
    """Whether boards (n, outputs) keep limits (n, limits), NaN none."""
    columns = values[:, [names.index(limit.quantity) for limit in limits]]
    low, high = np.array([limit.at_least for limit in limits]), np.array([limit.at_most for limit in limits])
    return np.asarray((columns >= low) & (columns <= high))


def _yields(
    limits: Sequence[Limit],
    names: Sequence[str],
    found: Sequence[Contributor],
    nominal: FloatArray,
    effects: FloatArray,
    values: FloatArray,
    unread: BoolArray,
) -> xr.Dataset:
    # No converter reads the boards `unread`.
    units = draw(found, _LINEAR_SAMPLES) / [one.deviation for one in found]
    columns = [names.index(limit.quantity) for limit in limits]
    picked = [limit.quantity for limit in limits]
    in_linear = kept(limits, picked, nominal[columns] + units @ effects[:, columns])
    variables: dict[str, tuple[Any, ...]] = {
        "limited": ("limit", [*picked, ""]),
        "at_least": ("limit", [*(limit.at_least for limit in limits), -np.inf]),
        "at_most": ("limit", [*(limit.at_most for limit in limits), np.inf]),
    }
    shares = [*in_linear.mean(axis=0), in_linear.all(axis=1).mean()]
    variables["linear_yield"] = ("limit", shares, {"long_name": "yield, linear"})
    if len(values):
        is_read = np.array(  # δ and shifts depend on values that a converter reads
            [name.partition("[")[0] not in QUANTITIES or request(name).quantity.is_read for name in picked]
        )
        good = kept(limits, names, values) & ~(unread[:, None] & is_read)
        counts = [*good.sum(axis=0).tolist(), int(good.all(axis=1).sum())]
        # Wilson's interval, which holds the true share with 95 %, only approximately for Sobol
        # points
        ends = [binomtest(count, len(values)).proportion_ci(0.95, method="wilson") for count in counts]
        variables["sample_yield"] = ("limit", np.array(counts) / len(values), {"long_name": "yield of boards"})
        variables["sample_yield_low"] = ("limit", [float(end.low) for end in ends], {"long_name": "at least"})
        variables["sample_yield_high"] = ("limit", [float(end.high) for end in ends], {"long_name": "at most"})
    return xr.Dataset(variables, coords={"limit": [*(limit.text for limit in limits), "all limits"]})
