"""Tables of a report, in SI units in the files and customary units on the page.

Names and units come from the datasets. To add a column to the table of a dataset, add the name of the variable to the
list of that table. Its attribute ``long_name`` is the heading, ``units`` the unit.
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
    """Column of a table.

    `label` is the heading on the page without the unit, by default the name in words. `unit` is the SI unit of the
    values in the rows and files, empty for text, "1" for a dimensionless number. `shown` is the unit on the page, by
    default the customary unit.
    """

    name: str
    label: str = ""
    unit: str = ""
    shown: DisplayUnit | None = None

    @property
    def key(self) -> str:
        """Name in the files: the quantity and its SI unit.

        An example is "force_N_per_m". The unit of a ratio is left out.
        """
        unit = "" if self.unit in ("", "1", "A/A") else "_" + self.unit.replace("/", "_per_")
        return self.name + unit

    @property
    def header(self) -> str:
        """Name on the page, with the unit shown there."""
        return self._shown.label(self.label or self.name.replace("_", " "))

    @property
    def _shown(self) -> DisplayUnit:
        return self.shown or display_unit(self.unit)

    def texts(self, values: Sequence[Value]) -> list[str]:
        """Return the values as the page shows them."""
        numbers = iter(self._shown.texts([value for value in values if not isinstance(value, (str, bool))]))
        return [_TRUTH[value] if isinstance(value, bool) else value if isinstance(value, str) else next(numbers)
                for value in values]  # fmt: skip


_POSITION = ("x", "y")  # names of columns
_TRUTH = {True: "yes", False: "no"}


@dataclass(frozen=True)
class Table:
    """Table with a name and a title.

    The name is for files and JSON, the title for people. Its rows have numbers in SI, "" for none. If rows have units
    of their own, `row_units` are shown in the column "unit", and apply to the columns of dimensionless numbers before
    it.
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
        """Return the table as CSV with SI values.

        Values have full precision. Texts have the minus sign of ASCII.
        """
        buffer = io.StringIO()
        writer = csv.writer(buffer, lineterminator="\n")
        writer.writerow(column.key for column in self.columns)
        writer.writerows(self.rows)
        return buffer.getvalue().replace("−", "-")

    def records(self) -> list[dict[str, Value]]:
        """Return the rows as mappings for JSON.

        They have SI values in full precision.
        """
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
        """Return the table without columns that are empty everywhere."""
        used = [k for k in range(len(self.columns)) if any(row[k] != "" for row in self.rows)]
        rows = tuple(tuple(row[k] for k in used) for row in self.rows)
        return replace(self, columns=tuple(self.columns[k] for k in used), rows=rows)

    def brief(self) -> Table:
        """Return the table for the page, without redundant columns.

        Left out are columns that are empty or zero in every row, or repeat the numbers of an earlier column of the same
        unit. The files have all. A position keeps x and y unless they are zero.
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
    """Test whether two columns of numbers agree to rounding."""
    return all(
        isinstance(a, float) and isinstance(b, float) and math.isclose(a, b, rel_tol=1e-12)
        for a, b in zip(values, others, strict=True)
    )


def dataset_table(
    name: str, title: str, dataset: xr.Dataset, variables: Sequence[str], shown: Mapping[str, DisplayUnit] | None = None
) -> Table:
    """Make a table of variables of a dataset in SI.

    Also shows their coordinates, with their ``long_name`` and ``units``. There is a row for each combination of their
    coordinates. The dimension that is named first changes slowest. Numbers that are not finite are left empty. `shown`
    has units for the page if the customary units do not fit, such as %.

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
    """SI unit of a variable.

    It is empty for text and truth values.
    """
    return str(variable.attrs.get("units", "1")) if variable.dtype.kind in "fiu" else ""


def cell(value: object) -> Value:
    """Return a value of a table.

    A number that is not finite is left empty.
    """
    if isinstance(value, (str, bool, int)):
        return value
    number = float(np.asarray(value))
    return number if math.isfinite(number) else ""


def root_mean_square(values: npt.NDArray[np.float64]) -> Value:
    """Return the root mean square of finite numbers.

    It is a value of a table, empty without numbers.
    """
    return cell(np.hypot.reduce(values / np.sqrt(len(values)))) if len(values) else ""  # avoids squares that overflow


def coil_table(design: Design, coupling: xr.Dataset) -> Table:
    """Return a table of the coils.

    A row for each has its values alone, and with its neighbours as terminated.
    """
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
    """Return a table of pairs of coils.

    A row for each active coil and other coil has the coupling, also without sheets and plates.
    """
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
    """Return a table of all values of the design.

    Assumed values have their reason. On a board without elastomer its keys are left out, unless they are given.
    """
    rows = []
    for key, value in file.values.items():
        if not file.design.sheets and key.rpartition(".")[2].startswith("elastomer") and key not in file.given:
            continue
        origin = "assumed" if key in file.assumed else "given" if key in file.given else "default"
        rows.append((key, _plain(value), origin, file.assumed.get(key, "")))
    return Table("design", "Design", tuple(map(Column, ("key", "value", "origin", "reason"))), tuple(rows))


def rules_table(margins: Sequence[Margin]) -> Table:
    """Return a table of margins, in the order of `check_rules`.

    A margin of the whole board has no place.
    """
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
    """Return a table of B_z per ampere.

    The active coil carries the current. There is a column for each field, named after the state of the other coils.
    """
    columns = (
        Column("x", unit="m"),
        *(Column(f"Bz_{of.replace('others as', 'as').replace(' ', '_')}", f"B_z, {of}", "T/A") for of in fields),
    )
    values = (field.B.sel(component="z").values.ravel().tolist() for field in fields.values())
    rows = tuple(zip(next(iter(fields.values())).x.values.tolist(), *values, strict=True))
    return Table("field_line", "B_z along a line", columns, rows)


def _plain(value: object) -> str:
    """Write a value as in a design file.

    Lists have no brackets.
    """
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, (list, tuple)):
        return ", ".join(_plain(item) if not isinstance(item, (list, tuple)) else f"[{_plain(item)}]" for item in value)
    return f"{value:g}" if isinstance(value, float) else str(value)
