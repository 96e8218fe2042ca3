"""The circuit's numbers as tables: states, windings, limits of the converter, frequency sweep."""

from __future__ import annotations

import math

import xarray as xr

from coilarray.hardware import check_channel, drive_for, settle_count
from coilarray.report.tables import Column, Table, Value, crossed_rows


def winding_table(scan: xr.Dataset) -> Table:
    """One row a coil: what its winding adds to L and the direct-current resistance."""
    columns = (
        Column("coil", "coil"),
        Column("ac_resistance_frequency_Hz", "at f (MHz)", 1e-6, 3),
        Column("ac_resistance_ohm", "R ac (Ω)", 1, 2),
        Column("resistance_model", "model of R"),
        Column("winding_capacitance_F", "C of the winding (pF)", 1e12, 2),
        Column("self_resonance_Hz", "self-resonance (MHz)", 1e-6, 3),
        Column("bare_winding_capacitance_F", "C without elastomer (pF)", 1e12, 2),
        Column("elastomer_delta", "δ of laying it on (10⁻⁶)", 1e6, 1),
        Column("dent_delta_bound", "δ of a dent, at most (10⁻⁶)", 1e6, 2),
    )
    rows: tuple[tuple[Value, ...], ...] = tuple(
        (
            str(name),
            float(scan.attrs["ac_resistance_frequency_Hz"]),
            float(scan.ac_resistance[k]),
            str(scan.resistance_model.values[k]),
            float(scan.winding_capacitance[k]),
            float(scan.self_resonance[k]),
            float(scan.bare_winding_capacitance[k]),
            float(scan.elastomer_delta[k]),
            float(scan.dent_delta_bound[k]),
        )
        for k, name in enumerate(scan.coil.values)
    )
    return Table("windings", "Windings", columns, rows)


def state_table(scan: xr.Dataset) -> Table:
    """One row a state of the scan, where the converter oscillates."""
    columns = (
        Column("state", "state"),
        Column("frequency_Hz", "f (MHz)", 1e-6, 4),
        Column("effective_inductance_H", "L_eff (µH)", 1e6, 3),
        Column("effective_resistance_ohm", "R_eff (Ω)", 1, 2),
        Column("resistance_ratio", "R_eff ac/dc", 1, 3),
        Column("quality_factor", "Q of the coil", 1, 1),
        Column("loaded_quality_factor", "Q with the tank", 1, 1),
        Column("parallel_resistance_ohm", "R_p (kΩ)", 1e-3, 2),
    )
    names = (
        "frequency", "effective_inductance", "effective_resistance", "resistance_ratio", "quality_factor",
        "loaded_quality_factor", "parallel_resistance",
    )  # fmt: skip
    rows: tuple[tuple[Value, ...], ...] = tuple(
        (str(state), *(float(scan[name].values[k]) for name in names)) for k, state in enumerate(scan.state.values)
    )
    return Table("states", "States", columns, rows)


def state_current_table(scan: xr.Dataset) -> Table:
    """One row for each state and coil."""
    columns = (
        Column("state", "state"),
        Column("coil", "coil"),
        Column("current_real", "i, in phase (A/A)", 1, 5),
        Column("current_imag", "i, quadrature (A/A)", 1, 5),
    )
    rows = crossed_rows(scan, "state", "coil", ("current_real", "current_imag"))
    return Table("state_currents", "Currents in each state", columns, rows)


def limit_table(scan: xr.Dataset) -> Table:
    """One row for each state and limit of an LDC1614, with the drive setting it asks for."""
    columns = (
        Column("state", "state"),
        Column("limit", "limit"),
        Column("value", "value", 1, 4),
        Column("low", "from", 1, 4),
        Column("high", "to", 1, 4),
        Column("kept", "kept"),
    )
    rows: list[tuple[Value, ...]] = []
    for state, f, R_p, Q, srf in _resonators(scan):
        for limit in check_channel(f, R_p, Q, srf):
            high = "" if math.isinf(limit.high) else limit.high
            rows.append((state, limit.name, limit.value, limit.low, high, limit.kept))
    return Table("ldc1614", "LDC1614", columns, tuple(rows))


def _resonators(scan: xr.Dataset) -> list[tuple[str, float, float, float, float]]:
    """State, frequency, R_p, Q of the resonator and self-resonance, in SI."""
    names = ("frequency", "parallel_resistance", "loaded_quality_factor", "state_self_resonance")
    values = [scan[name].values.tolist() for name in names]
    return list(zip(scan.state.values.tolist(), *values, strict=True))


def drive_table(scan: xr.Dataset) -> Table:
    """One row a state: setting of the LDC1614's sensor drive and least settling count."""
    columns = (
        Column("state", "state"),
        Column("idrive_code", "IDRIVE"),
        Column("drive_current_A", "drive (µA)", 1e6, 0),
        Column("amplitude_V", "amplitude (V peak)", 1, 2),
        Column("settle_count", "SETTLECOUNT, at least", 1, 0),
    )
    rows: list[tuple[Value, ...]] = []
    for state, f, R_p, Q, _ in _resonators(scan):
        drive = drive_for(R_p)
        setting: tuple[Value, ...] = ("none fits", "", "") if drive is None else (
            str(drive.code), drive.current, drive.amplitude
        )  # fmt: skip
        rows.append((state, *setting, float(settle_count(f, Q))))
    return Table("ldc1614_drive", "Drive of the LDC1614", columns, tuple(rows))


def sweep_table(sweep: xr.Dataset) -> Table:
    """One row for each frequency and state."""
    columns = (
        Column("frequency_Hz", "f (MHz)", 1e-6, 4),
        Column("state", "state"),
        Column("impedance_real_ohm", "Re Z (Ω)", 1, 3),
        Column("impedance_imag_ohm", "Im Z (Ω)", 1, 2),
        Column("apparent_inductance_H", "L (µH)", 1e6, 3),
        Column("quality_factor", "Q", 1, 2),
    )
    names = ("impedance_real", "impedance_imag", "apparent_inductance", "quality_factor")
    rows = crossed_rows(sweep, "frequency", "state", names)
    return Table("sweep", "Impedance over frequency", columns, rows)
