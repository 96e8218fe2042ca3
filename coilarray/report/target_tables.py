"""Tables of a target: states over distance, range, resolution, and couplings."""

from __future__ import annotations

import numpy as np
import xarray as xr

from coilarray.circuit.converter_limits import DRIVE_CURRENTS
from coilarray.circuit.readability import path_drives, with_reasons
from coilarray.compute.display_units import KILOHM, PER_MILLION, DisplayUnit
from coilarray.compute.table import Column, Table, Value, cell, dataset_table
from coilarray.electromagnetics.inductance import coupling_matrix

_CIRCUIT = ("effective_inductance", "frequency", "effective_resistance", "quality_factor", "parallel_resistance")
_CHANGE = "frequency_change"
_DELTAS = ("delta", "delta_error")  # delta_error is for a target with a mesh
_LARGE, _LARGE_DELTA = 0.01, DisplayUnit("%", 100.0, significant=True)  # |δ| from which its column is in %
_VOLTS = DisplayUnit("V", 1.0, 3, significant=True)
_MICROMETRES = DisplayUnit("µm", 1e6, 3, significant=True)


def base_table(response: xr.Dataset) -> Table:
    """Return a table of all states without the target."""
    names = ("base_inductance", *(f"base_{name}" for name in _CIRCUIT[1:]))
    shown = {"base_parallel_resistance": KILOHM}
    return dataset_table("target_base", "Without the target", response, ("state", *names), shown)


def _with_change(response: xr.Dataset) -> xr.Dataset:
    """Add the relative change of the frequency, about −δ/2."""
    change = (response.frequency / response.base_frequency - 1).transpose(*response.frequency.dims)
    return response.assign({_CHANGE: change.assign_attrs(units="1", long_name="Δf/f")})


def target_table(response: xr.Dataset) -> Table:
    """Return a table of distances and states.

    A row for each is at the place where the target moves that state the most. The last column is the standard deviation
    of a distance from one reading, by its noise. The error of a mesh has a column of its own.
    """
    response, states = _with_change(response), []
    for state in response.state.values:
        of = response.sel(state=[state])
        at = of.sel(x=float(of.best_x[0]), y=float(of.best_y[0]))
        x, y = (("state", [float(at[axis])], response[axis].attrs) for axis in ("x", "y"))
        states.append(at.drop_vars(["x", "y"]).assign(x=x, y=y))
    best = xr.concat(states, "state", data_vars="all", coords="minimal", compat="override", join="outer")
    large = float(np.abs(best.delta).max()) >= _LARGE
    unit = _LARGE_DELTA if large else PER_MILLION
    shown = {"delta": unit, _CHANGE: unit, "delta_error": PER_MILLION}
    shown |= {"distance_deviation": _MICROMETRES, "parallel_resistance": KILOHM, "amplitude": _VOLTS}
    deltas = (name for name in _DELTAS if name in best)
    names = ("distance", "state", "x", "y", *deltas, _CHANGE, *_CIRCUIT, "distance_deviation")
    best, read = with_reasons(best, ("amplitude",))
    return dataset_table("target", "Target", best, (*names, *read), shown)


def path_drive_table(response: xr.Dataset) -> Table:
    """Return a table of the converter's drive over a map.

    There is a row for each state over all positions, and no rows without a converter. The amplitudes are for the drive
    current of the coil alone. The last columns have the single drive current that reads the most positions and the coil
    alone, the positions that it reads, and the distances or depths that it reads where R_p is the least.
    """
    columns = (
        Column("state"), Column("drive_code", "IDRIVE of the coil alone"),
        Column("least_amplitude", "least amplitude with it", "V", _VOLTS),
        Column("largest_amplitude", "largest", "V", _VOLTS), Column("path_drive_code", "IDRIVE of the path"),
        Column("path_drive_current", "its current", "A"), Column("read", "positions read"),
        Column("positions", "of"), Column("alone", "reads the coil alone"),
        Column("heights", "read where R_p is the least"),
    )  # fmt: skip
    rows = tuple(
        (
            one.state, _code(one.code), cell(one.least), cell(one.most), _code(one.path_code),
            "" if one.path_code < 0 else DRIVE_CURRENTS[one.path_code], str(one.read), str(one.positions),
            one.alone, one.heights,
        )
        for one in path_drives(response)
    )  # fmt: skip
    return Table("target_drive", "Drive over the path", columns, rows)


def _code(code: int) -> str:
    return "none fits" if code < 0 else str(code)


def range_table(response: xr.Dataset) -> Table:
    """Return a table of the range and resolution of states.

    A row for each state has its range, and the resolved steps of distance. A number that the last distance of the map
    limits is marked as "at least". A step that is nowhere resolved is empty.
    """
    columns = [
        Column("state"),
        Column("nearest_readable", "read from", "m"),
        Column("range", unit="m"),
        Column("range_is_least", "range at least"),
    ]
    steps = response.step.values
    for step in steps.tolist():
        words = f"{step * 1e6:g} µm"
        columns.append(Column(f"resolves_{step * 1e6:g}um", f"{words} resolved up to", "m"))
    columns.append(Column("remark"))
    rows: list[tuple[Value, ...]] = []
    for k, state in enumerate(response.state.values.tolist()):
        of = response.isel(state=k)
        least = [f"{step * 1e6:g} µm" for step, more in zip(steps, of.resolved_is_least.values, strict=True) if more]
        remark = f"{', '.join(least)} farther than the map" if least else ""
        resolved = (cell(value) for value in of.resolved_distance.values)
        rows.append((state, cell(of.nearest_readable), cell(of.range), bool(of.range_is_least), *resolved, remark))
    return Table("target_range", "Range and resolution", tuple(columns), tuple(rows)).without_empty_columns()


def target_coupling_table(response: xr.Dataset) -> Table:
    """Return a table of pairs of coils by distance.

    A row for each distance and pair is at the place where the target changes the pair's coupling the most. ``coupling``
    is the coupling with the target, ``free_coupling`` without.
    """
    free = coupling_matrix(response.inductance.values)
    columns = (
        Column("distance", unit="m"), Column("coil"), Column("other"), Column("x", unit="m"), Column("y", unit="m"),
        Column("coupling", "coupling with the target", "1"), Column("free_coupling", "without", "1"),
    )  # fmt: skip
    rows: list[tuple[Value, ...]] = []
    names = response.coil.values.tolist()
    for distance in response.distance.values.tolist():
        coupling = response.coupling.sel(distance=distance).transpose("y", "x", "coil", "other").values
        for i, j in zip(*np.triu_indices(len(names), 1), strict=True):
            of = coupling[:, :, i, j]
            row, column = np.unravel_index(int(np.abs(of - free[i, j]).argmax()), of.shape)
            place = (float(response.x[column]), float(response.y[row]))
            rows.append((distance, names[i], names[j], *place, float(of[row, column]), float(free[i, j])))
    return Table("target_coupling", "Coupling with the target", columns, tuple(rows))


def values_table(response: xr.Dataset) -> Table:
    """Return a table of every value of a map.

    There is one row for each distance, place and state, with L_0 and f without the target.
    """
    deltas = (name for name in _DELTAS if name in response)
    names = ("distance", "y", "x", "state", *deltas, _CHANGE, *_CIRCUIT, "base_inductance", "base_frequency")
    response, read = with_reasons(_with_change(response))
    return dataset_table("target_values", "Target", response, (*names, *read))
