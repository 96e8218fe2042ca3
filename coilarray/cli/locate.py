"""``coilarray locate``, and the readings that it reads."""

from __future__ import annotations

import csv
import json
import math
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

import typer

from coilarray.cli import shared
from coilarray.cli.maps import depth_in_metres, is_map, kept_table, one_map, read_ellipses, read_map
from coilarray.compute.files import read_text
from coilarray.errors import DamagedError, LocalizeError, shown

if TYPE_CHECKING:
    import xarray as xr

    from coilarray.paper.ellipse_model import EllipseModel


Reading = dict[str, float] | list[float]
"""δ by the names of the coils, or in the order of the model."""
_Value = TypeVar("_Value")
_FILES = (".csv", ".json", ".jsonl")


def read_readings(text: str) -> list[Reading | LocalizeError]:
    """Read an argument: coil1=7.1e-4,... or a file .csv, .json or .jsonl.

    Returns the readings in their order, or the error of each. Raises LocalizeError for a file that cannot be read at
    all, and for no reading.
    """
    path = Path(text)
    suffix = path.suffix.lower()
    if suffix not in _FILES:
        if "=" not in text:
            raise LocalizeError(
                f"READINGS must be coil1=7.1e-4,coil2=..., a file .csv, .json or .jsonl, or -; got {shown(text)}."
            )
        return [_pairs(text)]
    content = read_text(path, LocalizeError)
    if suffix == ".csv":
        readings = list(_csv_readings(content, path))
    elif suffix == ".jsonl":
        readings = list(line_readings(line.encode() for line in content.splitlines()))
    else:
        readings = _json_file(content)
    if not readings:
        raise LocalizeError(f"there is no reading in {path}.")
    return readings


def typed_names(texts: Iterable[str]) -> list[str]:
    """Return the names in readings on the command line."""
    pairs = (text for text in texts if Path(text).suffix.lower() not in _FILES)
    return [part.partition("=")[0].strip() for text in pairs for part in text.split(",")]


def line_readings(lines: Iterable[bytes]) -> Iterator[Reading | LocalizeError]:
    """Yield a reading, or its error, for each line of JSON."""
    for line in lines:
        try:
            yield _json_reading(_parsed(line.decode("utf-8")))
        except UnicodeDecodeError:
            yield LocalizeError("a line must be UTF-8 text.")
        except LocalizeError as error:
            yield error


def _json_reading(value: object) -> Reading | LocalizeError:
    """Return a JSON object or list as a reading, or its error."""
    try:
        if isinstance(value, dict):
            return {name: _number(name, one) for name, one in value.items()}
        if isinstance(value, list):
            return [_number(f"number {k + 1}", one) for k, one in enumerate(value)]
    except LocalizeError as error:
        return error
    return LocalizeError(f"a reading must be an object or a list of numbers; got {shown(json.dumps(value))}.")


def _json_file(content: str) -> list[Reading | LocalizeError]:
    """Read a reading or a list of readings."""
    value = _parsed(content)
    several = value if isinstance(value, list) and any(isinstance(one, (dict, list)) for one in value) else [value]
    return [_json_reading(one) for one in several]


def _csv_readings(content: str, path: Path) -> Iterator[Reading | LocalizeError]:
    from coilarray.compute.checksum import checked_rows, has_checksums  # it loads NumPy

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
            yield {name: _from_text(name, value) for name, value in zip(names, row, strict=True)}
        except LocalizeError as error:
            yield error


def _pairs(text: str) -> Reading:
    parts = (part.partition("=") for part in text.split(","))
    named = _named_once([(name.strip(), value) for name, _, value in parts])
    return {name: _from_text(name, value) for name, value in named.items()}


def _parsed(text: str) -> object:
    if not text.strip():
        raise LocalizeError("the line is empty.")
    try:
        return json.loads(text, object_pairs_hook=_named_once)
    except LocalizeError:
        raise
    except (ValueError, RecursionError):
        raise LocalizeError(f"a reading must be JSON; got {shown(text.strip())}.") from None


def _named_once(pairs: list[tuple[str, _Value]]) -> dict[str, _Value]:
    found = dict(pairs)
    if len(found) < len(pairs):
        again = next(name for k, (name, _) in enumerate(pairs) if name in dict(pairs[:k]))
        raise LocalizeError(f"a reading must name a coil once; got {shown(again)} again.")
    return found


def _from_text(name: str, value: str) -> float:
    try:
        return float(value)
    except ValueError:
        raise LocalizeError(f"δ of {name} must be a number; got {shown(value)}.") from None


def _number(name: str, value: object) -> float:
    if isinstance(value, (int, float)) and not isinstance(value, bool):
        try:
            return float(value)
        except OverflowError:
            pass  # an integer of hundreds of digits
    raise LocalizeError(f"δ of {shown(name)} must be a number; got {shown(str(value))}.")


Record = dict[str, Any]
Solver = Callable[[Sequence[Reading]], list[Record]]
"""Function from readings to answers: mappings for JSON, with only ``error`` for a bad reading."""

_MOST_MM, _ADDITION_MM = 10.0, 0.2
_PUBLISHED = "published"
_FEWER_UNKNOWNS = (
    "A map at one place, as of coilarray response --x-mm 0 --y-mm 0 --out map.nc, leaves the depth alone: "
    "--model map.nc."
)


def locate(
    readings: Annotated[
        list[str],
        typer.Argument(
            metavar="READINGS...",
            help="δ as coil1=7.1e-4,coil2=3e-4,...; or files: .csv with the coils' names in the first line, .json, "
            ".jsonl; or - for a stream of JSON lines on standard input.",
        ),
    ],
    model: Annotated[
        str | None,
        typer.Option(
            help="Response as netCDF (.nc) or a design; gast2020 by default. With --ellipse also a model of "
            "`coilarray paper fit` (.json), or `published` for Table A1."
        ),
    ] = None,
    table: Annotated[
        Path | None,
        shared.file_option(
            ("--table",),
            "File of the design's response table (.nc); computed if it does not exist.",
            (".nc",),
        ),
    ] = None,
    coil: Annotated[
        list[str] | None,
        typer.Option(help="Use this coil, for example to leave out a broken one; may be repeated. All by default."),
    ] = None,
    reference: shared.References = None,
    noise: shared.Noise = None,
    ellipse: Annotated[
        bool, typer.Option("--ellipse", help="Use the ellipse model of Gast & Zimmermann (2020) instead.")
    ] = False,
    addition_mm: Annotated[
        float | None,
        typer.Option(help="With --ellipse: length added to every semi-axis A; 0.2 by default, as in the paper."),
    ] = None,
    depth_mm: Annotated[
        float | None, typer.Option(help="With --ellipse: depth of the map; the first one by default.")
    ] = None,
    as_json: shared.AsJson = False,
    allow_violations: shared.AllowViolations = False,
) -> None:
    """Find the position of an indentation or a target from δ.

    Estimates position and depth or distance by maximum likelihood over all coils. Every position that explains a
    reading is listed, such as both signs of y on a symmetric board. Positions are on the board, of an ellipse model
    from the model's own origin. The response table of a design is computed once and kept. For a design with a [target]
    and no [indentation] it is the target's map, whose coordinates with a single value are known.

    A stream gives one line of JSON for each line of input, with "error" for a bad one. The exit code is 2 only if no
    line was a reading.

    Example: coilarray locate --model gast2020
    coil1=-1e-5,coil2=3.84e-4,coil3=7.14e-4,coil4=6.8e-5,coil5=-1.3e-5,coil6=-2e-6

    Example: coilarray locate --model map.nc --coil coil1 --coil coil2 --coil coil3 coil1=7e-4,coil2=3e-4,coil3=1e-5

    Example: read_sensor | coilarray locate --model gast2020 -
    """
    stream = "-" in readings
    if stream and len(readings) > 1:
        raise LocalizeError("a stream (-) must be the only READINGS.")
    if addition_mm is not None and not ellipse:
        raise LocalizeError("--addition-mm is for --ellipse.")
    addition_mm = _ADDITION_MM if addition_mm is None else addition_mm
    if not abs(addition_mm) <= _MOST_MM:
        raise LocalizeError(f"--addition-mm must be from {-_MOST_MM:g} to {_MOST_MM:g}; got {addition_mm:g}.")
    if reference and ellipse:
        raise LocalizeError("--reference is for the response of all coils, without --ellipse.")
    depth = depth_in_metres(depth_mm)
    json_model = model is not None and model.lower().endswith(".json")
    if (json_model or model == _PUBLISHED) and not ellipse:
        raise LocalizeError(f"{model} is an ellipse model; it needs --ellipse.")
    if table is not None and (ellipse or is_map(model)):
        raise LocalizeError("--table is for the response table of a design, without --ellipse.")
    if depth is not None and not ellipse:
        raise LocalizeError("--depth-mm is for --ellipse; without it the depth is found.")
    given = [] if stream else [one for text in readings for one in read_readings(text)]
    assumed: dict[str, float | None] = {"noise": None}
    said: list[str] = []
    if ellipse:
        ellipses, origin = _ellipse_model(model, depth, coil or (), allow_violations)
        solve = _with_ellipses(ellipses, origin, coil, addition_mm * 1e-3)
    else:
        used = _response(model, table, allow_violations)
        solve, assumed, said = _with_all_coils(used, coil, reference or (), noise, given, readings)
    if stream:
        _stream(solve)
        return
    from coilarray.report.position import position_table

    records = _answers(solve, given)
    if all("error" in record for record in records):
        raise LocalizeError(f"{_none_in(readings)}: {records[0]['error']}")
    texts = [record.get("error") or record.get("reason") for record in records]
    lines = [f"reading {k}: {text}" for k, text in enumerate(texts, start=1) if text]
    data = {**assumed, "positions": records}
    shared.print_result(data, as_json=as_json, tables=[position_table(records)], lines=[*lines, *said])


def _answers(solve: Solver, readings: Sequence[Reading | LocalizeError]) -> list[Record]:
    """Return the answers to readings, errors for bad ones."""
    found = iter(solve([one for one in readings if not isinstance(one, LocalizeError)]))
    return [{"error": str(one)} if isinstance(one, LocalizeError) else next(found) for one in readings]


def _stream(solve: Solver) -> None:
    """Answer every line of standard input at once."""
    good, first = False, None
    try:
        for raw in line_readings(sys.stdin.buffer):
            (record,) = _answers(solve, [raw])
            good |= "error" not in record
            first = first or record.get("error")
            sys.stdout.write(json.dumps(record, allow_nan=False) + "\n")
            sys.stdout.flush()
    except BrokenPipeError:  # nobody listens any more
        shared.drop_output()
        return
    if not good:
        raise LocalizeError(f"there is no reading in the stream: {first or 'it is empty'}")


@dataclass(frozen=True)
class _Response:
    """Response with its states and unknowns, computed on demand."""

    states: tuple[str, ...]
    unknowns: int
    compute: Callable[[], xr.Dataset]


def _response(source: str | None, table: Path | None, allow_violations: bool) -> _Response:
    if is_map(source):
        response = read_map(Path(str(source)), target=True)
        states = tuple(str(name) for name in response.state.values)
        unknowns = sum(response.delta.sizes[name] > 1 for name in response.delta.dims if name != "state")
        return _Response(states, unknowns, lambda: response)
    design = shared.open_design(source, allow_violations=allow_violations)
    # the table of an indentation has three unknowns; that of a target shows them itself
    unknowns = 3 if design.target is None or design.indentation is not None else 0
    return _Response(tuple(state.name for state in design.plan), unknowns, lambda: kept_table(design, table))


def _ellipse_model(
    source: str | None, depth: float | None, coils: Sequence[str], allow_violations: bool
) -> tuple[EllipseModel, tuple[float, float]]:
    """Return an ellipse model and its origin on the board in m."""
    from coilarray.paper.ellipse import fit_ellipses
    from coilarray.paper.ellipse_model import ellipse_model
    from coilarray.paper.published import published_model
    from coilarray.response.dataset import origin_of

    if source == _PUBLISHED:
        return published_model(), (0.0, 0.0)
    if source is not None and source.lower().endswith(".json"):
        return read_ellipses(Path(source)), (0.0, 0.0)
    response = one_map(source, depth, allow_violations=allow_violations, coils=coils)
    return ellipse_model(fit_ellipses(response, depth)), origin_of(response)


def _none_in(readings: Sequence[str]) -> str:
    return f"there is no reading in {' '.join(readings)}"


def _with_all_coils(
    response: _Response,
    coils: Sequence[str] | None,
    reference: Sequence[str],
    noise: float | None,
    given: Sequence[Reading | LocalizeError],
    readings: Sequence[str],
) -> tuple[Solver, dict[str, float | None], list[str]]:
    """Solve by maximum likelihood, and describe the assumed noise.

    Errors that no response could mend are raised before a response is computed. `given` are the readings of the texts
    of the command line, empty for a stream.
    """
    from coilarray.compute.display_units import PER_MILLION
    from coilarray.design.scan_states import referenced_names
    from coilarray.hardware.record.recorded_response import less_reference
    from coilarray.localize.forward import checked_noise, chosen_states, forward_model, require_states
    from coilarray.localize.inverse import checked_reading, locate_all
    from coilarray.report.position import location_record
    from coilarray.response.dataset import on_board

    every = response.states
    used = chosen_states(every, coils or every)
    others = used
    if reference:
        referenced_names(every, reference, LocalizeError)
        used = (*used, *(name for name in reference if name not in used))
        others = referenced_names(used, reference, LocalizeError)
    if noise is not None:
        checked_noise(others, noise)
    try:
        require_states(others, response.unknowns)
    except LocalizeError as error:
        raise LocalizeError(f"{error} {_FEWER_UNKNOWNS}") from None
    for name in typed_names(readings) if given else []:
        if name not in every and get_close_matches(name, every):  # a time, for example, is left alone
            raise LocalizeError(f"a reading must name coils of the model, {', '.join(every)}; got {shown(name)}.")
    wrong = []
    for one in given:
        try:
            if isinstance(one, LocalizeError):
                raise one
            checked_reading(used, _of_states(one, used, every))
        except LocalizeError as error:
            wrong.append(error)
    if given and len(wrong) == len(given):
        hint = "" if coils or "missing" not in str(wrong[0]) else " --coil takes only the states that it names."
        raise LocalizeError(f"{_none_in(readings)}: {wrong[0]}{hint}")
    table = on_board(response.compute())
    model = forward_model(table).select(used)
    model = model.referenced(reference) if reference else model
    locate_all(model, [], noise=noise)  # a model that no reading fits is refused here, not at the first reading

    def located(readings: Sequence[Reading]) -> list[Record]:
        return [location_record(found, model.parameters) for found in locate_all(model, readings, noise=noise)]

    def less(one: Reading) -> Reading | LocalizeError:
        try:
            values = checked_reading(used, one).tolist()
        except LocalizeError as error:
            return error
        left = less_reference(dict(zip(used, values, strict=True)), reference)
        return {name: float(value) for name, value in left.items()}

    def solve(readings: Sequence[Reading]) -> list[Record]:
        good = [_of_states(one, used, every) for one in readings]
        return _answers(located, [less(one) for one in good]) if reference else located(good)

    common = 0.0 if noise is not None else float(model.common_noise.max())
    level, worst = model.noise if noise is None else noise, max(model.errors, default=0.0)
    said = [
        f"noise of δ {PER_MILLION.text(level, '.2')} of each coil"
        + (f", {PER_MILLION.text(common, '.2')} common to all" if common else "")
        + shared.noise_source(noise, table)
    ]
    if worst:
        said.append(f"± includes the mesh error of the table, up to {PER_MILLION.text(worst, '.2')} of δ (estimated)")
    return solve, {"noise": level, "common_noise": common, "table_error": worst}, said


def _of_states(reading: Reading, used: Sequence[str], every: Sequence[str]) -> Reading:
    """Return the δ of the used states, from a list of all or a mapping."""
    if isinstance(reading, dict):  # a time, for example; a misspelt coil is noticed as missing
        return {name: reading[name] for name in used if name in reading}
    if len(reading) == len(every):
        by_name = dict(zip(every, reading, strict=True))
        return [by_name[name] for name in used]  # in the order of --coil, as the model's
    return reading


def _with_ellipses(
    model: EllipseModel, origin: tuple[float, float], coils: Sequence[str] | None, addition: float
) -> Solver:
    """Intersect two ellipses."""
    from coilarray.paper.ellipse_model import EllipseModel as Model

    wanted = {model[name].name for name in coils or model.names}
    used = Model(tuple(one for one in model.coils if one.name in wanted))
    widened = used.with_semiaxis_addition(addition)
    if len(used.coils) < 2:
        raise LocalizeError(f"two coils are needed for a position; the model has {', '.join(used.names)}.")
    return lambda readings: [_crossed(widened, origin, one, model.names) for one in readings]


def _crossed(model: EllipseModel, origin: tuple[float, float], reading: Reading, names: Sequence[str]) -> Record:
    from coilarray.paper.ellipse_model import locate_x

    if not isinstance(reading, dict):
        if len(reading) != len(names):
            return {"error": f"a reading must have one δ for each of {len(names)} coils; got {len(reading)}."}
        reading = dict(zip(names, reading, strict=True))
    for name in model.names:
        if name not in reading:
            return {"error": f"the reading of {name} is missing."}
        if not math.isfinite(reading[name]):
            return {"error": f"the reading of {name} must be finite; got {reading[name]}."}
    try:
        place = locate_x(model, reading)
    except LocalizeError as error:
        return {"status": "no position fits", "reason": str(error), "modes": []}
    at_x, at_y = origin
    modes = [{"x_m": at_x + place.x, "y_m": at_y + y} for y in ((place.y, -place.y) if place.y > 0 else (0.0,))]
    return {"status": "located", **modes[0], "case": place.case, "coils": list(place.coils), "modes": modes}
