"""Figures of a coupling.

The matrices of k and L, the effect of the neighbours on each coil, and the currents in them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.colors import Normalize

from coilarray.compute.display_units import PLAIN, number_text, true_minus
from coilarray.viz.palette import BLUE, PALE, SEQUENTIAL, UNKNOWN, VERMILLION, signed_colours
from coilarray.viz.plots.style import axis_unit, colour_bar, faint_grid, legend_above, new_axes, styled

_MOST_NUMBERED = 12  # coils whose matrix has room for its numbers
_MOST_NAMED = 32  # coils whose names all fit along the edges of a matrix
_LARGEST = 11.0  # inches
_DARK = 0.179  # relative luminance with equal contrast to black and white, 4.6: √(1.05 · 0.05) − 0.05, WCAG 2.1


@styled
def plot_coupling(coupling: xr.Dataset, ax: Axes | None = None) -> Axes:
    """Draw the coupling coefficients k of all pairs.

    The matrix is drawn by `plot_matrix`. Its diagonal, 1, is left out.

    Parameters
    ----------
    coupling : xarray.Dataset
        Result of `coilarray.couple_design` or `coilarray.circuit.coupling.couple`.
    ax : Axes, optional
        Axes to draw into. The colours are symmetric about zero.

    Returns
    -------
    matplotlib.axes.Axes
        The given axes, or new axes by default.

    Examples
    --------
    >>> from coilarray.circuit.coupling import couple
    >>> pair = couple(["a", "b"], [[20e-6, -1e-6], [-1e-6, 20e-6]], 5.0, 330e-12)
    >>> [text.get_text() for text in plot_coupling(pair).texts]
    ['−0.050', '−0.050']
    """
    k, names = coupling.coupling, coupling.coil.values.tolist()
    title = "Coupling coefficient k = M/√(L L)"
    return plot_matrix(k, names, title=title, quantity="k", scale="diverging", mask_diagonal=True, ax=ax)


@styled
def plot_inductance(coupling: xr.Dataset, ax: Axes | None = None) -> Axes:
    """Draw the inductance matrix.

    It is drawn by `plot_matrix`, with L on the diagonal and M of the pairs off it. For more than 12 coils only M is
    drawn, because L would take up its colours.

    Parameters
    ----------
    coupling : xarray.Dataset
        As in `plot_coupling`.
    ax : Axes, optional
        Axes to draw into. The prefix is chosen from the largest value.

    Returns
    -------
    matplotlib.axes.Axes
        The given axes, or new axes by default.

    Examples
    --------
    >>> from coilarray.circuit.coupling import couple
    >>> pair = couple(["a", "b"], [[20e-6, -1e-6], [-1e-6, 20e-6]], 5.0, 330e-12)
    >>> [text.get_text() for text in plot_inductance(pair).texts]
    ['20.000', '−1.000', '−1.000', '20.000']
    """
    L, names = coupling.inductance, coupling.coil.values.tolist()
    unit = str(L.attrs["units"])
    many = len(names) > _MOST_NUMBERED
    title, quantity = ("Mutual inductance", "M") if many else ("Inductance", "L, M")
    return plot_matrix(
        L, names, title=title, quantity=quantity, unit=unit, scale="diverging", mask_diagonal=many, ax=ax
    )


@styled
def plot_matrix(
    values: npt.ArrayLike,
    names: Sequence[str],
    *,
    title: str,
    quantity: str = "",
    unit: str = "",
    scale: Literal["sequential", "diverging"] = "sequential",
    digits: int = 3,
    mask_diagonal: bool = False,
    ax: Axes | None = None,
) -> Axes:
    """Draw a square matrix as a heat map.

    For up to 12 coils the cells contain the numbers.

    Parameters
    ----------
    values : array_like, shape (coils, coils)
        Elements in SI units.
    names : sequence of str
        Names of the coils.
    title, quantity : str
        Title of the axes, and name of the quantity for the colour bar.
    unit : str
        SI unit of `values` without a prefix, such as ``"H"``. The prefix is chosen from the largest value shown. Empty
        for a pure number, which gets no prefix.
    scale : {"sequential", "diverging"}
        Diverging colours are symmetric about zero, or from zero for values of one sign.
    digits, mask_diagonal : int, bool
        Number of digits after the decimal point, and whether to leave the diagonal out. Without it the colours spread
        over the neighbours.
    ax : Axes, optional
        Axes to draw into.

    Returns
    -------
    matplotlib.axes.Axes
        The given axes, or new axes by default.

    Raises
    ------
    ValueError
        If the shape of the matrix does not fit the names, or the scale is unknown.

    Examples
    --------
    >>> ax = plot_matrix([[2e-6, 0.0], [0.0, 3e-6]], ["a", "b"], title="L", unit="H", digits=1)
    >>> [text.get_text() for text in ax.texts]
    ['2.0', '0.0', '0.0', '3.0']
    """
    matrix = np.asarray(values, dtype=np.float64)
    if matrix.shape != (len(names), len(names)):
        raise ValueError(f"a matrix of {len(names)} coils must have shape {(len(names),) * 2}; got {matrix.shape}.")
    hidden = np.eye(len(names), dtype=np.bool_) if mask_diagonal else np.zeros_like(matrix, dtype=np.bool_)
    shown = axis_unit(matrix[~hidden], unit) if unit else PLAIN
    numbers = np.ma.array(shown.of(matrix), mask=hidden)
    texts = [[number_text(number, digits) for number in row] for row in numbers.data.tolist()]
    label = shown.label(quantity) if quantity else shown.symbol
    return _heat_map(numbers, texts, names, title, label, scale, ax)


@styled
def plot_effective_inductance(coupling: xr.Dataset, ax: Axes | None = None) -> Axes:
    """Draw the effective inductance of each coil.

    All other coils are open, and as terminated. The change in per cent is written beside them. Dots are used rather
    than bars, because the axis does not start at zero.

    Parameters
    ----------
    coupling : xarray.Dataset
        As in `plot_coupling`.
    ax : Axes, optional
        Axes to draw into.

    Returns
    -------
    matplotlib.axes.Axes
        The given axes, or new axes by default.

    Examples
    --------
    >>> from coilarray.circuit.coupling import couple
    >>> pair = couple(["a", "b"], [[20e-6, -2e-6], [-2e-6, 20e-6]], 0.0, 330e-12)
    >>> [text.get_text() for text in plot_effective_inductance(pair).texts]
    ['−1.00 %', '−1.00 %']
    """
    names = coupling.coil.values.tolist()
    before, after = coupling.open_effective_inductance.values, coupling.effective_inductance.values
    shown = axis_unit(np.concatenate((before, after)), str(coupling.open_effective_inductance.attrs["units"]))
    ax = ax or new_axes(6.0, min(1.3 + 0.35 * len(names), _LARGEST))
    rows = np.arange(len(names))
    closed = "grounded" if (coupling.termination.values == "short").all() else "as terminated"
    ax.hlines(rows, shown.of(before), shown.of(after), color=PALE, linewidth=3, zorder=1)
    ax.scatter(shown.of(before), rows, s=45, color=BLUE, label="others open", zorder=2)
    ax.scatter(shown.of(after), rows, s=45, color=VERMILLION, marker="D", label=f"others {closed}", zorder=2)
    lower, change = shown.of(np.minimum(before, after)), 100 * (after / before - 1)
    for row, low, percent in zip(rows.tolist(), lower.tolist(), change.tolist(), strict=True):
        look: dict[str, Any] = {"xytext": (-9, 0), "textcoords": "offset points", "ha": "right", "va": "center"}
        look["fontsize"] = min(9.0, 280.0 / len(names))
        ax.annotate(true_minus(f"{percent:+.2f} %"), (low, row), **look)
    ax.set_yticks(rows, names, fontsize=min(9.0, 280.0 / len(names)))
    ax.margins(x=0.25)
    faint_grid(ax, "x")
    label = f"{shown.label('inductance')}; the axis does not start at zero"
    ax.set(ylim=(len(names) - 0.5, -0.5), xlabel=label, title="Effective inductance")
    legend_above(ax, 2)
    return ax


@styled
def plot_currents(coupling: xr.Dataset, ax: Axes | None = None) -> Axes:
    """Draw the currents that an active coil induces.

    The magnitude in the other coils is a colour, with the phase written below.

    Parameters
    ----------
    coupling : xarray.Dataset
        As in `plot_coupling`.
    ax : Axes, optional
        Axes to draw into, with a column per active coil and a row per passive coil. Currents are per ampere in the
        active coil. The diagonal, 1, is left out.

    Returns
    -------
    matplotlib.axes.Axes
        The given axes, or new axes by default.

    Examples
    --------
    >>> from coilarray.circuit.coupling import couple
    >>> pair = couple(["a", "b"], [[20e-6, -1e-6], [-1e-6, 20e-6]], 0.0, 330e-12)
    >>> plot_currents(pair).texts[0].get_text().split()
    ['50', '0°']
    """
    names = coupling.coil.values.tolist()
    currents = (coupling.current_real + 1j * coupling.current_imag).transpose("other", "coil").values
    hidden = np.eye(len(names), dtype=np.bool_)
    shown = axis_unit(np.abs(currents[~hidden]), "A")  # per A
    numbers = np.ma.array(shown.of(np.abs(currents)), mask=hidden)
    texts = [
        [f"{magnitude:.3g}\n{number_text(phase, 0)}°" for magnitude, phase in zip(*row, strict=True)]
        for row in zip(numbers.data.tolist(), np.degrees(np.angle(currents)).tolist(), strict=True)
    ]
    label = f"current ({shown.symbol} per A)"
    ax = _heat_map(numbers, texts, names, "Currents in the passive coils", label, "sequential", ax)
    ax.set(xlabel="active coil", ylabel="passive coil")
    return ax


def _heat_map(
    numbers: np.ma.MaskedArray[tuple[int, int], np.dtype[np.float64]],
    texts: Sequence[Sequence[str]],
    names: Sequence[str],
    title: str,
    label: str,
    scale: Literal["sequential", "diverging"],
    ax: Axes | None,
) -> Axes:
    """Draw a matrix with names and a colour bar.

    The names are along the edges. If there are few coils, every cell has a text. Masked cells are grey.
    """
    n = len(names)
    ax = ax or new_axes(min(2.2 + 0.62 * n, _LARGEST), min(1.4 + 0.55 * n, _LARGEST - 0.8))
    shown = numbers.compressed() if numbers.count() else np.array([0.0, 1.0])  # a single coil has no neighbours
    if scale == "diverging":
        colours, low, high = signed_colours(shown)
        norm = Normalize(low, high)
    elif scale == "sequential":
        colours, norm = SEQUENTIAL, Normalize(float(shown.min()), float(shown.max()))
    else:
        raise ValueError(f"scale must be 'sequential' or 'diverging'; got {scale!r}.")
    image = ax.imshow(numbers, cmap=colours, norm=norm)
    ax.set_facecolor(UNKNOWN)
    named = range(0, n, math.ceil(n / _MOST_NAMED))
    look: dict[str, Any] = {"fontsize": 9.0 if n <= _MOST_NUMBERED else 7.0}
    ax.set_xticks(named, [names[k] for k in named], rotation=0 if n <= _MOST_NUMBERED else 90, **look)
    ax.set_yticks(named, [names[k] for k in named], **look)
    ax.tick_params(length=0)
    ax.spines[:].set_visible(False)
    ax.set_title(title)
    colour_bar(ax, image, label)
    if n > _MOST_NUMBERED:
        return ax
    size, cells = min(9.0, 60.0 / max(len(texts), 1)), image.to_rgba(numbers)
    linear = np.where(cells <= 0.04045, cells / 12.92, ((cells + 0.055) / 1.055) ** 2.4)  # sRGB
    luminance = linear[..., :3] @ (0.2126, 0.7152, 0.0722)
    for i, j in np.argwhere(~np.ma.getmaskarray(numbers)).tolist():
        colour = "black" if luminance[i, j] > _DARK else "white"
        ax.text(j, i, texts[i][j], ha="center", va="center", fontsize=size, color=colour)
    return ax
