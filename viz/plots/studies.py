"""Figures of sweeps, searches and tolerance studies."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from matplotlib.ticker import FixedLocator, MaxNLocator
from scipy.interpolate import PchipInterpolator

from coilarray.compute.display_units import MM, true_minus
from coilarray.geometry.array import Array
from coilarray.viz import palette
from coilarray.viz.plots import style
from coilarray.viz.plots.board import plot_board

MOST_PANELS = 24
"""Largest number of panels in `sweep_figure`."""

# Counts of broken rules and of values that no converter reads, see `coilarray.sweep`.
_MARKS = ("fab_broken", "converter_unread")
_RESONANCES = ("frequency_MHz[", "self_resonance_MHz[")
_PANEL, _COLUMNS, _LEGEND = (4.2, 3.0), 3, 2.0  # inches, number, inches
_MOST_PAIRS = 6  # pairs of coils that a link shows
_MOST_TICKS = 8  # largest number of values of an entry that a map writes at its cells
_MOST_INSIDE = 4  # largest number of pairs of coils whose legend has room beside their curves
_TEXT, _LONGEST, _BESIDE = 14, 24, 45  # characters in one line: text at a tick, name of an axis, label beside one
_ONE_ZERO = 1e-9  # share of the range within which two zeros are equal, as a zero at a sample is found from both sides
_FAR_APART = 3.0  # largest over least resonance on an axis of equal steps


@style.styled
def plot_coupling_sweep(sweep: xr.Dataset, ax: Axes | None = None) -> Axes:
    """Draw the coupling coefficients of pairs over an entry.

    Circles, and values in the legend, mark the `zero_crossings`, for example of the pitch at which
    a pair does not couple. A dashed line is the design's own value. `sweep` is the result of
    `coilarray.sweep` over one entry with numbers, of which all ``k[coil,coil]`` are drawn. Raises
    ValueError if the sweep is not over one entry with numbers, or has no k.
    """
    entries, pairs = _entries(sweep), _names(sweep, "k[")
    if not _over_numbers(sweep, entries) or not pairs:
        raise ValueError(
            "a sweep of the coupling must be over one entry with numbers, and have k of a pair; this one is over "
            f"{', '.join(entries)} and has {', '.join(map(str, sweep.data_vars))}."
        )
    along = sweep.sortby(entries[0])
    x, unit = along[entries[0]].values.astype(np.float64), _unit(sweep[entries[0]])
    ax = ax or style.new_axes(6.5, 3.6)
    ax.axhline(0.0, color=palette.GREY, linewidth=0.8)
    for k, name in enumerate(pairs):
        zeros = zero_crossings(x, along[name].values)
        found = f" = 0 at {', '.join(f'{zero:#.3g}' for zero in zeros)} {unit}".rstrip() if zeros.size else ""
        _draw_line(ax, along, x, name, f"{name}{true_minus(found)}", k, marker=".")
        edge = palette.curve_look(k)["color"]
        ax.plot(zeros, np.zeros_like(zeros), "o", markersize=7, markerfacecolor="white", markeredgecolor=edge)
    _finish(ax, sweep[entries[0]], "coupling coefficient k")
    if len(pairs) > _MOST_INSIDE:
        style.legend_beside(ax)
    else:
        ax.legend(loc="best")  # without it Matplotlib warns on a slow machine
    return ax


def zero_crossings(x: npt.ArrayLike, values: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """Find places where samples at ascending x change their sign.

    Monotone cubics interpolate between the samples. Two samples of one sign have no zero between
    them. A sample that is zero counts.
    """
    at, y = np.asarray(x, dtype=np.float64), np.asarray(values, dtype=np.float64)
    zeros: list[float] = []
    for run in np.split(np.arange(y.size), np.flatnonzero(np.diff(np.isfinite(y))) + 1):
        if run.size > 1 and np.isfinite(y[run[0]]):
            zeros += PchipInterpolator(at[run], y[run]).roots(extrapolate=False).tolist()
    found: list[float] = []
    for zero in zeros:
        # a stretch of zeros is given as NaN
        if math.isfinite(zero) and not (found and zero - found[-1] <= _ONE_ZERO * (at[-1] - at[0])):
            found.append(zero)
    return np.array(found)


@style.styled
def plot_sweep_points(sweep: xr.Dataset, quantity: str, entry: str, ax: Axes | None = None) -> Axes:
    """Draw a dot per point of a sweep over an entry.

    `sweep` is the result of `coilarray.sweep`, a grid or samples, `quantity` a variable and `entry`
    a coordinate of it. A dashed line is the design's own value.
    """
    ax = ax or style.new_axes(*_PANEL)
    at = sweep[entry].broadcast_like(sweep[quantity]).transpose(*sweep[quantity].dims)
    x, values = _numbers(sweep[entry], at.values.ravel()), sweep[quantity].values.ravel()
    ax.plot(x, values, ".", color=palette.BLUE, markersize=4)
    _cross_out(ax, sweep.transpose(*sweep[quantity].dims), x, values)
    _finish(ax, sweep[entry], _label(sweep[quantity]))
    return ax


@style.styled
def plot_sweep_lines(sweep: xr.Dataset, quantity: str, ax: Axes | None = None) -> Axes:
    """Draw a quantity of a sweep as lines.

    `sweep` is the result of `coilarray.sweep` of a grid over one entry, or over two if one of them
    has texts, and `quantity` a variable of it. Each text then has a line. A point without a value
    is a gap, and a dashed line is the design's own value. Raises ValueError if the sweep is over
    other entries.
    """
    entries = _entries(sweep)
    along, apart = _line_entries(sweep, entries)
    if not along:
        raise ValueError(f"lines need one entry, or two of which one has texts; got {', '.join(entries)}.")
    ax = ax or style.new_axes(*_PANEL)
    x = _numbers(sweep[along], sweep[along].values)
    if not apart:
        ax.plot(x, sweep[quantity].values, "o-", color=palette.BLUE, markersize=4)
        _cross_out(ax, sweep, x, sweep[quantity].values)
    else:
        for k, text in enumerate(sweep[apart].values.tolist()):
            _draw_line(ax, sweep.isel({apart: k}), x, quantity, text, k, marker="o")
        ax.legend(title=apart, loc="best")  # as above
    _finish(ax, sweep[along], _label(sweep[quantity]))
    return ax


@style.styled
def plot_sweep_map(sweep: xr.Dataset, quantity: str, ax: Axes | None = None) -> Axes:
    """Draw a quantity over two entries as colours.

    `sweep` is the result of `coilarray.sweep` of a grid over two entries, and `quantity` a variable
    of it. Places without a result are grey. A diamond marks the design's own values. Raises
    ValueError if the sweep is over fewer or more entries.
    """
    entries = _entries(sweep)
    if "sample" in sweep.dims or len(entries) != 2:
        raise ValueError(f"a map needs a grid over two entries; got {', '.join(entries)}.")
    ax = ax or style.new_axes(*_PANEL)
    x, y = (_numbers(sweep[entry], sweep[entry].values) for entry in entries)
    values = np.ma.masked_invalid(sweep[quantity].transpose(*entries).values)[np.ix_(np.argsort(x), np.argsort(y))]
    across, up = np.meshgrid(x, y, indexing="ij")
    _cross_out(ax, sweep.transpose(*entries), across.ravel(), up.ravel())
    ax.set_facecolor(palette.UNKNOWN)
    mesh = ax.pcolormesh(np.sort(x), np.sort(y), values.T, shading="nearest", cmap=palette.SEQUENTIAL, rasterized=True)
    for axis, entry, places in zip((ax.xaxis, ax.yaxis), entries, (x, y), strict=True):
        _name_axis(axis, sweep[entry])
        if not _is_text(sweep[entry]) and sweep.sizes[entry] <= _MOST_TICKS:
            axis.set_major_locator(FixedLocator(np.sort(places).tolist()))
    own = [value for entry in entries if (value := _own(sweep[entry])) is not None]
    if len(own) == len(entries):
        ax.plot(own[:1], own[1:], "D", color="white", markeredgecolor=palette.VERMILLION, markersize=5)
    style.colour_bar(ax, mesh, _label(sweep[quantity]))
    return ax


@style.styled
def sweep_figure(result: xr.Dataset) -> Figure:
    """Draw all quantities of a sweep, one panel each.

    A grid over one or two entries has lines or maps. A grid over more entries, and samples, have a
    panel with dots for each quantity and entry. Over one entry with numbers, the coupling
    coefficients share a panel of `plot_coupling_sweep`, and the resonances with the tank and the
    self-resonances share a panel too. A dashed line or a diamond marks the design's own value.
    Points without a result are left out, or grey on a map. Crosses mark points that break
    fabrication rules or that no converter reads. `result` is the result of `coilarray.sweep`.
    Raises ValueError if there is no quantity, or more than `MOST_PANELS` panels.
    """
    entries = _entries(result)
    dotted = "sample" in result.dims or len(entries) > 2
    lines = bool(_line_entries(result, entries)[0])
    panels = _panels(result, entries, dotted=dotted, lines=lines)
    if not 1 <= len(panels) <= MOST_PANELS:
        raise ValueError(f"a figure of a sweep must have 1 to {MOST_PANELS} panels; it would have {len(panels)}.")
    columns = min(len(entries) if dotted else _COLUMNS, len(panels))
    rows = math.ceil(len(panels) / columns)
    legend = _LEGEND if _over_numbers(result, entries) and len(_names(result, "k[")) > _MOST_INSIDE else 0.0
    figure = style.new_figure(_PANEL[0] * columns + legend, _PANEL[1] * rows)
    for k, draw in enumerate(panels):
        draw(ax=figure.add_subplot(rows, columns, k + 1))
    own = [_own(result[entry]) is not None for entry in entries]
    mapped = not dotted and not lines
    marks = ["×  breaks fabrication rules, or no converter reads it"] if _broken(result).any() else []
    if all(own) if mapped else any(own):
        marks.append(f"{'◇' if mapped else '- -'}  the design as it is")
    figure.supxlabel("    ".join(marks), fontsize="small")
    return figure


@style.styled
def link_figure(result: xr.Dataset) -> Figure:
    """Draw the coupling and the efficiency of a link over its poses.

    One panel for k of the pairs and each efficiency over one axis, or maps over two. `result` is
    the result of `coilarray.studies.link.columns`. Of many pairs those with the largest |k| are
    drawn.
    """
    pairs = sorted(_names(result, "k["), key=lambda name: -float(abs(result[name]).max()))[:_MOST_PAIRS]
    shown = {name.partition("[")[2] for name in pairs}
    efficiencies = _names(result, "efficiency[") or [
        name for name in _names(result, "best_efficiency[") if name.partition("[")[2] in shown
    ]
    words = {name: str(result[name].attrs["long_name"]) for name in map(str, result.dims)}
    return sweep_figure(result[[*pairs, *efficiencies]].rename(words))


def _panels(sweep: xr.Dataset, entries: Sequence[str], *, dotted: bool, lines: bool) -> list[Callable[..., object]]:
    names = [str(name) for name in sweep.data_vars if name not in ("reason", *_MARKS)]
    names = names or _names(sweep, _MARKS[0])
    panels: list[Callable[..., object]] = []
    if _over_numbers(sweep, entries):
        pairs, resonances = _names(sweep, "k["), _names(sweep, _RESONANCES)
        panels += [partial(plot_coupling_sweep, sweep)] if pairs else []
        panels += [partial(_plot_resonances, sweep, resonances)] if resonances else []
        names = [name for name in names if name not in (*pairs, *resonances)]
    if dotted:
        return panels + [partial(plot_sweep_points, sweep, name, entry) for name in names for entry in entries]
    return panels + [partial(plot_sweep_lines if lines else plot_sweep_map, sweep, name) for name in names]


def _plot_resonances(sweep: xr.Dataset, names: Sequence[str], ax: Axes) -> None:
    (entry,) = _entries(sweep)
    along = sweep.sortby(entry)
    for k, name in enumerate(names):
        _draw_line(ax, along, along[entry].values, name, name, k, marker=".")
    values = np.concatenate([along[name].values for name in names])
    if np.nanmax(values, initial=0.0) > _FAR_APART * np.nanmin(values, initial=np.inf):
        ax.set_yscale("log")
        style.logarithmic_ticks(ax.yaxis, float(np.log10(np.nanmax(values) / np.nanmin(values))))
    _finish(ax, sweep[entry], "resonance (MHz)")
    ax.legend(loc="best")  # as above


def _draw_line(
    ax: Axes, sweep: xr.Dataset, x: npt.NDArray[np.float64], quantity: str, label: str, k: int, marker: str
) -> None:
    values = sweep[quantity].values
    ax.plot(x, values, marker=marker, markersize=4, label=label, **palette.curve_look(k))
    _cross_out(ax, sweep, x, values)


def _broken(sweep: xr.Dataset) -> npt.NDArray[np.bool_]:
    """Points that break fabrication rules or cannot be read."""
    marks = [sweep[name].values > 0 for name in _MARKS if name in sweep]
    return np.asarray(np.any(marks, axis=0)) if marks else np.zeros(1, dtype=bool)


def _cross_out(ax: Axes, sweep: xr.Dataset, x: npt.NDArray[np.float64], y: npt.NDArray[np.float64]) -> None:
    """Mark broken points, given in the order of the sweep."""
    broken = _broken(sweep).ravel()
    if broken.any():
        seen = [withStroke(linewidth=2.5, foreground="white")]  # on dark colours of a map too
        ax.plot(x.ravel()[broken], y.ravel()[broken], "x", color=palette.INK, markersize=6, zorder=5, path_effects=seen)


def _entries(sweep: xr.Dataset) -> list[str]:
    return [str(name) for name in sweep.coords if name != "sample"]


def _names(sweep: xr.Dataset, begin: str | tuple[str, ...]) -> list[str]:
    return [str(name) for name in sweep.data_vars if str(name).startswith(begin)]


def _over_numbers(sweep: xr.Dataset, entries: Sequence[str]) -> bool:
    return "sample" not in sweep.dims and len(entries) == 1 and not _is_text(sweep[entries[0]])


def _line_entries(sweep: xr.Dataset, entries: Sequence[str]) -> tuple[str, str]:
    """Entry along lines and entry of their texts, or empty."""
    if "sample" in sweep.dims:
        return "", ""
    if len(entries) == 1:
        return entries[0], ""
    texts = [entry for entry in entries if _is_text(sweep[entry]) and sweep.sizes[entry] <= len(palette.COILS)]
    if len(entries) != 2 or not texts:
        return "", ""
    return next(entry for entry in entries if entry != texts[-1]), texts[-1]


def _numbers(coordinate: xr.DataArray, values: npt.NDArray[np.generic]) -> npt.NDArray[np.float64]:
    """Places of values on an axis, where texts are numbered."""
    if not _is_text(coordinate):
        return values.astype(np.float64)
    texts = list(dict.fromkeys(coordinate.values.tolist()))
    return np.array([float(texts.index(value)) for value in values.tolist()])


def _finish(ax: Axes, entry: xr.DataArray, label: str) -> None:
    """Label the axes and mark the design's own value."""
    _name_axis(ax.xaxis, entry)
    own = _own(entry)
    if own is not None:
        ax.axvline(own, color=palette.INK, linestyle="--", linewidth=0.9, zorder=0)
    style.faint_grid(ax)
    ax.set_ylabel(textwrap.fill(label, _BESIDE))


def _name_axis(axis: Axis, coordinate: xr.DataArray) -> None:
    axis.set_label_text(_label(coordinate))
    if _is_text(coordinate):
        texts = list(dict.fromkeys(coordinate.values.tolist()))
        axis.set_ticks(range(len(texts)), [textwrap.fill(text, _TEXT) for text in texts])
    elif coordinate.dtype.kind in "iu":
        axis.set_major_locator(MaxNLocator(integer=True))


def _own(coordinate: xr.DataArray) -> float | None:
    """Design's own value of an entry, if within the sweep."""
    own = coordinate.attrs.get("design_value")
    if _is_text(coordinate) or own is None:
        return None
    return float(own) if coordinate.min() <= own <= coordinate.max() else None


def _is_text(coordinate: xr.DataArray) -> bool:
    return coordinate.dtype.kind not in "iuf"


def _label(array: xr.DataArray) -> str:
    name = str(array.attrs.get("long_name", array.name))
    if len(name) > _LONGEST:  # the options of a quantity on a line of their own
        name = name.replace("[", "\n[", 1)
    return f"{name} ({unit})" if (unit := _unit(array)) else name


def _unit(array: xr.DataArray) -> str:
    unit = str(array.attrs.get("units", "1"))
    return "" if unit == "1" else unit


@style.styled
def plot_convergence(
    scores: npt.ArrayLike,
    feasible: npt.ArrayLike,
    *,
    label: str,
    maximized: bool = False,
    polished_from: int | None = None,
    start: float | None = None,
    log: bool = False,
    ax: Axes | None = None,
) -> Axes:
    """Draw the score of every trial.

    `scores` (n,) are NaN if there is no such board, and `feasible` (n,) is whether each keeps all
    bounds. A line is the best feasible score up to each trial. The `label` of the vertical axis has
    the unit. The best score is the largest if `maximized`, and the axis is logarithmic if `log` and
    all scores are above zero. `polished_from` is the index of the first trial of the local solver.
    The score at the `start`, of the given design, is a dashed line. Raises ValueError if the shapes
    do not fit.
    """
    values, kept = np.asarray(scores, dtype=np.float64), np.asarray(feasible, dtype=np.bool_)
    if values.ndim != 1 or values.shape != kept.shape:
        raise ValueError(f"scores and feasible must be rows of one length; got {values.shape} and {kept.shape}.")
    ax = ax or style.new_axes(7.0, 3.6)
    number = np.arange(values.size)
    kept = kept & np.isfinite(values)
    ax.scatter(
        number[~kept], values[~kept], s=12, color=palette.PALE, marker="x", linewidth=0.9, label="breaks a bound"
    )
    ax.scatter(number[kept], values[kept], s=14, color=palette.BLUE, alpha=0.7, linewidth=0, label="keeps all bounds")
    if kept.any():
        worst = -np.inf if maximized else np.inf
        best = (np.maximum if maximized else np.minimum).accumulate(np.where(kept, values, worst))
        shown = np.isfinite(best)
        ax.step(number[shown], best[shown], where="post", color=palette.VERMILLION, label="best so far")
        scored = values[kept] if start is None else np.append(values[kept], start)
        low, high = float(scored.min()), float(scored.max())
        if log and low > 0:
            ax.set(yscale="log", ylim=(low / 1.5, high * 1.5))
        else:
            room = 0.06 * (high - low or abs(float(scored[0])) or 1.0)
            ax.set_ylim(low - room, high + room)
    if start is not None:
        ax.axhline(start, color=palette.INK, linestyle="--", linewidth=1.0, label="given design")
    if polished_from is not None:
        ax.axvspan(polished_from - 0.5, values.size - 0.5, color=palette.SHADE, zorder=0, label="local solver")
    ax.set(xlim=(-0.5, max(values.size - 0.5, 0.5)), xlabel="trial", ylabel=label)
    ax.xaxis.set_major_locator(MaxNLocator(integer=True))
    style.faint_grid(ax, "y")
    style.legend_above(ax, 5)
    return ax


@style.styled
def plot_front(
    points: npt.ArrayLike,
    feasible: npt.ArrayLike,
    front: Sequence[int],
    *,
    labels: tuple[str, str],
    start: tuple[float, float] | None = None,
    named: Mapping[int, str] | None = None,
    stairs: Literal["pre", "post"] | None = None,
    ax: Axes | None = None,
) -> Axes:
    """Draw two scores of all trials.

    The scores `points` (n, 2) of the trials are drawn against each other, if `feasible` (n,), which
    keep all bounds, with the Pareto `front` by its indices and the given design. A single point on
    the front is called the best. `labels` of both axes have units, and `start` has the scores of
    the given design. `named` has names to write beside points, by their indices. `stairs` draw the
    front as a staircase, ``"post"`` if the first score is minimized, ``"pre"`` if it is maximized.
    None draws no line, as for two out of more scores. Raises ValueError if the shapes do not fit.
    """
    values, kept = np.asarray(points, dtype=np.float64), np.asarray(feasible, dtype=np.bool_)
    if values.ndim != 2 or values.shape[1] != 2 or values.shape[:1] != kept.shape:
        raise ValueError(f"points must have shape (n, 2) and feasible (n,); got {values.shape} and {kept.shape}.")
    ax = ax or style.new_axes(6.5, 4.6)
    ax.scatter(values[kept, 0], values[kept, 1], s=14, color=palette.PALE, linewidth=0, label="keeps all bounds")
    edge = values[sorted(front, key=lambda k: tuple(values[k].tolist()))]
    if len(edge):
        if stairs is not None:
            ax.step(edge[:, 0], edge[:, 1], where=stairs, color=palette.VERMILLION, linewidth=0.8, alpha=0.6)
        name = "Pareto front" if len(edge) > 1 else "best"
        ax.scatter(edge[:, 0], edge[:, 1], s=30, color=palette.VERMILLION, label=name, zorder=3)
        wanted = edge if start is None else np.vstack([edge, start])
        low, high = wanted.min(axis=0), wanted.max(axis=0)
        room = np.where(high > low, high - low, np.abs(high) + 1e-12)
        near = np.clip(values[kept], low - 0.15 * room, high + 1.0 * room)
        low, high = np.minimum(low, near.min(axis=0)), np.maximum(high, near.max(axis=0))
        rim = 0.05 * np.where(high > low, high - low, 1.0)
        ax.set(xlim=(low[0] - rim[0], high[0] + rim[0]), ylim=(low[1] - rim[1], high[1] + rim[1]))
    if start is not None:
        ax.scatter(start[0], start[1], s=130, color=palette.INK, marker="*", label="given design", zorder=4)
    for k, name in (named or {}).items():
        ax.annotate(name, values[k].tolist(), xytext=(6, 6), textcoords="offset points", weight="bold")
    ax.set(xlabel=labels[0], ylabel=labels[1])
    style.faint_grid(ax)
    style.legend_above(ax, 3)
    return ax


@style.styled
def boards_figure(boards: Mapping[str, Array]) -> Figure:
    """Draw boards below each other, at one scale.

    `boards` are at least one, by their titles.
    """
    edges = np.array([array.bounds for array in boards.values()])
    (x_min, y_min), (x_max, y_max) = edges[:, :2].min(axis=0), edges[:, 2:].max(axis=0)
    width, height = style.figure_size(x_max - x_min, y_max - y_min)
    figure = style.new_figure(width, height * len(boards))
    rim = 0.16 * max(x_max - x_min, y_max - y_min)  # room for the sizes
    for k, (title, array) in enumerate(boards.items()):
        ax = plot_board(array, figure.add_subplot(len(boards), 1, k + 1))
        ax.set(xlim=MM.of((x_min - rim, x_max + rim)), ylim=MM.of((y_min - rim, y_max + rim)), title=title)
    return figure


_MOST_HISTOGRAMS = 6
_LEAST_SHARE = 0.02


@style.styled
def tolerance_figure(result: xr.Dataset, outputs: Sequence[str] | None = None) -> Figure:
    """Draw the shares of the contributors.

    `result` is the result of `coilarray.studies.tolerance.analyse`, and `outputs` are names of
    outputs, all by default. With samples the first six have a histogram. Raises ValueError if the
    analysis has no such output, or none is asked for.
    """
    names = list(outputs) if outputs is not None else result.output.values.tolist()
    for name in names:
        if name not in result.output.values:
            raise ValueError(f"the analysis has no output {name!r}; there are {', '.join(result.output.values)}.")
    if not names:
        raise ValueError("at least one output must be drawn; got none.")
    shown = names[:_MOST_HISTOGRAMS] if "value" in result else []
    rows = -(-len(shown) // _COLUMNS)
    width, bars = _shares_size(len(names))
    figure = style.new_figure(width, bars + 2.2 * rows)
    grid = figure.add_gridspec(1 + rows, _COLUMNS, height_ratios=[bars] + [2.2] * rows)
    plot_shares(result.sel(output=names), figure.add_subplot(grid[0, :]))
    for k, name in enumerate(shown):
        plot_boards(result, name, figure.add_subplot(grid[1 + k // _COLUMNS, k % _COLUMNS]))
    return figure


@style.styled
def plot_shares(result: xr.Dataset, ax: Axes | None = None) -> Axes:
    """Stack the shares of every kind of error.

    They are shares in the variance of each output. Board parts are plain, and layers are hatched.
    `result` is the result of `coilarray.studies.tolerance.analyse`.
    """
    names = result.output.values.tolist()
    ax = ax or style.new_axes(*_shares_size(len(names)))
    places = np.arange(len(names))
    left = np.zeros(len(names))
    kinds = list(dict.fromkeys(zip(result.table.values.tolist(), result.part.values.tolist(), strict=True)))
    tables = list(dict.fromkeys(table for table, _ in kinds))
    for table, part in kinds:
        there = (result.table.values == table) & (result.part.values == part)
        share = result.share.values[there].sum(axis=0)
        if share.max() < _LEAST_SHARE:
            continue
        colour, hatch, where = palette.KINDS[tables.index(table) % len(palette.KINDS)], "", "board"
        if part != "board":
            hatch, where = "////", "layers"
        look: dict[str, Any] = {"color": colour, "hatch": hatch, "edgecolor": "white", "linewidth": 0.4}
        ax.barh(places, share * 100, left=left, height=0.75, label=f"{table}, {where}", **look)
        left += share * 100
    spread = result.linear_deviation.values > 0
    ax.barh(places, np.where(spread, 100 - left, 0.0), left=left, height=0.75, color=palette.UNKNOWN, label="others")
    ax.set_yticks(places, names)
    ax.invert_yaxis()
    ax.set(xlim=(0, 100), xlabel="share of the linearised variance (%)")
    ax.legend(loc="center left", bbox_to_anchor=(1.01, 0.5), fontsize="small")
    return ax


@style.styled
def plot_boards(result: xr.Dataset, output: str, ax: Axes | None = None) -> Axes:
    """Draw the histogram of an output over the drawn boards.

    `result` is the result of `coilarray.studies.tolerance.analyse` with samples, and `output` the
    name of one of its outputs. The linearised spread and the limits are drawn too.
    """
    ax = ax or style.new_axes(4.0, 3.0)
    at = result.sel(output=output)
    values: npt.NDArray[np.float64] = at.value.values[np.isfinite(at.value.values)]
    nominal, deviation = float(at.nominal), float(at.linear_deviation)
    ax.hist(values, bins="sturges", density=True, color=palette.BLUE, alpha=0.6, label=f"{values.size} boards")
    low = min(float(values.min()), nominal - 3 * deviation)
    high = max(float(values.max()), nominal + 3 * deviation)
    if deviation > 0:
        x = np.linspace(low, high, 200)
        normal = np.exp(-(((x - nominal) / deviation) ** 2) / 2) / (deviation * np.sqrt(2 * np.pi))
        ax.plot(x, normal, color=palette.INK, label="linear")
    if "limited" in result:
        of_output = result.limited.values == output
        limits = np.r_[result.at_least.values[of_output], result.at_most.values[of_output]]
        for k, limit in enumerate(limits[np.isfinite(limits)].tolist()):
            ax.axvline(
                limit, color=palette.VERMILLION, linestyle="--", label="" if k else "limit"
            )  # once in the legend
    ax.set(xlabel=output, yticks=[])
    ax.locator_params(axis="x", nbins=4)
    style.legend_above(ax, 3, "center", columnspacing=0.8, fontsize="small", handlelength=1.2)
    return ax


def _shares_size(outputs: int) -> tuple[float, float]:
    """Size in inches of a figure of the shares."""
    return 9.0, 0.9 + 0.24 * outputs
