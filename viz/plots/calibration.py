"""Flat figures of a calibration.

Data and model with residuals, the posterior, and the evidence of combinations.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from coilarray.compute.display_units import MILLI_DELTA, MM, true_minus
from coilarray.viz.palette import BLUE, GREY, INK, VERMILLION
from coilarray.viz.plots import style

_MOST_STATES = 6
_LOOKS = {"A": ("o", BLUE), "B": ("s", VERMILLION), "x0": ("^", INK)}
_NAMES = {"A": "A", "B": "B", "x0": "$x_0$"}


@style.styled
def calibration_figure(calibration: xr.Dataset, combination: int = 0) -> Figure:
    """Draw measured and fitted numbers, one row per state.

    The residuals are in standard deviations. For ellipses, A, B and x0 are drawn over δ, with a band of one standard
    deviation of the posterior. For a response, δ is drawn along x, and the residuals as a map if there are several
    rows. At most six states are shown.

    Parameters
    ----------
    calibration : xarray.Dataset
        Dataset of `coilarray.studies.calibrate.calibrate`. If it has more than six states, the states with the largest
        measured values are drawn, and the title mentions this.
    combination : int
        Index of the combination of choices. The default is the most probable combination.

    Returns
    -------
    matplotlib.figure.Figure
        The figure, which its method `savefig` writes to a file.
    """
    of = calibration.isel(combination=combination)
    every = list(dict.fromkeys(of.state.values.tolist()))
    measured = np.abs(of.measured.values)
    by_size = sorted(every, key=lambda state: measured[of.state.values == state].max(), reverse=True)
    states = [state for state in every if state in by_size[:_MOST_STATES]]
    figure = style.new_figure(12.5, 3.4 * len(states))
    if len(states) < len(every):
        style.main_title(figure, f"The {len(states)} of {len(every)} states with the largest values")
    axes = figure.subplots(len(states), 2, squeeze=False)
    plot = _fitted_ellipses if calibration.attrs["kind"] == "ellipses" else _fitted_response
    for state, (left, right) in zip(states, axes, strict=True):
        plot(of.isel(datum=np.flatnonzero(of.state == state)), state, left, right)
    return figure


def _fitted_ellipses(of: xr.Dataset, state: str, left: Axes, right: Axes) -> None:
    """Draw the ellipses' parameters of a state over δ.

    Parameters that are only predicted are dashed. The residuals are drawn at the right.
    """
    known = np.isfinite(of.model.values[of.quantity == "x0"])  # else the window does not show the model's ellipse
    for name, (marker, colour) in _LOOKS.items():
        part = of.isel(datum=np.flatnonzero(of.quantity == name))
        level, model = MILLI_DELTA.of(part.level), np.where(known, MM.of(part.model), np.nan)
        left.plot(level, MM.of(part.measured), marker, color=colour, markersize=4.0, markerfacecolor="none")
        left.plot(level, model, "-", color=colour, label=_NAMES[name])
        style.draw_band(left, level, model, MM.of(part.model_std), colour)
        line = "-" if (part.weight > 0).any() else "--"
        remains = np.where(known, part.residual.values, np.nan)
        right.plot(level, remains, f"{marker}{line}", color=colour, label=_NAMES[name])
    left.set(xlabel=MILLI_DELTA.label("δ"), ylabel=MM.label("A, B, $x_0$"), title=f"{state}: lines fitted")
    right.set(xlabel=MILLI_DELTA.label("δ"), ylabel="fitted − measured (noise)", title=f"{state}: residuals")
    _finish(left, right)


def _fitted_response(of: xr.Dataset, state: str, left: Axes, right: Axes) -> None:
    """Draw δ of one state along x.

    There is a curve for every y and depth. The residuals are drawn by position.
    """
    deepest = of.isel(datum=np.flatnonzero(of.depth == of.depth.max()))
    for k, y in enumerate(np.unique(deepest.y.values)):
        row = deepest.isel(datum=np.flatnonzero(deepest.y == y)).sortby("x")
        shown: dict[str, Any] = {"color": INK, "markersize": 3.0, "markerfacecolor": "none"}
        left.plot(MM.of(row.x), MILLI_DELTA.of(row.measured), "o", label="measured" if not k else None, **shown)
        left.plot(MM.of(row.x), MILLI_DELTA.of(row.model), "-", color=BLUE, label=None if k else "fitted")
    dots = right.scatter(
        MM.of(deepest.x), MM.of(deepest.y), c=deepest.residual.values, cmap="RdBu_r",
        vmin=-style.largest(deepest.residual.values), vmax=style.largest(deepest.residual.values), s=18.0,
    )  # fmt: skip
    style.colour_bar(right, dots, "fitted − measured (noise)")
    left.set(xlabel=MM.label("x"), ylabel=MILLI_DELTA.label("δ"), title=f"{state}, {MM.text(deepest.depth[0])} deep")
    right.set(xlabel=MM.label("x"), ylabel=MM.label("y"), title=f"{state}: residuals")
    style.faint_grid(left)
    left.legend(loc="best")


def _finish(left: Axes, right: Axes) -> None:
    style.zero_line(right)
    for ax in (left, right):
        style.faint_grid(ax)
        style.legend_beside(ax)


@style.styled
def posterior_figure(calibration: xr.Dataset, combination: int = 0) -> Figure:
    """Draw the posterior of the unknowns.

    The diagonal has every unknown alone, and every pair is below it. Crosses are the fitted values.

    Parameters
    ----------
    calibration, combination
        As in `calibration_figure`.

    Returns
    -------
    matplotlib.figure.Figure
        The figure, which its method `savefig` writes to a file.
    """
    of = calibration.isel(combination=combination)
    of = of.isel(unknown=np.flatnonzero(np.isfinite(of["value"].values)))
    labels = [name.rpartition(".")[2] for name in of.unknown.values.tolist()]
    n = len(labels)
    side = max(2.0, min(4.0, 12.0 / n))
    figure = style.new_figure(side * n + 0.8, side * n + 0.4)
    axes = figure.subplots(n, n, squeeze=False)
    draws, best = of.posterior.values, of["value"].values
    for i in range(n):
        for j in range(n):
            ax = axes[i, j]
            if j > i:
                ax.remove()
                continue
            if i == j:
                ax.hist(draws[:, i], bins=30, color=BLUE, alpha=0.6)
                ax.axvline(best[i], color=VERMILLION, linewidth=1.0)
                ax.set_yticks([])
            else:
                ax.plot(draws[:, j], draws[:, i], ".", color=BLUE, markersize=1.5, alpha=0.5)
                ax.plot(best[j], best[i], "+", color=VERMILLION, markersize=9.0)
                ax.yaxis.set_major_locator(MaxNLocator(3))
            ax.xaxis.set_major_locator(MaxNLocator(3))
            if i == n - 1:
                ax.set_xlabel(labels[j], fontsize=8)
            if j == 0 and i:
                ax.set_ylabel(labels[i], fontsize=8)
    return figure


@style.styled
def plot_evidence(calibration: xr.Dataset, ax: Axes | None = None) -> Axes:
    """Draw the evidence of every combination of choices.

    It is relative to the best combination, as ln of the odds.

    Parameters
    ----------
    calibration : xarray.Dataset
        As in `calibration_figure`.
    ax : Axes, optional
        Axes to draw into.

    Returns
    -------
    matplotlib.axes.Axes
        The given axes, or new axes by default.

    Examples
    --------
    >>> figures = {"log_evidence": ("combination", [-10.0, -12.5])}
    >>> ax = plot_evidence(xr.Dataset(figures, {"combination": ["bonded", "sliding"]}))
    >>> [round(float(bar.get_width()), 6) for bar in ax.patches], [label.get_text() for label in ax.get_yticklabels()]
    ([0.0, -2.5], ['bonded', 'sliding'])
    """
    names = calibration.combination.values.tolist()
    ax = ax or style.new_axes(8.0, 0.35 * len(names) + 1.0)
    evidence = calibration.log_evidence.values
    relative = np.nan_to_num(evidence - evidence[0], nan=0.0)
    ax.barh(range(len(names)), relative, color=[BLUE if np.isfinite(one) else GREY for one in evidence])
    ax.set_yticks(range(len(names)), names)
    ax.invert_yaxis()
    ax.set(xlabel=true_minus("ln evidence - best"), title="Combinations")
    style.faint_grid(ax, "x")
    return ax
