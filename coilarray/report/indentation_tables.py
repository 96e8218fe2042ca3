"""The indentation's numbers as tables: force and dent over depth, and the response of every state."""

from __future__ import annotations

import numpy as np
import xarray as xr

from coilarray.circuit.readability import readable_of
from coilarray.compute.display_units import PER_MILLION, DisplayUnit
from coilarray.report.tables import Column, Table, Value, dataset_table
from coilarray.response.answering import NO_ANSWER

_NO_RING = 1e-6  # of the depth: a rise below it is rounding


def indentation_table(indentation: xr.Dataset) -> Table:
    """Return one row for each depth: force, contact, and how far every sheet and the ring around the dent move.

    Depth, contact radius (half width in plane strain), u_z on the axis of the upper face of every sheet, height and
    radius of the ring in m; force in N, in plane strain in N/m. A free surface that rises nowhere leaves the ring
    empty.
    """
    on_axis = indentation.displacement_z.isel(r=0, drop=True)
    columns = {
        f"{sheet}_displacement": on_axis.sel(interface=sheet, drop=True).assign_attrs(long_name=f"u_z of {sheet}")
        for sheet in indentation.interface.values.tolist()[1:]
    }
    rings = [_ring(indentation.isel(depth=k)) for k in range(indentation.sizes["depth"])]
    for k, (name, text) in enumerate((("ring_height", "height of the ring"), ("ring_radius", "radius of the ring"))):
        columns[name] = xr.DataArray([ring[k] for ring in rings], dims="depth", attrs={"long_name": text, "units": "m"})
    names = ("depth", "force", "contact_radius", *columns)
    shown = {"ring_height": DisplayUnit("µm", 1e6, 1)}
    return dataset_table("indentation", "Indentation", indentation.assign(columns), names, shown)


def response_table(response: xr.Dataset) -> Table:
    """Return one row for each depth and state: the largest δ of the map and where it is, and the lowest δ.

    Positions count from where those of the response do. A largest δ at the edge of the map, beyond which it may be
    larger, and one of zero are remarked; the latter has no place. Positions that the converter cannot read are left
    out, and remarked. Where the indenter has a material, its share of the
    largest δ stands beside it.
    """
    columns = (
        Column("depth", unit="m"),
        Column("state"),
        Column("peak_delta", "largest δ", "1", PER_MILLION),
        Column("peak_x", "at x", "m"),
        Column("peak_y", "at y", "m"),
        Column("metal_delta", "of it by metal", "1", PER_MILLION),
        Column("lowest_delta", "lowest δ", "1", PER_MILLION),
        Column("remark"),
    )
    rows: list[tuple[Value, ...]] = []
    read = readable_of(response)
    for k, depth in enumerate(response.depth.values.tolist()):
        for j, state in enumerate(response.state.values.tolist()):
            delta = response.delta.isel(depth=k, state=j).transpose("y", "x")
            seen = read.isel(depth=k, state=j).transpose("y", "x").values
            if not seen.any():
                rows.append((depth, state, "", "", "", "", "", "not readable"))
                continue
            unread = "" if seen.all() else f"{(~seen).sum()} of {seen.size} positions are not readable"
            delta = delta.where(seen)
            found = np.where(seen, delta.values, -np.inf)
            row, column = (int(n) for n in np.unravel_index(int(found.argmax()), delta.shape))
            peak, lowest = float(delta[row, column]), float(delta.min())
            if max(peak, -lowest) <= NO_ANSWER:
                rows.append((depth, state, peak, "", "", "", lowest, "no response"))
                continue
            ends = ((row, delta.sizes["y"]), (column, delta.sizes["x"]))
            at_edge = any(count > 1 and at in (0, count - 1) for at, count in ends)
            where = (float(delta.x[column]), float(delta.y[row]))
            metal: Value = ""
            if "metal_delta" in response:
                metal = float(response.metal_delta.isel(depth=k, state=j).transpose("y", "x")[row, column])
            remarks = ("at the edge of the map" if at_edge else "", unread)
            rows.append((depth, state, peak, *where, metal, lowest, "; ".join(filter(None, remarks))))
    return Table("response", "Response", columns, tuple(rows)).without_empty_columns()


def _ring(at: xr.Dataset) -> tuple[float, float]:
    """Height of the free surface where it rises highest, and the radius there; NaN where it does not rise."""
    top = at.isel(interface=-1)
    r, rise = (top.r + top.displacement_r).values, top.displacement_z.values
    highest = int(rise.argmax())
    if rise[highest] <= _NO_RING * float(at.depth):
        return np.nan, np.nan
    if highest == r.size - 1:  # the edge of a finite sample
        return float(rise[highest]), float(r[highest])
    # the vertex of the parabola through the highest node and those beside it
    near = slice(highest - 1, highest + 2)
    a, b, c = np.polyfit(r[near] - r[highest], rise[near], 2).tolist()
    return c - b**2 / (4 * a), float(r[highest]) - b / (2 * a)
