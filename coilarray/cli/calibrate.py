"""``coilarray calibrate``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from coilarray import viz
from coilarray.cli import shared
from coilarray.cli.maps import is_recording, read_ellipses, read_map, recorded_map
from coilarray.errors import GoalError

if TYPE_CHECKING:
    import xarray as xr

    from coilarray.paper.ellipse_model import EllipseModel
    from coilarray.studies.calibrate import Calibration, Plan

_PAPER = "published"
_FILES = ("calibration.html", "calibration.nc", "calibrated.toml")  # and the tables


def calibrate(
    design: Annotated[str, typer.Argument(metavar="DESIGN", help="Design file (TOML) or name of a bundled design.")],
    data: Annotated[
        str,
        typer.Argument(
            metavar="DATA",
            help="Recording of a campaign, response (.nc), ellipse model (.json), or `published` for Table A1.",
        ),
    ] = _PAPER,
    plan: Annotated[
        str | None,
        typer.Option("--plan", help="Calibration plan (TOML) or name of a bundled one; table_a1 with `published`."),
    ] = None,
    unknown: Annotated[
        list[str] | None,
        typer.Option(
            "--unknown", help="Unknown entry KEY=LOW:HIGH, in the unit of the key, instead of a plan; may be repeated."
        ),
    ] = None,
    calibration: shared.BoardConstants = None,
    workers: shared.Workers = None,
    cluster: shared.Cluster = None,
    cache: shared.Cache = None,
    out: Annotated[
        Path | None,
        shared.file_option(
            ("--out", "-o"), "Folder for page, tables, netCDF and the calibrated design (calibrated.toml)."
        ),
    ] = None,
    plot: Annotated[Path | None, shared.plot_option("data, model and residuals")] = None,
    as_json: shared.AsJson = False,
    allow_violations: shared.AllowViolations = False,
) -> None:
    """Fit unknown entries of a design to a measurement.

    A plan names keys of the design, and imperfections of the experiment, with bounds and priors
    (tables [[unknown]]: entry, low, high, prior_mean, prior_std), and alternatives such as the
    order of layers ([[alternative]] with [[alternative.choice]]: name, set, without). The command
    prints the fitted values with their errors and correlations, the alternatives with their
    evidence, and the directions that the data do not determine. Of an ellipse model, A, B and the
    peaks are fitted, x0 only if the plan says so. Evaluations are stored, so that the same command
    resumes after an interruption.

    Example: coilarray calibrate gast2020 campaign.sqlite --unknown
    elastomer.1.relative_permeability=2:4 --out fit
    """
    shared.check_workers(workers, cluster)
    from coilarray.compute.files import make_folder
    from coilarray.compute.store import open_store
    from coilarray.report import calibration as report
    from coilarray.studies.calibrate import calibrate as fit_to

    if calibration is not None and not is_recording(data):
        raise GoalError(f"--calibration is for a recording; {data} is not one.")
    opened = shared.open_design_file(design, allow_violations=allow_violations)
    chosen = _plan(plan, unknown, data)
    measured = _measured(data, calibration)
    if out is not None:
        make_folder(out)  # a folder that cannot be written is known before the work begins
    kept = open_store(cache)
    with (
        shared.resumable(lambda done: f"{done} evaluations are kept in {kept.folder}") as counting,
        shared.chosen_workers(workers, cluster) as used,
        shared.progress_bar("calibration") as show,
    ):
        found = fit_to(opened, measured, chosen, keep=kept.folder, workers=used, progress=counting(show))
    result = found.dataset
    tables, notes = report.calibration_tables(result), report.calibration_notes(result)
    written = [] if out is None else _write(found, out, data)
    shared.draw(plot, lambda: viz.calibration_figure(result))
    best = str(result.combination.values[0])
    record = {"best": best, "values": dict(found.values), "notes": notes}
    answer = {**shared.design_record(opened.design), "data": data, **record}
    records = {table.name: table.records() for table in tables}
    shown = [table for table in tables if table.name != "data"]
    if result.sizes["combination"] == 1:
        shown = [table for table in shown if table.name != "ranking"]
    lines = [*([f"Most probable: {best}."] if result.sizes["combination"] > 1 else []), *notes]
    shared.print_result(
        {**answer, **records, "files": [str(path) for path in written]},
        as_json=as_json, tables=shown, lines=lines, files=(*written, plot),
    )  # fmt: skip


def _plan(plan: str | None, unknown: list[str] | None, data: str) -> Plan:
    from coilarray.studies.calibrate.plan import load_plan, simple_plan
    from coilarray.studies.sweep import parse_axis

    if plan is not None and unknown:
        raise GoalError("--plan and --unknown cannot be given together.")
    if unknown:
        axes = [parse_axis(text, "--unknown") for text in unknown]
        for axis in axes:
            if not axis.interval:
                raise GoalError(f"--unknown must be KEY=LOW:HIGH; got the values {', '.join(axis.labels)}.")
        return simple_plan({axis.key: axis.values for axis in axes})
    if plan is None and data != _PAPER:
        raise GoalError("the unknown entries must be given: --plan FILE, or --unknown KEY=LOW:HIGH.")
    return load_plan("table_a1" if plan is None else plan)


def _measured(data: str, calibration: Path | None) -> xr.Dataset | EllipseModel | None:
    if data == _PAPER:
        return None
    if is_recording(data):
        return recorded_map(Path(data), calibration)[0]
    return read_ellipses(Path(data)) if data.lower().endswith(".json") else read_map(Path(data))


def _write(found: Calibration, out: Path, data: str) -> list[Path]:
    """Write page, numbers, tables and the calibrated design."""
    from coilarray.compute.files import write_text
    from coilarray.compute.netcdf import save_dataset
    from coilarray.design.write import file_text
    from coilarray.report.calibration import calibration_tables, write_calibration_page

    written = [out / name for name in _FILES]
    write_calibration_page(found.dataset, written[0], data)
    save_dataset(found.dataset, written[1])
    write_text(written[2], file_text(found.file))
    for table in calibration_tables(found.dataset):
        written.append(out / f"{table.name}.csv")
        write_text(written[-1], table.csv())
    return written
