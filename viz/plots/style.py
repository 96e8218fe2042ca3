"""What all flat figures have in common: settings, sizes, colour bars, grids, and the coils' outlines."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from typing import Any, Literal, ParamSpec, TypeVar

import matplotlib
import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colorbar import Colorbar
from matplotlib.figure import Figure
from matplotlib.patches import Polygon
from matplotlib.ticker import MaxNLocator

from coilarray.viz.palette import FAINT, INK, UNKNOWN
from coilarray.viz.plots.axis_units import MM

P = ParamSpec("P")
R = TypeVar("R")

STYLE: dict[Any, Any] = {
    "font.size": 9.0,
    "axes.titlesize": 10.0,
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": "#606060",
    "axes.labelcolor": INK,
    "axes.axisbelow": True,
    "grid.color": FAINT,
    "text.color": INK,
    "legend.frameon": False,
    "lines.linewidth": 1.6,
    "figure.dpi": 150.0,
    "figure.constrained_layout.use": True,
}
"""Matplotlib settings of every figure made here."""

_MOST_TICKS, _STEPS = 9, (1, 2, 5, 10)  # along x of a map


def styled(draw: Callable[P, R]) -> Callable[P, R]:
    """Draw in `STYLE` and leave the caller's settings as they were."""

    @functools.wraps(draw)
    def styled(*args: P.args, **kwargs: P.kwargs) -> R:
        with matplotlib.rc_context(STYLE):
            return draw(*args, **kwargs)

    return styled


def new_axes(width: float, height: float) -> Axes:
    """Axes of a new figure, sizes in inches, that belongs to no window and no global state."""
    return Figure(figsize=(width, height)).add_subplot()


def figure_size(width: float, height: float) -> tuple[float, float]:
    """Size in inches of a figure for a picture of equal scales, with room for labels; long ones stay readable."""
    scale = min(8.0 / width, 6.0 / height)
    return max(width * scale, 2.5) + 1.2, max(height * scale, 1.5) + 1.0


def colour_bar(ax: Axes, image: ScalarMappable, label: str) -> Colorbar:
    """Draw a colour bar exactly as high as the axes; bands of colour are as high as what they stand for."""
    figure = ax.get_figure(root=True)
    if figure is None:
        raise ValueError("ax must belong to a figure.")
    return figure.colorbar(image, cax=ax.inset_axes((1.03, 0.0, 0.03, 1.0)), label=label, spacing="proportional")


def faint_grid(ax: Axes, axis: Literal["x", "y", "both"] = "both") -> None:
    """Draw a grid behind everything, in a user's axes too."""
    ax.grid(axis=axis, color=FAINT)
    ax.set_axisbelow(True)


def legend_beside(ax: Axes, columns: int = 1, title: str | None = None) -> None:
    """Legend at the right of the axes, where it hides no curve; none where no curve has a name."""
    if ax.get_legend_handles_labels()[0]:
        ax.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), ncols=columns, title=title)


def legend_above(ax: Axes, columns: int, side: Literal["left", "right"] = "right") -> None:
    """Legend above the axes, beside the title, where it hides no curve."""
    ax.legend(
        loc="lower left" if side == "left" else "lower right",
        bbox_to_anchor=(0.0 if side == "left" else 1.0, 1.0),
        ncols=columns,
        borderaxespad=0.2,
        columnspacing=1.0,
    )


def draw_outlines(ax: Axes, outlines: Sequence[npt.ArrayLike]) -> None:
    """Draw the coils' outlines into axes in mm.

    Parameters
    ----------
    ax : Axes
        Where.
    outlines : sequence of array_like, each of shape (m, 2)
        Corners in m, first point not repeated.
    """
    for outline in outlines:
        ax.add_patch(Polygon(MM.of(outline), closed=True, facecolor="none", edgecolor=INK, linewidth=0.8))


def finish_map(ax: Axes, outlines: Sequence[npt.ArrayLike]) -> None:
    """Draw the coils on a map in mm within the limits that it has; grey where it has no value."""
    limits = ax.get_xlim(), ax.get_ylim()
    draw_outlines(ax, outlines)
    ax.set_xlim(*limits[0])
    ax.set_ylim(*limits[1])
    ax.set_facecolor(UNKNOWN)
    plan_axes(ax)


def plan_axes(ax: Axes) -> None:
    """Name the axes of a plan of the board in mm, of equal scales."""
    ax.set_aspect("equal")
    ax.xaxis.set_major_locator(MaxNLocator(_MOST_TICKS, steps=_STEPS))
    ax.set_xlabel(MM.label("x"))
    ax.set_ylabel(MM.label("y"))


def largest(values: npt.NDArray[np.float64]) -> float:
    """Largest magnitude of what is finite, 1 where that is zero: the limit of colours symmetric about zero."""
    finite = np.abs(values[np.isfinite(values)])
    return float(finite.max(initial=0.0)) or 1.0
