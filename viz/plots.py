"""Flat figures: copper, matrices, currents and fields, each drawn into Matplotlib axes that it returns.

Every function takes plain arrays in SI and chooses the SI prefix of its axes itself. It draws into the axes `ax`, or
into those of a new figure (``ax.figure``) that belongs to no window and no global state.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Literal, ParamSpec, TypeVar

import matplotlib
import numpy as np
import numpy.typing as npt
import shapely
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import PatchCollection
from matplotlib.colorbar import Colorbar
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Patch, PathPatch
from matplotlib.path import Path
from matplotlib.ticker import EngFormatter

from coilarray.geometry.array import CoilArray
from coilarray.geometry.copper import board_outline, copper_features, drills
from coilarray.viz.palette import BLUE, COILS, INK, LAYERS, VERMILLION, cycled

FloatArray = npt.NDArray[np.float64]
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
    "text.color": INK,
    "legend.frameon": False,
    "lines.linewidth": 1.6,
    "figure.dpi": 150.0,
    "figure.constrained_layout.use": True,
}
"""Matplotlib settings of every figure made here."""

_MM = 1e3  # mm in a metre
_MINUS = "\u2212"  # as wide as a plus, like the numbers on the axes


def styled(draw: Callable[P, R]) -> Callable[P, R]:
    """Draw in `STYLE` and leave the caller's settings as they were."""

    @functools.wraps(draw)
    def styled(*args: P.args, **kwargs: P.kwargs) -> R:
        with matplotlib.rc_context(STYLE):
            return draw(*args, **kwargs)

    return styled


@styled
def plot_copper(array: CoilArray, layer: str, ax: Axes | None = None) -> Axes:
    """Draw the copper of one layer, each coil in its own colour, with holes and the edge of the board, in mm.

    Parameters
    ----------
    array : CoilArray
        The board.
    layer : str
        Name of the copper layer.
    ax : Axes, optional
        Where to draw.
    """
    array.stackup.index(layer)
    ax = ax or _board_axes(array)
    colours = cycled(COILS, array.names)
    for feature in copper_features(array):
        if feature.layer == layer:
            # no add_patch, which would search every edge for the limits of the axes
            ax.add_artist(_patch(feature.shape, facecolor=colours[feature.net], linewidth=0))
    holes = [drill for drill in drills(array) if drill.drilled and layer in drill.layers]
    circles = [Circle((drill.x * _MM, drill.y * _MM), drill.diameter / 2 * _MM) for drill in holes]
    ax.add_collection(PatchCollection(circles, facecolor="white", edgecolor=INK, linewidth=0.3))
    present = {feature.net for feature in copper_features(array) if feature.layer == layer and feature.kind == "trace"}
    _legend(ax, {name: colour for name, colour in colours.items() if name in present}, 1.0)
    _finish_board(ax, array, f"Copper {layer}")
    return ax


@styled
def plot_board(array: CoilArray, ax: Axes | None = None) -> Axes:
    """Draw all copper layers seen from above, translucent, with the names of the coils: the board without rendering.

    Parameters
    ----------
    array : CoilArray
        The board.
    ax : Axes, optional
        Where to draw; in mm.
    """
    ax = ax or _board_axes(array)
    colours = cycled(LAYERS, array.stackup.names)
    features = copper_features(array)
    for layer in reversed(array.stackup.names):
        for feature in features:
            if feature.layer == layer:
                ax.add_artist(_patch(feature.shape, facecolor=colours[layer], linewidth=0, alpha=0.6))
    circles = [
        Circle((drill.x * _MM, drill.y * _MM), drill.diameter / 2 * _MM) for drill in drills(array) if drill.drilled
    ]
    ax.add_collection(PatchCollection(circles, facecolor="white", edgecolor=INK, linewidth=0.3))
    for name, (x, y) in zip(array.names, array.centres * _MM, strict=True):
        box = {"boxstyle": "round,pad=0.2", "facecolor": "white", "alpha": 0.8, "linewidth": 0}
        ax.text(x, y, name, ha="center", va="center", weight="bold", bbox=box)
    _legend(ax, {f"copper {layer}": colour for layer, colour in colours.items()}, 0.6)
    _finish_board(ax, array, "Board from above")
    return ax


@styled
def plot_matrix(
    values: npt.ArrayLike,
    names: Sequence[str],
    *,
    title: str,
    unit: str = "",
    scale: Literal["sequential", "diverging"] = "sequential",
    digits: int = 3,
    mask_diagonal: bool = False,
    ax: Axes | None = None,
) -> Axes:
    """Draw a square matrix as a heat map with its numbers in the cells.

    Parameters
    ----------
    values : array_like, shape (coils, coils)
        In SI.
    names : sequence of str
        Names of the coils.
    title : str
        What is shown.
    unit : str
        SI unit of `values` without a prefix, such as ``"H"``; the prefix is chosen from the largest value shown.
        Empty for a pure number, which gets none.
    scale : {"sequential", "diverging"}
        Diverging: colours symmetric about zero, for values of both signs.
    digits : int
        Digits after the point.
    mask_diagonal : bool
        True leaves the diagonal out, so that the colours spread over the neighbours.
    ax : Axes, optional
        Where to draw.

    Raises
    ------
    ValueError
        A matrix whose shape does not fit the names.
    """
    matrix = _square(values, names, np.float64)
    hidden = np.eye(len(names), dtype=np.bool_) if mask_diagonal else np.zeros_like(matrix, dtype=np.bool_)
    factor, shown_unit = prefix(matrix[~hidden], unit) if unit else (1.0, "")
    numbers = np.ma.array(matrix * factor, mask=hidden)
    texts = [[_fixed(number, digits) for number in row] for row in numbers.data.tolist()]
    return _heat_map(numbers, texts, names, title, shown_unit, scale, ax)


@styled
def plot_effective_inductance(
    names: Sequence[str],
    open_inductance: npt.ArrayLike,
    effective_inductance: npt.ArrayLike,
    ax: Axes | None = None,
) -> Axes:
    """Draw each coil's inductance with open and with grounded neighbours as two dots, and the change in per cent.

    Dots, not bars: their axis need not start at zero, and it says where it starts.

    Parameters
    ----------
    names : sequence of str
        Names of the coils.
    open_inductance, effective_inductance : array_like, shape (coils,)
        In H, with the neighbours open and grounded.
    ax : Axes, optional
        Where to draw.
    """
    before, after = (_row(values, names) for values in (open_inductance, effective_inductance))
    factor, unit = prefix(np.concatenate((before, after)), "H")
    ax = ax or new_axes(6.0, 1.3 + 0.35 * len(names))
    rows = np.arange(len(names))
    ax.hlines(rows, before * factor, after * factor, color="#B0B0B0", linewidth=3, zorder=1)
    ax.scatter(before * factor, rows, s=45, color=BLUE, label="neighbours open", zorder=2)
    ax.scatter(after * factor, rows, s=45, color=VERMILLION, marker="D", label="neighbours grounded", zorder=2)
    for row, low, percent in zip(
        rows.tolist(), np.minimum(before, after).tolist(), (100 * (after / before - 1)).tolist(), strict=True
    ):
        ax.annotate(
            f"{percent:+.2f} %".replace("-", _MINUS),
            (low * factor, row),
            xytext=(-9, 0),
            textcoords="offset points",
            ha="right",
            va="center",
        )
    ax.set_yticks(rows, names)
    ax.set_ylim(len(names) - 0.5, -0.5)
    ax.margins(x=0.25)
    ax.grid(axis="x", color="#E4E4E4")
    ax.set_axisbelow(True)
    ax.set_xlabel(f"inductance ({unit}); the axis does not start at zero")
    ax.set_title("Effective inductance")
    ax.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2, borderaxespad=0.2)
    return ax


@styled
def plot_currents(names: Sequence[str], currents: npt.ArrayLike, ax: Axes | None = None) -> Axes:
    """Draw the currents that one active coil drives in the others: magnitude as colour, and phase written below it.

    Parameters
    ----------
    names : sequence of str
        Names of the coils.
    currents : array_like of complex, shape (coils, coils)
        Element [i, j] is the current in coil i in A per ampere in the active coil j. The diagonal, 1, is left out.
    ax : Axes, optional
        Where to draw.
    """
    matrix = _square(currents, names, np.complex128)
    hidden = np.eye(len(names), dtype=np.bool_)
    factor, unit = prefix(np.abs(matrix[~hidden]), "A")
    numbers = np.ma.array(np.abs(matrix) * factor, mask=hidden)
    texts = [
        [f"{magnitude:.3g}\n{_fixed(phase, 0)}°" for magnitude, phase in zip(*row, strict=True)]
        for row in zip(numbers.data.tolist(), np.degrees(np.angle(matrix)).tolist(), strict=True)
    ]
    ax = _heat_map(numbers, texts, names, "Currents in the passive coils", f"{unit} per A", "sequential", ax)
    ax.set_xlabel("active coil")
    ax.set_ylabel("passive coil")
    return ax


@styled
def plot_field_lines(
    x: npt.ArrayLike,
    profiles: Mapping[str, npt.ArrayLike],
    *,
    coil_centre: float,
    coil_radius: float,
    ax: Axes | None = None,
) -> Axes:
    """Draw B_z along a line across a coil, one curve a profile, with the extent of the coil shaded.

    Parameters
    ----------
    x : array_like, shape (n,)
        Positions on the line in m.
    profiles : mapping of str to array_like, shape (n,)
        B_z in T per ampere in the coil, by the text that the legend shows.
    coil_centre, coil_radius : float
        Position and half the width of the coil in m.
    ax : Axes, optional
        Where to draw; mm across, and the field for a current of 1 mA.

    Raises
    ------
    ValueError
        No profile, or one whose shape does not fit `x`.
    """
    at = np.asarray(x, dtype=np.float64) * _MM
    per_mA = {label: np.asarray(values, dtype=np.float64) * 1e-3 for label, values in profiles.items()}
    if not per_mA or any(values.shape != at.shape for values in per_mA.values()):
        shapes = ", ".join(f"{label} {values.shape}" for label, values in per_mA.items())
        raise ValueError(f"profiles must be one or more of shape {at.shape}; got {shapes or 'none'}.")
    factor, unit = prefix(np.concatenate(list(per_mA.values())), "T")
    ax = ax or new_axes(6.5, 3.6)
    low, high = (coil_centre - coil_radius) * _MM, (coil_centre + coil_radius) * _MM
    ax.axvspan(low, high, color="#EDEDED", zorder=0, label="coil")
    ax.axhline(0.0, color="#909090", linewidth=0.8)
    styles = ("-", "--", "-.", ":")
    for k, (label, values) in enumerate(per_mA.items()):
        ax.plot(at, values * factor, label=label, color=COILS[k % len(COILS)], linestyle=styles[k % len(styles)])
    ax.set_xlim(at.min(), at.max())
    ax.set_xlabel("x (mm)")
    ax.set_ylabel(f"$B_z$ ({unit} per mA)")
    ax.legend()
    return ax


@styled
def plot_field_map(
    x: npt.ArrayLike,
    y: npt.ArrayLike,
    Bz: npt.ArrayLike,
    *,
    outlines: Sequence[npt.ArrayLike] = (),
    title: str,
    unit: str = "T",
    ax: Axes | None = None,
) -> Axes:
    """Draw B_z on a plane, with the outlines of the coils.

    Parameters
    ----------
    x, y : array_like, shapes (nx,), (ny,)
        Ascending coordinates in m.
    Bz : array_like, shape (nx, ny)
        In `unit`.
    outlines : sequence of array_like, each of shape (m, 2)
        Corners in m, first point not repeated.
    title : str
        What is shown.
    unit : str
        Unit of `Bz` without a prefix, such as ``"T"`` or ``"T/A"``.
    ax : Axes, optional
        Where to draw; in mm, colours symmetric about zero.

    Raises
    ------
    ValueError
        A field whose shape does not fit the coordinates.
    """
    across, along = (np.asarray(axis, dtype=np.float64) * _MM for axis in (x, y))
    field = np.asarray(Bz, dtype=np.float64)
    if field.shape != (across.size, along.size):
        raise ValueError(f"Bz must have shape (nx, ny) = {(across.size, along.size)}; got {field.shape}.")
    factor, shown_unit = prefix(field, unit)
    ax = ax or new_axes(*figure_size(np.ptp(across), np.ptp(along)))
    limit = float(np.abs(field * factor).max())
    mesh = ax.pcolormesh(
        across, along, field.T * factor, cmap="RdBu_r", vmin=-limit, vmax=limit, shading="nearest", rasterized=True
    )
    for outline in outlines:
        ax.add_patch(_patch(shapely.Polygon(np.asarray(outline)), facecolor="none", edgecolor=INK, linewidth=0.8))
    ax.set_aspect("equal")
    ax.set_xlabel("x (mm)")
    ax.set_ylabel("y (mm)")
    ax.set_title(title)
    colour_bar(ax, mesh, f"$B_z$ ({shown_unit})")
    return ax


def new_axes(width: float, height: float) -> Axes:
    """Axes of a new figure, sizes in inches."""
    return Figure(figsize=(width, height)).add_subplot()


def _board_axes(array: CoilArray) -> Axes:
    x_min, y_min, x_max, y_max = array.bounds
    return new_axes(*figure_size(x_max - x_min, y_max - y_min))


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


def _patch(shape: shapely.Polygon, **look: object) -> PathPatch:
    """One patch in mm of a polygon in m, holes left open."""
    rings = [shape.exterior, *shape.interiors]
    signs = [1, *[-1] * len(shape.interiors)]  # holes run the other way round, so that they stay open
    paths = [
        Path(np.asarray(ring.coords)[:: 1 if ring.is_ccw == (sign > 0) else -1, :2] * _MM, closed=True)
        for ring, sign in zip(rings, signs, strict=True)
    ]
    return PathPatch(Path.make_compound_path(*paths), **look)


def _finish_board(ax: Axes, array: CoilArray, title: str) -> None:
    outline = board_outline(array)
    ax.add_patch(_patch(outline, facecolor="none", edgecolor=INK, linewidth=1.0))
    x_min, y_min, x_max, y_max = (_MM * edge for edge in outline.bounds)
    rim = 0.02 * (x_max - x_min + y_max - y_min)
    ax.set_xlim(x_min - rim, x_max + rim)
    ax.set_ylim(y_min - rim, y_max + rim)
    ax.set_aspect("equal")
    ax.set_xlabel("x (mm)")
    ax.set_ylabel("y (mm)")
    ax.set_title(title)


def _legend(ax: Axes, colours: Mapping[str, str], alpha: float) -> None:
    """Legend above the axes at the right, where it hides no copper."""
    handles = [Patch(color=colour, label=text, alpha=alpha, linewidth=0) for text, colour in colours.items()]
    ax.legend(
        handles=handles,
        loc="lower right",
        bbox_to_anchor=(1.0, 1.0),
        ncols=min(len(handles), 6),
        borderaxespad=0.2,
        handlelength=1.0,
        columnspacing=1.0,
    )


def _heat_map(
    numbers: np.ma.MaskedArray[tuple[int, int], np.dtype[np.float64]],
    texts: Sequence[Sequence[str]],
    names: Sequence[str],
    title: str,
    unit: str,
    scale: Literal["sequential", "diverging"],
    ax: Axes | None,
) -> Axes:
    """Draw a matrix with names along its edges, a colour bar and a text in every cell; masked cells stay grey."""
    ax = ax or new_axes(2.2 + 0.62 * len(names), 1.4 + 0.55 * len(names))
    shown = numbers.compressed() if numbers.count() else np.array([0.0, 1.0])  # a single coil has no neighbours
    if scale == "diverging":
        limit = float(np.abs(shown).max()) or 1.0
        colours, norm = "RdBu_r", Normalize(-limit, limit)
    elif scale == "sequential":
        colours, norm = "viridis", Normalize(float(shown.min()), float(shown.max()))
    else:
        raise ValueError(f"scale must be 'sequential' or 'diverging'; got {scale!r}.")
    image = ax.imshow(numbers, cmap=colours, norm=norm)
    ax.set_facecolor("#E8E8E8")
    ax.set_xticks(range(len(names)), names)
    ax.set_yticks(range(len(names)), names)
    ax.tick_params(length=0)
    ax.spines[:].set_visible(False)
    ax.set_title(title)
    colour_bar(ax, image, unit)
    _write_cells(ax, texts, image.to_rgba(numbers), np.ma.getmaskarray(numbers))
    return ax


def _write_cells(ax: Axes, texts: Sequence[Sequence[str]], colours: FloatArray, mask: npt.NDArray[np.bool_]) -> None:
    """Write a text into every cell that is not masked, black on light colours and white on dark ones."""
    size = min(9.0, 60.0 / max(len(texts), 1))
    for i, j in np.argwhere(~mask).tolist():
        red, green, blue, _ = colours[i, j]
        light = 0.2126 * red + 0.7152 * green + 0.0722 * blue  # luma, Rec. ITU-R BT.709
        ax.text(j, i, texts[i][j], ha="center", va="center", fontsize=size, color="black" if light > 0.5 else "white")


def prefix(values: FloatArray, unit: str) -> tuple[float, str]:
    """Factor and unit with an SI prefix that bring the largest of the values between 1 and 1000."""
    largest = float(np.abs(values).max(initial=0.0))
    if largest == 0.0 or not math.isfinite(largest):
        return 1.0, unit
    # the small excess keeps 1000 (1 − 1e-16) from being shown as 1000 of the smaller unit
    exponent = min(max(3 * math.floor(math.log10(largest * (1 + 1e-12)) / 3), -24), 24)
    return 10.0**-exponent, EngFormatter.ENG_PREFIXES[exponent] + unit


def _fixed(number: float, digits: int) -> str:
    """Text of a number with a true minus sign, and none before a zero."""
    return f"{round(number, digits) + 0.0:.{digits}f}".replace("-", _MINUS)


def _square(values: npt.ArrayLike, names: Sequence[str], dtype: type[np.generic]) -> npt.NDArray[np.float64]:
    matrix = np.asarray(values, dtype=dtype)
    if matrix.shape != (len(names), len(names)):
        raise ValueError(f"a matrix of {len(names)} coils must have shape {(len(names),) * 2}; got {matrix.shape}.")
    return matrix


def _row(values: npt.ArrayLike, names: Sequence[str]) -> FloatArray:
    row = np.asarray(values, dtype=np.float64)
    if row.shape != (len(names),):
        raise ValueError(f"there must be one value for each of {len(names)} coils; got shape {row.shape}.")
    return row
