"""Tables of the localization: ellipse models, causes of the distortion of x0, positions.

The tables of causes are made from the dataset that `coilarray.paper.distortion.distortion` returns.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from coilarray.compute.display_units import PERCENT, DisplayUnit
from coilarray.compute.table import Column, Table, Value, cell, dataset_table, root_mean_square
from coilarray.localize.inverse import Location
from coilarray.paper.ellipse_model import EllipseModel
from coilarray.paper.published import published_model, undetermined_levels
from coilarray.response.interpolation import PARAMETERS

_PARAMETERS = ("A", "B", "x0")
_POWERS = ("p4", "p3", "p2", "p1", "p0")
_COMPARED = np.linspace(1e-4, 1e-3, 37)  # δ, in the range where the paper's polynomials were fitted
_STATUS = {
    "found": "located", "border": "on the border", "outside": "outside", "no fit": "no position fits",
    "nothing pressed": "nothing pressed",
}  # fmt: skip


def polynomial_table(model: EllipseModel, *, compare: bool = True) -> Table:
    """Return a table of an ellipse model's coefficients in m.

    A row for each coil and parameter has the coefficients of δ⁴ … δ⁰. The row of Table A1 is below it, but not for
    another board, whose coils have only the names in common with the paper's.
    """
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
    """Return a table of the fits of all coils.

    A row for each coil has steps, range of δ, misfit of ellipses and polynomials, and distance to Table A1. Misfits are
    root mean squares in m, over the points of all ellipses, and of each polynomial over the steps. For comparison they
    are also of each polynomial minus the polynomial of Table A1 over δ = 1e-4 … 1e-3 as far as the model reaches, empty
    for a coil that is not in Table A1. Undetermined steps, and levels that the window of either board does not
    determine, are left out.
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
    """Return a table of the causes' effects on x0.

    A row for each cause has the root mean square over δ of the loss in x0 without it, for every coil. The standard
    deviation of the posterior is added if `coilarray.paper.distortion.distortion` was given draws.
    """
    columns = {}
    for state in distortion.state.values.tolist():
        of = distortion.sel(state=state, drop=True)
        columns[f"{state}_rms"] = of.rms.assign_attrs(long_name=f"{state}, rms")
        if "rms_std" in of:
            columns[f"{state}_rms_std"] = of.rms_std.assign_attrs(long_name="±")
    return dataset_table("causes", "Causes", xr.Dataset(columns), ("cause", *columns))


def indenter_table(distortion: xr.Dataset) -> Table:
    """Return a table of the effect of indenter materials.

    A row for each material of the indenter and coil has the changes in x0, A, B and the peak. They are means over the
    levels of δ that both maps determine, empty without such a level. There is no row if the design's indenter is not a
    ball, or has a material of its own.
    """
    columns = (
        Column("indenter", "indenter of"),
        Column("coil"),
        Column("x0", "x0 moves by", "m"),
        Column("A", "A grows by", "m"),
        Column("B", "B grows by", "m"),
        Column("peak", "largest δ grows by", "1", PERCENT),
    )
    rows: list[tuple[Value, ...]] = []
    compared = (
        distortion.indenter.values.tolist()[1:] if "indenter" in distortion.dims else []
    )  # earlier versions: none
    for indenter in compared:
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
    """Return a table of predicted and published motion of x0.

    A row for each coil has the motion of x0 in Table A1 and in the prediction, and the residual. Levels that the window
    of one of the two does not determine are counted and left out. Numbers are empty if there is nothing to compare.
    """
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
    """Return a table of x0, A, B and every effect.

    A row for each coil and δ has predicted and published values.
    """
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
    """Return a location as a mapping for JSON.

    Values are in SI units. A refused reading has only ``error``. Other readings have ``status``, ``reason`` if there is
    one, ``chi_square``, ``degrees_of_freedom`` and ``probability``. If there is a position, they have ``x_m``, ``y_m``,
    ``depth_m`` and their ``sigma_…_m`` of the best of ``modes``, which has the same keys for each. A standard deviation
    that the reading does not determine is null. ``unread`` has the states that the converter cannot read there, if
    there are any. `parameters` are the parameters of the model. With a target the third is ``distance``.
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
    """Return a table of the positions of all readings.

    There is one row for each reading, counted from 1, and each position that explains it, from `location_record`.
    Lengths in m are empty if a reading does not determine them. Columns that are empty in every row are left out.
    """
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
