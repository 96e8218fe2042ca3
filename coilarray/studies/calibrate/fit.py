"""Least squares between bounds for a model that takes seconds, and its posterior.

Gauss–Newton steps in a box with Marquardt's damping. The slopes are differences of evaluations at
the start and at the end, where they make the covariance. In between they are Broyden's updates (C.
G. Broyden, Math. Comput. 19, 577, 1965), which cost nothing. If the updates give no better point,
the slopes are evaluated again. A fit requests evaluations and does not make them, so several fits
can share the workers.

Draws between bounds are made by separation of variables (A. Genz, J. Comput. Graph. Stat. 1, 141,
1992). The variables are drawn one after another, each normal given the variables before it and cut
off at its bounds. The product of the probabilities inside the bounds is the weight of a draw, and
its mean is the probability of the box.
"""

from collections.abc import Generator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.optimize import lsq_linear
from scipy.special import gammaln, log_ndtr, logsumexp, ndtri_exp
from scipy.stats import chi2, qmc

from coilarray.compute.arrays import BoolArray, FloatArray
from coilarray.errors import GoalError

Asking = Generator[list[FloatArray], list["FloatArray | str"], "Fit"]
"""Generator of points (unknowns,).

It gets the model's numbers or an error at each, and returns the fit.
"""
_MOST_STEPS = 40
_STEP = 0.02  # of an unknown's range, for the first slopes
_STEPS = (1e-3, 0.1)  # the same for later ones: outside the noise of meshes and levels, and not far away
_ENOUGH = 1e-2  # of a unit of χ²/2: a fit that could gain less stands within 0.14 of its standard deviations
_DAMPING = 1e-3
_SHARE = 0.1  # of the gain predicted by the linear model: a step with less is not taken
_ABSENT = 10.0  # standard deviations assumed for a number that the model does not have
_ROUNDING = 1e-9  # of the data
_AT_BOUND = 1e-6  # of an unknown's range
_RIDGE = 1e-3  # standard deviations in an unknown's range that it has in any case, or the information is singular
_DRAWS = 4096  # of a scrambled Sobol sequence
DRAWS = 1000  # number of draws from the posterior of every combination


@dataclass(frozen=True, eq=False)
class Problem:
    """Least-squares problem of a fit, unknowns in any units."""

    low: FloatArray
    high: FloatArray
    start: FloatArray
    prior_mean: FloatArray  # NaN if flat
    prior_std: FloatArray  # infinite if flat
    measured: FloatArray  # these four as in `coilarray.studies.calibrate.plan.Measurement`
    std: FloatArray
    weight: FloatArray
    noise_freedom: float

    def __post_init__(self) -> None:
        if self.scale_freedom < 1:
            raise GoalError(
                f"{len(self.low)} unknowns and the scale of the noise need more than {len(self.low)} independent "
                f"numbers; the data have {self.numbers:.3g}."
            )

    @cached_property
    def numbers(self) -> float:
        """Number of independent numbers in the data."""
        return float(self.weight.sum())

    @property
    def freedom(self) -> float:
        """Degrees of freedom: independent numbers minus unknowns."""
        return self.numbers - len(self.low)

    @property
    def scale_freedom(self) -> float:
        """Degrees of freedom of the noise scale after the fit."""
        return self.freedom + self.noise_freedom

    @property
    def span(self) -> FloatArray:
        """Range of every unknown."""
        return self.high - self.low

    def residuals(self, values: FloatArray) -> FloatArray:
        """Weighted residuals (n,) of the model's numbers, in standard deviations."""
        off = np.where(self.weight > 0, (values - self.measured) / self.std, 0.0)
        return np.sqrt(self.weight) * np.where(np.isfinite(off), off, _ABSENT)

    def prior_residuals(self, point: FloatArray) -> FloatArray:
        """Distance from the prior means in standard deviations, or 0."""
        return np.where(np.isfinite(self.prior_std), (point - np.nan_to_num(self.prior_mean)) / self.prior_std, 0.0)

    def weighted(self, slopes: FloatArray) -> FloatArray:
        """Slopes of `residuals` (n, unknowns) from the model's slopes."""
        rows = np.where(self.weight > 0, np.sqrt(self.weight) / self.std, 0.0)[:, None] * slopes
        return np.where(np.isfinite(rows), rows, 0.0)

    def scale_at(self, residuals: FloatArray) -> float:
        """Scale of the noise: 1 if given, otherwise from residuals."""
        if np.isinf(self.noise_freedom):
            return 1.0
        square = float(residuals @ residuals + self.noise_freedom) / self.scale_freedom
        return max(float(np.sqrt(square)), self.least_scale)

    @cached_property
    def least_scale(self) -> float:
        """Lower limit of the noise scale, from the data's rounding."""
        known = self.weight > 0
        size = float(np.sqrt(np.mean((self.measured[known] / self.std[known]) ** 2)))
        return _ROUNDING * (size or 1.0)


@dataclass(frozen=True, eq=False)
class Fit:
    """Result of a fit, or the `problem` without one."""

    point: FloatArray  # the best
    values: FloatArray  # (n,), the model's numbers there
    before: FloatArray  # (n,), at the first guess
    slopes: FloatArray
    scale: float  # factor of all deviations
    converged: bool  # whether no better point is near
    evaluations: int
    problem: str = ""


def information(problem: Problem, fit: Fit) -> FloatArray:
    """Information matrix of data and priors, positive definite."""
    rows = problem.weighted(fit.slopes) / fit.scale
    prior = 1 / problem.prior_std**2 + (_RIDGE / problem.span) ** 2
    return np.asarray(rows.T @ rows + np.diag(prior))


def at_bound(problem: Problem, point: FloatArray) -> BoolArray:
    """Whether each unknown is at a bound."""
    return np.minimum(point - problem.low, problem.high - point) < _AT_BOUND * problem.span


def fit(problem: Problem) -> Asking:
    """Fit the unknowns of a problem, driven as in `Asking`."""
    asked = 1
    point = np.clip(problem.start, problem.low, problem.high)
    (first,) = yield [point]
    if isinstance(first, str):
        nothing = np.empty(0)
        return Fit(nothing, nothing, nothing, np.empty((0, len(point))), 1.0, False, 1, first)
    values = before = first
    slopes, made, reason = yield from _slopes(problem, point, values, np.full(len(point), _STEP))
    asked, fresh, damping, converged = asked + made, True, _DAMPING, False
    scale = problem.scale_at(problem.residuals(values))
    for _ in range(_MOST_STEPS):
        if reason:
            return Fit(point, values, before, slopes, scale, False, asked, reason)
        now = Fit(point, values, before, slopes, scale, converged, asked)
        if _gain(problem, now, _step(problem, now, 0.0)) < _ENOUGH:
            if fresh:
                converged = True
                break
        else:
            move = _step(problem, now, damping)
            expected = _gain(problem, now, move)
            (outcome,) = yield [point + move]
            asked += 1
            if not isinstance(outcome, str):
                gained = _cost(problem, point, values, scale) - _cost(problem, point + move, outcome, scale)
                if gained > _SHARE * expected:
                    along = move / problem.span**2
                    slopes = slopes + np.outer(outcome - values - slopes @ move, along) / (move @ along)
                    point, values, fresh = np.clip(point + move, problem.low, problem.high), outcome, False
                    scale = problem.scale_at(problem.residuals(values))
                    damping = max(damping / 5, _DAMPING / 100)
                    continue
            if fresh:
                if expected < _ENOUGH:  # no short step gains either, if the slopes were taken here
                    converged = True
                    break
                damping *= 10
                continue
        # half a standard deviation of every unknown, so that the data change by half of their noise
        deviation = np.sqrt(np.diag(np.linalg.inv(information(problem, now))))
        steps = np.clip(0.5 * deviation / problem.span, *_STEPS)
        slopes, made, reason = yield from _slopes(problem, point, values, steps)
        asked, fresh = asked + made, True
    return Fit(point, values, before, slopes, scale, converged, asked)


def _slopes(
    problem: Problem, point: FloatArray, values: FloatArray, steps: FloatArray
) -> Generator[list[FloatArray], list[FloatArray | str], tuple[FloatArray, int, str]]:
    """Slopes of the model's numbers, evaluations, and any failure."""
    slopes, reason = np.zeros((len(values), len(point))), ""
    inwards = np.where(point + steps * problem.span <= problem.high, 1.0, -1.0)
    todo, made = list(range(len(point))), 0
    for sign in (1.0, -1.0):
        moves = {k: sign * inwards[k] * steps[k] * problem.span[k] for k in todo}
        moves = {k: move for k, move in moves.items() if problem.low[k] <= point[k] + move <= problem.high[k]}
        if not moves:
            break
        outcomes = yield [point + move * np.eye(len(point))[k] for k, move in moves.items()]
        made += len(moves)
        for (k, move), outcome in zip(moves.items(), outcomes, strict=True):
            if isinstance(outcome, str):
                reason = outcome
            else:
                slopes[:, k] = (outcome - values) / move
                todo.remove(k)
    return slopes, made, reason if todo else ""


def _rows(problem: Problem, now: Fit) -> tuple[FloatArray, FloatArray]:
    """Slopes by ranges of the unknowns, and residuals, in deviations."""
    data = problem.weighted(now.slopes) * problem.span / now.scale
    prior = np.diag(problem.span / problem.prior_std)
    offsets = problem.residuals(now.values) / now.scale, problem.prior_residuals(now.point)
    return np.vstack((data, prior)), np.concatenate(offsets)


def _step(problem: Problem, now: Fit, damping: float) -> FloatArray:
    """Damped least-squares step of the linear model in the box."""
    slopes, offsets = _rows(problem, now)
    size = np.sqrt((slopes**2).sum(axis=0) + _RIDGE**2)
    matrix = np.vstack((slopes, np.sqrt(damping) * np.diag(size))) if damping else slopes
    target = np.concatenate((-offsets, np.zeros(len(matrix) - len(offsets))))
    where = (now.point - problem.low) / problem.span
    box = np.minimum(-where, -1e-15), np.maximum(1 - where, 1e-15)
    move = np.clip(lsq_linear(matrix, target, bounds=box, method="bvls").x, -where, 1 - where)
    return np.asarray(move * problem.span)


def _gain(problem: Problem, now: Fit, move: FloatArray) -> float:
    """Reduction of χ²/2 by a step in the linear model."""
    slopes, offsets = _rows(problem, now)
    after = offsets + slopes @ (move / problem.span)
    return float(offsets @ offsets - after @ after) / 2


def _cost(problem: Problem, point: FloatArray, values: FloatArray, scale: float) -> float:
    """χ²/2 of data and priors."""
    data, prior = problem.residuals(values) / scale, problem.prior_residuals(point)
    return float(data @ data + prior @ prior) / 2


def together(fits: Sequence[Asking]) -> Generator[list[tuple[int, FloatArray]], list[FloatArray | str], list[Fit]]:
    """Drive fits side by side, yielding fit numbers and points."""
    ended: dict[int, Fit] = {}
    asking = {k: next(one) for k, one in enumerate(fits)}
    while asking:
        outcomes = iter((yield [(k, point) for k, points in asking.items() for point in points]))
        answers = {k: [next(outcomes) for _ in points] for k, points in asking.items()}
        asking = {}
        for k, answer in answers.items():
            try:
                asking[k] = fits[k].send(answer)
            except StopIteration as stop:
                ended[k] = stop.value
    return [ended[k] for k in range(len(fits))]


def posterior(problem: Problem, found: Fit) -> tuple[FloatArray, FloatArray, float]:
    """Covariance, draws and log evidence of a fit."""
    covariance = np.linalg.inv(information(problem, found))
    covariance = (covariance + covariance.T) / 2
    from_data = problem.weighted(found.slopes).T @ problem.residuals(found.values) / found.scale**2
    slope = from_data + problem.prior_residuals(found.point) / problem.prior_std  # of χ²/2 of data and priors
    pull = covariance @ slope
    draws, inside = bounded_normal(
        found.point - pull, covariance, problem.low, problem.high, DRAWS, problem.scale_freedom
    )
    shift = float(slope @ pull) / 2
    volume = (len(found.point) * np.log(2 * np.pi) + float(np.linalg.slogdet(covariance)[1])) / 2
    evidence = _log_likelihood(problem, found) + _log_prior(problem, found.point) + shift + volume + inside
    return covariance, draws, evidence


def _log_likelihood(problem: Problem, found: Fit) -> float:
    """Log-likelihood of the data, averaged over scales unless given."""
    # The square of the scale has the scaled inverse χ² prior with `noise_freedom`, 1/s² if nothing is known.
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
    flat = ~np.isfinite(problem.prior_std)
    every = (problem.low, problem.high, problem.prior_mean, problem.prior_std, point)
    low, high, mean, std, at = (values[~flat] for values in every)
    below, above = log_ndtr((low - mean) / std), log_ndtr((high - mean) / std)
    mass = above + np.log1p(-np.exp(below - above))
    normal = ((at - mean) / std) ** 2 / 2 + np.log(np.sqrt(2 * np.pi) * std) + mass
    total = -np.log(problem.span[flat]).sum() - normal.sum()
    return float(total)


def bounded_normal(
    mean: FloatArray, covariance: FloatArray, low: FloatArray, high: FloatArray, count: int, freedom: float = np.inf
) -> tuple[FloatArray, float]:
    """Draw (count, n) within bounds, with the log of their probability."""
    # A finite `freedom` gives Student's distribution, as the scale is only estimated.
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
