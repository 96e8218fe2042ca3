"""Summary of a design: extremes of decisive quantities, broken limits."""

import math
from collections.abc import Iterator, Sequence

import numpy as np
import shapely
import xarray as xr

from coilarray.circuit.converter_limits import readable_of, reading_lines
from coilarray.circuit.coupling import scan_design
from coilarray.compute.arrays import FloatArray
from coilarray.compute.display_units import KILOHM, MM, PER_MILLION, PERCENT, display_unit, true_minus
from coilarray.compute.table import Column, Table, Value, cell
from coilarray.design.model import Design
from coilarray.errors import CoilarrayError, LocalizeError
from coilarray.geometry import Array, Margin
from coilarray.geometry.rules import KEPT_WITHIN, broken_rules
from coilarray.localize.forward import forward_model
from coilarray.localize.identifiability import identifiability
from coilarray.studies.create.new_design import broken_limits

CHECKED_WITHOUT = "Limits of the converter were checked without"
_MOST_READ = 64  # coils, which take a few seconds
_ALIKE = 1e-9  # of a number, smaller differences are rounding
_PPM, _PERCENT = "ppm", "percent"  # units of dimensionless numbers as shown
_SHOWN = {_PPM: PER_MILLION, _PERCENT: PERCENT, "ohm": KILOHM}
_PARTS = {0.5: ("half", "half"), 0.95: ("most", "95 %")}  # of the area of the coils, with σ up to a value
_OF_STATES = (
    ("frequency", "f with the tank"), ("part_frequency", ""), ("effective_inductance", "L_eff"),
    ("quality_factor", "Q of the coil"), ("loaded_quality_factor", "Q of the resonator"),
    ("parallel_resistance", "R_p of the resonator"),
    ("state_self_resonance", "self-resonance"),
)  # fmt: skip


def summary_table(
    coupling: xr.Dataset,
    scan: xr.Dataset | None,
    margins: Sequence[Margin],
    response: xr.Dataset | None,
    without: xr.Dataset | None = None,
    target: xr.Dataset | None = None,
    bounds: xr.Dataset | None = None,
    links: xr.Dataset | None = None,
) -> Table:
    """Return the least and largest values of the decisive quantities.

    Programs find a row by its `key`, which does not change with the words. `without` is the scan
    without plates, and `links` are the solved ports. Of `bounds` it has the least σ of x and y over
    the coils, the values that half and 95 % of their area do not exceed, and the share where they
    are not determined.
    """
    found = [*_rows(coupling, scan, margins, response), *_link_rows(links), *_position_rows(bounds)]
    found += _metal_rows(scan, without, target)
    spread = any(most != "" for _, _, _, most, *_ in found)
    least = Column("least", "" if spread else "value", "1")
    columns = (Column("key"), Column("quantity"), least, Column("most", unit="1"), Column("unit"), Column("where"))
    units = tuple(_SHOWN.get(str(unit)) or display_unit(str(unit)) for *_, unit, _ in found)
    rows = tuple((*values, "1" if unit in (_PPM, _PERCENT) else unit, where) for *values, unit, where in found)
    main = tuple(column.name for column in columns[1:])
    return Table("summary", "Summary", columns, rows, units, main=main)


def verdicts(scan: xr.Dataset | None, margins: Sequence[Margin], *maps: xr.Dataset | None) -> list[str]:
    """Return broken limits with their worst cases, also of `maps`."""
    lines = broken_rules(margins)
    broken = [] if scan is None else broken_limits(scan)
    for name in dict.fromkeys(limit.name for _, limit in broken):
        state, limit = next(one for one in broken if one[1].name == name)
        lines.append(f"The converter cannot read {state}: {limit.words}.")
    if scan is not None and "readable" in scan and (left_out := scan.attrs.get("left_out")):
        lines.append(f"{CHECKED_WITHOUT} the {left_out.rstrip('.')}.")
    # a map of the flat board alone, over its states, is covered by the scan
    return [*lines, *(line for one in maps if one is not None and "y" in one.delta.dims for line in reading_lines(one))]


def unread_words(design: Design) -> str:
    """Describe why no LDC1614 can read the board, if so."""
    if not design.readout.is_judged or len(design.coil_names) > _MOST_READ:
        return ""
    try:
        scan = scan_design(design, elastomer=False, accuracy="screen")
        return " ".join(verdicts(scan.assign_attrs(left_out=""), ()))
    except CoilarrayError:  # a board without a resonance, for example
        return ""


def _rows(
    coupling: xr.Dataset, scan: xr.Dataset | None, margins: Sequence[Margin], response: xr.Dataset | None
) -> Iterator[tuple[Value, ...]]:
    names = coupling.coil.values.tolist()
    own = coupling.open_inductance
    yield _row("open_inductance", "L, the others open" if len(names) > 1 else "L", names, own.values, "H")
    for name, words in _OF_STATES:
        if scan is None or name not in scan or not np.isfinite(scan[name]).any():
            continue
        values, unit = scan[name], str(scan[name].attrs["units"])
        part = str(values.attrs["long_name"]).removeprefix("with capacitances of ")
        *row, where = _row(name, words or f"f with {part}", values.state.values.tolist(), values.values, unit)
        yield *row, where if words else f"{where}; capacitances of the part, unverified"
    if len(names) > 1:
        k = np.abs(coupling.coupling.values - np.eye(len(names)))
        i, j = (int(n) for n in np.unravel_index(int(k.argmax()), k.shape))
        yield ("largest_coupling", "largest |k|", "", float(k.max()), "1", f"{names[i]} and {names[j]}")
    if (worst := tightest(margins)) is not None:
        where = f"{worst.rule} of {worst.feature}{f' on {worst.layer}' if '/' in worst.layer else ''}"
        if abs(worst.margin) <= KEPT_WITHIN:
            where += f", which is exactly at its limit of {MM.text(worst.limit, '.4')}"
        yield ("tightest_rule", "tightest fabrication rule", worst.margin, "", "m", where)
    if response is not None:
        yield _peak_row(response.delta.where(readable_of(response)).isel(depth=-1))


def _link_rows(links: xr.Dataset | None) -> Iterator[tuple[Value, ...]]:
    if links is not None and "efficiency" in links:
        at = links.efficiency.sel(frequency=links.attrs["link_frequency_Hz"]).transpose("source", "load")
        names = [f"{source} to {load}" for source in at["source"].values for load in at["load"].values]
        yield _row("link_efficiency", "link efficiency", names, at.values.ravel(), _PERCENT)


def tightest(margins: Sequence[Margin]) -> Margin | None:
    """Return the least margin of traces, gaps and holes, if any."""
    return next((one for one in margins if one.unit and one.feature != "board"), None)  # they are sorted


def _peak_row(delta: xr.DataArray) -> tuple[Value, ...]:
    peaks, names = delta.max(("x", "y")), delta.state.values.tolist()
    at = delta.fillna(-np.inf).argmax(("x", "y"))
    ends = [(at[axis] == 0) | (at[axis] == delta.sizes[axis] - 1) for axis in ("x", "y") if delta.sizes[axis] > 1]
    beyond = np.any([end.values for end in ends], axis=0) if ends else np.zeros(len(names), dtype=bool)
    beyond &= np.isfinite(peaks.values)
    if beyond.all():
        beyond[:] = False
    within = np.flatnonzero(~beyond)
    words = f"peak δ, {MM.text(delta.depth)} deep"
    *row, where = _row("peak_delta", words, [names[n] for n in within], peaks.values[within], _PPM)
    outside = [name for name, out in zip(names, beyond.tolist(), strict=True) if out]
    left_out = f"without {', '.join(outside)}, which peak beyond the map" if outside else ""
    return *row, "; ".join(filter(None, (str(where), left_out)))


def position_bounds(response: xr.Dataset, array: Array) -> xr.Dataset | None:
    """Return the Cramér–Rao bounds over the deepest map, if any.

    ``over_coils`` (y, x) marks places over a coil. The position is not determined if σ is above
    ``coil_size``, the size of the largest coil in m.
    """
    try:
        bounds = identifiability(forward_model(response), float(response.depth[-1]))
    except LocalizeError:
        return None
    x, y = np.meshgrid(bounds.x, bounds.y)
    outlines = [shapely.Polygon(place.to_board(place.coil.outline)) for place in array.placements]
    over = shapely.intersects_xy(shapely.union_all(outlines), x, y)
    size = max(float(np.ptp(place.coil.outline, axis=0).max()) for place in array.placements)
    bounds = bounds.assign_coords(over_coils=(("y", "x"), over)).assign_attrs(coil_size=size)
    return bounds if np.isfinite(bounds.sigma_x).any() else None


def _position_rows(bounds: xr.Dataset | None) -> Iterator[tuple[Value, ...]]:
    if bounds is None:
        return
    size = float(bounds.attrs["coil_size"])
    scatter, drift = (max(bounds.attrs[name]) for name in ("noise", "common_noise"))
    together = f", common drift {PER_MILLION.text(drift, '.2')}" if drift else ""
    for axis in ("x", "y"):
        sigma = bounds[f"sigma_{axis}"]
        values, sigma = np.sort(sigma.values[bounds.over_coils.values]), sigma.where(bounds.over_coils)
        known = values < size
        if known.any():
            noise = f"at {_place(sigma, float(values[0]))}; noise of δ {PER_MILLION.text(scatter, '.2')}{together}"
            yield f"sigma_{axis}_best", f"σ of {axis}, best place", float(values[0]), "", "m", noise
        for share, (key, words) in _PARTS.items():
            if (most := part_of(values, share)) < size:
                where = "not exceeded over this part of their area"
                yield f"sigma_{axis}_{key}", f"σ of {axis}, {words} of coils", most, "", "m", where
        if not known.all():
            place = _place(sigma, float(values[-1]))
            where = f"of the coils' area: σ is above the {MM.text(size, '.4')} of a coil, as at {place}"
            share_unknown = float(1 - known.mean())
            yield f"{axis}_not_determined", f"{axis} not determined", share_unknown, "", _PERCENT, where


def part_of(values: FloatArray, share: float) -> float:
    """Return the least of sorted values that this share does not exceed."""
    return float(values[math.ceil(share * len(values)) - 1])  # no mean of two, as one may be infinite


def _place(sigma: xr.DataArray, value: float) -> str:
    place = sigma.where(sigma == value).stack(place=("y", "x")).dropna("place")[0]
    return true_minus(f"x {float(place.x) * 1e3:.4g}, y {float(place.y) * 1e3:.4g} mm")


def _metal_rows(
    scan: xr.Dataset | None, without: xr.Dataset | None, target: xr.Dataset | None
) -> Iterator[tuple[Value, ...]]:
    if scan is not None and without is not None:
        change = scan.effective_inductance.values / without.effective_inductance.values - 1
        yield _row("change_by_plates", "L_eff by the plates", scan.state.values.tolist(), change, _PPM)
    if target is None:
        return
    states = target.state.values.tolist()
    read = target.delta.where(readable_of(target))
    nearest = read.isel(distance=0).transpose("state", "y", "x").values.reshape(len(states), -1)
    largest = nearest[np.arange(len(states)), np.nan_to_num(np.abs(nearest), nan=-1.0).argmax(axis=1)]
    yield _row("target_delta", f"δ of target at {MM.text(target.distance[0])}", states, largest, _PPM)
    ranges = target["range"].values
    if np.isfinite(ranges).any():
        at_least = ", at least" if target.range_is_least.values.any() else ""
        yield _row("target_range", f"range of target{at_least}", states, ranges, "m")


def _row(key: str, words: str, names: Sequence[str], values: FloatArray, unit: str) -> tuple[Value, ...]:
    # a self-resonance that is not found, and R_p without losses, are infinite
    finite = np.flatnonzero(np.isfinite(values))
    if not len(finite):
        return key, words, "", "", unit, ""
    least, most = int(finite[values[finite].argmin()]), int(finite[values[finite].argmax()])
    low, high = cell(values[least]), cell(values[most])
    alike = values[most] - values[least] <= _ALIKE * abs(values[most])
    if alike:
        return key, words, low, "", unit, "" if len(finite) == len(values) else names[least]
    return key, words, low, high, unit, f"{names[least]}; {names[most]}"
