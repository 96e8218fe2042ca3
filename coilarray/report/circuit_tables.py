"""Tables of the circuit: states, windings, limits of the converter, frequency sweep."""

from __future__ import annotations

from collections.abc import Sequence

import xarray as xr

from coilarray.circuit.converter_limits import RESISTANCE, check_channel, drive_for
from coilarray.circuit.impedance import CLOSE_CHANNELS
from coilarray.circuit.readability import with_reasons
from coilarray.compute.display_units import KILOHM, PER_MILLION, DisplayUnit
from coilarray.compute.table import Column, Table, Value, cell, dataset_table
from coilarray.hardware import settle_count

_ALIKE = 1e-6  # relative distance of frequencies that is only rounding


def winding_table(scan: xr.Dataset) -> Table:
    """Return a table of the coils' windings.

    A row for each coil has the contribution of its winding to the inductance and the direct-current resistance.
    """
    frequency = (
        (),
        scan.attrs["ac_resistance_frequency_Hz"],
        {"units": "Hz", "long_name": "frequency of the AC resistance"},
    )
    names = (
        "coil", "ac_resistance_frequency", "ac_resistance", "resistance_model", "winding_capacitance",
        "self_resonance", "bare_winding_capacitance", "elastomer_delta", "dent_delta_bound",
    )  # fmt: skip
    shown = dict.fromkeys(("elastomer_delta", "dent_delta_bound"), PER_MILLION)
    scan = scan.assign(ac_resistance_frequency=frequency)
    return dataset_table("windings", "Windings", scan, [name for name in names if name in scan], shown)


def state_table(scan: xr.Dataset) -> Table:
    """Return a table of all states of the scan.

    The values of each row are where the converter oscillates.
    """
    names = (
        "state", "frequency", "effective_inductance", "effective_resistance", "resistance_ratio", "quality_factor",
        "loaded_quality_factor", "parallel_resistance", *(["part_frequency"] if "part_frequency" in scan else []),
    )  # fmt: skip
    scan, read = with_reasons(scan)
    return dataset_table("states", "States", scan, (*names, *read), {"parallel_resistance": KILOHM})


def close_line(pairs: Sequence[tuple[str, str, float]]) -> str:
    """Describe the effect of channels with close frequencies.

    The pairs are from `coilarray.circuit.impedance.close_channels`. Empty for no pairs.
    """
    if not pairs:
        return ""
    one, other, distance = pairs[0]
    closest = "even alike" if distance < _ALIKE else f"the closest with {100 * distance:.2g} %"
    which = f"{len(pairs)} pairs of states are closer" if len(pairs) > 1 else "one pair of states is closer"
    return (
        "The converter measures one state after another, so that states may have equal frequencies. Only if several "
        f"converters measured at the same time would they need {100 * CLOSE_CHANNELS:g} % between them; {which}, "
        f"{one} and {other} {closest}."
    )


def state_current_table(scan: xr.Dataset) -> Table:
    """Return one row for each state and coil."""
    names = ("state", "coil", "current_real", "current_imag")
    return dataset_table("state_currents", "Currents in each state", scan, names)


def limit_table(scan: xr.Dataset) -> Table:
    """Return a table of states and limits of an LDC1614.

    It has no rows for a design without a converter.
    """
    four = DisplayUnit(digits=4)
    columns = (
        *map(Column, ("state", "limit")),
        *(Column(name, label, "1", four) for name, label in (("value", "value"), ("low", "from"), ("high", "to"))),
        Column("kept"),
    )
    rows = tuple(
        (state, limit.name, limit.value, limit.low, cell(limit.high), limit.kept)
        for state, *resonator in _resonators(scan)
        for limit in check_channel(*resonator)
    )
    return Table("ldc1614", "LDC1614", columns, rows, mark="no")


def _resonators(scan: xr.Dataset) -> list[tuple[str, float, float, float, float]]:
    """State, frequency, R_p, Q and self-resonance of all resonators.

    They are in SI. Empty without a converter.
    """
    if "readable" not in scan:
        return []
    names = ("frequency", "parallel_resistance", "loaded_quality_factor", "state_self_resonance")
    values = [scan[name].values.tolist() for name in names]
    return list(zip(scan.state.values.tolist(), *values, strict=True))


def drive_table(scan: xr.Dataset) -> Table:
    """Return a table of the sensor drive settings.

    A row for each state has the setting of the LDC1614's sensor drive and the least settling count.
    """
    columns = (
        Column("state"),
        Column("idrive_code", "IDRIVE"),
        Column("drive_current", unit="A"),
        Column("amplitude", "peak amplitude", "V"),
        Column("settle_count", "SETTLECOUNT, at least", "1"),
    )
    rows: list[tuple[Value, ...]] = []
    for state, f, R_p, Q, _ in _resonators(scan):
        drive = drive_for(R_p) if RESISTANCE[0] <= R_p <= RESISTANCE[1] else None
        setting = ("none fits", "", "") if drive is None else (str(drive.code), drive.current, drive.amplitude)
        rows.append((state, *setting, settle_count(f, Q)))
    return Table("ldc1614_drive", "Drive of the LDC1614", columns, tuple(rows))


def sweep_table(sweep: xr.Dataset) -> Table:
    """Return one row for each frequency and state."""
    names = ("frequency", "state", "impedance_real", "impedance_imag", "apparent_inductance", "quality_factor")
    return dataset_table("sweep", "Impedance over frequency", sweep, names)
