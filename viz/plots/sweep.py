"""Figures of sweeps: lines, coupling zeros, maps and dots."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
import numpy.typing as npt
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from matplotlib.ticker import FixedLocator, MaxNLocator
from scipy.interpolate import PchipInterpolator

from coilarray.compute.display_units import true_minus
from coilarray.viz.palette import BLUE, COILS, GREY, INK, SEQUENTIAL, UNKNOWN, VERMILLION, curve_look
from coilarray.viz.plots import style

MOST_PANELS = 24
"""Largest number of panels in `sweep_figure`."""

# Counts of broken rules and of values that no converter reads, see `coilarray.sweep`.
_MARKS = ("fab_broken", "converter_unread")
_RESONANCES = ("frequency_MHz[", "self_resonance_MHz[")
_PANEL, _COLUMNS, _LEGEND = (4.2, 3.0), 3, 2.0  # inches, number, inches
_MOST_TICKS = 8  # largest number of values of an entry that a map writes at its cells
_MOST_INSIDE = 4  # largest number of pairs of coils whose legend has room beside their curves
_TEXT, _LONGEST = 14, 24  # characters in one line, of a text beside a tick and of the name of an axis
_ONE_ZERO = 1e-9  # share of the range within which two zeros are equal, as a zero at a sample is found from both sides
_FAR_APART = 3.0  # largest over least resonance on an axis of equal steps


@style.styled
def plot_coupling_sweep(sweep: xr.Dataset, ax: Axes | None = None) -> Axes:
    """Draw the coupling coefficients of pairs over an entry.

    Circles, and values in the legend, mark the `zero_crossings`, for example of the pitch at which
    a pair does not couple. A dashed line is the design's own value. Raises ValueError if the sweep
    is not over one entry with numbers, or has no k.

    Parameters
    ----------
    sweep : xarray.Dataset
        Result of `coilarray.sweep` over one entry with numbers. All its ``k[coil,coil]`` are drawn.
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
    ax.axhline(0.0, color=GREY, linewidth=0.8)
    for k, name in enumerate(pairs):
        zeros = zero_crossings(x, along[name].values)
        found = f" = 0 at {', '.join(f'{zero:#.3g}' for zero in zeros)} {unit}".rstrip() if zeros.size else ""
        _draw_line(ax, along, x, name, f"{name}{true_minus(found)}", k, marker=".")
        edge = curve_look(k)["color"]
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

    >>> zero_crossings([0.0, 1.0, 2.0, 3.0], [2.0, 1.0, -1.0, -2.0]).tolist()
    [1.5]
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

    A dashed line is the design's own value.

    Parameters
    ----------
    sweep : xarray.Dataset
        Result of `coilarray.sweep`, a grid or samples.
    quantity, entry : str
        Names of a variable and of a coordinate.
    """
    ax = ax or style.new_axes(*_PANEL)
    at = sweep[entry].broadcast_like(sweep[quantity]).transpose(*sweep[quantity].dims)
    x, values = _numbers(sweep[entry], at.values.ravel()), sweep[quantity].values.ravel()
    ax.plot(x, values, ".", color=BLUE, markersize=4)
    _cross_out(ax, sweep.transpose(*sweep[quantity].dims), x, values)
    _finish(ax, sweep[entry], _label(sweep[quantity]))
    return ax


@style.styled
def plot_sweep_lines(sweep: xr.Dataset, quantity: str, ax: Axes | None = None) -> Axes:
    """Draw a quantity of a sweep as lines.

    A dashed line is the design's own value. Raises ValueError if the sweep is over other entries.

    Parameters
    ----------
    sweep : xarray.Dataset
        Result of `coilarray.sweep` of a grid over one entry, or over two if one of them has texts.
        Each text then has a line. A point without a value is a gap.
    quantity : str
        Name of a variable.
    """
    entries = _entries(sweep)
    along, apart = _line_entries(sweep, entries)
    if not along:
        raise ValueError(f"lines need one entry, or two of which one has texts; got {', '.join(entries)}.")
    ax = ax or style.new_axes(*_PANEL)
    x = _numbers(sweep[along], sweep[along].values)
    if not apart:
        ax.plot(x, sweep[quantity].values, "o-", color=BLUE, markersize=4)
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

    Places without a result are grey. A diamond marks the design's own values. Raises ValueError if
    the sweep is over fewer or more entries.

    Parameters
    ----------
    sweep : xarray.Dataset
        Result of `coilarray.sweep` of a grid over two entries.
    quantity : str
        Name of a variable.
    """
    entries = _entries(sweep)
    if "sample" in sweep.dims or len(entries) != 2:
        raise ValueError(f"a map needs a grid over two entries; got {', '.join(entries)}.")
    ax = ax or style.new_axes(*_PANEL)
    x, y = (_numbers(sweep[entry], sweep[entry].values) for entry in entries)
    values = np.ma.masked_invalid(sweep[quantity].transpose(*entries).values)[np.ix_(np.argsort(x), np.argsort(y))]
    across, up = np.meshgrid(x, y, indexing="ij")
    _cross_out(ax, sweep.transpose(*entries), across.ravel(), up.ravel())
    ax.set_facecolor(UNKNOWN)
    mesh = ax.pcolormesh(np.sort(x), np.sort(y), values.T, shading="nearest", cmap=SEQUENTIAL, rasterized=True)
    for axis, entry, places in zip((ax.xaxis, ax.yaxis), entries, (x, y), strict=True):
        _name_axis(axis, sweep[entry])
        if not _is_text(sweep[entry]) and sweep.sizes[entry] <= _MOST_TICKS:
            axis.set_major_locator(FixedLocator(np.sort(places).tolist()))
    own = [value for entry in entries if (value := _own(sweep[entry])) is not None]
    if len(own) == len(entries):
        ax.plot(own[:1], own[1:], "D", color="white", markeredgecolor=VERMILLION, markersize=5)
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
    fabrication rules or that no converter reads. Raises ValueError if there is no quantity, or more
    than `MOST_PANELS` panels.

    Parameters
    ----------
    result : xarray.Dataset
        Result of `coilarray.sweep`.
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


def _panels(sweep: xr.Dataset, entries: Sequence[str], *, dotted: bool, lines: bool) -> list[Callable[..., object]]:
    """Functions that draw the panels of a sweep."""
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
    """Draw resonances over the entry of a sweep."""
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
    ax.plot(x, values, marker=marker, markersize=4, label=label, **curve_look(k))
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
        ax.plot(x.ravel()[broken], y.ravel()[broken], "x", color=INK, markersize=6, zorder=5, path_effects=seen)


def _entries(sweep: xr.Dataset) -> list[str]:
    return [str(name) for name in sweep.coords if name != "sample"]


def _names(sweep: xr.Dataset, begin: str | tuple[str, ...]) -> list[str]:
    return [str(name) for name in sweep.data_vars if str(name).startswith(begin)]


def _over_numbers(sweep: xr.Dataset, entries: Sequence[str]) -> bool:
    """Check if a sweep is over one entry with numbers."""
    return "sample" not in sweep.dims and len(entries) == 1 and not _is_text(sweep[entries[0]])


def _line_entries(sweep: xr.Dataset, entries: Sequence[str]) -> tuple[str, str]:
    """Entry along lines and entry of their texts, or empty."""
    if "sample" in sweep.dims:
        return "", ""
    if len(entries) == 1:
        return entries[0], ""
    texts = [entry for entry in entries if _is_text(sweep[entry]) and sweep.sizes[entry] <= len(COILS)]
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
        ax.axvline(own, color=INK, linestyle="--", linewidth=0.9, zorder=0)
    style.faint_grid(ax)
    ax.set_ylabel(label)


def _name_axis(axis: Axis, coordinate: xr.DataArray) -> None:
    """Label an axis and set its ticks."""
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
    """Name and unit of an entry or quantity."""
    name = str(array.name)
    if len(name) > _LONGEST:  # the options of a quantity on a line of their own
        name = name.replace("[", "\n[", 1)
    return f"{name} ({unit})" if (unit := _unit(array)) else name


def _unit(array: xr.DataArray) -> str:
    unit = str(array.attrs.get("units", "1"))
    return "" if unit == "1" else unit
