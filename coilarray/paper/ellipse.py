"""Ellipses through level curves, half of the paper's model.

For a state of the scan and one depth, δ(x, y) is a hill over the coil. Its curves of equal δ are
modelled as ellipses

    (x − x0)²/A² + y²/B² = 1                                                             (Eq. 3)

with the centre on y = 0 and the axes along x and y. x0, A and B depend on δ (Gast & Zimmermann
2020, Sect. 4 and 5).

Details that the paper leaves open, and their interpretation here:

- *Refined by cubic interpolation*: the paper gives neither the factor nor which of MATLAB's two
  cubic rules. Here every spacing of the grid is divided into 20, with the spline that has no free
  ends ("not a knot", MATLAB's ``'spline'``).
- *A stepwise sweep*, threshold ±2e-5 and step 3e-5: all points of the refined map with |δ − d_k| at
  most 2e-5 belong to the level d_k, and neighbouring levels share a quarter of their points. The
  levels are the multiples of the step. The lowest, 3e-5, then reaches down to 1e-5 and leaves out δ
  = 0, where the map is flat. Points are left out that no path with δ of at least d_k − 2e-5
  connects with the largest δ, such as a few far away in a map with noise.
- *The fit* follows Gal (2003): linear least squares of the conic's coefficients about the mean of
  the points, without Gal's terms xy and y, which Eq. 3 does not have.
- *Which steps were kept* is not given. Here a step is refused if it has fewer than 6 points (twice
  the unknowns), if the conic is not an ellipse, or if its centre is outside the map.
- *The window* ends at x = ±26 and y = ±6 mm, so most curves are open arcs. They are fitted like
  closed curves. A single arc, on one side of the centre, determines its crossing of y = 0, x0 + A
  or x0 − A, but hardly x0 and A separately. A level as wide as its arc is high then draws the fit
  inwards. On a map made of Table A1's own ellipses this happens for coil 1 below δ = 2.7e-4 and for
  coil 3 below 1.8e-4, where the printed x0 and A are therefore hardly known.
- *Which levels are determined* is not a question of the paper. Here every level has standard errors
  of x0, A and B from its own points. It is undetermined if the error of x0 exceeds the map's step
  along x, or if its points do not reach half a semi-axis beyond the centre on both sides (30° past
  the highest point). Then one arc is left, and the errors do not include how far the width of the
  level draws the fit inwards. A level is also undetermined if its ellipse leaves the largest δ
  outside by more than that step: an arc across the window may be fitted by a small ellipse far from
  the coil.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import xarray as xr
from scipy.interpolate import RectBivariateSpline
from scipy.ndimage import label

from coilarray.compute.arrays import FloatArray, IntArray
from coilarray.compute.display_units import PER_MILLION
from coilarray.errors import LocalizeError, require_positive
from coilarray.response.dataset import RESPONSE, in_ellipse_window

PARAMETERS = ("x0", "A", "B")  # names of the parameters of an ellipse, in the order of every row of them
REFINEMENT = 20  # divisions of every spacing of the grid. The paper's board is within 0.03 mm of 80 divisions
THRESHOLD = 2e-5  # half width of a level in δ, Sect. 5 of the paper
STEP = 3e-5  # step from level to level in δ, Sect. 5 of the paper
LEAST_POINTS = 6  # least number of points of a level that is fitted: twice the unknowns
LEAST_REACH = 0.5  # distance of the points of a determined level beyond the centre on both sides, in semi-axes
_LEAST_SAMPLES = 4  # of a cubic, along each axis
_MOST_LEVELS = 3000  # δ = 0.09 with the paper's step, each takes 0.4 ms
_MOST_POINTS = 10**9  # levels times refined points of all states, some 10 s (the paper's map has 1.2e7)
_CORNERS = 4  # corners of a cell of the sampled grid, the number of independent values of the smallest level
_LONGEST = 10.0  # semi-axis over the extent of the points: beyond it the conic is as good as a parabola or two lines


@dataclass(frozen=True)
class Ellipse:
    """Ellipse (x − x0)²/A² + y²/B² = 1, in m."""

    x0: float
    A: float
    B: float

    def __post_init__(self) -> None:
        if not np.isfinite([self.x0, self.A, self.B]).all() or min(self.A, self.B) <= 0:
            raise LocalizeError(
                f"an ellipse must have a finite centre and positive semi-axes; got x0 = {self.x0 * 1e3:.4g} mm, "
                f"A = {self.A * 1e3:.4g} mm, B = {self.B * 1e3:.4g} mm."
            )

    def distance(self, x: npt.ArrayLike, y: npt.ArrayLike) -> FloatArray:
        """Distance in m from the curve along rays, negative inside."""
        u, v = np.subtract(x, self.x0), np.asarray(y, dtype=np.float64)
        angle = np.arctan2(v, u)
        return np.asarray(np.hypot(u, v) - 1 / np.hypot(np.cos(angle) / self.A, np.sin(angle) / self.B))


def fit_ellipse(x: npt.ArrayLike, y: npt.ArrayLike) -> Ellipse:
    """Fit the ellipse (x − x0)²/A² + y²/B² = 1 to points.

    The fit is by least squares of a u² + c y² + d u = 1 with u = x − mean(x), as O. Gal's
    fit_ellipse (MATLAB Central File Exchange 3215, 2003) without its terms in xy and y. The mean
    matters: if the points are on no ellipse, an equation whose constant is set to 1 gives another
    fit about another origin.
    """
    if np.shape(x) != np.shape(y):
        raise LocalizeError(f"x and y must have the same shape; got {np.shape(x)} and {np.shape(y)}.")
    points = np.array([x, y], dtype=np.float64)
    if points.ndim != 2 or points.shape[1] < 3 or not np.isfinite(points).all():
        raise LocalizeError(f"an ellipse needs at least three finite points; got an array of shape {points.shape}.")
    mean = float(points[0].mean())
    length = float(np.ptp(points, axis=1).max())
    if length == 0:
        raise LocalizeError("an ellipse needs points that are not all the same.")
    u, v = (points[0] - mean) / length, points[1] / length
    (a, c, d), _, rank, _ = np.linalg.lstsq(np.stack([u**2, v**2, u], axis=1), np.ones_like(u), rcond=None)
    if rank < 3:
        raise LocalizeError("the points lie on more than one conic.")
    F = 1 + d**2 / (4 * a) if a else 0.0
    squares = np.array([F / a, F / c]) if a * c else np.zeros(2)
    if not ((squares > 0) & (squares < _LONGEST**2)).all():
        raise LocalizeError("the conic through the points is not an ellipse.")
    A, B = (np.sqrt(squares) * length).tolist()
    return Ellipse(mean - float(d / (2 * a)) * length, A, B)


def standard_errors(ellipse: Ellipse, x: FloatArray, y: FloatArray, independent: int) -> tuple[float, float, float]:
    """Return the standard errors of x0, A and B in m.

    The errors are of first order, with the scale of the residuals estimated. `independent` is the
    number of independent points that the n points represent, as points interpolated from the same
    samples have common errors. They are infinite if the points do not determine all three.
    """
    length = max(float(np.ptp(x)), float(np.ptp(y)))
    mean = float(x.mean())
    centre, A, B = (ellipse.x0 - mean) / length, ellipse.A / length, ellipse.B / length
    u, v = (x - mean) / length - centre, y / length
    # a u² + c y² + d u − 1 of the fit is E/K, E = (u − u0)²/A² + y²/B² − 1 and K = 1 − u0²/A²
    K = 1 - (centre / A) ** 2
    residual = ((u / A) ** 2 + (v / B) ** 2 - 1) / K
    slopes = np.stack([-2 * u / A**2, -2 * u**2 / A**3, -2 * v**2 / B**3], axis=-1)
    slopes_of_K = np.array([-2 * centre / A**2, 2 * centre**2 / A**3, 0.0])
    jacobian = (slopes - residual[:, None] * slopes_of_K) / K
    information = jacobian.T @ jacobian * (independent / len(u))
    variance = float(residual @ residual) / len(u) * independent / (independent - 3)
    try:
        squares = variance * np.diag(np.linalg.inv(information))
    except np.linalg.LinAlgError:
        return (np.inf, np.inf, np.inf)
    errors = np.sqrt(np.where(squares >= 0, squares, np.inf)) * length
    return float(errors[0]), float(errors[1]), float(errors[2])


def closes(x: FloatArray, x0: float, A: float) -> bool:
    """Test whether points (n,) reach `LEAST_REACH` semi-axes on both sides."""
    return bool(len(x) and min(x0 - float(x.min()), float(x.max()) - x0) >= LEAST_REACH * A)


def refined_map(delta: xr.DataArray, refinement: int = REFINEMENT) -> xr.DataArray:
    """Refine a map (y, x) by a bicubic spline.

    Every spacing is divided into `refinement` parts. At the sampled positions, in m, the map keeps
    the sampled values.
    """
    if refinement < 1 or refinement != int(refinement):
        raise LocalizeError(f"refinement must be a positive integer; got {refinement}.")
    _check_map(delta)
    y, x = axes = delta.y.values, delta.x.values
    values = delta.transpose("y", "x").values.astype(np.float64)
    places = (np.arange((len(axis) - 1) * refinement + 1) / refinement for axis in axes)
    fine_y, fine_x = (np.interp(at, np.arange(len(axis)), axis) for at, axis in zip(places, axes, strict=True))
    fine = RectBivariateSpline(y, x, values, s=0)(fine_y, fine_x)
    return xr.DataArray(fine, {"y": fine_y, "x": fine_x}, ("y", "x"))


def fit_ellipses(
    response: xr.Dataset,
    depth: float | None = None,
    *,
    states: Sequence[str] | None = None,
    refinement: int = REFINEMENT,
    threshold: float = THRESHOLD,
    step: float = STEP,
) -> xr.Dataset:
    """Fit an ellipse to each level of a response.

    It follows Sect. 5 of Gast & Zimmermann (2020), with the details that the module's docstring
    lists. The measured or simulated `response` has ``delta`` (depth, y, x, state) with the
    coordinates in m, y = 0 on the coils' axis. If the map has a window for ellipses
    (`coilarray.Indentation`), only the window is used. The `depth` in m is one that the response
    has, by default its first. The `states` are by default those whose largest δ lies within the map
    and above five levels. The curves around a maximum at the map's edge do not close. `refinement`
    is the number of parts of every spacing of the grid, `threshold` the half width of a level in δ,
    and `step` the distance of neighbouring levels in δ, which is also the lowest level.

    In the result, over ``state`` and ``step`` with the coordinate ``level`` (step), ``delta`` is
    the mean of the level's points. ``x0``, ``A``, ``B`` and ``rms``, the misfit along the ray from
    the centre (half the width of the level is part of it), are in m. ``x0_std``, ``A_std`` and
    ``B_std`` follow from `standard_errors`, with all points in a cell of the sampled grid counted
    as one. ``undetermined`` marks ellipses that their points do not determine. ``points`` is their
    number. ``refused`` is the reason why a step has no ellipse, empty if it has one. Refused steps
    hold NaN. ``peak`` (state) is the largest δ of the refined map.

    Raises LocalizeError for a response without δ or the wanted state or depth, a map that
    `refined_map` refuses, coils that are not on y = 0, a state without closed curves or any
    ellipse, settings that are not positive, more than 3000 levels or 10⁹ points in all of them.
    """
    response = in_ellipse_window(response)
    delta = RESPONSE.checked(response, "a response")["delta"]
    depths = delta.depth.values
    nearest = 0 if depth is None else int(np.argmin(np.abs(depths - depth)))
    if depth is not None and not np.isclose(depths[nearest], depth, rtol=1e-6, atol=0):
        listed = ", ".join(f"{value * 1e3:.4g}" for value in depths.tolist())
        raise LocalizeError(f"the response has the depths {listed} mm; got {depth * 1e3:.4g} mm.")
    delta = delta.isel(depth=nearest)
    for name, value in (("threshold", threshold), ("step", step)):
        require_positive(name, value, "", LocalizeError)
    chosen = _with_a_peak(delta, states, 6 * step)
    if {"coil", "coil_y"} <= set(response.coords):
        apart = float(np.abs(np.diff(delta.y.values)).min(initial=np.inf))
        for state in chosen:
            if state in response.coil.values and abs(float(response.coil_y.sel(coil=state))) > apart / 2:
                raise LocalizeError(
                    f"the ellipse model is for coils in one row, at y = 0 of the map; {state} is at y = "
                    f"{float(response.coil_y.sel(coil=state)) * 1e3:.4g} mm: take a coil of the row as the map's "
                    "origin. For coils in several rows use coilarray locate without ellipses."
                )
    points = len(chosen) * int(np.prod([(delta.sizes[axis] - 1) * refinement + 1 for axis in ("y", "x")]))
    _require_few_levels(float(delta.sel(state=chosen).max()), step, points)
    maps = [refined_map(delta.sel(state=state), refinement) for state in chosen]
    peaks = np.array([float(fine.values.max()) for fine in maps])
    _require_few_levels(float(peaks.max()), step, points)  # a spline overshoots beside a distant point
    count = max(1, int(np.floor((peaks.max() - step) / step)) + 1)
    levels = step + step * np.arange(count, dtype=np.float64)
    spacing = float(np.median(np.diff(delta.x.values)))
    rows = [_fit_levels(fine, levels, threshold, refinement, spacing) for fine in maps]
    for state, row in zip(chosen, rows, strict=True):
        if all(one.refused for one in row):
            raise LocalizeError(f"no level of {state} is an ellipse: the map has no closed curves of δ ≥ {step:.3g}.")
    return _dataset(chosen, levels, rows, peaks, threshold, response)


@dataclass(frozen=True)
class _Level:
    """Step of the sweep: mean δ, ellipse or reason without it."""

    points: int
    delta: float = np.nan
    x0: float = np.nan
    A: float = np.nan
    B: float = np.nan
    rms: float = np.nan
    x0_std: float = np.nan
    A_std: float = np.nan
    B_std: float = np.nan
    undetermined: bool = False
    refused: str = ""


def _fit_levels(
    fine: xr.DataArray, levels: FloatArray, threshold: float, refinement: int, spacing: float
) -> list[_Level]:
    """Fit rising levels of a refined map (y, x)."""
    values = fine.values
    peak = np.unravel_index(np.argmax(values), values.shape)
    top, left, part = 0, 0, values  # the window of the hill of the last level contains the hills of all higher levels
    found = []
    for level in levels.tolist():
        if level > values[peak]:
            found.append(_Level(0, refused="above the largest δ"))
            continue
        within = np.abs(part - level) <= threshold
        regions, _ = label(part >= level - threshold)
        hill = regions == regions.flat[np.argmax(part)]  # connected with the peak
        rows, columns = np.nonzero(within & hill)
        found.append(_fit_level(fine, rows + top, columns + left, refinement, spacing))
        of_rows, of_columns = (np.flatnonzero(hill.any(axis=axis)) for axis in (1, 0))
        part = part[of_rows[0] : of_rows[-1] + 1, of_columns[0] : of_columns[-1] + 1]
        top, left = top + int(of_rows[0]), left + int(of_columns[0])
    return found


def _fit_level(fine: xr.DataArray, rows: IntArray, columns: IntArray, refinement: int, spacing: float) -> _Level:
    """Fit the points of a level, rows and columns (n,)."""
    along, across, values = fine.x.values, fine.y.values, fine.values
    if len(rows) < LEAST_POINTS:
        return _Level(len(rows), refused="too few points")
    x, y = along[columns], across[rows]
    try:
        ellipse = fit_ellipse(x, y)
    except LocalizeError:
        return _Level(len(rows), refused="no ellipse")
    if not along[0] <= ellipse.x0 <= along[-1]:
        return _Level(len(rows), refused="centre outside the map")
    mean = float(values[rows, columns].mean())
    rms = float(np.sqrt(np.mean(ellipse.distance(x, y) ** 2)))
    of_cell = np.bincount(rows // refinement * len(along) + columns // refinement)
    errors = standard_errors(ellipse, x, y, max(int(np.count_nonzero(of_cell)), _CORNERS))
    row, column = np.unravel_index(np.argmax(values), values.shape)
    holds_peak = bool(ellipse.distance(along[column], across[row]) <= spacing)
    undetermined = not (errors[0] <= spacing and closes(x, ellipse.x0, ellipse.A) and holds_peak)
    return _Level(len(rows), mean, ellipse.x0, ellipse.A, ellipse.B, rms, *errors, undetermined)


def _with_a_peak(delta: xr.DataArray, states: Sequence[str] | None, least: float) -> list[str]:
    """States whose curves close in the map, as given states must."""
    known = [str(state) for state in delta.state.values]
    wanted = known if states is None else list(states)
    for state in wanted:
        if state not in known:
            raise LocalizeError(f"the response has no state {state!r}; it has {', '.join(known)}.")
    if not wanted or len(set(wanted)) != len(wanted):
        raise LocalizeError(f"states must name one state or more, each once; got {wanted}.")
    _check_map(delta.sel(state=wanted))
    largest = {state: float(delta.sel(state=state).max()) for state in wanted}
    inner = delta.isel(x=slice(1, -1), y=slice(1, -1))
    closed = [state for state in wanted if float(inner.sel(state=state).max()) == largest[state]]
    if states is not None:
        for state in wanted:
            if state not in closed:
                raise LocalizeError(f"the curves of {state} do not close: its largest δ is at the edge of the map.")
        return closed
    found = [state for state in closed if largest[state] >= least]
    if not found:
        need = f"the map has no closed curves of δ = {PER_MILLION.text(least, '.3')}, from which ellipses are fitted"
        most = max(largest, key=lambda state: largest[state])
        if largest[most] >= least:
            raise LocalizeError(f"{need}: where δ is that large, its peak is at the edge. Take a wider map.")
        reached = PER_MILLION.text(largest[most], ".3")
        raise LocalizeError(f"{need}: {most} reaches {reached} at most. Press deeper.")
    return found


def _require_few_levels(largest: float, step: float, points: int) -> None:
    levels = largest / step
    most = min(_MOST_LEVELS, _MOST_POINTS // points)
    if not levels <= most:
        raise LocalizeError(
            f"a largest δ of {largest:.3g} in steps of {step:.3g} makes {levels:.3g} levels on {points} refined "
            f"points; at most {most} levels are fitted."
        )


def _check_map(delta: xr.DataArray) -> None:
    for name in ("x", "y"):
        axis = delta[name].values
        if len(axis) < _LEAST_SAMPLES:
            raise LocalizeError(f"a map must have at least {_LEAST_SAMPLES} positions along {name}; got {len(axis)}.")
        if not np.isfinite(axis).all() or (np.diff(axis) <= 0).any():
            raise LocalizeError(f"the map's {name} must be finite and rising.")
    bad = np.argwhere(~np.isfinite(delta.transpose("y", "x", ...).values))
    if len(bad):
        y, x = (float(delta[name][k]) * 1e3 for name, k in zip("yx", bad[0], strict=False))
        raise LocalizeError(f"a map must be finite; δ at ({x:.4g}, {y:.4g}) mm is not.")


def _dataset(
    states: list[str],
    levels: FloatArray,
    rows: list[list[_Level]],
    peaks: FloatArray,
    threshold: float,
    response: xr.Dataset,
) -> xr.Dataset:

    def table(name: str) -> npt.NDArray[np.generic]:
        return np.array([[getattr(one, name) for one in row] for row in rows])

    described = {
        "delta": ("1", "mean δ of the level's points"),
        "x0": ("m", "centre of the ellipse"),
        "A": ("m", "semi-axis along x"),
        "B": ("m", "semi-axis along y"),
        "rms": ("m", "misfit along the ray from the centre, root mean square"),
        **{f"{name}_std": ("m", f"± {name}") for name in PARAMETERS},
        "points": ("1", "points of the level"),
    }
    both = ("state", "step")
    return xr.Dataset(
        {
            **{name: (both, table(name), {"units": u, "long_name": text}) for name, (u, text) in described.items()},
            "undetermined": (both, table("undetermined"), {"long_name": "the points do not determine the ellipse"}),
            "refused": (both, table("refused"), {"long_name": "why the step has no ellipse"}),
            "peak": ("state", peaks, {"units": "1", "long_name": "largest δ of the refined map"}),
        },
        coords={"state": states, "level": ("step", levels, {"units": "1", "long_name": "δ of the level"})},
        attrs={**{key: value for key, value in response.attrs.items() if "design" in key}, "threshold": threshold},
    )
