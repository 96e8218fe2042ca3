"""Tables of dents, responses, targets and plates."""

import math

import numpy as np
import xarray as xr

from coilarray.circuit.board_circuit import board_circuit
from coilarray.circuit.converter_limits import DRIVE_CURRENTS, path_drives, readable_of, with_reasons
from coilarray.compute.display_units import KILOHM, MM, PER_MILLION, PERCENT, DisplayUnit
from coilarray.compute.table import Column, Table, Value, cell, dataset_table
from coilarray.design.model import Design
from coilarray.electromagnetics.inductance import coupling_matrix
from coilarray.geometry import FinitePlate
from coilarray.response.dataset import NO_ANSWER

_NO_RING = 1e-6  # of the depth, below which a rise is rounding
_CIRCUIT = ("effective_inductance", "frequency", "effective_resistance", "quality_factor", "parallel_resistance")
_CHANGE = "frequency_change"
_DELTAS = ("delta", "delta_error")  # delta_error is for a target with a mesh
_LARGE, _LARGE_DELTA = 0.01, DisplayUnit("%", 100.0, significant=True)  # |δ| from which its column is in %
_VOLTS = DisplayUnit("V", 1.0, 3, significant=True)
_MICROMETRES = DisplayUnit("µm", 1e6, 3, significant=True)
_CONDUCTIVITY = DisplayUnit("MS/m", 1e-6, 4, significant=True)
_SHORT = DisplayUnit("mm", 1e3, 3, significant=True)
_RATIO = DisplayUnit(digits=3, significant=True)
_COMPARED = {
    "effective_inductance": "L_eff", "effective_resistance": "R_eff", "quality_factor": "Q", "frequency": "f"
}  # fmt: skip


def indentation_table(indentation: xr.Dataset) -> Table:
    """Return force (N or N/m), contact radius, displacements and ring by depth."""
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
    """Return the largest δ with place, and the lowest δ.

    A remark marks a largest δ at the edge of the map or of zero, and positions that the converter
    cannot read, which are left out. The share of an indenter of metal is beside it.
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
    """Height and radius of the surface's highest rise, or NaN."""
    top = at.isel(interface=-1)
    r, rise = (top.r + top.displacement_r).values, top.displacement_z.values
    highest = int(rise.argmax())
    if rise[highest] <= _NO_RING * float(at.depth):
        return np.nan, np.nan
    if highest == r.size - 1:  # the edge of a finite sample
        return float(rise[highest]), float(r[highest])
    near = slice(highest - 1, highest + 2)  # the vertex of the parabola through the highest node and its neighbours
    a, b, c = np.polyfit(r[near] - r[highest], rise[near], 2).tolist()
    return c - b**2 / (4 * a), float(r[highest]) - b / (2 * a)


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
    """Return distances and states where the target moves them most."""
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
    """Return the converter's drive over a map by state.

    The amplitudes are for the drive current of the coil alone. The last columns have the single
    current that reads the most, and the distances or depths that it reads where R_p is least.
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
    """Return range and resolved steps of distance by state."""
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
    """Return pairs where the target changes k most, by distance."""
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
    """Return every distance, place and state of a map."""
    deltas = (name for name in _DELTAS if name in response)
    names = ("distance", "y", "x", "state", *deltas, _CHANGE, *_CIRCUIT, "base_inductance", "base_frequency")
    response, read = with_reasons(_with_change(response))
    return dataset_table("target_values", "Target", response, (*names, *read))


def plate_table(design: Design, frequency: float) -> Table:
    """Return place, material, skin depth and model errors of the plates."""
    errors = board_circuit(design).plate_errors(frequency)
    columns: tuple[Column, ...] = (
        *map(Column, ("plate", "outline")),
        Column("z", "lowest point at z", "m", MM),
        Column("thickness", unit="m", shown=_SHORT),
        Column("material"),
        Column("conductivity", unit="S/m", shown=_CONDUCTIVITY),
        Column("relative_permeability", "µr", "1", _RATIO),
        Column("skin_depth", unit="m", shown=_SHORT),
        Column("thickness_over_skin_depth", "thickness in skin depths", "1", _RATIO),
    )
    if errors:
        columns += (
            Column("inductance_error", "ΔL errs by up to", "1", PERCENT),
            Column("resistance_error", "ΔR errs by up to", "1", PERCENT),
        )
    rows: list[tuple[Value, ...]] = []
    for plate in design.plates:
        outline = type(plate.outline).__name__.lower() if isinstance(plate, FinitePlate) else "infinite plate"
        material = plate.material
        depth = material.skin_depth(frequency)
        numbers = (material.conductivity, material.relative_permeability, depth, plate.thickness / depth)
        of_model: tuple[Value, ...] = ("", "") if errors else ()  # without columns where all plates are infinite
        if plate.name in errors:
            of_model = errors[plate.name].inductance, errors[plate.name].resistance
        rows.append(
            (
                plate.name, outline, plate.heights[0], plate.thickness, material.words,
                *("" if not math.isfinite(number) else number for number in numbers),
                *of_model,
            )
        )  # fmt: skip
    return Table("plates", "Plates", columns, tuple(rows))


def beside_plates_table(scan: xr.Dataset, without: xr.Dataset) -> Table:
    """Return L, R, Q, f with and without the plates."""
    rows: dict[str, xr.DataArray] = {}
    beside_q = str(scan.quality_factor.attrs["long_name"]).partition(",")[2]
    compared = _COMPARED | ({"quality_factor": f"Q,{beside_q}"} if beside_q else {})
    for name, words in compared.items():
        rows[name] = scan[name].assign_attrs(long_name=words)
        rows[f"{name}_without"] = without[name].assign_attrs(long_name=f"{words} without plates")
    change = scan.effective_inductance / without.effective_inductance - 1
    rows["plate_change"] = change.assign_attrs(long_name="change of L_eff", units="1")
    both = xr.Dataset(rows)
    names = ("state", *(one for name in _COMPARED for one in (name, f"{name}_without")), "plate_change")
    return dataset_table("beside_plates", "States beside the plates", both, names, {"plate_change": PERCENT})
