"""``coilarray board``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from typing import TYPE_CHECKING, Annotated, Any

import typer

from coilarray.cli.board_options import BoardOptions, board_command, opened_board, print_marked
from coilarray.cli.shared import (
    AllowViolations,
    AsJson,
    DesignArgument,
    open_design,
    progress_bar,
    table_text,
)
from coilarray.errors import HardwareError

if TYPE_CHECKING:
    from coilarray.design.model import Design
    from coilarray.hardware.board.connect import Board
    from coilarray.hardware.board.drive_codes import FoundDrive
    from coilarray.hardware.board.self_test import CoilCheck, SelfTest

_KINDS = {"serial": "serial ports", "linux": "buses of this computer", "ftdi": "adapters"}
_CHAIN = {
    "same": "wired back, and returns what was sent",
    "differ": "returns other words than were sent",
    "none": "not wired back, so that a broken data line shows only as coils that do not oscillate",
}
_MOST_LINES = 6  # symptoms and faults shown; all of them with --json


@board_command(without=("rate", "coils", "temperature"))
def board(
    design: DesignArgument = None,
    self_test: Annotated[
        bool, typer.Option("--self-test", help="Test every switch and coil; the exit code is 2 where one has a fault.")
    ] = False,
    find_drives: Annotated[
        bool,
        typer.Option("--find-drives", help="Find IDRIVE of every coil, in the surroundings of the later measurement."),
    ] = False,
    *,
    options: BoardOptions,
    as_json: AsJson = False,
    allow_violations: AllowViolations = False,
) -> None:
    """Show the ports of this computer and the board at one of them; test its switches and coils.

    Run the self-test once with every new board: until it has passed, the order of the switches' bits is an assumption.
    It detects stuck switches, broken and shorted coils and a wrong map of the switches from what oscillates and from
    the coupling of neighbouring coils.

    Options of a port follow a question mark: i2c:1?mode=2&speed=500000&order=lsb&readback=yes for the switches, and
    with ftdi://... also address=0x2B&clock=0&data=1&sync=2&back=3 (pins C0 to C7). A serial port has baud=9600, or
    baud=any where the rate is not known.

    Example: coilarray board --port /dev/ttyACM0 --self-test
    """
    from coilarray.hardware.board.connect import open_board, wiring_of_board
    from coilarray.hardware.wire.ports import parse_port

    place = parse_port(options.port)
    opened = open_design(design, allow_violations=allow_violations)
    if self_test or find_drives:
        drives, result, record, line = _tried(options, opened, self_test=self_test, find_drives=find_drives)
    else:
        wired = wiring_of_board(place, opened, options.wiring)
        with open_board(options.port, design=opened, wiring=wired, **options.emulation) as one:
            drives, result, record, line = None, None, _record(one), one.line
    data, parts = record | {"drives": None, "self_test": None}, [_ports_text(record["ports"]), line]
    if record["chain"] is not None:
        parts.append(f"end of the chain of switches: {_CHAIN[record['chain']]}")
    if drives is not None:
        data["drives"] = {name: asdict(drive) for name, drive in drives.items()}
        parts.append(_drives_text(drives))
    if result is not None:
        data["self_test"] = {"passed": result.passed, **asdict(result)}
        parts.append(_test_text(result))
    print_marked(data, parts, as_json=as_json, emulated=record["emulated"])
    if result is not None and not result.passed:
        raise HardwareError(f"the self-test of {options.port} has failed: {result.symptoms[0]}.")


def _tried(
    options: BoardOptions, design: Design, *, self_test: bool, find_drives: bool
) -> tuple[Mapping[str, FoundDrive] | None, SelfTest | None, dict[str, Any], str]:
    from dataclasses import replace

    from coilarray.hardware.board.drive_codes import find_drives as find
    from coilarray.hardware.board.self_test import self_test as test

    drives = result = None
    with (
        progress_bar("self-test") as progress,
        opened_board(options, design, real_time=False) as (one, settings),
    ):
        states = settings.states
        if find_drives:
            drives = find(one.reader, settings)
            states = tuple(replace(state, drive=drives[state.name].code) for state in states)
        chain = one.check_chain() if self_test else None
        if self_test:
            result = test(one.reader, one.wiring, replace(settings, states=states), progress=progress)
        return drives, result, _record(one, chain), one.line


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
    options = " ".join(f"--drive {name}={drive.code}" for name, drive in drives.items())
    return f"{table_text(('coil', 'IDRIVE', 'proposed', 'not good'), rows)}\n{options}"


def _test_text(result: SelfTest) -> str:
    headers = ("coil", "f in MHz", "turned round", "felt by", "both ends grounded", "end a", "end b")
    parts = [table_text(headers, [_row(check) for check in result.coils], "rise of the neighbour's frequency in 1e-6")]
    if result.passed:
        parts.append("self-test passed: the board is as its wiring says, as far as can be seen")
        parts += _listed("one thing stays open; press on a coil in `coilarray live` to tell:", result.untested)
    else:
        parts += _listed("self-test failed:", result.symptoms)
        parts += _listed("each of these alone explains it:", result.findings)
        parts += [] if result.findings else ["no single fault that is known explains it"]
    return "\n".join(parts)


def _row(check: CoilCheck) -> tuple[str, ...]:
    frequencies = ("–" if f is None else f"{f * 1e-6:.6f}" for f in (check.frequency, check.turned))
    rises = (f"{check.rises[end] * 1e6:.1f}" if end in check.rises else "–" for end in ("both", "a", "b"))
    return (check.coil, *frequencies, check.felt_by or "–", *rises)


def _listed(title: str, lines: tuple[str, ...]) -> list[str]:
    if not lines:
        return []
    more = [f"  … and {len(lines) - _MOST_LINES} more (--json)"] if len(lines) > _MOST_LINES else []
    return [title, *(f"  {line}" for line in lines[:_MOST_LINES]), *more]
