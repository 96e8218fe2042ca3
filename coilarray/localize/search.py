"""Search for likely positions: table scan and refinement.

Both minimise χ²(θ) = |W (δ − model(θ))|², which is −2 ln of the likelihood up to a constant, for
many readings at once. W is the whitening of `coilarray.localize.forward`.

The scan examines the cells of the table. Around the centre θ_c of a cell the model is taken as
linear, and a step u away from the centre, in sizes of the cell, costs |u|². The minimum over u has
a closed form,

    min_u |e − J u|² + |u|² = |e|² − |Qᵀe|²,   e = W (δ − model(θ_c)),  Q = J L⁻ᵀ,   L Lᵀ = 1 + JᵀJ,

so that the scan also finds narrow valleys that pass between the centres. The refinement is the
method of Levenberg and Marquardt with Nielsen's rule for the damping (K. Madsen, H. B. Nielsen, O.
Tingleff, Methods for Non-Linear Least Squares Problems, 2004, sect. 3.2) inside the bounds of the
table.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.ndimage import minimum_filter

from coilarray.compute.arrays import BoolArray, FloatArray, IntArray
from coilarray.compute.threads import ranges
from coilarray.localize.forward import ForwardModel, Whitening, whitening_of

_MOST_CELLS = 64  # along x and along y, more only if the table is finer
_DEPTH_CELLS = 8
_STARTS = 12  # of one reading, enough to find the least χ² of 200 random starts
_FARTHEST = 2.0  # step of the scan in sizes of a cell, the model is not linear much longer
_BLOCK = 64  # readings scanned together, a few MB
_UNIT = 0.1  # of the table's shorter side, and of its depths: steps that the damping treats alike
_ITERATIONS = 100
_SETTLED = 1e-6  # predicted fall of χ² of a step (a standard deviation is a fall by 1)
_LEAST_DAMPING = 1e-10  # of the trace of the normal matrix, which a state without response leaves singular


@dataclass(frozen=True, eq=False)
class Scan:
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

    def badness(self, readings: FloatArray) -> FloatArray:
        """Compute |e|² − |Qᵀe|² (n, *shape) for whitened readings."""
        offsets = np.einsum("fsc,cs->fc", self.forms, self.scaled)
        along = np.tensordot(readings, self.forms, axes=(1, 1))
        total = (readings**2).sum(axis=1)[:, None] - 2 * along[:, 0] + offsets[0]
        for k in range(1, len(self.forms)):
            total -= (along[:, k] - offsets[k]) ** 2
        return np.asarray(total.reshape(-1, *self.shape))


@lru_cache(maxsize=8)
def _kept_scan(model: ForwardModel, noise: tuple[float, ...] | None) -> Scan:
    return _scan_of(model, whitening_of(model, noise))


def _scan_of(model: ForwardModel, weights: Whitening) -> Scan:
    """Prepare the scan of a table for one covariance."""
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
    return Scan(shape, model.free, size, centres, scaled, slopes, np.ascontiguousarray(forms.T.swapaxes(0, 1)))


def starts(
    model: ForwardModel, readings: FloatArray, noise: FloatArray | None, weights: Whitening
) -> tuple[IntArray, FloatArray]:
    """Find positions to refine, the best local minima of cells.

    A cell counts if it is better than its neighbours in x and y. Returns points (m, 3) in m, not
    yet inside the bounds, and the rising index (m,) of their reading, which has at least one start.
    """
    alike = weights.deviations.ndim == 1  # else every reading has its own weights and its own scan
    scaled, size = weights.residuals(readings), _BLOCK if alike else 1
    kept = _kept_scan(model, None if noise is None else tuple(noise.tolist())) if alike else None
    found = [
        _starts(kept or _scan_of(model, weights.of(first)), scaled[first:last])
        for first, last in ranges(len(readings), size)
    ]
    owner = np.concatenate([part[0] + k * size for k, part in enumerate(found)])
    return owner, np.concatenate([part[1] for part in found])


def _starts(scan: Scan, readings: FloatArray) -> tuple[IntArray, FloatArray]:
    """Find the starts of readings by one scan."""
    badness = scan.badness(readings)
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
    step = _solve(J.swapaxes(1, 2) @ J + np.eye(len(scan.size)), (J.swapaxes(1, 2) @ e[..., None])[..., 0])
    points = scan.centres[cells]
    points[:, scan.free] += np.clip(step, -_FARTHEST, _FARTHEST) * scan.size
    return owner, points


def refine(
    model: ForwardModel, readings: FloatArray, points: FloatArray, weights: Whitening
) -> tuple[FloatArray, FloatArray]:
    """Minimise χ² from every start.

    Each start has a row of points (m, 3) in m and of readings (m, states). Starts outside the table
    begin on its border. Returns the points and their χ².
    """
    free = model.free
    unit, low, high = _units(model), model.lower[free], model.upper[free]
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
    step = _solve(H + (damping + floor)[:, None, None] * np.eye(g.shape[1]), g)
    return step, 2 * (g * step).sum(axis=1) - np.einsum("ni,nij,nj->n", step, H, step)


def _units(model: ForwardModel) -> FloatArray:
    """Lengths in m in which the parameters are comparable."""
    span = model.upper - model.lower
    side = min((length for length in span[:2].tolist() if length), default=0.0)
    return _UNIT * np.array([side, side, span[2]])[model.free]


def _residuals(
    model: ForwardModel, readings: FloatArray, points: FloatArray, weights: Whitening, unit: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Whitened residuals, and whitened slopes of the model per unit."""
    delta, jacobian = model.linear(points)
    return weights.residuals(readings - delta), weights.slopes(jacobian) * unit


def _solve(matrix: FloatArray, right: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.solve(matrix, right[..., None])[..., 0])
