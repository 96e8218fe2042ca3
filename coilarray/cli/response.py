"""``coilarray response``."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from coilarray import viz
from coilarray.cli import shared
from coilarray.errors import ElastomerError

if TYPE_CHECKING:
    from coilarray.response.map import Imperfections, Reach

_REST = "rest_distance_mm"
_SHEET = "thickness_error_mm."


def response(
    design: shared.DesignArgument = None,
    depth_mm: shared.Depths = None,
    x_mm: shared.PlacesX = None,
    y_mm: shared.PlacesY = None,
    experiment: Annotated[
        list[str] | None,
        typer.Option(
            metavar="KEY=VALUE",
            help="Imperfection of the experiment: depth_error_mm, tilt_x_mrad, tilt_y_mrad, offset_x_mm, offset_y_mm, "
            "drift, column_drift, thickness_error_mm.SHEET, noise (of each reading of L), seed; or rest_distance_mm, "
            "the height of an indenter with a material while L_0 is read. May be repeated.",
        ),
    ] = None,
    ideal: shared.Ideal = False,
    reach: Annotated[
        str,
        typer.Option(
            help="Coils included at a position: all; a number from 0.0001 to 0.1 for only those near the indenter "
            "that keep the error of δ below this fraction of its peak; auto for 0.001 on large boards, else all."
        ),
    ] = "auto",
    dent: Annotated[bool, typer.Option("--dent", help="Compute the dent and the force alone, without coils.")] = False,
    out: shared.NumbersFile = Path("response.nc"),
    plot: Annotated[Path | None, shared.plot_option("the maps of the deepest dent, or with --dent the dent")] = None,
    as_json: shared.AsJson = False,
    allow_violations: shared.AllowViolations = False,
) -> None:
    """Compute the response of every coil to an indentation.

    Computes δ = (L_peak − L_0)/L_0 of every state of the scan, for every position and depth of the
    indenter, with the other coils as the scan terminates them. The table shows the peak of every
    map. Positions in the table, the picture and a .csv are on the board. In a .nc they count from
    the map's origin, which it states. After an interruption the same command resumes from the
    folder FILE.parts. On large boards only the coils near the indenter are included, and a line
    says so.

    An indenter with a material (indenter.material of the design) also changes δ by its eddy
    currents and its magnetisation. Their share is shown beside δ. L_0 is read while the indenter
    just touches the sheets. A negative depth of such an indenter is a height above the sheets:
    --depth-mm=-5,-1,0,1.

    Plates below the coils ([[plate]]: a backplane, a copper pour) are included at the frequency of
    each state. Infinite plates reflect the field of the coils and of the dent, plates with an
    outline only the field of the coils.

    With --dent the table has the displacement of each sheet's upper face on the axis, the force of
    the indenter, which has no friction, and the ring, the highest rise of the free surface. A
    rectangular sample counts as wide, and its seat as even.

    Example: coilarray response gast2020 --depth-mm 0.5,1 --out map.nc --plot map.png

    Example: coilarray response gast2020 --dent --depth-mm 0.1:1:10 --out dent.csv
    """
    depths, *places = (
        shared.lengths(option, text) for option, text in (("--depth-mm", depth_mm), ("--x-mm", x_mm), ("--y-mm", y_mm))
    )
    if dent:
        _print_dent(design, depths, out, plot, as_json=as_json)
        return
    imperfections = _experiment(experiment or ())
    counted: Reach = None if reach == "all" else "auto"
    if reach not in ("all", "auto"):
        from coilarray.response.map import LARGEST_ERROR, LEAST_ERROR

        with suppress(ValueError):
            counted = float(reach)
        if not isinstance(counted, float) or not LEAST_ERROR <= counted <= LARGEST_ERROR:
            raise ElastomerError(
                f"--reach must be all, auto or {LEAST_ERROR:g} to {LARGEST_ERROR:g}, an error of δ; got {reach!r}."
            )
    from coilarray.circuit.converter_limits import reading_lines
    from coilarray.report.figures import map_outlines
    from coilarray.report.response_tables import path_drive_table, response_table
    from coilarray.response.dataset import coils_outside, on_board
    from coilarray.response.map import response_map

    opened = shared.open_design(design, allow_violations=allow_violations)
    x, y = shared.from_map_origin(opened.indentation, *places)
    if ideal:
        imperfections = replace(imperfections, network="ideal")
    with shared.map_parts(out) as keep, shared.progress_bar("response") as progress:
        result = response_map(
            opened, depths=depths, x=x, y=y, imperfections=imperfections, accuracy=counted, keep=keep,
            progress=progress,
        )  # fmt: skip
        shown = on_board(result)
        table = response_table(shown)
        in_metres = shown.delta.rename(depth="depth_m", y="y_m", x="x_m")
        shared.write_numbers(out, result, lambda: in_metres.to_dataframe().to_csv(lineterminator="\n"))
    shared.draw(plot, lambda: viz.response_figure(shown, map_outlines(opened, shown)))
    error, lifted = result.attrs["error_of_peak"], result.attrs.get("lifted_m")
    lines = [*reading_lines(shown), *([] if ideal else shared.missing_capacitance(opened))]
    if error:
        lines.append(
            f"only coils up to {result.attrs['coil_cutoff_m'] * 1e3:.0f} mm from the indenter are included: the error "
            f"of δ is up to {error:g} of its peak; --reach all includes every coil"
        )
    lines.append(f"wrote {out}: {' × '.join(map(str, result.delta.shape))} values over {result.delta.dims}")
    if outside := coils_outside(shown) if x is None and y is None else []:
        lines.append(f"note: the design's positions do not include the centres of {', '.join(outside)}")
    if lifted:
        weightless = opened.indentation is not None and not opened.indentation.unevenness.weight
        held = "; without seat_weight_Pa only the indenter holds it down" * weightless
        lines.append(f"note: the sample rises off its seat by up to {lifted * 1e3:.2g} mm{held}")
    # a path through metal needs its own drive; a dent alone changes no amplitude
    drive = path_drive_table(shown if "metal_delta" in shown else shown.drop_vars("amplitude", errors="ignore"))
    data = {
        **shared.design_record(opened), "file": out and str(out), "error_of_peak": error, "lifted_m": lifted,
        table.name: table.records(), drive.name: drive.records(),
    }  # fmt: skip
    tables = [table, *([drive] if drive.rows else [])]
    shared.print_result(data, as_json=as_json, tables=tables, lines=lines, files=[plot])


def _print_dent(
    name: str | None, depths: list[float] | None, out: Path | None, plot: Path | None, *, as_json: bool
) -> None:
    """Compute and print a design's dent and force."""
    if depths is not None and depths[0] <= 0:
        raise ElastomerError(f"--depth-mm must be above zero with --dent; got {depths[0] * 1e3:g}.")
    from coilarray.circuit.coupling import provenance
    from coilarray.compute.display_units import value_text
    from coilarray.design.model import load_design_file
    from coilarray.report.response_tables import indentation_table
    from coilarray.response.setup import contact_at, indentation_of

    file = load_design_file(name)
    opened = file.design
    setup = indentation_of(opened)
    result = contact_at(setup, opened.sheets, depths or setup.depths).assign_attrs(provenance(opened))
    how = f"{setup.indenter.name}, base {setup.base}, {setup.strain} strain"
    table = replace(indentation_table(result), title=how)
    shared.write_numbers(out, result, table.csv)
    shared.draw(plot, lambda: viz.indentation_figure(result, setup.indenter))
    lines = []
    if setup.sample_bounds is not None:
        lines.append("The sample counts as wide here, on an even seat that holds it. Responses include sides and seat.")
    tables, others = ("elastomer.", "indenter.", "indentation."), (".x_mm", ".y_mm", ".origin", "_permeability")
    assumed = {key: why for key, why in file.assumed.items() if key.startswith(tables) and not key.endswith(others)}
    lines += [f"assumed: {key} = {value_text(file.values[key])}: {why}" for key, why in assumed.items()]
    data = {
        **shared.design_record(opened), "indenter": setup.indenter.name, "base": str(setup.base),
        "strain": setup.strain, "dents": table.records(), "assumed": assumed,
    }  # fmt: skip
    shared.print_result(data, as_json=as_json, tables=[table], lines=lines, files=(out, plot))


def _experiment(texts: Sequence[str]) -> Imperfections:
    """Return the imperfections of an experiment."""
    from coilarray.studies.calibrate.data import imperfections_of
    from coilarray.studies.calibrate.plan import IMPERFECTIONS

    values: dict[str, float] = {}
    known = (*IMPERFECTIONS, f"{_SHEET}SHEET", "noise", "seed", _REST)
    for text in texts:
        key, _, value = text.partition("=")
        if key not in known and not key.startswith(_SHEET):
            raise ElastomerError(f"--experiment must be KEY=VALUE with a key of {', '.join(known)}; got {text!r}.")
        if key in values:
            raise ElastomerError(f"--experiment must name {key} once.")
        try:
            values[key] = float(value)
        except ValueError:
            raise ElastomerError(f"--experiment {key} must be a number; got {value!r}.") from None
    seed = values.get("seed", 0.0)
    if not seed.is_integer():
        raise ElastomerError(f"--experiment seed must be a whole number; got {seed:g}.")
    sheets = {key.removeprefix(_SHEET): value * 1e-3 for key, value in values.items() if key.startswith(_SHEET)}
    return replace(
        imperfections_of(values), thickness_errors=sheets, noise=values.get("noise", 0.0), seed=int(seed),
        rest=values.get(_REST, 0.0) * 1e-3,
    )  # fmt: skip
