"""Tables of ports, their links, resonances and standard capacitors."""

import numpy as np
import xarray as xr

from coilarray.circuit.matching import TOLERANCES, Series, capacitors, tolerance_corners, with_standard_values
from coilarray.circuit.ports import PortCircuit, port_impedance, power_transfer, scattering
from coilarray.compute.arrays import ComplexArray
from coilarray.compute.display_units import PERCENT, DisplayUnit
from coilarray.compute.table import Column, Table, Value, cell, dataset_table
from coilarray.design.model import Design

SWEPT = (0.7, 1.4)
"""Ends of a sweep, over the frequency of the link."""
_ROUNDING = 1e-3  # of an impedance, smaller reactances are what remains of larger ones known to 1e-4
_OHMS = DisplayUnit("Ω", 1.0, 4, significant=True)
_FOUR = DisplayUnit(digits=4)
_NUMBER = DisplayUnit(digits=4, significant=True)


def port_table(design: Design, solved: xr.Dataset) -> Table:
    """Return the ports with their impedances at the link's frequency."""
    at = solved.sel(frequency=solved.attrs["link_frequency_Hz"])
    columns = (
        *map(Column, ("port", "kind")),
        Column("resistance", unit="ohm", shown=_OHMS),
        *(Column(f"{kind}_capacitance", unit="F") for kind in ("series", "parallel")),
        *(Column(f"input_{part}", unit="ohm", shown=_OHMS) for part in ("resistance", "reactance")),
        Column("reflection", "|S| there", "1", _FOUR),
    )
    active = solved.port.values.tolist()
    rows: list[tuple[Value, ...]] = []
    for port in design.circuit.ports:
        kind = "tank" if port.resistance is None else "load" if port.source_resistance is None else "source"
        found: tuple[Value, ...] = ("", "", "")
        if port.coil in active:
            own = at.sel(port=port.coil, other=port.coil)
            reflection = float(np.hypot(own.s_real, own.s_imag))
            R, X = float(own.input_resistance), float(own.input_reactance)
            found = R, X if abs(X) > _ROUNDING * R else 0.0, reflection
        given = ("" if value is None else value for value in (port.resistance, *port.capacitances))
        rows.append((port.coil, kind, *given, *found))
    frequency = f"{solved.attrs['link_frequency_Hz'] * 1e-6:.6g}"
    return Table("ports", f"Ports at {frequency} MHz", columns, tuple(rows))


def link_table(solved: xr.Dataset) -> Table:
    """Return efficiencies from sources to loads at the link's frequency."""
    names = (
        "source", "load", "efficiency", "available_efficiency", "voltage_ratio", "kq", "best_efficiency",
        "best_load_resistance", "best_load_reactance",
    )  # fmt: skip
    shares = ("efficiency", "available_efficiency", "best_efficiency")
    shown = dict.fromkeys(shares, PERCENT) | dict.fromkeys(names[-2:], _OHMS) | dict.fromkeys(names[4:6], _NUMBER)
    if "efficiency" not in solved:
        return Table("links", "Links", (Column("source"),), ())
    at = solved.sel(frequency=solved.attrs["link_frequency_Hz"], drop=True)
    return dataset_table("links", "Links", at, names, shown)


def mode_table(solved: xr.Dataset) -> Table:
    """Return the resonances of the ports near the link's frequency."""
    columns = Column("mode_frequency", "resonance", "Hz"), Column("quality", "quality factor", "1", _NUMBER)
    values = zip(solved.mode_frequency.values.tolist(), solved.mode_quality.values.tolist(), strict=True)
    return Table("modes", "Resonances of the ports", columns, tuple((f, cell(Q)) for f, Q in values))


def sweep_table(solved: xr.Dataset) -> Table:
    """Return one row for each frequency and pair of ports."""
    names = ("frequency", "port", "other", "s_real", "s_imag", "input_resistance", "input_reactance")
    return dataset_table("s_parameters", "S-parameters", solved, names)


def capacitor_tables(circuit: PortCircuit, impedance: ComplexArray, series: Series) -> tuple[Table, Table]:
    """Return exact and standard capacitors, and the results with them."""
    standard = with_standard_values(circuit, series)
    rows = tuple(
        (coil, kind, C, near)
        for (coil, kind, C), (_, _, near) in zip(capacitors(circuit), capacitors(standard), strict=True)
    )
    exact, nearest = Column("exact", unit="F"), Column("nearest", f"nearest of {series}", "F")
    columns = (*map(Column, ("port", "capacitor")), exact, nearest)
    tolerance = TOLERANCES[series]
    corners = np.array([_reached(one, impedance) for one in tolerance_corners(standard, tolerance)])
    worst = corners[:, 0].max(), corners[:, 1].min(), corners[:, 2].min()
    results = (
        ("exact", _reached(circuit, impedance)),
        (f"nearest of {series}", _reached(standard, impedance)),
        (f"worst within ±{100 * tolerance:g} %", worst),
    )
    of_results = (
        Column("capacitors"),
        Column("reflection", "largest |S| of a source", "1", _FOUR),
        Column("efficiency", "least efficiency", "1", PERCENT),
        Column("available_efficiency", "least share of the available power", "1", PERCENT),
    )
    return (
        Table("capacitors", "Capacitors", columns, rows),
        Table("results", "Results", of_results, tuple((name, *map(cell, values)) for name, values in results)),
    )


def _reached(circuit: PortCircuit, impedance: ComplexArray) -> tuple[float, float, float]:
    """Largest reflection at a source, and least efficiencies, infinite for none."""
    Z = port_impedance(circuit, impedance, circuit.frequency)
    own = np.abs(np.diagonal(scattering(Z, circuit.resistances)))[circuit.sources]
    if not (circuit.sources and circuit.loads):
        return float(own.max(initial=0.0)), np.inf, np.inf
    moved = power_transfer(circuit, Z)
    return float(own.max()), float(moved.efficiency.min()), float(moved.available_efficiency.min())
