"""Tables of a tolerance analysis: spread and contributors of every output, errors, and yield.

Every table is made from the dataset that `coilarray.studies.tolerance.analyse` returns.
"""

from __future__ import annotations

import numpy as np
import xarray as xr

from coilarray.compute.display_units import PERCENT, DisplayUnit
from coilarray.compute.table import Column, Table, Value, cell, dataset_table

MOST_SHOWN = 3
"""Number of contributors of an output in the table of spreads."""

_PERCENT, _MICROMETRES, _MILLIMETRES, _MILLIRADIANS = (
    DisplayUnit(symbol, factor, 3, significant=True)
    for symbol, factor in (("%", 100.0), ("µm", 1e6), ("mm", 1e3), ("mrad", 1e3))
)
# units of a tolerance file by its tables
_FILE_UNITS = {
    "etch": _MICROMETRES, "registration": _MICROMETRES, "rotation": _MILLIRADIANS, "dielectric": _PERCENT,
    "copper": _PERCENT, "placement": _MILLIMETRES, "permeability": _PERCENT, "elastomer": _MILLIMETRES,
    "capacitance": _PERCENT, "plate_distance": _MILLIMETRES, "plate_thickness": _PERCENT, "conductivity": _PERCENT,
    "target_tilt": _MILLIRADIANS,
}  # fmt: skip


def _significant(digits: int) -> DisplayUnit:
    return DisplayUnit(digits=digits, significant=True)


def spread_table(result: xr.Dataset) -> Table:
    """Return a table of the outputs' spreads.

    A row for each output has its nominal value, linearised and sampled spread, and the largest contributors. Values are
    in the units of the outputs' names. ``step_change`` is the dependence of the linearisation on its step, in standard
    deviations. Without samples, or if the linearised spread is zero, their columns are empty.
    """
    sampled = ("sample_mean", "sample_deviation", "ratio", "ratio_error")
    columns: dict[str, object] = {name: np.nan for name in sampled if name not in result}
    for k, (name, text) in enumerate((("low", "2.5 %"), ("high", "97.5 %"))):
        value = result.percentiles.isel(percentile=k, drop=True) if "percentiles" in result else xr.DataArray(np.nan)
        columns[name] = value.assign_attrs(long_name=text)
    largest = [_largest(result.isel(output=k)) for k in range(result.sizes["output"])]
    columns["largest"] = ("output", largest, {"long_name": "largest shares of the linear variance"})
    names = ("output", "nominal", "linear_deviation", "step_change", *sampled, "low", "high", "largest")
    shown = {name: _significant(3) for name in ("linear_deviation", "sample_deviation")}
    shown |= {name: _significant(6) for name in ("nominal", "sample_mean", "low", "high")}
    shown |= {"step_change": _significant(2)} | {name: DisplayUnit(digits=3) for name in ("ratio", "ratio_error")}
    return dataset_table("spread", "Spread", result.assign(columns), names, shown)


def share_table(result: xr.Dataset) -> Table:
    """Return a table of the contributors of every output.

    The largest contributor of an output comes first.
    """
    columns = (
        Column("output"),
        Column("contributor"),
        Column("effect", "effect of 1 σ", "1", _significant(3)),
        Column("share", "share of the variance", "1", PERCENT),
    )
    rows: list[tuple[Value, ...]] = []
    for k, name in enumerate(result.output.values.tolist()):
        at = result.isel(output=k)
        for m in _ranking(at):
            rows.append((name, str(at.contributor.values[m]), float(at.effect[m]), float(at.share[m])))
    return Table("shares", "Contributors", columns, tuple(rows))


def error_table(result: xr.Dataset) -> Table:
    """Return a table of the contributors.

    A row for each has its distribution, and the reason if it is assumed.
    """
    names = ("contributor", "distribution", "deviation", "unit", "assumed")
    return dataset_table("errors", "Errors", result, names, {"deviation": _significant(3)})


def given_table(result: xr.Dataset) -> Table:
    """Return a table of the parts of a tolerance file.

    A row for each table of the file has standard deviations of its parts, and the reason if it is assumed.
    """
    columns = (
        Column("table", "error"), Column("distribution"), Column("board_deviation", "σ of the board", "1"),
        Column("layer_deviation", "σ of a layer", "1"), Column("unit"), Column("assumed"),
    )  # fmt: skip
    rows: list[tuple[Value, ...]] = []
    tables, parts = result.table.values, result.part.values
    names = list(dict.fromkeys(tables.tolist()))
    for name in names:
        there = np.flatnonzero(tables == name)
        of_part: list[Value] = []
        for part in ("board", "layer"):
            found = [k for k in there if parts[k] == part]
            of_part.append(float(result.deviation[found[0]]) if found else "")
        first = result.isel(contributor=there[0])
        rows.append((name, str(first.distribution.values), *of_part, str(first.unit.values), str(first.assumed.values)))
    return Table("given", "Errors", columns, tuple(rows), tuple(_FILE_UNITS[name] for name in names))


def yield_table(result: xr.Dataset) -> Table:
    """Return a table of the yield by limit.

    A row for each limit, and a row for all together, has the share of good boards. Without limits there are no rows. In
    the linear model every board can be made. Among the drawn boards, a board that cannot be made is bad. The interval
    is the interval of `coilarray.studies.tolerance.spread.Yield`.
    """
    if "limit" not in result.dims:
        return Table("yield", "Yield", (), ())
    names = ("linear_yield", "sample_yield", "sample_yield_low", "sample_yield_high")
    known = result.assign({name: np.nan for name in names if name not in result})
    return dataset_table("yield", "Yield", known, ("limit", *names), dict.fromkeys(names, PERCENT))


def sample_table(result: xr.Dataset) -> Table:
    """Return a table of the drawn boards.

    A row for each board has its errors, its outputs and, if it has none, the reason.
    """
    units = zip(result.contributor.values.tolist(), result.unit.values.tolist(), strict=True)
    columns = (
        *(Column(name if unit == "1" else f"{name} ({unit})") for name, unit in units),
        *map(Column, result.output.values.tolist()),
        Column("failure"),
    )
    boards = zip(result.error.values.tolist(), result.value.values.tolist(), result.failure.values, strict=True)
    rows = tuple((*errors, *map(cell, values), str(failure)) for errors, values, failure in boards)
    return Table("samples", "Boards", columns, rows)


def _largest(at: xr.Dataset) -> str:
    """Name the largest contributors of an output with their shares."""
    shown = [(str(at.contributor.values[m]), float(at.share[m])) for m in _ranking(at)[:MOST_SHOWN]]
    return "; ".join(f"{name} {share * 100:.0f} %" for name, share in shown if share >= 0.005)


def _ranking(at: xr.Dataset) -> list[int]:
    """Order the contributors of one output from the largest.

    The order is by index, and equal contributors keep their order.
    """
    return [int(m) for m in np.argsort(-at.share.values, kind="stable")]
