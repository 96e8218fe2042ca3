"""Flat figures of a tolerance analysis: what contributes to every spread, and how the drawn boards scatter."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from coilarray.viz.palette import BLUE, COILS, INK, VERMILLION
from coilarray.viz.plots import styled

_MOST_HISTOGRAMS = 6
_COLUMNS = 3
_REST = "#D0D0D0"  # what is too small to be told apart
_LEAST_SHARE = 0.02
_HEADROOM = 1.2  # for the legend


@styled
def tolerance_figure(result: xr.Dataset, outputs: Sequence[str] | None = None) -> Figure:
    """Draw the shares of the contributors and, with samples, the histograms of the first outputs.

    Parameters
    ----------
    result : xarray.Dataset
        As `coilarray.tolerance.analyse` returns it.
    outputs : sequence of str, optional
        Which outputs; all by default. The first six have a histogram.

    Returns
    -------
    Figure

    Raises
    ------
    ValueError
        An output that is not there, or none.
    """
    names = list(outputs) if outputs is not None else result.output.values.tolist()
    for name in names:
        if name not in result.output.values:
            raise ValueError(f"the analysis has no output {name!r}; there are {', '.join(result.output.values)}.")
    if not names:
        raise ValueError("at least one output must be drawn; got none.")
    shown = names[:_MOST_HISTOGRAMS] if "value" in result else []
    rows = -(-len(shown) // _COLUMNS)
    bars = 0.9 + 0.24 * len(names)
    figure = Figure(figsize=(9.0, bars + 2.2 * rows), layout="constrained")
    grid = figure.add_gridspec(1 + rows, _COLUMNS, height_ratios=[bars] + [2.2] * rows)
    plot_shares(result.sel(output=names), figure.add_subplot(grid[0, :]))
    for k, name in enumerate(shown):
        plot_boards(result, name, figure.add_subplot(grid[1 + k // _COLUMNS, k % _COLUMNS]))
    return figure


def plot_shares(result: xr.Dataset, ax: Axes) -> Axes:
    """Stack the shares of every kind of error in the variance of each output; board parts plain, layers hatched.

    Parameters
    ----------
    result : xarray.Dataset
        As `coilarray.tolerance.analyse` returns it.
    ax : Axes
        Where to draw.
    """
    names = result.output.values.tolist()
    places = np.arange(len(names))
    left = np.zeros(len(names))
    kinds = list(dict.fromkeys(zip(result.table.values.tolist(), result.part.values.tolist(), strict=True)))
    tables = list(dict.fromkeys(table for table, _ in kinds))
    for table, part in kinds:
        there = (result.table.values == table) & (result.part.values == part)
        share = result.share.values[there].sum(axis=0)
        if share.max() < _LEAST_SHARE:
            continue
        k = tables.index(table)
        ax.barh(
            places,
            share * 100,
            left=left,
            height=0.75,
            color=COILS[k % len(COILS)],
            alpha=1.0 if k < len(COILS) else 0.5,
            hatch="" if part == "board" else "////",
            edgecolor="white",
            linewidth=0.4,
            label=f"{table}, {'board' if part == 'board' else 'layers'}",
        )
        left += share * 100
    spread = result.linear_deviation.values > 0
    ax.barh(places, np.where(spread, 100 - left, 0.0), left=left, height=0.75, color=_REST, label="others")
    ax.set_yticks(places, names)
    ax.invert_yaxis()
    ax.set_xlim(0, 100)
    ax.set_xlabel("share of the linearised variance (%)")
    ax.legend(loc="center left", bbox_to_anchor=(1.01, 0.5), fontsize="small")
    return ax


def plot_boards(result: xr.Dataset, output: str, ax: Axes) -> Axes:
    """Draw the histogram of one output over the drawn boards, the linearised spread, and the limits.

    Parameters
    ----------
    result : xarray.Dataset
        As `coilarray.tolerance.analyse` returns it, with samples.
    output : str
        Which one.
    ax : Axes
        Where to draw.
    """
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
        for k in np.flatnonzero(result.limited.values == output):
            for limit in (float(result.at_least[k]), float(result.at_most[k])):
                if np.isfinite(limit):
                    ax.axvline(limit, color=VERMILLION, linestyle="--", label="limit")
    ax.set_xlabel(output)
    ax.set_yticks([])
    ax.locator_params(axis="x", nbins=4)
    ax.set_ylim(top=_HEADROOM * ax.get_ylim()[1])
    ax.legend(loc="upper center", ncols=3, fontsize="xx-small", columnspacing=0.8, handlelength=1.2)
    return ax
