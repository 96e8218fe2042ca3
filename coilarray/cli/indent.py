"""``coilarray indent``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, get_args

import typer

from coilarray.cli.shared import AsJson, DesignArgument, check_file, lengths, print_json, print_table
from coilarray.errors import ElastomerError

# what the dent depends on; the rest of [indentation] says where it is made
_ENTERING = ("thickness_mm", "youngs_modulus_kPa", "poissons_ratio", "base", "depths_mm", "sample_radius_mm")


def indent(
    design: DesignArgument = None,
    depth_mm: Annotated[
        str | None,
        typer.Option("--depth-mm", help="Depths, as 0.5,1,1.5 or START:STOP:COUNT; those of the design by default."),
    ] = None,
    base: Annotated[
        str | None,
        typer.Option("--base", help="bonded or frictionless, instead of the design's."),
    ] = None,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Also write .nc (all interfaces) or .csv (the table).")
    ] = None,
    plot: Annotated[
        Path | None,
        typer.Option(
            "--plot", help="Also draw the deepest dent and, of several depths, the force: .png, .svg or .pdf."
        ),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Press the indenter into the elastomer: force, contact and dent.

    Small strain, no friction under the indenter. Displacements are those of the upper faces of the sheets on the axis;
    the ring is the highest rise of the free surface.

    Example: coilarray indent gast2020 --depth-mm 0.1:1:10 --plot dent.png --out dent.csv
    """
    depths = None if depth_mm is None else _depths(depth_mm)
    check_file("--out", out, (".nc", ".csv"))
    check_file("--plot", plot, (".png", ".svg", ".pdf"))
    from coilarray.circuit.coupling import provenance
    from coilarray.compute.files import write_atomically, write_text
    from coilarray.compute.netcdf import save_dataset
    from coilarray.design.model import load_design_file
    from coilarray.elastomer.compliance import Base
    from coilarray.elastomer.contact import indent as press
    from coilarray.report.indentation_tables import indentation_table
    from coilarray.report.tables import design_table
    from coilarray.response.setup import indentation_of

    file = load_design_file(design)
    opened = file.design
    setup = indentation_of(opened)
    wanted = setup.base if base is None else base
    chosen = next((allowed for allowed in get_args(Base) if allowed == wanted), None)
    if chosen is None:
        raise ElastomerError(f"--base must be bonded or frictionless; got {base!r}.")
    result = press(opened.sheets, setup.indenter, depths or setup.depths, base=chosen, radius=setup.sample_radius)
    result = result.assign_attrs(provenance(opened))
    table = indentation_table(result)
    if out is not None and out.suffix.lower() == ".nc":
        save_dataset(result, out)
    elif out is not None:
        write_text(out, table.csv())
    if plot is not None:
        from coilarray.viz import indentation_figure

        write_atomically(plot, indentation_figure(result, setup.indenter).savefig)
    replaced = {"depths_mm": depths is not None, "base": base is not None}
    not_given = [
        row
        for row in design_table(file).records()
        if row["origin"] != "given" and _enters(str(row["key"])) and not replaced.get(str(row["key"]).split(".")[-1])
    ]
    if as_json:
        print_json(
            {
                "design": opened.name,
                "design_hash": opened.digest,
                "indenter": setup.indenter.name,
                "base": chosen,
                "dents": table.records(),
                "not_given": [{**row, "value": file.values[str(row["key"])]} for row in not_given],
            }
        )
        return
    print_table([column.header for column in table.columns], table.cells(), f"{setup.indenter.name}, base {chosen}")
    for row in not_given:
        reason = f": {row['reason']}" if row["reason"] else ""
        typer.echo(f"{row['origin']}: {row['key']} = {row['value']}{reason}")
    for path in (out, plot):
        if path is not None:
            typer.echo(f"wrote {path}")


def _depths(text: str) -> list[float]:
    """Depths in m from a list or a range in mm."""
    depths = lengths("--depth-mm", text)
    if depths[0] <= 0:
        raise ElastomerError(f"--depth-mm must be above zero; got {text!r}.")
    return depths


def _enters(key: str) -> bool:
    """Tell whether a key of the design enters the dent."""
    return key.startswith("indenter.") or (
        key.startswith(("elastomer.", "indentation.")) and key.split(".")[-1] in _ENTERING
    )
