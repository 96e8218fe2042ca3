"""``coilarray board info --noise``: how steady a recorded board is, beside the noise budget of its design."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

from coilarray import viz
from coilarray.cli.board.options import print_marked
from coilarray.cli.shared import design_record, draw, table_text


def show_noise(path: Path, reference: Sequence[str], plot: Path | None, *, as_json: bool) -> None:
    """Print the Allan deviations of the longest session of a recording beside its budget."""
    import numpy as np

    from coilarray.hardware.record.baseline_drift import at_rest
    from coilarray.hardware.record.recorded_response import recorded_series
    from coilarray.hardware.record.recording import open_recording
    from coilarray.hardware.record.reference_coil import less_reference
    from coilarray.hardware.record.stability import stability
    from coilarray.hardware.scan.board_network import board_budget
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
    parts = [f"{table.title}\n{table_text(table.headers, table.cells())}" for table in shown]
    parts += [*stability_lines(found), *budget_lines(budget)]
    parts += [] if plot is None else [f"wrote {plot}"]
    print_marked(data, parts, as_json=as_json, emulated=emulated)
