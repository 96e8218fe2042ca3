"""Flat figures that compare two responses.

Their difference, reading against reading, and x0 of both.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np
import numpy.typing as npt
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from coilarray.compute.display_units import MILLI_DELTA, MM, DisplayUnit, true_minus
from coilarray.viz.datasets.overlays import of_state
from coilarray.viz.palette import BLUE, COILS, GREY, VERMILLION
from coilarray.viz.plots import style

MOST_STATES = 6
"""Largest number of states in `comparison_figure`."""

_SIGMAS = 2.0  # half width of the band around x0
_STAGES: dict[Literal["before", "after"], str] = {"before": "as simulated", "after": "scaled and shifted"}
_SOURCES = {"measured": (VERMILLION, "o-"), "simulated": (BLUE, "s--")}
_WIDTHS = (1.0, 1.0, 0.6)  # of two maps and x0 beside each other
_ROW = 13.0  # inches


@style.styled
def plot_residual(
    comparison: xr.Dataset,
    state: str,
    depth: int = 0,
    stage: Literal["before", "after"] = "after",
    ax: Axes | None = None,
    outlines: Sequence[npt.ArrayLike] = (),
) -> Axes:
    """Draw measured minus simulated δ of one state.

    It is drawn over the position of the indenter, with the outlines of the coils. The colours are symmetric about zero
    and the same for both stages of a state. Places without a comparison are grey.

    Parameters
    ----------
    comparison : xarray.Dataset
        Result of `coilarray.studies.comparison.compare_responses`, with at least two x and two y.
    state, depth : str and int
        Name of the state, and index of the depth in the dataset.
    stage : {"before", "after"}
        Simulated map as it is, or scaled and shifted onto the measured map.
    ax : Axes, optional
        Axes to draw into, in mm.
    outlines : sequence of array_like
        As in `coilarray.viz.plot_response`.

    Returns
    -------
    matplotlib.axes.Axes
        The given axes, or new axes by default.

    Raises
    ------
    ValueError
        If the dataset has no such state, or the map has a single row.

    Examples
    --------
    >>> import xarray as xr
    >>> dims, residual = ("depth", "y", "x", "state"), [[[[1e-5], [2e-5]], [[-3e-5], [0.0]]]]
    >>> comparison = xr.Dataset(
    ...     {"residual_before": (dims, residual), "residual_after": (dims, residual)},
    ...     {"depth": [1e-3], "y": [0.0, 2e-3], "x": [0.0, 2e-3], "state": ["coil1"]},
    ... )
    >>> ax = plot_residual(comparison, "coil1")
    >>> ax.get_title(loc="left"), ax.child_axes[0].get_ylabel()
    ('Measured less simulated coil1, scaled and shifted', 'δ (10⁻⁶)')
    """
    of = of_state(comparison.isel(depth=depth), state)
    style.require_plane(of)
    ax = ax or style.new_axes(*style.map_size(of))
    both, shown = _residuals(of)
    mesh = style.signed_map(ax, of, both[list(_STAGES).index(stage)], outlines, style.largest(both))
    style.colour_bar(ax, mesh, shown.label("δ"))
    ax.set_title(f"Measured less simulated {state}, {_STAGES[stage]}")
    return ax


@style.styled
def plot_readings(comparison: xr.Dataset, depth: int = 0, ax: Axes | None = None) -> Axes:
    """Draw measured over simulated δ of every state.

    There is a dot per position, and the line of equality.

    Parameters
    ----------
    comparison, depth
        As in `plot_residual`.
    ax : Axes, optional
        Axes to draw into. Both have the unit 10⁻³.

    Returns
    -------
    matplotlib.axes.Axes
        The given axes, or new axes by default.

    Examples
    --------
    >>> import xarray as xr
    >>> delta = (("source", "depth", "y", "x", "state"), [[[[[2e-4], [8e-4]]]], [[[[1e-4], [4e-4]]]]])
    >>> scale = {"scale": (("depth", "state"), [[2.0]]), "scale_std": (("depth", "state"), [[0.1]])}
    >>> axes = {"source": ["measured", "simulated"], "depth": [1e-3], "y": [0.0], "x": [0.0, 5e-3], "state": ["coil1"]}
    >>> ax = plot_readings(xr.Dataset({"delta": delta, **scale}, axes))
    >>> ax.lines[0].get_label(), ax.get_xlabel()
    ('coil1, scale 2.000 ± 0.100', 'simulated δ (10⁻³)')
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
    style.faint_grid(ax)
    ax.set(xlabel=MILLI_DELTA.label("simulated δ"), ylabel=MILLI_DELTA.label("measured δ"))
    ax.set_title(f"Readings, {MM.text(at.depth)} deep")
    style.legend_beside(ax)
    return ax


@style.styled
def plot_centres(comparison: xr.Dataset, state: str, depth: int = 0, ax: Axes | None = None) -> Axes:
    """Draw x0 of the ellipses of one state over δ.

    The values are measured and simulated, with bands of two standard deviations. Levels whose points do not determine
    their ellipse are crossed out.

    Parameters
    ----------
    comparison, state, depth
        As in `plot_residual`.
    ax : Axes, optional
        Axes to draw into, mm over 10⁻³.

    Returns
    -------
    matplotlib.axes.Axes
        The given axes, or new axes by default.

    Raises
    ------
    ValueError
        If the dataset has no such state.

    Examples
    --------
    >>> import xarray as xr
    >>> x0 = (("source", "depth", "state", "level"), [[[[0.0, 1e-4]]], [[[1e-4, 2e-4]]]])
    >>> axes = {"source": ["measured", "simulated"], "depth": [1e-3], "state": ["coil1"], "level": [1e-4, 2e-4]}
    >>> curves = xr.Dataset({"x0": x0, "x0_std": x0}, axes)
    >>> ax = plot_centres(curves.assign(undetermined=curves.x0 > 1), "coil1")
    >>> [line.get_label() for line in ax.lines], ax.get_ylabel()
    (['measured', 'simulated'], '$x_0$ (mm)')
    """
    of = of_state(comparison.isel(depth=depth), state)
    ax = ax or style.new_axes(5.0, 3.5)
    level = MILLI_DELTA.of(of.level)
    drawn = [source for source in _SOURCES if np.isfinite(of.x0.sel(source=source)).any()]
    for source in drawn:
        colour, look = _SOURCES[source]
        x0, deviation = (MM.of(of[name].sel(source=source)) for name in ("x0", "x0_std"))
        ax.plot(level, x0, look, color=colour, markersize=3.0, markerfacecolor="none", linewidth=1.0, label=source)
        style.draw_band(ax, level, x0, _SIGMAS * deviation, colour)
        style.mark_undetermined(ax, level, x0, of.undetermined.sel(source=source), colour)
    if "coil_x" in of.coords and state in of.coil.values:
        centre = float(MM.of(of.coil_x.sel(coil=state)))
        ax.axhline(centre, color=GREY, linewidth=0.8, linestyle=":", label="centre of the coil")
    style.faint_grid(ax)
    ax.set(xlabel=MILLI_DELTA.label("δ"), ylabel=MM.label("$x_0$"), title=f"$x_0$ of {state}")
    if drawn:
        style.legend_beside(ax)
    else:
        ax.text(0.5, 0.5, "no ellipses", ha="center", va="center", transform=ax.transAxes)
    return ax


@style.styled
def comparison_figure(comparison: xr.Dataset, depth: int = -1, outlines: Sequence[npt.ArrayLike] = ()) -> Figure:
    """Draw a comparison, one row per state.

    A row has the difference before and after scale and shift, and x0 of both. A response along a single line, or at a
    single position, is drawn by `plot_readings` alone. The first `MOST_STATES` states are shown.

    Parameters
    ----------
    comparison, outlines
        As in `plot_residual`, with any number of x and y.
    depth : int
        Index of the depth in the dataset. The default is the deepest.

    Returns
    -------
    matplotlib.figure.Figure
        The figure, which its method `savefig` writes to a file.
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
        both, shown = _residuals(of)
        for ax, values, stage in zip((left, right), both, _STAGES.values(), strict=True):
            mesh = style.signed_map(ax, of, values, outlines, style.largest(both))
            ax.set_title(f"{state}, {stage}")
        figure.colorbar(mesh, ax=[left, right], label=shown.label("δ"), fraction=0.03, pad=0.01)
        right.set_ylabel("")
        plot_centres(comparison, state, depth, curve)
    note = f" ({len(names)} of {comparison.sizes['state']} states)" if len(names) < comparison.sizes["state"] else ""
    style.main_title(figure, f"Measured less simulated δ, {MM.text(comparison.depth[depth])} deep{note}")
    return figure


def _residuals(of: xr.Dataset) -> tuple[npt.NDArray[np.float64], DisplayUnit]:
    """Residuals of one state and their common unit.

    The residuals before and after scale and shift have shape (2, y, x).
    """
    both = np.stack([of[f"residual_{stage}"].transpose("y", "x").values for stage in _STAGES])
    shown = style.axis_unit(both, "1")
    return shown.of(both), shown
