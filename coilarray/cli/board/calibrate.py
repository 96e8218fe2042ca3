"""``coilarray board calibrate``."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from coilarray.cli.board.options import print_marked
from coilarray.cli.shared import AsJson, check_file, table_text
from coilarray.compute.display_units import true_minus
from coilarray.errors import HardwareError

if TYPE_CHECKING:
    from coilarray.design.scan_states import Switches
    from coilarray.hardware.record.calibration import BoardCalibration, Channel
    from coilarray.hardware.record.stability import Drift

_HOUR = 3600.0  # s


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
        float, typer.Option(help="Relative standard error of the known inductance, as 0.01.")
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
        float, typer.Option(help="Relative standard error of the known frequency, as 1e-6.")
    ] = 0.0,
    drift_order: Annotated[
        int | None,
        typer.Option(help="Order of the polynomial of the drift, 1 to 3; by default the lowest order that fits."),
    ] = None,
    out: Annotated[Path, typer.Option("--out", "-o", help="File to write: .toml.")] = Path("board.toml"),
    as_json: AsJson = False,
) -> None:
    """Find the constants of a board from a recording.

    The constants are the clock, the capacitance of every tank, and the drift. L depends on all of them, δ only on the
    drift. The clock is found from a known frequency, the capacitances from known inductances, and the drift of L_0 from
    the scans at rest. Use the file with: coilarray board compare --calibration

    Example: coilarray board calibrate run.sqlite --inductance-uH 52.7 --inductance-error 0.005 --out board.toml

    Example: coilarray board calibrate campaign.sqlite --simulated --out board.toml
    """
    check_file("--out", out, (".toml",))
    given = _inductances(inductance_uh or ())
    frequency = None if frequency_mhz is None else _pair("--frequency-MHz", frequency_mhz, 1e6)
    if given and simulated:
        raise HardwareError("--inductance-uH and --simulated cannot be given together.")
    from coilarray.circuit.impedance import part_switches
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
            order=drift_order,
            source=f"coilarray board calibrate {recording.name}",
            made=iso_time(time.time()),
        )
        design = opened.design if result.channels else None
    expected = None if design is None else part_switches(design)
    save_calibration(result, out)
    print_marked(
        {**_data(result), "expected_capacitance_F": expected and expected.across_coil, "file": str(out)},
        [*_text(result, expected), f"wrote {out}"],
        as_json=as_json,
        emulated=result.emulated,
    )


def _inductances(texts: Sequence[str]) -> dict[str, float]:
    """Read inductances in H by state, or one for all states under an empty name."""
    found: dict[str, float] = {}
    for text in texts:
        state, value = _pair("--inductance-uH", text if "=" in text else f"={text}", 1e-6)
        if state in found:
            raise HardwareError(f"--inductance-uH must name a state once; got {text!r} again.")
        found[state] = value
    if "" in found and len(found) > 1:
        raise HardwareError("--inductance-uH must be one value for all states, or STATE=VALUE for each; got both.")
    return found


def _pair(option: str, text: str, unit: float) -> tuple[str, float]:
    state, equals, number = text.rpartition("=")
    try:
        value = float(number) if equals else math.nan
    except ValueError:
        value = math.nan
    if not (math.isfinite(value) and value > 0):
        raise HardwareError(f"{option} must be STATE=VALUE with a positive number; got {text.removeprefix('=')!r}.")
    return state, value * unit


def _data(result: BoardCalibration) -> dict[str, Any]:
    from coilarray.hardware.record.calibration import channel_record

    return {
        "emulated": result.emulated,
        "board": result.board,
        "clock_Hz": result.clock,
        "clock_standard_error_Hz": result.clock_error,
        "clock_from": result.clock_from,
        "capacitances_from": result.inductances_from,
        "channels": [channel_record(channel) for channel in result.channels],
        "drifts": [
            {
                "session": drift.session,
                "state": drift.state,
                "order": len(drift.coefficients),
                "rate_per_s": drift.rate,
                "rate_standard_error_per_s": drift.rate_error,
                "scatter": drift.scatter,
                "smooth": drift.smooth,
            }
            for drift in result.drifts
        ],
    }


def _text(result: BoardCalibration, expected: Switches | None) -> list[str]:
    error = "" if result.clock_error is None else f" ± {result.clock_error:.3g} Hz"
    parts = [f"clock {result.clock:.8g} Hz{error}, from the {result.clock_from}"]
    if result.clock_error is not None:
        parts.append(
            f"for the file of --settings: clock_MHz = {result.clock * 1e-6:.4f}; scans are then timed by this clock, "
            "not by the slowest possible one"
        )
    if result.channels:
        parts.append(table_text(("state", "L (µH)", "C (pF)", "±"), [_channel_row(one) for one in result.channels]))
    if expected is not None:
        parts.append(_expected(expected))
    if result.inductances_from == "design":
        parts.append(
            "L is taken from the simulation: measured and simulated L agree by construction, which proves nothing."
        )
    if result.drifts:
        headers = ("session", "state", "order", "drift of L_0 (10⁻⁶/h)", "±", "scatter (10⁻⁶)", "smooth")
        parts.append(table_text(headers, [_drift_row(one) for one in result.drifts]))
    return parts


def _expected(switches: Switches) -> str:
    tank, whole = switches.tank_capacitance * 1e12, switches.across_coil * 1e12
    more = "" if whole == tank else f", {whole:.4g} pF with the capacitances of its switches (typical, not verified)"
    return f"expected from the design: {tank:.4g} pF{more}, plus the capacitance of winding and traces"


def _channel_row(channel: Channel) -> tuple[str, ...]:
    numbers = (channel.inductance * 1e6, channel.capacitance * 1e12)
    return channel.state, *(f"{number:.4f}" for number in numbers), f"{channel.standard_error * 1e12:.2g}"


def _drift_row(drift: Drift) -> tuple[str, ...]:
    numbers = (drift.rate * _HOUR, drift.rate_error * _HOUR, drift.scatter)
    return (
        str(drift.session + 1),
        drift.state,
        str(len(drift.coefficients)),
        *(true_minus(f"{number * 1e6:.3f}") for number in numbers),
        "yes" if drift.smooth else "no",
    )
