"""Options, settings and marks of the commands for a board."""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, fields
from functools import cached_property, wraps
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, get_type_hints

import typer

from coilarray.cli.shared import open_design_file
from coilarray.compute.threads import Progress
from coilarray.errors import HardwareError

if TYPE_CHECKING:
    from coilarray.cli.board.files import BoardSettings
    from coilarray.design.model import Design, DesignFile
    from coilarray.hardware.board.connect import Board
    from coilarray.hardware.scan.settings import ScanSettings
    from coilarray.hardware.scan.wiring import Wiring

EMULATOR = "emulator"

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

_LARGEST_SEED = 2**63 - 1


@dataclass(frozen=True)
class BoardOptions:
    """Checked options of a command with a board, see `board_command`."""

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
            "(K/s), clock_MHz=36 (of its oscillator), press=X,Y,DEPTH (mm on the board; in live, after the baseline)."
        ),
    ] = None
    emulation: dict[str, Any] = field(init=False)

    def __post_init__(self) -> None:
        if self.rate is not None and not (math.isfinite(self.rate) and self.rate > 0):
            raise HardwareError(f"--rate must be positive and finite; got {self.rate:g}.")
        if self.emulate and not is_emulator(self.port):
            raise HardwareError(f"--emulate is for the emulator; {self.port} is a real board.")
        assert self.file  # read once, so that mistakes show at once
        object.__setattr__(self, "emulation", _emulation(self.emulate or ()))  # frozen

    @cached_property
    def file(self) -> BoardSettings:
        """Settings of the board."""
        from coilarray.cli.board.files import BoardSettings, read_file  # loads pydantic, which no help needs

        return read_file(BoardSettings, "settings", self.settings)

    def design_file(self, name: str | None) -> DesignFile:
        """Read a design, refused for violations that are not allowed."""
        return open_design_file(name, allow_violations=self.file.allow_violations)

    def press_on(self, design: Design) -> tuple[float, float, float] | None:
        """Return the finger's press: x, y and depth in m."""
        if "press" not in self.emulation:
            return None
        from coilarray.response.dataset import map_origin

        x, y, depth = (value * 1e-3 for value in self.emulation["press"])
        at_x, at_y = map_origin(design.indentation)
        return x - at_x, y - at_y, depth


def is_emulator(port: str) -> bool:
    """Whether a port names an emulated board."""
    return port.partition("?")[0].strip() == EMULATOR


def board_command(*, without: Sequence[str] = ()) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Return a decorator: ``options`` becomes fields of `BoardOptions`."""
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
    """Open and configure a board, emulated in `real_time` or virtual time."""
    from coilarray.hardware.board.connect import open_board, wiring_of_board
    from coilarray.hardware.emulator.board import Conditions, PacedClock, VirtualClock
    from coilarray.hardware.record.recorder import thermometer
    from coilarray.hardware.wire.ports import parse_port

    port = parse_port(options.port)
    wiring = wiring_of_board(port, design, options.wiring, options.file.coils)
    settings = _scan_settings(options, design, wiring)
    emulated = is_emulator(options.port)
    emulation: dict[str, Any] = {}
    if emulated:
        given, clock = options.emulation, PacedClock() if real_time else VirtualClock()
        conditions = Conditions(drift=given.get("drift", 0.0), noise=given.get("noise"))
        # the board has room temperature now, not when the computer was started
        conditions.start -= conditions.drift * clock.now()
        if "clock_MHz" in given:
            conditions.oscillator = given["clock_MHz"] * 1e6
        emulation = {"seed": given.get("seed", 0), "clock": clock, "conditions": conditions}
        emulation |= {} if progress is None else {"progress": progress}
    with ExitStack() as opened:
        read = None
        if options.file.thermometer is not None and not emulated:
            read = opened.enter_context(thermometer(Path(options.file.thermometer)))
        board = opened.enter_context(open_board(options.port, design=design, wiring=wiring, **emulation))
        board.thermometer = read or board.thermometer
        press = options.press_on(design)
        if board.emulator is not None and press is not None and not real_time:
            board.emulator.indenter.press(*press)
        board.reader.configure(settings)
        yield board, settings


def _scan_settings(options: BoardOptions, design: Design, wiring: Wiring) -> ScanSettings:
    from coilarray.hardware.chips.ldc1614 import EXTERNAL_CLOCK_RANGE, INTERNAL_CLOCK_RANGE
    from coilarray.hardware.scan.settings import ConverterClock, design_settings
    from coilarray.hardware.wire.ports import bus_rate, parse_port

    port, file = parse_port(options.port), options.file
    channels = port.board
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


def _emulation(texts: Sequence[str]) -> dict[str, Any]:
    from coilarray.hardware.chips.ldc1614 import INTERNAL_CLOCK_RANGE

    low, high = (frequency / 1e6 for frequency in INTERNAL_CLOCK_RANGE)
    allowed: dict[str, tuple[float, float, str]] = {
        "seed": (0, _LARGEST_SEED, "a whole number, not negative"),
        "noise": (0, math.inf, "a finite number of at least 0"),
        "drift": (-math.inf, math.inf, "a finite number"),
        "clock_MHz": (low, high, f"a finite number from {low:g} to {high:g}"),
        "press": (0, math.inf, "3 finite numbers, the last of at least 0"),
    }
    given: dict[str, Any] = {}
    for text in texts:
        key, equals, value = text.partition("=")
        if key not in allowed or not equals:
            raise HardwareError(f"--emulate must be KEY=VALUE with a key of {', '.join(allowed)}; got {text!r}.")
        if key in given:
            raise HardwareError(f"--emulate must give {key} once; got {text!r} too.")
        least, most, words = allowed[key]
        try:
            numbers: list[float] = [int(value)] if key == "seed" else [float(part) for part in value.split(",")]
        except ValueError:
            numbers = []
        count = 3 if key == "press" else 1
        if len(numbers) != count or not least <= numbers[-1] <= most or not all(map(math.isfinite, numbers)):
            raise HardwareError(f"--emulate {key} must be {words}; got {value!r}.")
        given[key] = numbers if key == "press" else numbers[0]
    return given
