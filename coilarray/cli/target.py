"""``coilarray target``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from coilarray import viz
from coilarray.cli import shared


def target(
    design: Annotated[
        str,
        typer.Argument(
            metavar="DESIGN",
            help="Design file (TOML) with a [target], or name of a bundled design; proximity by default.",
            show_default=False,
        ),
    ] = "proximity",
    distance_mm: Annotated[
        str | None, typer.Option(help="Distances, such as 0.5,1 or START:STOP:COUNT; the design's by default.")
    ] = None,
    x_mm: shared.PlacesX = None,
    y_mm: shared.PlacesY = None,
    noise: shared.Noise = None,
    ideal: shared.Ideal = False,
    accuracy: shared.Accuracy = "full",
    out: shared.NumbersFile = Path("target.nc"),
    plot: Annotated[Path | None, shared.plot_option("δ, L, Q and f against the distance")] = None,
    maps: Annotated[Path | None, shared.plot_option("the maps of δ at the least distance", "--maps")] = None,
    as_json: shared.AsJson = False,
    allow_violations: shared.AllowViolations = False,
) -> None:
    """Compute the response of every coil to a metal target.

    The [target] of the design, of metal or ferrite, is moved over the board, vertically and
    sideways. At every position the whole circuit is solved: L, R, Q, R_p and f of every state of
    the scan, its δ relative to the board without the target, and every coupling. The tables show
    each state without the target, and at the position where the target changes it most, with the
    relative change Δf/f of its frequency, about −δ/2. They also show its range, the distance at
    which |δ| is 3 times the noise, and the distances up to which 1, 10 and 100 µm are resolved.
    Positions in tables, pictures and a .csv are on the board. The design may have any [[plate]]
    beside a target, with a sphere only those below the coils. A plate that nearly touches the
    copper takes longest: --accuracy screen takes a third of the time. Over magnetic sheets or
    beside plates an interrupted map of a disc or another outline is resumed, distance by distance,
    from the folder FILE.parts by the same command.

    Example: coilarray target proximity --distance-mm 1:20:14 --out target.csv --plot target.png
    """
    distances = shared.lengths("--distance-mm", distance_mm, positive=True)
    places = [shared.lengths(option, text) for option, text in (("--x-mm", x_mm), ("--y-mm", y_mm))]
    from coilarray.circuit.converter_limits import reading_lines
    from coilarray.compute.display_units import PER_MILLION
    from coilarray.report.figures import map_outlines
    from coilarray.report.response_tables import (
        base_table,
        path_drive_table,
        range_table,
        target_coupling_table,
        target_table,
        values_table,
    )
    from coilarray.response.dataset import on_board
    from coilarray.response.target import target_map

    opened = shared.open_design(design, allow_violations=allow_violations)
    x, y = shared.from_map_origin(opened.target, *places)
    network: Literal["ideal"] | None = "ideal" if ideal else None
    with shared.map_parts(out) as keep, shared.progress_bar("target") as progress:
        result = target_map(
            opened, distances=distances, x=x, y=y, noise=noise, network=network, accuracy=accuracy,
            keep=keep, progress=progress,
        )  # fmt: skip
        shown = on_board(result)
        shared.write_numbers(out, result, values_table(shown).csv)
    drive = path_drive_table(shown)
    tables = base_table(shown), target_table(shown), range_table(shown), *([drive] if drive.rows else [])
    shared.draw(plot, lambda: viz.target_figure(shown))
    shared.draw(maps, lambda: viz.response_figure(shown, map_outlines(opened, shown)))
    data = {
        **shared.design_record(opened),
        "file": out and str(out),
        "body": result.attrs["target"],
        "material": result.attrs["material"],
        "noise": result.attrs["sigma"],
        **{key: value for key, value in result.attrs.items() if key.startswith("plate_")},
        **{table.name: table.records() for table in (*tables, target_coupling_table(shown))},
    }
    sigma = PER_MILLION.text(result.attrs["sigma"], ".2")
    lines = [
        *reading_lines(shown),
        *shared.plate_error_lines(result.attrs),
        f"noise of δ {sigma}{shared.noise_source(noise, result)}: the range ends where |δ| is "
        f"{result.attrs['range_factor']:g} times that; a step of distance is resolved if it is at least the standard "
        "deviation of one reading",
        f"wrote {out}: {' × '.join(map(str, result.delta.shape))} values over {result.delta.dims}",
    ]
    shared.print_result(data, as_json=as_json, tables=tables, lines=lines, files=[plot, maps])
