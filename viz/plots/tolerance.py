"""Figures of tolerances: contributions to spreads, and scatter."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from coilarray.viz.palette import BLUE, INK, KINDS, UNKNOWN, VERMILLION
from coilarray.viz.plots.style import legend_above, new_axes, new_figure, styled

_MOST_HISTOGRAMS = 6
_COLUMNS = 3
_LEAST_SHARE = 0.02


@styled
def tolerance_figure(result: xr.Dataset, outputs: Sequence[str] | None = None) -> Figure:
    """Draw the shares of the contributors.

    With samples the histograms of the first outputs are drawn too. Raises ValueError if the
    analysis has no such output, or none is asked for.

    Parameters
    ----------
    result : xarray.Dataset
        Result of `coilarray.studies.tolerance.analyse`.
    outputs : sequence of str, optional
        Names of the outputs, all by default. The first six have a histogram.
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
    figure = new_figure(width, bars + 2.2 * rows)
    grid = figure.add_gridspec(1 + rows, _COLUMNS, height_ratios=[bars] + [2.2] * rows)
    plot_shares(result.sel(output=names), figure.add_subplot(grid[0, :]))
    for k, name in enumerate(shown):
        plot_boards(result, name, figure.add_subplot(grid[1 + k // _COLUMNS, k % _COLUMNS]))
    return figure


@styled
def plot_shares(result: xr.Dataset, ax: Axes | None = None) -> Axes:
    """Stack the shares of every kind of error.

    They are shares in the variance of each output. Board parts are plain, and layers are hatched.

    Parameters
    ----------
    result : xarray.Dataset
        Result of `coilarray.studies.tolerance.analyse`.
    """
    names = result.output.values.tolist()
    ax = ax or new_axes(*_shares_size(len(names)))
    places = np.arange(len(names))
    left = np.zeros(len(names))
    kinds = list(dict.fromkeys(zip(result.table.values.tolist(), result.part.values.tolist(), strict=True)))
    tables = list(dict.fromkeys(table for table, _ in kinds))
    for table, part in kinds:
        there = (result.table.values == table) & (result.part.values == part)
        share = result.share.values[there].sum(axis=0)
        if share.max() < _LEAST_SHARE:
            continue
        colour, hatch, where = KINDS[tables.index(table) % len(KINDS)], "", "board"
        if part != "board":
            hatch, where = "////", "layers"
        look: dict[str, Any] = {"color": colour, "hatch": hatch, "edgecolor": "white", "linewidth": 0.4}
        ax.barh(places, share * 100, left=left, height=0.75, label=f"{table}, {where}", **look)
        left += share * 100
    spread = result.linear_deviation.values > 0
    ax.barh(places, np.where(spread, 100 - left, 0.0), left=left, height=0.75, color=UNKNOWN, label="others")
    ax.set_yticks(places, names)
    ax.invert_yaxis()
    ax.set(xlim=(0, 100), xlabel="share of the linearised variance (%)")
    ax.legend(loc="center left", bbox_to_anchor=(1.01, 0.5), fontsize="small")
    return ax


@styled
def plot_boards(result: xr.Dataset, output: str, ax: Axes | None = None) -> Axes:
    """Draw the histogram of an output over the drawn boards.

    The linearised spread and the limits are drawn too.

    Parameters
    ----------
    result : xarray.Dataset
        Result of `coilarray.studies.tolerance.analyse` with samples.
    output : str
        Name of the output.
    """
    ax = ax or new_axes(4.0, 3.0)
    at = result.sel(output=output)
    values: npt.NDArray[np.float64] = at.value.values[np.isfinite(at.value.values)]
    nominal, deviation = float(at.nominal), float(at.linear_deviation)
    ax.hist(values, bins="sturges", density=True, color=BLUE, alpha=0.6, label=f"{values.size} boards")
    low = min(float(values.min()), nominal - 3 * deviation)
    high = max(float(values.max()), nominal + 3 * deviation)
    if deviation > 0:
        x = np.linspace(low, high, 200)
        normal = np.exp(-(((x - nominal) / deviation) ** 2) / 2) / (deviation * np.sqrt(2 * np.pi))
        ax.plot(x, normal, color=INK, label="linear")
    if "limited" in result:
        of_output = result.limited.values == output
        limits = np.r_[result.at_least.values[of_output], result.at_most.values[of_output]]
        for k, limit in enumerate(limits[np.isfinite(limits)].tolist()):
            ax.axvline(limit, color=VERMILLION, linestyle="--", label="" if k else "limit")  # once in the legend
    ax.set(xlabel=output, yticks=[])
    ax.locator_params(axis="x", nbins=4)
    legend_above(ax, 3, "center", columnspacing=0.8, fontsize="small", handlelength=1.2)
    return ax


def _shares_size(outputs: int) -> tuple[float, float]:
    """Size in inches of a figure of the shares."""
    return 9.0, 0.9 + 0.24 * outputs
