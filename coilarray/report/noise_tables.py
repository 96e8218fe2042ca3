"""Tables of the noise budget, and what they say in words."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from coilarray.circuit.noise_budget import NoiseBudget
from coilarray.compute.arrays import FloatArray
from coilarray.compute.display_units import DisplayUnit
from coilarray.report.tables import Column, Table, Value

_NOISE = DisplayUnit("10⁻⁶", 1e6, 3, significant=True)
_DRIFT = DisplayUnit("10⁻⁶/K", 1e6, 3, significant=True)


def cause_table(budget: NoiseBudget) -> Table:
    """Return one row a cause, of the state where it is the largest, and the totals."""
    columns = (
        Column("cause"),
        Column("scan_noise", "noise of a scan", "1", _NOISE),
        Column("drift", "drift", "1/K", _DRIFT),
        Column("change", "since L_0", "1", _NOISE),
        Column("coils", "coils"),
        Column("size", "size"),
        Column("source", "source"),
    )
    rows: list[tuple[Value, ...]] = [
        (
            cause.name, *(_largest(values) for values in (cause.noise, cause.drift, np.abs(cause.change))),
            "common" if cause.common else "each", "assumed" if cause.assumed else "known", cause.source,
        )
        for cause in budget.causes
    ]  # fmt: skip
    changes = np.sqrt(np.sum([cause.change**2 for cause in budget.causes], axis=0))
    rows.append(("all in quadrature", *map(_largest, (budget.scan_noise, budget.drift, changes)), "", "", ""))
    return Table("causes", "Noise and drift of L, relative", columns, tuple(rows))


def sigma_table(budget: NoiseBudget) -> Table:
    """Return one row a state: the noise of δ, its drift, and both as a reading has them."""
    columns = (
        Column("state"),
        Column("noise", "noise of δ", "1", _NOISE),
        Column("drift", "drift of δ", "1/K", _DRIFT),
        Column("sigma", "σ of δ", "1", _NOISE),
    )
    values = (budget.noise.tolist(), budget.drift.tolist(), budget.sigma.tolist())
    return Table("sigma", "δ of a reading", columns, tuple(zip(budget.states, *values, strict=True)))


def budget_lines(budget: NoiseBudget) -> list[str]:
    """Say for which settings a budget holds, and what of it is not verified."""
    readout, assumed = budget.readout, [cause.name for cause in budget.causes if cause.assumed]
    lines = [
        f"RCOUNT {readout.rcount}, {readout.conversion_time * 1e3:.3g} ms at {readout.reference * 1e-6:.4g} MHz; plain "
        f"counting would resolve {readout.counting_limit:.2g} of f, the resolution above is finer",
        f"σ of δ: {readout.averaged_scans} of a reading and {readout.baseline_scans} scans of L_0, and what changes "
        f"from L_0 to the reading by {readout.temperature_change:g} K and {readout.supply_change * 1e3:g} mV",
    ]
    if budget.reference:
        lines.append(f"less the mean δ of {', '.join(budget.reference)}, which must not be pressed")
    if assumed:
        lines.append(f"assumed, not verified on a board: {', '.join(assumed)}; change them in [readout]")
    return lines


def _largest(values: FloatArray) -> float:
    return float(values[np.abs(values).argmax()])


def budget_tables(budget: NoiseBudget) -> Sequence[Table]:
    """Return both tables."""
    return cause_table(budget), sigma_table(budget)
