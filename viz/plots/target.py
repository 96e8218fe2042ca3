"""Flat figures of readings against the distance of a target."""

from __future__ import annotations

import math

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from coilarray.compute.display_units import MM
from coilarray.response.answering import answering_states
from coilarray.response.coordinates import as_depths
from coilarray.viz.palette import GREY, curve_look
from coilarray.viz.plots import style

_SHOWN = {
    "delta": "|δ|",
    "effective_inductance": "effective inductance",
    "quality_factor": "quality factor",
    "frequency": "resonance frequency",
}
_MOST_STATES = 8  # curves of a panel
_PANELS = (9.5, 6.4)  # inches
_LOGARITHMIC = 30.0  # last over first distance above which their axis is logarithmic


@style.styled
def plot_target(response: xr.Dataset, quantity: str = "delta", ax: Axes | None = None) -> Axes:
    """Draw a quantity against the distance of a target.

    There is a curve per state, at the place where the target changes it the most. Values that no converter can read are
    crossed.

    Parameters
    ----------
    response : xarray.Dataset
        Result of `coilarray.target_map`.
    quantity : str
        ``delta``, whose magnitude is drawn on a logarithmic axis beside the noise, or ``effective_inductance``,
        ``quality_factor`` or ``frequency``, with a dotted line for each value without the target.
    ax : Axes, optional
        Axes to draw into, mm across.

    Returns
    -------
    matplotlib.axes.Axes
        The given axes, or new axes by default.

    Raises
    ------
    ValueError
        If the quantity is none of these.

    Examples
    --------
    >>> from coilarray import load_design, target_map
    >>> ax = plot_target(target_map(load_design("proximity"), distances=[4e-3, 8e-3]))
    >>> ax.get_xlabel(), ax.get_ylabel()
    ('distance (mm)', '|δ|')
    """
    if quantity not in _SHOWN:
        raise ValueError(f"quantity must be one of {', '.join(_SHOWN)}; got {quantity!r}.")
    states = answering_states(as_depths(response), _MOST_STATES)
    values = np.stack([_along(response, quantity, state) for state in states], axis=-1)
    base = None if quantity == "delta" else response[f"base_{_BASES.get(quantity, quantity)}"].values[states]
    names = response.state.values[states].tolist()
    shown = style.axis_unit(response[quantity])
    ax = ax or style.new_axes(6.5, 3.6)
    distance, colours = MM.of(response.distance), style.state_colours(response, names)
    crossed, marked = False, "readable" in response
    for k, name in enumerate(names):
        look = curve_look(k) | {"color": colours[name]}
        drawn = np.abs(values[:, k]) if quantity == "delta" else shown.of(values[:, k])
        ax.plot(distance, drawn, label=name, marker="o", markersize=3.0, **look)
        unread = np.array(
            [not one for one in _along(response, "readable", states[k])] if marked else [], dtype=np.bool_
        )
        if marked and unread.any():
            ax.plot(distance[unread], drawn[unread], "x", color=GREY, markersize=9.0, zorder=5)
            crossed = True
        if base is not None:
            ax.axhline(float(shown.of(base[k])), color=colours[name], linewidth=0.8, linestyle=":", zorder=0)
    if crossed:
        ax.plot([], [], "x", color=GREY, markersize=9.0, label="not readable")
    if base is not None:
        ax.plot([], [], color=GREY, linewidth=0.8, linestyle=":", label="without the target")
    if quantity == "delta":
        ax.set_yscale("log")
        noise = float(response.attrs.get("sigma", response.attrs["noise"]))
        ax.axhline(noise, color=GREY, linewidth=1.2, linestyle=":", label="noise")
    else:
        ax.ticklabel_format(axis="y", useOffset=False)
    if distance[-1] > _LOGARITHMIC * distance[0]:
        ax.set_xscale("log")
        style.logarithmic_ticks(ax.xaxis, math.log10(distance[-1] / distance[0]))
    style.faint_grid(ax)
    label = _SHOWN[quantity] if quantity == "delta" else shown.label(_SHOWN[quantity])
    ax.set(xlabel=MM.label("distance"), ylabel=label)
    style.legend_beside(ax)
    return ax


@style.styled
def target_figure(response: xr.Dataset) -> Figure:
    """Draw all quantities against the distance of a target.

    These are |δ|, inductance, quality factor and frequency. `response` is the result of `coilarray.target_map`. Every
    state is shown where the target changes it the most. If there are many states, the nearest to the middle of the map
    are shown.

    Returns
    -------
    matplotlib.figure.Figure
        The figure, which its method `savefig` writes to a file.
    """
    figure = style.new_figure(*_PANELS)
    panels = figure.subplots(2, 2, sharex=True).ravel().tolist()
    for ax, quantity in zip(panels, _SHOWN, strict=True):
        plot_target(response, quantity, ax)
    for ax in panels[:2]:
        ax.set_xlabel("")
    style.one_legend(figure)
    words = f"{response.attrs['material'].replace('_', ' ')} {response.attrs['target']}"
    style.main_title(figure, f"Target: {words}")
    return figure


_BASES = {"effective_inductance": "inductance"}  # names of values without the target that differ


def _along(response: xr.Dataset, quantity: str, state: int) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """Values (distance,) of a state at its best place.

    The state is given by its index.
    """
    of = response.isel(state=state)
    at = of[quantity].sel(x=float(of.best_x), y=float(of.best_y))
    return np.asarray(at.transpose("distance").values)
