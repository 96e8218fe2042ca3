"""Figures of B_z: along a line across a coil, and on a plane above the board."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes

from coilarray.viz.palette import DIVERGING, GREY, SHADE, curve_look
from coilarray.viz.plots.axis_units import MM, AxisUnit, axis_unit
from coilarray.viz.plots.style import colour_bar, figure_size, finish_map, largest, new_axes, styled

if TYPE_CHECKING:
    import xarray as xr

FloatArray = npt.NDArray[np.float64]


@styled
def plot_field_lines(
    fields: Mapping[str, xr.Dataset], ax: Axes | None = None, *, coil: tuple[float, float] | None = None
) -> Axes:
    """Draw B_z along x as bell-shaped curves, one a field, like Fig. 2 of Gast & Zimmermann (2020).

    Parameters
    ----------
    fields : mapping of str to xarray.Dataset
        As `coilarray.operating_field` returns them, of one current and one y and z, by the text that the legend shows.
    ax : Axes, optional
        Where to draw; mm across.
    coil : tuple of float, optional
        Where the coil begins and ends, in m; shaded.

    Raises
    ------
    ValueError
        No field, or one that is not of a line along x.

    Examples
    --------
    >>> from coilarray import couple_design, load_design, operating_field
    >>> design = load_design("gast_fem")
    >>> coupling, name = couple_design(design), design.array.names[0]
    >>> line = operating_field(design, coupling, name, [-20e-3, 0.0, 20e-3], 0.0, 1e-3)
    >>> plot_field_lines({"1 mm high": line}).get_ylabel()
    '$B_z$ (mT per A)'
    """
    if not fields:
        raise ValueError("fields must hold one or more; got none.")
    for label, field in fields.items():
        if field.sizes["y"] != 1 or field.sizes["z"] != 1:
            raise ValueError(f"a field must be of a line along x, one y and one z; {label} has {dict(field.sizes)}.")
    curves = {label: _vertical(field)[:, 0, 0] for label, field in fields.items()}
    shown = axis_unit(np.concatenate(list(curves.values())), "T")
    ax = ax or new_axes(6.5, 3.6)
    if coil is not None:
        ax.axvspan(*MM.of(coil), color=SHADE, zorder=0, label="coil")
    ax.axhline(0.0, color=GREY, linewidth=0.8)
    first = next(iter(fields.values()))
    for k, (label, values) in enumerate(curves.items()):
        ax.plot(MM.of(fields[label].x), shown.of(values), label=label, **curve_look(k))
    ax.set_xlim(MM.of(first.x).min(), MM.of(first.x).max())
    ax.set_xlabel(MM.label("x"))
    ax.set_ylabel(_label(first, shown))
    ax.set_title(f"$B_z$ of {first.attrs['active_coil']}, {_place(first)}")
    ax.legend(loc="best")  # said, or it warns of a machine that is slow
    return ax


@styled
def plot_field_map(field: xr.Dataset, ax: Axes | None = None, outlines: Sequence[npt.ArrayLike] = ()) -> Axes:
    """Draw B_z on a horizontal plane, with the outlines of the coils.

    Parameters
    ----------
    field : xarray.Dataset
        As `coilarray.operating_field` returns it, of one z.
    ax : Axes, optional
        Where to draw; in mm, colours symmetric about zero.
    outlines : sequence of array_like, each of shape (m, 2)
        Corners of the coils in m, first point not repeated.

    Raises
    ------
    ValueError
        A field that is not of a plane.

    Examples
    --------
    >>> from coilarray import couple_design, load_design, operating_field
    >>> design = load_design("gast_fem")
    >>> coupling, name = couple_design(design), design.array.names[0]
    >>> plane = operating_field(design, coupling, name, [-5e-3, 0.0, 5e-3], [0.0, 5e-3], 1e-3)
    >>> plot_field_map(plane).child_axes[0].get_ylabel()
    '$B_z$ (mT per A)'
    """
    if field.sizes["z"] != 1 or min(field.sizes["x"], field.sizes["y"]) < 2:
        raise ValueError(f"a field must be of a plane, two x and y or more and one z; it has {dict(field.sizes)}.")
    values = _vertical(field)[:, :, 0].T
    shown = axis_unit(values, "T")
    x, y = MM.of(field.x), MM.of(field.y)
    ax = ax or new_axes(*figure_size(np.ptp(x), np.ptp(y)))
    limit = largest(shown.of(values))
    mesh = ax.pcolormesh(
        x, y, shown.of(values), cmap=DIVERGING, vmin=-limit, vmax=limit, shading="nearest", rasterized=True
    )
    finish_map(ax, outlines)
    ax.set_title(f"$B_z$ of {field.attrs['active_coil']}, {_place(field)}; others {field.attrs['other_coils']}")
    colour_bar(ax, mesh, _label(field, shown))
    return ax


def _vertical(field: xr.Dataset) -> FloatArray:
    """B_z in phase with the current, shape (nx, ny, nz), per ampere of the active coil."""
    values: FloatArray = field.B.sel(component="z").transpose("x", "y", "z").values
    return values / float(field.attrs["active_current_A"])


def _label(field: xr.Dataset, shown: AxisUnit) -> str:
    return f"$B_z$ ({shown.symbol} per A)"


def _place(field: xr.Dataset) -> str:
    return f"{MM.factor * float(field.z[0]):g} mm above the board"
