"""Tables of the indentation: force and dent over depth, and the response of every state."""

from __future__ import annotations

import numpy as np
import xarray as xr

from coilarray.circuit.readability import readable_of
from coilarray.compute.display_units import PER_MILLION, DisplayUnit
from coilarray.compute.table import Column, Table, Value, dataset_table
from coilarray.response.dataset import NO_ANSWER

_NO_RING = 1e-6  # of the depth, below which a rise is rounding


def indentation_table(indentation: xr.Dataset) -> Table:
    """Return a table of force, contact and dent by depth.

    It has depth, contact radius (half width in plane strain), u_z on the axis of the upper face of every sheet, height
    and radius of the ring around the dent in m. The force is in N, in plane strain in N/m. The ring is empty if the
    free surface rises nowhere.
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
    """Return a table of the largest and lowest δ.

    A row for each depth and state has the largest δ of the map with its place, and the lowest δ. Positions count from
    the same origin as in the response. A remark marks a largest δ at the edge of the map, beyond which it may be
    larger, and a largest δ of zero, which has no place. Positions that the converter cannot read are left out, with a
    remark. If the indenter has a material, its share of the largest δ is beside it.
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
    """Height and radius of the ring around a dent.

    It is where the free surface rises highest. NaN if it does not rise.
    """
    top = at.isel(interface=-1)
    r, rise = (top.r + top.displacement_r).values, top.displacement_z.values
    highest = int(rise.argmax())
    if rise[highest] <= _NO_RING * float(at.depth):
        return np.nan, np.nan
    if highest == r.size - 1:  # the edge of a finite sample
        return float(rise[highest]), float(r[highest])
    # the vertex of the parabola through the highest node and its neighbours
    near = slice(highest - 1, highest + 2)
    a, b, c = np.polyfit(r[near] - r[highest], rise[near], 2).tolist()
    return c - b**2 / (4 * a), float(r[highest]) - b / (2 * a)
