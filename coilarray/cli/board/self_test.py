"""``coilarray board test``."""

from __future__ import annotations

from dataclasses import asdict, replace
from typing import TYPE_CHECKING, Annotated, Any

import typer

from coilarray.cli.board.options import BoardOptions, board_command, is_emulator, opened_board, print_marked
from coilarray.cli.shared import AsJson, DesignArgument, progress_bar
from coilarray.compute.display_units import DisplayUnit
from coilarray.errors import HardwareError

if TYPE_CHECKING:
    from coilarray.compute.table import Table
    from coilarray.hardware.board.connect import Board
    from coilarray.hardware.board.self_test import SelfTest

_KINDS = {"serial": "serial ports", "linux": "buses of this computer", "ftdi": "adapters"}
_CHAIN = {
    "same": "wired back, returns what was sent",
    "differ": "wired back, does not return what was sent",
    "none": "not wired back, so that a broken data line shows only as coils that do not oscillate",
}
_MOST_LINES = 6  # symptoms and faults shown; all of them with --json


@board_command(without=("rate",))
def self_test(
    design: DesignArgument = None,
    only_list: Annotated[
        bool, typer.Option("--list", help="Only list the ports of this computer, and say what answers at --port.")
    ] = False,
    find_drives: Annotated[
        bool,
        typer.Option(
            "--find-drives", help="Find the drive current (IDRIVE) of every coil. Run it where the board will be used."
        ),
    ] = False,
    *,
    options: BoardOptions,
    as_json: AsJson = False,
) -> None:
    """Test every switch and coil of a board.

    It lists the ports of this computer too. The exit code is 2 if the board has a fault. Run it
    once with every new board: until it has passed, the order of the switches' bits is an
    assumption. It detects stuck switches, broken and shorted coils, and switches assigned to the
    wrong coils, from which coils oscillate and how neighbouring coils couple.

    Options of a port follow a question mark: i2c:1?mode=2&readback=yes for the switches, with
    ftdi://... also address=0x2B, and baud=9600 of a serial port.

    Without switches, coils are wired to the channels of the converter:
    i2c:1?channels=0,1&clock=40MHz (clock at the pin CLKIN, internal by default). The self-test then
    reports which coils oscillate.

    Example: coilarray board test --port /dev/ttyACM0

    Example: coilarray board test --list
    """
    if only_list and find_drives:
        raise HardwareError("--list cannot be given with --find-drives.")
    from coilarray.compute.table import text_table
    from coilarray.hardware.board import self_test as tests
    from coilarray.hardware.board.connect import open_board, wiring_of_board
    from coilarray.hardware.wire.ports import parse_port

    place = parse_port(options.port)
    opened = options.design(design)
    drives = result = None
    if only_list:
        # ports are listed without a design, which decides on the coils of an emulator
        named = opened if design is not None or is_emulator(options.port) else None
        wired = wiring_of_board(place, named, options.wiring, options.file.coils)
        with open_board(options.port, design=opened, wiring=wired) as board:
            record, line = _record(board), board.line
    else:
        with progress_bar("self-test") as progress, opened_board(options, opened, real_time=False) as (board, settings):
            if find_drives:
                drives = tests.find_drives(board.reader, settings)
                states = tuple(replace(state, drive=drives[state.name].code) for state in settings.states)
            record = _record(board, board.check_chain())
            trying = settings if drives is None else replace(settings, states=states)
            result = tests.self_test(board.reader, board.wiring, trying, progress=progress)
            line = board.line
    parts: list[str | Table] = [
        *(f"{title}: {', '.join(record['ports'][kind]) or 'none'}" for kind, title in _KINDS.items()),
        line,
    ]
    if record["chain"] is not None:
        parts.append(f"end of the chain of switches: {_CHAIN[record['chain']]}")
    if drives is not None:
        codes = ", ".join(f"{name} = {drive.code}" for name, drive in drives.items())
        rows = [(name, str(one.code), str(one.proposed), ", ".join(one.reasons)) for name, one in drives.items()]
        parts.append(text_table(("coil", "IDRIVE", "proposed", "not good"), rows))
        parts.append(f"for the file of --settings: drives = {{ {codes} }}")
    if result is not None:
        parts += _test_parts(result)
    tried = {
        "drives": None if drives is None else {name: asdict(drive) for name, drive in drives.items()},
        "self_test": result and {"passed": result.passed, **asdict(result)},
    }
    print_marked(record | tried, parts, as_json=as_json, emulated=record["emulated"])
    if result is not None and not result.passed:
        raise HardwareError(f"the self-test of {options.port} has failed: {result.symptoms[0]}.")


def _record(one: Board, chain: str | None = None) -> dict[str, Any]:
    from coilarray.hardware.wire.ports import found_ports

    return {
        "emulated": one.emulated,
        "port": one.port,
        "identity": asdict(one.identity),
        "wiring": one.wiring.name,
        "assumed": dict(one.wiring.assumed),
        "ports": found_ports(),
        "chain": chain,
    }


def _test_parts(result: SelfTest) -> list[str | Table]:
    """Return the table and the findings of a self-test."""
    from coilarray.compute.table import Column, Table

    rise = DisplayUnit("10⁻⁶", 1e6, 1)
    columns = (
        Column("coil"),
        Column("f", unit="Hz", shown=DisplayUnit("MHz", 1e-6, 6)),
        Column("turned", "f reversed", "Hz", DisplayUnit("MHz", 1e-6, 6)),
        Column("felt_by", "sensed by"),
        *(
            Column(end, f"neighbour rises, {text} grounded", "1", rise)
            for end, text in (("both", "ends"), ("a", "end a"), ("b", "end b"))
        ),
    )
    rows = tuple(
        (
            check.coil,
            *("" if value is None else value for value in (check.frequency, check.turned)),
            check.felt_by or "",
            *(check.rises.get(end, "") for end in ("both", "a", "b")),
        )
        for check in result.coils
    )
    # of coils at channels nothing but f is measured
    parts: list[str | Table] = [Table("self_test", "", columns, rows).without_empty_columns()]
    if result.passed:
        parts.append("self-test passed: the board agrees with its wiring, as far as the test can show")
        title = "one question is left open; press on a coil in `coilarray board live` to settle it:"
        listed = [(title, result.untested)]
    else:
        listed = [("self-test failed:", result.symptoms), ("any one of these explains it:", result.findings)]
    for title, lines in listed:
        more = [f"  … and {len(lines) - _MOST_LINES} more (--json)"] if len(lines) > _MOST_LINES else []
        parts += [title, *(f"  {line}" for line in lines[:_MOST_LINES]), *more] if lines else []
    if not (result.passed or result.findings):
        parts.append("no single known fault explains it")
    return parts
