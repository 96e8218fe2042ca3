"""``coilarray locate``, the readings that it reads, and ``coilarray calibrate``."""

from __future__ import annotations

import csv
import json
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

import typer

from coilarray import viz
from coilarray.cli import shared
from coilarray.compute.display_units import PER_MILLION
from coilarray.compute.files import checked_rows, has_checksums, make_folder, read_text, write_text
from coilarray.compute.store import open_store
from coilarray.errors import DamagedError, GoalError, LocalizeError, shown

if TYPE_CHECKING:
    import xarray as xr

    from coilarray.paper.ellipse_model import EllipseModel
    from coilarray.studies.calibrate import Plan


Reading = dict[str, float] | list[float]  # δ by the coils' names, or in the model's order
Record = dict[str, Any]  # answer for JSON, with only ``error`` for a bad reading
_Value = TypeVar("_Value")
_READINGS = (".csv", ".jsonl")
_PUBLISHED = "published"
_FEWER_UNKNOWNS = (
    "A map at one place, as of coilarray response --x-mm 0 --y-mm 0 --out map.nc, leaves the depth alone: "
    "--model map.nc."
)
_Solution = tuple[Callable[[Sequence[dict[str, float]]], list[Record]], dict[str, float | None], list[str]]


def read_readings(text: str) -> list[Reading | LocalizeError]:
    """Read coil1=7.1e-4,... or a .csv or .jsonl file, with bad readings as errors."""
    path = Path(text)
    suffix = path.suffix.lower()
    if suffix not in _READINGS:
        if "=" not in text:
            raise LocalizeError(
                f"READINGS must be coil1=7.1e-4,coil2=..., a file .csv or .jsonl, or -; got {shown(text)}."
            )
        parts = (part.partition("=") for part in text.split(","))
        named = _named_once([(name.strip(), value) for name, _, value in parts])
        return [{name: _number(name, value) for name, value in named.items()}]
    content = read_text(path, LocalizeError)
    lines = (line.encode() for line in content.splitlines())
    readings = list(_csv_readings(content, path) if suffix == ".csv" else line_readings(lines))
    if not readings:
        raise LocalizeError(f"there is no reading in {path}.")
    return readings


def line_readings(lines: Iterable[bytes]) -> Iterator[Reading | LocalizeError]:
    """Yield a reading, or its error, for each line."""
    for line in lines:
        try:
            yield _json_reading(line.decode("utf-8"))
        except UnicodeDecodeError:
            yield LocalizeError("a line must be UTF-8 text.")
        except LocalizeError as error:
            yield error


def _json_reading(text: str) -> Reading:
    try:
        value = json.loads(text, object_pairs_hook=_named_once)
    except LocalizeError:
        raise
    except (ValueError, RecursionError):
        raise LocalizeError(f"a reading must be JSON; got {shown(text.strip())}.") from None
    named = value if isinstance(value, dict) else dict(enumerate(value, 1)) if isinstance(value, list) else None
    if named is None:
        raise LocalizeError(f"a reading must be an object or a list of numbers; got {shown(text.strip())}.")
    for name, one in named.items():
        if isinstance(one, bool) or not isinstance(one, (int, float)):
            raise LocalizeError(f"δ of {shown(name)} must be a number; got {shown(str(one))}.")
    numbers = {str(name): _number(str(name), one) for name, one in named.items()}
    return numbers if isinstance(value, dict) else list(numbers.values())


def _csv_readings(content: str, path: Path) -> Iterator[Reading | LocalizeError]:
    try:
        rows = checked_rows(content, path) if has_checksums(content) else list(csv.reader(content.splitlines()))
    except DamagedError as error:
        raise LocalizeError(str(error)) from None
    except csv.Error as error:
        raise LocalizeError(f"cannot read {path}: {error}.") from None
    names = [name.strip() for name in rows[0]] if rows else []
    if len(set(names)) < len(names):
        raise LocalizeError(f"the first line must name every coil once; got {shown(', '.join(names))}.")
    for row in rows[1:]:
        try:
            if len(row) != len(names):
                raise LocalizeError(f"a line must have {len(names)} values; got {len(row)}.")
            yield {name: _number(name, value) for name, value in zip(names, row, strict=True)}
        except LocalizeError as error:
            yield error


def _named_once(pairs: list[tuple[str, _Value]]) -> dict[str, _Value]:
    found = dict(pairs)
    if len(found) < len(pairs):
        again = next(name for k, (name, _) in enumerate(pairs) if name in dict(pairs[:k]))
        raise LocalizeError(f"a reading must name a coil once; got {shown(again)} again.")
    return found


def _number(name: str, value: str | float) -> float:
    try:
        return float(value)
    except (ValueError, OverflowError):  # also an integer of hundreds of digits
        raise LocalizeError(f"δ of {name} must be a number; got {shown(value)}.") from None


def locate(
    readings: Annotated[
        list[str],
        typer.Argument(
            metavar="READINGS...",
            help="δ as coil1=7.1e-4,coil2=3e-4,...; or files: .csv with the coils' names in the first line, .jsonl; or "
            "- for a stream of JSON lines on standard input.",
        ),
    ],
    model: Annotated[
        str | None,
        typer.Option(
            help="Response as netCDF (.nc) or a design; gast2020 by default. Or an ellipse model of `coilarray paper "
            "fit` (.json), or `published` for that of Gast & Zimmermann (2020)."
        ),
    ] = None,
    coil: Annotated[
        list[str] | None,
        typer.Option(help="Use this coil, for example to leave out a broken one; may be repeated. All by default."),
    ] = None,
    reference: shared.References = None,
    noise: shared.Noise = None,
    as_json: shared.AsJson = False,
    allow_violations: shared.AllowViolations = False,
) -> None:
    """Find the position of an indentation or a target from δ.

    Estimates position and depth or distance by maximum likelihood over all coils. Every position
    that explains a reading is listed, such as both signs of y on a symmetric board. Positions are
    on the board. The response table of a design is computed once and kept. For a design with a
    [target] and no [indentation] it is the target's map, whose coordinates with a single value are
    known. An ellipse model gives x and y from its own origin.

    A stream gives one line of JSON for each line of input, with "error" for a bad line. The exit
    code is 2 only if no line was a reading.

    Example: coilarray locate --model gast2020
    coil1=-1e-5,coil2=3.84e-4,coil3=7.14e-4,coil4=6.8e-5,coil5=-1.3e-5,coil6=-2e-6

    Example: coilarray locate --model map.nc --coil coil1 --coil coil2 --coil coil3
    coil1=7e-4,coil2=3e-4,coil3=1e-5

    Example: read_sensor | coilarray locate --model gast2020 -
    """
    stream = "-" in readings
    if stream and len(readings) > 1:
        raise LocalizeError("a stream (-) must be the only READINGS.")
    given = [] if stream else [one for text in readings for one in read_readings(text)]
    from coilarray.design.scan_states import referenced_names
    from coilarray.hardware.record.recorded_response import less_reference
    from coilarray.localize.forward import chosen_states, require_states
    from coilarray.localize.inverse import checked_reading

    every, unknowns, compute = _model(model, allow_violations)
    used = chosen_states(every, coil or every)
    others = used
    if reference:
        referenced_names(every, reference, LocalizeError)
        used = (*used, *(name for name in reference if name not in used))
        others = referenced_names(used, reference, LocalizeError)
    try:
        require_states(others, unknowns)
    except LocalizeError as error:
        raise LocalizeError(f"{error} {_FEWER_UNKNOWNS}") from None

    def prepared(one: Reading | LocalizeError) -> dict[str, float] | LocalizeError:
        """Return δ of the used states, less the references."""
        if isinstance(one, LocalizeError):
            return one
        if isinstance(one, list) and len(one) == len(every):
            one = dict(zip(every, one, strict=True))
        if isinstance(one, dict):  # others, such as a time, are left alone
            one = {name: one[name] for name in used if name in one}
        try:
            delta = dict(zip(used, checked_reading(used, one).tolist(), strict=True))
        except LocalizeError as error:
            return error
        return {name: float(value) for name, value in less_reference(delta, reference).items()} if reference else delta

    ready = list(map(prepared, given))
    if ready and all(isinstance(one, LocalizeError) for one in ready):  # before a table is computed
        hint = "" if coil or "missing" not in str(ready[0]) else " --coil takes only the states that it names."
        raise LocalizeError(f"there is no reading in {' '.join(readings)}: {ready[0]}{hint}")
    found = compute()
    solve, assumed, said = (
        _by_response(found, used, reference, noise) if hasattr(found, "delta") else _by_ellipses(found, others)
    )
    if stream:
        _stream(lambda one: solve([fit])[0] if isinstance(fit := prepared(one), dict) else {"error": str(fit)})
        return
    from coilarray.report.position import position_table

    answers = iter(solve([one for one in ready if isinstance(one, dict)]))
    records = [next(answers) if isinstance(one, dict) else {"error": str(one)} for one in ready]
    texts = [record.get("error") or record.get("reason") for record in records]
    lines = [f"reading {k}: {text}" for k, text in enumerate(texts, start=1) if text]
    data = {**assumed, "positions": records}
    shared.print_result(data, as_json=as_json, tables=[position_table(records)], lines=[*lines, *said])


def _stream(answer: Callable[[Reading | LocalizeError], Record]) -> None:
    good, first = False, None
    try:
        for one in line_readings(sys.stdin.buffer):
            record = answer(one)
            good |= "error" not in record
            first = first or record.get("error")
            sys.stdout.write(json.dumps(record, allow_nan=False) + "\n")
            sys.stdout.flush()
    except BrokenPipeError:  # nobody listens any more
        shared.drop_output()
        return
    if not good:
        raise LocalizeError(f"there is no reading in the stream: {first or 'it is empty'}")


def _model(
    source: str | None, allow_violations: bool
) -> tuple[tuple[str, ...], int, Callable[[], xr.Dataset | EllipseModel]]:
    is_file = source is not None and source.lower().endswith(".json")
    if is_file or source == _PUBLISHED:
        from coilarray.paper.ellipse_model import published_model

        ellipses = shared.read_ellipses(Path(str(source))) if is_file else published_model()
        return ellipses.names, 2, lambda: ellipses
    if shared.is_map(source):
        response = shared.read_map(Path(str(source)), target=True)
        unknowns = sum(response.delta.sizes[name] > 1 for name in response.delta.dims if name != "state")
        return tuple(map(str, response.state.values)), unknowns, lambda: response
    design = shared.open_design(source, allow_violations=allow_violations, boards=True)
    # a table of an indentation has three unknowns, a target's table shows them itself
    unknowns = 3 if design.target is None or design.indentation is not None else 0
    return tuple(state.name for state in design.plan), unknowns, lambda: shared.kept_table(design)


def _by_response(response: Any, used: Sequence[str], reference: Sequence[str] | None, noise: float | None) -> _Solution:
    from coilarray.localize.forward import forward_model
    from coilarray.localize.inverse import locate_all
    from coilarray.report.position import location_record
    from coilarray.response.dataset import on_board

    table = on_board(response)
    model = forward_model(table).select(used)
    model = model.referenced(reference) if reference else model
    locate_all(model, [], noise=noise)  # a model that no reading fits is refused here, not at the first reading
    common = 0.0 if noise is not None else float(model.common_noise.max())
    level, worst = model.noise if noise is None else noise, max(model.errors, default=0.0)
    said = [
        f"noise of δ {PER_MILLION.text(level, '.2')} of each coil"
        + (f", {PER_MILLION.text(common, '.2')} common to all" if common else "")
        + shared.noise_source(noise, table)
    ]
    if worst:
        said.append(f"± includes the mesh error of the table, up to {PER_MILLION.text(worst, '.2')} of δ (estimated)")

    def solve(readings: Sequence[dict[str, float]]) -> list[Record]:
        return [location_record(found, model.parameters) for found in locate_all(model, readings, noise=noise)]

    return solve, {"noise": level, "common_noise": common, "table_error": worst}, said


def _by_ellipses(model: Any, names: Sequence[str]) -> _Solution:
    from coilarray.paper.ellipse_model import EllipseModel, locate_x

    widened = EllipseModel(tuple(one for one in model.coils if one.name in names)).with_semiaxis_addition()

    def crossed(reading: dict[str, float]) -> Record:
        try:
            place = locate_x(widened, reading)
        except LocalizeError as error:
            return {"status": "no position fits", "reason": str(error), "modes": []}
        modes = [{"x_m": place.x, "y_m": y} for y in ((place.y, -place.y) if place.y > 0 else (0.0,))]
        return {"status": "located", **modes[0], "case": place.case, "coils": list(place.coils), "modes": modes}

    return lambda readings: list(map(crossed, readings)), {"noise": None}, []


def calibrate(
    design: Annotated[str, typer.Argument(metavar="DESIGN", help="Design file (TOML) or name of a bundled design.")],
    data: Annotated[
        str,
        typer.Argument(
            metavar="DATA",
            help="Recording of a campaign, response (.nc), ellipse model (.json), or `published` for Table A1.",
        ),
    ] = _PUBLISHED,
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
        Path | None, shared.out_option("Folder for page, tables, netCDF and the calibrated design (calibrated.toml).")
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
    from coilarray.design.write import file_text
    from coilarray.report import measurement as report
    from coilarray.studies.calibrate import calibrate as fit_to

    if calibration is not None and not shared.is_recording(data):
        raise GoalError(f"--calibration is for a recording; {data} is not one.")
    opened = shared.open_design_file(design, allow_violations=allow_violations)
    chosen = _plan(plan, unknown, data)
    measured: xr.Dataset | EllipseModel | None = None
    if shared.is_recording(data):
        measured = shared.recorded_map(Path(data), calibration)[0]
    elif data != _PUBLISHED:
        read = shared.read_ellipses if data.lower().endswith(".json") else shared.read_map
        measured = read(Path(data))
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
    written: list[Path] = []
    if out is not None:
        page = partial(report.write_calibration_page, result, data=data)
        written = shared.write_folder(out, "calibration", page, result, tables)
        written.insert(2, out / "calibrated.toml")
        write_text(written[2], file_text(found.file, out))
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
    if plan is None and data != _PUBLISHED:
        raise GoalError("the unknown entries must be given: --plan FILE, or --unknown KEY=LOW:HIGH.")
    return load_plan("table_a1" if plan is None else plan)
