"""``coilarray impedance``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from coilarray import viz
from coilarray.cli import shared
from coilarray.errors import GeometryError


def impedance(
    design: shared.DesignArgument = None,
    from_mhz: Annotated[
        float | None,
        typer.Option("--from-MHz", help="Lowest frequency of the sweep; a tenth of the resonance by default."),
    ] = None,
    to_mhz: Annotated[
        float | None,
        typer.Option(
            "--to-MHz",
            help="Highest frequency; by default four times the resonance or the self-resonance, whichever is higher.",
        ),
    ] = None,
    points: Annotated[
        int,
        shared.number_option(("--points",), 2, 10_000, "Number of frequencies, evenly spaced on a logarithmic scale."),
    ] = 50,
    out: Annotated[Path | None, shared.out_option("Also write the sweep: .nc or .csv.", ".nc", ".csv")] = None,
    plot: Annotated[Path | None, shared.plot_option("L, R and Q over frequency, with both resonances")] = None,
    force: shared.Force = False,
    as_json: shared.AsJson = False,
    allow_violations: shared.AllowViolations = False,
) -> None:
    """Compute the resonances, and the impedance over frequency.

    Solves the circuit with AC resistance, winding capacitance and switches, for each state of the design's scan.

    Example: coilarray impedance gast2020 --from-MHz 0.5 --to-MHz 5 --out sweep.csv --plot sweep.png
    """
    _require_range(1e-6 if from_mhz is None else from_mhz, 1e6 if to_mhz is None else to_mhz)  # before any work
    import numpy as np

    from coilarray.circuit.impedance import close_channels, scan_design, sweep_design, sweep_frequencies, sweep_range
    from coilarray.report import circuit_tables

    opened = shared.open_design(design, allow_violations=allow_violations)
    with shared.progress_bar("states") as progress:
        scan = scan_design(opened, progress=progress)
    low, high = (f * 1e-6 for f in sweep_range(scan))
    low, high = low if from_mhz is None else from_mhz, high if to_mhz is None else to_mhz
    _require_range(low, high)
    even = np.geomspace(low * 1e6, high * 1e6, points)
    frequencies = even if plot is None else sweep_frequencies(scan, points, (even[0], even[-1]))
    with shared.progress_bar(f"impedance at {frequencies.size} frequencies") as progress:
        curves = sweep_design(opened, frequencies, progress=progress)
    sweep = curves.sel(frequency=even)
    of_sweep = circuit_tables.sweep_table(sweep)
    shared.write_numbers(out, sweep, of_sweep.csv)
    shared.draw(plot, lambda: viz.frequency_figure(curves, scan))
    states, windings = circuit_tables.state_table(scan), circuit_tables.winding_table(scan)
    drives, limits = circuit_tables.drive_table(scan), circuit_tables.limit_table(scan)
    close = close_channels(scan.state.values.tolist(), scan.frequency.values)
    data = {
        **shared.design_record(opened),
        "states": states.records(),
        "windings": windings.records(),
        "state_currents": circuit_tables.state_current_table(scan).records(),
        "capacitance_F": scan.capacitance.values.tolist() if "capacitance" in scan else None,
        "left_out": scan.attrs["left_out"],
        "ldc1614_drive": drives.records(),
        "ldc1614": limits.records(),
        "close_channels": [{"states": [a, b], "relative_distance": d} for a, b, d in close],
        "sweep": of_sweep.records(),
    }
    lines = [
        f"LDC1614, {state}: {limit} is {value:.4g}, allowed {low:g} to {high if high == '' else f'{high:g}'}"
        for state, limit, value, low, high, kept in limits.rows
        if not kept
    ]
    if limits.rows and not lines:
        without = " without the target (coilarray target has it with)" if opened.target else ""
        so_far = "as far as these numbers go, " if scan.attrs["left_out"] else ""
        lines = [f"LDC1614: {so_far}all limits are kept{without}"]
    if close:
        lines.append(circuit_tables.close_line(close))
    lines += shared.left_out_lines(scan.attrs["left_out"])
    tables = [states, windings, *([drives] if drives.rows else [])]
    shared.print_result(data, as_json=as_json, tables=tables, lines=lines, files=(out, plot))


def _require_range(low: float, high: float) -> None:
    """Refuse frequencies in MHz that are no range."""
    if not 1e-6 <= low < high <= 1e6:
        raise GeometryError(f"--from-MHz must be at least 1e-06 and below --to-MHz; got {low:g} and {high:g}.")
