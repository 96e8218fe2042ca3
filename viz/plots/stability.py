"""Flat figures of the noise of a board.

Allan deviation against averaging time.
"""

from __future__ import annotations

import math

import numpy as np
import xarray as xr
from matplotlib.axes import Axes

from coilarray.compute.display_units import DisplayUnit
from coilarray.viz.palette import GREY, curve_look
from coilarray.viz.plots import style

_SECONDS = DisplayUnit("s")


@style.styled
def plot_stability(found: xr.Dataset, ax: Axes | None = None) -> Axes:
    """Draw the Allan deviation of every state.

    It is drawn against the averaging time, with its confidence intervals.

    Parameters
    ----------
    found : xarray.Dataset
        Result of `coilarray.hardware.record.stability.stability`. If it has ``expected``, white noise of the budget is
        a dotted line.
    ax : Axes, optional
        Axes to draw into.

    Returns
    -------
    matplotlib.axes.Axes
        The given axes, or new axes by default.

    Examples
    --------
    >>> from coilarray.hardware.record.stability import stability
    >>> noise = 1e-6 * np.random.default_rng(0).standard_normal((200, 1))
    >>> ax = plot_stability(stability(0.3 * np.arange(200), noise, ["coil1"], expected=[1e-6]))
    >>> ax.get_xlabel(), ax.get_ylabel(), ax.get_xscale()
    ('averaging time (s)', 'Allan deviation of δ', 'log')
    """
    ax = ax or style.new_axes(6.5, 3.8)
    tau, names = found.tau.values, found.state.values.tolist()
    colours = style.state_colours(found, names)
    for k, name in enumerate(names):
        one = found.sel(state=name)
        known = np.isfinite(one.deviation.values)
        deviation, low, high = (one[key].values[known] for key in ("deviation", "low", "high"))
        look = curve_look(k) | {"color": colours[name]}
        bars = (deviation - low, high - deviation)
        ax.errorbar(tau[known], deviation, bars, label=name, marker="o", markersize=3.0, elinewidth=0.8, **look)
    ax.set(xscale="log", yscale="log", xlabel=_SECONDS.label("averaging time"), ylabel="Allan deviation of δ")
    if "expected" in found and np.isfinite(found.expected.values).any():
        expected = float(np.nanmean(found.expected.values))
        ax.plot(tau, expected * np.sqrt(tau[0] / tau), color=GREY, linewidth=1.2, linestyle=":", label="budget, white")
    style.logarithmic_ticks(ax.xaxis, math.log10(tau[-1] / tau[0]) if len(tau) > 1 else 1.0)
    style.faint_grid(ax)
    style.legend_beside(ax)
    return ax
