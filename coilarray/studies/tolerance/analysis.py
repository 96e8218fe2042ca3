"""Whole tolerance analysis: boards around the design, randomly drawn boards, and the spread from both."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from itertools import combinations, product
from typing import Any

import numpy as np
import xarray as xr

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
from coilarray.localize.forward import forward_model, table_for, table_grid
from coilarray.response.interpolation import PARAMETERS
from coilarray.studies.points import Outcome, run_cached
from coilarray.studies.quantities import QUANTITIES, Evaluation, canonical, request
from coilarray.studies.tolerance.perturb import perturb
from coilarray.studies.tolerance.position import Shifts, require_states, shifts_at
from coilarray.studies.tolerance.spread import (
    CENTRAL,
    LEAST_SAMPLES,
    Sampling,
    Sensitivity,
    deviation_error,
    difference_points,
    draw,
    error_steps,
    errors_of,
    kept,
    sensitivity,
    yield_of,
)
from coilarray.studies.tolerance.tolerances import UNITS, Contributor, Limit, Positions, Tolerances, contributors

UNREAD = "unread values"
"""Name of an outcome that is not an output."""
_MOST_OF_ALL_PAIRS = 7  # coils, of which all pairs still make a readable table
_LEAST_KNOWN = 0.5  # of the thickness of all sheets, a length over which δ changes much
_LINEAR_SAMPLES = 1 << 16  # of the linear model, for its yield: errs by less than 1e-3


def default_quantities(design: Design) -> tuple[str, ...]:
    """Names of all self-inductances, and of couplings of all pairs or, of many coils, neighbours."""
    coils = design.array.names
    few = len(coils) <= _MOST_OF_ALL_PAIRS
    of = combinations(range(len(coils)), 2) if few else sorted(design.array.neighbours)
    pairs = tuple(f"k[{coils[i]},{coils[j]}]" for i, j in of)
    return (*(("worst_k", "rms_k") if pairs else ()), *(f"inductance_uH[{coil}]" for coil in coils), *pairs)


@dataclass(frozen=True)
class Outputs:
    """Outputs of a board by canonical names: quantities, and δ at positions."""

    quantities: tuple[str, ...]
    positions: Positions | None = None
    accuracy: Accuracy = "screen"

    def names(self, design: Design) -> tuple[str, ...]:
        """Names of all outputs: quantities, then δ by place and state."""
        states = [state.name for state in design.plan]
        deltas = [f"delta[{state},{place}]" for place in self.places() for state in states]
        return (*self.quantities, *deltas)

    def places(self) -> tuple[str, ...]:
        """Positions as they appear in names of outputs."""
        at = self.positions
        if at is None:
            return ()
        return tuple(f"x_mm={_mm(x)},y_mm={_mm(y)},depth_mm={_mm(at.depth)}" for y, x in product(at.y, at.x))

    def item(self, document: Mapping[str, Any], errors: Mapping[str, float]) -> dict[str, Any]:
        """Return one board as plain data, for `evaluate_board`."""
        at = self.positions and replace(self.positions, noise=None)  # which matters only for locating
        return {"document": document, "errors": dict(errors), "outputs": replace(self, positions=at)}


def wanted_outputs(
    design: Design, quantities: Sequence[str], positions: Positions | None, accuracy: Accuracy = "screen"
) -> Outputs:
    """Check the requested outputs, counting repeated quantities once.

    Raises GoalError if a quantity or coil is unknown, or if positions are given for a design without an indentation.
    """
    if positions is not None and design.indentation is None:
        raise GoalError(f"positions need [indenter] and [indentation], which the design {design.name} does not have.")
    requests = {one.key: one for one in map(request, quantities)}
    if not requests and positions is None:
        raise GoalError("at least one quantity or position must be asked for.")
    nominal = Evaluation(design, accuracy)
    for coil in (coil for one in requests.values() for coil in one.coils):
        nominal.coil(coil)
    return Outputs(tuple(requests), positions, accuracy)


def evaluate_board(item: Mapping[str, Any]) -> dict[str, float]:
    """Compute the outputs of one board from `Outputs.item`, on a worker.

    `UNREAD` is the number of values among them that no converter can read. Raises GoalError if the errors leave no
    board or the board does not have a quantity, and CoilarrayError if the physics cannot be solved.
    """
    document, outputs = item["document"], item["outputs"]
    board = perturb(build_design(document, document["name"]), item["errors"])
    evaluation = Evaluation(board, outputs.accuracy)
    values = {name: request(name).value(evaluation) for name in outputs.quantities}
    if (at := outputs.positions) is not None:
        response = evaluation.response(np.array([at.depth]), np.array(at.x), np.array(at.y))
        names = outputs.names(board)[len(outputs.quantities) :]
        values |= dict(zip(names, response.delta.values[0].ravel().tolist(), strict=True))
    return {**values, UNREAD: float(evaluation.unread)}


def _mm(length: float) -> str:
    """Write a length in mm, to the nanometre."""
    return f"{round(length * 1e3, 6):g}"


def analyse(
    design: Design | DesignFile,
    tolerances: Tolerances,
    *,
    quantities: Sequence[str] = (),
    samples: int = 64,
    seed: int = 0,
    sampling: Sampling = "sobol",
    accuracy: Accuracy = "screen",
    table: xr.Dataset | None = None,
    workers: int | Executor = 1,
    cache: Store | None = None,
    progress: Progress | None = None,
) -> xr.Dataset:
    """Compute the spread of a design's quantities over boards with fabrication errors.

    `tolerances` are the distributions of the errors, positions and limits. `quantities` are by default of the
    tolerances, otherwise `default_quantities`. Quantities in limits are added. `samples` is the number of drawn boards,
    0 or at least 8, with `seed` and `sampling` as in `draw`. The `accuracy` ``screen`` shifts values by 1e-4 of L and
    5e-5 in k, the same for all boards, so their spread is accurate to 1 %. `table` is the response table for locating
    positions, from `table_for`, by default computed. `workers` are a number of local processes or an executor. `cache`
    keeps the boards. `progress` is called with (done, total). Raises GoalError if `check_analysis` refuses the
    arguments, or a board next to the nominal board is impossible, and CoilarrayError if the nominal board cannot be
    solved.

    Returns
    -------
    xarray.Dataset
        Dataset over ``output``, quantities in the units of their names, δ by place and state and shifts of the located
        position in mm, and over ``contributor``, the errors:

        - ``nominal``, ``linear_deviation`` and ``step_change`` (see `Sensitivity`) of each output.
        - ``effect``, ``wide_effect`` and ``share`` (contributor, output).
        - ``deviation``, ``unit``, ``table``, ``part`` and ``distribution`` of each contributor, with a reason.
        - With samples ``error`` (sample, contributor) and ``value`` (sample, output), NaN if a board has no value or a
          reading has no position, with the cause in ``failure``; ``sample_mean``, ``sample_deviation`` with its
          standard error, its ``ratio`` to the linear deviation, and ``percentiles``. ``unread`` marks boards that no
          converter reads.
        - For each ``limit`` and last for all together ``linear_yield`` and, with samples, ``sample_yield`` with its
          interval. A board that cannot be made keeps no limit, and a board that no converter can read none on read
          quantities. The linear model includes neither effect.

    Examples
    --------
    >>> from coilarray import load_design
    >>> from coilarray.studies.tolerance import Spread, Tolerances
    >>> thickness = Tolerances({"dielectric": Spread(board=0.02)})
    >>> result = analyse(load_design("gast_fem"), thickness, samples=0)
    >>> result.output.item(), round(float(result.linear_deviation[0] / result.nominal[0]), 5)
    ('inductance_uH[coil1]', 0.00051)
    """
    file = as_file(design)
    design = file.design
    found, outputs, limits, drawn = _asked(design, tolerances, quantities, samples, seed, sampling, accuracy)
    if table is None:
        _check_places(design, outputs)
    shifts = None
    if outputs.positions is not None:
        model = forward_model(table_for(design) if table is None else table)
        shifts = shifts_at(model, outputs.positions, _LEAST_KNOWN * design.top)
    outs = outputs.names(design)
    names = (*outs, *(() if shifts is None else shifts.names(outputs.places())))
    _check_limits(limits, names)

    steps = error_steps(found)
    around = difference_points(steps)
    boards = [{}, *around, *(errors_of(found, row) for row in drawn)]
    items = [outputs.item(file.document, errors) for errors in boards]
    outcomes: list[Outcome] = [""] * len(boards)
    with open_executor(workers) as executor:
        for k, outcome in run_cached(evaluate_board, items, executor, cache, progress=progress, total=len(boards)):
            if k == 0 and isinstance(outcome, str):
                raise GoalError(outcome)  # no board at all
            outcomes[k] = outcome
    near, taken = outcomes[: 1 + len(around)], outcomes[1 + len(around) :]
    values = _near_values(near, boards, outs)
    nominal, linear = values[0], sensitivity(found, steps, values[1:])
    sampled = np.array([[np.nan] * len(nominal) if isinstance(o, str) else [o[name] for name in outs] for o in taken])
    sampled = sampled.reshape(samples, len(nominal))
    located: dict[str, str] = {}
    if shifts is not None:
        nominal, linear, sampled, located = _with_shifts(shifts, outputs, nominal, linear, sampled)
    result = _linear_part(names, found, tolerances, nominal, linear)
    if samples:
        failures = [outcome if isinstance(outcome, str) else "" for outcome in taken]
        result = result.merge(_sampled_part(names, linear, drawn, sampled, failures))
    unread = [not isinstance(one, str) and one.get(UNREAD, 0.0) > 0 for one in (near[0], *taken)]
    if limits:
        result = result.merge(_yields(limits, names, found, nominal, linear, sampled, np.array(unread[1:], dtype=bool)))
    if any(unread):
        words = {"long_name": "whether no converter can read the board"}
        result = result.assign(unread=("sample", np.array(unread[1:], dtype=np.bool_), words)) if samples else result
        located["not_read"] = (
            f"{'the' if unread[0] else 'not the'} nominal board, {sum(unread[1:])} of {samples} drawn ones"
        )
    about = {"seed": seed, "sampling": sampling, "accuracy": accuracy, "boards": len(boards)}
    return result.assign_attrs({**provenance(design), **about, **located})


def check_analysis(
    design: Design | DesignFile,
    tolerances: Tolerances,
    *,
    quantities: Sequence[str] = (),
    samples: int = 64,
    seed: int = 0,
    sampling: Sampling = "sobol",
    accuracy: Accuracy = "screen",
    with_table: bool = False,
) -> None:
    """Check the arguments of `analyse`, within milliseconds.

    Neither a table nor a board is computed, so some errors are found by `analyse` only. Without a response table,
    positions must lie in the table that will be computed. Raises GoalError if a quantity or coil is unknown, a limit is
    not on an output, the samples or the seed are not allowed, or no error has a spread, and LocalizeError if a position
    lies outside the table to be computed, or there are fewer states than unknowns.
    """
    design = as_file(design).design
    _, outputs, limits, _ = _asked(design, tolerances, quantities, samples, seed, sampling, accuracy)
    shifts = [f"shift_{parameter}_mm[{place}]" for place in outputs.places() for parameter in PARAMETERS]
    _check_limits(limits, (*outputs.names(design), *shifts))
    if not with_table:
        _check_places(design, outputs)


def _asked(
    design: Design,
    tolerances: Tolerances,
    quantities: Sequence[str],
    samples: int,
    seed: int,
    sampling: Sampling,
    accuracy: Accuracy,
) -> tuple[Sequence[Contributor], Outputs, list[Limit], FloatArray]:
    """Check the input of an analysis; return its contributors, outputs, limits and drawn errors."""
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
    outputs = wanted_outputs(design, [*asked, *by_name], tolerances.positions, accuracy)
    if tolerances.positions is not None:
        states, places = len(design.plan), len(tolerances.positions.x) * len(tolerances.positions.y)
        needed = 8.0 * len(PARAMETERS) * states * places**2  # of `Shifts.matrix`
        require_memory(needed, f"the matrix of shifts at {places} positions", "take fewer")
    return found, outputs, limits, draw(found, samples, seed, sampling)


def _check_limits(limits: Sequence[Limit], names: Sequence[str]) -> None:
    for limit in limits:
        if limit.quantity not in names:
            raise GoalError(f"the limit {limit.text} does not name an output; there are {', '.join(names)}.")


def _check_places(design: Design, outputs: Outputs) -> None:
    """Refuse positions outside the table to be computed, and too few states for it."""
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
    require_states([state.name for state in design.plan], len(PARAMETERS))


def _near_values(
    outcomes: Sequence[Outcome], boards: Sequence[Mapping[str, float]], names: Sequence[str]
) -> FloatArray:
    """Return the outputs of the nominal board and its neighbours, shape (boards, outputs)."""
    rows = []
    for outcome, errors in zip(outcomes, boards, strict=False):
        if isinstance(outcome, str):
            ((name, value),) = errors.items()
            raise GoalError(
                f"the board with {name} {value:+.3g}, one standard deviation or less, cannot be made: {outcome}"
            )
        rows.append([outcome[name] for name in names])
    return np.array(rows)


def _with_shifts(
    shifts: Shifts, outputs: Outputs, nominal: FloatArray, linear: Sensitivity, sampled: FloatArray
) -> tuple[FloatArray, Sensitivity, FloatArray, dict[str, str]]:
    """Append the shifts of the located positions to the outputs, with attributes of the result."""
    first, by_delta = len(outputs.quantities), shifts.matrix()
    matrix = np.hstack((np.zeros((len(by_delta), first)), by_delta))
    good = np.isfinite(sampled).all(axis=1)
    located = np.full((len(sampled), len(by_delta)), np.nan)
    located[good], found = shifts.located(sampled[good, first:] - nominal[first:])
    attributes = {
        "found": f"{int(found.sum())} of {int(good.sum()) * len(shifts.points)} readings",
        "undetermined": "; ".join(shifts.undetermined(outputs.places())),
    }
    none = np.zeros(len(by_delta))
    return np.append(nominal, none), linear.joined(linear.through(matrix)), np.hstack((sampled, located)), attributes


def _linear_part(
    names: Sequence[str], found: Sequence[Contributor], tolerances: Tolerances, nominal: FloatArray, linear: Sensitivity
) -> xr.Dataset:
    """Make the part of the result from the linear model."""
    both, single, of_error = ("contributor", "output"), ("output",), ("contributor",)
    return xr.Dataset(
        {
            "nominal": (single, nominal, {"long_name": "nominal value"}),
            "linear_deviation": (single, linear.deviation, {"long_name": "σ, linear"}),
            "step_change": (single, linear.step_change, {"units": "1", "long_name": "change by twice the step (σ)"}),
            "effect": (both, linear.effects, {"long_name": "effect of 1 σ"}),
            "wide_effect": (both, linear.wide_effects, {"long_name": "effect of 1 σ, twice the step"}),
            "share": (both, linear.shares, {"units": "1", "long_name": "share of the linearised variance"}),
            "deviation": (of_error, [one.deviation for one in found], {"long_name": "standard deviation"}),
            "unit": (of_error, [UNITS[one.table] for one in found]),
            "table": (of_error, [one.table for one in found]),
            "part": (of_error, [one.part for one in found]),
            "distribution": (of_error, [one.distribution for one in found]),
            "assumed": (of_error, [tolerances.assumed.get(one.table, "") for one in found]),
        },
        coords={"output": list(names), "contributor": [one.name for one in found]},
    )


def _sampled_part(
    names: Sequence[str], linear: Sensitivity, drawn: FloatArray, values: FloatArray, failures: Sequence[str]
) -> xr.Dataset:
    """Make the part of the result from drawn boards."""
    single = ("output",)
    # a board without a position still has its other outputs
    columns = [column[np.isfinite(column)] for column in values.T]
    short = [name for name, column in zip(names, columns, strict=True) if len(column) < LEAST_SAMPLES]
    if short:
        reason = next((failure for failure in failures if failure), "no reading gives a position")
        raise GoalError(f"fewer than {LEAST_SAMPLES} of {len(values)} boards have {short[0]}: {reason}")
    deviation = np.array([column.std(ddof=1) for column in columns])
    error = np.array([float(deviation_error(column)) for column in columns])
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio, ratio_error = (
            np.where(linear.deviation > 0, of / linear.deviation, np.nan) for of in (deviation, error)
        )
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
            "percentiles": (("percentile", "output"), np.array([np.percentile(c, CENTRAL) for c in columns]).T),
        },
        coords={"percentile": list(CENTRAL)},
    )


def _yields(
    limits: Sequence[Limit],
    names: Sequence[str],
    found: Sequence[Contributor],
    nominal: FloatArray,
    linear: Sensitivity,
    values: FloatArray,
    unread: BoolArray,
) -> xr.Dataset:
    """Yield for each limit and, last, for all limits together; no converter reads `unread` (sample)."""
    units = draw(found, _LINEAR_SAMPLES) / [one.deviation for one in found]
    columns = [names.index(limit.quantity) for limit in limits]
    picked = [limit.quantity for limit in limits]
    in_linear = kept(limits, picked, nominal[columns] + units @ linear.effects[:, columns])
    variables: dict[str, tuple[Any, ...]] = {
        "limited": ("limit", [*picked, ""]),
        "at_least": ("limit", [*(limit.at_least for limit in limits), -np.inf]),
        "at_most": ("limit", [*(limit.at_most for limit in limits), np.inf]),
    }
    shares = [*in_linear.mean(axis=0), in_linear.all(axis=1).mean()]
    variables["linear_yield"] = ("limit", shares, {"long_name": "yield, linear"})
    if len(values):
        # δ and shifts depend on values that a converter reads
        is_read = np.array(
            [name.partition("[")[0] not in QUANTITIES or request(name).quantity.is_read for name in picked]
        )
        good = kept(limits, names, values) & ~(unread[:, None] & is_read)
        counts = [*good.sum(axis=0).tolist(), int(good.all(axis=1).sum())]
        yields = [yield_of(count, len(values)) for count in counts]
        for end, text in (("share", "yield of boards"), ("low", "at least"), ("high", "at most")):
            name = "sample_yield" if end == "share" else f"sample_yield_{end}"
            variables[name] = ("limit", [getattr(one, end) for one in yields], {"long_name": text})
    return xr.Dataset(variables, coords={"limit": [*(limit.text for limit in limits), "all limits"]})
