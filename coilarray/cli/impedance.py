"""``coilarray impedance``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from coilarray.cli.maps import check_file
from coilarray.cli.shared import (
    AllowViolations,
    AsJson,
    DesignArgument,
    open_design,
    print_json,
    print_table,
    progress_bar,
)
from coilarray.errors import GeometryError

_MOST_POINTS = 10_000


def impedance(
    design: DesignArgument = None,
    from_mhz: Annotated[float, typer.Option("--from-MHz", help="Lowest frequency of the sweep.")] = 0.1,
    to_mhz: Annotated[float, typer.Option("--to-MHz", help="Highest frequency of the sweep.")] = 10.0,
    points: Annotated[int, typer.Option("--points", help="Frequencies, evenly spaced on a logarithmic scale.")] = 50,
    out: Annotated[Path | None, typer.Option("--out", "-o", help="Also write the sweep: .nc or .csv.")] = None,
    plot: Annotated[Path | None, typer.Option("--plot", help="Also draw L over frequency: .png, .svg or .pdf.")] = None,
    as_json: AsJson = False,
    allow_violations: AllowViolations = False,
) -> None:
    """Solve the circuit: resonance of every state, and impedance over frequency.

    With AC resistance, the capacitance of the windings and the switches, for each state of the design's scan plan.

    Example: coilarray impedance gast2020 --from-MHz 0.5 --to-MHz 5 --out sweep.csv --plot sweep.png
    """
    if not 1e-6 <= from_mhz < to_mhz <= 1e6:
        raise GeometryError(f"--from-MHz must be at least 1e-06 and below --to-MHz; got {from_mhz:g} and {to_mhz:g}.")
    if not 2 <= points <= _MOST_POINTS:
        raise GeometryError(f"--points must be 2 to {_MOST_POINTS}; got {points}.")
    check_file("--out", out, (".nc", ".csv"))
    check_file("--plot", plot, (".png", ".svg", ".pdf"))
    import numpy as np

    from coilarray.circuit.impedance import close_channels, scan_design, sweep_design
    from coilarray.compute.files import write_atomically, write_text
    from coilarray.compute.netcdf import save_dataset
    from coilarray.report.circuit_tables import (
        drive_table,
        limit_table,
        state_current_table,
        state_table,
        sweep_table,
        winding_table,
    )

    opened = open_design(design, allow_violations=allow_violations)
    with progress_bar("states") as progress:
        scan = scan_design(opened, progress=progress)
    with progress_bar(f"impedance at {points} frequencies") as progress:
        sweep = sweep_design(opened, np.geomspace(from_mhz * 1e6, to_mhz * 1e6, points), progress=progress)
    if out is not None and out.suffix.lower() == ".nc":
        save_dataset(sweep, out)
    elif out is not None:
        write_text(out, sweep_table(sweep).csv())
    if plot is not None:
        from matplotlib.figure import Figure

        from coilarray.viz import plot_frequency_sweep

        ax = plot_frequency_sweep(sweep)
        assert isinstance(ax.figure, Figure)
        write_atomically(plot, ax.figure.savefig)
    states, limits = state_table(scan), limit_table(scan)
    close = close_channels(scan.state.values.tolist(), scan.frequency.values)
    if as_json:
        print_json(
            {
                "design": opened.name,
                "design_hash": opened.digest,
                "states": states.records(),
                "windings": winding_table(scan).records(),
                "state_currents": state_current_table(scan).records(),
                "capacitance_F": scan.capacitance.values.tolist(),
                "ldc1614_drive": drive_table(scan).records(),
                "ldc1614": limits.records(),
                "close_channels": [{"states": [a, b], "relative_distance": d} for a, b, d in close],
                "sweep": sweep_table(sweep).records(),
            }
        )
        return
    for table in (states, winding_table(scan), drive_table(scan)):
        print_table([column.header for column in table.columns], table.cells())
        typer.echo()
    broken = [row for row in limits.rows if not row[-1]]
    for state, limit, value, low, high, _ in broken:
        typer.echo(
            f"LDC1614, {state}: {limit} is {value:.4g}, allowed {low:g} to {high if high == '' else f'{high:g}'}"
        )
    if not broken:
        typer.echo("LDC1614: all limits are kept")
    if close:
        a, b, distance = close[0]
        typer.echo(
            f"warning: {len(close)} pairs of states are closer than 3 % in frequency (closest {a} and {b}, "
            f"{distance * 100:.2g} %): harmless one after another, not at the same time"
        )
    for path in (out, plot):
        if path is not None:
            typer.echo(f"wrote {path}")
