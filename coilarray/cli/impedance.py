"""``coilarray impedance``."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from coilarray import viz
from coilarray.cli import shared
from coilarray.errors import GeometryError, OutputError

if TYPE_CHECKING:
    import xarray as xr

    from coilarray.compute.table import Table
    from coilarray.design.model import Design

_FILES = r"\.(nc|csv|cir|sub|inp|s\d+p)"


def impedance(
    design: shared.DesignArgument = None,
    from_mhz: Annotated[
        float | None,
        typer.Option("--from-MHz", help="Lowest frequency of the sweep; a tenth of the resonance by default."),
    ] = None,
    to_mhz: Annotated[
        float | None, typer.Option("--to-MHz", help="Highest frequency; above resonance and self-resonance by default.")
    ] = None,
    points: Annotated[
        int,
        shared.number_option(("--points",), 2, 10_000, "Number of frequencies, evenly spaced on a logarithmic scale."),
    ] = 50,
    noise: Annotated[
        bool, typer.Option("--noise", help="Print the noise and drift of the readings, cause by cause, instead.")
    ] = False,
    reference: shared.References = None,
    out: Annotated[
        Path | None,
        shared.out_option("Also write the sweep: .nc, .csv; the network: .cir, .sub (SPICE), .sNp, .inp (FastHenry)."),
    ] = None,
    plot: Annotated[Path | None, shared.plot_option("L, R and Q over frequency, with both resonances")] = None,
    as_json: shared.AsJson = False,
    allow_violations: shared.AllowViolations = False,
) -> None:
    """Compute inductances, couplings, resonances and impedances.

    Prints the matrices of L, M and k (of more than 24 coils the strongest couplings), and for each
    state of the scan the circuit with AC resistance, winding capacitance and switches, with the
    limits of the converter.

    With --noise it prints every cause of noise instead: its noise in one scan, its drift per
    kelvin, its change since L_0 was read, and the source of the value. Values and settings are in
    the table [readout] of the design. `locate`, position errors and the ranges of targets assume
    the σ of δ at the end. `coilarray board info --noise` compares a recording with it.

    Example: coilarray impedance gast2020 --from-MHz 0.5 --to-MHz 5 --out sweep.csv --plot sweep.png

    Example: coilarray impedance gast2020 --noise --reference coil6
    """
    if out is not None and not re.fullmatch(_FILES, out.suffix.lower()):
        raise OutputError(f"--out must end in .nc, .csv, .cir, .sub, .sNp or .inp; got {out}.")
    shared.check_file("--out", out, None)
    _require_range(1e-6 if from_mhz is None else from_mhz, 1e6 if to_mhz is None else to_mhz)  # before any work
    if reference and not noise:
        raise GeometryError("--reference is for --noise.")
    opened = shared.open_design(design, allow_violations=allow_violations)
    if noise:
        _print_noise(opened, reference or [], as_json=as_json)
        return
    suffix = "" if out is None else out.suffix.lower()
    if suffix == ".inp" and opened.plates:
        raise OutputError(f"--out .inp cannot hold [[plate]], which {opened.name} has; write .cir or .sNp.")
    import numpy as np

    from coilarray.circuit.board_circuit import board_circuit
    from coilarray.circuit.coupling import (
        close_channels,
        couple_design,
        scan_design,
        sweep_design,
        sweep_frequencies,
        sweep_range,
    )
    from coilarray.circuit.network import checked_network
    from coilarray.report import circuit_tables
    from coilarray.report.tables import coil_table, matrix_tables, pair_table

    with shared.progress_bar("inductance matrix") as progress:
        # two coils in one place are refused here, before any circuit
        inductance = checked_network(board_circuit(opened, progress=progress).inductance, 0.0)[0]
    with shared.progress_bar("states") as progress:
        scan = scan_design(opened, progress=progress)
    errors = board_circuit(opened).plate_error_attributes
    low, high = (f * 1e-6 for f in sweep_range(scan))
    low, high = low if from_mhz is None else from_mhz, high if to_mhz is None else to_mhz
    _require_range(low, high)
    even = np.geomspace(low * 1e6, high * 1e6, points)
    frequencies = even if plot is None else sweep_frequencies(scan, points, (even[0], even[-1]))
    with shared.progress_bar(f"impedance at {frequencies.size} frequencies") as progress:
        curves = sweep_design(opened, frequencies, progress=progress)
    sweep = curves.sel(frequency=even)
    of_sweep = circuit_tables.sweep_table(sweep)
    if suffix in (".nc", ".csv"):
        shared.write_numbers(out, sweep, of_sweep.csv)
    elif out is not None:
        _write_network(opened, scan, out)
    shared.draw(plot, lambda: viz.frequency_figure(curves, scan))
    states, windings = circuit_tables.state_table(scan), circuit_tables.winding_table(scan)
    drives, limits = circuit_tables.drive_table(scan), circuit_tables.limit_table(scan)
    close = close_channels(scan.state.values.tolist(), scan.frequency.values)
    data: dict[str, object] = {**shared.design_record(opened), "names": list(opened.array.names)}
    if as_json:
        coupling = couple_design(opened)
        data |= {
            "inductance_H": inductance.tolist(),
            "coupling": coupling.coupling.values.tolist(),
            "coils": coil_table(opened, coupling).records(),
            "pairs": pair_table(coupling).records(),
            **errors,
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
    lines = [*shared.plate_error_lines(errors), *_limit_lines(limits, scan, opened)]
    lines += [circuit_tables.close_line(close)] if close else []
    lines += shared.left_out_lines(scan.attrs["left_out"])
    matrices = matrix_tables(list(opened.array.names), inductance)
    tables = [*matrices, states, windings, *([drives] if drives.rows else [])]
    shared.print_result(data, as_json=as_json, tables=tables, lines=lines, files=(out, plot))


def _limit_lines(limits: Table, scan: xr.Dataset, design: Design) -> list[str]:
    """Name the broken limits of the converter."""
    lines = [
        f"LDC1614, {state}: {limit} is {value:.4g}, allowed {low:g} to {high if high == '' else f'{high:g}'}"
        for state, limit, value, low, high, kept in limits.rows
        if not kept
    ]
    if limits.rows and not lines:
        without = " without the target (coilarray target has it with)" if design.target else ""
        so_far = "as far as these numbers go, " if scan.attrs["left_out"] else ""
        lines = [f"LDC1614: {so_far}all limits are kept{without}"]
    return lines


def _write_network(design: Design, scan: xr.Dataset, out: Path) -> None:
    """Write the network of a design for another program."""
    from coilarray.circuit.board_circuit import board_circuit
    from coilarray.circuit.coupling import couple_design
    from coilarray.circuit.network_files import exchange_frequencies, export_network, fasthenry_input
    from coilarray.compute.files import write_text

    if out.suffix.lower() == ".inp":
        frequency = float(couple_design(design).frequency.mean())
        write_text(out, fasthenry_input(design.array, [frequency], title=design.name))
    else:
        circuit = board_circuit(design)
        export_network(circuit.swept(exchange_frequencies(circuit.network)), out, title=design.name)


def _print_noise(design: Design, reference: list[str], *, as_json: bool) -> None:
    """Print the noise budget of a design."""
    from coilarray.circuit.noise_budget import noise_budget
    from coilarray.report.circuit_tables import budget_lines, noise_table, sigma_table

    budget = noise_budget(design)
    if reference:
        budget = budget.referenced(reference)
    data = {**shared.design_record(design), **budget.to_record()}
    tables = (noise_table(budget), sigma_table(budget))
    shared.print_result(data, as_json=as_json, tables=tables, lines=budget_lines(budget))


def _require_range(low: float, high: float) -> None:
    """Refuse frequencies in MHz that are no range."""
    if not 1e-6 <= low < high <= 1e6:
        raise GeometryError(f"--from-MHz must be at least 1e-06 and below --to-MHz; got {low:g} and {high:g}.")
