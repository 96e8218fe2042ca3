"""Commands for what a board has recorded: ``coilarray board info``, ``calibrate`` and ``compare``."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from coilarray import viz
from coilarray.cli import shared
from coilarray.compute.display_units import PER_MILLION, DisplayUnit
from coilarray.compute.files import checked_rows, has_checksums, has_seal, make_folder, read_text, unsealed
from coilarray.compute.table import Column, Table, text_table
from coilarray.errors import HardwareError, LocalizeError, OutputError

if TYPE_CHECKING:
    import xarray as xr

    from coilarray.compute.arrays import FloatArray
    from coilarray.design.model import Design

    _Source = tuple[xr.Dataset, Sequence[FloatArray]]  # a response, and the outlines of its coils where they are known


FORMATS = (".nc", ".csv")  # endings of the files that a recording is converted to
_SEALED = (".toml", ".csv")
_MOST_ERROR = 0.5  # relative, of a known inductance or frequency
_PAGE = ".html"
_LACKING = ("only_measured", "only_simulated")
_ALONE = 2e-3  # m; spacing of a simulated map along an axis on which there is a single measured position


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
    calibration: shared.BoardConstants = None,
    noise: Annotated[
        bool,
        typer.Option(
            "--noise", help="Show the Allan deviation of δ at rest beside the noise budget, instead of the summary."
        ),
    ] = False,
    reference: shared.References = None,
    plot: Annotated[Path | None, shared.plot_option("the Allan deviation, with --noise")] = None,
    verify: Annotated[
        bool, typer.Option("--verify", help="Only check the file against its checksums; also .toml and .csv.")
    ] = False,
    as_json: shared.AsJson = False,
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
    shared.check_file("--out", out, FORMATS)
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
                dataset = shared.campaign_response(recording, calibration, partial=partial)
            shared.write_numbers(out, dataset, lambda: (series_csv if as_series else response_csv)(dataset))
            what = "the time series" if as_series else "the response"
            shape = " × ".join(str(n) for n in dataset.delta.shape)
            wrote = [f"wrote {out}: {what}, {shape} values over {', '.join(dataset.delta.dims)}"]
            board = summary["sessions"][0]["board"]
            if (known := dataset.attrs.get("calibration_board", board)) != board:
                wrote.append(f"the calibration is for the board “{known}”, the recording is of “{board}”")
    data = {**summary, "wrote": None if out is None else str(out)}
    lines = [*summary_parts(summary), *wrote]
    shared.print_result(data, as_json=as_json, lines=lines, emulated=summary["emulated"])


def _verify(path: Path, *, as_json: bool) -> None:
    if shared.is_recording(str(path)) or path.suffix.lower() not in _SEALED:
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
    shared.print_result({"file": str(path), "checksums": checksums}, as_json=as_json, lines=[line])


def summary_parts(summary: Mapping[str, Any]) -> list[str | Table]:
    """Return a recording's summary as lines and a table."""
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
    headers = ("state", "f (MHz)", "L_eff (µH)", "noise of L_eff", "good", "doubtful", "bad", "why")
    return [*lines, text_table(headers, rows)]


def reading_cells(frequency: float | None, inductance: float | None) -> tuple[str, str]:
    """Cells of a frequency in Hz and inductance in H."""
    return (
        "–" if frequency is None else f"{frequency * 1e-6:.6f}",
        "–" if inductance is None else f"{inductance * 1e6:.4f}",
    )


def _show_noise(path: Path, reference: Sequence[str], plot: Path | None, *, as_json: bool) -> None:
    import numpy as np

    from coilarray.hardware.record.recorded_response import at_rest, less_reference, recorded_series
    from coilarray.hardware.record.recording import open_recording
    from coilarray.hardware.record.stability import stability
    from coilarray.hardware.scan.settings import board_budget
    from coilarray.report import tables as report

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
    shared.draw(plot, lambda: viz.plot_stability(found))
    tables = (report.stability_table(found), report.allan_table(found))
    data = {
        **shared.design_record(design),
        "emulated": emulated,
        "source": str(path),
        **found.attrs,
        **{table.name: table.records() for table in tables},
        "budget": budget.to_record(),
    }
    shown = (tables[0], report.averages_table(found))
    parts: list[str | Table] = [*shown, *report.stability_lines(found), *report.budget_lines(budget)]
    parts += [] if plot is None else [f"wrote {plot}"]
    shared.print_result(data, as_json=as_json, lines=parts, emulated=emulated)


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
        shared.number_option(
            "--inductance-error", 0, _MOST_ERROR, "Relative standard error of the known inductance, as 0.01."
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
        shared.number_option(
            "--frequency-error", 0, _MOST_ERROR, "Relative standard error of the known frequency, as 1e-6."
        ),
    ] = 0.0,
    out: Annotated[Path, shared.out_option("File to write: .toml.", ".toml")] = Path("board.toml"),
    as_json: shared.AsJson = False,
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
    shared.print_result(
        result.model_dump(by_alias=True, exclude={"schema_", "kind", "checksum", "source", "made", "design_hash"})
        | {"expected_capacitance_F": expected and expected.across_coil, "file": str(out)},
        lines=[*parts, f"wrote {out}"],
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


def compare(
    measured: Annotated[
        str,
        typer.Argument(
            metavar="MEASURED", help="Recording of a campaign, response (.nc), a design, or `published` for Table A1."
        ),
    ],
    simulated: Annotated[
        str,
        typer.Argument(
            metavar="SIMULATED", help="The same; the response of a design is computed at the measured positions."
        ),
    ],
    calibration: shared.BoardConstants = None,
    reference: shared.References = None,
    largest_shift_mm: Annotated[
        float | None,
        shared.number_option(
            "--largest-shift-mm", 0, 1000, "Largest shift to try; the spacing of the measured positions by default."
        ),
    ] = None,
    out: Annotated[
        Path | None, shared.out_option("Also write: one page (.html), or a folder with page, tables and netCDF.")
    ] = None,
    picture: Annotated[Path | None, shared.plot_option("the residuals and x0 of both", "--picture")] = None,
    as_json: shared.AsJson = False,
    allow_violations: shared.AllowViolations = False,
) -> None:
    """Compare a measured response with a simulated one.

    For every coil it finds the scale and the shift that fit the simulated map to the measured map,
    the residuals before and after, and x0, A and B of the ellipses of both with the same settings.
    Maps on different grids are interpolated, never extrapolated. States, depths and positions of a
    single map are listed.

    Example: coilarray board compare campaign.sqlite gast2020 --out comparison
    """
    if calibration is not None and not shared.is_recording(measured):
        raise LocalizeError(f"--calibration is for a recording; {measured} is not one.")
    from coilarray.report.measurement import comparison_notes, comparison_tables, write_comparison_page
    from coilarray.response.dataset import in_ellipse_window
    from coilarray.studies.comparison import compare_responses

    if out is not None and _is_page(out):
        shared.check_file("--out", out, (_PAGE,))
    elif out is not None:
        make_folder(out)  # a folder that cannot be written is known before the work begins
    largest_shift = None if largest_shift_mm is None else largest_shift_mm * 1e-3
    first, outlines = _response(measured, None, largest_shift, calibration, allow_violations)
    if simulated == "published":  # which is known there alone
        first = in_ellipse_window(first)
    second, others = _response(simulated, first, largest_shift, None, allow_violations)
    outlines = outlines or others
    if reference:
        from coilarray.hardware.record.recorded_response import response_less_reference

        first, second = (response_less_reference(one, reference) for one in (first, second))
    with shared.progress_bar("comparison") as progress:
        result = compare_responses(first, second, largest_shift=largest_shift, progress=progress)
    tables, notes = comparison_tables(result), comparison_notes(result)
    written: list[Path] = []
    if out is not None:
        page = partial(write_comparison_page, result, names=(measured, simulated), outlines=outlines)
        if _is_page(out):
            page(out)
            written = [out]
        else:
            written = shared.write_folder(out, "comparison", page, result, tables)
    shared.draw(picture, lambda: viz.comparison_figure(result, -1, outlines))
    files = [str(path) for path in (*written, picture) if path is not None]
    emulated = any(bool(one.attrs.get("emulated", 0)) for one in (first, second))
    said = {key: result.attrs[key] for key in ("noise_from", "points_left_out", "points_missing")}
    lacking = {key: [name for name in result.attrs[key].split(", ") if name] for key in _LACKING}
    data = {
        "emulated": emulated, "measured": measured, "simulated": simulated, **said,
        **lacking, "notes": notes, **{table.name: table.records() for table in tables}, "files": files,
    }  # fmt: skip
    parts: list[str | Table] = [
        *(table for table in tables if table.name != "curves"),
        *notes,
        *(f"wrote {path}" for path in files),
    ]
    shared.print_result(data, as_json=as_json, lines=parts, emulated=emulated)


def _is_page(out: Path) -> bool:
    return out.suffix.lower() == _PAGE


def _response(
    name: str, beside: xr.Dataset | None, largest_shift: float | None, calibration: Path | None, allow_violations: bool
) -> _Source:
    if shared.is_recording(name):
        return shared.recorded_map(Path(name), calibration)
    if shared.is_map(name):
        return shared.read_response(Path(name)), ()
    if name == "published":
        from coilarray.paper.ellipse_model import published_map

        x, y = (None, None) if beside is None else _around(beside, largest_shift)
        return published_map(x, y), ()
    return _computed(shared.open_design(name, allow_violations=allow_violations), beside, largest_shift)


def _computed(design: Design, beside: xr.Dataset | None, largest_shift: float | None) -> _Source:
    # L_0 is by all capacitance only beside a calibrated recording, otherwise by the design's tank capacitor.
    from coilarray.errors import ElastomerError
    from coilarray.hardware.scan.settings import board_network
    from coilarray.report.page import map_outlines
    from coilarray.response.map import Imperfections, respond, response_map
    from coilarray.response.setup import indentation_of

    indentation_of(design)  # refused before the network is computed
    # beside a recording of coils at the channels of a converter there are no switches
    wired = beside is not None and bool(beside.attrs.get("wired", False))
    board = Imperfections(network=board_network(design, wired=wired))
    with shared.progress_bar(f"response of {design.name}") as progress:
        at = partial(response_map, design, imperfections=board, progress=progress)
        if beside is None:
            response = at()
            return response, map_outlines(design, response)
        x, y = _around(beside, largest_shift)
        try:
            response = at(depths=beside.depth.values, x=x, y=y)
        except ElastomerError:  # a sample may end where the measured positions do
            response = at(depths=beside.depth.values, x=beside.x.values, y=beside.y.values)
    if "capacitance_from" in beside.attrs:
        response = response.assign(base_inductance=respond(design, response, ideal=True).base_inductance)
    return response, map_outlines(design, response)


def _around(response: xr.Dataset, largest_shift: float | None) -> tuple[FloatArray, FloatArray]:
    """Positions along x and y, widened by the largest shift."""
    import numpy as np

    axes = []
    for name in ("x", "y"):
        axis = np.asarray(response[name].values, dtype=np.float64)
        step = float(np.median(np.diff(axis))) if len(axis) > 1 else _ALONE
        count = max(1 if len(axis) > 1 else 2, math.ceil((largest_shift or 0.0) / step - 1e-9))
        beyond = step * np.arange(1, 1 + count)
        axes.append(np.concatenate((axis[0] - beyond[::-1], axis, axis[-1] + beyond)))
    return axes[0], axes[1]
