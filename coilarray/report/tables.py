"""The numbers of a report as tables: SI in the files, prefixed units on the page, one source for both."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr

from coilarray.design.model import Design, DesignFile
from coilarray.electromagnetics.inductance import coupling_matrix
from coilarray.geometry import Margin

Value = str | float | bool


@dataclass(frozen=True)
class Column:
    """One column.

    Parameters
    ----------
    key : str
        Name in the files, ending in the SI unit.
    header : str
        Name on the page, with the unit shown there.
    scale : float
        From SI to the unit on the page.
    digits : int
        Decimal places on the page.
    """

    key: str
    header: str
    scale: float = 1.0
    digits: int = 3

    def text(self, value: Value) -> str:
        """Return a value as the page shows it."""
        if isinstance(value, bool):
            return "yes" if value else "no"
        if isinstance(value, str):
            return value
        shown = round(value * self.scale, self.digits) + 0.0  # + 0.0: no −0
        return f"{shown:.{self.digits}f}".replace("-", "−")


@dataclass(frozen=True)
class Table:
    """A named table; `rows` hold one value a column, numbers in SI."""

    name: str
    title: str
    columns: tuple[Column, ...]
    rows: tuple[tuple[Value, ...], ...]

    def csv(self) -> str:
        """Return the table as CSV with SI values in full precision."""
        buffer = io.StringIO()
        writer = csv.writer(buffer, lineterminator="\n")
        writer.writerow(column.key for column in self.columns)
        writer.writerows(self.rows)
        return buffer.getvalue()

    def records(self) -> list[dict[str, Value]]:
        """Return the rows as mappings for JSON, SI values in full precision."""
        keys = [column.key for column in self.columns]
        return [dict(zip(keys, row, strict=True)) for row in self.rows]

    def cells(self) -> list[list[str]]:
        """Return the rows as the page shows them."""
        return [[c.text(value) for c, value in zip(self.columns, row, strict=True)] for row in self.rows]


def crossed_rows(dataset: xr.Dataset, first: str, second: str, names: Sequence[str]) -> tuple[tuple[Value, ...], ...]:
    """One row for each pair of labels of two dimensions, with the values of the variables `names` (first, second)."""
    return tuple(
        (a, b, *(float(dataset[name].values[i, j]) for name in names))
        for i, a in enumerate(dataset[first].values.tolist())
        for j, b in enumerate(dataset[second].values.tolist())
    )


def coil_table(design: Design, coupling: xr.Dataset) -> Table:
    """One row a coil: what it is alone and with its neighbours terminated."""
    columns = (
        Column("coil", "coil"),
        Column("layers", "layers"),
        Column("x_m", "x (mm)", 1e3, 2),
        Column("y_m", "y (mm)", 1e3, 2),
        Column("resistance_ohm", "R dc (Ω)", 1, 2),
        Column("inductance_H", "L (µH)", 1e6, 3),
        Column("sheet_inductance_H", "of L by the sheets (µH)", 1e6, 3),
        Column("effective_inductance_H", "L_eff (µH)", 1e6, 3),
        Column("inductance_change", "L_eff/L − 1 (%)", 100, 3),
        Column("effective_resistance_ohm", "R_eff (Ω)", 1, 2),
        Column("quality_factor", "Q", 1, 1),
        Column("open_frequency_Hz", "f, others open (MHz)", 1e-6, 4),
        Column("frequency_Hz", "f (MHz)", 1e-6, 4),
    )
    names = (
        "x", "y", "resistance", "open_inductance", "own_sheet_inductance", "effective_inductance",
        "inductance_change", "effective_resistance", "quality_factor", "open_frequency", "frequency",
    )  # fmt: skip
    single = coupling.assign(own_sheet_inductance=("coil", np.diag(coupling.sheet_inductance)))
    rows: list[tuple[Value, ...]] = []
    for k, place in enumerate(design.array.placements):
        rows.append((place.name, "+".join(place.layers), *(float(single[name][k]) for name in names)))
    return Table("coils", "Coils", columns, tuple(rows))


def pair_table(coupling: xr.Dataset) -> Table:
    """One row for each active coil and other coil; the coupling also without the magnetic sheets."""
    columns = (
        Column("active", "active"),
        Column("other", "other"),
        Column("mutual_inductance_H", "M (µH)", 1e6, 4),
        Column("sheet_inductance_H", "of M by the sheets (µH)", 1e6, 4),
        Column("coupling", "k", 1, 5),
        Column("bare_coupling", "k without sheets", 1, 5),
        Column("current_real", "i, in phase (A/A)", 1, 5),
        Column("current_imag", "i, quadrature (A/A)", 1, 5),
        Column("contribution_H", "part in L_eff − L (µH)", 1e6, 4),
    )
    names = (
        "inductance", "sheet_inductance", "coupling", "bare_coupling", "current_real", "current_imag", "contribution",
    )  # fmt: skip
    bare = coupling_matrix(coupling.inductance.values - coupling.sheet_inductance.values)
    both = coupling.assign(bare_coupling=(("coil", "other"), bare))
    rows = tuple(row for row in crossed_rows(both, "coil", "other", names) if row[0] != row[1])
    return Table("pairs", "Pairs of coils", columns, rows)


def design_table(file: DesignFile) -> Table:
    """One row for each value of the design, assumed ones with their reason."""
    columns = (
        Column("key", "key"),
        Column("value", "value"),
        Column("origin", "origin"),
        Column("reason", "reason"),
    )
    rows = []
    for key, value in file.values.items():
        origin = "assumed" if key in file.assumed else "given" if key in file.given else "default"
        rows.append((key, _plain(value), origin, file.assumed.get(key, "")))
    return Table("design", "Design", columns, tuple(rows))


@dataclass(frozen=True)
class MarginTable(Table):
    """The table of margins, in which lengths stand beside counts and ratios; the page shows the lengths in mm."""

    def cells(self) -> list[list[str]]:
        """Return the rows as the page shows them."""
        shown = []
        for row, cells in zip(self.rows, super().cells(), strict=True):
            if row[_UNIT] == "1":
                numbers = [f"{number:.4g}".replace("-", "−") for number in row[_NUMBERS]]
                cells[_NUMBERS], cells[_UNIT] = numbers, ""
            else:
                cells[_UNIT] = "mm"
            shown.append(cells)
        return shown


# columns of a `MarginTable`
_NUMBERS, _UNIT = slice(3, 6), 6


def rules_table(margins: Sequence[Margin]) -> MarginTable:
    """One row a margin, in the order of `check_rules`; a margin that has no place leaves x and y empty."""
    columns = (
        Column("rule", "rule"),
        Column("layer", "layer"),
        Column("feature", "feature"),
        Column("value", "value", 1e3, 4),
        Column("limit", "limit", 1e3, 4),
        Column("margin", "margin", 1e3, 4),
        Column("unit", "unit"),
        Column("x_m", "x (mm)", 1e3, 3),
        Column("y_m", "y (mm)", 1e3, 3),
        Column("kept", "kept"),
    )
    rows = tuple(
        (
            *(m.rule, m.layer, m.feature, m.value, m.limit, m.margin, m.unit or "1"),
            *("" if place is None else place for place in (m.x, m.y)),
            m.kept,
        )
        for m in margins
    )
    return MarginTable("rules", "Fabrication rules", columns, rows)


def line_table(alone: xr.Dataset, operating: xr.Dataset) -> Table:
    """B_z along a line, per ampere in the active coil."""
    columns = (
        Column("x_m", "x (mm)", 1e3, 2),
        Column("Bz_others_open_T_per_A", "B_z, others open (µT/mA)", 1e3, 4),
        Column("Bz_as_terminated_T_per_A", "B_z, as terminated (µT/mA)", 1e3, 4),
    )
    fields = (alone.B.sel(component="z").values.ravel(), operating.B.sel(component="z").values.ravel())
    rows = tuple(zip(alone.x.values.tolist(), *(field.tolist() for field in fields), strict=True))
    return Table("field_line", "B_z along a line", columns, rows)


def _plain(value: object) -> str:
    """Write a value as it stands in a design file, without the brackets of lists."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, (list, tuple)):
        return ", ".join(_plain(item) if not isinstance(item, (list, tuple)) else f"[{_plain(item)}]" for item in value)
    return f"{value:g}" if isinstance(value, float) else str(value)
