"""Position and depth from δ by maximum likelihood.

For Gaussian noise of known covariance in δ, −2 ln of the likelihood is χ² up to a constant. The
relative error of a target's table is added to the variances, scaled by the δ of the reading. A
`Location` keeps every mode, which is every minimum of χ² in the likelihood region {θ : χ²(θ) − min
χ² ≤ q}. Here q is the quantile of χ² with as many degrees of freedom as unknowns. On a board that
is symmetric in y both signs of y are modes.

The minima are found by a scan and a refinement, for many readings at once. The scan examines the
cells of the table. Around the centre θ_c of a cell the model is taken as linear, and a step u away
from the centre, in sizes of the cell, costs |u|². The minimum over u has a closed form,

    min_u |e − J u|² + |u|² = |e|² − |Qᵀe|²,   e = W (δ − model(θ_c)),  Q = J L⁻ᵀ,   L Lᵀ = 1 + JᵀJ,

with W the whitening of `coilarray.localize.forward`, so that the scan also finds narrow valleys
that pass between the centres. The refinement is the method of Levenberg and Marquardt with
Nielsen's rule for the damping (K. Madsen, H. B. Nielsen, O. Tingleff, Methods for Non-Linear Least
Squares Problems, 2004, sect. 3.2) inside the bounds of the table.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise, zip_longest
from typing import Literal

import numpy as np
import numpy.typing as npt
from scipy.ndimage import minimum_filter
from scipy.special import chdtrc, chdtri

from coilarray.compute.arrays import BoolArray, FloatArray, IntArray
from coilarray.compute.display_units import true_minus
from coilarray.compute.table import html_card, html_table
from coilarray.compute.threads import ranges
from coilarray.errors import LocalizeError, listed
from coilarray.localize.forward import ForwardModel, Whitening, checked_noise, require_states, whitening_of
from coilarray.localize.identifiability import covariance_of
from coilarray.response.interpolation import PARAMETERS

Verdict = Literal["found", "border", "outside", "no fit", "nothing pressed", "refused"]
"""Result of a reading: a position in the table, on its border or outside, no position that fits, no
indentation beyond the noise, or an invalid reading."""

Reading = Mapping[str, float] | Sequence[float] | FloatArray
"""δ by the names of the states, or in the order of the model's states."""

UNKNOWN_DEVIATION = 0.1  # standard deviation in m from which a coordinate counts as unknown: it is larger than a board
CONFIDENCE = 0.95  # confidence of regions, and so of the modes that are kept
ALARM = 1e-3  # probability that a reading that the model explains is reported as "no fit"
_SAME = 1.0  # two minima nearer than one standard deviation are one mode
_BENT = 2.0  # factor by which χ² may differ from its parabola for a Gaussian mode
_LEAST = 1e-13  # of eigenvalues, against division by zero if the information is singular
_BLOCK = 1000  # readings solved together, some 10 MB
_MOST_CELLS = 64  # along x and along y, more only if the table is finer
_DEPTH_CELLS = 8
_STARTS = 12  # of one reading, enough to find the least χ² of 200 random starts
_FARTHEST = 2.0  # step of the scan in sizes of a cell, the model is not linear much longer
_SCANNED = 64  # readings scanned together, a few MB
_UNIT = 0.1  # of the table's shorter side, and of its depths: steps that the damping treats alike
_ITERATIONS = 100
_SETTLED = 1e-6  # predicted fall of χ² of a step (a standard deviation is a fall by 1)
_LEAST_DAMPING = 1e-10  # of the trace of the normal matrix, which a state without response leaves singular


@dataclass(frozen=True, eq=False)
class Mode:
    """Position `x`, `y`, `depth` in m that explains a reading.

    `information` is the Fisher information in 1/m², and `chi_square` belongs to the residuals. If
    `gaussian`, χ² rises at the ends of the axes of its ellipsoid by the expected amount within a
    factor of 2, with all ends in the table. Otherwise the region follows from `deviance`. `border`
    are coordinates on the border of the table, `free` the numbers of the unknowns, and `unread` the
    states that the converter cannot read there. `span` is the extent of the table along x, y and
    depth in m: a coordinate with a larger standard deviation is not determined.
    """

    x: float
    y: float
    depth: float
    information: FloatArray
    chi_square: float
    gaussian: bool = False
    border: tuple[str, ...] = ()
    free: tuple[int, ...] = ()
    unread: tuple[str, ...] = ()
    span: tuple[float, ...] = (UNKNOWN_DEVIATION,) * 3

    @property
    def unknowns(self) -> list[int]:
        """Indices of the unknowns among x, y and depth."""
        return list(self.free or range(len(self.information)))

    @property
    def covariance(self) -> FloatArray:
        """Inverse of the information in m², shape (unknowns, unknowns)."""
        return covariance_of(self.information)

    @property
    def deviations(self) -> FloatArray:
        """Standard deviations (unknowns,) of x, y and depth in m."""
        return np.sqrt(np.diagonal(self.covariance))

    @property
    def known_deviations(self) -> tuple[float | None, ...]:
        """Deviations in m of x, y, depth, None from the `span` on."""
        found = dict(zip(self.unknowns, self.deviations.tolist(), strict=True))
        return tuple(found[k] if found.get(k, np.inf) < self.span[k] else None for k in range(max(found) + 1))


@dataclass(frozen=True, eq=False)
class Location:
    """Position of the indentation from one reading, with its uncertainty.

    `reason` says why for any `verdict` but ``"found"``. `modes` are in order, best first, and empty if
    nothing is pressed or the reading is refused. `chi_square` is χ² of the best mode, or of no
    indentation if nothing is pressed, with its `degrees_of_freedom`, None and 0 for a refused reading.
    Noise alone makes χ² as large or larger with `probability`.
    """

    verdict: Verdict
    reason: str = ""
    modes: tuple[Mode, ...] = ()
    chi_square: float | None = None
    degrees_of_freedom: int = 0
    probability: float | None = None

    def __repr__(self) -> str:
        return f"<Location: {' '.join(location_lines(self))}>"

    def _repr_html_(self) -> str:
        return html_card(f"Location: {self.verdict}", html_table((), [(line,) for line in location_lines(self)]))

    @property
    def best(self) -> Mode:
        """Most likely mode, or a LocalizeError without modes."""
        if not self.modes:
            raise LocalizeError(f"there is no position: {self.reason}")
        return self.modes[0]

    @property
    def ambiguous(self) -> bool:
        """True if there is more than one mode."""
        return len(self.modes) > 1


def location_lines(location: Location) -> list[str]:
    """Say where something presses, the likeliest first, or why that is not known.

    >>> location_lines(Location("nothing pressed", "nothing is pressed."))
    ['Nothing is pressed.']
    """
    reason = [location.reason[:1].upper() + location.reason[1:]] if location.reason else []
    return reason + [f"{'Or pressed' if k else 'Pressed'} at {mode_text(one)}." for k, one in enumerate(location.modes)]


def mode_text(mode: Mode) -> str:
    """Return position and uncertainty of a mode in words."""
    parts = []
    values = zip_longest(("x", "y", "depth"), (mode.x, mode.y, mode.depth), mode.known_deviations)
    for k, (name, value, sigma) in enumerate(values):
        known = k not in mode.unknowns or sigma is not None
        text = f"{name} = {round(value * 1e3, 2) + 0.0:.2f}{'' if sigma is None else f' ± {sigma * 1e3:.2g}'} mm"
        parts.append(text if known else f"{name} not determined")
    cannot = f"; the converter cannot read {listed(mode.unread)} there" if mode.unread else ""
    return true_minus(", ".join(parts)) + cannot


def locate(
    model: ForwardModel,
    reading: Reading,
    *,
    noise: npt.ArrayLike | None = None,
    confidence: float = CONFIDENCE,
    alarm: float = ALARM,
) -> Location:
    """Find the position of an indentation from one reading.

    Parameters
    ----------
    model : ForwardModel
        Model of the board.
    reading : mapping of str to float, or array_like, shape (states,)
        δ by name, or in the model's order. A coil that is missing or NaN is refused. To locate
        without it use ``model.select([...])``.
    noise : array_like, scalar or shape (states,), optional
        Standard deviation of δ. By default the noise of the model.
    confidence : float
        Confidence of the region whose modes are kept.
    alarm : float
        Least probability of the residuals at which a position still fits, and of the reading itself
        at which it still counts as noise.

    Returns
    -------
    Location
        Every position that fits the reading, in m, the most likely one first. LocalizeError is
        raised for a reading with states that are unknown or missing, of another length or with a δ
        that is not between −1 and 1, and for a model with fewer states than unknowns.

    Examples
    --------
    >>> import xarray as xr
    >>> from coilarray.localize.forward import forward_model
    >>> axis, h = np.linspace(-10e-3, 10e-3, 21), np.linspace(0.25e-3, 1.75e-3, 7)
    >>> far = lambda x, y: np.hypot(axis - x, axis[:, None] - y) / 8e-3
    >>> coils = [np.exp(-far(*at) ** 2) for at in [(-6e-3, -3e-3), (6e-3, -3e-3), (0, 5e-3), (0, -6e-3)]]
    >>> delta = 0.6 * h[:, None, None, None] * np.stack(coils, axis=-1)
    >>> coords = {"depth": h, "y": axis, "x": axis, "state": ["a", "b", "c", "d"]}
    >>> model = forward_model(xr.Dataset({"delta": (("depth", "y", "x", "state"), delta)}, coords))
    >>> found = locate(model, dict(zip("abcd", model.delta([2e-3, 1e-3, 1e-3]))))
    >>> found.verdict, len(found.modes), round(found.best.x * 1e3, 3), found.best.deviations.round(5)
    ('found', 1, 2.0, array([1.5e-04, 1.1e-04, 2.0e-05]))
    """
    return _solve(model, [checked_reading(model.states, reading)], noise, confidence, alarm)[0]


def locate_all(
    model: ForwardModel,
    readings: Iterable[Reading],
    *,
    noise: npt.ArrayLike | None = None,
    confidence: float = CONFIDENCE,
    alarm: float = ALARM,
) -> list[Location]:
    """Locate many readings, as "refused" if `locate` would raise."""
    results: list[Location | None] = []
    good = []
    for reading in readings:
        try:
            good.append(checked_reading(model.states, reading))
            results.append(None)
        except LocalizeError as error:
            results.append(Location("refused", str(error)))
    found = iter(_solve(model, good, noise, confidence, alarm))
    return [next(found) if result is None else result for result in results]


def deviance(
    model: ForwardModel,
    reading: Reading,
    location: Location,
    points: npt.ArrayLike,
    *,
    noise: npt.ArrayLike | None = None,
) -> FloatArray:
    """Rise of χ² at points above the best mode.

    The points with a deviance up to the quantile of χ² are the likelihood region. It follows curved
    valleys and holds all modes, so it keeps its confidence even if the ellipsoids of the
    modes do not. Compare it with the quantile of χ² for as many degrees of freedom as unknowns,
    7.81 for three. `location` is that of the `reading`, with `model` and `noise` as in `locate`.
    The `points` of shape (…, 3) are x, y and depth in m, and the dimensionless deviance has the
    shape (…). Raises LocalizeError as `locate` and `ForwardModel.delta`, and without a mode.
    """
    row = checked_reading(model.states, reading)
    chi_square = whitening_of(model, noise, row).chi_square(row - model.delta(points))
    return np.asarray(chi_square - location.best.chi_square)


def _solve(
    model: ForwardModel, rows: Sequence[FloatArray], noise: npt.ArrayLike | None, confidence: float, alarm: float
) -> list[Location]:
    sigma = None if noise is None else checked_noise(model.states, noise)
    for name, value in (("confidence", confidence), ("alarm", alarm)):
        if not 0 < value < 1:
            raise LocalizeError(f"{name} must be between 0 and 1; got {value}.")
    require_states(model.states, model.unknowns)
    result: list[Location] = []
    for first, last in ranges(len(rows), _BLOCK):
        result += _solve_block(model, np.array(rows[first:last]), sigma, confidence, alarm)
    return result


def _solve_block(
    model: ForwardModel, readings: FloatArray, noise: FloatArray | None, confidence: float, alarm: float
) -> list[Location]:
    states = len(model.states)
    nothing = whitening_of(model, noise).chi_square(readings)
    chances = chdtrc(states, nothing)
    what = "nothing is pressed" if model.parameters == PARAMETERS else "no target is noticed"
    result = [
        Location(
            "nothing pressed",
            f"{what}: noise alone makes such a reading with a probability of {chance:.2g}.",
            chi_square=value,
            degrees_of_freedom=states,
            probability=chance,
        )
        for value, chance in zip(nothing.tolist(), chances.tolist(), strict=True)
    ]
    pressed = np.flatnonzero(chances <= alarm)
    if len(pressed):
        for k, (modes, pressure) in zip(pressed, _modes(model, readings[pressed], noise, confidence), strict=True):
            result[k] = _judged(modes, pressure, states, alarm)
    return result


def _modes(
    model: ForwardModel, readings: FloatArray, noise: FloatArray | None, confidence: float
) -> Iterator[tuple[tuple[Mode, ...], float]]:
    """Find the minima of χ² in the likelihood region, best first.

    Beside them is the fall of χ² beyond the border of the table, if the model were linear there.
    """
    quantile = float(chdtri(model.unknowns, 1 - confidence))
    of_readings = whitening_of(model, noise, readings)
    owner, points = _all_starts(model, readings, noise, of_readings)
    points, chi_square = refine(model, readings[owner], points, of_readings.of(owner))
    order = np.lexsort((chi_square, owner))
    owner, points, chi_square = owner[order], points[order], chi_square[order]
    best = chi_square[np.searchsorted(owner, np.arange(len(readings)))]
    kept = chi_square <= best[owner] + quantile
    owner, points, chi_square = owner[kept], points[kept], chi_square[kept]
    delta, jacobian = model.linear(points)
    weights = of_readings.of(owner)
    scaled = weights.slopes(jacobian)
    fisher = scaled.swapaxes(1, 2) @ scaled
    slope = np.einsum("nsi,ns->ni", scaled, weights.residuals(readings[owner] - delta))
    covariance = covariance_of(fisher)
    known = np.isfinite(covariance[:, 0, 0])
    pressure = np.einsum("ni,nij,nj->n", slope, np.where(known[:, None, None], covariance, 0.0), slope)
    pressure[points[:, 2] <= 0] = 0  # a depth below zero is no indentation either
    gaussian = known & _is_gaussian(model, readings[owner], points, chi_square, fisher, weights, quantile)
    edge = (points <= model.lower) | (points >= model.upper)
    unread, counted = model.unread_at(points), fisher
    missing: list[tuple[str, ...]] = [()] * len(points)
    if unread is not None:
        seen = whitening_of(model, noise, readings[owner], points).slopes(jacobian)
        counted, gaussian = seen.swapaxes(1, 2) @ seen, gaussian & ~unread.any(axis=-1)
        missing = [tuple(name for name, no in zip(model.states, row, strict=True) if no) for row in unread]
    span = tuple(np.minimum(model.upper - model.lower, UNKNOWN_DEVIATION).tolist())
    for first, last in pairwise(np.searchsorted(owner, np.arange(len(readings) + 1)).tolist()):
        modes = []
        for k in range(first, last):
            away = (points[k] - points[first:k])[:, model.free]
            if (np.einsum("ni,nij,nj->n", away, fisher[first:k], away) > _SAME).all():
                border = tuple(model.parameters[axis] for axis in model.free if edge[k, axis])
                x, y, depth = points[k].tolist()
                shown = (bool(gaussian[k]), border, tuple(model.free), missing[k], span)
                modes.append(Mode(x, y, depth, counted[k], float(chi_square[k]), *shown))
        yield tuple(modes), float(pressure[first])


def _is_gaussian(
    model: ForwardModel,
    readings: FloatArray,
    points: FloatArray,
    chi_square: FloatArray,
    fisher: FloatArray,
    weights: Whitening,
    quantile: float,
) -> BoolArray:
    """Test whether χ² rises as expected along every ellipsoid's axes."""
    scale = np.sqrt(np.maximum(np.diagonal(fisher, axis1=1, axis2=2), _LEAST))
    values, vectors = np.linalg.eigh(fisher / (scale[:, :, None] * scale[:, None, :]))
    axes = vectors / scale[:, :, None] * np.sqrt(quantile / np.maximum(values, _LEAST))[:, None, :]
    ends = np.repeat(points[:, None], 2 * axes.shape[-1], axis=1)
    ends[..., model.free] += np.concatenate((axes, -axes), axis=-1).swapaxes(1, 2)
    inside = ((ends >= model.lower) & (ends <= model.upper)).all(axis=(1, 2))
    result = np.zeros(len(points), dtype=bool)
    if inside.any():
        there = weights.of((inside, None)).chi_square(readings[inside, None] - model.delta(ends[inside]))
        rise = (there - chi_square[inside, None]) / quantile
        result[inside] = ((rise > 1 / _BENT) & (rise < _BENT)).all(axis=1)
    return result


def _judged(modes: tuple[Mode, ...], pressure: float, states: int, alarm: float) -> Location:
    best = modes[0]
    freedom = max(1, states - len(best.information) + len(best.border))
    probability = float(chdtrc(freedom, best.chi_square))
    edge = f"the best position is on the border of the table in {' and '.join(best.border)}"
    verdict: Verdict = "found"
    reason = ""
    if best.border and chdtrc(len(best.border), pressure) < alarm:
        verdict = "outside"
        reason = f"{edge}, and one outside would fit better: χ² would fall by about {pressure:.3g}."
    elif probability < alarm:
        verdict = "no fit"
        reason = (
            f"no position of the table explains the reading: χ² is {best.chi_square:.4g} with {freedom} degrees of "
            f"freedom, which noise exceeds with a probability of {probability:.1e}."
        )
    elif best.border:
        verdict = "border"
        reason = f"{edge}; the indenter may be outside."
    return Location(verdict, reason, modes, best.chi_square, freedom, probability)


def checked_reading(states: Sequence[str], reading: Reading) -> FloatArray:
    """Return δ (states,) of a reading in the states' order."""
    if isinstance(reading, Mapping):
        for name in reading:
            if name not in states:
                raise LocalizeError(f"the model has no state {name!r}; there are {', '.join(states)}.")
        if missing := [name for name in states if name not in reading]:
            are = "is" if len(missing) == 1 else "are"
            raise LocalizeError(f"a reading must have δ of every state; {listed(missing)} {are} missing.")
        reading = [reading[name] for name in states]
    try:
        values = np.asarray(reading, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise LocalizeError(f"δ must be numbers; got {reading!r}.") from error
    if values.shape != (len(states),):
        raise LocalizeError(f"a reading must have one δ for each of {len(states)} states; got shape {values.shape}.")
    bad = ~(np.abs(values) < 1)
    if bad.any():
        k = int(np.flatnonzero(bad)[0])
        raise LocalizeError(f"δ must be a number between -1 and 1; that of {states[k]} is {values[k]}.")
    return values


@dataclass(frozen=True, eq=False)
class _Scan:
    """Cells of the table, with a linear model around each.

    `size` (unknowns,) of a cell and `centres` (cells, 3) are in m. `scaled` (cells, states) is W
    times the model at the centre, and `slopes` (cells, states, unknowns) W times its change over a
    cell, J. `forms` (1 + unknowns, states, cells) has `scaled` and the columns of Q.
    """

    shape: tuple[int, int, int]
    free: list[int]
    size: FloatArray
    centres: FloatArray
    scaled: FloatArray
    slopes: FloatArray
    forms: FloatArray


@lru_cache(maxsize=8)
def _kept_scan(model: ForwardModel, noise: tuple[float, ...] | None) -> _Scan:
    return _scan_of(model, whitening_of(model, noise))


def _scan_of(model: ForwardModel, weights: Whitening) -> _Scan:
    # an even number of cells: on the middle line a symmetric board has no slope across it
    columns, rows = (max((min(len(axis), _MOST_CELLS + 1)) // 2 * 2, 1) for axis in (model.x, model.y))
    shape = (columns, rows, _DEPTH_CELLS if len(model.depth) > 1 else 1)
    span = model.upper - model.lower
    axes = [low + length * (np.arange(n) + 0.5) / n for low, length, n in zip(model.lower, span, shape, strict=True)]
    centres = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    size = (span / shape)[model.free]
    delta, jacobian = model.linear(centres)
    scaled, slopes = weights.residuals(delta), weights.slopes(jacobian) * size
    lower = np.linalg.cholesky(np.eye(model.unknowns) + slopes.swapaxes(1, 2) @ slopes)
    Q = np.linalg.solve(lower, slopes.swapaxes(1, 2))
    forms = np.concatenate((scaled[:, None], Q), axis=1)
    return _Scan(shape, model.free, size, centres, scaled, slopes, np.ascontiguousarray(forms.T.swapaxes(0, 1)))


def _all_starts(
    model: ForwardModel, readings: FloatArray, noise: FloatArray | None, weights: Whitening
) -> tuple[IntArray, FloatArray]:
    """Find positions to refine, the best local minima of cells.

    A cell counts if it is better than its neighbours in x and y. Returns points (m, 3) in m, also
    outside, and the rising index (m,) of their reading, which has at least one start.
    """
    alike = weights.deviations.ndim == 1  # else every reading has its own weights and its own scan
    scaled, size = weights.residuals(readings), _SCANNED if alike else 1
    kept = _kept_scan(model, None if noise is None else tuple(noise.tolist())) if alike else None
    found = [
        _starts(kept or _scan_of(model, weights.of(first)), scaled[first:last])
        for first, last in ranges(len(readings), size)
    ]
    owner = np.concatenate([part[0] + k * size for k, part in enumerate(found)])
    return owner, np.concatenate([part[1] for part in found])


def _starts(scan: _Scan, readings: FloatArray) -> tuple[IntArray, FloatArray]:
    offsets = np.einsum("fsc,cs->fc", scan.forms, scan.scaled)  # |e|² − |Qᵀe|² in every cell
    along = np.tensordot(readings, scan.forms, axes=(1, 1))
    total = (readings**2).sum(axis=1)[:, None] - 2 * along[:, 0] + offsets[0]
    for k in range(1, len(scan.forms)):
        total -= (along[:, k] - offsets[k]) ** 2
    badness = total.reshape(-1, *scan.shape)
    level = badness.argmin(axis=-1)
    least = np.take_along_axis(badness, level[..., None], axis=-1)[..., 0]
    hollow = least <= minimum_filter(least, size=(1, 3, 3), mode="nearest")
    ranked = np.where(hollow, least, np.inf).reshape(len(readings), -1)
    count = min(_STARTS, ranked.shape[1])
    places = np.argpartition(ranked, count - 1, axis=1)[:, :count]
    used = np.isfinite(np.take_along_axis(ranked, places, axis=1))
    owner, _ = np.nonzero(used)
    places = places[used]
    cells = places * scan.shape[2] + level.reshape(len(readings), -1)[owner, places]
    J, e = scan.slopes[cells], readings[owner] - scan.scaled[cells]
    step = _solved(J.swapaxes(1, 2) @ J + np.eye(len(scan.size)), (J.swapaxes(1, 2) @ e[..., None])[..., 0])
    points = scan.centres[cells]
    points[:, scan.free] += np.clip(step, -_FARTHEST, _FARTHEST) * scan.size
    return owner, points


def refine(
    model: ForwardModel, readings: FloatArray, points: FloatArray, weights: Whitening
) -> tuple[FloatArray, FloatArray]:
    """Minimise χ² from starts (m, 3) in m and their readings (m, states).

    Starts outside the table begin on its border. Returns the points and their χ².
    """
    free = model.free
    low, high = model.lower[free], model.upper[free]
    span = model.upper - model.lower
    side = min((length for length in span[:2].tolist() if length), default=0.0)
    unit = _UNIT * np.array([side, side, span[2]])[free]  # lengths in m in which the unknowns are comparable
    points = points.copy()
    points[:, free] = np.clip(points[:, free], low, high)
    e, A = _residuals(model, readings, points, weights, unit)
    chi_square = (e**2).sum(axis=1)
    damping, growth = np.ones(len(points)), np.full(len(points), 2.0)
    going = np.arange(len(points))
    for _ in range(_ITERATIONS):
        at = points[going][:, free]
        step, promised = _step(A[going], e[going], damping[going], at <= low, at >= high)
        trial = points[going]
        trial[:, free] = np.clip(at + step * unit, low, high)
        new_e, new_A = _residuals(model, readings[going], trial, weights.of(going), unit)
        new = (new_e**2).sum(axis=1)
        gain = np.minimum((chi_square[going] - new) / np.maximum(promised, _SETTLED * 1e-9), 2.0)
        better = new <= chi_square[going]
        taken, refused = going[better], going[~better]
        points[taken], e[taken], A[taken], chi_square[taken] = trial[better], new_e[better], new_A[better], new[better]
        damping[taken] *= np.clip(1 - (2 * gain[better] - 1) ** 3, 0.2, 2.0)
        growth[taken] = 2.0
        damping[refused] *= growth[refused]
        growth[refused] *= 2
        going = going[promised > _SETTLED]
        if not len(going):
            break
    return points, chi_square


def _step(
    A: FloatArray, e: FloatArray, damping: FloatArray, at_low: BoolArray, at_high: BoolArray
) -> tuple[FloatArray, FloatArray]:
    """Damped step in units within bounds, and its predicted fall."""
    g, H = np.einsum("nsi,ns->ni", A, e), A.swapaxes(1, 2) @ A
    held = (at_low & (g < 0)) | (at_high & (g > 0))
    g[held] = 0
    H[held] = 0
    H.swapaxes(1, 2)[held] = 0
    floor = _LEAST_DAMPING * (1 + np.einsum("nii->n", H))
    step = _solved(H + (damping + floor)[:, None, None] * np.eye(g.shape[1]), g)
    return step, 2 * (g * step).sum(axis=1) - np.einsum("ni,nij,nj->n", step, H, step)


def _residuals(
    model: ForwardModel, readings: FloatArray, points: FloatArray, weights: Whitening, unit: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Whitened residuals, and whitened slopes of the model per unit."""
    delta, jacobian = model.linear(points)
    return weights.residuals(readings - delta), weights.slopes(jacobian) * unit


def _solved(matrix: FloatArray, right: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.solve(matrix, right[..., None])[..., 0])
