"""``coilarray board compare``."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from coilarray import viz
from coilarray.cli import shared
from coilarray.cli.board.options import print_marked
from coilarray.cli.maps import is_map, is_recording, read_response, recorded_map
from coilarray.errors import LocalizeError

if TYPE_CHECKING:
    import xarray as xr

    from coilarray.compute.arrays import FloatArray
    from coilarray.compute.table import Table
    from coilarray.design.model import Design

    _Source = tuple[xr.Dataset, Sequence[FloatArray]]  # a response, and the outlines of its coils where they are known

_PAGE = ".html"
_LACKING = ("only_measured", "only_simulated")
_ALONE = 2e-3  # m; spacing of a simulated map along an axis on which there is a single measured position


def compare(
    measured: Annotated[
        str,
        typer.Argument(
            metavar="MEASURED", help="Recording of a campaign, response (.nc), a design, or `published` for Table A1."
        ),
    ],
    simulated: Annotated[
        str,
        typer.Argument(
            metavar="SIMULATED", help="The same; the response of a design is computed at the measured positions."
        ),
    ],
    calibration: shared.BoardConstants = None,
    reference: shared.References = None,
    largest_shift_mm: Annotated[
        float | None,
        shared.number_option(
            ("--largest-shift-mm",), 0, 1000, "Largest shift to try; the spacing of the measured positions by default."
        ),
    ] = None,
    out: Annotated[
        Path | None,
        shared.file_option(("--out", "-o"), "Also write: one page (.html), or a folder with page, tables and netCDF."),
    ] = None,
    picture: Annotated[Path | None, shared.plot_option("the residuals and x0 of both", "--picture")] = None,
    as_json: shared.AsJson = False,
    allow_violations: shared.AllowViolations = False,
) -> None:
    """Compare a measured response with a simulated one.

    For every coil it finds the scale and the shift that fit the simulated map to the measured map,
    the residuals before and after, and x0, A and B of the ellipses of both with the same settings.
    Maps on different grids are interpolated, never extrapolated. States, depths and positions of a
    single map are listed.

    Example: coilarray board compare campaign.sqlite gast2020 --out comparison
    """
    if calibration is not None and not is_recording(measured):
        raise LocalizeError(f"--calibration is for a recording; {measured} is not one.")
    from coilarray.compute.files import make_folder
    from coilarray.report.comparison import comparison_notes, comparison_tables
    from coilarray.response.dataset import in_ellipse_window
    from coilarray.studies.comparison import compare_responses

    if out is not None and _is_page(out):
        shared.check_file("--out", out, (_PAGE,))
    elif out is not None:
        make_folder(out)  # a folder that cannot be written is known before the work begins
    largest_shift = None if largest_shift_mm is None else largest_shift_mm * 1e-3
    first, outlines = _response(measured, None, largest_shift, calibration, allow_violations)
    if simulated == "published":  # which is known there alone
        first = in_ellipse_window(first)
    second, others = _response(simulated, first, largest_shift, None, allow_violations)
    outlines = outlines or others
    if reference:
        from coilarray.hardware.record.recorded_response import response_less_reference

        first, second = (response_less_reference(one, reference) for one in (first, second))
    with shared.progress_bar("comparison") as progress:
        result = compare_responses(first, second, largest_shift=largest_shift, progress=progress)
    written = [] if out is None else _write(result, out, (measured, simulated), outlines)
    shared.draw(picture, lambda: viz.comparison_figure(result, -1, outlines))
    files = [str(path) for path in (*written, picture) if path is not None]
    emulated = any(bool(one.attrs.get("emulated", 0)) for one in (first, second))
    tables, notes = comparison_tables(result), comparison_notes(result)
    said = {key: result.attrs[key] for key in ("noise_from", "points_left_out", "points_missing")}
    lacking = {key: [name for name in result.attrs[key].split(", ") if name] for key in _LACKING}
    data = {
        "emulated": emulated, "measured": measured, "simulated": simulated, **said,
        **lacking, "notes": notes, **{table.name: table.records() for table in tables}, "files": files,
    }  # fmt: skip
    parts: list[str | Table] = [
        *(table for table in tables if table.name != "curves"),
        *notes,
        *(f"wrote {path}" for path in files),
    ]
    print_marked(data, parts, as_json=as_json, emulated=emulated)


def _is_page(out: Path) -> bool:
    return out.suffix.lower() == _PAGE


def _response(
    name: str, beside: xr.Dataset | None, largest_shift: float | None, calibration: Path | None, allow_violations: bool
) -> _Source:
    """Read or compute a response, with positions around another."""
    if is_recording(name):
        return recorded_map(Path(name), calibration)
    if is_map(name):
        return read_response(Path(name)), ()
    if name == "published":
        from coilarray.paper.ellipse_model import published_map

        x, y = (None, None) if beside is None else _around(beside, largest_shift)
        return published_map(x, y), ()
    return _computed(shared.open_design(name, allow_violations=allow_violations), beside, largest_shift)


def _computed(design: Design, beside: xr.Dataset | None, largest_shift: float | None) -> _Source:
    """Response of a design with all strays of its circuit.

    Beside another response it is around that one's positions. L_0 is by the design's tank capacitor
    alone, as in a recording that is not calibrated, beside a calibrated one by all capacitance.
    """
    from coilarray.errors import ElastomerError
    from coilarray.hardware.scan.settings import board_network
    from coilarray.report.figures import map_outlines
    from coilarray.response.map import Imperfections, respond, response_map
    from coilarray.response.setup import indentation_of

    indentation_of(design)  # refused before the network is computed
    # beside a recording of coils at the channels of a converter there are no switches
    wired = beside is not None and bool(beside.attrs.get("wired", False))
    board = Imperfections(network=board_network(design, wired=wired))
    with shared.progress_bar(f"response of {design.name}") as progress:
        at = partial(response_map, design, imperfections=board, progress=progress)
        if beside is None:
            response = at()
            return response, map_outlines(design, response)
        x, y = _around(beside, largest_shift)
        try:
            response = at(depths=beside.depth.values, x=x, y=y)
        except ElastomerError:  # a sample may end where the measured positions do
            response = at(depths=beside.depth.values, x=beside.x.values, y=beside.y.values)
    if "capacitance_from" in beside.attrs:
        response = response.assign(base_inductance=respond(design, response, ideal=True).base_inductance)
    return response, map_outlines(design, response)


def _around(response: xr.Dataset, largest_shift: float | None) -> tuple[FloatArray, FloatArray]:
    """Positions along x and y, widened by the largest shift."""
    import numpy as np

    axes = []
    for name in ("x", "y"):
        axis = np.asarray(response[name].values, dtype=np.float64)
        step = float(np.median(np.diff(axis))) if len(axis) > 1 else _ALONE
        count = max(1 if len(axis) > 1 else 2, math.ceil((largest_shift or 0.0) / step - 1e-9))
        beyond = step * np.arange(1, 1 + count)
        axes.append(np.concatenate((axis[0] - beyond[::-1], axis, axis[-1] + beyond)))
    return axes[0], axes[1]


def _write(result: xr.Dataset, out: Path, names: tuple[str, str], outlines: Sequence[FloatArray]) -> list[Path]:
    """Write the page, or a folder with numbers and tables."""
    from coilarray.compute.files import write_text
    from coilarray.compute.netcdf import save_dataset
    from coilarray.report.comparison import comparison_tables, write_comparison_page

    if _is_page(out):
        write_comparison_page(result, out, names, outlines)
        return [out]
    written = [out / "comparison.html", out / "comparison.nc"]
    write_comparison_page(result, written[0], names, outlines)
    save_dataset(result, written[1])
    for table in comparison_tables(result):
        written.append(out / f"{table.name}.csv")
        write_text(written[-1], table.csv())
    return written
