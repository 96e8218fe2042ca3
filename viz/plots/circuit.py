"""Figures of circuits and fields: L, k, currents, frequency, B."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Polygon, Rectangle

from coilarray.compute.display_units import MM, PLAIN, DisplayUnit, number_text
from coilarray.viz.palette import (
    GREY,
    INK,
    ON_DARK,
    ON_MAP,
    SEQUENTIAL,
    SHADE,
    UNKNOWN,
    curve_look,
    signed_colours,
)
from coilarray.viz.plots import style

_MOST_NUMBERED = 12  # coils whose matrix has room for its numbers
_MOST_NAMED = 32  # coils whose names all fit along the edges of a matrix
_LARGEST = 11.0  # inches
_NEAR = 2.3  # distances of the nearest neighbour within which k is written
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
_FLOOR = 1e-6  # of |S|, −120 dB
_RANGE = 0.35  # opacity of the range of all curves


@style.styled
def plot_coupling(coupling: xr.Dataset, ax: Axes | None = None) -> Axes:
    """Draw the matrix of the coupling coefficients k.

    For up to 12 coils the cells contain the numbers. Lines part the coils of different boards.
    `coupling` is the result of `coilarray.couple_design` or `coilarray.circuit.coupling.couple`.
    """
    matrix = coupling.coupling
    names = matrix.coil.values.tolist()
    numbers = np.ma.array(matrix.values, mask=np.eye(len(names), dtype=np.bool_))
    texts = [[number_text(number, 3) for number in row] for row in numbers.data.tolist()]
    values = numbers.compressed() if numbers.count() else [0.0, 1.0]  # a single coil has no neighbours
    colours, low, high = signed_colours(values)
    look = colours, Normalize(low, high)
    return _heat_map(numbers, texts, names, "Coupling coefficient k = M/√(L L)", "k", look, ax)


@style.styled
def plot_equivalent_circuit(values: Mapping[str, str], ax: Axes | None = None) -> Axes:
    """Draw the equivalent circuit of a coil between its two terminals.

    The `values` are texts with units, such as "93.1 µH ± 0.01 %", of the inductance ``"L"``, the
    resistance ``"R"`` in series, and of what lies across them: the ``"winding"`` capacitance, the
    ``"tank"`` capacitor or any other, in this order.
    """
    across = [name for name in values if name not in ("L", "R")]
    ax = ax or style.new_axes(5.2, 2.4)
    wire: dict[str, Any] = {"color": INK, "linewidth": 1.2}
    right = 0.8 + 2.4 * (len(across) + 1)
    ax.plot([right, 0, 0], [3, 3, 2.75], [0, 0, right], [0.35, 0, 0], [0, 0], [1.35, 1.2], **wire)
    ax.plot([right, right], [0, 3], "o", color=INK, markersize=5, markerfacecolor="white")
    turns = np.linspace(0, 3, 61)  # half circles
    ax.plot(0.2 * np.abs(np.sin(np.pi * turns)), 2.75 - 1.4 * turns / 3, **wire)
    ax.add_patch(Rectangle((-0.15, 0.35), 0.3, 0.85, facecolor="none", edgecolor=INK, linewidth=1.2))
    for name, y in (("L", 2.05), ("R", 0.78)):
        ax.text(0.4, y, f"${name}$  {values.get(name, '')}", va="center")
    for x, name in zip(3.2 + 2.4 * np.arange(len(across)), across, strict=True):
        ax.plot(
            [x, x], [0, 1.42], [x, x], [1.58, 3], [x - 0.3, x + 0.3], [1.42] * 2, [x - 0.3, x + 0.3], [1.58] * 2, **wire
        )
        ax.text(x + 0.4, 1.5, f"{name}\n{values[name]}", va="center")
    ax.set(xlim=(-0.3, right + 0.5), ylim=(-0.2, 3.2))
    ax.set_axis_off()
    return ax


@style.styled
def plot_neighbours(
    coupling: xr.Dataset, outlines: Mapping[str, npt.ArrayLike], coil: str, ax: Axes | None = None
) -> Axes:
    """Draw the coupling of one coil with all others on the board.

    Each other coil has the colour of its k, and the nearest have the number in it. The `coupling`
    is as in `plot_coupling`, `outlines` are corners (m, 2) of each coil by name, in m on the board,
    and `coil` is the name of the coil that couples with the others. Raises ValueError if there is
    no such coil.
    """
    names = coupling.coil.values.tolist()
    if coil not in names:
        raise ValueError(f"coil must be one of {', '.join(names)}; got {coil!r}.")
    shapes = {name: MM.of(outlines[name]) for name in names}
    k = dict(zip(names, coupling.coupling.sel(coil=coil).values.tolist(), strict=True))
    others = [name for name in names if name != coil]
    colours, low, high = signed_colours([k[name] for name in others])
    corners = np.vstack(list(shapes.values()))
    ax = ax or style.new_axes(*style.figure_size(*np.ptp(corners, axis=0).tolist()))
    shade = ScalarMappable(Normalize(low, high), colours)
    middle = {name: (shape.min(axis=0) + shape.max(axis=0)) / 2 for name, shape in shapes.items()}
    distance = {name: math.dist(middle[name], middle[coil]) for name in others}
    nearest = min(distance.values())
    for name in names:
        fill = UNKNOWN if name == coil else shade.to_rgba(np.array(k[name]))
        ax.add_patch(Polygon(shapes[name], closed=True, facecolor=fill, edgecolor=ON_MAP, linewidth=0.8))
        if name == coil or distance[name] < _NEAR * nearest:
            text = coil if name == coil else number_text(k[name], 4, "+")
            x, y = middle[name].tolist()
            style.write_name(ax, x, y, text, fontsize=8)
    (x_min, y_min), (x_max, y_max) = corners.min(axis=0).tolist(), corners.max(axis=0).tolist()
    rim = 0.02 * (x_max - x_min + y_max - y_min)
    ax.set(xlim=(x_min - rim, x_max + rim), ylim=(y_min - rim, y_max + rim))
    style.plan_axes(ax)
    style.colour_bar(ax, shade, f"k with {coil}")
    style.CELLS[ax] = [[*middle[name].tolist(), f"{name}: k = {number_text(k[name], 4, '+')}"] for name in others]
    return ax


@style.styled
def plot_currents(coupling: xr.Dataset, ax: Axes | None = None) -> Axes:
    """Draw the currents that an active coil induces.

    Each column has the currents per ampere in an active coil. The magnitude in the other coils is a
    colour, with the phase written below. `coupling` is as in `plot_coupling`.
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
    norm = Normalize(*((numbers.min(), numbers.max()) if numbers.count() else (0.0, 1.0)))
    ax = _heat_map(numbers, texts, names, "Currents in the passive coils", label, (SEQUENTIAL, norm), ax)
    ax.set(xlabel="active coil", ylabel="passive coil")
    return ax


@style.styled
def plot_frequency_sweep(
    sweep: xr.Dataset, quantity: str = "apparent_inductance", ax: Axes | None = None, *, scan: xr.Dataset | None = None
) -> Axes:
    """Draw a quantity over frequency, one curve per state.

    The `sweep` is a result of `coilarray.circuit.coupling.sweep_design`, and the `quantity` its
    variable ``apparent_inductance``, ``impedance_real``, ``impedance_imag`` or ``quality_factor``.
    If there are many states, three of them and the range of all are drawn. A quantity with a pole
    is drawn up to four times its value at the lowest frequency. With a `scan`, the result of
    `coilarray.circuit.coupling.scan_design` of the same states, a dot marks the resonance with the
    tank on each curve, and a dotted line the self-resonance. Raises ValueError if the sweep has no
    such quantity.
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
    names, resonances = sweep.state.values.tolist(), ("frequency", "state_self_resonance")
    chosen = list(range(len(names)))
    if len(names) > _MOST_CURVES:  # those of least, middle and most inductance
        order = sweep["apparent_inductance"].isel(frequency=0).values.argsort(kind="stable")
        chosen = sorted(int(order[k]) for k in (0, len(names) // 2, len(names) - 1))
        within = (values > 0).all(axis=1)  # no range beyond a pole of some states
        low, high = (shown.of(edge) for edge in (values.min(axis=1), values.max(axis=1)))
        ax.fill_between(f, low, high, where=within, color=GREY, alpha=_RANGE, lw=0, label=f"all {len(names)} states")
    for k in chosen:
        name, curve = names[k], shown.of(values[:, k])
        # Losses turn a pole of the inductance into a steep fall, and a sample on it may lie within
        # the axis.
        falls = (np.diff(values[:, k]) < 0) & ((values[:-1, k] > top) | (np.diff(np.sign(values[:, k])) < 0))
        pole = np.flatnonzero(falls & (quantity == "apparent_inductance")) + 1
        drawn = np.insert(f, pole, np.nan), np.insert(curve, pole, np.nan)
        ax.plot(*drawn, label=name, marker="o" if f.size == 1 else "", **curve_look(k))
        if scan is not None:
            colour = curve_look(k)["color"]
            tank, own = (float(of_frequency.of(scan[one].sel(state=name))) for one in resonances)
            if f[0] <= tank <= f[-1]:
                ax.plot(tank, np.interp(tank, f, curve), "o", color=colour, markersize=5)
            if f[0] <= own <= f[-1]:
                ax.axvline(own, color=colour, linestyle=":", linewidth=0.9, zorder=0)
    if scan is not None:
        for one, mark, label in zip(resonances, "o:", ("with the tank", "self-resonance"), strict=True):
            at = of_frequency.of(scan[one])
            if ((f[0] <= at) & (at <= f[-1])).any():
                ax.plot([], [], mark, color=GREY, label=label)
    if top > 0:
        ax.set_ylim(0.0, float(shown.of(top)))
    ax.set_xscale("log")
    if f.size > 1:
        ax.set_xlim(f[0], f[-1])
    style.logarithmic_ticks(ax.xaxis, math.log10(f[-1] / f[0]))
    style.finish_curves(ax, of_frequency.label("frequency"), shown.label(_NAMES[quantity]))
    return ax


@style.styled
def frequency_figure(sweep: xr.Dataset, scan: xr.Dataset) -> Figure:
    """Draw impedance quantities over frequency.

    These are apparent inductance, resistance and quality factor, with the resonances of every
    state. `sweep` and `scan` are results of `coilarray.sweep_design` and
    `coilarray.scan_design`.
    """
    names = ("apparent_inductance", "impedance_real", "quality_factor")
    figure = style.new_figure(6.5, 3.2 * len(names))
    for k, name in enumerate(names):
        ax = figure.add_subplot(len(names), 1, k + 1)
        plot_frequency_sweep(sweep, name, ax, scan=scan)
        if k and (legend := ax.get_legend()) is not None:
            legend.remove()  # it repeats the first legend
        positive = sweep[name].values[sweep[name].values > 0]
        if name == "impedance_real" and positive.size and positive.max() > _MANY * positive.min():
            ax.set_yscale("log")
            ax.set_ylim(positive.min() / _HEADROOM, positive.max() * _HEADROOM)
            style.logarithmic_ticks(ax.yaxis, math.log10(positive.max() / positive.min()))
    return figure


@style.styled
def ports_figure(solved: xr.Dataset) -> Figure:
    """Draw S-parameters over frequency, and the efficiencies below.

    The magnitude of S, for the resistances of sources and loads, is drawn once of every pair.
    Dotted lines are the resonances, the grey line is the frequency of the link. `solved` is the
    result of `coilarray.circuit.ports.solve_ports`.
    """
    of_frequency = style.axis_unit(solved.frequency)
    f, names = of_frequency.of(solved.frequency), solved.port.values.tolist()
    linked = "efficiency" in solved
    figure = style.new_figure(6.5, 3.2 * (1 + linked))
    axes = [figure.add_subplot(1 + linked, 1, k + 1) for k in range(1 + linked)]
    magnitude = np.hypot(solved.s_real, solved.s_imag).values
    for k, (i, j) in enumerate(zip(*np.triu_indices(len(names)), strict=True)):
        shown = 20 * np.log10(np.maximum(magnitude[:, j, i], _FLOOR))
        label = names[i] if i == j else f"{names[i]} to {names[j]}"
        axes[0].plot(f, shown, label=label, marker="o" if f.size == 1 else "", **curve_look(k))
    if linked:
        links = [(a, b) for a in solved["source"].values for b in solved["load"].values]
        for k, (a, b) in enumerate(links):
            for name, line, words in (("efficiency", "-", ""), ("best_efficiency", "--", ", at most")):
                values = 100 * solved[name].sel(source=a, load=b).values
                look = curve_look(k) | {"linestyle": line}
                axes[1].plot(f, values, label=f"{a} to {b}{words}", marker="o" if f.size == 1 else "", **look)
        axes[1].set_ylim(0.0, 100.0)
    for ax, label in zip(axes, ("|S| (dB)", "efficiency (%)"), strict=False):
        for mode in of_frequency.of(solved.mode_frequency):
            if f[0] <= mode <= f[-1]:
                ax.axvline(mode, color=GREY, linestyle=":", linewidth=0.9, zorder=0)
        ax.axvline(float(of_frequency.of(solved.attrs["link_frequency_Hz"])), color=GREY, linewidth=0.9, zorder=0)
        style.finish_curves(ax, of_frequency.label("frequency"), label)
    return figure


def _heat_map(
    numbers: np.ma.MaskedArray[tuple[int, int], np.dtype[np.float64]],
    texts: Sequence[Sequence[str]],
    names: Sequence[str],
    title: str,
    label: str,
    colours: tuple[str, Normalize],
    ax: Axes | None,
) -> Axes:
    n = len(names)
    ax = ax or style.new_axes(min(2.2 + 0.62 * n, _LARGEST), min(1.4 + 0.55 * n, _LARGEST - 0.8))
    image = ax.imshow(numbers, cmap=colours[0], norm=colours[1])
    ax.set_facecolor(UNKNOWN)
    named = range(0, n, math.ceil(n / _MOST_NAMED))
    look: dict[str, Any] = {"fontsize": 9.0 if n <= _MOST_NUMBERED else 7.0}
    ax.set_xticks(named, [names[k] for k in named], rotation=0 if n <= _MOST_NUMBERED else 90, **look)
    ax.set_yticks(named, [names[k] for k in named], **look)
    ax.tick_params(length=0)
    ax.spines[:].set_visible(False)
    ax.set_title(title)
    style.colour_bar(ax, image, label)
    style.CELLS[ax] = [
        [j, i, f"{names[i]}, {names[j]}: {' at '.join(texts[i][j].split(chr(10)))}"]
        for i, j in np.argwhere(~np.ma.getmaskarray(numbers)).tolist()
    ]
    boards = [name.rpartition("/")[0] for name in names]
    for k in range(1, n):  # between blocks of coils of one board
        if boards[k] != boards[k - 1]:
            ax.axhline(k - 0.5, color=INK, linewidth=1.2)
            ax.axvline(k - 0.5, color=INK, linewidth=1.2)
    if n > _MOST_NUMBERED:
        return ax
    size, cells = min(9.0, 60.0 / n), image.to_rgba(numbers)
    linear = np.where(cells <= 0.04045, cells / 12.92, ((cells + 0.055) / 1.055) ** 2.4)  # sRGB
    luminance = linear[..., :3] @ (0.2126, 0.7152, 0.0722)
    for i, j in np.argwhere(~np.ma.getmaskarray(numbers)).tolist():
        colour = ON_MAP if luminance[i, j] > _DARK else ON_DARK
        ax.text(j, i, texts[i][j], ha="center", va="center", fontsize=size, color=colour)
    return ax


@style.styled
def plot_field_lines(
    fields: Mapping[str, xr.Dataset], ax: Axes | None = None, *, coil: tuple[float, float] | None = None
) -> Axes:
    """Draw B_z along x.

    Each of the `fields`, results of `coilarray.operating_field` along x with one y and one z by
    their texts in the legend, has a bell-shaped curve, as in Fig. 2 of Gast & Zimmermann (2020).
    The `coil` is shaded between its ends along x in m, if given. Raises ValueError if there is no
    field, or a field is not along x.
    """
    if not fields:
        raise ValueError("fields must hold one or more; got none.")
    for label, field in fields.items():
        if field.sizes["y"] != 1 or field.sizes["z"] != 1:
            raise ValueError(f"a field must be of a line along x, one y and one z; {label} has {dict(field.sizes)}.")
    curves = {label: _vertical(field)[:, 0, 0] for label, field in fields.items()}
    first = next(iter(fields.values()))
    shown = style.axis_unit(np.concatenate(list(curves.values())), str(first.B.attrs["units"]))
    ax = ax or style.new_axes(6.5, 3.6)
    if coil is not None:
        ax.axvspan(*MM.of(coil), color=SHADE, zorder=0, label="coil")
    ax.axhline(0.0, color=GREY, linewidth=0.8)
    for k, (label, values) in enumerate(curves.items()):
        ax.plot(MM.of(fields[label].x), shown.of(values), label=label, **curve_look(k))
    ax.set_xlim(MM.of(first.x).min(), MM.of(first.x).max())
    ax.set(xlabel=MM.label("x"), ylabel=_label(shown), title=f"$B_z$ of {first.attrs['active_coil']}, {_place(first)}")
    style.legend_beside(ax)  # on the shaded coil its own patch would be invisible
    return ax


@style.styled
def plot_field_map(field: xr.Dataset, ax: Axes | None = None, outlines: Sequence[npt.ArrayLike] = ()) -> Axes:
    """Draw B_z on a horizontal plane.

    `field` is the result of `coilarray.operating_field` with one z. The colours are symmetric about
    zero. The `outlines` of the coils are as in `coilarray.viz.plot_response`. Raises ValueError if
    the field is not on a plane.
    """
    if field.sizes["z"] != 1 or min(field.sizes["x"], field.sizes["y"]) < 2:
        raise ValueError(f"a field must be of a plane, two x and y or more and one z; it has {dict(field.sizes)}.")
    values = _vertical(field)[:, :, 0].T
    shown = style.axis_unit(values, str(field.B.attrs["units"]))
    ax = ax or style.new_axes(*style.map_size(field))
    mesh = style.signed_map(ax, field, shown.of(values), outlines, rasterized=True)
    others = "" if field.attrs["other_coils"] == "none" else f"; others {field.attrs['other_coils']}"
    ax.set_title(f"$B_z$ of {field.attrs['active_coil']}, {_place(field)}{others}")
    style.colour_bar(ax, mesh, _label(shown))
    return ax


def _vertical(field: xr.Dataset) -> npt.NDArray[np.float64]:
    """B_z in phase per ampere of the active coil, shape (nx, ny, nz)."""
    values: npt.NDArray[np.float64] = field.B.sel(component="z").transpose("x", "y", "z").values
    return values / float(field.attrs["active_current_A"])


def _label(shown: DisplayUnit) -> str:
    return f"$B_z$ ({shown.symbol} per A)"


def _place(field: xr.Dataset) -> str:
    return f"{MM.text(field.z[0])} above the board"
