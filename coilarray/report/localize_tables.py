"""The numbers of the localization as tables: ellipse models, causes of the distortion of x0, calibration, positions."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import xarray as xr

from coilarray.localize.ellipse_model import EllipseModel
from coilarray.localize.inverse import Location
from coilarray.localize.published import published_model
from coilarray.report.tables import Column, Table, Value

_PARAMETERS = ("A", "B", "x0")
_POWERS = ("p4", "p3", "p2", "p1", "p0")
_COMPARED = np.linspace(1e-4, 1e-3, 37)  # δ, where the paper's polynomials were fitted
_STATUS = {
    "found": "located",
    "border": "on the border",
    "outside": "outside",
    "no fit": "no position fits",
    "nothing pressed": "nothing pressed",
}


class ScientificColumn(Column):
    """A column of numbers that span many powers of ten: `digits` of them are significant."""

    def text(self, value: Value) -> str:
        """Return a value as the page shows it."""
        if isinstance(value, (bool, str)):
            return super().text(value)
        return f"{value * self.scale:.{self.digits}g}".replace("-", "−")


def polynomial_table(model: EllipseModel, *, compare: bool = True) -> Table:
    """One row for each coil and parameter of an ellipse model, and below it the same of Table A1 where it has the coil.

    Parameters
    ----------
    model : EllipseModel
    compare : bool
        False leaves Table A1 out: on another board its coils have the names alone in common.

    Returns
    -------
    Table
        Coefficients of δ⁴ … δ⁰ in m.
    """
    columns = (
        Column("coil", "coil"),
        Column("parameter", "parameter"),
        Column("source", "source"),
        *(ScientificColumn(f"{power}_m", f"{power} (mm)", 1e3, 4) for power in _POWERS),
    )
    published = {coil.name: coil for coil in published_model().coils} if compare else {}
    rows: list[tuple[Value, ...]] = []
    for coil in model.coils:
        for key in _PARAMETERS:
            rows.append((coil.name, key, "this map", *getattr(coil, key)))
            if coil.name in published:
                rows.append((coil.name, key, "Table A1", *getattr(published[coil.name], key)))
    return Table("polynomials", "Polynomials", columns, tuple(rows))


def fit_table(fits: xr.Dataset, model: EllipseModel, *, compare: bool = True) -> Table:
    """One row a coil: steps, range of δ, misfit of the ellipses and of the polynomials, distance to Table A1.

    Parameters
    ----------
    fits : xarray.Dataset
        As `coilarray.localize.ellipse.fit_ellipses` returns it.
    model : EllipseModel
        Of these fits.
    compare : bool
        As in `polynomial_table`; False leaves the columns of the distance out.

    Returns
    -------
    Table
        Misfits in m, root mean square: of the points of all ellipses, of each polynomial over the steps, and of each
        polynomial less that of Table A1 over δ = 1e-4 … 1e-3 as far as the model reaches; empty without that coil.
    """
    columns = (
        Column("coil", "coil"),
        Column("steps", "steps", 1, 0),
        Column("refused", "refused", 1, 0),
        Column("lowest_delta", "δ from (10⁻⁶)", 1e6, 0),
        Column("highest_delta", "to (10⁻⁶)", 1e6, 0),
        Column("ellipse_rms_m", "ellipses, rms (mm)", 1e3, 3),
        *(Column(f"{key}_rms_m", f"{key}(δ), rms (mm)", 1e3, 3) for key in _PARAMETERS),
        *(Column(f"{key}_less_published_rms_m", f"{key} − Table A1 (mm)", 1e3, 2) for key in _PARAMETERS if compare),
    )
    published = {coil.name: coil for coil in published_model().coils} if compare else {}
    rows: list[tuple[Value, ...]] = []
    for coil in model.coils:
        of = fits.sel(state=coil.name)
        kept = of.isel(step=np.flatnonzero(of.refused.values == ""))
        delta = kept.delta.values
        below = [text for text in of.refused.values.tolist() if text and text != "above the largest δ"]
        off = [_rms(kept[key].values - np.polyval(getattr(coil, key), delta)) for key in _PARAMETERS]
        at = _COMPARED[(_COMPARED >= coil.lowest) & (_COMPARED <= coil.highest)]
        apart: list[Value] = ["", "", ""] if compare else []
        if coil.name in published:
            other = published[coil.name]
            apart = [_rms(np.polyval(getattr(coil, k), at) - np.polyval(getattr(other, k), at)) for k in _PARAMETERS]
        steps, refused = float(kept.sizes["step"]), float(len(below))
        rows.append((coil.name, steps, refused, coil.lowest, coil.highest, _rms(kept.rms.values), *off, *apart))
    return Table("fits", "Ellipses", columns, tuple(rows))


def cause_table(distortion: xr.Dataset) -> Table:
    """One row a cause: root mean square over δ of what x0 loses without it, for every coil.

    Parameters
    ----------
    distortion : xarray.Dataset
        As `coilarray.localize.distortion.distortion` returns it.

    Returns
    -------
    Table
        In m; empty where the map has no such level.
    """
    states = distortion.state.values.tolist()
    columns = (
        Column("cause", "cause"),
        *(Column(f"{state}_rms_m", f"{state}, rms (mm)", 1e3, 3) for state in states),
    )
    rows: list[tuple[Value, ...]] = [
        (cause, *(number(value) for value in distortion.rms.sel(cause=cause).values))
        for cause in distortion.cause.values.tolist()
    ]
    return Table("causes", "Causes", columns, tuple(rows))


def residual_table(distortion: xr.Dataset) -> Table:
    """One row a coil: how far x0 moves in Table A1 and in the prediction, and what remains between them.

    Parameters
    ----------
    distortion : xarray.Dataset
        As `coilarray.localize.distortion.distortion` returns it; ``calibrated_x0`` (calibration, state, delta) is
        counted too.

    Returns
    -------
    Table
        Root mean squares over δ in m of published x0 − centre, predicted x0 − centre and predicted − published x0;
        empty where there is nothing to compare.
    """
    columns = (
        Column("coil", "coil"),
        Column("prediction", "prediction"),
        Column("published_rms_m", "published x0 − centre, rms (mm)", 1e3, 3),
        Column("predicted_rms_m", "predicted x0 − centre, rms (mm)", 1e3, 3),
        Column("residual_rms_m", "remains (mm)", 1e3, 3),
        Column("residual_mean_m", "of it, mean (mm)", 1e3, 3),
        Column("compared", "levels of δ", 1, 0),
    )
    predictions = {"as designed": distortion.x0.sel(neighbours="grounded")}
    if "calibrated_x0" in distortion:
        for name in distortion.calibration.values.tolist():
            predictions[f"calibrated, {name}"] = distortion.calibrated_x0.sel(calibration=name)
    rows: list[tuple[Value, ...]] = []
    for state in distortion.state.values.tolist():
        centre = float(distortion.centre.sel(state=state))
        published = distortion.published_x0.sel(state=state).values
        for name, x0 in predictions.items():
            predicted = x0.sel(state=state).values
            both = np.isfinite(predicted) & np.isfinite(published)
            apart = (predicted - published)[both]
            rows.append(
                (
                    state,
                    name,
                    _rms((published - centre)[both]),
                    _rms((predicted - centre)[np.isfinite(predicted)]),
                    _rms(apart),
                    number(apart.mean()) if len(apart) else "",
                    float(both.sum()),
                )
            )
    return Table("residuals", "What remains", columns, tuple(rows))


def distortion_table(distortion: xr.Dataset) -> Table:
    """One row for each coil and δ: x0, A and B as predicted and published, and every effect.

    Parameters
    ----------
    distortion : xarray.Dataset
        As `coilarray.localize.distortion.distortion` returns it.

    Returns
    -------
    Table
        In m; empty where a map has no such level.
    """
    series: list[tuple[str, xr.DataArray]] = [("centre_m", distortion.centre.broadcast_like(distortion.published_x0))]
    for key in ("x0", "A", "B"):
        for neighbours in distortion.neighbours.values.tolist():
            series.append((f"{key}_{neighbours}_m", distortion[key].sel(neighbours=neighbours)))
        series.append((f"{key}_published_m", distortion[f"published_{key}"]))
    if "calibrated_x0" in distortion:
        for name in distortion.calibration.values.tolist():
            series.append((f"x0_calibrated_{name}_m", distortion.calibrated_x0.sel(calibration=name)))
    for cause in distortion.cause.values.tolist():
        series.append((f"effect_{cause.replace(' ', '_')}_m", distortion.effect.sel(cause=cause)))
    columns = (
        Column("coil", "coil"),
        Column("delta", "δ (10⁻⁶)", 1e6, 0),
        *(Column(key, key, 1e3, 3) for key, _ in series),
    )
    values = np.stack([array.transpose("state", "delta").values for _, array in series], axis=-1)
    rows: list[tuple[Value, ...]] = [
        (state, delta, *(number(value) for value in values[i, j]))
        for i, state in enumerate(distortion.state.values.tolist())
        for j, delta in enumerate(distortion.delta.values.tolist())
    ]
    return Table("distortion", "x0, A and B over δ", columns, tuple(rows))


def calibration_table(results: Mapping[str, xr.Dataset]) -> Table:
    """One row for each calibration and unknown.

    Parameters
    ----------
    results : mapping of str to xarray.Dataset
        `coilarray.localize.calibration.Calibration.result` by the name of the base.

    Returns
    -------
    Table
        First guess, value and its 95 % interval in SI, and whether the value is at a bound of its range, where the
        interval means little.
    """
    columns = (
        Column("base", "base"),
        Column("unknown", "unknown"),
        Column("unit", "unit"),
        *(
            ScientificColumn(key, header, 1, 4)
            for key, header in (("start", "guess"), ("value", "value"), ("low", "95 % from"), ("high", "to"))
        ),
        Column("at_bound", "at a bound"),
    )
    rows: list[tuple[Value, ...]] = []
    for base, result in results.items():
        for k, name in enumerate(result.unknown.values.tolist()):
            values = (number(result[key][k]) for key in ("start", "value", "low", "high"))
            rows.append((base, name, str(result.unit.values[k]), *values, bool(result.at_bound[k])))
    return Table("calibration", "Calibration to A, B and the peaks", columns, tuple(rows))


def correlation_table(base: str, result: xr.Dataset) -> Table:
    """One row an unknown: its correlations with the others."""
    names = result.unknown.values.tolist()
    columns = (
        Column("unknown", f"correlation, {base}"),
        *(Column(f"correlation_{name}", name, 1, 2) for name in names),
    )
    rows: list[tuple[Value, ...]] = [
        (name, *(number(value) for value in result.correlation.sel(unknown=name).values)) for name in names
    ]
    return Table(f"correlation_{base}", "Correlation", columns, tuple(rows))


def misfit_table(results: Mapping[str, xr.Dataset]) -> Table:
    """One row a calibration: root mean square of the residuals in units of their trust, before and after."""
    columns = (
        Column("base", "base"),
        Column("misfit_before", "misfit before (in its trust)", 1, 2),
        Column("misfit_after", "after", 1, 2),
    )
    rows: list[tuple[Value, ...]] = [
        (base, number(result.misfit_before), number(result.misfit_after)) for base, result in results.items()
    ]
    return Table("misfit", "Misfit of A, B and the peaks", columns, tuple(rows))


def location_record(location: Location) -> dict[str, object]:
    """Return what a reading says as a mapping for JSON, in SI units.

    Parameters
    ----------
    location : Location
        As `coilarray.localize.inverse.locate` returns it.

    Returns
    -------
    dict
        ``error`` alone for a refused reading. Else ``status``, ``reason`` where there is one, ``chi_square``,
        ``degrees_of_freedom``, ``probability``, and where there is a position ``x_m``, ``y_m``, ``depth_m`` and their
        ``sigma_…_m`` of the best of ``modes``, which has the same keys for each; a standard deviation that the reading
        does not tell is null.
    """
    if location.verdict == "refused":
        return {"error": location.reason}
    record: dict[str, object] = {"status": _STATUS[location.verdict]}
    if location.reason:
        record["reason"] = location.reason
    modes = []
    for mode in location.modes:
        one: dict[str, object] = {"x_m": mode.x, "y_m": mode.y, "depth_m": mode.depth}
        sigma = zip(("x", "y", "depth"), mode.known_deviations, strict=False)
        one |= {f"sigma_{name}_m": value for name, value in sigma}
        one |= {"chi_square": mode.chi_square, "gaussian": mode.gaussian, "border": list(mode.border)}
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
    """One row for each reading and position that explains it.

    Parameters
    ----------
    records : sequence of mappings
        Of `location_record`, or with ``status`` and ``modes`` of ``x_m`` and ``y_m``.

    Returns
    -------
    Table
        In m; empty where a reading does not tell, and without the columns that are empty. Readings count from 1.
    """
    columns = (
        Column("reading", "reading", 1, 0),
        Column("status", "status"),
        Column("x_m", "x (mm)", 1e3, 3),
        Column("y_m", "y (mm)", 1e3, 3),
        Column("depth_m", "depth (mm)", 1e3, 3),
        Column("sigma_x_m", "± x (mm)", 1e3, 3),
        Column("sigma_y_m", "± y (mm)", 1e3, 3),
        Column("sigma_depth_m", "± depth (mm)", 1e3, 3),
        Column("chi_square", "χ²", 1, 2),
    )
    rows: list[tuple[Value, ...]] = []
    for k, record in enumerate(records):
        status = "error" if "error" in record else str(record["status"])
        for mode in record.get("modes") or [{"chi_square": record.get("chi_square")}]:
            values = ("" if mode.get(column.key) is None else float(mode[column.key]) for column in columns[2:])
            rows.append((float(k + 1), status, *values))
    told = [k for k in range(len(columns)) if any(row[k] != "" for row in rows)]
    kept = tuple(tuple(row[k] for k in told) for row in rows)
    return Table("positions", "Positions", tuple(columns[k] for k in told), kept)


def number(value: object) -> Value:
    """Return a number of a table; what is not finite is left empty."""
    as_float = float(np.asarray(value))
    return as_float if math.isfinite(as_float) else ""


def _rms(values: npt.NDArray[np.float64]) -> Value:
    """Root mean square; empty of nothing."""
    return number(np.sqrt(np.mean(values**2))) if len(values) else ""
