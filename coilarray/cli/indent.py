"""``coilarray indent``."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal

import typer

from coilarray import viz
from coilarray.cli import shared
from coilarray.errors import ElastomerError

# what the dent depends on; the rest of [indentation] says where it is made
_ENTERING = (
    "thickness_mm", "youngs_modulus_kPa", "poissons_ratio", "strain", "base", "seat_stiffness_kPa_per_mm",
    "seat_shear_kPa_per_mm", "depths_mm", "sample_radius_mm",
)  # fmt: skip


def indent(
    design: shared.DesignArgument = None,
    depth_mm: shared.Depths = None,
    base: Annotated[
        Literal["bonded", "frictionless"] | None,
        typer.Option(help="How the lowest sheet is held on the board, instead of what the design says."),
    ] = None,
    strain: Annotated[
        Literal["finite", "linear"] | None,
        typer.Option(help="Large deformations, or linear elasticity (faster), instead of what the design says."),
    ] = None,
    out: Annotated[
        Path | None, shared.out_option("Also write .nc (all interfaces) or .csv (the table).", ".nc", ".csv")
    ] = None,
    plot: Annotated[Path | None, shared.plot_option("the deepest dent and, for several depths, the force")] = None,
    force: shared.Force = False,
    as_json: shared.AsJson = False,
) -> None:
    """Compute the dent and the force of the indenter.

    The indenter has no friction. The table has the displacement of each sheet's upper face on the axis, and the height
    of the ring, the highest rise of the free surface. A rectangular sample counts as wide, and its seat as even.

    Example: coilarray indent gast2020 --depth-mm 0.1:1:10 --plot dent.png --out dent.csv
    """
    depths = shared.lengths("--depth-mm", depth_mm)
    if depths is not None and depths[0] <= 0:
        raise ElastomerError(f"--depth-mm must be above zero; got {depth_mm!r}.")
    from coilarray.circuit.coupling import provenance
    from coilarray.design.model import load_design_file
    from coilarray.report.indentation_tables import indentation_table
    from coilarray.report.tables import design_table
    from coilarray.response.setup import contact_at, indentation_of

    file = load_design_file(design)
    opened = file.design
    setup = indentation_of(opened)
    setup = replace(setup, base=base or setup.base, strain=strain or setup.strain, depths=tuple(depths or setup.depths))
    result = contact_at(setup, opened.sheets, setup.depths).assign_attrs(provenance(opened))
    how = f"base {setup.base}, {setup.strain} strain"
    table = replace(indentation_table(result), title=f"{setup.indenter.name}, {how}")
    shared.write_numbers(out, result, table.csv)
    shared.draw(plot, lambda: viz.indentation_figure(result, setup.indenter))
    on_seat = ("base", "seat_stiffness_kPa_per_mm", "seat_shear_kPa_per_mm")
    replaced = {
        "depths_mm": depths is not None,
        "strain": strain is not None,
        **dict.fromkeys(on_seat, base is not None),
    }
    not_given = [
        row
        for row in design_table(file).records()
        if row["origin"] != "given" and _enters(str(row["key"])) and not replaced.get(str(row["key"]).split(".")[-1])
    ]
    lines = [": ".join(filter(None, (f"{row['origin']}", f"{row['key']} = {row['value']}", f"{row['reason']}")))
             for row in not_given]  # fmt: skip
    if setup.sample_bounds is not None:
        lines.insert(
            0,
            "The sample counts as wide here, on an even seat that holds it; responses include its sides and its seat.",
        )
    data = {
        **shared.design_record(opened),
        "indenter": setup.indenter.name,
        "base": str(setup.base),
        "strain": setup.strain,
        "dents": table.records(),
        "not_given": [{**row, "value": file.values[str(row["key"])]} for row in not_given],
    }
    shared.print_result(data, as_json=as_json, tables=[table], titles=True, lines=lines, files=(out, plot))


def _enters(key: str) -> bool:
    """Tell whether a key of the design enters the dent."""
    return key.startswith("indenter.") or (
        key.startswith(("elastomer.", "indentation.")) and key.split(".")[-1] in _ENTERING
    )
