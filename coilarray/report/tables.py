"""Tables of coils, pairs, the design, its rules and the field along a line."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from coilarray.compute.display_units import PERCENT, DisplayUnit
from coilarray.compute.table import Column, Table, dataset_table
from coilarray.design.model import Design, DesignFile
from coilarray.geometry import Margin

if TYPE_CHECKING:
    import xarray as xr


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
    return Table(
        "design", "Design", tuple(map(Column, ("key", "value", "origin", "reason"))), tuple(rows), mark="assumed"
    )


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
    return Table("rules", "Fabrication rules", columns, rows, units, mark="no")


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
