"""Posteriors, evidences and undetermined directions of fits of several combinations.

Draws between bounds are made by separation of variables (A. Genz, J. Comput. Graph. Stat. 1, 141,
1992). The variables are drawn one after another, each normal given the variables before it and cut
off at its bounds. The product of the probabilities inside the bounds is the weight of a draw, and
its mean is the probability of the box.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr
from scipy.special import gammaln, log_ndtr, logsumexp, ndtri_exp
from scipy.stats import chi2, f, qmc

from coilarray.circuit.coupling import provenance
from coilarray.compute.arrays import FloatArray
from coilarray.design.keys import entry_unit
from coilarray.design.model import Design
from coilarray.design.vary import vary_document
from coilarray.response.setup import indentation_of
from coilarray.studies.calibrate.data import Measurement
from coilarray.studies.calibrate.fit import Fit, Problem, at_bound, gradient, information
from coilarray.studies.calibrate.plan import Choice, Plan, Unknown, separated

_DRAWS = 4096  # of a scrambled Sobol sequence
DRAWS = 1000
"""Number of draws from the posterior of every combination."""
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


def bounded_normal(
    mean: FloatArray, covariance: FloatArray, low: FloatArray, high: FloatArray, count: int, freedom: float = np.inf
) -> tuple[FloatArray, float]:
    """Draw from a normal distribution with bounds (n,).

    Returns draws (count, n), and the logarithm of the normal probability of the box. With a finite
    `freedom` the draws are from Student's distribution, whose scale is only estimated.
    """
    n = len(mean)
    lower = np.asarray(np.linalg.cholesky(covariance), dtype=np.float64)
    parts = np.clip(qmc.Sobol(n + 1, seed=np.random.default_rng(0)).random(_DRAWS), 1e-12, 1 - 1e-12)
    normal, weight = _separated(mean, lower, low, high, parts[:, :n], np.ones(_DRAWS))
    probability = float(logsumexp(weight) - np.log(_DRAWS))
    if np.isfinite(freedom):
        scale = np.sqrt(freedom / chi2.ppf(parts[:, n], freedom))
        normal, weight = _separated(mean, lower, low, high, parts[:, :n], scale)
    shares = np.exp(weight - logsumexp(weight))
    order = np.random.default_rng(0).permutation(_DRAWS)  # every fourth point of the sequence would not fill the space
    kept = np.searchsorted(np.cumsum(shares[order]), (np.arange(count) + 0.5) / count).clip(max=_DRAWS - 1)
    return normal[order[kept]], probability


def _separated(
    mean: FloatArray, lower: FloatArray, low: FloatArray, high: FloatArray, parts: FloatArray, scale: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Points from numbers between 0 and 1, with log weights."""
    normal, weight = np.zeros_like(parts), np.zeros(len(parts))
    for k in range(len(mean)):
        shift = mean[k] + scale * (normal @ lower[k])
        a, b = ((bound[k] - shift) / (scale * lower[k, k]) for bound in (low, high))
        upper = a > 0  # both tails are taken at the left, where logarithms are exact
        left, right = np.where(upper, -b, a), np.where(upper, -a, b)
        below, above = log_ndtr(left), log_ndtr(right)
        mass = above + np.log1p(-np.exp(np.minimum(below - above, -1e-300)))
        at = ndtri_exp(np.minimum(np.logaddexp(below, np.log(parts[:, k]) + mass), above))
        normal[:, k] = np.clip(np.where(upper, -at, at), a, b)
        weight += mass
    return np.clip(mean + scale[:, None] * (normal @ lower.T), low, high), weight


@dataclass(frozen=True, eq=False)
class Case:
    """Combination of choices with document, unknowns and start."""

    name: str
    choices: tuple[Choice, ...]
    document: Mapping[str, Any]
    unknowns: tuple[Unknown, ...]
    start: FloatArray

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


@dataclass(frozen=True)
class Unsolved:
    """Combination of choices without a fit, and the reason."""

    name: str
    choices: tuple[Choice, ...]
    unknowns: tuple[Unknown, ...]
    reason: str


@dataclass(frozen=True, eq=False)
class Solution:
    """Fitted combination with covariance, draws and figures."""

    case: Case
    problem: Problem
    fit: Fit
    covariance: FloatArray
    draws: FloatArray
    log_evidence: float


def solution(case: Case, problem: Problem, found: Fit) -> Solution:
    """Return posterior and evidence of a fit."""
    curvature = information(problem, found)
    covariance = np.linalg.inv(curvature)
    covariance = (covariance + covariance.T) / 2
    pull = covariance @ gradient(problem, found)
    draws, inside = bounded_normal(
        found.point - pull, covariance, problem.low, problem.high, DRAWS, problem.scale_freedom
    )
    shift = float(gradient(problem, found) @ pull) / 2
    volume = (len(found.point) * np.log(2 * np.pi) + float(np.linalg.slogdet(covariance)[1])) / 2
    evidence = _log_likelihood(problem, found) + _log_prior(problem, found.point) + shift + volume + inside
    return Solution(case, problem, found, covariance, draws, evidence)


def _log_likelihood(problem: Problem, found: Fit) -> float:
    """Log-likelihood of the data, averaged over scales unless given.

    The square of the scale has the scaled inverse χ² prior with `noise_freedom`. Its limit is 1/s²
    if nothing is known.
    """
    r, n, known = problem.residuals(found.values), problem.numbers, problem.noise_freedom
    square = float(r @ r)
    constant = -float(problem.weight @ np.log(np.sqrt(2 * np.pi) * problem.std))
    if np.isinf(known):
        return constant - square / 2
    square = max(square, n * problem.least_scale**2)
    averaged = constant + float(gammaln((n + known) / 2)) - (n + known) / 2 * np.log((square + known) / 2)
    averaged += known / 2 * np.log(known / 2) - float(gammaln(known / 2)) if known else -np.log(2)
    return float(averaged)


def _log_prior(problem: Problem, point: FloatArray) -> float:
    """Logarithm of the prior density, cut off at the bounds."""
    total = 0.0
    for low, high, mean, std, at in zip(
        problem.low, problem.high, problem.prior_mean, problem.prior_std, point, strict=True
    ):
        if not np.isfinite(std):
            total -= np.log(high - low)
            continue
        ends = log_ndtr(np.array([low - mean, high - mean]) / std)
        mass = ends[1] + np.log1p(-np.exp(ends[0] - ends[1]))
        total -= ((at - mean) / std) ** 2 / 2 + np.log(np.sqrt(2 * np.pi) * std) + mass
    return float(total)


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


def result_dataset(
    design: Design, measured: Measurement, plan: Plan, rows: Sequence[Solution | Unsolved]
) -> xr.Dataset:
    """Return all results in the given order, see `calibrate`."""
    combinations = [row if isinstance(row, Unsolved) else row.case for row in rows]
    names = list(dict.fromkeys(unknown.name for one in combinations for unknown in one.unknowns))
    n, m = len(names), len(measured.values)
    table = {key: np.full((len(rows), n), np.nan) for key in ("start", "value", "std", "low", "high")}
    bounds, correlation = np.zeros((len(rows), n), dtype=bool), np.full((len(rows), n, n), np.nan)
    draws = np.full((len(rows), DRAWS, n), np.nan)
    numbers = {key: np.full((len(rows), m), np.nan) for key in ("model", "before", "model_std", "residual")}
    figures = {key: np.full(len(rows), np.nan) for key in _FIGURES}
    said = [""] * len(rows)
    for i, row in enumerate(rows):
        if isinstance(row, Unsolved):
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
    reasons = [row.reason if isinstance(row, Unsolved) else "" for row in rows]
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
