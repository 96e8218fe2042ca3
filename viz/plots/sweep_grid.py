"""Figures of sweeps.

Sweeps over the frequency, and over entries of a design as lines, coupling with zeros, maps and dots.
"""

from __future__ import annotations

import math
import textwrap
from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from matplotlib.ticker import FixedLocator, MaxNLocator
from scipy.interpolate import PchipInterpolator

from coilarray.compute.display_units import PLAIN, true_minus
from coilarray.studies.sweep import RULES, UNREAD
from coilarray.viz.palette import BLUE, COILS, GREY, INK, SEQUENTIAL, UNKNOWN, VERMILLION, curve_look
from coilarray.viz.plots.style import (
    axis_unit,
    colour_bar,
    faint_grid,
    legend_beside,
    logarithmic_ticks,
    new_axes,
    new_figure,
    styled,
)

MOST_PANELS = 24
"""Largest number of panels in `sweep_figure`."""

_PANEL = (4.2, 3.0)  # inches
_LEGEND = 2.0  # inches
_COLUMNS = 3
_MOST_TICKS = 8  # largest number of values of an entry that a map writes at its cells
_MOST_INSIDE = 4  # largest number of pairs of coils whose legend has room beside their curves
_TEXT = 14  # characters of a text in one line beside a tick
_LONGEST = 24  # characters of the name of an axis in one line
_ONE_ZERO = 1e-9  # share of the range within which two zeros are equal, as a zero at a sample is found from both sides

_NAMES = {
    "apparent_inductance": "apparent inductance Im Z/ω",
    "impedance_real": "effective resistance Re Z",
    "impedance_imag": "reactance Im Z",
    "quality_factor": "quality factor Im Z/Re Z",
}
_POLES = ("apparent_inductance", "impedance_real", "impedance_imag")  # with a pole at the self-resonance
_RESONANCES = ("frequency_MHz[", "self_resonance_MHz[")
_MANY = 10.0  # largest over least value
_FAR_APART = 3.0  # largest over least value
_CEILING = 4.0  # height of the axis for a pole, over the value at the lowest frequency
_HEADROOM = 1.08
_MOST_CURVES = 9  # number of curves that can be distinguished if coils are alike
_RANGE = 0.35  # opacity of the range of all curves


@styled
def plot_frequency_sweep(
    sweep: xr.Dataset, quantity: str = "apparent_inductance", ax: Axes | None = None, *, scan: xr.Dataset | None = None
) -> Axes:
    """Draw a quantity over frequency, one curve per state.

    If there are many states, three of them and the range of all are drawn.

    Parameters
    ----------
    sweep : xarray.Dataset
        Result of `coilarray.circuit.impedance.sweep_design`.
    quantity : str
        Name of a variable: ``apparent_inductance``, ``impedance_real``, ``impedance_imag`` or ``quality_factor``.
    ax : Axes, optional
        Axes to draw into. They start at zero. For a quantity with a pole they end at four times its value at the lowest
        frequency.
    scan : xarray.Dataset, optional
        Result of `coilarray.circuit.impedance.scan_design` of the same states. A dot marks the resonance with the tank
        on each curve, and a dotted line the self-resonance.

    Returns
    -------
    matplotlib.axes.Axes
        The given axes, or new axes by default.

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
    shown = PLAIN if unit == "1" else axis_unit(top, unit)
    of_frequency = axis_unit(sweep.frequency)
    f = of_frequency.of(sweep.frequency)
    ax = ax or new_axes(6.5, 3.6)
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
    logarithmic_ticks(ax.xaxis, math.log10(f[-1] / f[0]))
    faint_grid(ax)
    ax.set(xlabel=of_frequency.label("frequency"), ylabel=shown.label(_NAMES[quantity]))
    legend_beside(ax)
    return ax


def _chosen(sweep: xr.Dataset) -> list[int]:
    """Choose the states that are drawn.

    Their indices are returned. These are all states. If there are many, they are the states with the least, the middle
    and the most inductance.
    """
    count = sweep.sizes["state"]
    if count <= _MOST_CURVES:
        return list(range(count))
    first = sweep["apparent_inductance"].transpose("frequency", "state").values[0]
    order = first.argsort(kind="stable")
    return sorted(int(order[k]) for k in (0, count // 2, count - 1))


@styled
def frequency_figure(sweep: xr.Dataset, scan: xr.Dataset) -> Figure:
    """Draw impedance quantities over frequency.

    These are apparent inductance, resistance and quality factor, with the resonances of every state.

    Parameters
    ----------
    sweep, scan : xarray.Dataset
        Results of `coilarray.circuit.impedance.sweep_design` and `coilarray.circuit.impedance.scan_design`.

    Returns
    -------
    matplotlib.figure.Figure
        The figure, which its method `savefig` writes to a file.

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
    figure = new_figure(6.5, 3.2 * len(names))
    for k, name in enumerate(names):
        ax = figure.add_subplot(len(names), 1, k + 1)
        plot_frequency_sweep(sweep, name, ax, scan=scan)
        if k and (legend := ax.get_legend()) is not None:
            legend.remove()  # it repeats the first legend
        if name == "impedance_real":
            _logarithmic(ax, sweep[name].values)
    return figure


def _logarithmic(ax: Axes, values: npt.NDArray[np.float64]) -> None:
    """Use powers of ten if values span many.

    The resistance near a self-resonance does so.
    """
    positive = values[values > 0]
    if positive.size and positive.max() > _MANY * positive.min():
        ax.set_yscale("log")
        ax.set_ylim(positive.min() / _HEADROOM, positive.max() * _HEADROOM)
        logarithmic_ticks(ax.yaxis, math.log10(positive.max() / positive.min()))


def _mark_resonances(
    ax: Axes,
    scan: xr.Dataset,
    state: str,
    shown: Callable[[npt.ArrayLike], npt.NDArray[np.float64]],
    f: npt.NDArray[np.float64],
    curve: npt.NDArray[np.float64],
    colour: str,
) -> None:
    """Mark the resonances of a state on its curve.

    Only resonances within the frequencies are marked. The frequencies are in the unit shown.
    """
    of_state = scan.sel(state=state)
    tank, own = (float(shown(of_state[name])) for name in ("frequency", "state_self_resonance"))
    if f[0] <= tank <= f[-1]:
        ax.plot(tank, np.interp(tank, f, curve), "o", color=colour, markersize=5)
    if f[0] <= own <= f[-1]:
        ax.axvline(own, color=colour, linestyle=":", linewidth=0.9, zorder=0)


@styled
def plot_coupling_sweep(sweep: xr.Dataset, ax: Axes | None = None) -> Axes:
    """Draw the coupling coefficients of pairs over an entry.

    The entry of the design may be the pitch. The zeros of the coefficients are marked.

    Parameters
    ----------
    sweep : xarray.Dataset
        Result of `coilarray.sweep` over one entry with numbers. All its ``k[coil,coil]`` are drawn.
    ax : Axes, optional
        Axes to draw into. Circles, and values in the legend, mark the `zero_crossings` where a pair does not couple. A
        dashed line is the design's own value.

    Returns
    -------
    matplotlib.axes.Axes
        The given axes, or new axes by default.

    Raises
    ------
    ValueError
        If the sweep is not over one entry with numbers, or has no k.

    Examples
    --------
    >>> import xarray as xr
    >>> pitch = ("array.pitch_mm", [12.0, 14.0, 16.0, 18.0], {"units": "mm"})
    >>> k = ("array.pitch_mm", [0.04, 0.01, -0.01, -0.02])
    >>> ax = plot_coupling_sweep(xr.Dataset({"k[coil1,coil2]": k}, {"array.pitch_mm": pitch}))
    >>> [text.get_text() for text in ax.get_legend().get_texts()]
    ['k[coil1,coil2] = 0 at 14.9 mm']
    """
    entries = _entries(sweep)
    pairs = [str(name) for name in sweep.data_vars if _is_coupling(str(name))]
    if "sample" in sweep.dims or len(entries) != 1 or _is_text(sweep[entries[0]]) or not pairs:
        raise ValueError(
            "a sweep of the coupling must be over one entry with numbers, and have k of a pair; this one is over "
            f"{', '.join(entries)} and has {', '.join(map(str, sweep.data_vars))}."
        )
    along = sweep.sortby(entries[0])
    x, unit = along[entries[0]].values.astype(np.float64), _unit(sweep[entries[0]])
    ax = ax or new_axes(6.5, 3.6)
    ax.axhline(0.0, color=GREY, linewidth=0.8)
    for place, name in enumerate(pairs):
        values = along[name].values
        zeros = zero_crossings(x, values)
        found = f" = 0 at {', '.join(f'{zero:#.3g}' for zero in zeros)} {unit}".rstrip() if zeros.size else ""
        look = curve_look(place)
        ax.plot(x, values, marker=".", markersize=4, label=f"{name}{true_minus(found)}", **look)
        ax.plot(zeros, np.zeros_like(zeros), "o", markersize=7, markerfacecolor="white", markeredgecolor=look["color"])
        _cross_out(ax, along, x, values)
    _finish(ax, sweep[entries[0]], "coupling coefficient k")
    if len(pairs) > _MOST_INSIDE:
        legend_beside(ax)
    else:
        ax.legend(loc="best")  # without it Matplotlib warns on a slow machine
    return ax


def zero_crossings(x: npt.ArrayLike, values: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """Find places where samples change their sign.

    The samples are at ascending x, and the places ascend too. Monotone cubics interpolate between the samples. Two
    samples of one sign have no zero between them, and no zero is looked for beside a NaN. A sample that is zero counts.

    Examples
    --------
    >>> zero_crossings([0.0, 1.0, 2.0, 3.0], [2.0, 1.0, -1.0, -2.0]).tolist()
    [1.5]
    """
    at, y = np.asarray(x, dtype=np.float64), np.asarray(values, dtype=np.float64)
    zeros: list[float] = []
    for run in np.split(np.arange(y.size), np.flatnonzero(np.diff(np.isfinite(y))) + 1):
        if run.size > 1 and np.isfinite(y[run[0]]):
            zeros += PchipInterpolator(at[run], y[run]).roots(extrapolate=False).tolist()
    found: list[float] = []
    for zero in zeros:
        # a stretch of zeros is given as NaN
        if math.isfinite(zero) and not (found and zero - found[-1] <= _ONE_ZERO * (at[-1] - at[0])):
            found.append(zero)
    return np.array(found)


@styled
def plot_sweep_points(sweep: xr.Dataset, quantity: str, entry: str, ax: Axes | None = None) -> Axes:
    """Draw a quantity of a sweep over an entry.

    There is a dot per point.

    Parameters
    ----------
    sweep : xarray.Dataset
        Result of `coilarray.sweep`, a grid or samples.
    quantity, entry : str
        Names of a variable and of a coordinate.
    ax : Axes, optional
        Axes to draw into. A dashed line is the design's own value.

    Returns
    -------
    matplotlib.axes.Axes
        The given axes, or new axes by default.

    Examples
    --------
    >>> import xarray as xr
    >>> sweep = xr.Dataset({"worst_k": ("sample", [0.1, 0.2])}, {"array.pitch_mm": ("sample", [14.0, 12.0])})
    >>> plot_sweep_points(sweep, "worst_k", "array.pitch_mm").lines[0].get_xdata().tolist()
    [14.0, 12.0]
    """
    ax = ax or new_axes(*_PANEL)
    at = sweep[entry].broadcast_like(sweep[quantity]).transpose(*sweep[quantity].dims)
    x, values = _numbers(sweep[entry], at.values.ravel()), sweep[quantity].values.ravel()
    ax.plot(x, values, ".", color=BLUE, markersize=4)
    _cross_out(ax, sweep.transpose(*sweep[quantity].dims), x, values)
    _finish(ax, sweep[entry], _label(sweep[quantity]))
    return ax


@styled
def plot_sweep_lines(sweep: xr.Dataset, quantity: str, ax: Axes | None = None) -> Axes:
    """Draw a quantity of a sweep as lines.

    It is drawn over an entry with numbers, with a line for each text of a second entry.

    Parameters
    ----------
    sweep, quantity
        As in `plot_sweep_points`, of a grid over one entry, or over two entries if one of them has texts. A point
        without a value is a gap.
    ax : Axes, optional
        Axes to draw into. A dashed line is the design's own value.

    Returns
    -------
    matplotlib.axes.Axes
        The given axes, or new axes by default.

    Raises
    ------
    ValueError
        If the sweep is over other entries.

    Examples
    --------
    >>> import xarray as xr
    >>> k = ("array.pitch_mm", [0.2, 0.1])
    >>> sweep = xr.Dataset({"worst_k": k}, {"array.pitch_mm": ("array.pitch_mm", [12.0, 14.0], {"units": "mm"})})
    >>> plot_sweep_lines(sweep, "worst_k").get_xlabel()
    'array.pitch_mm (mm)'
    """
    entries = _entries(sweep)
    along, apart = _line_entries(sweep, entries)
    if not along:
        raise ValueError(f"lines need one entry, or two of which one has texts; got {', '.join(entries)}.")
    ax = ax or new_axes(*_PANEL)
    x = _numbers(sweep[along], sweep[along].values)
    if not apart:
        ax.plot(x, sweep[quantity].values, "o-", color=BLUE, markersize=4)
        _cross_out(ax, sweep, x, sweep[quantity].values)
    else:
        for k, text in enumerate(sweep[apart].values.tolist()):
            one = sweep.isel({apart: k})
            ax.plot(x, one[quantity].values, marker="o", markersize=4, label=text, **curve_look(k))
            _cross_out(ax, one, x, one[quantity].values)
        ax.legend(title=apart, loc="best")  # as above
    _finish(ax, sweep[along], _label(sweep[quantity]))
    return ax


@styled
def plot_sweep_map(sweep: xr.Dataset, quantity: str, ax: Axes | None = None) -> Axes:
    """Draw a quantity over two entries as colours.

    Places without a result are grey.

    Parameters
    ----------
    sweep, quantity
        As in `plot_sweep_points`, of a grid over two entries.
    ax : Axes, optional
        Axes to draw into. A diamond marks the design's own values.

    Returns
    -------
    matplotlib.axes.Axes
        The given axes, or new axes by default.

    Raises
    ------
    ValueError
        If the sweep is over fewer or more entries.

    Examples
    --------
    >>> import xarray as xr
    >>> sweep = xr.Dataset({"worst_k": (("a", "b"), [[1.0, 2.0], [3.0, 4.0]])}, {"a": [0.0, 1.0], "b": [0.0, 1.0]})
    >>> plot_sweep_map(sweep, "worst_k").collections[0].get_array().tolist()  # a across, b up
    [[1.0, 3.0], [2.0, 4.0]]
    """
    entries = _entries(sweep)
    if "sample" in sweep.dims or len(entries) != 2:
        raise ValueError(f"a map needs a grid over two entries; got {', '.join(entries)}.")
    ax = ax or new_axes(*_PANEL)
    x, y = (_numbers(sweep[entry], sweep[entry].values) for entry in entries)
    values = np.ma.masked_invalid(sweep[quantity].transpose(*entries).values)[np.ix_(np.argsort(x), np.argsort(y))]
    across, up = np.meshgrid(x, y, indexing="ij")
    _cross_out(ax, sweep.transpose(*entries), across.ravel(), up.ravel())
    ax.set_facecolor(UNKNOWN)
    mesh = ax.pcolormesh(np.sort(x), np.sort(y), values.T, shading="nearest", cmap=SEQUENTIAL, rasterized=True)
    for axis, entry in zip((ax.xaxis, ax.yaxis), entries, strict=True):
        _name_axis(axis, sweep[entry])
        if not _is_text(sweep[entry]) and sweep.sizes[entry] <= _MOST_TICKS:
            axis.set_major_locator(FixedLocator(np.sort(_numbers(sweep[entry], sweep[entry].values)).tolist()))
    own = [value for entry in entries if (value := _own(sweep[entry])) is not None]
    if len(own) == len(entries):
        ax.plot(own[:1], own[1:], "D", color="white", markeredgecolor=VERMILLION, markersize=5)
    colour_bar(ax, mesh, _label(sweep[quantity]))
    return ax


@styled
def sweep_figure(result: xr.Dataset) -> Figure:
    """Draw the quantities of a sweep.

    Parameters
    ----------
    result : xarray.Dataset
        Result of `coilarray.sweep`.

    Returns
    -------
    Figure
        One panel per quantity, with a line for a grid over a single entry, and lines or a map for two entries. For a
        grid over more entries, and for samples, one panel for each quantity and entry, with a dot per point. Over one
        entry with numbers, coupling coefficients share a panel, drawn by `plot_coupling_sweep`. The resonances with the
        tank and the self-resonances share a panel too. A dashed line or a diamond marks the design's own value. Points
        without a result are left out, or grey on a map. Crosses mark points that break fabrication rules or that no
        converter reads.

    Raises
    ------
    ValueError
        If there is no quantity, or more than `MOST_PANELS` panels.

    Examples
    --------
    >>> import xarray as xr
    >>> sweep = xr.Dataset({"worst_k": ("array.pitch_mm", [0.2, 0.1])}, {"array.pitch_mm": [12.0, 14.0]})
    >>> [ax.get_ylabel() for ax in sweep_figure(sweep).axes]
    ['worst_k']
    """
    names = [str(name) for name in result.data_vars if name not in ("reason", RULES, UNREAD)] or [
        name for name in (RULES,) if name in result
    ]
    entries = _entries(result)
    dotted = "sample" in result.dims or len(entries) > 2
    single = not dotted and len(entries) == 1 and not _is_text(result[entries[0]])
    pairs = [name for name in names if single and _is_coupling(name)]
    resonances = [name for name in names if single and name.startswith(_RESONANCES)]
    others = [name for name in names if name not in (*pairs, *resonances)]
    panels = [(shared[0], "") for shared in (pairs, resonances) if shared]
    panels += [(name, entry) for name in others for entry in (entries if dotted else [""])]
    if not 1 <= len(panels) <= MOST_PANELS:
        raise ValueError(f"a figure of a sweep must have 1 to {MOST_PANELS} panels; it would have {len(panels)}.")
    columns = min(len(entries) if dotted else _COLUMNS, len(panels))
    rows = math.ceil(len(panels) / columns)
    beside = _LEGEND if len(pairs) > _MOST_INSIDE else 0.0
    figure = new_figure(_PANEL[0] * columns + beside, _PANEL[1] * rows)
    for k, (name, entry) in enumerate(panels):
        ax = figure.add_subplot(rows, columns, k + 1)
        if name in pairs:
            plot_coupling_sweep(result, ax)
        elif name in resonances:
            _plot_resonances(result, resonances, ax)
        elif dotted:
            plot_sweep_points(result, name, entry, ax)
        elif _line_entries(result, entries)[0]:
            plot_sweep_lines(result, name, ax)
        else:
            plot_sweep_map(result, name, ax)
    figure.supxlabel(
        "    ".join(_explained(result, entries, mapped=not dotted and len(entries) == 2)), fontsize="small"
    )
    return figure


def _explained(sweep: xr.Dataset, entries: Sequence[str], *, mapped: bool) -> list[str]:
    """Texts that explain the marks of a figure.

    For two entries without texts the marks are on a map if `mapped` is true.
    """
    own = [_own(sweep[entry]) is not None for entry in entries]
    mapped = mapped and not _line_entries(sweep, entries)[0]
    marks = ["×  breaks fabrication rules, or no converter reads it"] if _broken(sweep).any() else []
    if all(own) if mapped else any(own):
        marks.append(f"{'◇' if mapped else '- -'}  the design as it is")
    return marks


def _plot_resonances(sweep: xr.Dataset, names: Sequence[str], ax: Axes) -> None:
    """Draw resonances over the entry of a sweep.

    Each resonance has a line. If they are far apart, the axis has powers of ten.
    """
    (entry,) = _entries(sweep)
    along = sweep.sortby(entry)
    for k, name in enumerate(names):
        ax.plot(along[entry].values, along[name].values, marker=".", markersize=4, label=name, **curve_look(k))
        _cross_out(ax, along, along[entry].values, along[name].values)
    values = np.concatenate([along[name].values for name in names])
    if np.nanmax(values, initial=0.0) > _FAR_APART * np.nanmin(values, initial=np.inf):
        ax.set_yscale("log")
        logarithmic_ticks(ax.yaxis, float(np.log10(np.nanmax(values) / np.nanmin(values))))
    _finish(ax, sweep[entry], "resonance (MHz)")
    ax.legend(loc="best")  # as above


def _broken(sweep: xr.Dataset) -> npt.NDArray[np.bool_]:
    """Check which points break rules or cannot be read.

    The rules are fabrication rules, as far as the sweep records them.
    """
    marks = [sweep[name].values > 0 for name in (RULES, UNREAD) if name in sweep]
    return np.asarray(np.any(marks, axis=0)) if marks else np.zeros(1, dtype=bool)


def _cross_out(ax: Axes, sweep: xr.Dataset, x: npt.NDArray[np.float64], y: npt.NDArray[np.float64]) -> None:
    """Mark points that break fabrication rules.

    Their places are given in the order of the sweep.
    """
    broken = _broken(sweep).ravel()
    if broken.any():
        seen = [withStroke(linewidth=2.5, foreground="white")]  # on dark colours of a map too
        ax.plot(x.ravel()[broken], y.ravel()[broken], "x", color=INK, markersize=6, zorder=5, path_effects=seen)


def _entries(sweep: xr.Dataset) -> list[str]:
    return [str(name) for name in sweep.coords if name != "sample"]


def _is_coupling(name: str) -> bool:
    return name.startswith("k[")


def _line_entries(sweep: xr.Dataset, entries: Sequence[str]) -> tuple[str, str]:
    """Entry along lines and entry of the lines' texts.

    Each text has a line of its own. An entry that does not exist is empty.
    """
    if "sample" in sweep.dims:
        return "", ""
    if len(entries) == 1:
        return entries[0], ""
    texts = [entry for entry in entries if _is_text(sweep[entry]) and sweep.sizes[entry] <= len(COILS)]
    if len(entries) != 2 or not texts:
        return "", ""
    return next(entry for entry in entries if entry != texts[-1]), texts[-1]


def _numbers(coordinate: xr.DataArray, values: npt.NDArray[np.generic]) -> npt.NDArray[np.float64]:
    """Places of values on an axis.

    Texts are numbered in the order in which they first appear.
    """
    if not _is_text(coordinate):
        return values.astype(np.float64)
    texts = list(dict.fromkeys(coordinate.values.tolist()))
    return np.array([float(texts.index(value)) for value in values.tolist()])


def _finish(ax: Axes, entry: xr.DataArray, label: str) -> None:
    """Label the axes and mark the design's own value."""
    _name_axis(ax.xaxis, entry)
    own = _own(entry)
    if own is not None:
        ax.axvline(own, color=INK, linestyle="--", linewidth=0.9, zorder=0)
    faint_grid(ax)
    ax.set_ylabel(label)


def _name_axis(axis: Axis, coordinate: xr.DataArray) -> None:
    """Label an axis and set its ticks."""
    axis.set_label_text(_label(coordinate))
    if _is_text(coordinate):
        texts = list(dict.fromkeys(coordinate.values.tolist()))
        axis.set_ticks(range(len(texts)), [textwrap.fill(text, _TEXT) for text in texts])
    elif coordinate.dtype.kind in "iu":
        axis.set_major_locator(MaxNLocator(integer=True))


def _own(coordinate: xr.DataArray) -> float | None:
    """Read the design's own value of an entry.

    It is None for a text, and for a value outside the sweep.
    """
    own = coordinate.attrs.get("design_value")
    if _is_text(coordinate) or own is None:
        return None
    return float(own) if coordinate.min() <= own <= coordinate.max() else None


def _is_text(coordinate: xr.DataArray) -> bool:
    return coordinate.dtype.kind not in "iuf"


def _label(array: xr.DataArray) -> str:
    """Name and unit of an entry or quantity.

    Both have the prefix of the dataset.
    """
    name = str(array.name)
    if len(name) > _LONGEST:  # the options of a quantity on a line of their own
        name = name.replace("[", "\n[", 1)
    return f"{name} ({unit})" if (unit := _unit(array)) else name


def _unit(array: xr.DataArray) -> str:
    unit = str(array.attrs.get("units", "1"))
    return "" if unit == "1" else unit
