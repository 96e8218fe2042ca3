"""Options shared by all commands for a board, and the mark on every line about an emulated one."""

from __future__ import annotations

import csv
import inspect
import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, fields, replace
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar, get_type_hints

import typer

from coilarray.cli.shared import print_json
from coilarray.compute.files import read_text
from coilarray.errors import HardwareError

if TYPE_CHECKING:
    from coilarray.compute.threads import Progress
    from coilarray.design.model import Design
    from coilarray.hardware.board.connect import Board
    from coilarray.hardware.scan.settings import ScanSettings

EMULATOR = "emulator"
MARK = "[emulator] "
"""Start of every line about an emulated board."""

WiringName = Annotated[
    str | None, typer.Option("--wiring", help="Wiring file (TOML) or name of a bundled one; six_coils by default.")
]

_T = TypeVar("_T")
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
            "i2c:1[:0x2A][,spi:0.0][?rate=400000] (Linux; the rate is the clock of the I²C bus in Hz), "
            "ftdi://...; the emulator by default. /dev/ttyACM0?baud=any tries every rate. Without switches, "
            "coils at the channels of a converter: i2c:1?channels=0,1&chip=LDC1612&clock=40MHz or "
            "i2c:1?board=grove-ldc1612; also after ftdi://... and emulator."
        ),
    ] = EMULATOR
    wiring: WiringName = None
    wired_coils: Annotated[
        str | None,
        typer.Option(
            "--coils",
            help="Coils at the channels of the port, in that order, such as coil3,coil1; needed if the design has "
            "more coils than the port has channels.",
        ),
    ] = None
    rate: Annotated[
        float | None,
        typer.Option(help="Scans per second, estimated with the I²C clock of the port; full resolution by default."),
    ] = None
    clock_MHz: Annotated[  # noqa: N815 - as the option
        float | None,
        typer.Option(
            "--clock-MHz",
            help="Clock of the converter, measured or external; by default that of the port, or 43.4, typical of "
            "the internal oscillator. It may be as low as 35, so that scans take a quarter longer while the "
            "clock is not given.",
        ),
    ] = None
    external_clock: Annotated[
        bool,
        typer.Option("--external-clock", help="The clock is an external one, at the pin CLKIN; needs --clock-MHz."),
    ] = False
    undivided: Annotated[
        bool,
        typer.Option(
            "--undivided",
            help="Use the undivided clock, which halves the time of full resolution. As the converter divides the "
            "clock of a single channel, it briefly scans a second one too. Not verified on a device; not with a "
            "microcontroller.",
        ),
    ] = False
    discard: Annotated[
        int,
        typer.Option(
            help="Conversions of each state to discard after the converter wakes, 0 to 15; `coilarray board "
            "--self-test` finds how many."
        ),
    ] = 0
    drive: Annotated[
        list[str] | None,
        typer.Option(
            help="Drive current (IDRIVE) of all coils, 0 to 31, or of one as COIL=CODE; may be repeated. From the "
            "design by default."
        ),
    ] = None
    coils: Annotated[
        list[str] | None,
        typer.Option("--coil", help="Measure only this state of the scan; may be repeated. All by default."),
    ] = None
    temperature: Annotated[
        Path | None,
        typer.Option(
            help="File of a thermometer, read once a second and recorded: hwmon, a thermal zone or the 1-wire bus "
            "of Linux (in 0.001 °C), or any file with a number that has a decimal point (in °C). The emulator "
            "has its own."
        ),
    ] = None
    emulate: Annotated[
        list[str] | None,
        typer.Option(
            help="Behaviour of the emulator; may be repeated: seed=1, noise=1e-7 (relative, of f), drift=0.01 "
            "(K/s), clock_MHz=36 (of its oscillator), first_offset=40000 (error of the first conversion after "
            "sleep in codes, as users of the FDC2214 report; not verified), press=X,Y,DEPTH (mm on the board; "
            "in live, after the baseline), path=FILE.csv (columns time_s, x_mm, y_mm, depth_mm), "
            "switches=counted (include the capacitances of the wiring's parts: typical, not verified)."
        ),
    ] = None
    emulation: dict[str, Any] = field(init=False)
    drives: dict[str, int] | int | None = field(init=False)

    def __post_init__(self) -> None:
        from coilarray.hardware.chips.ldc1614 import MOST_DISCARDED

        for option, value in (("--rate", self.rate), ("--clock-MHz", self.clock_MHz)):
            if value is not None and not (math.isfinite(value) and value > 0):
                raise HardwareError(f"{option} must be positive and finite; got {value:g}.")
        if self.external_clock and self.clock_MHz is None:
            raise HardwareError("--external-clock needs --clock-MHz.")
        if not 0 <= self.discard <= MOST_DISCARDED:
            raise HardwareError(f"--discard must be 0 to {MOST_DISCARDED}; got {self.discard}.")
        if self.emulate and not is_emulator(self.port):
            raise HardwareError(f"--emulate is for the emulator; {self.port} is a real board.")
        if self.temperature is not None and is_emulator(self.port):
            raise HardwareError("--temperature is for a real board; the emulator has a temperature of its own.")
        object.__setattr__(self, "emulation", _emulation(self.emulate or ()))
        object.__setattr__(self, "drives", _drives(self.drive or ()))

    @property
    def given(self) -> list[str]:
        """Names of the options that are not left at their defaults."""
        hints = get_type_hints(BoardOptions, include_extras=True)
        changed = [one.name for one in fields(self) if one.init and getattr(self, one.name) not in (one.default, [])]
        # typer keeps a name that is declared as the first argument in `default`
        declared = {name: hints[name].__metadata__[0].default for name in changed}
        return [text if isinstance(text, str) else f"--{name.replace('_', '-')}" for name, text in declared.items()]

    @property
    def coils_of_channels(self) -> list[str] | None:
        """Names of the coils at the channels of the port, where they are given."""
        return None if self.wired_coils is None else [name.strip() for name in self.wired_coils.split(",")]

    def path_of(self, design: Design) -> list[tuple[float, float, float, float]] | None:
        """Return the path of an emulated finger, time in s and x, y and depth in m, counted from the map's origin."""
        path = self.emulation.get("path")
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
    would, otherwise its time is virtual; `progress` gets (done, total) while it computes its response table, once per
    design. HardwareError for options that do not fit the design or the wiring, or a board that cannot be opened or
    configured.
    """
    from coilarray.hardware.board.connect import open_board, wiring_of_board
    from coilarray.hardware.chips.ldc1614 import EXTERNAL_CLOCK_RANGE, INTERNAL_CLOCK_RANGE
    from coilarray.hardware.record.thermometer import thermometer
    from coilarray.hardware.scan.design_settings import design_settings
    from coilarray.hardware.wire.ports import board_of, bus_rate, parse_port

    port = parse_port(options.port)
    bus_clock = bus_rate(port)
    if options.rate is not None and not bus_clock.known:
        typer.echo(
            f"The system does not report the clock of {options.port}; --rate assumes {bus_clock.hertz * 1e-3:g} kHz. "
            "Give another one after the port, such as ?rate=400000.",
            err=True,
        )
    wiring = wiring_of_board(port, design, options.wiring, options.coils_of_channels)
    channels = board_of(port)
    clock = None if channels is None else channels.clock
    if options.clock_MHz is not None:
        external = options.external_clock or clock is not None
        low, high = EXTERNAL_CLOCK_RANGE if external else INTERNAL_CLOCK_RANGE
        if not low <= options.clock_MHz * 1e6 <= high:
            whose = "at the pin CLKIN" if external else "of the converter's own oscillator"
            raise HardwareError(
                f"--clock-MHz must be {low * 1e-6:g} to {high * 1e-6:g} {whose}; got {options.clock_MHz:g}."
            )
    with _option_named("rate", "--rate"):
        settings = design_settings(
            design,
            wiring,
            states=options.coils,
            rate=options.rate,
            clock=clock if options.clock_MHz is None else options.clock_MHz * 1e6,
            external_clock=options.external_clock or clock is not None,
            undivided=options.undivided,
            family="LDC" if channels is None else channels.converter.family,
            drives=options.drives,
            discard=options.discard,
            bus_rate=bus_clock.hertz,
        )
    emulation = dict(options.emulation)
    path = options.path_of(design)
    if path is not None:
        emulation["path"] = path
    if is_emulator(options.port) and real_time:
        from coilarray.hardware.emulator import PacedClock

        emulation["clock"] = PacedClock()
        start = emulation["clock"].now()
        if path is not None:
            emulation["path"] = [(start + time, *place) for time, *place in path]
        if "drift" in emulation:  # the board has room temperature now, not when the computer was started
            drift = emulation["drift"]
            emulation["drift"] = replace(drift, start=drift.start - drift.rate * start)
    if is_emulator(options.port) and progress is not None:
        emulation["progress"] = progress
    with ExitStack() as opened:
        read = None if options.temperature is None else opened.enter_context(thermometer(options.temperature))
        board = opened.enter_context(open_board(options.port, design=design, wiring=wiring, **emulation))
        board.thermometer = read or board.thermometer
        board.reader.configure(settings)
        yield board, settings


@contextmanager
def _option_named(parameter: str, option: str) -> Iterator[None]:
    """Name the option instead of the parameter in an error of the library."""
    try:
        yield
    except HardwareError as error:
        name, _, rest = str(error).partition(" ")
        if name != parameter:
            raise
        raise HardwareError(f"{option} {rest}") from None


def print_marked(data: Any, parts: Sequence[str], *, as_json: bool, emulated: bool) -> None:
    """Print the result of a command with a board: `data` as JSON and nothing else, or marked texts for people."""
    if as_json:
        print_json(data)
    else:
        typer.echo(marked("\n".join(parts), emulated=emulated))


def marked(text: str, *, emulated: bool) -> str:
    """Return a text with every line marked where it is about an emulated board."""
    return "\n".join(f"{MARK}{line}".rstrip() for line in text.splitlines()) if emulated else text


def all_or_each(
    option: str, what: str, form: str, texts: Sequence[str], read: Callable[[str], tuple[str, _T]]
) -> dict[str, _T]:
    """Read an option given once for all coils or states, kept under an empty name, or once for each."""
    found: dict[str, _T] = {}
    for text in texts:
        name, value = read(text)
        if name in found:
            raise HardwareError(f"{option} must name a {what} once; got {text!r} again.")
        found[name] = value
    if "" in found and len(found) > 1:
        raise HardwareError(f"{option} must be one value for all {what}s, or {form} for each; got both.")
    return found


def _drives(texts: Sequence[str]) -> dict[str, int] | int | None:
    codes = all_or_each("--drive", "coil", "COIL=CODE", texts, _drive)
    return codes.get("", codes or None)


def _drive(text: str) -> tuple[str, int]:
    coil, equals, code = text.rpartition("=")
    if not (code.isdecimal() and code.isascii() and int(code) <= 31 and bool(coil) == bool(equals)):
        raise HardwareError(f"--drive must be 0 to 31, or COIL=CODE; got {text!r}.")
    return coil, int(code)


def _emulation(texts: Sequence[str]) -> dict[str, Any]:
    """Return the keyword arguments for the emulated board."""
    given: dict[str, Any] = {}
    for text in texts:
        key, equals, value = text.partition("=")
        reader = _EMULATED.get(key)
        if reader is None or not equals:
            raise HardwareError(f"--emulate must be KEY=VALUE with a key of {', '.join(_EMULATED)}; got {text!r}.")
        name, emulated = reader(value)
        if name in given:
            raise HardwareError(f"--emulate must give {key} once, and press or path but not both; got {text!r} too.")
        given[name] = emulated
    return given


def _seed(text: str) -> tuple[str, object]:
    if not (text.isdecimal() and text.isascii() and int(text) < _LARGEST_SEED):
        raise HardwareError(f"--emulate seed must be a whole number, not negative; got {text!r}.")
    return "seed", int(text)


def _noise(text: str) -> tuple[str, object]:
    (noise,) = _numbers("noise", text, 1)
    if noise < 0:
        raise HardwareError(f"--emulate noise must not be negative; got {text!r}.")
    return "noise", noise


def _drift(text: str) -> tuple[str, object]:
    from coilarray.hardware.emulator import Drift

    (rate,) = _numbers("drift", text, 1)
    return "drift", Drift(rate=rate)


def _clock(text: str) -> tuple[str, object]:
    from coilarray.hardware.chips.ldc1614 import INTERNAL_CLOCK_RANGE
    from coilarray.hardware.emulator import Oscillator

    (clock,) = _numbers("clock_MHz", text, 1)
    low, high = INTERNAL_CLOCK_RANGE
    if not low <= clock * 1e6 <= high:
        raise HardwareError(f"--emulate clock_MHz must be {low / 1e6:g} to {high / 1e6:g}; got {text!r}.")
    return "oscillator", Oscillator(clock * 1e6)


def _first_offset(text: str) -> tuple[str, object]:
    (codes,) = _numbers("first_offset", text, 1)
    return "first_offset", codes


def _press(text: str) -> tuple[str, object]:
    x, y, depth = _numbers("press", text, 3)
    if depth < 0:
        raise HardwareError(f"--emulate press must not have a negative depth; got {text!r}.")
    return "path", [(0.0, x * 1e-3, y * 1e-3, depth * 1e-3)]


def _path(text: str) -> tuple[str, object]:
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
    return "path", [(time, x * 1e-3, y * 1e-3, depth * 1e-3) for time, x, y, depth in points]


def _switches(text: str) -> tuple[str, object]:
    if text != "counted":
        raise HardwareError(f"--emulate switches must be counted; got {text!r}.")
    return "count_parts", True


_EMULATED = {
    "switches": _switches, "seed": _seed, "noise": _noise, "drift": _drift, "clock_MHz": _clock,
    "first_offset": _first_offset, "press": _press, "path": _path,
}  # fmt: skip


def _numbers(key: str, text: str, count: int) -> list[float]:
    try:
        values = [float(part) for part in text.split(",")]
    except ValueError:
        values = []
    if len(values) != count or not all(math.isfinite(value) for value in values):
        raise HardwareError(f"--emulate {key} must be {count} finite numbers; got {text!r}.")
    return values
