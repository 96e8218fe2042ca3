"""Options and settings files shared by the commands for a board, and the mark on lines about an emulated one."""

from __future__ import annotations

import csv
import inspect
import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, fields, replace
from functools import cached_property, wraps
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, get_type_hints

import typer

from coilarray.cli.shared import open_design_file, print_json, terminal_width
from coilarray.compute.files import read_text
from coilarray.errors import HardwareError

if TYPE_CHECKING:
    from coilarray.cli.board.files import BoardSettings
    from coilarray.compute.table import Table
    from coilarray.compute.threads import Progress
    from coilarray.design.model import Design, DesignFile
    from coilarray.hardware.board.connect import Board
    from coilarray.hardware.scan.settings import ScanSettings
    from coilarray.hardware.scan.wiring import Wiring

EMULATOR = "emulator"
MARK = "[emulator] "
"""Start of every line about an emulated board."""

WiringName = Annotated[
    str | None, typer.Option("--wiring", help="Wiring file (TOML) or name of a bundled one; six_coils by default.")
]
SettingsFile = Annotated[
    Path | None,
    typer.Option(
        "--settings",
        help="File (TOML) with settings of this board: its clock, drive currents, discarded conversions, coils at "
        "channels, thermometer; and of a live display.",
    ),
]

_PATH_COLUMNS = ["time_s", "x_mm", "y_mm", "depth_mm"]
_LARGEST_SEED = 2**63
_LONGEST_PATH = 1_000_000  # lines


@dataclass(frozen=True)
class BoardOptions:
    """Options of a command with a board, checked; `board_command` adds them to a command.

    Raises
    ------
    HardwareError
        An invalid value: which option, and what is allowed.
    """

    port: Annotated[
        str,
        typer.Option(
            help="Board: /dev/ttyACM0, COM5 or usb:SERIALNUMBER (microcontroller), "
            "i2c:1[:0x2A][,spi:0.0] (Linux), ftdi://ftdi:232h/1 (FT232H); the emulator by default. Without switches, "
            "coils at the channels of a converter: i2c:1?channels=0,1&clock=40MHz; also after ftdi://... and emulator."
        ),
    ] = EMULATOR
    wiring: WiringName = None
    rate: Annotated[
        float | None,
        typer.Option(help="Scans per second, estimated with the I²C clock of the port; full resolution by default."),
    ] = None
    settings: SettingsFile = None
    emulate: Annotated[
        list[str] | None,
        typer.Option(
            help="Behaviour of the emulator; may be repeated: seed=1, noise=1e-7 (relative, of f), drift=0.01 "
            "(K/s), clock_MHz=36 (of its oscillator), press=X,Y,DEPTH (mm on the board; "
            "in live, after the baseline), path=FILE.csv (columns time_s, x_mm, y_mm, depth_mm), "
            "switches=counted (include the capacitances of the wiring's parts: typical, not verified)."
        ),
    ] = None
    emulation: dict[str, Any] = field(init=False)

    def __post_init__(self) -> None:
        if self.rate is not None and not (math.isfinite(self.rate) and self.rate > 0):
            raise HardwareError(f"--rate must be positive and finite; got {self.rate:g}.")
        if self.emulate and not is_emulator(self.port):
            raise HardwareError(f"--emulate is for the emulator; {self.port} is a real board.")
        assert self.file  # read once, so that mistakes show at once
        object.__setattr__(self, "emulation", _emulation(self.emulate or ()))

    @cached_property
    def file(self) -> BoardSettings:
        """Settings of the board."""
        from coilarray.cli.board.files import read_settings  # loads pydantic, which no help needs

        return read_settings(self.settings)

    @property
    def given(self) -> list[str]:
        """Names of the options for a board that are not left at their defaults."""
        names = ("port", "wiring", "rate", "emulate")
        return [f"--{name}" for name in names if getattr(self, name) not in (getattr(BoardOptions, name), [])]

    def design(self, name: str | None) -> Design:
        """Read a design, which must keep the fabrication rules unless the settings allow violations."""
        return self.design_file(name).design

    def design_file(self, name: str | None) -> DesignFile:
        """As `design`, with what only the file says."""
        return open_design_file(name, allow_violations=self.file.allow_violations)

    def path_of(self, design: Design) -> list[tuple[float, float, float, float]] | None:
        """Return the path of an emulated finger, time in s and x, y and depth in m, counted from the map's origin."""
        path = self.emulation.get("press", self.emulation.get("path"))
        if path is None:
            return None
        from coilarray.response.dataset import map_origin

        at_x, at_y = map_origin(design.indentation)
        return [(time, x - at_x, y - at_y, depth) for time, x, y, depth in path]


def is_emulator(port: str) -> bool:
    """Whether the name of a port is that of an emulated board."""
    return port.partition("?")[0].strip() == EMULATOR


def board_command(*, without: Sequence[str] = ()) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Return a decorator that replaces the parameter ``options`` of a command by the fields of `BoardOptions`.

    The command does not have the fields whose names are in `without`.
    """
    hints = get_type_hints(BoardOptions, include_extras=True)
    shared = [
        inspect.Parameter(one.name, inspect.Parameter.KEYWORD_ONLY, default=one.default, annotation=hints[one.name])
        for one in fields(BoardOptions)
        if one.init and one.name not in without
    ]

    def decorate(command: Callable[..., None]) -> Callable[..., None]:
        @wraps(command)
        def with_options(**given: Any) -> None:
            command(options=BoardOptions(**{one.name: given.pop(one.name) for one in shared}), **given)

        parameters: list[inspect.Parameter] = []
        for own in inspect.signature(command, eval_str=True).parameters.values():
            parameters += shared if own.name == "options" else [own.replace(kind=inspect.Parameter.KEYWORD_ONLY)]
        shown: Any = with_options
        shown.__signature__ = inspect.Signature(parameters)  # typer reads the parameters from here
        shown.__annotations__ = {one.name: one.annotation for one in parameters}
        return with_options

    return decorate


@contextmanager
def opened_board(
    options: BoardOptions, design: Design, *, real_time: bool, progress: Progress | None = None
) -> Iterator[tuple[Board, ScanSettings]]:
    """Open the board of the options and configure it for the coils of a design, for the length of a ``with`` block.

    Its coils are grounded whichever way the block is left. With `real_time` the emulator takes as long as a board
    would, otherwise its time is virtual; `progress` gets (done, total) while it computes its response table.
    """
    from coilarray.hardware.board.connect import open_board, wiring_of_board
    from coilarray.hardware.record.recorder import thermometer
    from coilarray.hardware.wire.ports import parse_port

    port = parse_port(options.port)
    wiring = wiring_of_board(port, design, options.wiring, options.file.coils)
    settings = _scan_settings(options, design, wiring)
    emulated = is_emulator(options.port)
    emulation = _emulated(options, design, real_time=real_time) if emulated else {}
    if emulated and progress is not None:
        emulation["progress"] = progress
    with ExitStack() as opened:
        read = None
        if options.file.thermometer is not None and not emulated:
            read = opened.enter_context(thermometer(Path(options.file.thermometer)))
        board = opened.enter_context(open_board(options.port, design=design, wiring=wiring, **emulation))
        board.thermometer = read or board.thermometer
        board.reader.configure(settings)
        yield board, settings


def _scan_settings(options: BoardOptions, design: Design, wiring: Wiring) -> ScanSettings:
    """Make the settings of a scan from the options and the settings of the board."""
    from coilarray.hardware.chips.ldc1614 import EXTERNAL_CLOCK_RANGE, INTERNAL_CLOCK_RANGE
    from coilarray.hardware.scan.design_settings import design_settings
    from coilarray.hardware.scan.settings import ConverterClock
    from coilarray.hardware.wire.ports import board_of, bus_rate, parse_port

    port, file = parse_port(options.port), options.file
    channels = board_of(port)
    clock, external = (None, False) if channels is None else (channels.clock, channels.clock is not None)
    if file.clock is not None:
        clock, external = file.clock * 1e6, file.external_clock or external
        low, high = EXTERNAL_CLOCK_RANGE if external else INTERNAL_CLOCK_RANGE
        if not low <= clock <= high:
            whose = "at the pin CLKIN" if external else "of the converter's own oscillator"
            raise HardwareError(
                f"{options.settings}: clock_MHz must be {low * 1e-6:g} to {high * 1e-6:g} {whose}; got {file.clock:g}."
            )
    try:
        return design_settings(
            design,
            wiring,
            states=file.states,
            rate=options.rate,
            clock=ConverterClock(clock, external),
            drives=file.drives if file.drive is None else dict.fromkeys(wiring.coils, file.drive) | file.drives,
            discard=file.discard,
            bus_rate=bus_rate(port),
        )
    except HardwareError as error:
        if not str(error).startswith("rate "):
            raise
        raise HardwareError(f"--{error}") from None


def _emulated(options: BoardOptions, design: Design, *, real_time: bool) -> dict[str, Any]:
    """Return the keyword arguments of `emulated_board`."""
    from coilarray.hardware.emulator import Conditions, Drift, Oscillator, PacedClock

    given = options.emulation
    drift, path = Drift(rate=given.get("drift", 0.0)), options.path_of(design)
    arguments: dict[str, Any] = {"seed": given.get("seed", 0), "count_parts": "switches" in given}
    if real_time:
        clock = arguments["clock"] = PacedClock()
        start = clock.now()
        # the board has room temperature now, not when the computer was started
        drift = replace(drift, start=drift.start - drift.rate * start)
        path = path and [(start + time, x, y, depth) for time, x, y, depth in path]
    oscillator = Oscillator(given["clock_MHz"] * 1e6) if "clock_MHz" in given else Oscillator()
    conditions = Conditions(oscillator, drift, given.get("noise"))
    return arguments | {"conditions": conditions, "path": path}


def print_marked(data: Any, parts: Sequence[str | Table], *, as_json: bool, emulated: bool) -> None:
    """Print the result of a command with a board: `data` as JSON and nothing else, or marked texts for people."""
    if as_json:
        print_json(data)
    else:
        texts = (part if isinstance(part, str) else part.text(terminal_width()) for part in parts)
        typer.echo(marked("\n".join(texts), emulated=emulated))


def marked(text: str, *, emulated: bool) -> str:
    """Return a text with every line marked where it is about an emulated board."""
    return "\n".join(f"{MARK}{line}".rstrip() for line in text.splitlines()) if emulated else text


def _emulation(texts: Sequence[str]) -> dict[str, Any]:
    """Read the values of --emulate by their keys."""
    given: dict[str, Any] = {}
    for text in texts:
        key, equals, value = text.partition("=")
        if key not in _EMULATED or not equals:
            raise HardwareError(f"--emulate must be KEY=VALUE with a key of {', '.join(_EMULATED)}; got {text!r}.")
        if key in given or {key, *given} >= {"press", "path"}:
            raise HardwareError(f"--emulate must give {key} once, and press or path but not both; got {text!r} too.")
        given[key] = _EMULATED[key](value)
    return given


def _seed(text: str) -> int:
    if not (text.isdecimal() and text.isascii() and int(text) < _LARGEST_SEED):
        raise HardwareError(f"--emulate seed must be a whole number, not negative; got {text!r}.")
    return int(text)


def _clock(text: str) -> float:
    from coilarray.hardware.chips.ldc1614 import INTERNAL_CLOCK_RANGE

    low, high = INTERNAL_CLOCK_RANGE
    return _numbers("clock_MHz", text, (low / 1e6, high / 1e6))[0]


def _path(text: str) -> list[tuple[float, ...]]:
    lines = read_text(Path(text), HardwareError).splitlines()
    if len(lines) > _LONGEST_PATH:
        raise HardwareError(f"{text} must have at most {_LONGEST_PATH} lines; got {len(lines)}.")
    try:
        head, *rows = list(csv.reader(lines)) or [[]]
        points = [[float(value) for value in row] for row in rows]
    except (ValueError, csv.Error) as error:
        raise HardwareError(f"cannot read {text}: {error}.") from None
    if [name.strip() for name in head] != _PATH_COLUMNS or any(len(point) != len(_PATH_COLUMNS) for point in points):
        raise HardwareError(f"{text} must have the columns {', '.join(_PATH_COLUMNS)}.")
    return [(time, x * 1e-3, y * 1e-3, depth * 1e-3) for time, x, y, depth in points]


def _switches(text: str) -> str:
    if text != "counted":
        raise HardwareError(f"--emulate switches must be counted; got {text!r}.")
    return text


_EMULATED: dict[str, Callable[[str], Any]] = {
    "switches": _switches,
    "seed": _seed,
    "noise": lambda text: _numbers("noise", text, (0, math.inf))[0],
    "drift": lambda text: _numbers("drift", text, (-math.inf, math.inf))[0],
    "clock_MHz": _clock,
    "press": lambda text: [(0.0, *(value * 1e-3 for value in _numbers("press", text, (0, math.inf), 3)))],
    "path": _path,
}


def _numbers(key: str, text: str, allowed: tuple[float, float], count: int = 1) -> list[float]:
    """Read numbers; the last must be in the range that is allowed."""
    low, high = allowed
    try:
        values = [float(part) for part in text.split(",")]
    except ValueError:
        values = []
    if len(values) != count or not all(map(math.isfinite, values)) or not low <= values[-1] <= high:
        numbers = "a finite number" if count == 1 else f"{count} finite numbers, the last"
        limits = f" of at least {low:g}" if high == math.inf else f" from {low:g} to {high:g}"
        raise HardwareError(f"--emulate {key} must be {numbers}{'' if low == -math.inf else limits}; got {text!r}.")
    return values
