"""Common parts of all flat figures.

The label of an axis reads ``inductance (µH)``. Its ticks are plain numbers, also if logarithmic.
"""

from __future__ import annotations

import functools
import inspect
import math
import sys
import threading
from collections.abc import Callable, Sequence
from typing import Any, Literal, ParamSpec, TypeVar
from weakref import WeakKeyDictionary

import matplotlib
import numpy as np
import numpy.typing as npt
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.cm import ScalarMappable
from matplotlib.collections import QuadMesh
from matplotlib.colorbar import Colorbar
from matplotlib.figure import Figure
from matplotlib.patches import Polygon
from matplotlib.ticker import EngFormatter, FuncFormatter, LogLocator, MaxNLocator, NullFormatter
from matplotlib.transforms import Bbox

from coilarray.compute.arrays import FloatArray
from coilarray.compute.display_units import MM, DisplayUnit, power_of_ten
from coilarray.viz.palette import DIVERGING, FAINT, GREY, INK, ON_MAP, UNKNOWN, coil_colours

P = ParamSpec("P")
R = TypeVar("R")

STYLE: dict[Any, Any] = {
    "font.size": 9.0,
    "axes.titlesize": 10.0,
    "axes.titlelocation": "left",
    "axes.titley": 1.0,  # else every drawing measures the labels beside the title, for a place that stays the same
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

_ROWS = 16  # rows of a column of a legend
_MOST_TICKS, _STEPS = 9, (1, 2, 5, 10)  # largest number and steps of ticks along x of a map
_SYMBOLS = {"ohm": "Ω", "1": ""}  # of the units in datasets


_AX = """

Parameters
----------
ax : matplotlib.axes.Axes, optional
    Axes to draw into. The default is a new figure.
"""


def styled(draw: Callable[P, R]) -> Callable[P, R]:
    """Draw in `STYLE`, keep the settings, explain the parameter `ax`."""
    explained = inspect.getdoc(draw)
    if explained and "ax" in inspect.signature(draw).parameters:
        draw.__doc__ = explained + _AX

    @functools.wraps(draw)
    def styled(*args: P.args, **kwargs: P.kwargs) -> R:
        # Matplotlib's own context would undo the settings that a notebook makes when its first
        # figure loads a backend.
        before = {key: matplotlib.rcParams[key] for key in STYLE}
        matplotlib.rcParams.update(STYLE)
        try:
            return draw(*args, **kwargs)
        finally:
            matplotlib.rcParams.update(before)

    return styled


class NotebookFigure(Figure):
    """Figure of pyplot that a notebook shows once."""

    def _ipython_display_(self) -> None:
        if "inline" in matplotlib.get_backend():
            close(self)  # else the notebook shows it again at the end of the cell
        raise NotImplementedError  # then IPython shows it like any figure


def new_figure(width: float, height: float, layout: Literal["compressed"] | None = None) -> Figure:
    """Make a figure in inches, of pyplot if somebody looks."""
    prompt = hasattr(sys, "ps1")  # of Python, IPython and notebooks
    if (prompt or "matplotlib.pyplot" in sys.modules) and threading.current_thread() is threading.main_thread():
        from matplotlib import pyplot

        return pyplot.figure(figsize=(width, height), layout=layout, FigureClass=NotebookFigure)
    return Figure(figsize=(width, height), layout=layout)


def new_axes(width: float, height: float) -> Axes:
    """Axes of a new figure with sizes in inches."""
    return new_figure(width, height).add_subplot()


def save(figure: Figure, file: Any, **look: Any) -> None:
    """Save a figure and close it, with `look` for Matplotlib."""
    lay_out(figure)
    figure.savefig(file, **look)
    close(figure)


def lay_out(figure: Figure) -> None:
    """Lay a figure out without drawing it: the first layout cuts labels of equal scales."""
    if (engine := figure.get_layout_engine()) is not None:
        engine.execute(figure)


def close(figure: Figure) -> None:
    """Remove a saved figure from pyplot."""
    if "matplotlib.pyplot" in sys.modules:
        sys.modules["matplotlib.pyplot"].close(figure)


def figure_size(width: float, height: float) -> tuple[float, float]:
    """Size in inches of a figure of equal scales."""
    scale = min(8.0 / width, 6.0 / height)
    return max(width * scale, 2.5) + 1.2, max(height * scale, 1.5) + 1.0


def colour_bar(ax: Axes, image: ScalarMappable, label: str, extend: Literal["neither", "max"] = "neither") -> Colorbar:
    """Draw a colour bar exactly as high as the axes."""
    beside = ax.inset_axes((1.03, 0.0, 0.03, 1.0))
    return Colorbar(beside, image, label=label, spacing="proportional", extend=extend)


def faint_grid(ax: Axes, axis: Literal["x", "y", "both"] = "both") -> None:
    """Draw a grid behind everything."""
    ax.grid(axis=axis, color=FAINT)
    ax.set_axisbelow(True)


def legend_beside(ax: Axes, title: str | None = None) -> None:
    """Draw a legend at the right of the axes."""
    if named := ax.get_legend_handles_labels()[0]:
        ax.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), ncols=math.ceil(len(named) / _ROWS), title=title)


def one_legend(figure: Figure) -> None:
    """Draw one legend at the right of a figure."""
    named: dict[str, Any] = {}
    for ax in figure.axes:
        for handle, name in zip(*ax.get_legend_handles_labels(), strict=True):
            named.setdefault(name, handle)
        if (legend := ax.get_legend()) is not None:
            legend.remove()
    figure.legend(named.values(), named.keys(), loc="outside right upper")


def legend_above(
    ax: Axes, columns: int, side: Literal["left", "center", "right"] = "right", columnspacing: float = 1.0, **look: Any
) -> None:
    """Draw a legend above the axes, beside the title."""
    anchor = ({"left": 0.0, "center": 0.5, "right": 1.0}[side], 1.0)
    look = {"loc": f"lower {side}", "borderaxespad": 0.2, "columnspacing": columnspacing, **look}
    ax.legend(bbox_to_anchor=anchor, ncols=columns, **look)


def draw_curve(
    ax: Axes,
    x: npt.ArrayLike,
    y: FloatArray,
    line: str,
    colour: str,
    *,
    half: npt.ArrayLike | None = None,
    undetermined: npt.ArrayLike | None = None,
    **look: Any,
) -> None:
    """Draw a curve with a band, `undetermined` points crossed out."""
    ax.plot(x, y, line, color=colour, **look)
    if half is not None:
        ax.fill_between(x, y - np.asarray(half), y + np.asarray(half), color=colour, alpha=0.2, linewidth=0)
    if undetermined is not None and (hidden := np.asarray(undetermined, dtype=bool) & np.isfinite(y)).any():
        label = "undetermined" if "undetermined" not in [one.get_label() for one in ax.lines] else None
        ax.plot(np.asarray(x)[hidden], y[hidden], "x", color=colour, markersize=4.5, label=label)


def finish_curves(ax: Axes, x: str, y: str, title: str = "") -> None:
    """Label the axes of curves, with grid and legend."""
    faint_grid(ax)
    ax.set(xlabel=x, ylabel=y, title=title)
    legend_beside(ax)


def zero_line(ax: Axes) -> None:
    """Draw a thin line at zero behind the curves."""
    ax.axhline(0.0, color=GREY, linewidth=0.8, zorder=0)


def state_colours(response: xr.Dataset, names: Sequence[str]) -> dict[str, str]:
    """Colour of each state."""
    known = {"coil", "coil_x", "coil_y"} <= set(response.coords)
    if not known or not set(names) <= set(response.coil.values.tolist()):
        return coil_colours(names)
    colours = coil_colours(response.coil.values.tolist(), np.column_stack((response.coil_x, response.coil_y)))
    return {name: colours[name] for name in names}


def write_name(ax: Axes, x: float, y: float, name: str, **look: Any) -> None:
    """Write a coil's name in a white box about a place in mm."""
    box: dict[str, Any] = {"boxstyle": "round,pad=0.2", "facecolor": "white", "alpha": 0.8, "linewidth": 0}
    ax.text(x, y, name, ha="center", va="center", bbox=box, **look)


def draw_outlines(ax: Axes, outlines: Sequence[npt.ArrayLike]) -> None:
    """Draw the coils' outlines, corners (m, 2) in m, into axes in mm."""
    for outline in outlines:
        ax.add_patch(Polygon(MM.of(outline), closed=True, facecolor="none", edgecolor=ON_MAP, linewidth=0.8))


def finish_map(ax: Axes, outlines: Sequence[npt.ArrayLike]) -> None:
    """Draw the coils on a map in mm."""
    limits = ax.get_xlim(), ax.get_ylim()
    draw_outlines(ax, outlines)
    ax.set_xlim(*limits[0])
    ax.set_ylim(*limits[1])
    ax.set_facecolor(UNKNOWN)
    plan_axes(ax)


def signed_map(
    ax: Axes,
    at: xr.Dataset | xr.DataArray,
    values: npt.NDArray[np.float64],
    outlines: Sequence[npt.ArrayLike],
    limit: float | None = None,
    *,
    rasterized: bool = False,
) -> QuadMesh:
    """Draw values (y, x) in colours symmetric about zero, over `at` in m."""
    limit = largest(values) if limit is None else limit
    shown = np.ma.masked_invalid(values)
    look: dict[str, Any] = {"cmap": DIVERGING, "vmin": -limit, "vmax": limit, "rasterized": rasterized}
    mesh = ax.pcolormesh(MM.of(at.x), MM.of(at.y), shown, **look)
    finish_map(ax, outlines)
    return mesh


def plan_axes(ax: Axes) -> None:
    """Label the axes of a plan in mm."""
    ax.set(aspect="equal", xlabel=MM.label("x"), ylabel=MM.label("y"))
    ax.xaxis.set_major_locator(MaxNLocator(_MOST_TICKS, steps=_STEPS))


def map_size(at: xr.Dataset | xr.DataArray) -> tuple[float, float]:
    """Size in inches of a figure of a map over `at`."""
    return figure_size(float(np.ptp(at.x.values)), float(np.ptp(at.y.values)))


def main_title(figure: Figure, title: str) -> None:
    """Write a title above all axes, at the left."""
    figure.suptitle(title, x=0.01, ha="left", fontsize="large")


def largest(values: npt.NDArray[np.float64]) -> float:
    """Largest magnitude of the finite values."""
    finite = np.abs(values[np.isfinite(values)])
    return float(finite.max(initial=0.0)) or 1.0


def axis_unit(values: npt.ArrayLike | xr.DataArray, unit: str | None = None) -> DisplayUnit:
    """Choose the prefix of a unit for an axis.

    It brings the largest of the finite values between 1 and 1000. `unit` is an SI unit without a
    prefix. For a pure number, "" or "1", the power of ten is written out.

    >>> axis_unit([58.2e-6, -3e-6], "H").label("L")
    'L (µH)'
    >>> axis_unit([7.9e-4], "1").label("δ"), axis_unit([19.5], "ohm").label("R")
    ('δ (10⁻⁶)', 'R (Ω)')
    """
    named = str(getattr(values, "attrs", {}).get("units", "1")) if unit is None else unit
    symbol = _SYMBOLS.get(named, named)
    # The small excess keeps 1000 (1 − 1e-16) from being shown as 1000 of the smaller unit.
    decades = math.log10(largest(np.asarray(values, dtype=np.float64)) * (1 + 1e-12))
    exponent = min(max(3 * math.floor(decades / 3), -24), 24)
    power = power_of_ten(exponent) if exponent else ""
    return DisplayUnit(EngFormatter.ENG_PREFIXES[exponent] + symbol if symbol else power, 10.0**-exponent)


def described_axes(figure: Figure, box: Bbox) -> list[dict[str, Any]]:
    """Describe axes for a page that shows the values under the mouse.

    Places are in points from the upper left corner of `box`, in inches. Labelled curves get the name of their group in
    the SVG, and maps have their values in few digits.
    """
    found = []
    for ax in figure.axes:
        named = (line for line in ax.lines if not str(line.get_label()).startswith("_"))
        lines = [line for line in named if np.size(line.get_xdata()) > _FEWEST]
        maps = [one for one in ax.collections if isinstance(one, QuadMesh)]
        for k, line in enumerate(lines):
            line.set_gid(f"curve-{figure.axes.index(ax)}-{k}")
        shown = VALUES.get(ax) or (_mesh_values(maps[0]) if maps else None)
        if not ax.get_visible() or not (lines or shown or ax in CELLS):
            continue
        place = ax.get_window_extent().transformed(figure.dpi_scale_trans.inverted())
        corners = place.x0 - box.x0, box.y1 - place.y1, place.width, place.height
        one: dict[str, Any] = {"place": [round(72 * value, 2) for value in corners]}
        for name, axis in (("x", ax.xaxis), ("y", ax.yaxis)):
            ends = [float(f"{end:.6g}") for end in axis.get_view_interval()]
            one[name] = {"ends": ends, "log": axis.get_scale() == "log", "label": axis.get_label_text()}
        one["curves"] = [[line.get_gid(), str(line.get_label())] for line in lines]
        cells = CELLS.get(ax)
        found.append(one | ({} if shown is None else {"map": shown}) | ({} if cells is None else {"cells": cells}))
    return found


_FEWEST = 2  # points of a line that is a mark
VALUES: WeakKeyDictionary[Axes, dict[str, Any]] = WeakKeyDictionary()
"""Values of maps that are drawn as bands, from `map_values`."""
CELLS: WeakKeyDictionary[Axes, list[list[Any]]] = WeakKeyDictionary()
"""Cells of matrices, and coils of plans: x and y on the axes, and the text of the nearest to the mouse."""
_MOST_VALUES = 40  # along an edge of a map, of six maps


def map_values(
    x: npt.ArrayLike, y: npt.ArrayLike, values: FloatArray, label: str = "", maps: int = 1
) -> dict[str, Any]:
    """Return a coarse map (y, x) with its places for `described_axes`, coarser beside many `maps`."""
    most = _MOST_VALUES / max(1.0, math.sqrt(maps / 6))
    steps = [math.ceil(count / most) for count in values.shape]
    coarse = np.ma.filled(values[:: steps[0], :: steps[1]], np.nan).tolist()
    texts = [" ".join(f"{value:.3g}" for value in row) for row in coarse]  # "nan" where there is none
    at_x, at_y = np.asarray(x)[:: steps[1]], np.asarray(y)[:: steps[0]]
    ends = [[float(f"{one[end]:.5g}") for end in (0, -1)] for one in (at_x, at_y)]
    return {"x": ends[0], "y": ends[1], "values": texts, "label": label}


def _mesh_values(mesh: QuadMesh) -> dict[str, Any]:
    """Values of the cells of a mesh at their middles."""
    corners = np.asarray(mesh.get_coordinates(), dtype=np.float64)
    middles = (corners[:-1, :-1] + corners[1:, 1:]) / 2
    values: Any = np.ma.filled(np.ma.asarray(mesh.get_array(), dtype=np.float64), np.nan)
    label = "" if mesh.colorbar is None else mesh.colorbar.ax.get_ylabel()
    return map_values(middles[0, :, 0], middles[:, 0, 1], values.reshape(middles.shape[:2]), label)


def logarithmic_ticks(axis: Axis, decades: float) -> None:
    """Write plain numbers on a logarithmic axis."""
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if decades < 2.5 else (1.0,)))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())
