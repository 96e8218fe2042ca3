"""Tables of coils, pairs, design, rules, fields and tolerances."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from coilarray.compute.arrays import FloatArray
from coilarray.compute.display_units import PERCENT, DisplayUnit, display_unit
from coilarray.compute.table import Column, Table, Value, cell, dataset_table
from coilarray.design.model import Design, DesignFile
from coilarray.geometry import Margin

if TYPE_CHECKING:
    import xarray as xr


def coil_table(design: Design, coupling: xr.Dataset) -> Table:
    """Return the coils alone, and with their neighbours as terminated."""
    layers = ["+".join(place.layers) for place in design.array.placements]
    by_sheets = coupling.sheet_inductance
    single = coupling.assign(layers=("coil", layers), sheet_inductance=("coil", np.diag(by_sheets), by_sheets.attrs))
    names = (
        "coil", "layers", "x", "y", "open_inductance", "effective_inductance", "frequency", "quality_factor",
        "effective_resistance", "inductance_change", "open_frequency", "sheet_inductance", "resistance",
        "ideal_effective_inductance", "ideal_frequency",
    )  # fmt: skip
    return dataset_table("coils", "Coils", single, names, {"inductance_change": PERCENT})


def pair_table(coupling: xr.Dataset) -> Table:
    """Return the couplings, also without sheets and plates."""
    from coilarray.electromagnetics.inductance import coupling_matrix

    by_plates = coupling.plate_inductance.values if "plate_inductance" in coupling else 0.0
    bare = coupling_matrix(coupling.inductance.values - coupling.sheet_inductance.values - by_plates)
    described = {"long_name": "coupling coefficient without magnetic sheets and plates", "units": "1"}
    both = coupling.assign(
        mutual_inductance=coupling.inductance.assign_attrs(long_name="mutual inductance"),
        bare_coupling=(("coil", "other"), bare, described),
    ).rename(coil="active")
    names = (
        "active", "other", "mutual_inductance", "sheet_inductance", "coupling", "bare_coupling", "current_real",
        "current_imag", "contribution",
    )  # fmt: skip
    table = dataset_table("pairs", "Pairs of coils", both, names)
    return replace(table, rows=tuple(row for row in table.rows if row[0] != row[1]))


def design_table(file: DesignFile) -> Table:
    """Return all values of the design, with reasons if assumed.

    On a board without elastomer its keys are left out, unless they are given.
    """
    rows = []
    for key, value in file.values.items():
        if not file.design.sheets and key.rpartition(".")[2].startswith("elastomer") and key not in file.given:
            continue
        origin = "assumed" if key in file.assumed else "given" if key in file.given else "default"
        rows.append((key, _plain(value), origin, file.assumed.get(key, "")))
    return Table(
        "design", "Design", tuple(map(Column, ("key", "value", "origin", "reason"))), tuple(rows), mark="assumed"
    )


def rules_table(margins: Sequence[Margin]) -> Table:
    """Return the margins to the rules with their places."""
    columns = (
        *map(Column, ("rule", "layer", "feature")),
        *(Column(name, unit="1") for name in ("value", "limit", "margin")),
        Column("unit"),
        Column("x", unit="m"),
        Column("y", unit="m"),
        Column("kept"),
    )
    rows = tuple(
        (
            *(m.rule, m.layer, m.feature, m.value, m.limit, m.margin, m.unit or "1"),
            *("" if place is None else place for place in (m.x, m.y)),
            m.kept,
        )
        for m in margins
    )
    units = tuple(_LENGTH if m.unit else _NUMBER for m in margins)
    return Table("rules", "Fabrication rules", columns, rows, units, mark="no")


_LENGTH, _NUMBER = DisplayUnit("mm", 1e3, 4), DisplayUnit(significant=True)


def line_table(fields: Mapping[str, xr.Dataset]) -> Table:
    """Return B_z per ampere in the active coil by state."""
    columns = (
        Column("x", unit="m"),
        *(Column(f"Bz_{of.replace('others as', 'as').replace(' ', '_')}", f"B_z, {of}", "T/A") for of in fields),
    )
    values = (field.B.sel(component="z").values.ravel().tolist() for field in fields.values())
    rows = tuple(zip(next(iter(fields.values())).x.values.tolist(), *values, strict=True))
    return Table("field_line", "B_z along a line", columns, rows)


def _plain(value: object) -> str:
    """Write a value as in design files, lists without brackets."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, (list, tuple)):
        return ", ".join(_plain(item) if not isinstance(item, (list, tuple)) else f"[{_plain(item)}]" for item in value)
    return f"{value:g}" if isinstance(value, float) else str(value)


_MOST_COILS, _MOST_PAIRS = 24, 20  # coils of a printed matrix, and printed pairs of more coils


def matrix_tables(names: Sequence[str], inductance: FloatArray) -> list[Table]:
    """Return L, M and k, or the strongest pairs.

    `inductance` (n, n) is in H. Of many coils only the strongest pairs are listed.
    """
    from coilarray.electromagnetics.inductance import coupling_matrix

    if len(names) == 1:
        return [Table("L", "Inductance", (Column("coil"), Column("L", unit="H")), ((names[0], inductance[0, 0]),))]
    coupling = coupling_matrix(inductance)
    plain = DisplayUnit(digits=5)
    if len(names) > _MOST_COILS:
        first, second = np.triu_indices(len(names), 1)
        order = np.argsort(-np.abs(coupling[first, second]), kind="stable")
        of_pairs = (Column("pair"), Column("M", unit="H"), Column("k", unit="1", shown=plain))
        strongest = ((int(first[n]), int(second[n])) for n in order[:_MOST_PAIRS])
        pairs = tuple((f"{names[i]} – {names[j]}", inductance[i, j], coupling[i, j]) for i, j in strongest)
        low, high = display_unit("H").texts([np.diag(inductance).min(), np.diag(inductance).max()])
        notes = (f"L of {len(names)} coils: {low} to {high} µH", f"… and {len(order) - len(pairs)} more (--json)")
        return [Table("pairs", "Strongest couplings", of_pairs, pairs, notes=notes)]
    tables = []
    for name, unit, values in (("L and M", display_unit("H"), inductance), ("k", plain, coupling)):
        columns = (Column("coil"), *(Column(one, one, "1", replace(unit, symbol="")) for one in names))
        rows = tuple((one, *row) for one, row in zip(names, values.tolist(), strict=True))
        tables.append(Table(name, unit.label(name), columns, rows))
    return tables


_MOST_SHOWN = 3  # contributors of an output in the table of spreads

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
    """Return nominal values, both spreads and largest contributors by output.

    Values are in the units of the outputs' names.
    """
    import xarray as xr

    sampled = ("sample_mean", "sample_deviation", "ratio", "ratio_error")
    columns: dict[str, object] = {name: np.nan for name in sampled if name not in result}
    for k, (name, text) in enumerate((("low", "2.5 %"), ("high", "97.5 %"))):
        value = result.percentiles.isel(percentile=k, drop=True) if "percentiles" in result else xr.DataArray(np.nan)
        columns[name] = value.assign_attrs(long_name=text)
    largest = [_largest(result.isel(output=k)) for k in range(result.sizes["output"])]
    columns["largest"] = ("output", largest, {"long_name": "largest shares of the linear variance"})
    names = ("output", "nominal", "linear_deviation", *sampled, "low", "high", "largest")
    shown = {name: _significant(3) for name in ("linear_deviation", "sample_deviation")}
    shown |= {name: _significant(6) for name in ("nominal", "sample_mean", "low", "high")}
    shown |= {name: DisplayUnit(digits=3) for name in ("ratio", "ratio_error")}
    return dataset_table("spread", "Spread", result.assign(columns), names, shown)


def share_table(result: xr.Dataset) -> Table:
    """Return the contributors of every output, the largest first."""
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
    """Return the contributors with distribution and, if assumed, the reason."""
    names = ("contributor", "distribution", "deviation", "unit", "assumed")
    return dataset_table("errors", "Errors", result, names, {"deviation": _significant(3)})


def given_table(result: xr.Dataset) -> Table:
    """Return the tables of a tolerance file with standard deviations."""
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
    """Return the share of good boards by limit and overall.

    In the linear model every board can be made. Among the drawn boards, a board that cannot be made
    is bad.
    """
    if "limit" not in result.dims:
        return Table("yield", "Yield", (), ())
    names = ("linear_yield", "sample_yield", "sample_yield_low", "sample_yield_high")
    known = result.assign({name: np.nan for name in names if name not in result})
    return dataset_table("yield", "Yield", known, ("limit", *names), dict.fromkeys(names, PERCENT))


def sample_table(result: xr.Dataset) -> Table:
    """Return errors, outputs and failure of the drawn boards."""
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
    shown = [(str(at.contributor.values[m]), float(at.share[m])) for m in _ranking(at)[:_MOST_SHOWN]]
    return "; ".join(f"{name} {share * 100:.0f} %" for name, share in shown if share >= 0.005)


def _ranking(at: xr.Dataset) -> list[int]:
    """Order the contributors of one output from the largest."""
    return [int(m) for m in np.argsort(-at.share.values, kind="stable")]
