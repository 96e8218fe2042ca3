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
    tilt: Annotated[tuple[float, float], typer.Option(help="Rise of the sample along x and y, mm per mm.")] = (
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
    noise: Annotated[float, typer.Option(help="Relative standard deviation of each reading of L.")] = 0.0,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the noise.")] = 0,
    ideal: shared.Ideal = False,
    dielectric: Annotated[
        bool, typer.Option("--dielectric", help="Include the change of the coils' capacitance by the dent.")
    ] = False,
    metal: Annotated[
        bool, typer.Option("--metal/--no-metal", help="Count the indenter's material, where it has one.")
    ] = True,
    rest_distance_mm: Annotated[
        float,
        typer.Option(help="Height over the sheets of an indenter with a material while L_0 is read; inf: far away."),
    ] = 0.0,
    reach: Annotated[
        str,
        typer.Option(
            help="Coils that count at a position: all; a number from 0.0001 to 0.1: those near the indenter, for this "
            "error of δ relative to its peak; auto: all, on large boards those for 0.001."
        ),
    ] = "auto",
    out: shared.NumbersFile = Path("response.nc"),
    plot: Annotated[Path | None, shared.plot_option("the maps of the deepest dent")] = None,
    force: shared.Force = False,
    as_json: shared.AsJson = False,
    allow_violations: shared.AllowViolations = False,
) -> None:
    """Map what an indentation does to every coil.

    δ = (L_peak − L_0)/L_0 of every state of the scan, for every position and depth of the indenter, with the other
    coils as the scan terminates them. The table shows the peak of every map; it, the picture and a .csv have places on
    the board, a .nc those from the map's origin, and where that is. An interrupted map goes on from the folder
    FILE.parts when the same command runs again. On large boards only the coils near the indenter are counted, and a
    line says so; --reach all counts every coil.

    An indenter with a material (indenter.material of the design) also changes δ by its eddy currents and its
    magnetisation, against L_0 read as it just touches; their share stands beside δ. Of such an indenter a depth below 0
    is a height over the sheets: --depth-mm=-5,-1,0,1.

    Plates below the coils ([[plate]]: a backplane, a copper pour) count with what they send back, at the frequency of
    each state: infinite ones of the coils' field and of the dent's, those with an outline of the coils' field.

    Example: coilarray response gast2020 --depth-mm 0.5,1 --out map.nc --plot map.png
    """
    depths, *places = (
        shared.lengths(option, text) for option, text in (("--depth-mm", depth_mm), ("--x-mm", x_mm), ("--y-mm", y_mm))
    )
    errors = _thickness_errors(thickness_error_mm or ())
    counted = _reach(reach)
    from coilarray.report.figures import map_outlines
    from coilarray.report.indentation_tables import response_table
    from coilarray.response.answering import coils_outside
    from coilarray.response.coordinates import on_board
    from coilarray.response.map import Imperfections, response_map

    opened = shared.open_design(design, allow_violations=allow_violations)
    x, y = shared.from_map_origin(opened.indentation, *places)
    offset = (offset_mm[0] * 1e-3, offset_mm[1] * 1e-3)
    imperfections = Imperfections(tilt, offset, depth_error_mm * 1e-3, errors, noise=noise, seed=seed)
    with shared.map_parts(out) as parts, shared.progress_bar("response") as progress:
        result = response_map(
            opened, depths=depths, x=x, y=y, reach=counted, imperfections=imperfections, ideal=ideal,
            dielectric=dielectric, metal=metal, rest=rest_distance_mm * 1e-3, parts=parts, progress=progress,
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
            f"only coils up to {result.attrs['coil_cutoff_m'] * 1e3:.0f} mm from the indenter count: δ is within "
            f"{error:g} of its peak; --reach all counts every coil",
        )
    outside = coils_outside(shown) if x is None and y is None else []
    if outside:
        lines.append(f"note: the positions of the design leave out the centres of {', '.join(outside)}")
    data = {
        **shared.design_record(opened),
        "file": out and str(out),
        "error_of_peak": error,
        "response": table.records(),
    }
    shared.print_result(data, as_json=as_json, tables=[table], lines=lines, files=[plot])


def _reach(text: str) -> Reach:
    """Which coils count; the library checks the number."""
    try:
        return None if text == "all" else "auto" if text == "auto" else float(text)
    except ValueError:
        raise ElastomerError(f"--reach must be all, auto or an error of δ; got {text!r}.") from None


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
