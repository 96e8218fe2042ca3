"""``coilarray board test``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from typing import TYPE_CHECKING, Annotated, Any, TypedDict

import typer

from coilarray.cli.board.options import BoardOptions, board_command, is_emulator, opened_board, print_marked
from coilarray.cli.shared import (
    AllowViolations,
    AsJson,
    DesignArgument,
    open_design,
    progress_bar,
    table_text,
)
from coilarray.compute.display_units import PER_MILLION, number_text
from coilarray.errors import HardwareError

if TYPE_CHECKING:
    from coilarray.compute.threads import Progress
    from coilarray.design.model import Design
    from coilarray.hardware.board.connect import Board
    from coilarray.hardware.board.drive_codes import FoundDrive
    from coilarray.hardware.board.first_conversions import FirstConversions
    from coilarray.hardware.board.self_test import CoilCheck, SelfTest
    from coilarray.hardware.scan.settings import ScanSettings

_KINDS = {"serial": "serial ports", "linux": "buses of this computer", "ftdi": "adapters"}
_CHAIN = {
    "same": "wired back, returns what was sent",
    "differ": "wired back, does not return what was sent",
    "none": "not wired back, so that a broken data line shows only as coils that do not oscillate",
}
_NONE, _ALWAYS = "–", 2  # in the table of the self-test: no value; columns that are always shown
_MOST_LINES = 6  # symptoms and faults shown; all of them with --json


@board_command(without=("coils", "temperature", "rate"))
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
    allow_violations: AllowViolations = False,
) -> None:
    """Test every switch and coil of a board.

    It lists the ports of this computer too. The exit code is 2 if the board has a fault. Run it once with every new
    board: until it has passed, the order of the switches' bits is an assumption. It detects stuck switches, broken and
    shorted coils, and switches assigned to the wrong coils, from which coils oscillate and how neighbouring coils
    couple. It also compares the first conversions after sleep with later ones and says whether some of them must be
    discarded (--discard).

    Options of a port follow a question mark: i2c:1?mode=2&speed=500000&order=lsb&readback=yes for the switches, and
    with ftdi://... also address=0x2B&clock=0&data=1&sync=2&back=3 (pins C0 to C7). A serial port has baud=9600, or
    baud=any if the rate is not known.

    Without switches, coils are wired to the channels of the converter: i2c:1?channels=0,1&chip=LDC1612&clock=40MHz
    (clock at the pin CLKIN, internal by default), or a known board: i2c:1?board=grove-ldc1612, btt-eddy, cartographer,
    mellow-fly or ldc1614evm, none of them verified on a device. The self-test then reports which coils oscillate.

    Example: coilarray board test --port /dev/ttyACM0

    Example: coilarray board test --list
    """
    if only_list and find_drives:
        raise HardwareError("--list cannot be given with --find-drives.")
    from coilarray.hardware.board.connect import open_board, wiring_of_board
    from coilarray.hardware.wire.ports import board_of, parse_port

    place = parse_port(options.port)
    opened = open_design(design, allow_violations=allow_violations)
    tried: _Tried = {}
    if only_list:
        # the ports can be looked at without a design; that of an emulator decides on its coils
        named = opened if design is not None or is_emulator(options.port) else None
        wired = wiring_of_board(place, named, options.wiring, options.coils_of_channels)
        with open_board(options.port, design=opened, wiring=wired, **options.emulation) as board:
            record, line = _record(board), board.line
    else:
        with (
            progress_bar("self-test") as progress,
            opened_board(options, opened, real_time=False) as (board, settings),
        ):
            tried = _try(board, settings, progress, find_drives=find_drives)
            record, line = _record(board, tried["chain"]), board.line
    parts = [_ports_text(record["ports"]), line]
    if record["emulated"] and board_of(place) is None and (left_out := _left_out(opened, options)):
        parts.append(left_out)
    if "board" in record["assumed"]:
        parts.append(f"board: {record['assumed']['board']}")
    if record["chain"] is not None:
        parts.append(f"end of the chain of switches: {_CHAIN[record['chain']]}")
    if "drives" in tried:
        parts.append(_drives_text(tried["drives"]))
    if tried:
        parts += [_first_text(tried["first"]), _test_text(tried["result"])]
    print_marked(record | _as_record(tried), parts, as_json=as_json, emulated=record["emulated"])
    if tried and not tried["result"].passed:
        raise HardwareError(f"the self-test of {options.port} has failed: {tried['result'].symptoms[0]}.")


class _Tried(TypedDict, total=False):
    """What was found by trying the board."""

    chain: str | None
    drives: Mapping[str, FoundDrive]
    first: FirstConversions
    result: SelfTest


def _try(board: Board, settings: ScanSettings, progress: Progress, *, find_drives: bool) -> _Tried:
    from dataclasses import replace

    from coilarray.hardware.board import drive_codes
    from coilarray.hardware.board import self_test as tests
    from coilarray.hardware.board.first_conversions import first_conversions

    tried: _Tried = {}
    if find_drives:
        drives = tried["drives"] = drive_codes.find_drives(board.reader, settings)
        states = tuple(replace(state, drive=drives[state.name].code) for state in settings.states)
        settings = replace(settings, states=states)
    tried["chain"] = board.check_chain()
    first = tried["first"] = first_conversions(board.reader, settings)
    settings = replace(settings, discard=max(settings.discard, first.recommended))
    tried["result"] = tests.self_test(board.reader, board.wiring, settings, progress=progress)
    return tried


def _as_record(tried: _Tried) -> dict[str, Any]:
    from coilarray.hardware.board.first_conversions import DISCARDS

    drives, first, result = tried.get("drives"), tried.get("first"), tried.get("result")
    return {
        "drives": drives and {name: asdict(drive) for name, drive in drives.items()},
        "first_conversions": first and {"discards": DISCARDS, **asdict(first)},
        "self_test": result and {"passed": result.passed, **asdict(result)},
    }


def _left_out(design: Design, options: BoardOptions) -> str:
    """Say that the emulator leaves out the capacitances of the switch part, if the design does."""
    from coilarray.circuit.impedance import part_switches

    switches = design.circuit.switches
    if options.emulation.get("count_parts") or part_switches(design).across_coil == switches.across_coil:
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
    options = " ".join(f"--drive {name}={drive.code}" for name, drive in drives.items())
    return f"{table_text(('coil', 'IDRIVE', 'proposed', 'not good'), rows)}\n{options}"


def _first_text(first: FirstConversions) -> str:
    from coilarray.hardware.board.first_conversions import DISCARDS

    if not first.offsets:
        return "first conversions could not be compared: no coil has a result in every scan"
    headers = ("coil", *(f"{discard} discarded" for discard in DISCARDS[:-1]), "scan reversed")
    rows = [
        (name, *(number_text(one * 1e6, 1) for one in (*offsets[:-1], first.backwards[name])))
        for name, offsets in first.offsets.items()
    ]
    limit = PER_MILLION.text(first.noticeable, ".2")
    parts = [table_text(headers, rows, f"change of f in 10⁻⁶ from that with {DISCARDS[-1]} conversions discarded")]
    if not first.recommended:
        parts.append(f"first conversions after sleep agree with later ones to {limit}: none need be discarded")
    elif first.settled:
        parts.append(f"first conversions after sleep are off by more than {limit}; discard some:")
        parts.append(f"--discard {first.recommended}")
    else:
        parts.append(f"first conversions after sleep are off by more than {limit}, and {DISCARDS[-1]} may be too few:")
        parts.append(f"--discard {first.recommended}")
    if first.order_matters:
        parts.append(
            f"f changes by more than {limit} when the scan runs backwards: a state is affected by the one before it"
        )
    return "\n".join(parts)


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
