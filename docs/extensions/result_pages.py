"""A page of the files that results are kept in: variables, dimensions, units and attributes of real, small ones."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING

import xarray as xr
from command_pages import write_page
from sphinx.errors import ExtensionError

import coilarray as ca
from coilarray.circuit.ports import solve_ports
from coilarray.design.ports import Port
from coilarray.hardware import design_settings, open_board
from coilarray.hardware.record import recording as recording_module
from coilarray.hardware.record.recorded_response import recorded_series
from coilarray.hardware.record.recorder import begin_session, open_recorder, record_stream
from coilarray.hardware.record.recording import open_recording

if TYPE_CHECKING:
    from sphinx.application import Sphinx

_FOLDER = "reference/results"
_HEAD = """# Files of results

All numbers are SI. Results are [netCDF](https://www.unidata.ucar.edu/software/netcdf/) files, which xarray, MATLAB,
Julia and others read; a unit is the attribute `units` of its variable, and `1` is a ratio. Python functions return the
same as an `xarray.Dataset`:

```python
import xarray
response = xarray.open_dataset("response.nc")
response.delta.sel(state="coil2")
```

A recording is an SQLite database. The tables below are those of real results with the bundled designs; what depends on
the design, such as plates, adds variables that say so themselves.
"""
_STARTER = "starter"


def _series() -> xr.Dataset:
    """Return a few scans of two emulated coils as a time series."""
    design = ca.load_design(_STARTER)
    with tempfile.TemporaryDirectory() as folder, open_board("emulator?channels=0,1,2", design=design) as board:
        path = Path(folder) / "run.sqlite"
        settings = design_settings(design, board.wiring)
        board.reader.configure(settings)
        with open_recorder(path) as recorder:
            recorder.start(begin_session(board, settings, design))
            record_stream(board.reader, recorder, scans=10)
        with open_recording(path) as recording:
            return recorded_series(recording).load()


def results() -> Iterator[tuple[str, str, xr.Dataset]]:
    """Yield title, origin and dataset of every kind of result."""
    starter = ca.load_design(_STARTER)
    yield "Coupling", "{doc}`couple_design`, ``report/coupling.nc`` of a report", ca.couple_design(starter)
    yield "Scan", "{doc}`scan_design`", ca.scan_design(starter)
    yield (
        "Impedance over frequency",
        "`coilarray impedance --out`, {doc}`sweep_design`",
        ca.sweep_design(starter, [1e6]),
    )
    coils = ca.Array.row(ca.Spiral(4, 20e-3, 3, 0.5e-3, 0.5e-3), 2, pitch=22e-3)
    ports = Port("coil1", source_resistance=50.0), Port("coil2", load_resistance=20.0, series_capacitance=180e-12)
    circuit = ca.Circuit(ports=ports, link_frequency=13.56e6)
    link = ca.Design(coils, circuit=circuit)
    yield "Ports", "`coilarray impedance --ports --out`, ``report/ports.nc`` of a report", solve_ports(link)
    yield (
        "Response to an indentation",
        "`coilarray response --out`, {doc}`response_map`",
        ca.response_map(starter, depths=[5e-4], x=[0.0], y=[0.0]),
    )
    yield (
        "Response to a target",
        "`coilarray target --out`, {doc}`target_map`",
        ca.target_map(ca.load_design("proximity"), distances=[2e-3, 4e-3]),
    )
    yield "Time series of a recording", "`coilarray board info --out`", _series()


def table(dataset: xr.Dataset) -> list[str]:
    """Return the variables of a dataset as a table, and its attributes as another.

    ExtensionError for a variable that does not say what it means, or a number that does not say its unit.
    """
    for name, one in dataset.data_vars.items():
        for key in ("long_name", "units") if one.dtype.kind == "f" else ("long_name",):
            if not one.attrs.get(key):
                raise ExtensionError(f"a file of results has the variable {name} without {key}.")
    lines = [":::{div} stacked", "| variable | dimensions | unit | meaning |", "| --- | --- | --- | --- |"]
    for name in (*dataset.data_vars, *dataset.coords):
        one = dataset[name]
        role = "coordinate" if name in dataset.coords else ""
        meaning = str(one.attrs.get("long_name", role)).replace("|", "\\|")
        lines.append(f"| `{name}` | {', '.join(map(str, one.dims))} | {one.attrs.get('units', '')} | {meaning} |")
    lines += [":::", "", "| attribute | here |", "| --- | --- |"]
    lines += [f"| `{name}` | {_short(value)} |" for name, value in dataset.attrs.items()]
    return lines


def _short(value: object) -> str:
    text = " ".join(str(value).split()).replace("|", "\\|")
    return (text if len(text) <= 60 else f"{text[:60]}…").join(("`", "`")) if text else ""


def page() -> str:
    """Return the page in Markdown."""
    lines = [_HEAD]
    for title, origin, dataset in results():
        lines += [f"## {title}", "", f"{origin}.".replace("{doc}`", "{doc}`../python/coilarray."), ""]
        lines += [*table(dataset), ""]
    tables = resources.files("coilarray.hardware.record").joinpath("recording.sql").read_text(encoding="utf-8").strip()
    lines += [
        "## Recording",
        "",
        "`coilarray board measure --out`, `coilarray board live --out`. Raw words of the converter, never L alone;",
    ]
    lines += [
        f"SQLite's `user_version` is {recording_module.SCHEMA}.",
        "",
        "```{code-block} sql",
        "",
        tables,
        "```",
        "",
    ]
    return "\n".join(lines)


def _write(app: Sphinx) -> None:
    folder = Path(app.srcdir) / _FOLDER
    folder.mkdir(parents=True, exist_ok=True)
    write_page(folder / "index.md", page())


def setup(app: Sphinx) -> dict[str, bool]:
    """Write the page before Sphinx looks for it."""
    app.connect("builder-inited", _write)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
