"""The indentation's numbers as tables: force and dent over depth, and the response of every state."""

from __future__ import annotations

import numpy as np
import xarray as xr

from coilarray.report.tables import Column, Table, Value

_NO_RING = 1e-6  # of the depth: a rise below it is rounding


def indentation_table(indentation: xr.Dataset) -> Table:
    """One row a depth: force, contact, and how far every sheet and the ring around the dent move.

    Parameters
    ----------
    indentation : xarray.Dataset
        As `coilarray.elastomer.contact.indent` returns it.

    Returns
    -------
    Table
        Depth, contact radius (half width in plane strain), u_z on the axis of the upper face of every sheet, height
        and radius of the ring in m; force in N, in plane strain in N/m. A free surface that rises nowhere leaves the
        ring empty.
    """
    plane = indentation.attrs["symmetry"] == "plane"
    sheets = indentation.interface.values.tolist()[1:]
    columns = (
        Column("depth_m", "depth (mm)", 1e3, 3),
        Column("force_N_per_m", "force (N/m)", 1, 3) if plane else Column("force_N", "force (mN)", 1e3, 2),
        Column("contact_radius_m", "half width of contact (mm)" if plane else "contact radius (mm)", 1e3, 3),
        *(Column(f"{sheet}_displacement_m", f"u_z of {sheet} (mm)", 1e3, 4) for sheet in sheets),
        Column("ring_height_m", "ring (µm)", 1e6, 1),
        Column("ring_radius_m", "ring at x (mm)" if plane else "ring at r (mm)", 1e3, 2),
    )
    rows: list[tuple[Value, ...]] = []
    for k, depth in enumerate(indentation.depth.values.tolist()):
        at = indentation.isel(depth=k)
        on_axis = at.displacement_z.isel(r=0).values.tolist()[1:]
        rows.append((depth, float(at.force), float(at.contact_radius), *on_axis, *_ring(at)))
    return Table("indentation", "Indentation", columns, tuple(rows))


def response_table(response: xr.Dataset) -> Table:
    """One row for each depth and state: the largest δ of the map and where it is, and the lowest δ.

    Parameters
    ----------
    response : xarray.Dataset
        As `coilarray.response.map.response_map` returns it.

    Returns
    -------
    Table
        δ as pure numbers; depth and position in m, from the map's origin.
    """
    columns = (
        Column("depth_m", "depth (mm)", 1e3, 3),
        Column("state", "state"),
        Column("peak_delta", "peak δ (10⁻⁶)", 1e6, 2),
        Column("peak_x_m", "at x (mm)", 1e3, 2),
        Column("peak_y_m", "at y (mm)", 1e3, 2),
        Column("lowest_delta", "lowest δ (10⁻⁶)", 1e6, 2),
    )
    rows: list[tuple[Value, ...]] = []
    for k, depth in enumerate(response.depth.values.tolist()):
        for j, state in enumerate(response.state.values.tolist()):
            delta = response.delta.isel(depth=k, state=j).transpose("y", "x")
            row, column = np.unravel_index(int(delta.values.argmax()), delta.shape)
            x, y = float(delta.x[column]), float(delta.y[row])
            rows.append((depth, state, float(delta[row, column]), x, y, float(delta.min())))
    return Table("response", "Response", columns, tuple(rows))


def _ring(at: xr.Dataset) -> tuple[Value, Value]:
    """Height of the free surface where it rises highest, and the radius there; empty where it does not rise."""
    top = at.isel(interface=-1)
    r, rise = (top.r + top.displacement_r).values, top.displacement_z.values
    highest = int(rise.argmax())
    if rise[highest] <= _NO_RING * float(at.depth):
        return "", ""
    if highest == r.size - 1:  # the edge of a finite sample
        return float(rise[highest]), float(r[highest])
    # the vertex of the parabola through the highest node and those beside it
    near = slice(highest - 1, highest + 2)
    a, b, c = np.polyfit(r[near] - r[highest], rise[near], 2).tolist()
    return c - b**2 / (4 * a), float(r[highest]) - b / (2 * a)
