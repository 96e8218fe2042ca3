"""Tables of the noise budget, with a summary in words."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from coilarray.circuit.noise_budget import NoiseBudget
from coilarray.compute.arrays import FloatArray
from coilarray.compute.display_units import DisplayUnit
from coilarray.compute.table import Column, Table, Value

if TYPE_CHECKING:
    import xarray as xr

_NOISE = DisplayUnit("10⁻⁶", 1e6, 3, significant=True)
_DRIFT = DisplayUnit("10⁻⁶/K", 1e6, 3, significant=True)


def cause_table(budget: NoiseBudget) -> Table:
    """Return a table of the causes of noise.

    A row for each cause is for the state where it is the largest. The totals follow.
    """
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
            "common" if cause.common else "each", cause.size, cause.source,
        )
        for cause in budget.causes
    ]  # fmt: skip
    changes = np.sqrt(np.sum([cause.change**2 for cause in budget.causes], axis=0))
    rows.append(("all in quadrature", *map(_largest, (budget.scan_noise, budget.drift, changes)), "", "", ""))
    return Table("causes", "Noise and drift of L, relative", columns, tuple(rows))


def sigma_table(budget: NoiseBudget) -> Table:
    """Return a table of the noise of δ by state.

    A row has the noise of δ, its drift, and both as in a reading.
    """
    columns = (
        Column("state"),
        Column("noise", "noise of δ", "1", _NOISE),
        Column("drift", "drift of δ", "1/K", _DRIFT),
        Column("sigma", "σ of δ", "1", _NOISE),
        *([Column("readable")] if budget.unread else []),
    )
    values = [budget.noise.tolist(), budget.drift.tolist(), budget.sigma.tolist()]
    if budget.unread:
        values.append([name not in budget.unread for name in budget.states])
    return Table("sigma", "δ of a reading", columns, tuple(zip(budget.states, *values, strict=True)))


def budget_lines(budget: NoiseBudget) -> list[str]:
    """Describe the settings of a budget and its unverified parts."""
    readout, assumed = budget.readout, [cause.name for cause in budget.causes if cause.size == "assumed"]
    lines = [
        f"RCOUNT {readout.rcount}, {readout.conversion_time * 1e3:.3g} ms at {readout.reference * 1e-6:.4g} MHz; plain "
        f"counting would resolve {readout.counting_limit:.2g} of f, the resolution above is finer",
        f"σ of δ: {readout.averaged_scans} of a reading and {readout.baseline_scans} scans of L_0, and what changes "
        f"from L_0 to the reading by {readout.temperature_change:g} K and {readout.supply_change * 1e3:g} mV",
    ]
    if budget.reference:
        lines.append(f"less the mean δ of {', '.join(budget.reference)}, which must not be pressed")
    if budget.unread:
        lines.append(f"no LDC1614 can read {', '.join(budget.unread)}, whose noise is of no use: coilarray impedance")
    if assumed:
        lines.append(f"assumed, not verified on a board: {', '.join(assumed)}; change them in [readout]")
    return lines


def stability_table(found: xr.Dataset) -> Table:
    """Return a table of measured noise and drift by state.

    The values come from `coilarray.hardware.record.stability.stability`: noise of a scan, budget, drift.
    """
    columns = (
        Column("state"),
        Column("scan_noise", "noise of a scan", "1", _NOISE),
        Column("low", "from", "1", _NOISE),
        Column("high", "to", "1", _NOISE),
        Column("expected", "budget", "1", _NOISE),
        Column("least", "least deviation", "1", _NOISE),
        Column("least_tau", "averaged over", "s", DisplayUnit("s", 1.0, 3, significant=True)),
        Column("drift", "drift", "1/s", DisplayUnit("10⁻⁶/h", 3.6e9, 3, significant=True)),
        Column("drift_error", "± drift", "1/s", DisplayUnit("10⁻⁶/h", 3.6e9, 2, significant=True)),
    )
    rows: list[tuple[Value, ...]] = []
    for name in found.state.values.tolist():
        one = found.sel(state=name)
        least = int(np.nanargmin(one.deviation.values))
        shown = (one.scan_noise, one.low[0], one.high[0], one.expected, one.deviation[least], one.tau[least])
        numbers = [float(value) for value in (*shown, one.drift, one.drift_error)]
        rows.append((name, *("" if math.isnan(value) else value for value in numbers)))
    return Table("stability", "Noise and drift of δ at rest", columns, tuple(rows))


def allan_table(found: xr.Dataset) -> Table:
    """Return a table of Allan deviations.

    A row for every state and averaging time has its confidence interval.
    """
    columns = (
        Column("state"),
        Column("tau", "averaged over", "s", DisplayUnit("s", 1.0, 4, significant=True)),
        *(Column(name, text, "1", _NOISE) for name, text in (("deviation", ""), ("low", "from"), ("high", "to"))),
    )
    rows = [
        (name, float(tau), *(float(found[key].sel(state=name, tau=tau)) for key in ("deviation", "low", "high")))
        for name in found.state.values.tolist()
        for tau in found.tau.values
        if np.isfinite(found.deviation.sel(state=name, tau=tau))
    ]
    return Table("allan", "Allan deviation of δ", columns, tuple(rows))


def averages_table(found: xr.Dataset) -> Table:
    """Return a table of averaging times.

    A row for each has the Allan deviation over all states, and white noise of the budget.
    """
    columns = (
        Column("tau", "averaged over", "s", DisplayUnit("s", 1.0, 4, significant=True)),
        *(Column(name, f"{name} coil", "1", _NOISE) for name in ("least", "median", "largest")),
        Column("expected", "budget, white", "1", _NOISE),
    )
    expected, first = float(found.expected.median()), float(found.tau[0])
    rows = []
    for tau in found.tau.values.tolist():
        values = found.deviation.sel(tau=tau).values
        white = expected * math.sqrt(first / tau)
        shown = (np.nanmin(values), np.nanmedian(values), np.nanmax(values), white)
        rows.append((tau, *("" if math.isnan(value) else float(value) for value in shown)))
    return Table("averages", "Allan deviation of δ", columns, tuple(rows))


def stability_lines(found: xr.Dataset) -> list[str]:
    """Describe the measuring time and compare noise and budget."""
    lines = [f"{found.attrs['scans']} scans, one every {found.attrs['period']:.4g} s; intervals of 68 %"]
    ratio = (found.scan_noise / found.expected).values
    if np.isfinite(ratio).any():
        lines.append(f"noise of a scan over that of the budget: {np.nanmin(ratio):.2f} to {np.nanmax(ratio):.2f}")
    return lines


def _largest(values: FloatArray) -> float:
    return float(values[np.abs(values).argmax()])


def budget_tables(budget: NoiseBudget) -> Sequence[Table]:
    """Return both tables."""
    return cause_table(budget), sigma_table(budget)
