"""``coilarray board info``."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from coilarray import viz
from coilarray.cli.board.options import print_marked
from coilarray.cli.maps import campaign_response, is_recording
from coilarray.cli.shared import (
    AsJson,
    BoardConstants,
    References,
    check_file,
    design_record,
    draw,
    plot_option,
    print_result,
    write_numbers,
)
from coilarray.compute.display_units import PER_MILLION
from coilarray.compute.files import checked_rows, has_checksums, has_seal, read_text, unsealed
from coilarray.errors import HardwareError, OutputError

if TYPE_CHECKING:
    from coilarray.compute.table import Table

FORMATS = (".nc", ".csv")
"""Endings of the files that a recording is converted to."""
_SEALED = (".toml", ".csv")


def info(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="Recording of a board; with --verify other files.")],
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="File to convert to: .nc (netCDF) or .csv; none by default.")
    ] = None,
    series: Annotated[
        bool, typer.Option("--series", help="Convert to a time series of all scans, also for a campaign.")
    ] = False,
    baseline: Annotated[
        int, typer.Option(help="Number of first scans that are the baseline of δ of a time series.")
    ] = 10,
    partial: Annotated[
        bool, typer.Option("--partial", help="Convert an unfinished campaign; missing positions are NaN.")
    ] = False,
    calibration: BoardConstants = None,
    noise: Annotated[
        bool,
        typer.Option(
            "--noise", help="Show the Allan deviation of δ at rest beside the noise budget, instead of the summary."
        ),
    ] = False,
    reference: References = None,
    plot: Annotated[Path | None, plot_option("the Allan deviation, with --noise")] = None,
    verify: Annotated[
        bool, typer.Option("--verify", help="Only check the file against its checksums; also .toml and .csv.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Show a summary of a recording, and convert it.

    A campaign becomes a response, as `coilarray response` writes it: netCDF, or a CSV with a line
    for every position and state. Anything else becomes a time series: netCDF with all raw words, or
    a CSV of time_s and the δ of every coil, which `coilarray locate` reads. The whole file is
    checked for damage, and refused if a checksum is wrong.

    With --noise it shows the noise of single scans, the noise of averages over longer times, and
    the drift, beside the budget that `coilarray impedance --noise` explains. Let nothing touch the
    board while it is recorded, some ten minutes.

    Example: coilarray board info run.sqlite

    Example: coilarray board info campaign.sqlite --out measured.nc

    Example: coilarray board info rest.sqlite --noise --plot noise.png
    """
    if verify:
        _verify(run, as_json=as_json)
        return
    if noise:
        if out is not None:
            raise HardwareError("--noise cannot be given with --out.")
        _show_noise(run, reference or (), plot, as_json=as_json)
        return
    if reference or plot is not None:
        raise HardwareError("--reference and --plot are for --noise.")
    if run.is_dir():
        raise HardwareError(f"cannot read {run}: it is a folder.")
    check_file("--out", out, FORMATS)
    if out is not None and out.resolve() == run.resolve():
        raise OutputError(f"--out must be another file than the recording {run}.")
    if baseline < 1:
        raise HardwareError(f"--baseline must be at least 1; got {baseline}.")
    from coilarray.hardware.record.recorded_response import recorded_series, response_csv, series_csv
    from coilarray.hardware.record.recording import open_recording, summarize_recording

    wrote = []
    with open_recording(run) as recording:
        recording.check()
        summary = summarize_recording(recording)
        as_series = series or recording.campaign is None
        if as_series and calibration is not None:
            raise HardwareError("--calibration is for the response of a campaign; δ of a time series needs none.")
        if out is not None:
            if as_series:
                dataset = recorded_series(recording, baseline=baseline)
            else:
                dataset = campaign_response(recording, calibration, partial=partial)
            write_numbers(out, dataset, lambda: (series_csv if as_series else response_csv)(dataset))
            what = "the time series" if as_series else "the response"
            shape = " × ".join(str(n) for n in dataset.delta.shape)
            wrote = [f"wrote {out}: {what}, {shape} values over {dataset.delta.dims}"]
            board = summary["sessions"][0]["board"]
            if (known := dataset.attrs.get("calibration_board", board)) != board:
                wrote.append(f"the calibration is for the board “{known}”, the recording is of “{board}”")
    data = {**summary, "wrote": None if out is None else str(out)}
    print_marked(data, [*summary_parts(summary), *wrote], as_json=as_json, emulated=summary["emulated"])


def _verify(path: Path, *, as_json: bool) -> None:
    """Check a file against its checksums, and tell the findings."""
    if is_recording(str(path)) or path.suffix.lower() not in _SEALED:
        from coilarray.hardware.record.recording import open_recording

        with open_recording(path) as recording:
            recording.check()
            scans, checksums, without = f"{recording.count()} scans, which ", True, ""
    else:
        try:
            if path.suffix.lower() != ".csv":
                if checksums := has_seal(content := path.read_bytes()):
                    unsealed(content, path)
            elif checksums := has_checksums(table := read_text(path, HardwareError)):
                checked_rows(table, path)
        except (OSError, ValueError) as error:  # ValueError: a name with a zero byte
            raise HardwareError(f"cannot read {path}: {getattr(error, 'strerror', error)}.") from None
        scans, without = "", "carries no checksum: it is cut, or another program or a person wrote it"
    right = "are as their checksums say" if scans else "is as its checksum says"
    line = f"{path}: {scans}{right if checksums else without}"
    print_result({"file": str(path), "checksums": checksums}, as_json=as_json, lines=[line])


def summary_parts(summary: Mapping[str, Any]) -> list[str | Table]:
    """Return a recording's summary as lines and a table."""
    from coilarray.compute.table import text_table

    lines: list[str | Table] = [
        "{file}: design {design}, wiring {wiring}, coilarray {coilarray_version}".format_map(summary),
        *map("{started}  {port} ({board}), settings {settings_hash}: {scans} scans".format_map, summary["sessions"]),
    ]
    lost = f", {summary['lost_scans']} lost" if summary["lost_scans"] else ""
    lines.append(f"{summary['scans']} scans of {len(summary['states'])} states in {summary['seconds']:.1f} s{lost}")
    if summary["campaign"] is not None:
        lines.append("campaign: {measured} of {positions} positions are measured".format_map(summary["campaign"]))
    for test in summary["self_tests"]:
        more = f", and {len(test['symptoms']) - 1} more" if len(test["symptoms"]) > 1 else ""
        lines.append("self-test passed" if test["passed"] else f"self-test failed: {test['symptoms'][0]}{more}")
    rows = [
        (
            state["state"],
            *reading_cells(state["frequency_Hz"], state["inductance_H"]),
            "–" if state["relative_noise"] is None else PER_MILLION.text(state["relative_noise"], ".2"),
            *(str(state[verdict]) for verdict in ("good", "doubtful", "bad")),
            ", ".join(f"{count} {reason}" for reason, count in state["reasons"].items()),
        )
        for state in summary["states"]
    ]
    headers = ("state", "f in MHz", "L in µH", "noise of L", "good", "doubtful", "bad", "why")
    return [*lines, text_table(headers, rows)]


def reading_cells(frequency: float | None, inductance: float | None) -> tuple[str, str]:
    """Cells of a frequency in Hz and inductance in H."""
    return (
        "–" if frequency is None else f"{frequency * 1e-6:.6f}",
        "–" if inductance is None else f"{inductance * 1e6:.4f}",
    )


def _show_noise(path: Path, reference: Sequence[str], plot: Path | None, *, as_json: bool) -> None:
    """Print the longest session's Allan deviations beside its budget."""
    import numpy as np

    from coilarray.hardware.record.recorded_response import at_rest, less_reference, recorded_series
    from coilarray.hardware.record.recording import open_recording
    from coilarray.hardware.record.stability import stability
    from coilarray.hardware.scan.settings import board_budget
    from coilarray.report.circuit_tables import (
        allan_table,
        averages_table,
        budget_lines,
        stability_lines,
        stability_table,
    )

    with open_recording(path) as recording:
        series, design, emulated = recorded_series(recording), recording.design, recording.emulated
        longest = int(np.bincount(series.session.values).argmax())
        settings = recording.sessions[longest].settings
    kept = at_rest(series) & (series.session.values == longest)
    values = series.inductance.values[kept]
    delta = dict(zip(series.state.values.tolist(), (values / np.nanmean(values, axis=0) - 1).T, strict=True))
    budget = board_budget(design, settings)
    if reference:
        delta, budget = less_reference(delta, reference), budget.referenced(reference)
    expected = dict(zip(budget.states, budget.scan_noise.tolist(), strict=True))
    columns = np.stack(list(delta.values()), axis=-1)
    found = stability(
        series.time.values[kept], columns, list(delta), expected=[expected.get(name, math.nan) for name in delta]
    )
    draw(plot, lambda: viz.plot_stability(found))
    tables = (stability_table(found), allan_table(found))
    data = {
        **design_record(design),
        "emulated": emulated,
        "source": str(path),
        **found.attrs,
        **{table.name: table.records() for table in tables},
        "budget": budget.to_record(),
    }
    shown = (tables[0], averages_table(found))
    parts: list[str | Table] = [*shown, *stability_lines(found), *budget_lines(budget)]
    parts += [] if plot is None else [f"wrote {plot}"]
    print_marked(data, parts, as_json=as_json, emulated=emulated)
