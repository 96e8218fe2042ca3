"""Fit entries of a design to measurements, and rank alternatives."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from scipy.special import logsumexp
from scipy.stats import chi2, f

from coilarray.circuit.coupling import provenance
from coilarray.compute.arrays import FloatArray
from coilarray.compute.netcdf import Entry, Schema
from coilarray.compute.store import Store, store_to_keep
from coilarray.compute.table import html_card, html_table
from coilarray.compute.threads import Progress
from coilarray.compute.workers import open_executor
from coilarray.design.keys import entry_unit
from coilarray.design.model import Design, DesignFile, build_design, build_design_file, one_board
from coilarray.design.vary import no_longer_assumed, vary_document
from coilarray.design.write import as_file
from coilarray.errors import DesignError, GoalError
from coilarray.paper.ellipse_model import EllipseModel, difference_from_published, published_model
from coilarray.response.setup import Imperfections, indentation_of
from coilarray.studies.calibrate.fit import DRAWS, Fit, Problem, at_bound, fit, posterior, together
from coilarray.studies.calibrate.plan import (
    IMPERFECTION,
    Choice,
    Measurement,
    Plan,
    Unknown,
    evaluate_model,
    imperfections_of,
    measurement,
    separated,
    simple_plan,
)
from coilarray.studies.optimize.goal import value_of
from coilarray.studies.sweep import SAYS_NOTHING, decisive, run_cached

_FLAT_STD = 1 / np.sqrt(12)  # of a flat prior, in its range
_WEAKEST = 0.15  # of the largest share in a direction: smaller shares are not mentioned,
_FELT = 0.3  # unless they alone change the data by this part of their noise
_INTERVAL = (0.025, 0.975)
_FIGURES = (
    "chi_square", "degrees_of_freedom", "fit_probability", "noise_scale", "log_evidence", "determined", "evaluations",
)  # fmt: skip
_SAID = {
    "start": "first guess", "value": "value", "std": "± value", "low": "95 % interval, from",
    "high": "95 % interval, to", "model": "fitted", "before": "as first guessed", "model_std": "± fitted",
    "residual": "fitted less measured, in standard deviations", "chi_square": "χ²",
    "degrees_of_freedom": "degrees of freedom", "fit_probability": "probability of a larger χ²",
    "noise_scale": "scale of the noise", "log_evidence": "ln evidence",
    "determined": "directions that the data determine", "evaluations": "evaluations",
}  # fmt: skip
_GUESSED_STEPS = 6  # of a fit, for a progress bar
CALIBRATION = Schema(  # variables of a calibration's dataset that draws need
    GoalError,
    "value, posterior and entries over combination, draw and unknown",
    {
        "value": Entry("", ("combination", "unknown"), needed=True, gaps=True),
        "posterior": Entry("", ("combination", "draw", "unknown"), needed=True, gaps=True),
        "unknown": Entry(None, ("unknown",), needed=True),
        "entries": Entry(None, ("unknown",), needed=True, longest=100_000),
    },
)


@dataclass(frozen=True, eq=False)
class Case:
    """Combination of choices, or the `reason` why it has no fit."""

    name: str
    choices: tuple[Choice, ...]
    unknowns: tuple[Unknown, ...]
    document: Mapping[str, Any]
    start: FloatArray
    reason: str = ""

    @property
    def names(self) -> list[str]:
        """Names of the unknowns."""
        return [unknown.name for unknown in self.unknowns]

    def changed(self, point: FloatArray) -> tuple[dict[str, Any], dict[str, float]]:
        """Return document and imperfections for given unknowns."""
        values = {
            entry: value
            for unknown, value in zip(self.unknowns, point.tolist(), strict=True)
            for entry in unknown.entry
        }
        entries, imperfections = separated(values)
        return vary_document(self.document, entries), imperfections


@dataclass(frozen=True, eq=False)
class Solution:
    """Fitted combination with covariance, draws and figures."""

    case: Case
    problem: Problem
    fit: Fit
    covariance: FloatArray
    draws: FloatArray
    log_evidence: float


def _undetermined(row: Solution) -> list[str]:
    """Describe the directions that the priors determine better."""
    problem = row.problem
    prior = np.where(np.isfinite(problem.prior_std), problem.prior_std, problem.span * _FLAT_STD)
    rows = problem.weighted(row.fit.slopes) / row.fit.scale * prior
    squares, directions = np.linalg.eigh(rows.T @ rows)
    said = []
    for square, either in zip(squares, directions.T, strict=True):
        if square >= 1:
            continue
        direction = either * np.sign(either[int(np.argmax(np.abs(either)))])
        size, felt = np.abs(direction), np.abs(direction) * np.linalg.norm(rows, axis=0)
        shown = [k for k in np.argsort(-size) if size[k] >= _WEAKEST * size.max() or felt[k] >= _FELT]
        order = [(k, row.case.names[k]) for k in shown]
        units = {name: "" if entry_unit(name) == "1" else entry_unit(name) for name in row.case.names}
        parts = [f"{name} by {direction[k] * prior[k]:+.3g} {units[name]}".rstrip() for k, name in order]
        noises = np.sqrt(max(float(square), 0.0))
        said.append(f"{' with '.join(parts)}: changes the data by {noises:.2g} of their noise")
    return said


def result_dataset(design: Design, measured: Measurement, plan: Plan, rows: Sequence[Solution | Case]) -> xr.Dataset:
    """Return all results in the given order, see `calibrate`."""
    combinations = [row if isinstance(row, Case) else row.case for row in rows]
    names = list(dict.fromkeys(unknown.name for one in combinations for unknown in one.unknowns))
    n, m = len(names), len(measured.values)
    table = {key: np.full((len(rows), n), np.nan) for key in ("start", "value", "std", "low", "high")}
    bounds, correlation = np.zeros((len(rows), n), dtype=bool), np.full((len(rows), n, n), np.nan)
    draws = np.full((len(rows), DRAWS, n), np.nan)
    numbers = {key: np.full((len(rows), m), np.nan) for key in ("model", "before", "model_std", "residual")}
    figures = {key: np.full(len(rows), np.nan) for key in _FIGURES}
    said = [""] * len(rows)
    for i, row in enumerate(rows):
        if isinstance(row, Case):
            continue
        problem = row.problem
        at = [names.index(name) for name in row.case.names]
        std = np.sqrt(np.diag(row.covariance))
        interval = np.quantile(row.draws, _INTERVAL, axis=0)
        for key, values in zip(table, (row.case.start, row.fit.point, std, *interval), strict=True):
            table[key][i, at] = values
        bounds[i, at] = at_bound(problem, row.fit.point)
        correlation[i][np.ix_(at, at)] = row.covariance / np.outer(std, std)
        draws[i][:, at] = row.draws
        known = np.isfinite(measured.values) & np.isfinite(row.fit.values)
        off = np.where(known, row.fit.values - measured.values, np.nan)
        slopes = row.fit.slopes
        band = np.sqrt(np.einsum("ij,jk,ik->i", slopes, row.covariance, slopes))
        given = (row.fit.values, row.fit.before, band, off / (measured.std * row.fit.scale))
        for key, values in zip(numbers, given, strict=True):
            numbers[key][i] = values
        r = problem.residuals(row.fit.values)
        square, freedom, noise = float(r @ r), max(problem.freedom, 1e-9), problem.noise_freedom
        odds = np.nan  # of a larger χ² by noise alone, if the data tell its size
        if np.isinf(noise):
            odds = float(chi2.sf(square, freedom))
        elif noise:
            odds = float(f.sf(square / freedom, freedom, noise))
        direct = _undetermined(row)
        said[i] = "\n".join(direct)
        determined = len(row.case.names) - len(direct)
        found = (square, problem.freedom, odds, row.fit.scale, row.log_evidence, determined, row.fit.evaluations)
        for key, value in zip(_FIGURES, found, strict=True):
            figures[key][i] = value
    solved = [isinstance(row, Solution) for row in rows]
    reasons = [row.reason if isinstance(row, Case) else "" for row in rows]
    evidence = np.where(solved, figures["log_evidence"], -np.inf)
    units = [entry_unit(name) for name in names]
    both, of_datum = ("combination", "unknown"), ("combination", "datum")
    data: dict[str, Any] = {key: (both, values, {"long_name": _SAID[key]}) for key, values in table.items()}
    data |= {
        "at_bound": (both, bounds, {"long_name": "at a bound"}),
        "correlation": (("combination", "unknown", "other"), correlation, {"units": "1"}),
        "posterior": (("combination", "draw", "unknown"), draws, {"long_name": "draws from the posterior"}),
        "measured": ("datum", measured.values, {"long_name": "measured"}),
        "noise": ("datum", measured.std, {"long_name": "standard deviation, given or relative"}),
        "weight": ("datum", measured.weight, {"long_name": "independent numbers that one represents"}),
        **{key: (of_datum, values, {"long_name": _SAID[key]}) for key, values in numbers.items()},
        **{key: ("combination", figures[key], {"long_name": _SAID[key], "units": "1"}) for key in _FIGURES},
        "probability": (
            "combination", np.exp(evidence - logsumexp(evidence)),
            {"long_name": "probability among the combinations", "units": "1"},
        ),
        "converged": ("combination", [isinstance(row, Solution) and row.fit.converged for row in rows]),
        "undetermined": ("combination", said, {"long_name": "directions that the data do not determine"}),
        "problem": ("combination", reasons, {"long_name": "why there is no fit"}),
    }  # fmt: skip
    coords: dict[str, Any] = {"combination": [one.name for one in combinations], "unknown": names, "other": names}
    shared = {unknown.name: " ".join(unknown.entry) for one in combinations for unknown in one.unknowns}
    coords |= {"unit": ("unknown", units), "entries": ("unknown", [shared[name] for name in names])}
    coords |= {key: ("datum", list(values)) for key, values in measured.coords.items()}
    for number, one in enumerate(plan.alternatives):
        chosen = [each.choices[number].name for each in combinations]
        coords[f"choice_of_{one.name.replace(' ', '_')}"] = ("combination", chosen, {"long_name": one.name})
    how = {0.0: "estimated", np.inf: "given"}.get(measured.noise_freedom, "measured")
    kind = str(measured.request["kind"])
    about: dict[str, Any] = {"title": plan.title, "kind": kind, "noise_is": how}
    if kind == "ellipses":
        window = indentation_of(design).in_ellipse_window().x
        about["window_x_m"] = [min(window), max(window)]
    return xr.Dataset(data, coords, {**provenance(design), **about})


@dataclass(frozen=True, eq=False)
class Calibration:
    """Calibrated design.

    `file` has the choices of the best combination and the fitted values, no longer assumed, in the
    text of the design's own file. `imperfections` are the fitted ones of the experiment, and
    `values` all fitted values in the units of the entries, by the first entry of each unknown.
    `dataset` has the results of all combinations, the most probable first, see `calibrate`.
    """

    file: DesignFile
    imperfections: Imperfections
    values: Mapping[str, float]
    dataset: xr.Dataset

    def __repr__(self) -> str:
        values = ", ".join(f"{name} = {value} ± {error}" for name, value, error, _ in self._fitted)
        return f"<Calibration of {self.design.name}: {values}; {self._misfit}>"

    def _repr_html_(self) -> str:
        table = html_table(("unknown", "value", "±", "unit"), self._fitted)
        return html_card(f"Calibration of {self.design.name}: {self._misfit}", table)

    @property
    def _fitted(self) -> list[tuple[str, str, str, str]]:
        """Name, value, standard deviation and unit of the unknowns."""
        best = self.dataset.isel(combination=0)
        own = best.isel(unknown=np.flatnonzero(np.isfinite(best["value"].values)))
        columns = (own[name].values.tolist() for name in ("unknown", "value", "std", "unit"))
        return [(name, f"{value:.5g}", f"{error:.2g}", unit) for name, value, error, unit in zip(*columns, strict=True)]

    @property
    def _misfit(self) -> str:
        best = self.dataset.isel(combination=0)
        return f"χ² {float(best.chi_square):.4g} of {float(best.degrees_of_freedom):.4g} degrees of freedom"

    @property
    def design(self) -> Design:
        """The design of `file`."""
        return self.file.design


def calibrate(
    design: Design | DesignFile,
    data: xr.Dataset | EllipseModel | None = None,
    unknowns: Plan | Mapping[str, Any] | None = None,
    *,
    keep: bool | str | Path = False,
    workers: int | Executor = 1,
    progress: Progress | None = None,
) -> Calibration:
    """Fit entries of a design to measured data, with errors, correlations and what is undetermined.

    Parameters
    ----------
    design : Design or DesignFile
        Design with an indentation. Entries that are not unknowns stay unchanged.
    data : xarray.Dataset or EllipseModel, optional
        A measured response, as `coilarray.hardware.record.recorded_response.recorded_response`
        returns it, with NaN in its gaps, or ellipses. By default the ellipses are Table A1 of Gast
        & Zimmermann (2020).
    unknowns : Plan or mapping of str to sequence
        A plan from `coilarray.studies.calibrate.plan.load_plan`, or (low, high) or (low, high,
        start) of each unknown by its dotted key, in the unit of the key. Keys are the keys of
        `coilarray.vary`, and ``imperfections.`` with ``depth_error_mm``, ``tilt_x_mrad``,
        ``tilt_y_mrad``, ``offset_x_mm``, ``offset_y_mm``, ``drift`` or ``column_drift``.
    keep : bool, str or Path
        Whether evaluations are kept for later runs: in the user's cache folder, or in the given
        folder.
    workers : int or concurrent.futures.Executor
        Number of local processes, or an executor. With 1 everything is computed in this process.
    progress : callable, optional
        Called with (done, total). The total is an estimate.

    Returns
    -------
    Calibration
        The calibration. Its dataset has a row for each ``combination`` of choices, the most
        probable first. For each ``unknown``:
        ``value``, the most probable value, its standard deviation ``std`` from the slopes there,
        ``low`` and ``high``, the 95 % interval between the bounds, ``at_bound``, ``correlation``
        with each ``other``, and ``posterior``, draws.

        For each ``datum``: ``measured`` and its standard deviation ``noise``, ``weight``, the
        number of independent numbers for which it counts, 0 if only predicted, ``before`` and
        ``model``, the number of the first guess and of the fit, ``model_std``, the band of the
        posterior, and ``residual``, fitted minus measured in standard deviations of the noise.

        For each combination: ``chi_square``, ``degrees_of_freedom`` and ``fit_probability``, the
        probability of a larger χ² by noise of the given size, ``noise_scale``, ``log_evidence``,
        ``probability`` among the combinations, ``determined``, the number of directions that the
        data determine better than the priors, ``undetermined``, the others, one per line,
        ``converged``, ``evaluations``, and ``problem``, the reason why there is no fit.

    Raises
    ------
    GoalError
        If the plan does not fit the design or the data, there are no data and the board is not of
        the paper, there are fewer numbers than unknowns, or no combination has a fit.
    LocalizeError, ElastomerError
        If the data are not a response, or the design has no indentation.
    ClusterError, OutputError
        As in `coilarray.sweep`.

    Notes
    -----
    The posterior is the normal distribution of the linear model at the best point, cut off at the
    bounds. If the scale of the noise is measured or estimated, it is Student's distribution.
    Evidences are Laplace's approximation for the same box (D. J. C. MacKay, Information Theory,
    Inference, and Learning Algorithms, ch. 28). Flat priors enter them with their ranges, so wide
    bounds cost probability. A direction is determined if the data alone give it a smaller standard
    deviation than the prior. For a flat prior it is the range/√12.

    Examples
    --------
    >>> from coilarray import load_design
    >>> calibrate(load_design("gast2020"), unknowns={"array.pitch_mm": (14, 12)})
    Traceback (most recent call last):
    coilarray.errors.GoalError: unknowns: unknown.0 needs low below high; got 14 and 12.
    """
    file = as_file(design)
    one_board(file.design, "a calibration")
    plan = unknowns if isinstance(unknowns, Plan) else simple_plan(unknowns or {})
    if data is None:
        if difference := difference_from_published(file.design):
            raise GoalError(
                f"the design {file.design.name} is not the board of `published` (Table A1 of the paper): {difference}; "
                "give DATA of its own, and --plan or --unknown."
            )
        data = published_model()
    measured = measurement(data, plan.data, file.design)
    cases = [_case_of(file, plan, choices) for choices in plan.combinations()]
    fitted = [case for case in cases if not case.reason]
    if not fitted:
        raise GoalError(f"no combination has a fit: {cases[0].reason}")
    numbers, problems = (measured.values, measured.std, measured.weight), []
    for case in fitted:
        rows = [
            (one.low, one.high, *((np.nan, np.inf) if one.prior_std is None else (one.prior_mean, one.prior_std)))
            for one in case.unknowns
        ]
        low, high, mean, std = np.array(rows, dtype=np.float64).T
        problems.append(Problem(low, high, case.start, mean, std, *numbers, measured.noise_freedom))
    with open_executor(workers) as executor:
        fits = _fit_all(fitted, problems, measured, executor, store_to_keep(keep), progress)
    solved: list[Solution] = []
    unsolved = [case for case in cases if case.reason]
    for case, problem, one in zip(fitted, problems, fits, strict=True):
        if one.problem:
            unsolved.append(replace(case, reason=one.problem))
        else:
            solved.append(Solution(case, problem, one, *posterior(problem, one)))
    solved.sort(key=lambda row: -row.log_evidence)
    if not solved:
        raise GoalError(f"no combination has a fit: {unsolved[0].reason}")
    best = solved[0]
    values = dict(zip(best.case.names, best.fit.point.tolist(), strict=True))
    document, imperfections = best.case.changed(best.fit.point)
    found = [entry for unknown in best.case.unknowns for entry in unknown.entry]
    found += [key for choice in best.case.choices for key in choice.set]
    # the document of the case with title, source and remaining assumptions
    says = {key: file.document[key] for key in file.document if key in document or key in SAYS_NOTHING}
    whole = no_longer_assumed({**says, **document}, found)
    known = build_design_file(document, file.design.name).values
    assumed = {key: reason for key, reason in whole.pop("assumed", {}).items() if key in known}
    return Calibration(
        build_design_file(whole | ({"assumed": assumed} if assumed else {}), file.design.name, file.text),
        imperfections_of(imperfections),
        values,
        result_dataset(file.design, measured, plan, (*solved, *unsolved)),
    )


def _case_of(file: DesignFile, plan: Plan, choices: tuple[Choice, ...]) -> Case:
    name = ", ".join(choice.name for choice in choices) or "as designed"
    unknowns = tuple(plan.unknowns_of(choices))
    document = decisive(file.document)
    changes = {key: value for choice in choices for key, value in choice.set.items()}
    try:
        for key in (key for choice in choices for key in choice.without):
            document = _without(document, key.split("."), key)
        document = vary_document(document, changes)
    except DesignError as error:
        return Case(name, choices, unknowns, document, np.empty(0), str(error))
    starts = []
    for unknown in unknowns:  # the given first guess, the design's value, or the middle
        own = 0.0 if unknown.name.startswith(IMPERFECTION) else changes.get(unknown.name, value_of(file, unknown.name))
        if unknown.start is not None:
            starts.append(unknown.start)
        elif isinstance(own, int | float) and unknown.low <= own <= unknown.high:
            starts.append(float(own))
        else:
            starts.append((unknown.low + unknown.high) / 2)
    case = Case(name, choices, unknowns, document, np.array(starts))
    try:  # a misspelt key is found before any work
        build_design(case.changed(case.start)[0], file.design.name)
    except DesignError as error:
        return replace(case, reason=str(error))
    return case


def _without(table: Any, parts: Sequence[str], key: str) -> Any:
    """Return tables without an entry, which must exist."""
    if isinstance(table, list) and parts[0].isdecimal() and int(parts[0]) < len(table) and len(parts) > 1:
        place = int(parts[0])
        return [*table[:place], _without(table[place], parts[1:], key), *table[place + 1 :]]
    if not isinstance(table, Mapping) or parts[0] not in table:
        raise DesignError(f"{key} is not in the design, so it cannot be removed.")
    rest = {name: value for name, value in table.items() if name != parts[0]}
    return rest if len(parts) == 1 else {**rest, parts[0]: _without(table[parts[0]], parts[1:], key)}


def _fit_all(
    cases: Sequence[Case],
    problems: Sequence[Problem],
    measured: Measurement,
    executor: Executor,
    store: Store | None,
    progress: Progress | None,
) -> list[Fit]:
    total = sum(2 * len(case.unknowns) + 1 + _GUESSED_STEPS for case in cases)
    starts = [case.changed(case.start)[0] for case in cases]  # an entry that a choice needs may be an unknown
    done = 0

    def item(k: int, point: FloatArray) -> dict[str, Any] | str:
        try:
            document, imperfections = cases[k].changed(point)
        except DesignError as error:
            return f"{cases[k].document['name']}: {error}"
        circuit = any(entry.startswith("circuit.") for one in cases[k].unknowns for entry in one.entry)
        parts = str(store.folder) if store is not None and circuit else ""
        return {
            "document": document,
            "imperfections": imperfections,
            "start": starts[k],
            "parts": parts,
            "request": measured.request,
        }

    driver = together([fit(problem) for problem in problems])
    try:
        points = next(driver) if cases else []
        while points:
            outcomes: list[FloatArray | str] = [""] * len(points)
            items = [item(k, point) for k, point in points]
            for index, outcome in run_cached(evaluate_model, items, executor, store):
                outcomes[index] = outcome if isinstance(outcome, str) else np.array(list(outcome.values()))
                done += 1
                if progress is not None:
                    progress(done, max(total, done + 1))
            points = driver.send(outcomes)
    except StopIteration as stop:
        return list(stop.value)
    return []


def calibrated_imperfections(calibration: xr.Dataset) -> Imperfections:
    """Return the fitted imperfections of the best combination."""
    best = _best(calibration)
    values = dict(zip(best.unknown.values.tolist(), best["value"].values.tolist(), strict=True))
    return imperfections_of(separated(values)[1])


def posterior_draws(
    design: Design | DesignFile, calibration: xr.Dataset, count: int
) -> list[tuple[Design, Imperfections]]:
    """Draw designs and imperfections from a calibration's best combination."""
    # GoalError for fewer than `count` draws in the dataset, DesignError if the design lacks an entry
    best = _best(calibration)
    if not 1 <= count <= best.sizes["draw"]:
        raise GoalError(f"the number of draws must be from 1 to {best.sizes['draw']}; got {count}.")
    file = as_file(design)
    keys = [str(entries).split() for entries in best.entries.values]
    rows = best.posterior.values[np.linspace(0, best.sizes["draw"] - 1, count).astype(int)]
    drawn = []
    for row in rows.tolist():
        values = {key: value for entries, value in zip(keys, row, strict=True) for key in entries}
        changes, errors = separated(values)
        built = build_design(vary_document(file.document, changes), file.design.name)
        drawn.append((built, imperfections_of(errors)))
    return drawn


def _best(calibration: xr.Dataset) -> xr.Dataset:
    best = CALIBRATION.checked(calibration, "the dataset").isel(combination=0)
    own = np.flatnonzero(np.isfinite(best["value"].values))
    return best[list(CALIBRATION.variables)].isel(unknown=own)
