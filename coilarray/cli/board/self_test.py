"""``coilarray board test``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, replace
from typing import TYPE_CHECKING, Annotated, Any

import typer

from coilarray.cli.board.options import BoardOptions, board_command, is_emulator, opened_board, print_marked
from coilarray.cli.shared import (
    AsJson,
    DesignArgument,
    progress_bar,
    table_text,
)
from coilarray.compute.display_units import number_text
from coilarray.errors import HardwareError

if TYPE_CHECKING:
    from coilarray.design.model import Design
    from coilarray.hardware.board.connect import Board
    from coilarray.hardware.board.drive_codes import FoundDrive
    from coilarray.hardware.board.self_test import CoilCheck, SelfTest

_KINDS = {"serial": "serial ports", "linux": "buses of this computer", "ftdi": "adapters"}
_CHAIN = {
    "same": "wired back, returns what was sent",
    "differ": "wired back, does not return what was sent",
    "none": "not wired back, so that a broken data line shows only as coils that do not oscillate",
}
_NONE, _ALWAYS = "–", 2  # in the table of the self-test: no value; columns that are always shown
_MOST_LINES = 6  # symptoms and faults shown; all of them with --json


@board_command(without=("rate",))
def self_test(
    design: DesignArgument = None,
    only_list: Annotated[
        bool,
        typer.Option("--list", help="Only list the ports of this computer, and say what answers at --port."),
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

    It lists the ports of this computer too. The exit code is 2 if the board has a fault. Run it once with every new
    board: until it has passed, the order of the switches' bits is an assumption. It detects stuck switches, broken and
    shorted coils, and switches assigned to the wrong coils, from which coils oscillate and how neighbouring coils
    couple.

    Options of a port follow a question mark: i2c:1?mode=2&readback=yes for the switches, with ftdi://... also
    address=0x2B, and baud=9600 of a serial port.

    Without switches, coils are wired to the channels of the converter: i2c:1?channels=0,1&clock=40MHz (clock at the
    pin CLKIN, internal by default). The self-test then reports which coils oscillate.

    Example: coilarray board test --port /dev/ttyACM0

    Example: coilarray board test --list
    """
    if only_list and find_drives:
        raise HardwareError("--list cannot be given with --find-drives.")
    from coilarray.hardware.board import drive_codes
    from coilarray.hardware.board import self_test as tests
    from coilarray.hardware.board.connect import open_board, wiring_of_board
    from coilarray.hardware.wire.ports import board_of, parse_port

    place = parse_port(options.port)
    opened = options.design(design)
    drives = result = None
    if only_list:
        # the ports can be looked at without a design; that of an emulator decides on its coils
        named = opened if design is not None or is_emulator(options.port) else None
        wired = wiring_of_board(place, named, options.wiring, options.file.coils)
        with open_board(options.port, design=opened, wiring=wired) as board:
            record, line = _record(board), board.line
    else:
        with (
            progress_bar("self-test") as progress,
            opened_board(options, opened, real_time=False) as (board, settings),
        ):
            if find_drives:
                drives = drive_codes.find_drives(board.reader, settings)
                states = tuple(replace(state, drive=drives[state.name].code) for state in settings.states)
            record = _record(board, board.check_chain())
            trying = settings if drives is None else replace(settings, states=states)
            result = tests.self_test(board.reader, board.wiring, trying, progress=progress)
            line = board.line
    parts = [_ports_text(record["ports"]), line]
    if record["emulated"] and board_of(place) is None and (left_out := _left_out(opened, options)):
        parts.append(left_out)
    if record["chain"] is not None:
        parts.append(f"end of the chain of switches: {_CHAIN[record['chain']]}")
    if drives is not None:
        parts.append(_drives_text(drives))
    if result is not None:
        parts.append(_test_text(result))
    tried = {
        "drives": None if drives is None else {name: asdict(drive) for name, drive in drives.items()},
        "self_test": result and {"passed": result.passed, **asdict(result)},
    }
    print_marked(record | tried, parts, as_json=as_json, emulated=record["emulated"])
    if result is not None and not result.passed:
        raise HardwareError(f"the self-test of {options.port} has failed: {result.symptoms[0]}.")


def _left_out(design: Design, options: BoardOptions) -> str:
    """Say that the emulator leaves out the capacitances of the switch part, if the design does."""
    from coilarray.circuit.impedance import part_switches

    switches = design.circuit.switches
    if "switches" in options.emulation or part_switches(design).across_coil == switches.across_coil:
        return ""
    return (
        f"switch capacitance across a coil: {switches.across_coil * 1e12:.4g} pF, from the design; with "
        f"{design.circuit.part} it would be {part_switches(design).across_coil * 1e12:.4g} pF (--emulate "
        "switches=counted)"
    )


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


def _ports_text(ports: Mapping[str, tuple[str, ...]]) -> str:
    return "\n".join(f"{title}: {', '.join(ports[kind]) or 'none'}" for kind, title in _KINDS.items())


def _drives_text(drives: Mapping[str, FoundDrive]) -> str:
    rows = [(name, str(drive.code), str(drive.proposed), ", ".join(drive.reasons)) for name, drive in drives.items()]
    codes = ", ".join(f"{name} = {drive.code}" for name, drive in drives.items())
    table = table_text(("coil", "IDRIVE", "proposed", "not good"), rows)
    return f"{table}\nfor the file of --settings: drives = {{ {codes} }}"


def _test_text(result: SelfTest) -> str:
    headers = ("coil", "f in MHz", "reversed", "sensed by", "both ends grounded", "end a", "end b")
    rows = [_row(check) for check in result.coils]
    # of coils at channels nothing but f is measured
    kept = [k for k in range(len(headers)) if k < _ALWAYS or any(row[k] != _NONE for row in rows)]
    title = "rise of the neighbour's frequency in 10⁻⁶" if len(kept) > _ALWAYS else ""
    parts = [table_text([headers[k] for k in kept], [[row[k] for k in kept] for row in rows], title)]
    if result.passed:
        parts.append("self-test passed: the board agrees with its wiring, as far as the test can show")
        parts += _listed(
            "one question is left open; press on a coil in `coilarray board live` to settle it:", result.untested
        )
    else:
        parts += _listed("self-test failed:", result.symptoms)
        parts += _listed("any one of these explains it:", result.findings)
        parts += [] if result.findings else ["no single known fault explains it"]
    return "\n".join(parts)


def _row(check: CoilCheck) -> tuple[str, ...]:
    frequencies = (_NONE if f is None else f"{f * 1e-6:.6f}" for f in (check.frequency, check.turned))
    rises = (number_text(check.rises[end] * 1e6, 1) if end in check.rises else _NONE for end in ("both", "a", "b"))
    return (check.coil, *frequencies, check.felt_by or _NONE, *rises)


def _listed(title: str, lines: tuple[str, ...]) -> list[str]:
    if not lines:
        return []
    more = [f"  … and {len(lines) - _MOST_LINES} more (--json)"] if len(lines) > _MOST_LINES else []
    return [title, *(f"  {line}" for line in lines[:_MOST_LINES]), *more]
