"""Metal near the coils as tables: the plates, and what they do to every state of the scan."""

from __future__ import annotations

import math

import xarray as xr

from coilarray.compute.display_units import MM, PERCENT, DisplayUnit
from coilarray.design.model import Design
from coilarray.geometry import FinitePlate
from coilarray.report.tables import Column, Table, Value, dataset_table

_CONDUCTIVITY = DisplayUnit("MS/m", 1e-6, 4, significant=True)
_SHORT = DisplayUnit("mm", 1e3, 3, significant=True)
_RATIO = DisplayUnit(digits=3, significant=True)
_COMPARED = {
    "effective_inductance": "L_eff", "effective_resistance": "R_eff", "quality_factor": "Q", "frequency": "f"
}  # fmt: skip


def plate_table(design: Design, frequency: float) -> Table:
    """Return one row for each plate: its place, material, and its skin depth at a frequency in Hz."""
    columns = (
        *map(Column, ("plate", "outline")),
        Column("z", "lowest point at z", "m", MM),
        Column("thickness", unit="m", shown=_SHORT),
        Column("material"),
        Column("conductivity", unit="S/m", shown=_CONDUCTIVITY),
        Column("relative_permeability", "µr", "1", _RATIO),
        Column("skin_depth", unit="m", shown=_SHORT),
        Column("thickness_over_skin_depth", "thickness in skin depths", "1", _RATIO),
    )
    rows: list[tuple[Value, ...]] = []
    for plate in design.plates:
        outline = type(plate.outline).__name__.lower() if isinstance(plate, FinitePlate) else "infinite plate"
        material = plate.material
        depth = material.skin_depth(frequency)
        numbers = (material.conductivity, material.relative_permeability, depth, plate.thickness / depth)
        rows.append(
            (
                plate.name, outline, plate.heights[0], plate.thickness, material.words,
                *("" if not math.isfinite(number) else number for number in numbers),
            )
        )  # fmt: skip
    return Table("plates", "Plates", columns, tuple(rows))


def beside_plates_table(scan: xr.Dataset, without: xr.Dataset) -> Table:
    """Return one row for each state: L, R, Q and f beside the plates and without them, as the converter sees them."""
    rows: dict[str, xr.DataArray] = {}
    for name, words in _COMPARED.items():
        rows[name] = scan[name].assign_attrs(long_name=words)
        rows[f"{name}_without"] = without[name].assign_attrs(long_name=f"{words} without plates")
    change = scan.effective_inductance / without.effective_inductance - 1
    rows["plate_change"] = change.assign_attrs(long_name="change of L_eff", units="1")
    both = xr.Dataset(rows)
    names = ("state", *(one for name in _COMPARED for one in (name, f"{name}_without")), "plate_change")
    return dataset_table("beside_plates", "States beside the plates", both, names, {"plate_change": PERCENT})
