"""A tolerance analysis as tables: spread and contributors of every output, the errors, and the yield."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import xarray as xr

from coilarray.report.tables import Column, Table, Value

MOST_SHOWN = 3
"""Contributors of an output that the table of spreads names."""


@dataclass(frozen=True)
class Figure(Column):
    """A column of numbers of any size, with so many significant `digits`; an empty text stands for none."""

    digits: int = 4

    def text(self, value: Value) -> str:
        """Return a value as the page shows it."""
        if isinstance(value, (str, bool)):
            return super().text(value)
        return f"{value * self.scale:.{self.digits}g}".replace("-", "−")


@dataclass(frozen=True)
class GivenTable(Table):
    """The table of given spreads, each in the unit of a tolerance file on the page."""

    def cells(self) -> list[list[str]]:
        """Return the rows as the page shows them."""
        shown = []
        for row, cells in zip(self.rows, super().cells(), strict=True):
            scale, cells[_UNIT] = _SHOWN[str(row[0])]
            cells[_DEVIATIONS] = ["" if isinstance(one, str) else f"{one * scale:.3g}" for one in row[_DEVIATIONS]]
            shown.append(cells)
        return shown


# columns of a `GivenTable`
_DEVIATIONS, _UNIT = slice(2, 4), 4
_SHOWN = {
    "etch": (1e6, "µm"),
    "registration": (1e6, "µm"),
    "rotation": (1e3, "mrad"),
    "dielectric": (100.0, "%"),
    "copper": (100.0, "%"),
    "placement": (1e3, "mm"),
    "permeability": (100.0, "%"),
    "elastomer": (1e3, "mm"),
    "capacitance": (100.0, "%"),
}


def spread_table(result: xr.Dataset) -> Table:
    """One row an output: nominal value, linearised and sampled spread, and what contributes most.

    Parameters
    ----------
    result : xarray.Dataset
        As `coilarray.studies.tolerance.analyse` returns it.

    Returns
    -------
    Table
        Values in the units of the outputs' names. ``step_change`` is how far the linearisation depends on its step, in
        standard deviations. Without samples, or where the linearised spread is zero, their columns are empty.
    """
    columns = (
        Column("output", "output"),
        Figure("nominal", "nominal", digits=6),
        Figure("linear_deviation", "σ, linear", digits=3),
        Figure("step_change", "by twice the step (σ)", digits=2),
        Figure("sample_mean", "mean of boards", digits=6),
        Figure("sample_deviation", "σ of boards", digits=3),
        Column("ratio", "ratio", digits=3),
        Column("ratio_error", "± of it", digits=3),
        Figure("low", "2.5 %", digits=6),
        Figure("high", "97.5 %", digits=6),
        Column("largest", "largest shares of the linear variance"),
    )
    rows: list[tuple[Value, ...]] = []
    for k, name in enumerate(result.output.values.tolist()):
        at = result.isel(output=k)
        linear = (float(at.nominal), float(at.linear_deviation), float(at.step_change))
        sampled: list[Value] = [""] * 6
        if "value" in result:
            numbers = (at.sample_mean, at.sample_deviation, at.ratio, at.ratio_error, *at.percentiles)
            sampled = [_known(float(number)) for number in numbers]
        rows.append((name, *linear, *sampled, _largest(at)))
    return Table("spread", "Spread", columns, tuple(rows))


def share_table(result: xr.Dataset) -> Table:
    """One row for each output and contributor, the largest contributor of an output first; those of no effect last.

    Parameters
    ----------
    result : xarray.Dataset
        As `coilarray.studies.tolerance.analyse` returns it.
    """
    columns = (
        Column("output", "output"),
        Column("contributor", "contributor"),
        Figure("effect", "effect of 1 σ", digits=3),
        Column("share", "share of the variance (%)", 100, 1),
    )
    rows: list[tuple[Value, ...]] = []
    for k, name in enumerate(result.output.values.tolist()):
        at = result.isel(output=k)
        for m in _ranking(at):
            rows.append((name, str(at.contributor.values[m]), float(at.effect[m]), float(at.share[m])))
    return Table("shares", "Contributors", columns, tuple(rows))


def error_table(result: xr.Dataset) -> Table:
    """One row a contributor: its distribution, and why it is assumed where no one gave it.

    Parameters
    ----------
    result : xarray.Dataset
        As `coilarray.studies.tolerance.analyse` returns it.
    """
    columns = (
        Column("contributor", "error"),
        Column("distribution", "distribution"),
        Figure("deviation", "standard deviation", digits=3),
        Column("unit", "unit"),
        Column("assumed", "assumed"),
    )
    rows: list[tuple[Value, ...]] = []
    for k, name in enumerate(result.contributor.values.tolist()):
        distribution, unit, assumed = (str(result[key].values[k]) for key in ("distribution", "unit", "assumed"))
        rows.append((name, distribution, float(result.deviation[k]), unit, assumed))
    return Table("errors", "Errors", columns, tuple(rows))


def given_table(result: xr.Dataset) -> GivenTable:
    """One row a table of the tolerance file: standard deviations of its parts, and the reason where it is assumed.

    Parameters
    ----------
    result : xarray.Dataset
        As `coilarray.studies.tolerance.analyse` returns it.
    """
    columns = (
        Column("table", "error"),
        Column("distribution", "distribution"),
        Figure("board_deviation", "σ of the board", digits=3),
        Figure("layer_deviation", "σ of a layer", digits=3),
        Column("unit", "unit"),
        Column("assumed", "assumed"),
    )
    rows: list[tuple[Value, ...]] = []
    tables, parts = result.table.values, result.part.values
    for name in dict.fromkeys(tables.tolist()):
        there = np.flatnonzero(tables == name)
        of_part: list[Value] = []
        for part in ("board", "layer"):
            found = [k for k in there if parts[k] == part]
            of_part.append(float(result.deviation[found[0]]) if found else "")
        first = result.isel(contributor=there[0])
        rows.append((name, str(first.distribution.values), *of_part, str(first.unit.values), str(first.assumed.values)))
    return GivenTable("given", "Errors", columns, tuple(rows))


def yield_table(result: xr.Dataset) -> Table:
    """One row a limit and one for all together: share of good boards, none where no limit was set.

    Parameters
    ----------
    result : xarray.Dataset
        As `coilarray.studies.tolerance.analyse` returns it.

    Returns
    -------
    Table
        Of the linear model, in which every board can be made, and, with samples, of the drawn boards, of which one that
        cannot be made is bad. Their interval is that of `coilarray.studies.tolerance.statistics.Yield`.
    """
    columns = (
        Column("limit", "limit"),
        Column("linear_yield", "yield, linear (%)", 100, 2),
        Column("sample_yield", "yield of boards (%)", 100, 2),
        Column("sample_yield_low", "at least (%)", 100, 2),
        Column("sample_yield_high", "at most (%)", 100, 2),
    )
    if "limit" not in result.dims:
        return Table("yield", "Yield", columns, ())
    names = [column.key for column in columns[1:]]
    rows = tuple(
        (str(limit), *(float(result[name].values[k]) if name in result else "" for name in names))
        for k, limit in enumerate(result.limit.values)
    )
    return Table("yield", "Yield", columns, rows)


def sample_table(result: xr.Dataset) -> Table:
    """One row a drawn board: its errors, its outputs and, where it has none, the reason.

    Parameters
    ----------
    result : xarray.Dataset
        As `coilarray.studies.tolerance.analyse` returns it, with samples.
    """
    contributors, outputs = result.contributor.values.tolist(), result.output.values.tolist()
    units = [unit if unit != "1" else "" for unit in result.unit.values.tolist()]
    columns = (
        *(Figure(f"{name} ({unit})" if unit else name, name) for name, unit in zip(contributors, units, strict=True)),
        *(Figure(name, name) for name in outputs),
        Column("failure", "failure"),
    )
    rows = tuple(
        (*errors, *map(_known, values), str(failure))
        for errors, values, failure in zip(
            result.error.values.tolist(), result.value.values.tolist(), result.failure.values, strict=True
        )
    )
    return Table("samples", "Boards", columns, rows)


def _largest(at: xr.Dataset) -> str:
    """Name the largest contributors of one output with their shares."""
    shown = [(str(at.contributor.values[m]), float(at.share[m])) for m in _ranking(at)[:MOST_SHOWN]]
    return "; ".join(f"{name} {share * 100:.0f} %" for name, share in shown if share >= 0.005)


def _ranking(at: xr.Dataset) -> list[int]:
    """Order the contributors of one output by index from the largest, equal ones in their order."""
    return [int(m) for m in np.argsort(-at.share.values, kind="stable")]


def _known(value: float) -> Value:
    return value if math.isfinite(value) else ""
