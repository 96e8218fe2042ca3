"""Figures of B_z along a line and on a plane."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt
import xarray as xr
from matplotlib.axes import Axes

from coilarray.compute.display_units import MM, DisplayUnit
from coilarray.viz.palette import GREY, SHADE, curve_look
from coilarray.viz.plots.style import axis_unit, colour_bar, legend_beside, map_size, new_axes, signed_map, styled


@styled
def plot_field_lines(
    fields: Mapping[str, xr.Dataset], ax: Axes | None = None, *, coil: tuple[float, float] | None = None
) -> Axes:
    """Draw B_z along x.

    Each field has a bell-shaped curve, as in Fig. 2 of Gast & Zimmermann (2020). Raises ValueError
    if there is no field, or a field is not along x.

    Parameters
    ----------
    fields : mapping of str to xarray.Dataset
        Results of `coilarray.operating_field` along x, with one y and one z, by their texts in the
        legend.
    coil : tuple of float, optional
        Ends of the coil along x in m. The coil is shaded.
    """
    if not fields:
        raise ValueError("fields must hold one or more; got none.")
    for label, field in fields.items():
        if field.sizes["y"] != 1 or field.sizes["z"] != 1:
            raise ValueError(f"a field must be of a line along x, one y and one z; {label} has {dict(field.sizes)}.")
    curves = {label: _vertical(field)[:, 0, 0] for label, field in fields.items()}
    first = next(iter(fields.values()))
    shown = axis_unit(np.concatenate(list(curves.values())), str(first.B.attrs["units"]))
    ax = ax or new_axes(6.5, 3.6)
    if coil is not None:
        ax.axvspan(*MM.of(coil), color=SHADE, zorder=0, label="coil")
    ax.axhline(0.0, color=GREY, linewidth=0.8)
    for k, (label, values) in enumerate(curves.items()):
        ax.plot(MM.of(fields[label].x), shown.of(values), label=label, **curve_look(k))
    ax.set_xlim(MM.of(first.x).min(), MM.of(first.x).max())
    ax.set(xlabel=MM.label("x"), ylabel=_label(shown), title=f"$B_z$ of {first.attrs['active_coil']}, {_place(first)}")
    legend_beside(ax)  # on the shaded coil its own patch would be invisible
    return ax


@styled
def plot_field_map(field: xr.Dataset, ax: Axes | None = None, outlines: Sequence[npt.ArrayLike] = ()) -> Axes:
    """Draw B_z on a horizontal plane.

    The outlines of the coils are drawn too.

    The colours are symmetric about zero. Raises ValueError if the field is not on a plane.

    Parameters
    ----------
    field : xarray.Dataset
        Result of `coilarray.operating_field` with one z.
    outlines : sequence of array_like
        As in `coilarray.viz.plot_response`.
    """
    if field.sizes["z"] != 1 or min(field.sizes["x"], field.sizes["y"]) < 2:
        raise ValueError(f"a field must be of a plane, two x and y or more and one z; it has {dict(field.sizes)}.")
    values = _vertical(field)[:, :, 0].T
    shown = axis_unit(values, str(field.B.attrs["units"]))
    ax = ax or new_axes(*map_size(field))
    mesh = signed_map(ax, field, shown.of(values), outlines, rasterized=True)
    others = "" if field.attrs["other_coils"] == "none" else f"; others {field.attrs['other_coils']}"
    ax.set_title(f"$B_z$ of {field.attrs['active_coil']}, {_place(field)}{others}")
    colour_bar(ax, mesh, _label(shown))
    return ax


def _vertical(field: xr.Dataset) -> npt.NDArray[np.float64]:
    """B_z in phase per ampere of the active coil, shape (nx, ny, nz)."""
    values: npt.NDArray[np.float64] = field.B.sel(component="z").transpose("x", "y", "z").values
    return values / float(field.attrs["active_current_A"])


def _label(shown: DisplayUnit) -> str:
    return f"$B_z$ ({shown.symbol} per A)"


def _place(field: xr.Dataset) -> str:
    return f"{MM.text(field.z[0])} above the board"
