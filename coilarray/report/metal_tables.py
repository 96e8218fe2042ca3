"""Tables of metal near the coils: the plates and their effect on every state."""

from __future__ import annotations

import math
from collections.abc import Mapping

import xarray as xr

from coilarray.circuit.board_circuit import board_circuit
from coilarray.compute.display_units import MM, PERCENT, DisplayUnit
from coilarray.compute.table import Column, Table, Value, dataset_table
from coilarray.design.model import Design
from coilarray.geometry import FinitePlate
from coilarray.metal.finite_plates import PlateError

_CONDUCTIVITY = DisplayUnit("MS/m", 1e-6, 4, significant=True)
_SHORT = DisplayUnit("mm", 1e3, 3, significant=True)
_RATIO = DisplayUnit(digits=3, significant=True)
_COMPARED = {
    "effective_inductance": "L_eff", "effective_resistance": "R_eff", "quality_factor": "Q", "frequency": "f"
}  # fmt: skip


def plate_table(design: Design, frequency: float) -> Table:
    """Return a table of the plates and their skin depths.

    A row for each plate has its place, material, and its skin depth at a frequency in Hz. If there are finite plates,
    it also has the errors of their ΔL and ΔR, by mesh and model.
    """
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
        rows.append(
            (
                plate.name, outline, plate.heights[0], plate.thickness, material.words,
                *("" if not math.isfinite(number) else number for number in numbers),
                *_errors(errors, plate.name),
            )
        )  # fmt: skip
    return Table("plates", "Plates", columns, tuple(rows))


def _errors(errors: Mapping[str, PlateError], name: str) -> tuple[Value, ...]:
    """Cells of the errors of a plate.

    They are empty for an infinite plate. There are no cells if all plates are infinite.
    """
    if name in errors:
        return errors[name].inductance, errors[name].resistance
    return ("", "") if errors else ()


def beside_plates_table(scan: xr.Dataset, without: xr.Dataset) -> Table:
    """Return a table of states with and without the plates.

    A row for each state has L, R, Q and f, as the converter sees them.
    """
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
