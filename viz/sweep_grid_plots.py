"""Flat figures of sweeps over entries of a design: lines, maps, and points of samples."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence
from typing import TYPE_CHECKING

import matplotlib
import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from coilarray.viz.palette import BLUE, COILS, VERMILLION
from coilarray.viz.plots import STYLE, colour_bar

if TYPE_CHECKING:
    import xarray as xr

FloatArray = npt.NDArray[np.float64]

MOST_PANELS = 24
"""Panels that `sweep_figure` shows at most."""

_PANEL = (4.2, 3.0)  # inches
_COLUMNS = 3
_TEXT = 14  # characters of a text in one line beside a tick


def sweep_figure(result: xr.Dataset) -> Figure:
    """Draw the quantities of a sweep.

    Parameters
    ----------
    result : xarray.Dataset
        As `coilarray.sweep.run_sweep` returns it.

    Returns
    -------
    Figure
        One panel a quantity: a line over the one entry of a grid, lines or a map over two. Of a grid over more entries,
        and of samples, one panel for each quantity and entry, with a dot a point. A dashed line or a cross is the
        design's own value; what has no result is left out, or grey on a map.

    Raises
    ------
    ValueError
        No quantity, or more than `MOST_PANELS` panels.
    """
    names = [str(name) for name in result.data_vars if name != "reason"]
    entries = [str(name) for name in result.coords if name != "sample"]
    dotted = "sample" in result.dims or len(entries) > 2
    panels = [(name, entry) for name in names for entry in (entries if dotted else [""])]
    if not 1 <= len(panels) <= MOST_PANELS:
        raise ValueError(f"a figure of a sweep must have 1 to {MOST_PANELS} panels; it would have {len(panels)}.")
    columns = min(len(entries) if dotted else _COLUMNS, len(panels))
    rows = math.ceil(len(panels) / columns)
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(_PANEL[0] * columns, _PANEL[1] * rows))
        for k, (name, entry) in enumerate(panels):
            ax = figure.add_subplot(rows, columns, k + 1)
            if dotted:
                _dots(ax, result, name, entry)
            elif len(entries) == 1:
                _line(ax, result, name, entries[0])
            elif lines := _lines_of(result, entries):
                _lines(ax, result, name, *lines)
            else:
                _map(ax, result, name, entries)
        return figure


def _dots(ax: Axes, result: xr.Dataset, name: str, entry: str) -> None:
    at = result[entry].broadcast_like(result[name]).transpose(*result[name].dims)
    ax.plot(_numbers(result[entry], at.values.ravel()), result[name].values.ravel(), ".", color=BLUE, markersize=4)
    _name_axis(ax.xaxis, result[entry])
    _mark(ax, result[entry])
    ax.set_ylabel(_label(result[name]))


def _line(ax: Axes, result: xr.Dataset, name: str, entry: str) -> None:
    x = _numbers(result[entry], result[entry].values)
    ax.plot(x, result[name].values, "o-", color=BLUE, markersize=4)
    _name_axis(ax.xaxis, result[entry])
    _mark(ax, result[entry])
    ax.set_ylabel(_label(result[name]))


def _lines(ax: Axes, result: xr.Dataset, name: str, along: str, apart: str) -> None:
    x = _numbers(result[along], result[along].values)
    for k, text in enumerate(result[apart].values.tolist()):
        values = result[name].isel({apart: k}).values
        ax.plot(x, values, "o-", color=COILS[k % len(COILS)], markersize=4, label=text)
    _name_axis(ax.xaxis, result[along])
    _mark(ax, result[along])
    ax.set_ylabel(_label(result[name]))
    ax.legend(title=apart)


def _lines_of(result: xr.Dataset, entries: Sequence[str]) -> tuple[str, str] | None:
    """Return the entry along lines and the one of texts that tells them apart; None for a map."""
    texts = [entry for entry in entries if _is_text(result[entry]) and result.sizes[entry] <= len(COILS)]
    return next(((along, texts[-1]) for along in entries if texts and along != texts[-1]), None)


def _map(ax: Axes, result: xr.Dataset, name: str, entries: Sequence[str]) -> None:
    x, y = (_numbers(result[entry], result[entry].values) for entry in entries)
    values = np.ma.masked_invalid(result[name].transpose(*entries).values)[np.ix_(np.argsort(x), np.argsort(y))]
    ax.set_facecolor("#D8D8D8")
    mesh = ax.pcolormesh(np.sort(x), np.sort(y), values.T, shading="nearest", cmap="viridis", rasterized=True)
    for axis, entry in zip((ax.xaxis, ax.yaxis), entries, strict=True):
        _name_axis(axis, result[entry])
    across, up = (_own(result[entry]) for entry in entries)
    if across is not None and up is not None:
        ax.plot([across], [up], "x", color=VERMILLION)
    colour_bar(ax, mesh, _label(result[name]))


def _numbers(coordinate: xr.DataArray, values: npt.NDArray[np.generic]) -> FloatArray:
    """Return where values stand on an axis: texts are numbered in the order in which they first come."""
    if not _is_text(coordinate):
        return values.astype(np.float64)
    texts = list(dict.fromkeys(coordinate.values.tolist()))
    return np.array([float(texts.index(value)) for value in values.tolist()])


def _name_axis(axis: Axis, coordinate: xr.DataArray) -> None:
    axis.set_label_text(_label(coordinate))
    if _is_text(coordinate):
        texts = list(dict.fromkeys(coordinate.values.tolist()))
        axis.set_ticks(range(len(texts)), [textwrap.fill(text, _TEXT) for text in texts])
    elif coordinate.dtype.kind in "iu":
        axis.set_major_locator(MaxNLocator(integer=True))


def _mark(ax: Axes, coordinate: xr.DataArray) -> None:
    own = _own(coordinate)
    if own is not None:
        ax.axvline(own, color=VERMILLION, linestyle="--", linewidth=0.9, zorder=0)


def _own(coordinate: xr.DataArray) -> float | None:
    """Return the design's own value of an entry; None for a text, and where it is beyond what was swept."""
    own = coordinate.attrs.get("design_value")
    if _is_text(coordinate) or own is None:
        return None
    return float(own) if coordinate.min() <= own <= coordinate.max() else None


def _is_text(coordinate: xr.DataArray) -> bool:
    return coordinate.dtype.kind not in "iuf"


def _label(array: xr.DataArray) -> str:
    unit = array.attrs.get("units", "1")
    return str(array.name) if unit == "1" else f"{array.name} ({unit})"
