"""Where a board comes nearest to its fabrication rules: every layer as a whole, and its worst place enlarged."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from matplotlib import patheffects
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from coilarray.geometry.array import CoilArray
from coilarray.geometry.rules import Margin
from coilarray.viz.palette import INK
from coilarray.viz.plots.axis_units import MM, PLAIN, true_minus
from coilarray.viz.plots.board import plot_copper
from coilarray.viz.plots.style import figure_size, styled

_TOGETHER = 0.025  # of the board's diagonal: places nearer than that get one circle
_VIEW = 10.0  # limits and values, whichever is larger, in the width of an enlarged place
_LEAST_VIEW = 1e-3  # m
_BROKEN = "#B00020"


@dataclass(frozen=True)
class _Mark:
    """A circle on one layer, the numbers of the margins there, and the worst of them."""

    numbers: tuple[int, ...]
    worst: Margin
    x: float
    y: float


@styled
def check_figure(array: CoilArray, margins: Sequence[Margin]) -> Figure:
    """Draw the copper of every layer with the places of the margins circled and numbered, and the first one enlarged.

    Parameters
    ----------
    array : CoilArray
        Board that is drawn.
    margins : sequence of Margin
        Margins to mark, the worst first: the k-th has the number k, as in a table. Those without a place are left out.
        Places close together share a circle, which is red where the first of them is broken.

    Returns
    -------
    Figure
        One row per layer: all its copper, and beside it the place of its mark with the lowest number enlarged.
    """
    layers = array.stackup.names
    marks = {layer: _marks(array, layer, margins) for layer in layers}
    x_min, y_min, x_max, y_max = array.bounds
    width, height = figure_size(x_max - x_min, y_max - y_min)
    figure = Figure(figsize=(width + height, height * len(layers)))
    grid = figure.add_gridspec(len(layers), 2, width_ratios=(width, height))
    for row, layer in enumerate(layers):
        ax = plot_copper(array, layer, figure.add_subplot(grid[row, 0]))
        for mark in marks[layer]:
            _circle(ax, mark)
        if marks[layer]:
            _enlarge(plot_copper(array, layer, figure.add_subplot(grid[row, 1])), marks[layer][0])
    return figure


def _marks(array: CoilArray, layer: str, margins: Sequence[Margin]) -> list[_Mark]:
    """Gather the margins of one layer by their places, in the order of their numbers."""
    x_min, y_min, x_max, y_max = array.bounds
    near = _TOGETHER * ((x_max - x_min) ** 2 + (y_max - y_min) ** 2) ** 0.5
    marks: list[_Mark] = []
    for number, margin in enumerate(margins, start=1):
        if margin.layer != layer or margin.x is None or margin.y is None:
            continue
        for k, mark in enumerate(marks):
            if (mark.x - margin.x) ** 2 + (mark.y - margin.y) ** 2 <= near**2:
                marks[k] = _Mark((*mark.numbers, number), mark.worst, mark.x, mark.y)
                break
        else:
            marks.append(_Mark((number,), margin, margin.x, margin.y))
    return marks


def _circle(ax: Axes, mark: _Mark) -> None:
    colour = INK if mark.worst.kept else _BROKEN
    halo = [patheffects.withStroke(linewidth=3.5, foreground="white")]
    x, y = MM.of((mark.x, mark.y)).tolist()
    circle: dict[str, Any] = {"ms": 12, "mfc": "none", "mec": colour, "mew": 1.6}
    ax.plot(x, y, "o", path_effects=halo, gid=_label(mark), **circle)
    letters: dict[str, Any] = {"xytext": (8, 8), "textcoords": "offset points", "color": colour, "weight": "bold"}
    ax.annotate(_label(mark), (x, y), path_effects=halo, **letters)


def _label(mark: _Mark) -> str:
    """Numbers as text, runs of three and more shortened: 1, 4–7."""
    runs: list[list[int]] = []
    for number in mark.numbers:
        if runs and number == runs[-1][-1] + 1:
            runs[-1].append(number)
        else:
            runs.append([number])
    parts = ([f"{run[0]}–{run[-1]}"] if len(run) > 2 else [str(number) for number in run] for run in runs)
    return ", ".join(itertools.chain.from_iterable(parts))


def _enlarge(ax: Axes, mark: _Mark) -> None:
    worst = mark.worst
    lengths = (worst.value, worst.limit) if worst.unit == "m" else (0.0,)
    half = max(_VIEW * max(lengths), _LEAST_VIEW) / 2 * MM.factor
    _circle(ax, mark)
    x, y = MM.of((mark.x, mark.y)).tolist()
    ax.set(xlim=(x - half, x + half), ylim=(y - half, y + half))
    ax.xaxis.set_major_locator(MaxNLocator(4))  # the labels are long
    legend = ax.get_legend()
    if legend is not None:
        legend.remove()
    unit = MM if worst.unit == "m" else PLAIN
    value, limit = (unit.text(number, ".4") for number in (worst.value, worst.limit))
    title = f"{mark.numbers[0]}: {worst.rule} of {worst.feature},\n{value}, limit {limit}"
    ax.set_title(true_minus(title))
