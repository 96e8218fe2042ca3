"""Arguments, options, reading, writing and printing of several commands."""

from __future__ import annotations

import itertools
import json
import os
import re
import shutil
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from coilarray.compute.files import is_own, read_text, write_atomically, write_text, writing
from coilarray.compute.store import Keep, not_kept, open_store
from coilarray.compute.table import Table, fill
from coilarray.compute.threads import Progress, cores
from coilarray.errors import ClusterError, CoilarrayError, ElastomerError, LocalizeError, NetworkError, OutputError

if TYPE_CHECKING:
    from concurrent.futures import Executor

    import xarray as xr
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from coilarray.compute.arrays import FloatArray
    from coilarray.design.model import Design, DesignFile, Indentation
    from coilarray.geometry import Target
    from coilarray.hardware.record.recording import Recording
    from coilarray.paper.ellipse_model import EllipseModel


MARK = "[emulator] "  # start of every line about an emulated board
MARKS = {"ok": "✔", "bad": "✖", "warn": "⚠"}  # of the kinds of a verdict
_COLOURS = {"✔": "green", "✖": "red", "⚠": "yellow"}
_CODES = re.compile(r"\x1b\[[0-9;]*m")  # of colours
_LOOSE_MINUS = re.compile(r"(?<![^\s(\[±])-(?=\.?\d)")  # before a number in a sentence, not in a command
_SQLITE = b"SQLite format 3\0"  # begins every file of SQLite
_RECORDING = ".sqlite"


def file_option(names: Sequence[str], text: str, suffixes: Sequence[str] = (), *, printed: bool = False) -> Any:
    """Return an option for a file, checked before any work."""

    def check(context: typer.Context, parameter: typer.CallbackParam, path: Path | None) -> Path | None:
        source = context.get_parameter_source(str(parameter.name))
        if printed and context.params["as_json"] and source is not None and source.name == "DEFAULT":  # JSON instead
            return None
        if suffixes:
            check_file(names[0], path, suffixes)
        if path is not None and source is not None and source.name == "DEFAULT" and not is_own(path):
            raise OutputError(f"{path} exists and is not from coilarray; name another file with {names[0]}.")
        return path

    return typer.Option(*names, help=text, callback=check)


def number_option(name: str, low: float, high: float, text: str, *, above: bool = False) -> Any:
    """Return an option for a number from `low` to `high`."""
    allowed = f"above {low:.12g} and at most {high:.12g}" if above else f"{low:.12g} to {high:.12g}"

    def check(value: float | None) -> float | None:
        if value is not None and not (low <= value <= high and (value > low or not above)):
            raise CoilarrayError(f"{name} must be {allowed}; got {value:.12g}.")
        return value

    return typer.Option(name, help=text, callback=check)


def out_option(text: str, *suffixes: str, printed: bool = False) -> Any:
    """Return the option --out with its help text."""
    return file_option(("--out", "-o"), text, suffixes, printed=printed)


def plot_option(what: str, name: str = "--plot") -> Any:
    """Return the option for a picture."""
    return file_option((name,), f"Also draw {what}: .png, .svg or .pdf.", (".png", ".svg", ".pdf"))


DesignArgument = Annotated[
    str | None,
    typer.Argument(metavar="DESIGN", help="Design file (TOML) or name of a bundled design; gast2020 by default."),
]
AllowViolations = Annotated[
    bool,
    typer.Option(
        "--allow-violations",
        help="Accept a design that breaks a fabrication rule; the inductance of overlapping traces is not meaningful.",
    ),
]
AsJson = Annotated[
    bool, typer.Option("--json", help="Print the numbers as JSON in SI units, and nothing else.", is_eager=True)
]
Every = Annotated[bool, typer.Option("--all", help="Print every row, also of coils that are alike.")]
Force = Annotated[bool, typer.Option("--force", help="Replace a file that exists.")]
Accuracy = Annotated[
    Literal["full", "screen"], typer.Option("--accuracy", help="Accuracy of the inductances; screen is much faster.")
]
Goals = Annotated[
    list[str] | None,
    typer.Option(
        "--goal",
        help="One of worst_k, decouple, position_error, smallest (board), and range or resolution (of a target), "
        "which fit any design; or minimize QUANTITY, maximize QUANTITY or QUANTITY=VALUE; may be repeated.",
    ),
]
Vary = Annotated[
    list[str] | None,
    typer.Option(
        "--vary",
        help="Entry of the design to vary: KEY=START:STOP, KEY=START:STOP:COUNT or KEY=A,B,…; may be repeated. Those "
        "of the goal by default.",
    ),
]
Quantities = Annotated[
    list[str] | None,
    typer.Option("--quantity", "-q", help='Quantity to compute, such as worst_k or "k[coil1,coil2]"; may be repeated.'),
]
References = Annotated[
    list[str] | None,
    typer.Option(
        "--reference",
        metavar="COIL",
        help="Reference coil, which nothing touches: its δ is subtracted from that of the others, which removes "
        "their common drift; may be repeated.",
    ),
]
BoardConstants = Annotated[
    Path | None,
    typer.Option(
        "--calibration",
        help="Constants of the board of a recorded campaign, found by coilarray board calibrate (.toml).",
    ),
]
Resume = Annotated[bool, typer.Option("--resume", help="Continue the recording if the file exists.")]
Workers = Annotated[
    int | None,
    typer.Option("--workers", help="Number of local processes, of one thread each; one per core by default."),
]
Cluster = Annotated[
    str | None,
    typer.Option("--cluster", metavar="tcp://HOST:PORT", help="Dask scheduler; its workers compute instead."),
]
Cache = Annotated[
    Path | None, typer.Option("--cache", metavar="DIR", help="Folder of stored results; the user's cache by default.")
]
Depths = Annotated[
    str | None, typer.Option("--depth-mm", help="Depths, such as 0.5,1 or START:STOP:COUNT; the design's by default.")
]
PlacesX = Annotated[
    str | None,
    typer.Option(help="Positions along x on the board, such as 0,5 or START:STOP:COUNT; the design's by default."),
]
PlacesY = Annotated[str | None, typer.Option(help="Positions along y, in the same form.")]
Ideal = Annotated[
    bool, typer.Option("--ideal/--strays", help="Leave AC resistance and stray capacitances out of the circuit.")
]
Noise = Annotated[
    float | None,
    number_option(
        "--noise",
        0,
        1,
        "Standard deviation of δ of a reading; that of the design's noise budget by default.",
        above=True,
    ),
]
NumbersFile = Annotated[
    Path | None,
    out_option("File to write: .nc (netCDF) or .csv; with --json only if it is given.", ".nc", ".csv", printed=True),
]

SMALLEST_MM, LONGEST_MM = 1e-6, 100_000.0
_MOST_LENGTHS = 1000


def open_design(name: str | None, *, allow_violations: bool, boards: bool = False) -> Design:
    """Read a design, whose broken rules must be allowed, and which may have several boards only if told."""
    return open_design_file(name, allow_violations=allow_violations, boards=boards).design


def open_design_file(name: str | None, *, allow_violations: bool, boards: bool = False) -> DesignFile:
    """As `open_design`, with what only the file says."""
    from coilarray.design.model import load_design_file, one_board
    from coilarray.errors import RuleViolationError
    from coilarray.geometry import require_rules

    file = load_design_file(name)
    if not boards:
        one_board(file.design, "this command")
    for board in () if allow_violations else file.design.placed:
        try:
            require_rules(board.array, board.design.rules)
        except RuleViolationError as error:
            raise RuleViolationError(f"{board.name or file.design.name}: {error}") from None
    return file


def design_record(design: Design) -> dict[str, str]:
    """Return name and hash of a design for JSON."""
    return {"design": design.name, "design_hash": design.digest}


@contextmanager
def map_parts(out: Path | None) -> Iterator[Keep]:
    """Keep a map's parts beside its file until written."""
    if out is None:
        yield not_kept
        return

    store = open_store(out.with_name(f"{out.name}.parts"))
    kept = store.keys()
    try:
        yield store.dataset
        store.discard(store.keys())
    except NetworkError:
        store.discard(store.keys() - kept)  # of no use: going on would end in the same way
        raise
    finally:
        store.discard(())  # the folder, where nothing was computed


def from_map_origin(
    setup: Indentation | Target | None, x: Sequence[float] | None, y: Sequence[float] | None
) -> tuple[tuple[float, ...] | None, ...]:
    """Return positions on the board (m) from a map's origin."""
    from coilarray.response.dataset import from_board, map_origin

    rows = zip((x, y), map_origin(setup), strict=True)
    return tuple(None if row is None else from_board(row, at) for row, at in rows)


def lengths(option: str, text: str | None, *, positive: bool = False) -> list[float] | None:
    """Convert a rising list or START:STOP:COUNT from mm to m."""
    if text is None:
        return None
    import numpy as np

    parts = text.split(":")
    try:
        if len(parts) == 3:
            start, stop, count = float(parts[0]), float(parts[1]), int(parts[2])
            values = np.linspace(start, stop, count).tolist() if 2 <= count <= _MOST_LENGTHS else []
        else:
            values = [float(part) for part in text.split(",")]
    except ValueError:
        values = []
    rising = all(low < high for low, high in itertools.pairwise(values))
    low = positive and min(values, default=1.0) <= 0
    far = not all(abs(value) <= LONGEST_MM for value in values)
    if low or far or not (0 < len(values) <= _MOST_LENGTHS and rising):
        bound = f", above 0 and at most {LONGEST_MM:g}" if low else f", at most {LONGEST_MM:g}" if far else ""
        raise ElastomerError(
            f"{option} must be rising numbers of mm{bound}, such as 0.5,1 or START:STOP:COUNT with 2 to "
            f"{_MOST_LENGTHS} of them; got {text!r}."
        )
    return [value * 1e-3 for value in values]


def require_new(path: Path, *, force: bool) -> None:
    """Refuse without `force` an existing file or filled folder."""
    if not force and (any(path.iterdir()) if path.is_dir() else path.exists()):
        raise OutputError(f"{path} exists; --force replaces it.")


def check_file(option: str, path: Path | None, suffixes: Sequence[str] | None) -> None:
    """Refuse before any work a file that cannot be written."""
    if path is None:
        return
    if suffixes is not None and path.suffix.lower() not in suffixes:
        listed = " or ".join([", ".join(suffixes[:-1]), suffixes[-1]] if len(suffixes) > 1 else suffixes)
        raise OutputError(f"{option} must end in {listed}; got {path}.")
    with writing(path):
        taken, placed = path.is_dir(), path.parent.is_dir()
    if taken:
        raise OutputError(f"cannot write {path}: it is a folder.")
    if not placed:
        raise OutputError(f"cannot write {path}: there is no folder {path.parent}.")
    check_folder(path.parent)


def check_folder(path: Path) -> None:
    """Refuse before any work a folder that cannot be written."""
    with writing(path):
        there = next(folder for folder in (path, *path.parents) if folder.exists())  # at last . or /
    if not there.is_dir():
        raise OutputError(f"cannot make the folder {there}: a file has that name.")
    if not os.access(there, os.W_OK):
        raise OutputError(f"cannot write in {path}: the folder {there} is not writable.")


def write_numbers(out: Path | None, dataset: xr.Dataset, csv: Callable[[], str]) -> None:
    """Write a dataset as netCDF, or its table as CSV."""
    from coilarray.compute.netcdf import save_dataset

    if out is not None and out.suffix.lower() == ".nc":
        save_dataset(dataset, out)
    elif out is not None:
        write_text(out, csv())


def write_folder(
    out: Path, name: str, page: Callable[[Path], None], dataset: xr.Dataset, tables: Sequence[Table]
) -> list[Path]:
    """Write a page, its numbers and its tables into a folder."""
    from coilarray.compute.netcdf import save_dataset

    written = [out / f"{name}.html", out / f"{name}.nc", *(out / f"{table.name}.csv" for table in tables)]
    page(written[0])
    save_dataset(dataset, written[1])
    for path, table in zip(written[2:], tables, strict=True):
        write_text(path, table.csv())
    return written


def open_page(path: Path) -> None:
    """Open a page in the browser."""
    import webbrowser

    if not webbrowser.open(path.resolve().as_uri()):
        raise OutputError(f"no browser can be opened here; the page is {path}.")


def wrote_map(out: Path | None, result: xr.Dataset) -> str:
    """Say how many values of δ are written."""
    return f"wrote {out}: {' × '.join(map(str, result.delta.shape))} values over {', '.join(result.delta.dims)}"


def draw(path: Path | None, plot: Callable[[], Figure | Axes]) -> None:
    """Draw a figure into a file, if one is given."""
    if path is None:
        return
    from coilarray.viz.plots.style import save

    drawn = plot()
    figure: Any = drawn if hasattr(drawn, "savefig") else drawn.figure
    write_atomically(path, lambda temporary: save(figure, temporary))


def print_result(
    data: Mapping[str, Any],
    *,
    as_json: bool,
    tables: Sequence[Table] = (),
    lines: Sequence[str | Table] = (),
    files: Sequence[Path | None] = (),
    emulated: bool = False,
) -> None:
    """Print `data` as JSON, or tables, sentences and written files."""
    if as_json:
        print_json(data)
        return
    for table in tables:
        say(table)
        if len(tables) > 1:
            say("")
    for line in (*lines, *(f"wrote {path}" for path in files if path is not None)):
        say(line, emulated=emulated)


def marked(text: str, *, emulated: bool) -> str:
    """Return a text, each line marked for emulated boards."""
    return "\n".join(f"{MARK}{line}".rstrip() for line in text.splitlines()) if emulated else text


def missing_capacitance(design: Design, quantities: Sequence[str] = ("q",)) -> list[str]:
    """Return a line on windings without a needed capacitance."""
    from coilarray.circuit.board_circuit import board_circuit
    from coilarray.studies.quantities import request

    needed = any(request(name).quantity.is_read for name in quantities)
    return left_out_lines(board_circuit(design).windings.capacitance[1] if needed else "")


def left_out_lines(left_out: str) -> list[str]:
    """Return a line on effects that are left out."""
    return [f"not in these numbers: {left_out}"] if left_out else []


def noise_source(given: float | None, response: xr.Dataset) -> str:
    """Describe the source of the noise of δ, unless given."""
    if given is not None:
        return ""
    return " from the noise budget" if "noise" in response.attrs else " by default, as the response states none"


def plate_error_lines(attributes: Mapping[Any, Any]) -> list[str]:
    """Return a line on errors of plates with outlines."""
    if "plate_error_inductance" not in attributes:
        return []
    errors = [100 * attributes[f"plate_error_{name}"] for name in ("inductance", "resistance")]
    L, R = (f"{error:.2g}" if error < 100 else f"{error:.0f}" for error in errors)
    return [
        f"the change by a plate with an outline errs by up to {L} % of ΔL and {R} % of ΔR (estimated: its mesh, and "
        f"currents on faces and rim of a plate that is {attributes['plate_skin_depths']:.2g} skin depths thick)"
    ]


def print_json(data: Any) -> None:
    """Print a value as JSON, without infinite numbers and NaN."""
    typer.echo(json.dumps(data, indent=1, allow_nan=False))


def terminal_width(*, err: bool = False) -> int | None:
    """Characters of the terminal's line, None if redirected."""
    stream = sys.stderr if err else sys.stdout
    return shutil.get_terminal_size().columns if stream is not None and stream.isatty() else None


def say(text: str | Table, *, err: bool = False, emulated: bool = False) -> None:
    """Print a table or lines, wrapped at the width of the terminal."""
    width = terminal_width(err=err)
    inside = None if width is None else width - len(MARK) * emulated
    if isinstance(text, Table):
        shown = text.text(inside)
    else:
        shown = fill(text if width is None else _LOOSE_MINUS.sub("−", text), inside)
        if shown[:1] in _COLOURS and not err:
            shown = typer.style(shown[0], fg=_COLOURS[shown[0]], bold=True) + shown[1:]
    shown, stream = marked(shown, emulated=emulated), sys.stderr if err else sys.stdout
    if stream is not None:  # a progress bar shows above itself what is printed
        print(shown if stream.isatty() else _CODES.sub("", shown), file=stream, flush=True)


def drop_output() -> None:
    """Redirect standard output to nothing, as it cannot be written."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


@contextmanager
def progress_bar(text: str, steps: Sequence[str] = ()) -> Iterator[Callable[..., None]]:
    """Show a progress bar on a terminal, with the step that runs."""
    from rich.console import Console
    from rich.progress import BarColumn, TaskProgressColumn, TextColumn, TimeElapsedColumn
    from rich.progress import Progress as Bar

    console = Console(stderr=True)
    # no time that is left: steps take unequal times
    columns = (TextColumn("{task.description}"), BarColumn(20), TaskProgressColumn(), TimeElapsedColumn())
    redirect = sys.stdout is not None and sys.stdout.isatty()  # else what is printed is for a file
    look: dict[str, Any] = {"transient": True, "disable": not console.is_terminal, "redirect_stdout": redirect}
    with Bar(*columns, console=console, **look) as bar:
        first = f"{text}: {steps[0]}" if steps else text
        task = bar.add_task(first, total=None)

        def update(done: int, total: int, step: str = "") -> None:
            step = step or (steps[done] if done < len(steps) else "")
            bar.update(task, completed=done, total=total, description=f"{text}: {step}" if step else text)

        yield update


@contextmanager
def chosen_workers(workers: int | None, cluster: str | None, tasks: int | None = None) -> Iterator[int | Executor]:
    """Open the executor of --cluster, or return --workers."""
    from coilarray.compute.workers import MOST_WORKERS, dask_executor

    if cluster is None:
        yield workers if workers is not None else min(cores(), MOST_WORKERS, tasks or MOST_WORKERS)
    else:
        with dask_executor(cluster) as executor:
            yield executor


def check_workers(workers: int | None, cluster: str | None) -> None:
    """Refuse --workers together with --cluster."""
    if workers is not None and cluster is not None:
        raise ClusterError("--workers is for processes on this machine; it cannot be given with --cluster.")


@contextmanager
def resumable(
    kept: Callable[[int], str], done: int = 0
) -> Iterator[Callable[[Callable[..., None]], Callable[..., None]]]:
    """Say what is kept when interrupted; yield a wrapper that counts."""

    def counting(show: Callable[..., None]) -> Callable[..., None]:
        def progress(now: int, *rest: Any) -> None:
            nonlocal done
            done = max(done, now)
            show(now, *rest)

        return progress

    try:
        yield counting
    except (KeyboardInterrupt, ClusterError):
        if done:
            say(f"coilarray: {kept(done)}; the same command continues from there", err=True)
        raise


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
        say(f"{path} is of an emulated board: no real board was measured.", err=True, emulated=True)
    return response


def read_response(path: Path, *, target: bool = False) -> xr.Dataset:
    """Read a response, or with `target` a target's map too."""
    from coilarray.compute.netcdf import read_checked
    from coilarray.response.dataset import RESPONSE, TARGET_MAP

    return read_checked(path, RESPONSE, *([TARGET_MAP] if target else []))


def recorded_map(path: Path, calibration: Path | None) -> tuple[xr.Dataset, list[FloatArray]]:
    """Read a campaign's response, and coil outlines in m."""
    from coilarray.hardware.record.recording import open_recording
    from coilarray.report.page import map_outlines

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
    from coilarray.paper.ellipse_model import model_from_json

    return model_from_json(read_text(path, LocalizeError))


def kept_table(design: Design) -> xr.Dataset:
    """Return a design's response table, stored or computed."""
    with progress_bar(f"table of {design.name}") as progress:
        return stored_table(design, progress=progress)


def stored_table(design: Design, *, progress: Progress) -> xr.Dataset:
    """Return the response table of a design from the store."""
    from coilarray.localize.forward import table_for

    store = open_store()
    return store.dataset(("readable positions", design.digest), lambda: table_for(design, progress=progress))
