"""Sweeps and tolerance studies that the page starts.

They run in processes of their own. Their results become rows.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from coilarray.compute.display_units import DisplayUnit, value_text
from coilarray.compute.store import open_store
from coilarray.compute.threads import Progress
from coilarray.design.model import build_design_file
from coilarray.studies.quantities import QUANTITIES
from coilarray.studies.sweep import RULES, parse_axis, plan_sweep, run_sweep
from coilarray.studies.tolerance import analyse, load_tolerances
from coilarray.studies.tolerance.analysis import default_quantities
from coilarray.viz.studio.entries import Entry, text_of
from coilarray.viz.studio.job import progress_of
from coilarray.viz.studio.services import Document, Stopped, Tell

_EVERY = 1.0  # s between two results of a running sweep
_STEPS = 5  # number of offered values
_NEAR = 0.2  # range of the offered values to both sides, over the present value
_THREE = DisplayUnit(digits=3, significant=True)

PLAIN = tuple(name for name, quantity in QUANTITIES.items() if not any(one.required for one in quantity.options))
"""Names of the quantities that need no options."""


@dataclass(frozen=True)
class SweepRequest:
    """Sweep of a design.

    It has its axes as on the command line, and its quantities. Without quantities the first of the design is used.
    """

    document: Document
    name: str
    axes: tuple[str, ...]
    quantities: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class SweepResult:
    """Points of a sweep with their known values."""

    points: tuple[Mapping[str, Any], ...]  # entries that are changed, as for `coilarray.design.vary.vary`
    values: xr.Dataset  # of `coilarray.sweep`


@dataclass(frozen=True)
class Row:
    """Row of a table of results."""

    cells: tuple[str, ...]
    point: int | None = None  # point whose entries can be used
    reason: str = ""  # why it has no values or no board
    broken: bool = False  # breaks fabrication rules


def sweep_entries(item: SweepRequest, tell: Tell, _: Stopped) -> SweepResult:
    """Sweep as ``coilarray sweep`` does, with the same store.

    This task sends results while it runs.
    """
    file = build_design_file(item.document, item.name)
    wanted = item.quantities or default_quantities(file.design)[:1]
    plan = plan_sweep(file, [parse_axis(text) for text in item.axes], wanted)
    sent = time.monotonic()

    def watch(so_far: Callable[[], xr.Dataset]) -> None:
        nonlocal sent
        if time.monotonic() - sent > _EVERY:
            tell(SweepResult(plan.points, so_far()))
            sent = time.monotonic()

    found = run_sweep(plan, 1, open_store(None), progress=progress_of(tell), watch=watch)
    return SweepResult(plan.points, found)


def spread_boards(
    document: Document, name: str, tolerances: Path | None, quantities: Sequence[str], samples: int, progress: Progress
) -> xr.Dataset:
    """Analyse tolerances as ``coilarray tolerance`` does.

    Without a file typical values are used.
    """
    file = build_design_file(document, name)
    settings: dict[str, Any] = {"quantities": quantities, "samples": samples, "cache": open_store(None)}
    return analyse(file, load_tolerances(tolerances), **settings, progress=progress)


def axis_text(entry: Entry) -> str:
    """Values near the value of an entry, as text.

    The text has the form that ``coilarray sweep --vary`` reads behind the key.

    Examples
    --------
    >>> axis_text(Entry("array.pitch_mm", "pitch", "mm", "Array", 13.0, 6.5, 26.0, 0.1))
    '10.4:15.6:5'
    """
    if entry.step == 1.0:  # whole number
        low, high = max(entry.low, entry.value - 2), min(entry.high, entry.value + 2)
        return ",".join(text_of(value) for value in np.arange(low, high + 1))
    width = _NEAR * (abs(entry.value) or entry.high)
    low, high = max(entry.low, entry.value - width), entry.value + width
    return f"{low:.4g}:{high:.4g}:{_STEPS}"


def sweep_rows(result: SweepResult) -> tuple[tuple[str, ...], tuple[Row, ...]]:
    """Head and rows of a table of a sweep.

    There is a row for each computed point.
    """
    keys = [str(name) for name in result.values.data_vars if name != "reason"]
    columns = [result.values[key].values.ravel().tolist() for key in keys]
    broken = (result.values[RULES] > 0).values.ravel().tolist()
    rows = []
    for k, reason in enumerate(result.values.reason.values.ravel().tolist()):
        found = [column[k] for column in columns]
        if reason or not np.isnan(found).all():
            values = (*result.points[k].values(), *(None if np.isnan(one) else one for one in found))
            why = reason or ("it breaks fabrication rules" if broken[k] else "")
            rows.append(Row(tuple(map(value_text, values)), None if reason else k, why, broken[k]))
    return (*result.points[0], *keys), tuple(rows)


def tolerance_rows(result: xr.Dataset) -> tuple[tuple[str, ...], tuple[Row, ...]]:
    """Head and rows of a table of a tolerance study.

    There is a row for each output, then a row for each limit.
    """
    sampled = "sample_deviation" in result
    rows = []
    for k, name in enumerate(result.output.values.tolist()):
        one = result.isel(output=k)
        first = int(np.argmax(one.share.values))
        share = float(one.share[first])
        of = f"{one.contributor.values[first]} ({100 * share:.0f} %)" if share > 0 else "no error"
        (linear,) = _THREE.texts([float(one.linear_deviation)])
        (drawn,) = _THREE.texts([float(one.sample_deviation)]) if sampled else ["–"]
        rows.append(Row((name, value_text(float(one.nominal)), linear, drawn, of)))
    if "limit" in result.dims:
        shares = result.sample_yield if "sample_yield" in result else result.linear_yield
        for text, share in zip(result.limit.values.tolist(), shares.values.tolist(), strict=True):
            rows.append(Row((text, "", "", "", f"yield {100 * share:.1f} %")))
    return ("output", "nominal", "σ, linear", "σ, drawn", "most by"), tuple(rows)
