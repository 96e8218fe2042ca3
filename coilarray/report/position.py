"""Positions of a map by the paper's ellipse model."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import xarray as xr

from coilarray.compute.display_units import PERCENT, PPM, DisplayUnit, span
from coilarray.compute.table import Column, Table, Value, cell, dataset_table, root_mean_square, text_table
from coilarray.errors import LocalizeError
from coilarray.localize.inverse import Location
from coilarray.paper.ellipse import Ellipse, fit_ellipses
from coilarray.paper.ellipse_model import (
    SEMIAXIS_ADDITION,
    EllipseModel,
    EllipsePosition,
    ellipse_model,
    locate_x,
    published_model,
    published_rows,
    undetermined_levels,
)
from coilarray.response.dataset import axis_label, in_ellipse_window, origin_of
from coilarray.response.interpolation import PARAMETERS

Place = tuple[float, float]
"""Real x and y in m, from the map's origin."""
_LEVEL = 5e-4  # of δ, in the middle of the published polynomials
_PARAMETERS = ("A", "B", "x0")
_POWERS = ("p4", "p3", "p2", "p1", "p0")
_COMPARED = np.linspace(1e-4, 1e-3, 37)  # δ, in the range where the paper's polynomials were fitted
_STATUS = {
    "found": "located", "border": "on the border", "outside": "outside", "no fit": "no position fits",
    "nothing pressed": "nothing pressed",
}  # fmt: skip


@dataclass(frozen=True, eq=False)
class MapPositions:
    """Positions from a map's ellipse model for its own readings.

    `readings` are δ of every coil over the grid. `found` are places with a position, with A longer
    by `SEMIAXIS_ADDITION` as in the paper. `origin` is in m on the board, and `axis` names it.
    """

    fits: xr.Dataset
    model: EllipseModel
    depth: float
    readings: Mapping[Place, Mapping[str, float]]
    found: Mapping[Place, EllipsePosition]
    origin: tuple[float, float] = (0.0, 0.0)
    axis: str = "x (mm)"

    @property
    def error(self) -> xr.DataArray:
        """Determined minus real x in m (y, x), or NaN."""
        x, y = (sorted({place[k] for place in self.readings}) for k in (0, 1))
        values = np.full((len(y), len(x)), np.nan)
        for (at_x, at_y), position in self.found.items():
            values[y.index(at_y), x.index(at_x)] = position.x - at_x
        on_board = {"y": np.array(y) + self.origin[1], "x": np.array(x) + self.origin[0]}
        return xr.DataArray(values, on_board, ("y", "x"))

    def largest_error(self) -> float:
        """Largest |determined − real x| in m."""
        return max(abs(position.x - x) for (x, _), position in self.found.items())

    def example(self) -> Place:
        """Return the off-axis place with the best known ellipses."""

        def rank(place: Place) -> tuple[bool, bool, float]:
            position = self.found[place]
            lesser = min(self.readings[place][coil] for coil in position.coils)
            return position.case == "two points", abs(place[1]) > 1e-9, lesser

        return max(self.found, key=rank)

    def ellipses(self, place: Place) -> dict[str, Ellipse]:
        """Return the two intersecting ellipses of a place by coil."""
        model = self.model.with_semiaxis_addition(SEMIAXIS_ADDITION)
        return {coil: model[coil].ellipse(self.readings[place][coil]) for coil in self.found[place].coils}


def map_positions(response: xr.Dataset) -> MapPositions:
    """Fit the ellipse model to the deepest map, and locate."""
    response = in_ellipse_window(response)
    if response.sizes["state"] < 2:
        raise LocalizeError(f"a position needs two coils; the map has only {response.state.values[0]}.")
    fits = fit_ellipses(response, float(response.depth[-1]))
    model = ellipse_model(fits)
    if len(model.coils) < 2:
        raise LocalizeError(f"a position needs closed curves of two coils; the map has only those of {model.names[0]}.")
    delta = response.delta.isel(depth=-1).transpose("y", "x", "state")
    states = delta.state.values.tolist()
    readings = {
        (x, y): dict(zip(states, delta.values[j, i].tolist(), strict=True))
        for j, y in enumerate(delta.y.values.tolist())
        for i, x in enumerate(delta.x.values.tolist())
    }
    widened = model.with_semiaxis_addition(SEMIAXIS_ADDITION)
    found = {}
    for place, reading in readings.items():
        try:
            found[place] = locate_x(widened, reading)
        except LocalizeError:  # the model has no position for it, and the picture leaves the place grey
            continue
    if not found:
        raise LocalizeError("the ellipses meet at none of the map's places.")
    return MapPositions(
        fits, model, float(delta.depth), readings, found, origin_of(response), axis_label(response, "x")
    )


def paper_table(frequency: xr.DataArray | None, positions: MapPositions | None) -> Table:
    """Return published numbers of the paper's sensor beside those of the design.

    `frequency` in Hz is that of each state. The ellipses are compared at one level of δ.
    """
    said, rows = {row["quantity"]: row["value"] for row in published_rows("text")}, list[tuple[str, ...]]()
    if frequency is not None:
        rows.append(("resonance (MHz)", said["resonance in MHz"], span(frequency.values, DisplayUnit("", 1e-6), 3)))
    if positions is not None:
        printed = np.abs([float(row["error_mm"]) for row in published_rows("table_2")])
        errors = 1e3 * np.abs([found.x - x for (x, _), found in positions.found.items()])
        places = (f"{np.sqrt(np.mean(of**2)):.2f}, at {len(of)} places" for of in (printed, errors))
        rows.append(("error of x, root mean square (mm)", *places))
        for theirs in published_model().coils:
            ours = next((one for one in positions.model.coils if one.name == theirs.name), None)
            if ours is not None and ours.covers(_LEVEL) and theirs.covers(_LEVEL):
                curves = zip(("x0", "A", "B"), theirs.curves(_LEVEL), ours.curves(_LEVEL), strict=True)
                for name, *both in sorted(curves):
                    numbers = (f"{1e3 * float(value):.1f}" for value in both)
                    rows.append((f"{name} of {theirs.name} at δ = {PPM.text(_LEVEL)} (mm)", *numbers))
    table = text_table(("quantity", "published", "this design"), rows, "Beside the paper")
    return replace(table, name="paper")


def map_position_table(positions: MapPositions) -> Table:
    """Return real and determined x by place, and used coils."""
    columns = (
        *(Column(name, unit="m") for name in ("x", "y", "determined_x", "error")),
        Column("case"),
        Column("coils"),
    )
    rows: list[tuple[Value, ...]] = []
    from_x, from_y = positions.origin
    for x, y in positions.readings:
        position = positions.found.get((x, y))
        found: tuple[Value, ...] = ("", "", "", "")
        if position is not None:
            found = (position.x + from_x, position.x - x, position.case, " and ".join(position.coils))
        rows.append((x + from_x, y + from_y, *found))
    return Table("map_positions", "Positions of the map", columns, tuple(rows))


def polynomial_table(model: EllipseModel, *, compare: bool = True) -> Table:
    """Return coefficients of δ⁴ … δ⁰ in m, beside Table A1 if `compare`."""
    four = DisplayUnit("mm", 1e3, significant=True)
    columns = (*map(Column, ("coil", "parameter", "source")), *(Column(power, "", "m", four) for power in _POWERS))
    published = {coil.name: coil for coil in published_model().coils} if compare else {}
    rows: list[tuple[Value, ...]] = []
    for coil in model.coils:
        for key in _PARAMETERS:
            rows.append((coil.name, key, "this map", *getattr(coil, key)))
            if coil.name in published:
                rows.append((coil.name, key, "Table A1", *getattr(published[coil.name], key)))
    return Table("polynomials", "Polynomials", columns, tuple(rows))


def fit_table(fits: xr.Dataset, model: EllipseModel, *, compare: bool = True) -> Table:
    """Return steps, range of δ and misfits by coil.

    Misfits are root mean squares in m over the points of all ellipses, and of each polynomial over
    the steps. If `compare`, they are also of each polynomial minus Table A1 over δ = 1e-4 … 1e-3.
    """
    whole = DisplayUnit("10⁻⁶", 1e6, 0)
    columns = (
        Column("coil"),
        Column("steps", unit="1"),
        Column("refused", unit="1"),
        Column("undetermined", unit="1"),
        Column("lowest_delta", "δ from", "1", whole),
        Column("highest_delta", "δ to", "1", whole),
        Column("ellipse_rms", "ellipses, rms", "m"),
        *(Column(f"{key}_rms", f"{key}(δ), rms", "m") for key in _PARAMETERS),
        *(Column(f"{key}_less_published_rms", f"{key} − Table A1, rms", "m") for key in _PARAMETERS if compare),
    )
    published = {coil.name: coil for coil in published_model().coils} if compare else {}
    rows: list[tuple[Value, ...]] = []
    for coil in model.coils:
        of = fits.sel(state=coil.name)
        fitted = of.isel(step=np.flatnonzero(of.refused.values == "")).sortby("delta")
        kept = fitted.isel(step=np.flatnonzero(~fitted.undetermined.values))
        delta = kept.delta.values
        below = [text for text in of.refused.values.tolist() if text and text != "above the largest δ"]
        off = [root_mean_square(kept[key].values - np.polyval(getattr(coil, key), delta)) for key in _PARAMETERS]
        at = _COMPARED[(_COMPARED >= coil.lowest) & (_COMPARED <= coil.highest)]
        apart: list[Value] = ["", "", ""] if compare else []
        if coil.name in published:
            other = published[coil.name]
            hidden = np.interp(at, fitted.delta, fitted.undetermined) > 0
            at = at[~(hidden | undetermined_levels(other, at))]
            both = ((np.polyval(getattr(one, key), at) for one in (coil, other)) for key in _PARAMETERS)
            apart = [root_mean_square(mine - theirs) for mine, theirs in both]
        counts = (fitted.sizes["step"], len(below), fitted.sizes["step"] - kept.sizes["step"])
        misfit = root_mean_square(kept.rms.values)
        rows.append((coil.name, *counts, coil.lowest, coil.highest, misfit, *off, *apart))
    return Table("fits", "Ellipses", columns, tuple(rows))


def cause_table(distortion: xr.Dataset) -> Table:
    """Return rms losses in x0 without each cause, by coil."""
    columns = {}
    for state in distortion.state.values.tolist():
        of = distortion.sel(state=state, drop=True)
        columns[f"{state}_rms"] = of.rms.assign_attrs(long_name=f"{state}, rms")
        if "rms_std" in of:
            columns[f"{state}_rms_std"] = of.rms_std.assign_attrs(long_name="±")
    return dataset_table("causes", "Causes", xr.Dataset(columns), ("cause", *columns))


def indenter_table(distortion: xr.Dataset) -> Table:
    """Return changes of x0, A, B, peak by indenter material."""
    columns = (
        Column("indenter", "indenter of"),
        Column("coil"),
        Column("x0", "x0 moves by", "m"),
        Column("A", "A grows by", "m"),
        Column("B", "B grows by", "m"),
        Column("peak", "largest δ grows by", "1", PERCENT),
    )
    rows: list[tuple[Value, ...]] = []
    for indenter in distortion.indenter.values.tolist()[1:]:
        for state in distortion.state.values.tolist():
            of = distortion.sel(state=state)
            changed = [
                (of[f"indenter_{name}"].sel(indenter=indenter) - of[f"indenter_{name}"].sel(indenter="without")).values
                for name in ("x0", "A", "B")
            ]
            means = [cell(one[np.isfinite(one)].mean()) if np.isfinite(one).any() else "" for one in changed]
            peak = of.indenter_peak.sel(indenter=indenter) / of.indenter_peak.sel(indenter="without") - 1
            rows.append((indenter, state, *means, cell(float(peak))))
    return Table("indenters", "Indenters of metal or ferrite", columns, tuple(rows))


def residual_table(distortion: xr.Dataset) -> Table:
    """Return rms motions of x0 and residuals, without undetermined levels."""
    columns = (
        Column("coil"),
        Column("published_rms", "published x0 − centre, rms", "m"),
        Column("predicted_rms", "predicted x0 − centre, rms", "m"),
        Column("residual_rms", "predicted − published x0, rms", "m"),
        Column("residual_mean", "mean", "m"),
        Column("compared", "levels of δ", "1"),
        Column("undetermined", "undetermined, left out", "1"),
    )
    grounded = distortion.sel(neighbours="grounded")
    rows: list[tuple[Value, ...]] = []
    for state in distortion.state.values.tolist():
        of = grounded.sel(state=state)
        published = of.published_x0.where(~of.published_undetermined).values - float(of.centre)
        predicted = of.x0.where(~of.undetermined).values - float(of.centre)
        both = np.isfinite(predicted) & np.isfinite(published)
        apart = (predicted - published)[both]
        moved = (published[both], predicted[np.isfinite(predicted)], apart)
        mean = cell(apart.mean()) if len(apart) else ""
        hidden = np.isfinite(of.x0.values) & np.isfinite(of.published_x0.values) & ~both
        rows.append((state, *map(root_mean_square, moved), mean, int(both.sum()), int(hidden.sum())))
    return Table("residuals", "What remains", columns, tuple(rows))


def distortion_table(distortion: xr.Dataset) -> Table:
    """Return x0, A, B and every effect, predicted and published."""
    series = {"centre": distortion.centre}
    for key in ("x0", "A", "B"):
        for neighbours in distortion.neighbours.values.tolist():
            series[f"{key}_{neighbours}"] = distortion[key].sel(neighbours=neighbours, drop=True)
            if f"{key}_std" in distortion:
                series[f"{key}_{neighbours}_std"] = distortion[f"{key}_std"].sel(neighbours=neighbours, drop=True)
        series[f"{key}_published"] = distortion[f"published_{key}"]
    for neighbours in distortion.neighbours.values.tolist():
        series[f"undetermined_{neighbours}"] = distortion.undetermined.sel(neighbours=neighbours, drop=True)
    series["undetermined_published"] = distortion.published_undetermined
    for cause in distortion.cause.values.tolist():
        series[f"effect_{cause.replace(' ', '_')}"] = distortion.effect.sel(cause=cause, drop=True)
    named = {key: array.assign_attrs(long_name=key.replace("_", " ")) for key, array in series.items()}
    table = xr.Dataset(named).rename(state="coil")
    shown = {"delta": DisplayUnit("10⁻⁶", 1e6, 0)}
    return dataset_table("distortion", "x0, A and B over δ", table, ("coil", "delta", *named), shown)


def location_record(location: Location, parameters: Sequence[str] = PARAMETERS) -> dict[str, object]:
    """Return a location for JSON, in SI units.

    A refused reading has only ``error``. Others have the best mode beside all ``modes``, with
    numbers that are null if the reading does not determine them, and the ``unread`` states.
    """
    if location.verdict == "refused":
        return {"error": location.reason}
    unnoticed = location.verdict == "nothing pressed" and tuple(parameters) != PARAMETERS
    record: dict[str, object] = {"status": "no target" if unnoticed else _STATUS[location.verdict]}
    if location.reason:
        record["reason"] = location.reason
    modes = []
    for mode in location.modes:
        place = zip(parameters, (mode.x, mode.y, mode.depth), strict=True)
        one: dict[str, object] = {f"{name}_m": value for name, value in place}
        sigma = zip(parameters, mode.known_deviations, strict=False)
        one |= {f"sigma_{name}_m": value for name, value in sigma}
        one |= {"chi_square": mode.chi_square, "gaussian": mode.gaussian, "border": list(mode.border)}
        one |= {"unread": list(mode.unread)} if mode.unread else {}
        modes.append(one)
    if modes:
        record |= {key: value for key, value in modes[0].items() if key.endswith("_m")}
    record |= {
        "chi_square": location.chi_square,
        "degrees_of_freedom": location.degrees_of_freedom,
        "probability": location.probability,
        "modes": modes,
    }
    return record


def position_table(records: Sequence[Mapping[str, Any]]) -> Table:
    """Return every numbered position that explains a reading."""
    columns = (
        Column("reading", unit="1"),
        Column("status"),
        *(Column(name, unit="m") for name in (*PARAMETERS, "distance")),
        *(Column(f"sigma_{name}", f"± {name}", "m") for name in PARAMETERS),
        Column("sigma_distance", "± distance", "m", DisplayUnit("µm", 1e6, 3, significant=True)),
        Column("chi_square", "χ²", "1", DisplayUnit(digits=2)),
        Column("unread", "not readable there"),
    )
    rows: list[tuple[Value, ...]] = []
    for k, record in enumerate(records):
        status = "error" if "error" in record else str(record["status"])
        for mode in record.get("modes") or [{"chi_square": record.get("chi_square")}]:
            values = ("" if mode.get(column.key) is None else float(mode[column.key]) for column in columns[2:-1])
            rows.append((k + 1, status, *values, ", ".join(mode.get("unread", ()))))
    return Table("positions", "Positions", columns, tuple(rows)).without_empty_columns()
