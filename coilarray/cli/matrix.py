"""``coilarray matrix``."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated

from coilarray.cli import shared
from coilarray.errors import OutputError


def matrix(
    design: shared.DesignArgument = None,
    out: Annotated[
        Path | None,
        shared.out_option(
            "Also write the network: .nc (all), .csv (pairs), .cir or .sub (SPICE), .sNp or .inp (FastHenry)."
        ),
    ] = None,
    as_json: shared.AsJson = False,
    allow_violations: shared.AllowViolations = False,
) -> None:
    """Print the inductance and coupling matrices.

    Example: coilarray matrix gast2020 --json
    """
    if out is not None and not re.fullmatch(r"\.(nc|csv|cir|sub|inp|s\d+p)", out.suffix.lower()):
        raise OutputError(f"--out must end in .nc, .csv, .cir, .sub, .sNp or .inp; got {out}.")
    from coilarray.circuit.coupling import couple_design
    from coilarray.circuit.exchange import export_network, fasthenry_input
    from coilarray.compute.display_units import DisplayUnit, display_unit
    from coilarray.compute.files import write_text
    from coilarray.report.tables import coil_table, pair_table

    opened = shared.open_design(design, allow_violations=allow_violations)
    with shared.progress_bar("inductance matrix") as progress:
        coupling = couple_design(opened, progress=progress)
    suffix = "" if out is None else out.suffix.lower()
    if suffix in ("", ".nc", ".csv"):
        shared.write_numbers(out, coupling, pair_table(coupling).csv)
    elif out is not None and suffix == ".inp":
        write_text(out, fasthenry_input(opened.array, [float(coupling.frequency.mean())], title=opened.name))
    elif out is not None:
        export_network(coupling, out)
    if not as_json:
        names = coupling.coil.values.tolist()
        for title, matrix_of, unit in (
            ("L and M", coupling.inductance, display_unit("H")),
            ("\nk", coupling.coupling, DisplayUnit(digits=5)),
        ):
            rows = [[name, *unit.texts(row)] for name, row in zip(names, matrix_of.values.tolist(), strict=True)]
            shared.print_table(("", *names), rows, unit.label(title))
    data = {
        **shared.design_record(opened),
        "names": coupling.coil.values.tolist(),
        "inductance_H": coupling.inductance.values.tolist(),
        "coupling": coupling.coupling.values.tolist(),
        "coils": coil_table(opened, coupling).records(),
        "pairs": pair_table(coupling).records(),
    }
    shared.print_result(data, as_json=as_json, files=[out])
