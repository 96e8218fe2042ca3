"""Figures of measurements: comparisons, calibrations, and noise."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from coilarray.compute.display_units import MILLI_DELTA, MM, DisplayUnit, true_minus
from coilarray.viz.datasets.results import of_state
from coilarray.viz.palette import BLUE, COILS, DIVERGING, GREY, INK, VERMILLION, curve_look
from coilarray.viz.plots import style

MOST_STATES = 6
"""Largest number of states in `comparison_figure` and `calibration_figure`."""

_STAGES = {"before": "as simulated", "after": "scaled and shifted"}
_SOURCES = {"measured": (VERMILLION, "o-"), "simulated": (BLUE, "s--")}
_SIGMAS = 2.0  # half width of the band around x0
_WIDTHS = (1.0, 1.0, 0.6)  # of two maps and x0 beside each other
_ROW = 13.0  # inches
_LOOKS = {"A": ("o", BLUE), "B": ("s", VERMILLION), "x0": ("^", INK)}
_NAMES = {"A": "A", "B": "B", "x0": "$x_0$"}


@style.styled
def plot_readings(comparison: xr.Dataset, depth: int = 0, ax: Axes | None = None) -> Axes:
    """Draw measured over simulated δ of every state.

    There is a dot per position, and the line of equality.

    Parameters
    ----------
    comparison : xarray.Dataset
        Result of `coilarray.studies.comparison.compare_responses`.
    depth : int
        Index of the depth in the dataset.
    """
    at = comparison.isel(depth=depth)
    ax = ax or style.new_axes(5.0, 4.5)
    names = at.state.values.tolist()
    ends: list[float] = []
    for k, (name, colour) in enumerate(style.state_colours(comparison, names).items()):
        measured, simulated = (MILLI_DELTA.of(at.delta.sel(state=name, source=source)).ravel() for source in _SOURCES)
        label = true_minus(f"{name}, scale {float(at.scale[k]):.3f} ± {float(at.scale_std[k]):.3f}")
        marker = "os^Dv*"[(k // len(COILS)) % 6]
        ax.plot(simulated, measured, marker, markersize=3.0, markerfacecolor="none", color=colour, label=label)
        ends += simulated[np.isfinite(simulated)].tolist()
    if ends:
        span = min(ends), max(ends)
        ax.plot(span, span, color=GREY, linewidth=0.8, zorder=0)
    title = f"Readings, {MM.text(at.depth)} deep"
    style.finish_curves(ax, MILLI_DELTA.label("simulated δ"), MILLI_DELTA.label("measured δ"), title)
    return ax


@style.styled
def plot_centres(comparison: xr.Dataset, state: str, depth: int = 0, ax: Axes | None = None) -> Axes:
    """Draw x0 of the ellipses of one state over δ.

    The values are measured and simulated, with bands of two standard deviations. Levels whose
    points do not determine their ellipse are crossed out.

    Parameters
    ----------
    comparison, depth : xarray.Dataset and int
        As in `plot_readings`.
    state : str
        State of the comparison.

    Raises
    ------
    ValueError
        If the dataset has no such state.
    """
    of = of_state(comparison.isel(depth=depth), state)
    ax = ax or style.new_axes(5.0, 3.5)
    level = MILLI_DELTA.of(of.level)
    for source, (colour, line) in _SOURCES.items():
        one = of.sel(source=source)
        if np.isfinite(one.x0).any():
            half, look = _SIGMAS * MM.of(one.x0_std), {"markersize": 3.0, "markerfacecolor": "none", "linewidth": 1.0}
            undetermined = one.undetermined
            style.draw_curve(
                ax, level, MM.of(one.x0), line, colour, half=half, undetermined=undetermined, label=source, **look
            )
    if not ax.lines:
        ax.text(0.5, 0.5, "no ellipses", ha="center", va="center", transform=ax.transAxes)
    if "coil_x" in of.coords and state in of.coil.values:
        centre = float(MM.of(of.coil_x.sel(coil=state)))
        ax.axhline(centre, color=GREY, linewidth=0.8, linestyle=":", label="centre of the coil")
    style.finish_curves(ax, MILLI_DELTA.label("δ"), MM.label("$x_0$"), f"$x_0$ of {state}")
    return ax


@style.styled
def comparison_figure(comparison: xr.Dataset, depth: int = -1, outlines: Sequence[npt.ArrayLike] = ()) -> Figure:
    """Draw a comparison, one row per state.

    A row has maps of measured minus simulated δ before and after scale and shift, in the same
    colours, and x0 of both. A response along a single line, or at a single position, is drawn by
    `plot_readings` alone. The first `MOST_STATES` states are shown. `comparison` and `depth` are as
    in `plot_readings`, by default the deepest, and `outlines` as in `coilarray.viz.plot_response`.
    """
    if min(comparison.sizes["x"], comparison.sizes["y"]) < 2:
        figure = style.new_figure(7.0, 4.5)
        plot_readings(comparison, depth, figure.add_subplot())
        return figure
    names = comparison.state.values.tolist()[:MOST_STATES]
    aspect = float(np.ptp(comparison.y.values) / np.ptp(comparison.x.values))
    height = max(1.9, _ROW / sum(_WIDTHS) * aspect + 0.9)
    figure = style.new_figure(_ROW, height * len(names) + 0.5)
    axes = figure.subplots(len(names), 3, squeeze=False, width_ratios=_WIDTHS)
    for (left, right, curve), state in zip(axes, names, strict=True):
        of = of_state(comparison.isel(depth=depth), state)
        both = np.stack([of[f"residual_{stage}"].transpose("y", "x").values for stage in _STAGES])
        shown = style.axis_unit(both, "1")
        for ax, values, stage in zip((left, right), shown.of(both), _STAGES.values(), strict=True):
            mesh = style.signed_map(ax, of, values, outlines, style.largest(shown.of(both)))
            ax.set_title(f"{state}, {stage}")
        figure.colorbar(mesh, ax=[left, right], label=shown.label("δ"), fraction=0.03, pad=0.01)
        right.set_ylabel("")
        plot_centres(comparison, state, depth, curve)
    note = f" ({len(names)} of {comparison.sizes['state']} states)" if len(names) < comparison.sizes["state"] else ""
    style.main_title(figure, f"Measured less simulated δ, {MM.text(comparison.depth[depth])} deep{note}")
    return figure


@style.styled
def calibration_figure(calibration: xr.Dataset, combination: int = 0) -> Figure:
    """Draw measured and fitted numbers, one row per state.

    The residuals are in standard deviations. For ellipses, A, B and x0 are drawn over δ, with a
    band of one standard deviation of the posterior. For a response, δ is drawn along x, and the
    residuals as a map if there are several rows. At most six states are shown.

    Parameters
    ----------
    calibration : xarray.Dataset
        Dataset of `coilarray.studies.calibrate.calibrate`. If it has more than six states, the
        states with the largest measured values are drawn, and the title mentions this.
    combination : int
        Index of the combination of choices. The default is the most probable combination.
    """
    of = calibration.isel(combination=combination)
    every = list(dict.fromkeys(of.state.values.tolist()))
    measured = np.abs(of.measured.values)
    by_size = sorted(every, key=lambda state: measured[of.state.values == state].max(), reverse=True)
    states = [state for state in every if state in by_size[:MOST_STATES]]
    figure = style.new_figure(12.5, 3.4 * len(states))
    if len(states) < len(every):
        style.main_title(figure, f"The {len(states)} of {len(every)} states with the largest values")
    axes = figure.subplots(len(states), 2, squeeze=False)
    plot = _fitted_ellipses if calibration.attrs["kind"] == "ellipses" else _fitted_response
    for state, (left, right) in zip(states, axes, strict=True):
        plot(of.isel(datum=np.flatnonzero(of.state == state)), state, left, right)
    return figure


def _fitted_ellipses(of: xr.Dataset, state: str, left: Axes, right: Axes) -> None:
    """Draw the ellipses' parameters of a state over δ."""
    known = np.isfinite(of.model.values[of.quantity == "x0"])  # else the window does not show the model's ellipse
    for name, (marker, colour) in _LOOKS.items():
        part = of.isel(datum=np.flatnonzero(of.quantity == name))
        level, model = MILLI_DELTA.of(part.level), np.where(known, MM.of(part.model), np.nan)
        left.plot(level, MM.of(part.measured), marker, color=colour, markersize=4.0, markerfacecolor="none")
        style.draw_curve(left, level, model, "-", colour, half=MM.of(part.model_std), label=_NAMES[name])
        line = "-" if (part.weight > 0).any() else "--"
        remains = np.where(known, part.residual.values, np.nan)
        right.plot(level, remains, f"{marker}{line}", color=colour, label=_NAMES[name])
    style.zero_line(right)
    style.finish_curves(left, MILLI_DELTA.label("δ"), MM.label("A, B, $x_0$"), f"{state}: lines fitted")
    style.finish_curves(right, MILLI_DELTA.label("δ"), "fitted − measured (noise)", f"{state}: residuals")


def _fitted_response(of: xr.Dataset, state: str, left: Axes, right: Axes) -> None:
    """Draw δ of one state along x."""
    deepest = of.isel(datum=np.flatnonzero(of.depth == of.depth.max()))
    for k, y in enumerate(np.unique(deepest.y.values)):
        row = deepest.isel(datum=np.flatnonzero(deepest.y == y)).sortby("x")
        shown: dict[str, Any] = {"color": INK, "markersize": 3.0, "markerfacecolor": "none"}
        left.plot(MM.of(row.x), MILLI_DELTA.of(row.measured), "o", label="measured" if not k else None, **shown)
        left.plot(MM.of(row.x), MILLI_DELTA.of(row.model), "-", color=BLUE, label=None if k else "fitted")
    limit = style.largest(deepest.residual.values)
    colours: dict[str, Any] = {"c": deepest.residual.values, "cmap": DIVERGING, "vmin": -limit, "vmax": limit}
    dots = right.scatter(MM.of(deepest.x), MM.of(deepest.y), s=18.0, **colours)
    style.colour_bar(right, dots, "fitted − measured (noise)")
    left.set(xlabel=MM.label("x"), ylabel=MILLI_DELTA.label("δ"), title=f"{state}, {MM.text(deepest.depth[0])} deep")
    right.set(xlabel=MM.label("x"), ylabel=MM.label("y"), title=f"{state}: residuals")
    style.faint_grid(left)
    left.legend(loc="best")


@style.styled
def posterior_figure(calibration: xr.Dataset, combination: int = 0) -> Figure:
    """Draw the posterior of the unknowns.

    The diagonal has every unknown alone, and every pair is below it. Crosses are the fitted values.
    The parameters are as in `calibration_figure`.
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

    It is relative to the best combination, as ln of the odds. `calibration` is as in
    `calibration_figure`.
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


@style.styled
def plot_stability(found: xr.Dataset, ax: Axes | None = None) -> Axes:
    """Draw every state's Allan deviation against the averaging time.

    `found` is the result of `coilarray.hardware.record.stability.stability`. If it has
    ``expected``, white noise of the budget is a dotted line.
    """
    ax = ax or style.new_axes(6.5, 3.8)
    tau, names = found.tau.values, found.state.values.tolist()
    colours = style.state_colours(found, names)
    for k, name in enumerate(names):
        one = found.sel(state=name)
        known = np.isfinite(one.deviation.values)
        look = curve_look(k) | {"color": colours[name]}
        ax.plot(tau[known], one.deviation.values[known], label=name, marker="o", markersize=3.0, **look)
    ax.set(xscale="log", yscale="log")
    if "expected" in found and np.isfinite(found.expected.values).any():
        expected = float(np.nanmean(found.expected.values))
        ax.plot(tau, expected * np.sqrt(tau[0] / tau), color=GREY, linewidth=1.2, linestyle=":", label="budget, white")
    style.logarithmic_ticks(ax.xaxis, math.log10(tau[-1] / tau[0]) if len(tau) > 1 else 1.0)
    style.finish_curves(ax, DisplayUnit("s").label("averaging time"), "Allan deviation of δ")
    return ax
