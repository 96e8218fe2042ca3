"""Figures of coils in their circuit: k and L, effective inductance, currents, and impedance over frequency."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from coilarray.compute.display_units import PLAIN, number_text, true_minus
from coilarray.viz.palette import BLUE, GREY, PALE, SEQUENTIAL, UNKNOWN, VERMILLION, curve_look, signed_colours
from coilarray.viz.plots import style

_MOST_NUMBERED = 12  # coils whose matrix has room for its numbers
_MOST_NAMED = 32  # coils whose names all fit along the edges of a matrix
_LARGEST = 11.0  # inches
_DARK = 0.179  # relative luminance with equal contrast to black and white, 4.6: √(1.05 · 0.05) − 0.05, WCAG 2.1

_NAMES = {
    "apparent_inductance": "apparent inductance Im Z/ω",
    "impedance_real": "effective resistance Re Z",
    "impedance_imag": "reactance Im Z",
    "quality_factor": "quality factor Im Z/Re Z",
}
_POLES = ("apparent_inductance", "impedance_real", "impedance_imag")  # with a pole at the self-resonance
_MANY = 10.0  # largest over least resistance on an axis of equal steps; it spans decades near a self-resonance
_CEILING, _HEADROOM = 4.0, 1.08  # height of the axis over a pole's value at the lowest frequency, and over all values
_MOST_CURVES = 9  # number of curves that can be distinguished if coils are alike
_RANGE = 0.35  # opacity of the range of all curves


@style.styled
def plot_coupling(coupling: xr.Dataset, ax: Axes | None = None) -> Axes:
    """Draw the coupling coefficients k of all pairs.

    The matrix is drawn by `plot_matrix`, without its diagonal.

    Parameters
    ----------
    coupling : xarray.Dataset
        Result of `coilarray.couple_design` or `coilarray.circuit.coupling.couple`.

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


@style.styled
def plot_inductance(coupling: xr.Dataset, ax: Axes | None = None) -> Axes:
    """Draw the inductance matrix.

    It is drawn by `plot_matrix`, with L on the diagonal and M of the pairs off it. For more than 12 coils only M is
    drawn, because L would take up its colours.

    Parameters
    ----------
    coupling : xarray.Dataset
        As in `plot_coupling`.

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


@style.styled
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
    shown = style.axis_unit(matrix[~hidden], unit) if unit else PLAIN
    numbers = np.ma.array(shown.of(matrix), mask=hidden)
    texts = [[number_text(number, digits) for number in row] for row in numbers.data.tolist()]
    label = shown.label(quantity) if quantity else shown.symbol
    return _heat_map(numbers, texts, names, title, label, scale, ax)


@style.styled
def plot_effective_inductance(coupling: xr.Dataset, ax: Axes | None = None) -> Axes:
    """Draw the effective inductance of each coil.

    All other coils are open, and as terminated. The change in per cent is written beside them. Dots are used rather
    than bars, because the axis does not start at zero.

    Parameters
    ----------
    coupling : xarray.Dataset
        As in `plot_coupling`.

    Examples
    --------
    >>> from coilarray.circuit.coupling import couple
    >>> pair = couple(["a", "b"], [[20e-6, -2e-6], [-2e-6, 20e-6]], 0.0, 330e-12)
    >>> [text.get_text() for text in plot_effective_inductance(pair).texts]
    ['−1.00 %', '−1.00 %']
    """
    names = coupling.coil.values.tolist()
    before, after = coupling.open_effective_inductance.values, coupling.effective_inductance.values
    shown = style.axis_unit(np.concatenate((before, after)), str(coupling.open_effective_inductance.attrs["units"]))
    ax = ax or style.new_axes(6.0, min(1.3 + 0.35 * len(names), _LARGEST))
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
    style.faint_grid(ax, "x")
    label = f"{shown.label('inductance')}; the axis does not start at zero"
    ax.set(ylim=(len(names) - 0.5, -0.5), xlabel=label, title="Effective inductance")
    style.legend_above(ax, 2)
    return ax


@style.styled
def plot_currents(coupling: xr.Dataset, ax: Axes | None = None) -> Axes:
    """Draw the currents that an active coil induces.

    Each column has the currents per ampere in an active coil. The magnitude in the other coils is a colour, with the
    phase written below.

    Parameters
    ----------
    coupling : xarray.Dataset
        As in `plot_coupling`.

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
    shown = style.axis_unit(np.abs(currents[~hidden]), "A")  # per A
    numbers = np.ma.array(shown.of(np.abs(currents)), mask=hidden)
    texts = [
        [f"{magnitude:.3g}\n{number_text(phase, 0)}°" for magnitude, phase in zip(*row, strict=True)]
        for row in zip(numbers.data.tolist(), np.degrees(np.angle(currents)).tolist(), strict=True)
    ]
    label = f"current ({shown.symbol} per A)"
    ax = _heat_map(numbers, texts, names, "Currents in the passive coils", label, "sequential", ax)
    ax.set(xlabel="active coil", ylabel="passive coil")
    return ax


@style.styled
def plot_frequency_sweep(
    sweep: xr.Dataset, quantity: str = "apparent_inductance", ax: Axes | None = None, *, scan: xr.Dataset | None = None
) -> Axes:
    """Draw a quantity over frequency, one curve per state.

    If there are many states, three of them and the range of all are drawn. A quantity with a pole is drawn up to four
    times its value at the lowest frequency.

    Parameters
    ----------
    sweep : xarray.Dataset
        Result of `coilarray.circuit.impedance.sweep_design`.
    quantity : str
        Name of a variable: ``apparent_inductance``, ``impedance_real``, ``impedance_imag`` or ``quality_factor``.
    scan : xarray.Dataset, optional
        Result of `coilarray.circuit.impedance.scan_design` of the same states. A dot marks the resonance with the tank
        on each curve, and a dotted line the self-resonance.

    Raises
    ------
    ValueError
        If the sweep has no such quantity.

    Examples
    --------
    >>> from coilarray import load_design
    >>> from coilarray.circuit.impedance import sweep_design
    >>> ax = plot_frequency_sweep(sweep_design(load_design("gast_fem"), [1e5, 1e6]))
    >>> ax.get_xlabel(), ax.get_ylabel()
    ('frequency (MHz)', 'apparent inductance Im Z/ω (µH)')
    """
    there = [name for name in _NAMES if name in sweep]
    if quantity not in there:
        raise ValueError(f"quantity must be one of {', '.join(there)}; got {quantity!r}.")
    values = sweep[quantity].transpose("frequency", "state").values
    top = _HEADROOM * float(values.max())
    if quantity in _POLES:
        top = min(_CEILING * float(values[0].max()), top)
    unit = str(sweep[quantity].attrs["units"])
    shown = PLAIN if unit == "1" else style.axis_unit(top, unit)
    of_frequency = style.axis_unit(sweep.frequency)
    f = of_frequency.of(sweep.frequency)
    ax = ax or style.new_axes(6.5, 3.6)
    names = sweep.state.values.tolist()
    chosen = _chosen(sweep)
    if len(chosen) < len(names):
        within = (values > 0).all(axis=1)  # no range beyond a pole of some states
        low, high = (shown.of(edge) for edge in (values.min(axis=1), values.max(axis=1)))
        ax.fill_between(f, low, high, where=within, color=GREY, alpha=_RANGE, lw=0, label=f"all {len(names)} states")
    for k in chosen:
        name, curve = names[k], shown.of(values[:, k])
        # Losses turn a pole of the inductance into a steep fall, and a sample on it may lie within the axis.
        falls = (np.diff(values[:, k]) < 0) & ((values[:-1, k] > top) | (np.diff(np.sign(values[:, k])) < 0))
        pole = np.flatnonzero(falls & (quantity == "apparent_inductance")) + 1
        drawn = np.insert(f, pole, np.nan), np.insert(curve, pole, np.nan)
        ax.plot(*drawn, label=name, marker="o" if f.size == 1 else "", **curve_look(k))
        if scan is not None:
            _mark_resonances(ax, scan, name, of_frequency.of, f, curve, curve_look(k)["color"])
    if scan is not None:
        for mark, label, own in (("o", "with the tank", "frequency"), (":", "self-resonance", "state_self_resonance")):
            at = of_frequency.of(scan[own])
            if ((f[0] <= at) & (at <= f[-1])).any():
                ax.plot([], [], mark, color=GREY, label=label)
    if top > 0:
        ax.set_ylim(0.0, float(shown.of(top)))
    ax.set_xscale("log")
    if f.size > 1:
        ax.set_xlim(f[0], f[-1])
    style.logarithmic_ticks(ax.xaxis, math.log10(f[-1] / f[0]))
    style.faint_grid(ax)
    ax.set(xlabel=of_frequency.label("frequency"), ylabel=shown.label(_NAMES[quantity]))
    style.legend_beside(ax)
    return ax


def _chosen(sweep: xr.Dataset) -> list[int]:
    """All states, or of many those of least, middle and most inductance."""
    count = sweep.sizes["state"]
    if count <= _MOST_CURVES:
        return list(range(count))
    first = sweep["apparent_inductance"].transpose("frequency", "state").values[0]
    order = first.argsort(kind="stable")
    return sorted(int(order[k]) for k in (0, count // 2, count - 1))


@style.styled
def frequency_figure(sweep: xr.Dataset, scan: xr.Dataset) -> Figure:
    """Draw impedance quantities over frequency.

    These are apparent inductance, resistance and quality factor, with the resonances of every state.

    Parameters
    ----------
    sweep, scan : xarray.Dataset
        Results of `coilarray.circuit.impedance.sweep_design` and `coilarray.circuit.impedance.scan_design`.

    Examples
    --------
    >>> from coilarray import load_design
    >>> from coilarray.circuit.impedance import scan_design, sweep_design
    >>> design = load_design("gast_fem")
    >>> figure = frequency_figure(sweep_design(design, [1e5, 1e6]), scan_design(design, elastomer=False))
    >>> [ax.get_ylabel().split(" Im")[0] for ax in figure.axes]
    ['apparent inductance', 'effective resistance Re Z (Ω)', 'quality factor']
    """
    names = ("apparent_inductance", "impedance_real", "quality_factor")
    figure = style.new_figure(6.5, 3.2 * len(names))
    for k, name in enumerate(names):
        ax = figure.add_subplot(len(names), 1, k + 1)
        plot_frequency_sweep(sweep, name, ax, scan=scan)
        if k and (legend := ax.get_legend()) is not None:
            legend.remove()  # it repeats the first legend
        if name == "impedance_real":
            _logarithmic(ax, sweep[name].values)
    return figure


def _logarithmic(ax: Axes, values: npt.NDArray[np.float64]) -> None:
    """Use powers of ten if values span many."""
    positive = values[values > 0]
    if positive.size and positive.max() > _MANY * positive.min():
        ax.set_yscale("log")
        ax.set_ylim(positive.min() / _HEADROOM, positive.max() * _HEADROOM)
        style.logarithmic_ticks(ax.yaxis, math.log10(positive.max() / positive.min()))


def _mark_resonances(
    ax: Axes,
    scan: xr.Dataset,
    state: str,
    shown: Callable[[npt.ArrayLike], npt.NDArray[np.float64]],
    f: npt.NDArray[np.float64],
    curve: npt.NDArray[np.float64],
    colour: str,
) -> None:
    """Mark the resonances of a state, with frequencies in the unit shown."""
    of_state = scan.sel(state=state)
    tank, own = (float(shown(of_state[name])) for name in ("frequency", "state_self_resonance"))
    if f[0] <= tank <= f[-1]:
        ax.plot(tank, np.interp(tank, f, curve), "o", color=colour, markersize=5)
    if f[0] <= own <= f[-1]:
        ax.axvline(own, color=colour, linestyle=":", linewidth=0.9, zorder=0)


def _heat_map(
    numbers: np.ma.MaskedArray[tuple[int, int], np.dtype[np.float64]],
    texts: Sequence[Sequence[str]],
    names: Sequence[str],
    title: str,
    label: str,
    scale: Literal["sequential", "diverging"],
    ax: Axes | None,
) -> Axes:
    """Draw a matrix with names and a colour bar."""
    n = len(names)
    ax = ax or style.new_axes(min(2.2 + 0.62 * n, _LARGEST), min(1.4 + 0.55 * n, _LARGEST - 0.8))
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
    style.colour_bar(ax, image, label)
    if n > _MOST_NUMBERED:
        return ax
    size, cells = min(9.0, 60.0 / max(len(texts), 1)), image.to_rgba(numbers)
    linear = np.where(cells <= 0.04045, cells / 12.92, ((cells + 0.055) / 1.055) ** 2.4)  # sRGB
    luminance = linear[..., :3] @ (0.2126, 0.7152, 0.0722)
    for i, j in np.argwhere(~np.ma.getmaskarray(numbers)).tolist():
        colour = "black" if luminance[i, j] > _DARK else "white"
        ax.text(j, i, texts[i][j], ha="center", va="center", fontsize=size, color=colour)
    return ax
