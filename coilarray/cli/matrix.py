"""``coilarray matrix``."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from coilarray.cli.shared import (
    AllowViolations,
    AsJson,
    DesignArgument,
    open_design,
    print_json,
    print_table,
    progress_bar,
)
from coilarray.errors import OutputError

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt


def matrix(
    design: DesignArgument = None,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", help="Also write .nc (all), .csv (pairs), .cir (SPICE), .sNp or .inp (FastHenry)."),
    ] = None,
    as_json: AsJson = False,
    allow_violations: AllowViolations = False,
) -> None:
    """Print the inductance and coupling matrices.

    Example: coilarray matrix gast2020 --json
    """
    if out is not None and not re.fullmatch(r"\.(nc|csv|cir|sub|inp|s\d+p)", out.suffix.lower()):
        raise OutputError(f"--out must end in .nc, .csv, .cir, .sub, .sNp or .inp; got {out}.")
    from coilarray.circuit.coupling import couple_design, design_circuit, design_inductance
    from coilarray.circuit.exchange import export_network, fasthenry_input
    from coilarray.compute.files import write_text
    from coilarray.compute.netcdf import save_dataset
    from coilarray.electromagnetics.inductance import coupling_matrix
    from coilarray.report.tables import coil_table, pair_table

    opened = open_design(design, allow_violations=allow_violations)
    names = list(opened.array.names)
    with progress_bar("inductance matrix") as progress:
        inductance = design_inductance(opened, progress)[0]
    suffix = "" if out is None else out.suffix.lower()
    if as_json or suffix in (".nc", ".csv", ".inp"):  # the matrices alone need no circuit, which takes longer
        coupling = couple_design(opened)
    if out is not None:
        if suffix == ".nc":
            save_dataset(coupling, out)
        elif suffix == ".csv":
            write_text(out, pair_table(coupling).csv())
        elif suffix == ".inp":
            frequencies = [float(coupling.frequency.mean())]
            write_text(out, fasthenry_input(opened.array, frequencies, title=opened.name))
        else:
            export_network(design_circuit(opened), out, title=opened.name)
    if as_json:
        print_json(
            {
                "design": opened.name,
                "design_hash": opened.digest,
                "names": names,
                "inductance_H": inductance.tolist(),
                "coupling": coupling.coupling.values.tolist(),
                "coils": coil_table(opened, coupling).records(),
                "pairs": pair_table(coupling).records(),
            }
        )
        return
    _print("L and M (µH)", names, inductance * 1e6, 4)
    typer.echo()
    _print("k", names, coupling_matrix(inductance), 5)
    if out is not None:
        typer.echo(f"wrote {out}")


def _print(title: str, names: list[str], values: npt.NDArray[np.float64], digits: int) -> None:
    rows = [[name, *(f"{value:.{digits}f}" for value in row)] for name, row in zip(names, values.tolist(), strict=True)]
    print_table(("", *names), rows, title)
