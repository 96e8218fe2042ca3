"""``coilarray matrix``."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from coilarray.cli import shared
from coilarray.errors import OutputError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from coilarray.compute.arrays import FloatArray

_MOST_COILS, _MOST_PAIRS = 24, 20  # of which matrices are printed; that are printed of more coils


def matrix(
    design: shared.DesignArgument = None,
    out: Annotated[
        Path | None,
        shared.out_option(
            "Also write the network: .nc (all), .csv (pairs), .cir or .sub (SPICE), .sNp or .inp (FastHenry)."
        ),
    ] = None,
    force: shared.Force = False,
    as_json: shared.AsJson = False,
    allow_violations: shared.AllowViolations = False,
) -> None:
    """Print the inductance and coupling matrices.

    Of more than 24 coils the strongest couplings are printed; --json and --out have all.

    Example: coilarray matrix gast2020 --json
    """
    if out is not None and not re.fullmatch(r"\.(nc|csv|cir|sub|inp|s\d+p)", out.suffix.lower()):
        raise OutputError(f"--out must end in .nc, .csv, .cir, .sub, .sNp or .inp; got {out}.")
    from coilarray.circuit.board_circuit import board_circuit
    from coilarray.circuit.coupling import couple_design
    from coilarray.circuit.fasthenry import fasthenry_input
    from coilarray.circuit.network import checked_network
    from coilarray.circuit.network_files import exchange_frequencies, export_network
    from coilarray.compute.files import write_text
    from coilarray.electromagnetics.inductance import coupling_matrix
    from coilarray.report.tables import coil_table, pair_table

    opened = shared.open_design(design, allow_violations=allow_violations)
    suffix = "" if out is None else out.suffix.lower()
    if suffix == ".inp" and opened.plates:
        raise OutputError(f"--out .inp cannot hold [[plate]], which {opened.name} has; write .cir or .sNp.")
    names = list(opened.array.names)
    with shared.progress_bar("inductance matrix") as progress:
        # two coils in one place are refused here, before any circuit
        inductance = checked_network(board_circuit(opened, progress=progress).inductance, 0.0)[0]
    circuit = board_circuit(opened)
    data: dict[str, object] = {**shared.design_record(opened), "names": names}
    if as_json or suffix in (".nc", ".csv", ".inp"):  # the matrices alone need no circuit, which takes longer
        coupling = couple_design(opened)
        data |= {
            "inductance_H": inductance.tolist(),
            "coupling": coupling.coupling.values.tolist(),
            "coils": coil_table(opened, coupling).records(),
            "pairs": pair_table(coupling).records(),
            **circuit.plate_error_attributes,
        }
        if suffix == ".inp" and out is not None:
            write_text(out, fasthenry_input(opened.array, [float(coupling.frequency.mean())], title=opened.name))
        elif suffix in (".nc", ".csv"):
            shared.write_numbers(out, coupling, pair_table(coupling).csv)
    if out is not None and suffix not in (".nc", ".csv", ".inp"):
        network = circuit.swept(exchange_frequencies(circuit.network))
        export_network(network, out, title=opened.name)
    lines: list[str] = []
    if not as_json:
        lines = shared.plate_error_lines(circuit.plate_error_attributes)
        _print_matrices(names, inductance, coupling_matrix(inductance))
    shared.print_result(data, as_json=as_json, lines=lines, files=[out])


def _print_matrices(names: Sequence[str], inductance: FloatArray, coupling: FloatArray) -> None:
    """Print both matrices; of one coil its inductance, and of many the pairs that couple most."""
    from coilarray.compute.display_units import DisplayUnit, display_unit

    henry, plain = display_unit("H"), DisplayUnit(digits=5)
    if len(names) == 1:
        typer.echo(shared.table_text(("coil", henry.label("L")), [[names[0], *henry.texts(inductance[0])]]))
        return
    if len(names) > _MOST_COILS:
        _print_strongest(names, inductance, coupling)
        return
    for title, values, unit in (("L and M", inductance, henry), ("\nk", coupling, plain)):
        rows = [[name, *unit.texts(row)] for name, row in zip(names, values.tolist(), strict=True)]
        typer.echo(shared.table_text(("", *names), rows, unit.label(title)))


def _print_strongest(names: Sequence[str], inductance: FloatArray, coupling: FloatArray) -> None:
    import numpy as np

    from coilarray.compute.display_units import DisplayUnit, display_unit

    henry, plain = display_unit("H"), DisplayUnit(digits=5)
    first, second = np.triu_indices(len(names), 1)
    order = np.argsort(-np.abs(coupling[first, second]), kind="stable")[:_MOST_PAIRS]
    first, second, count = first[order], second[order], first.size
    least, most = henry.texts([float(np.diag(inductance).min()), float(np.diag(inductance).max())])
    M, k = henry.texts(inductance[first, second].tolist()), plain.texts(coupling[first, second].tolist())
    pairs = [f"{names[a]} – {names[b]}" for a, b in zip(first.tolist(), second.tolist(), strict=True)]
    rows = list(zip(pairs, M, k, strict=True))
    typer.echo(f"L of {len(names)} coils: {least} to {most} {henry.symbol}\n")
    typer.echo(shared.table_text(("pair", henry.label("M"), "k"), rows, "the strongest couplings"))
    typer.echo(f"… and {count - len(rows)} more (--json, --out)")
