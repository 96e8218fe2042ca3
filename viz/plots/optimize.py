"""Figures of a search: convergence, Pareto front, and boards."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Literal

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from coilarray.compute.display_units import MM
from coilarray.geometry.array import Array
from coilarray.viz.palette import BLUE, INK, PALE, SHADE, VERMILLION
from coilarray.viz.plots.board import plot_board
from coilarray.viz.plots.style import faint_grid, figure_size, legend_above, new_axes, new_figure, styled


@styled
def plot_convergence(
    scores: npt.ArrayLike,
    feasible: npt.ArrayLike,
    *,
    label: str,
    maximized: bool = False,
    polished_from: int | None = None,
    start: float | None = None,
    log: bool = False,
    ax: Axes | None = None,
) -> Axes:
    """Draw the score of every trial.

    A line is the best feasible score up to each trial. Raises ValueError if the shapes do not fit.

    Parameters
    ----------
    scores, feasible : array_like of float and of bool, shape (n,)
        Score of every trial, NaN if there is no such board, and whether it keeps all bounds.
    label : str
        Label of the vertical axis, with the unit.
    maximized, log : bool
        Whether larger is better, and whether the axis is logarithmic if all scores are above zero.
    polished_from : int, optional
        Index of the first trial of the local solver.
    start : float, optional
        Score of the given design, drawn as a dashed line.
    """
    values, kept = np.asarray(scores, dtype=np.float64), np.asarray(feasible, dtype=np.bool_)
    if values.ndim != 1 or values.shape != kept.shape:
        raise ValueError(f"scores and feasible must be rows of one length; got {values.shape} and {kept.shape}.")
    ax = ax or new_axes(7.0, 3.6)
    number = np.arange(values.size)
    kept = kept & np.isfinite(values)
    ax.scatter(number[~kept], values[~kept], s=12, color=PALE, marker="x", linewidth=0.9, label="breaks a bound")
    ax.scatter(number[kept], values[kept], s=14, color=BLUE, alpha=0.7, linewidth=0, label="keeps all bounds")
    if kept.any():
        worst = -np.inf if maximized else np.inf
        best = (np.maximum if maximized else np.minimum).accumulate(np.where(kept, values, worst))
        shown = np.isfinite(best)
        ax.step(number[shown], best[shown], where="post", color=VERMILLION, label="best so far")
        _focus(ax, values[kept] if start is None else np.append(values[kept], start), log)
    if start is not None:
        ax.axhline(start, color=INK, linestyle="--", linewidth=1.0, label="given design")
    if polished_from is not None:
        ax.axvspan(polished_from - 0.5, values.size - 0.5, color=SHADE, zorder=0, label="local solver")
    ax.set(xlim=(-0.5, max(values.size - 0.5, 0.5)), xlabel="trial", ylabel=label)
    ax.xaxis.set_major_locator(MaxNLocator(integer=True))
    faint_grid(ax, "y")
    legend_above(ax, 5)
    return ax


@styled
def plot_front(
    points: npt.ArrayLike,
    feasible: npt.ArrayLike,
    front: Sequence[int],
    *,
    labels: tuple[str, str],
    start: tuple[float, float] | None = None,
    named: Mapping[int, str] | None = None,
    stairs: Literal["pre", "post"] | None = None,
    ax: Axes | None = None,
) -> Axes:
    """Draw two scores of all trials.

    The scores are drawn against each other, with the Pareto front and the given design. Raises
    ValueError if the shapes do not fit.

    Parameters
    ----------
    points, feasible : array_like of float, shape (n, 2), and of bool, shape (n,)
        Scores of the trials, and whether each keeps all bounds. Other trials are left out.
    front : sequence of int
        Indices of the points on the front. A single point is called the best.
    labels, start : tuple of str, and of float, optional
        Labels of both axes, with units, and the scores of the given design.
    named : mapping of int to str, optional
        Names to write beside points, by their indices.
    stairs : {"pre", "post"}, optional
        Draw the front as a staircase: ``"post"`` if the first score is minimized, ``"pre"`` if it
        is maximized. None draws no line, as for two out of more scores.
    """
    values, kept = np.asarray(points, dtype=np.float64), np.asarray(feasible, dtype=np.bool_)
    if values.ndim != 2 or values.shape[1] != 2 or values.shape[:1] != kept.shape:
        raise ValueError(f"points must have shape (n, 2) and feasible (n,); got {values.shape} and {kept.shape}.")
    ax = ax or new_axes(6.5, 4.6)
    ax.scatter(values[kept, 0], values[kept, 1], s=14, color=PALE, linewidth=0, label="keeps all bounds")
    edge = values[sorted(front, key=lambda k: tuple(values[k].tolist()))]
    if len(edge):
        if stairs is not None:
            ax.step(edge[:, 0], edge[:, 1], where=stairs, color=VERMILLION, linewidth=0.8, alpha=0.6)
        name = "Pareto front" if len(edge) > 1 else "best"
        ax.scatter(edge[:, 0], edge[:, 1], s=30, color=VERMILLION, label=name, zorder=3)
        _focus_both(ax, edge if start is None else np.vstack([edge, start]), values[kept])
    if start is not None:
        ax.scatter(start[0], start[1], s=130, color=INK, marker="*", label="given design", zorder=4)
    for k, name in (named or {}).items():
        ax.annotate(name, values[k].tolist(), xytext=(6, 6), textcoords="offset points", weight="bold")
    ax.set(xlabel=labels[0], ylabel=labels[1])
    faint_grid(ax)
    legend_above(ax, 3)
    return ax


@styled
def boards_figure(boards: Mapping[str, Array]) -> Figure:
    """Draw boards below each other, at one scale.

    Parameters
    ----------
    boards : mapping of str to Array
        Boards by their titles, at least one.
    """
    edges = np.array([array.bounds for array in boards.values()])
    (x_min, y_min), (x_max, y_max) = edges[:, :2].min(axis=0), edges[:, 2:].max(axis=0)
    width, height = figure_size(x_max - x_min, y_max - y_min)
    figure = new_figure(width, height * len(boards))
    rim = 0.02 * (x_max - x_min + y_max - y_min)
    for k, (title, array) in enumerate(boards.items()):
        ax = plot_board(array, figure.add_subplot(len(boards), 1, k + 1))
        ax.set(xlim=MM.of((x_min - rim, x_max + rim)), ylim=MM.of((y_min - rim, y_max + rim)), title=title)
    return figure


def _focus(ax: Axes, values: npt.NDArray[np.float64], log: bool) -> None:
    """Show all trials that keep the bounds."""
    if log and values.min() > 0:
        ax.set_yscale("log")
        ax.set_ylim(values.min() / 1.5, values.max() * 1.5)
        return
    room = 0.06 * (float(np.ptp(values)) or abs(float(values[0])) or 1.0)
    ax.set_ylim(values.min() - room, values.max() + room)


def _focus_both(ax: Axes, wanted: npt.NDArray[np.float64], others: npt.NDArray[np.float64]) -> None:
    """Show the front and the start."""
    low, high = wanted.min(axis=0), wanted.max(axis=0)
    room = np.where(high > low, high - low, np.abs(high) + 1e-12)
    near = np.clip(others, low - 0.15 * room, high + 1.0 * room)
    low, high = np.minimum(low, near.min(axis=0)), np.maximum(high, near.max(axis=0))
    rim = 0.05 * np.where(high > low, high - low, 1.0)
    ax.set_xlim(low[0] - rim[0], high[0] + rim[0])
    ax.set_ylim(low[1] - rim[1], high[1] + rim[1])
