"""Responses and maps of the commands for positions."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from coilarray.cli import shared
from coilarray.cli.board.options import marked
from coilarray.errors import LocalizeError

if TYPE_CHECKING:
    import xarray as xr

    from coilarray.compute.arrays import FloatArray
    from coilarray.compute.threads import Progress
    from coilarray.design.model import Design
    from coilarray.hardware.record.recording import Recording
    from coilarray.paper.ellipse_model import EllipseModel

_SQLITE = b"SQLite format 3\0"  # begins every file of SQLite
_RECORDING = ".sqlite"


def is_map(source: str | None) -> bool:
    """Whether a response is a netCDF file, no recording."""
    if source is not None and is_recording(source):
        raise LocalizeError(
            f"{source} is a recording; convert it to a response: coilarray board info {source} --out map.nc"
        )
    return source is not None and source.lower().endswith(".nc")


def is_recording(source: str) -> bool:
    """Whether a file is, or would be, an SQLite database."""
    begins = b""
    with suppress(OSError, ValueError), Path(source).open("rb") as file:  # no file to be read; a name with a zero byte
        begins = file.read(len(_SQLITE))
    return begins == _SQLITE or source.lower().endswith(_RECORDING)


def read_map(path: Path, *, target: bool = False) -> xr.Dataset:
    """Read a response, and whether its board is emulated."""
    response = read_response(path, target=target)
    if response.attrs.get("emulated", 0):
        text = f"{path} is of an emulated board: no real board was measured."
        typer.echo(marked(text, emulated=True), err=True)
    return response


def read_response(path: Path, *, target: bool = False) -> xr.Dataset:
    """Read a response, or with `target` a target's map too."""
    from coilarray.compute.netcdf import read_checked
    from coilarray.response.dataset import RESPONSE, TARGET_MAP

    return read_checked(path, RESPONSE, *([TARGET_MAP] if target else []))


def recorded_map(path: Path, calibration: Path | None) -> tuple[xr.Dataset, list[FloatArray]]:
    """Read a campaign's response, and coil outlines in m."""
    from coilarray.hardware.record.recording import open_recording
    from coilarray.report.figures import map_outlines

    with open_recording(path) as recording:
        response = campaign_response(recording, calibration, partial=True)
        design = recording.design
    return response, map_outlines(design, response)


def campaign_response(recording: Recording, calibration: Path | None, *, partial: bool) -> xr.Dataset:
    """Return a campaign's response, calibrated if constants are given."""
    from coilarray.hardware.record.calibration import calibrated_response, load_calibration
    from coilarray.hardware.record.recorded_response import recorded_response

    if calibration is None:
        return recorded_response(recording, partial=partial)
    return calibrated_response(recording, load_calibration(calibration), partial=partial)


def read_ellipses(path: Path) -> EllipseModel:
    """Read an ellipse model of `coilarray paper fit`."""
    from coilarray.compute.files import read_text
    from coilarray.paper.ellipse_model import model_from_json

    return model_from_json(read_text(path, LocalizeError))


def kept_table(design: Design) -> xr.Dataset:
    """Return a design's response table, stored or computed."""
    with shared.progress_bar(f"table of {design.name}") as progress:
        return stored_table(design, progress=progress)


def stored_table(design: Design, *, progress: Progress) -> xr.Dataset:
    """Return the response table of a design from the store."""
    from coilarray.compute.store import open_store
    from coilarray.localize.forward import table_for

    store = open_store()
    return store.dataset(("readable positions", design.digest), lambda: table_for(design, progress=progress))
