"""``coilarray compare``."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from coilarray.cli.board_options import marked
from coilarray.cli.maps import is_map, is_recording, read_response
from coilarray.cli.shared import (
    PICTURES,
    AllowViolations,
    AsJson,
    check_file,
    open_design,
    print_json,
    progress_bar,
    table_text,
)
from coilarray.errors import LocalizeError

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt
    import xarray as xr

    from coilarray.design.model import Design

    FloatArray = npt.NDArray[np.float64]

_PUBLISHED = "published"
_PAGE = ".html"
_LONGEST_MM = 1000.0
_ALONE = 2e-3  # m; spacing of a simulated map along an axis on which there is a single measured position


def compare(
    measured: Annotated[
        str,
        typer.Argument(
            metavar="MEASURED",
            help="Recording of a campaign, response (.nc), a design, or `published` for Table A1.",
        ),
    ],
    simulated: Annotated[
        str, typer.Argument(metavar="SIMULATED", help="The same; a design is computed at the measured positions.")
    ],
    calibration: Annotated[
        Path | None,
        typer.Option("--calibration", help="Constants of the measured board, of `coilarray calibrate-board` (.toml)."),
    ] = None,
    largest_shift_mm: Annotated[
        float | None,
        typer.Option(
            "--largest-shift-mm",
            "--reach-mm",
            help="Largest shift that is tried; the measured spacing by default.",
        ),
    ] = None,
    replicates: Annotated[
        int, typer.Option("--replicates", min=0, max=1000, help="Noisy maps for the uncertainty of the ellipses.")
    ] = 16,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", help="Also write: one page (.html), or a folder with page, tables and netCDF."),
    ] = None,
    picture: Annotated[
        Path | None, typer.Option("--picture", help="Also draw what remains and x0 of both: .png, .svg or .pdf.")
    ] = None,
    as_json: AsJson = False,
    allow_violations: AllowViolations = False,
) -> None:
    """Compare a measured response with a simulated one.

    For every coil the scale and the shift that bring the simulated map onto the measured one, what remains before and
    after, and the ellipses of both with the same settings. Maps on different grids are interpolated, never
    extrapolated; states, depths and positions that one lacks are named.

    Example: coilarray compare campaign.sqlite gast2020 --out comparison
    """
    if largest_shift_mm is not None and not (math.isfinite(largest_shift_mm) and 0 <= largest_shift_mm <= _LONGEST_MM):
        raise LocalizeError(f"--largest-shift-mm must be 0 to {_LONGEST_MM:g}; got {largest_shift_mm:g}.")
    if calibration is not None and not is_recording(measured):
        raise LocalizeError(f"--calibration is for a recording; {measured} is none.")
    if out is not None and out.suffix.lower() == _PAGE:
        check_file("--out", out, (_PAGE,))
    check_file("--picture", picture, PICTURES)
    from coilarray.compute.files import make_folder, write_atomically
    from coilarray.localize.comparison import compare_responses

    page_alone = out is not None and out.suffix.lower() == _PAGE
    if out is not None and not page_alone:
        make_folder(out)  # a folder that cannot be written is known before the work begins
    largest_shift = None if largest_shift_mm is None else largest_shift_mm * 1e-3
    first = _response(measured, None, largest_shift, calibration, allow_violations=allow_violations)
    second = _response(simulated, first.response, largest_shift, None, allow_violations=allow_violations)
    with progress_bar("comparison") as progress:
        result = compare_responses(
            first.response, second.response, largest_shift=largest_shift, replicates=replicates, progress=progress
        )
    written: list[Path] = []
    outlines = first.outlines or second.outlines
    if out is not None:
        written = _write(result, out, (measured, simulated), outlines, page_alone=page_alone)
    if picture is not None:
        from coilarray.viz.plots.comparison import comparison_figure

        write_atomically(picture, comparison_figure(result, -1, outlines).savefig)
        written.append(picture)
    data = _data(result, (measured, simulated), emulated=first.emulated or second.emulated)
    if as_json:
        print_json({**data, "files": [str(path) for path in written]})
        return
    lines = _text(result, written)
    typer.echo(marked(lines, emulated=first.emulated or second.emulated))


@dataclass(frozen=True, eq=False)
class _Source:
    """A response, and the outlines of its coils where they are known."""

    response: xr.Dataset
    outlines: Sequence[FloatArray] = ()

    @property
    def emulated(self) -> bool:
        return bool(self.response.attrs.get("emulated", 0))


def _response(
    name: str,
    beside: xr.Dataset | None,
    largest_shift: float | None,
    calibration: Path | None,
    *,
    allow_violations: bool,
) -> _Source:
    """Read or compute a response; what is computed beside another one has positions around all of its own."""
    if is_recording(name):
        return _recorded(Path(name), calibration)
    if is_map(name):
        return _Source(read_response(Path(name)))
    if name == _PUBLISHED:
        from coilarray.localize.published import published_map

        x, y = (None, None) if beside is None else _around(beside, largest_shift)
        return _Source(published_map(x, y))
    return _computed(open_design(name, allow_violations=allow_violations), beside, largest_shift)


def _recorded(path: Path, calibration: Path | None) -> _Source:
    from coilarray.hardware.record.calibration_file import load_calibration
    from coilarray.hardware.record.channel_calibration import calibrated_response
    from coilarray.hardware.record.recorded_response import recorded_response
    from coilarray.hardware.record.recording import open_recording
    from coilarray.report.figures import map_outlines

    known = None if calibration is None else load_calibration(calibration)
    with open_recording(path) as recording:
        if known is None:
            response = recorded_response(recording, partial=True)
        else:
            response = calibrated_response(recording, known, partial=True)
        design = recording.design
    return _Source(response, map_outlines(design, response))


def _computed(design: Design, beside: xr.Dataset | None, largest_shift: float | None) -> _Source:
    """Response of a design with all strays of its circuit, at its own positions or around those of another one.

    L_0 is by the design's tank capacitor alone, as a recording has it that is not calibrated; beside one that is, by
    all capacitance there is.
    """
    from coilarray.compute.store import open_store
    from coilarray.errors import ElastomerError
    from coilarray.hardware.scan.board_network import board_network
    from coilarray.report.figures import map_outlines
    from coilarray.response.map import respond, response_map
    from coilarray.response.setup import indentation_of

    indentation_of(design)  # refused before the network is computed
    network = board_network(design, open_store())
    with progress_bar(f"response of {design.name}") as progress:

        def at(*axes: FloatArray | None) -> xr.Dataset:
            depths, x, y = axes
            return response_map(design, depths=depths, x=x, y=y, network=network, progress=progress)

        if beside is None:
            response = at(None, None, None)
        else:
            try:
                response = at(beside.depth.values, *_around(beside, largest_shift))
            except ElastomerError:  # a sample may end where the measured positions do
                response = at(beside.depth.values, beside.x.values, beside.y.values)
    if beside is not None and "capacitance_from" in beside.attrs:
        response = response.assign(base_inductance=respond(design, response, ideal=True).base_inductance)
    return _Source(response, map_outlines(design, response))


def _around(response: xr.Dataset, largest_shift: float | None) -> tuple[FloatArray, FloatArray]:
    """Positions of a response along x and y in m, and as many beyond as a shift may largest_shift."""
    import numpy as np

    axes = []
    for name in ("x", "y"):
        axis = np.asarray(response[name].values, dtype=np.float64)
        step = float(np.median(np.diff(axis))) if len(axis) > 1 else _ALONE
        beyond = step * np.arange(
            1, 1 + max(1 if len(axis) > 1 else 2, math.ceil((largest_shift or 0.0) / step - 1e-9))
        )
        axes.append(np.concatenate((axis[0] - beyond[::-1], axis, axis[-1] + beyond)))
    return axes[0], axes[1]


def _write(
    result: xr.Dataset, out: Path, names: tuple[str, str], outlines: Sequence[FloatArray], *, page_alone: bool
) -> list[Path]:
    from coilarray.compute.files import write_text
    from coilarray.compute.netcdf import save_dataset
    from coilarray.report.comparison import comparison_tables, write_comparison_page

    page = out if page_alone else out / "comparison.html"
    write_comparison_page(result, page, names, outlines)
    if page_alone:
        return [page]
    written = [page, out / "comparison.nc"]
    save_dataset(result, written[-1])
    for table in comparison_tables(result):
        written.append(out / f"{table.name}.csv")
        write_text(written[-1], table.csv())
    return written


def _data(result: xr.Dataset, names: tuple[str, str], *, emulated: bool) -> dict[str, Any]:
    from coilarray.report.comparison import comparison_notes, comparison_tables

    return {
        "emulated": emulated,
        "measured": names[0],
        "simulated": names[1],
        "noise_from": result.attrs["noise_from"],
        "only_measured": _names(result.attrs["only_measured"]),
        "only_simulated": _names(result.attrs["only_simulated"]),
        "points_left_out": result.attrs["points_left_out"],
        "points_missing": result.attrs["points_missing"],
        "notes": comparison_notes(result),
        **{table.name: table.records() for table in comparison_tables(result)},
    }


def _names(joined: str) -> list[str]:
    return joined.split(", ") if joined else []


def _text(result: xr.Dataset, written: Sequence[Path]) -> str:
    from coilarray.report.comparison import comparison_notes, comparison_tables

    parts = [
        table_text([column.header for column in table.columns], table.cells(), table.title)
        for table in comparison_tables(result)
        if table.name != "curves"
    ]
    parts += comparison_notes(result)
    parts += [f"wrote {path}" for path in written]
    return "\n".join(parts)
