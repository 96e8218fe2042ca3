"""Tables of a report: SI in the files, customary units on the page; names and units come from the datasets.

To add a column to the table of a dataset, add the name of the variable to the list of that table: its attribute
``long_name`` is the heading, ``units`` the unit.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from coilarray.compute.display_units import PERCENT, DisplayUnit, display_unit
from coilarray.design.model import Design, DesignFile
from coilarray.geometry import Margin

if TYPE_CHECKING:
    import xarray as xr

Value = str | float | bool


@dataclass(frozen=True)
class Column:
    """A column of a table.

    `label` is the heading on the page without the unit, the name in words by default; `unit` the SI unit of the values
    in the rows and files, empty for text, "1" for a pure number; `shown` the unit on the page, by default the customary
    one.
    """

    name: str
    label: str = ""
    unit: str = ""
    shown: DisplayUnit | None = None

    @property
    def key(self) -> str:
        """Name in the files: the quantity and its SI unit, as "force_N_per_m"; the unit of a ratio is left out."""
        unit = "" if self.unit in ("", "1", "A/A") else "_" + self.unit.replace("/", "_per_")
        return self.name + unit

    @property
    def header(self) -> str:
        """Name on the page, with the unit that is shown there."""
        return self._shown.label(self.label or self.name.replace("_", " "))

    @property
    def _shown(self) -> DisplayUnit:
        return self.shown or display_unit(self.unit)

    def texts(self, values: Sequence[Value]) -> list[str]:
        """Return the values of this column as the page shows them."""
        numbers = iter(self._shown.texts([value for value in values if not isinstance(value, (str, bool))]))
        return [_TRUTH[value] if isinstance(value, bool) else value if isinstance(value, str) else next(numbers)
                for value in values]  # fmt: skip


_POSITION = ("x", "y")  # names of columns
_TRUTH = {True: "yes", False: "no"}


@dataclass(frozen=True)
class Table:
    """A table with a name for files and JSON and a title for people; its rows have numbers in SI, "" for none.

    Where rows have units of their own, `row_units` are shown in the column "unit", and count for the columns of pure
    numbers before it.
    """

    name: str
    title: str
    columns: tuple[Column, ...]
    rows: tuple[tuple[Value, ...], ...]
    row_units: tuple[DisplayUnit, ...] = ()

    @property
    def headers(self) -> list[str]:
        """Headings of the columns on the page."""
        return [column.header for column in self.columns]

    def csv(self) -> str:
        """Return the table as CSV with SI values in full precision, and the minus sign of ASCII in texts."""
        buffer = io.StringIO()
        writer = csv.writer(buffer, lineterminator="\n")
        writer.writerow(column.key for column in self.columns)
        writer.writerows(self.rows)
        return buffer.getvalue().replace("−", "-")

    def records(self) -> list[dict[str, Value]]:
        """Return the rows as mappings for JSON, SI values in full precision."""
        keys = [column.key for column in self.columns]
        return [dict(zip(keys, row, strict=True)) for row in self.rows]

    def cells(self) -> list[list[str]]:
        """Return the rows as the page shows them."""
        if not self.rows:
            return []
        columns = [c.texts(values) for c, values in zip(self.columns, zip(*self.rows, strict=True), strict=True)]
        for k, unit in enumerate(self.row_units):
            end = [column.name for column in self.columns].index("unit")
            columns[end][k] = unit.symbol
            for texts, column, value in zip(columns[:end], self.columns, self.rows[k], strict=False):
                if column.unit == "1":
                    texts[k] = Column("", shown=unit).texts([value])[0]
        return [list(row) for row in zip(*columns, strict=True)]

    def without_empty_columns(self) -> Table:
        """Return the table without the columns that are empty in every row."""
        used = [k for k in range(len(self.columns)) if any(row[k] != "" for row in self.rows)]
        rows = tuple(tuple(row[k] for k in used) for row in self.rows)
        return replace(self, columns=tuple(self.columns[k] for k in used), rows=rows)

    def brief(self) -> Table:
        """Return the table for the page, without empty and repeated columns.

        Left out are columns that are empty or zero in every row, or repeat the numbers of an earlier one of their unit;
        the files have all. A position keeps x and y unless they are zero.
        """
        columns = list(zip(*self.rows, strict=True))
        kept = [
            k
            for k, values in enumerate(columns)
            if not all(value == "" or (value == 0 and not isinstance(value, bool)) for value in values)
            and (
                self.columns[k].name in _POSITION
                or not any(self.columns[j].unit == self.columns[k].unit and _same(values, columns[j]) for j in range(k))
            )
        ]
        rows = tuple(tuple(row[k] for k in kept) for row in self.rows)
        return replace(self, columns=tuple(self.columns[k] for k in kept), rows=rows)


def _same(values: Sequence[Value], others: Sequence[Value]) -> bool:
    """Whether two columns of numbers agree to rounding."""
    return all(
        isinstance(a, float) and isinstance(b, float) and math.isclose(a, b, rel_tol=1e-12)
        for a, b in zip(values, others, strict=True)
    )


def dataset_table(
    name: str, title: str, dataset: xr.Dataset, variables: Sequence[str], shown: Mapping[str, DisplayUnit] | None = None
) -> Table:
    """Make a table of the variables and coordinates of a dataset in SI, with their ``long_name`` and ``units``.

    There is a row for each combination of their coordinates; the dimension that is named first changes slowest. Numbers
    that are not finite are left empty. `shown` has units for the page where the customary ones do not fit, such as %.

    Examples
    --------
    >>> import xarray as xr
    >>> R = ("coil", [14.2, 14.1], {"long_name": "DC resistance", "units": "ohm"})
    >>> coils = xr.Dataset({"resistance": R}, {"coil": ["a", "b"]})
    >>> table = dataset_table("coils", "Coils", coils, ["coil", "resistance"])
    >>> table.headers, table.cells(), table.csv().splitlines()[0]
    (['coil', 'DC resistance (Ω)'], [['a', '14.200'], ['b', '14.100']], 'coil,resistance_ohm')
    """
    import xarray as xr

    arrays = [dataset[variable] for variable in variables]
    columns = tuple(
        Column(variable, str(one.attrs.get("long_name", "")), _unit(one), (shown or {}).get(variable))
        for variable, one in zip(variables, arrays, strict=True)
    )
    values = (one.values.ravel().tolist() for one in xr.broadcast(*arrays))
    return Table(name, title, columns, tuple(tuple(map(cell, row)) for row in zip(*values, strict=True)))


def _unit(variable: xr.DataArray) -> str:
    """SI unit of a variable; empty for text and truth values."""
    return str(variable.attrs.get("units", "1")) if variable.dtype.kind in "fiu" else ""


def cell(value: object) -> Value:
    """Return a value of a table; a number that is not finite is left empty."""
    if isinstance(value, (str, bool, int)):
        return value
    number = float(np.asarray(value))
    return number if math.isfinite(number) else ""


def root_mean_square(values: npt.NDArray[np.float64]) -> Value:
    """Return the root mean square of finite numbers as a value of a table; empty where there are none."""
    return cell(np.hypot.reduce(values / np.sqrt(len(values)))) if len(values) else ""  # no square that overflows


def coil_table(design: Design, coupling: xr.Dataset) -> Table:
    """Return one row for each coil: its values alone, and with its neighbours as terminated."""
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
    """Return one row for each active coil and other coil; the coupling also without sheets and plates."""
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
    """Return one row for each value of the design, assumed ones with their reason.

    On a board without elastomer its keys are left out, unless they are given.
    """
    rows = []
    for key, value in file.values.items():
        if not file.design.sheets and key.rpartition(".")[2].startswith("elastomer") and key not in file.given:
            continue
        origin = "assumed" if key in file.assumed else "given" if key in file.given else "default"
        rows.append((key, _plain(value), origin, file.assumed.get(key, "")))
    return Table("design", "Design", tuple(map(Column, ("key", "value", "origin", "reason"))), tuple(rows))


def rules_table(margins: Sequence[Margin]) -> Table:
    """Return one row for each margin, in the order of `check_rules`; a margin of the whole board has no place."""
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
    return Table("rules", "Fabrication rules", columns, rows, units)


_LENGTH, _NUMBER = DisplayUnit("mm", 1e3, 4), DisplayUnit(significant=True)


def line_table(fields: Mapping[str, xr.Dataset]) -> Table:
    """Return B_z along a line per ampere in the active coil: a column for each field, by what it says of the others."""
    columns = (
        Column("x", unit="m"),
        *(Column(f"Bz_{of.replace('others as', 'as').replace(' ', '_')}", f"B_z, {of}", "T/A") for of in fields),
    )
    values = (field.B.sel(component="z").values.ravel().tolist() for field in fields.values())
    rows = tuple(zip(next(iter(fields.values())).x.values.tolist(), *values, strict=True))
    return Table("field_line", "B_z along a line", columns, rows)


def _plain(value: object) -> str:
    """Write a value as it stands in a design file, without the brackets of lists."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, (list, tuple)):
        return ", ".join(_plain(item) if not isinstance(item, (list, tuple)) else f"[{_plain(item)}]" for item in value)
    return f"{value:g}" if isinstance(value, float) else str(value)
