"""``coilarray response``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from coilarray import viz
from coilarray.cli import shared
from coilarray.errors import ElastomerError

if TYPE_CHECKING:
    from coilarray.response.map import Reach


def response(
    design: shared.DesignArgument = None,
    depth_mm: shared.Depths = None,
    x_mm: shared.PlacesX = None,
    y_mm: shared.PlacesY = None,
    tilt: Annotated[tuple[float, float], typer.Option(help="Slope of the elastomer along x and y, in mm per mm.")] = (
        0.0,
        0.0,
    ),
    offset_mm: Annotated[tuple[float, float], typer.Option(help="True minus assumed position of the indenter.")] = (
        0.0,
        0.0,
    ),
    depth_error_mm: Annotated[float, typer.Option(help="True minus assumed depth.")] = 0.0,
    thickness_error_mm: Annotated[
        list[str] | None, typer.Option(help="SHEET=VALUE, true minus designed thickness; may be repeated.")
    ] = None,
    noise: Annotated[
        float, shared.number_option(("--noise",), 0.0, 1.0, "Relative standard deviation of each reading of L.")
    ] = 0.0,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the noise.")] = 0,
    ideal: shared.Ideal = False,
    dielectric: Annotated[
        bool, typer.Option("--dielectric", help="Include the change of the coils' capacitance due to the dent.")
    ] = False,
    metal: Annotated[
        bool, typer.Option("--metal/--no-metal", help="Include the indenter's material, if it has one.")
    ] = True,
    rest_distance_mm: Annotated[
        float,
        typer.Option(help="Height above the sheets of an indenter with a material while L_0 is read; inf: far away."),
    ] = 0.0,
    reach: Annotated[
        str,
        typer.Option(
            help="Coils included at a position: all; a number from 0.0001 to 0.1 for only those near the indenter "
            "that keep the error of δ below this fraction of its peak; auto for 0.001 on large boards, else all."
        ),
    ] = "auto",
    out: shared.NumbersFile = Path("response.nc"),
    plot: Annotated[Path | None, shared.plot_option("the maps of the deepest dent")] = None,
    force: shared.Force = False,
    as_json: shared.AsJson = False,
    allow_violations: shared.AllowViolations = False,
) -> None:
    """Compute the response of every coil to an indentation.

    Computes δ = (L_peak − L_0)/L_0 of every state of the scan, for every position and depth of the indenter, with the
    other coils as the scan terminates them. The table shows the peak of every map. Positions in the table, the picture
    and a .csv are on the board; in a .nc they count from the map's origin, which it states. After an interruption the
    same command resumes from the folder FILE.parts. On large boards only the coils near the indenter are included, and
    a line says so; --reach all includes every coil.

    An indenter with a material (indenter.material of the design) also changes δ by its eddy currents and its
    magnetisation; their share is shown beside δ. L_0 is that of the indenter just touching the sheets. A negative depth
    of such an indenter is a height above the sheets: --depth-mm=-5,-1,0,1.

    Plates below the coils ([[plate]]: a backplane, a copper pour) are included, at the frequency of each state:
    infinite plates reflect the field of the coils and that of the dent, plates with an outline only that of the coils.

    Example: coilarray response gast2020 --depth-mm 0.5,1 --out map.nc --plot map.png
    """
    depths, *places = (
        shared.lengths(option, text) for option, text in (("--depth-mm", depth_mm), ("--x-mm", x_mm), ("--y-mm", y_mm))
    )
    errors = _thickness_errors(thickness_error_mm or ())
    counted = _reach(reach)
    from coilarray.circuit.readability import reading_lines
    from coilarray.report.figures import map_outlines
    from coilarray.report.indentation_tables import response_table
    from coilarray.report.target_tables import path_drive_table
    from coilarray.response.dataset import coils_outside, on_board
    from coilarray.response.map import Imperfections, response_map

    opened = shared.open_design(design, allow_violations=allow_violations)
    x, y = shared.from_map_origin(opened.indentation, *places)
    offset = (offset_mm[0] * 1e-3, offset_mm[1] * 1e-3)
    imperfections = Imperfections(tilt, offset, depth_error_mm * 1e-3, errors, noise=noise, seed=seed)
    with shared.map_parts(out) as keep, shared.progress_bar("response") as progress:
        result = response_map(
            opened, depths=depths, x=x, y=y, reach=counted, imperfections=imperfections, ideal=ideal,
            dielectric=dielectric, metal=metal, rest=rest_distance_mm * 1e-3, keep=keep, progress=progress,
        )  # fmt: skip
        shown = on_board(result)
        table = response_table(shown)
        in_metres = shown.delta.rename(depth="depth_m", y="y_m", x="x_m")
        shared.write_numbers(out, result, lambda: in_metres.to_dataframe().to_csv(lineterminator="\n"))
    shared.draw(plot, lambda: viz.response_figure(shown, map_outlines(opened, shown)))
    error = result.attrs["error_of_peak"]
    lines = [f"wrote {out}: {' × '.join(map(str, result.delta.shape))} values over {result.delta.dims}"]
    if error:
        lines.insert(
            0,
            f"only coils up to {result.attrs['coil_cutoff_m'] * 1e3:.0f} mm from the indenter are included: the error "
            f"of δ is up to {error:g} of its peak; --reach all includes every coil",
        )
    outside = coils_outside(shown) if x is None and y is None else []
    if outside:
        lines.append(f"note: the design's positions do not include the centres of {', '.join(outside)}")
    lifted = result.attrs.get("lifted_m")
    if lifted:
        weightless = opened.indentation is not None and not opened.indentation.unevenness.weight
        held = "; without seat_weight_Pa only the indenter holds it down" * weightless
        lines.append(f"note: the sample rises off its seat by up to {lifted * 1e3:.2g} mm{held}")
    lines = [*reading_lines(shown), *([] if ideal else shared.missing_capacitance(opened)), *lines]
    # a path through metal needs its own drive; a dent alone changes no amplitude
    drive = path_drive_table(shown if "metal_delta" in shown else shown.drop_vars("amplitude", errors="ignore"))
    data = {
        **shared.design_record(opened),
        "file": out and str(out),
        "error_of_peak": error,
        "lifted_m": lifted,
        "response": table.records(),
        drive.name: drive.records(),
    }
    shared.print_result(
        data, as_json=as_json, tables=[table, *([drive] if drive.rows else [])], lines=lines, files=[plot]
    )


def _reach(text: str) -> Reach:
    """Which coils count; the library checks the number."""
    try:
        return None if text == "all" else "auto" if text == "auto" else float(text)
    except ValueError:
        raise ElastomerError(f"--reach must be all, auto or a relative error of δ; got {text!r}.") from None


def _thickness_errors(texts: Sequence[str]) -> dict[str, float]:
    """Errors in m by the sheet's name."""
    errors: dict[str, float] = {}
    for text in texts:
        sheet, _, value = text.partition("=")
        try:
            error = float(value) * 1e-3
        except ValueError:
            raise ElastomerError(f"--thickness-error-mm must be SHEET=VALUE; got {text!r}.") from None
        if sheet in errors:
            raise ElastomerError(f"--thickness-error-mm must name a sheet once; got {sheet!r} again.")
        errors[sheet] = error
    return errors
