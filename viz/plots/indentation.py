"""Figures of an indentation: force over depth, and section."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Polygon

from coilarray.compute.display_units import MM
from coilarray.geometry.elastomer import Indenter
from coilarray.viz.datasets.elastomer import indenter_outline
from coilarray.viz.datasets.results import at_depth
from coilarray.viz.palette import BLUE, INK, LAMINATE, SHEETS, VERMILLION, cycled
from coilarray.viz.plots.style import axis_unit, faint_grid, figure_size, new_axes, new_figure, styled

_WIDTH = 2.5  # stack thicknesses shown on each side of the indenter; the raised ring lies within two
_ABOVE, _BELOW = 0.45, 0.06  # thicknesses of the stack shown above its top and of the board
_FORCE_HEIGHT = 3.4  # inches


@styled
def plot_force_depth(indentation: xr.Dataset, ax: Axes | None = None) -> Axes:
    """Draw the force over the depth.

    The contact radius has an axis of its own at the right.

    Parameters
    ----------
    indentation : xarray.Dataset
        Result of `coilarray.indent`.
    """
    ax = ax or new_axes(6.0, _FORCE_HEIGHT)
    depth = MM.of(indentation.depth)
    shown, name = axis_unit(indentation.force), _contact_name(indentation)
    (force,) = ax.plot(depth, shown.of(indentation.force), color=BLUE, marker="o", markersize=4, label="force")
    right = ax.twinx()
    right.spines["right"].set_visible(True)
    look: dict[str, Any] = {"color": VERMILLION, "linestyle": "--", "marker": "D", "markersize": 4}
    (radius,) = right.plot(depth, MM.of(indentation.contact_radius), label=name, **look)
    for axis in (ax, right):
        axis.set_ylim(bottom=0.0)
    ax.set_xlim(left=0.0)
    faint_grid(ax)
    title = f"Force over depth; base: {indentation.attrs['base']}"
    ax.set(xlabel=MM.label("depth"), ylabel=shown.label("force"), title=title)
    right.set_ylabel(MM.label(name))
    ax.legend(handles=[force, radius], loc="upper left")
    return ax


@styled
def plot_dent(indentation: xr.Dataset, indenter: Indenter, depth: int = -1, ax: Axes | None = None) -> Axes:
    """Draw the deformed sheets under the indenter in section.

    The section is mirrored about the axis of the indenter. The flat sheets are dashed. Raises
    ValueError if the dataset has no such depth.

    Parameters
    ----------
    indentation : xarray.Dataset
        As in `plot_force_depth`.
    indenter, depth : Indenter and int
        Body that made the dent, and index of the depth in the dataset. The default is the deepest.
    """
    at = at_depth(indentation, depth)
    height = MM.of(at.height)
    top = float(height[-1])
    half, ceiling = _half_width(indentation) * MM.factor, (1 + _ABOVE) * top
    ax = ax or new_axes(*_dent_size(indentation))
    names = at.interface.values.tolist()[1:]
    lines = [_mirrored(at, k) for k in range(len(height))]
    for k, (name, colour) in enumerate(cycled(SHEETS, names).items()):
        section = np.vstack((lines[k], lines[k + 1][::-1]))
        ax.add_patch(Polygon(section, facecolor=colour, alpha=0.5, edgecolor="none", label=name))
        ax.plot(*lines[k + 1].T, color=colour, linewidth=1.4)
        ax.hlines(height[k + 1], -half, half, color=colour, linewidth=0.8, linestyles="--")
    tip = top - float(at.depth) * MM.factor
    r, z = (MM.of(values) for values in indenter_outline(indenter, (ceiling - tip) / MM.factor))
    body = np.vstack((np.column_stack((-r[::-1], z[::-1] + tip)), np.column_stack((r, z + tip))))
    ax.add_patch(Polygon(body, facecolor="#C8C8C8", edgecolor=INK, linewidth=1.0, label=indenter.name))
    ax.axhspan(-_BELOW * top, 0.0, color=LAMINATE, linewidth=0, label="board")
    ax.set(xlim=(-half, half), ylim=(-_BELOW * top, ceiling), aspect="equal")
    ax.set(xlabel=MM.label("r" if at.attrs["symmetry"] == "axial" else "x"), ylabel=MM.label("z"))
    force, radius = axis_unit(at.force).text(at.force, ".3"), MM.text(at.contact_radius, ".3")
    title = f"{MM.text(at.depth)} deep: {force}, {_contact_name(at)} {radius}"
    ax.set_title(title, pad=22)  # points, room for the legend
    ax.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=6, borderpad=0, borderaxespad=0.4, handlelength=1.0)
    return ax


@styled
def indentation_figure(indentation: xr.Dataset, indenter: Indenter) -> Figure:
    """Draw the deepest dent.

    If there are several depths, the force over the depth is drawn below it.

    Parameters
    ----------
    indentation, indenter
        As in `plot_dent`.
    """
    width, height = _dent_size(indentation)
    heights = [height] if indentation.sizes["depth"] == 1 else [height, _FORCE_HEIGHT]
    figure = new_figure(width, sum(heights))
    axes = figure.subplots(len(heights), squeeze=False, height_ratios=heights).ravel()
    plot_dent(indentation, indenter, ax=axes[0])
    for ax in axes[1:]:
        plot_force_depth(indentation, ax=ax)
    return figure


def _half_width(indentation: xr.Dataset) -> float:
    """Half width of a section through the dent in m."""
    widest = float((indentation.r + indentation.displacement_r).max())
    return min(_WIDTH * float(indentation.height[-1]), widest)


def _dent_size(indentation: xr.Dataset) -> tuple[float, float]:
    """Size of a figure of the dent in inches."""
    width, height = figure_size(2 * _half_width(indentation), (1 + _ABOVE + _BELOW) * float(indentation.height[-1]))
    return width, height + 0.4  # for title and legend in two rows


def _contact_name(indentation: xr.Dataset) -> str:
    return "contact radius" if indentation.attrs["symmetry"] == "axial" else "half width of contact"


def _mirrored(at: xr.Dataset, k: int) -> npt.NDArray[np.float64]:
    """Deformed interface k on both sides in mm, shape (2 n − 1, 2)."""
    one = at.isel(interface=k)
    across = MM.of(one.r + one.displacement_r)
    along = MM.of(one.height + one.displacement_z)
    return np.column_stack((np.r_[-across[:0:-1], across], np.r_[along[:0:-1], along]))
