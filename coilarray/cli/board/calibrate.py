"""``coilarray board calibrate``."""

from __future__ import annotations

import math
import time
from pathlib import Path
from typing import Annotated

import typer

from coilarray.cli.board.options import print_marked
from coilarray.cli.shared import AsJson, number_option, out_option
from coilarray.errors import HardwareError

_MOST_ERROR = 0.5  # relative, of a known inductance or frequency


def calibrate(
    recording: Annotated[
        Path, typer.Argument(metavar="RUN.sqlite", help="Recording of the board at rest, or of a campaign.")
    ],
    inductance_uh: Annotated[
        list[str] | None,
        typer.Option(
            "--inductance-uH",
            help="Known inductance, as STATE=VALUE, or VALUE for all; may be repeated. It gives the capacitances.",
        ),
    ] = None,
    inductance_error: Annotated[
        float,
        number_option(
            ("--inductance-error",), 0, _MOST_ERROR, "Relative standard error of the known inductance, as 0.01."
        ),
    ] = 0.0,
    simulated: Annotated[
        bool,
        typer.Option(
            "--simulated",
            help="Take the inductances of the simulated design instead. Measured and simulated L then agree by "
            "construction, which proves nothing.",
        ),
    ] = False,
    frequency_mhz: Annotated[
        str | None,
        typer.Option(
            "--frequency-MHz",
            help="Frequency of a known source in place of a state's tank, as STATE=VALUE. It gives the clock.",
        ),
    ] = None,
    frequency_error: Annotated[
        float,
        number_option(
            ("--frequency-error",), 0, _MOST_ERROR, "Relative standard error of the known frequency, as 1e-6."
        ),
    ] = 0.0,
    out: Annotated[Path, out_option("File to write: .toml.", ".toml")] = Path("board.toml"),
    as_json: AsJson = False,
) -> None:
    """Find the constants of a board from a recording.

    The constants are the clock and the capacitance of every tank. L depends on both, δ on neither.
    The clock is found from a known frequency, and the capacitances from known inductances. The file
    is for: coilarray board compare --calibration

    Example: coilarray board calibrate run.sqlite --inductance-uH 52.7 --inductance-error 0.005
    --out board.toml

    Example: coilarray board calibrate campaign.sqlite --simulated --out board.toml
    """
    given: dict[str, float] = {}
    for text in inductance_uh or ():
        state, value = _pair("--inductance-uH", text if "=" in text else f"={text}", 1e-6)
        if state in given or ("" in {state, *given} and given):
            raise HardwareError(
                "--inductance-uH must be one value for all states, or STATE=VALUE once for each; "
                f"got {text!r} after another."
            )
        given[state] = value
    frequency = None if frequency_mhz is None else _pair("--frequency-MHz", frequency_mhz, 1e6)
    if given and simulated:
        raise HardwareError("--inductance-uH and --simulated cannot be given together.")
    from coilarray.circuit.coupling import part_switches
    from coilarray.compute.display_units import DisplayUnit
    from coilarray.compute.table import Column, Table
    from coilarray.hardware.record.calibration import calibrate_board, save_calibration
    from coilarray.hardware.record.recording import iso_time, open_recording

    with open_recording(recording) as opened:
        known = dict.fromkeys(opened.states, given[""]) if "" in given else given
        result = calibrate_board(
            opened,
            inductances=known or None,
            inductance_error=inductance_error,
            from_design=simulated,
            known_frequency=frequency,
            frequency_error=frequency_error,
            source=f"coilarray board calibrate {recording.name}",
            made=iso_time(time.time()),
        )
        expected = part_switches(opened.design) if result.channels else None
    save_calibration(result, out)
    error = "" if result.clock_error is None else f" ± {result.clock_error:.3g} Hz"
    parts: list[str | Table] = [f"clock {result.clock:.8g} Hz{error}, from the {result.clock_from}"]
    if result.clock_error is not None:
        parts.append(
            f"for the file of --settings: clock_MHz = {result.clock * 1e-6:.4f}; scans are then timed by this clock, "
            "not by the slowest possible one"
        )
    if expected is not None:
        columns = (
            Column("state"),
            Column("L", unit="H"),
            Column("C", "", "F", DisplayUnit("pF", 1e12, 4)),
            Column("error", "±", "F", DisplayUnit("pF", 1e12, 2, significant=True)),
        )
        rows = ((one.state, one.inductance, one.capacitance, one.standard_error) for one in result.channels)
        parts.append(Table("channels", "", columns, tuple(rows)))
        tank, whole = expected.tank_capacitance * 1e12, expected.across_coil * 1e12
        parts.append(
            f"expected from the design: {tank:.4g} pF"
            + ("" if whole == tank else f", {whole:.4g} pF with the capacitances of its switches (typical)")
            + ", plus the capacitance of winding and traces"
        )
    if simulated:
        parts.append(
            "L is taken from the simulation: measured and simulated L agree by construction, which proves nothing."
        )
    print_marked(
        result.model_dump(by_alias=True, exclude={"schema_", "kind", "checksum", "source", "made", "design_hash"})
        | {"expected_capacitance_F": expected and expected.across_coil, "file": str(out)},
        [*parts, f"wrote {out}"],
        as_json=as_json,
        emulated=result.emulated,
    )


def _pair(option: str, text: str, unit: float) -> tuple[str, float]:
    state, equals, number = text.rpartition("=")
    try:
        value = float(number) if equals else math.nan
    except ValueError:
        value = math.nan
    if not (math.isfinite(value) and value > 0):
        raise HardwareError(f"{option} must be STATE=VALUE with a positive number; got {text.removeprefix('=')!r}.")
    return state, value * unit
