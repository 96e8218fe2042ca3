"""``coilarray board --noise``: how steady the readings of a board are, beside the noise budget of its design."""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from coilarray import viz
from coilarray.cli.board_options import BoardOptions, opened_board, print_marked
from coilarray.cli.shared import design_record, draw, open_design, progress_bar, table_text
from coilarray.errors import HardwareError

if TYPE_CHECKING:
    from coilarray.compute.arrays import FloatArray
    from coilarray.design.model import Design
    from coilarray.hardware.scan.settings import ScanSettings

_LONGEST = 1e6  # s
_TENTHS = 10  # of a second, in which the progress bar counts


class _AtRest(NamedTuple):
    """Scans of a board at rest: times in s, and L in H by state."""

    design: Design
    settings: ScanSettings
    time: FloatArray
    inductance: dict[str, FloatArray]
    emulated: bool
    source: str
    recorded_design: Design | None = None  # where it is another one than `design`


def show_noise(
    noise: str,
    design: str | None,
    reference: Sequence[str],
    plot: Path | None,
    *,
    options: BoardOptions,
    as_json: bool,
    allow_violations: bool,
) -> None:
    """Measure a board for a time in s, or read a recording, and print Allan deviations beside the budget."""
    import numpy as np

    from coilarray.hardware.record.reference_coil import less_reference
    from coilarray.hardware.record.stability import stability
    from coilarray.hardware.scan.board_network import board_budget
    from coilarray.report.noise_tables import (
        allan_table,
        averages_table,
        budget_lines,
        stability_lines,
        stability_table,
    )

    seconds = _seconds(noise)
    if seconds is None:
        if options.given:
            raise HardwareError(
                f"--noise reads the recording {noise}; it cannot be given with {', '.join(options.given)}."
            )
        at_rest = _recorded(Path(noise), design, allow_violations)
    else:
        at_rest = _measured(options, open_design(design, allow_violations=allow_violations), seconds)
    opened = at_rest.design
    budget = board_budget(opened, at_rest.settings)
    delta = {name: values / np.nanmean(values) - 1 for name, values in at_rest.inductance.items()}
    if reference:
        delta, budget = less_reference(delta, reference), budget.referenced(reference)
    expected = dict(zip(budget.states, budget.scan_noise.tolist(), strict=True))
    columns = np.stack(list(delta.values()), axis=-1)
    found = stability(at_rest.time, columns, list(delta), expected=[expected.get(name, math.nan) for name in delta])
    draw(plot, lambda: viz.plot_stability(found))
    tables = (stability_table(found), allan_table(found))
    data: dict[str, Any] = {
        **design_record(opened),
        "emulated": at_rest.emulated,
        "source": at_rest.source,
        **found.attrs,
        **{table.name: table.records() for table in tables},
        "budget": budget.to_record(),
    }
    shown = (tables[0], averages_table(found))
    parts = [f"{table.title}\n{table_text(table.headers, table.cells())}" for table in shown]
    parts += [*stability_lines(found), *budget_lines(budget)]
    if at_rest.recorded_design is not None:
        data["recorded_design_hash"] = at_rest.recorded_design.digest
        parts.append(
            f"the budget is that of {opened.name}; the recording was made with another design or version of it"
        )
    parts += [] if plot is None else [f"wrote {plot}"]
    print_marked(data, parts, as_json=as_json, emulated=at_rest.emulated)


def _seconds(text: str) -> float | None:
    """Read a time in s; None for the name of a recording."""
    try:
        seconds = float(text)
    except ValueError:
        return None
    if not 0 < seconds <= _LONGEST:
        raise HardwareError(f"--noise must be a recording, or a time above 0 and at most {_LONGEST:g} s; got {text}.")
    return seconds


def _measured(options: BoardOptions, design: Design, seconds: float) -> _AtRest:
    import numpy as np

    from coilarray.hardware.record.stability import FEWEST
    from coilarray.hardware.scan.readings import read_scan

    times: list[float] = []
    rows: list[dict[str, float]] = []
    with (
        progress_bar("noise") as progress,
        opened_board(options, design, real_time=False) as (board, settings),
        closing(board.reader.scans()) as scans,
    ):
        if seconds < (least := FEWEST * settings.period):
            raise HardwareError(f"--noise must be at least {least:.2g} s for {FEWEST} of these scans; got {seconds:g}.")
        for scan in scans:
            passed = scan.time - times[0] if times else 0.0
            if passed > seconds:
                break
            times.append(scan.time)
            rows.append(read_scan(scan, settings, design.circuit.capacitance).inductances)
            progress(round(_TENTHS * passed), math.ceil(_TENTHS * seconds))
        emulated, source = board.emulated, board.port
    names = [state.name for state in settings.states]
    inductance = {name: np.array([row.get(name, math.nan) for row in rows]) for name in names}
    return _AtRest(design, settings, np.array(times), inductance, emulated, source)


def _recorded(path: Path, design: str | None, allow_violations: bool) -> _AtRest:
    import numpy as np

    from coilarray.hardware.record.baseline_drift import at_rest
    from coilarray.hardware.record.recorded_response import recorded_series
    from coilarray.hardware.record.recording import open_recording

    with open_recording(path) as recording:
        series = recorded_series(recording)
        session = int(np.bincount(series.session.values).argmax())  # the longest
        kept = at_rest(series) & (series.session.values == session)
        opened = recording.design if design is None else open_design(design, allow_violations=allow_violations)
        known = [state.name for state in opened.plan]
        if unknown := [name for name in recording.states if name not in known]:
            raise HardwareError(
                f"{path} has the state {unknown[0]!r}, which the design {opened.name} does not have; its states are "
                f"{', '.join(known)}."
            )
        return _AtRest(
            opened,
            recording.sessions[session].settings,
            series.time.values[kept],
            {name: series.inductance.values[kept, k] for k, name in enumerate(recording.states)},
            recording.emulated,
            str(path),
            None if opened.digest == recording.design.digest else recording.design,
        )
