"""Pages and tables of a calibration, and of a comparison with a simulated response."""

from collections.abc import Sequence
from dataclasses import replace
from importlib import metadata
from pathlib import Path

import numpy as np
import xarray as xr

from coilarray import viz
from coilarray.compute.arrays import FloatArray
from coilarray.compute.display_units import PER_MILLION, DisplayUnit
from coilarray.compute.files import write_text
from coilarray.compute.table import Details, Section, Table, Warn, dataset_table
from coilarray.paper.ellipse import PARAMETERS
from coilarray.report.page import draw, html_page, now, provenance_section

_PLAIN = DisplayUnit(significant=True)
_FOUR = DisplayUnit(digits=4)
_MOST_ALTERNATIVES = 20  # rows of the posterior's picture
_LEAST_DOUBT = 1e-3  # probability of a larger χ² by chance, below which the data are not explained
_ESTIMATED = "estimated"
_OF_INDUCTANCES = {  # by the attribute ``capacitance_from`` of a measured response
    "design": "The tank capacitances were calibrated with the simulated inductances: that measured and simulated L_0 "
    "agree is no test of either.",
    "known inductances": "The tank capacitances were calibrated with known inductances.",
    "None": "The tank capacitances of the measured L_0 were not calibrated; they are those of the recording.",
}

_WHERE = ("depth", "state")


def ranking_table(result: xr.Dataset) -> Table:
    """Return all combinations of choices, the most probable first."""
    evidence = (result.log_evidence - result.log_evidence[0]).assign_attrs(long_name="ln evidence − best", units="1")
    names = ["combination", "probability", "log_evidence", "chi_square", "degrees_of_freedom", "noise_scale"]
    names += ["determined", "converged", "evaluations", "problem"]
    shown = dict.fromkeys(("log_evidence", "chi_square", "degrees_of_freedom"), DisplayUnit(digits=2))
    shown |= {"probability": _FOUR, "noise_scale": DisplayUnit(digits=3), "determined": DisplayUnit(digits=0)}
    shown |= {"evaluations": DisplayUnit(digits=0)}
    table = dataset_table("ranking", "Combinations", result.assign(log_evidence=evidence), names, shown)
    return table.without_empty_columns()


def unknown_table(result: xr.Dataset, combination: int = 0) -> Table:
    """Return a combination's unknowns with errors and 95 % intervals."""
    numbers = ("start", "value", "std", "low", "high")
    of = _own(result, combination)
    names = ("unknown", "unit", *numbers, "at_bound")
    return dataset_table("unknowns", "Unknowns", of, names, dict.fromkeys(numbers, _PLAIN))


def correlation_table(result: xr.Dataset, combination: int = 0) -> Table:
    """Return the correlations between the unknowns of a combination."""
    of = _own(result, combination)
    columns = {
        f"correlation_{name}": of.correlation.sel(other=name, drop=True).assign_attrs(long_name=name)
        for name in of.unknown.values.tolist()
    }
    shown = dict.fromkeys(columns, DisplayUnit(digits=2))
    return dataset_table("correlation", "Correlations", xr.Dataset(columns), ("unknown", *columns), shown)


def misfit_table(result: xr.Dataset, combination: int = 0) -> Table:
    """Return the rms residuals of each state before and after.

    They are in SI and relative to the measured numbers. Rows that are not fitted are predictions.
    The last row of ellipses is for their ends x0 ± A on y = 0, as far as the window shows them.
    """
    of = result.isel(combination=combination)
    of = of.isel(datum=np.flatnonzero(np.isfinite(of.measured) & np.isfinite(of.model)))
    keys = list(dict.fromkeys(zip(of.state.values.tolist(), of.quantity.values.tolist(), strict=True)))
    rows = []
    for state, quantity in keys:
        part = of.isel(datum=np.flatnonzero((of.state == state) & (of.quantity == quantity)))
        size = float(np.sqrt((part.measured**2).mean()))
        remains = [float(np.sqrt(((part[name] - part.measured) ** 2).mean())) for name in ("before", "model")]
        rows.append((*remains, remains[1] / size if size else np.nan, part.sizes["datum"], (part.weight > 0).any()))
    if result.attrs["kind"] == "ellipses":
        keys.append(("all", "x0 ± A"))
        rows.append(_ends(of, result.attrs["window_x_m"]))
    before, after, share, count, fitted = np.array(rows).T
    data = {
        "quantity": ("row", [quantity for _, quantity in keys]),
        "before": ("row", before, {"long_name": "rms before", "units": "1"}),
        "after": ("row", after, {"long_name": "rms after", "units": "1"}),
        "share": ("row", share, {"long_name": "rms after, relative", "units": "1"}),
        "count": ("row", count.astype(int), {"long_name": "numbers", "units": "1"}),
        "fitted": ("row", fitted.astype(bool), {"long_name": "fitted"}),
    }
    table = xr.Dataset(data, {"state": ("row", [state for state, _ in keys])})
    return dataset_table("misfit", "What remains", table, ("state", *data), {"before": _PLAIN, "after": _PLAIN})


def _ends(of: xr.Dataset, window: Sequence[float]) -> tuple[float, float, float, int, bool]:
    """Row of `misfit_table` for the ellipses' ends."""
    names = ("before", "model", "measured")
    ends = []
    for state in np.unique(of.state.values):
        part = of.isel(datum=np.flatnonzero(of.state == state))
        x0, A = (part.isel(datum=np.flatnonzero(part.quantity == key)).set_index(datum="level") for key in ("x0", "A"))
        x0, A = xr.align(x0[list(names)], A[list(names)])
        ends += [x0 - A, x0 + A]
    both = xr.concat(ends, "datum")
    both = both.isel(datum=np.flatnonzero((both.measured >= window[0]) & (both.measured <= window[1])))
    before, after = (float(np.sqrt(((both[name] - both.measured) ** 2).mean())) for name in names[:2])
    return before, after, after / float(np.sqrt((both.measured**2).mean())), both.sizes["datum"], False


def residual_table(result: xr.Dataset, combination: int = 0) -> Table:
    """Return every number of a combination with its residual."""
    of = result.isel(combination=combination, drop=True)
    where = [name for name in ("quantity", "state", "level", "depth", "y", "x") if name in of.coords]
    names = (*where, "measured", "noise", "weight", "before", "model", "model_std", "residual")
    return dataset_table("data", "Data and model", of, names)


def calibration_tables(result: xr.Dataset) -> list[Table]:
    """Return the tables of the best combination, the longest last."""
    makers = (ranking_table, unknown_table, correlation_table, misfit_table, residual_table)
    return [make(result) for make in makers]


def calibration_notes(result: xr.Dataset) -> list[str]:
    """Return sentences about directions that the data do not determine."""
    best = result.isel(combination=0)
    notes = []
    for name in best.unknown.values[best.at_bound.values].tolist():
        notes.append(f"{name} is at a bound of its range: the data want it beyond.")
    if not bool(best.converged):
        notes.append("The fit ended before it converged; its errors are those of where it stands.")
    undetermined = str(best.undetermined.values).splitlines()
    if undetermined:
        notes.append("The data determine less than the priors: " + "; ".join(undetermined) + ".")
    if result.attrs["noise_is"] == _ESTIMATED:
        scale = f"{float(best.noise_scale):.3g}"
        found = (
            f"The noise of δ is estimated from the residuals, a standard deviation of {scale}, as the data state none."
            if (result.noise == 1).all()  # of a response without noise
            else f"The scale of the noise is estimated from the residuals: {scale} of the standard deviations given."
        )
        notes.append(f"{found} Whether the model fits at all, it cannot say.")
    elif float(best.fit_probability) < _LEAST_DOUBT:
        notes.append(
            f"The model does not explain the data: χ² is {float(best.chi_square):.4g} with "
            f"{float(best.degrees_of_freedom):.4g} degrees of freedom. The errors hold for a model that does."
        )
    failed = int((result.problem != "").sum())
    if failed:
        notes.append(f"{failed} of {result.sizes['combination']} combinations have no fit.")
    return notes


def write_calibration_page(result: xr.Dataset, path: Path, data: str) -> None:
    """Write a calibration to `data` as a self-contained HTML page."""
    tables = {table.name: table for table in calibration_tables(result)}
    several = result.sizes["combination"] > 1
    caption = "Posterior of the unknowns between their bounds: draws, and the most probable point as a cross."
    pictures = [
        draw("model", "Measured and fitted, and the residuals.", viz.calibration_figure(result)),
        draw("posterior", caption, viz.posterior_figure(result)),
    ]
    if several:
        shown = min(result.sizes["combination"], _MOST_ALTERNATIVES)
        caption = f"Evidence of the {shown} most probable combinations, relative to the best."
        pictures.append(draw("ranking", caption, viz.plot_evidence(result.isel(combination=slice(shown)))))
    best = f"; the most probable combination: **{result.combination.values[0]}**" if several else ""
    sections = [
        Section("Unknowns", (
            "Values in the units of their keys. ± is one standard deviation. The interval holds 95 % of the posterior "
            "between the bounds.",
            replace(tables["unknowns"], mark="yes"),
            Details("Correlations", (tables["correlation"],)),
        )),
        Section("Combinations", (
            "Every combination of choices was fitted. The evidence is the probability of the data under a combination, "
            "over all values of its unknowns between their bounds. The probability shares it out among the "
            "combinations, each as likely as any other beforehand.",
            tables["ranking"],
        )),
        Section("What remains", (
            "Root mean square of fitted less measured numbers, in SI, and relative to the measured ones.",
            tables["misfit"],
            *pictures,
            Details("Data and model", (tables["data"],)),
        )),
    ]  # fmt: skip
    made = {**{key: result.attrs[key] for key in ("design", "design_hash", "coilarray_version")}, "date": now()}
    page = html_page(
        result.attrs["title"] or f"Calibration of {result.attrs['design']}",
        [f"Design **{made['design']}**, fitted to **{data}**{best}.", *map(Warn, calibration_notes(result))],
        [*(one for one in sections if several or one.title != "Combinations"), provenance_section(made)],
    )
    write_text(path, page)


def _own(result: xr.Dataset, combination: int) -> xr.Dataset:
    """Return a combination with the unknowns that it has."""
    of = result.isel(combination=combination, drop=True)
    own = np.flatnonzero(np.isfinite(of["value"].values))
    return of.isel(unknown=own, other=own)


def scale_table(comparison: xr.Dataset) -> Table:
    """Return the simulated map's scale and shift onto the measured."""
    shifts = {}
    for axis in ("x", "y"):
        for end in ("", "_std"):
            shift = comparison[f"shift{end}"].sel(axis=axis, drop=True)
            shifts[f"shift_{axis}{end}"] = shift.assign_attrs(long_name=f"{shift.attrs['long_name']} {axis}")
    names = (*_WHERE, "scale", "scale_std", *shifts, "at_limit", "points")
    shown = dict.fromkeys(("scale", "scale_std"), DisplayUnit(digits=4))
    return dataset_table("scales", "Scale and shift", comparison.assign(shifts), names, shown)


def remains_table(comparison: xr.Dataset) -> Table:
    """Return rms residuals and correlations before and after the fit."""
    errors = ("noise", "rms_before", "rms_before_std", "rms_after", "rms_after_std")
    correlations = ("correlation_before", "correlation_before_std", "correlation_after", "correlation_after_std")
    five = DisplayUnit(digits=5)
    shown = dict.fromkeys(errors, PER_MILLION) | dict.fromkeys(correlations, five)
    return dataset_table("remains", "What remains", comparison, (*_WHERE, *errors, *correlations), shown)


def ellipse_table(comparison: xr.Dataset) -> Table:
    """Return measured minus simulated x0, A and B.

    Levels that one of the maps does not determine are counted and left out. A state without
    ellipses has one row, with the reason.
    """
    values, noise = (
        comparison[[name + end for name in PARAMETERS]].to_dataarray("parameter").assign_coords(parameter=[*PARAMETERS])
        for end in ("", "_std")
    )
    apart = values.sel(source="measured", drop=True) - values.sel(source="simulated", drop=True)
    hidden = comparison.undetermined.any("source")
    levels = apart.notnull() & ~hidden
    spread = (noise**2).sum("source") ** 0.5
    counts = {
        "levels": (levels, "levels of both"),
        "undetermined": (apart.notnull() & hidden, "undetermined, left out"),
    }
    lengths = {
        "mean_difference": (apart.where(levels).mean("level"), "measured − simulated, mean"),
        "rms_difference": ((apart.where(levels) ** 2).mean("level") ** 0.5, "rms"),
        "rms_noise": ((spread.where(levels & (spread > 0)) ** 2).mean("level") ** 0.5, "rms of the noise in it"),
    }
    columns = {name: of.sum("level").assign_attrs(long_name=text, units="1") for name, (of, text) in counts.items()}
    columns |= {name: of.assign_attrs(long_name=text, units="m") for name, (of, text) in lengths.items()}
    problem = xr.apply_ufunc(
        _problem, *(comparison.ellipse_problem.sel(source=one) for one in ("measured", "simulated")), vectorize=True
    )
    columns["problem"] = problem.assign_attrs(long_name="why there is none")
    table = dataset_table("ellipses", "Ellipses", xr.Dataset(columns), (*_WHERE, "parameter", *columns))
    rows = (row if not row[-1] else (*row[:2], "", *row[3:]) for row in table.rows if not row[-1] or row[2] == "x0")
    return replace(table, rows=tuple(rows))


def curve_table(comparison: xr.Dataset) -> Table:
    """Return x0, A and B of both with standard deviations."""
    columns = {}
    for name in PARAMETERS:
        for source in comparison.source.values.tolist():
            for end, text in (("", f"{name} {source}"), ("_std", f"± {name}")):
                of = comparison[name + end].sel(source=source, drop=True)
                columns[f"{name}_{source}{end}"] = of.assign_attrs(long_name=text)
    for source in comparison.source.values.tolist():
        of = comparison.undetermined.sel(source=source, drop=True)
        columns[f"undetermined_{source}"] = of.assign_attrs(long_name=f"undetermined, {source}")
    levels = xr.Dataset(columns).rename(level="delta")
    names = (*_WHERE, "delta", *columns)
    table = dataset_table("curves", "x0, A and B over δ", levels, names, {"delta": PER_MILLION})
    return replace(table, rows=tuple(row for row in table.rows if any(value != "" for value in row[3:-2])))


def inductance_table(comparison: xr.Dataset) -> Table | None:
    """Return L_0 of both responses by state, None without."""
    if "base_inductance" not in comparison:
        return None
    measured, simulated = (comparison.base_inductance.sel(source=one, drop=True) for one in ("measured", "simulated"))
    both = xr.Dataset(
        {
            "measured": measured.assign_attrs(long_name="L_0, measured"),
            "simulated": simulated.assign_attrs(long_name="L_0, simulated"),
            "ratio": (measured / simulated.where(simulated != 0)).assign_attrs(
                long_name="measured/simulated", units="1"
            ),
        }
    )
    title = "Inductances without an indentation"
    shown = {"ratio": DisplayUnit(digits=5)}
    return dataset_table("inductances", title, both, ("state", "measured", "simulated", "ratio"), shown)


def comparison_tables(comparison: xr.Dataset) -> list[Table]:
    """Return every table of a comparison, the long one last."""
    makers = (scale_table, remains_table, ellipse_table, inductance_table, curve_table)
    return [table for table in (make(comparison) for make in makers) if table is not None]


def comparison_notes(comparison: xr.Dataset) -> list[str]:
    """Return what was not compared, and limits of the figures."""
    said = comparison.attrs
    notes = []
    for side in comparison.source.values.tolist():
        if said[f"only_{side}"]:
            notes.append(f"Only {side}, not compared: {said[f'only_{side}']}.")
    designs = [str(said.get(f"{side}_design_hash", "")) for side in ("measured", "simulated")]
    if all(designs) and designs[0] != designs[1]:
        notes.append(
            f"The two are of different designs: measured {said.get('measured_design', '?')} ({designs[0][:12]}), "
            f"simulated {said.get('simulated_design', '?')} ({designs[1][:12]})."
        )
    boards = [said.get(f"measured_{key}") for key in ("calibration_board", "board")]
    if boards[0] is not None and boards[0] != boards[1]:
        notes.append(f"The calibration is of the board “{boards[0]}”, the measurement of “{boards[1]}”.")
    if "measured_reference_coils" in said:
        notes.append(f"δ of both is less that of {said['measured_reference_coils']}.")
    if said["depths_left_out"]:
        depths = ", ".join(f"{float(value) * 1e3:.4g}" for value in said["depths_left_out"].split(", "))
        notes.append(f"Measured at depths that the simulated response does not reach, not compared: {depths} mm.")
    if said["points_left_out"]:
        notes.append(
            f"{said['points_left_out']} readings at positions outside of the simulated map were not compared; nothing "
            "is extrapolated."
        )
    if said["points_missing"]:
        notes.append(f"{said['points_missing']} readings of the grid are not measured yet.")
    if said["noise_from"] == "residuals":
        notes.append("The measured response has no noise figures: ± comes from the scatter of the residuals.")
    if bool(comparison.at_limit.any()):
        notes.append(
            "A best shift is beyond the range that was searched: its figures are those at the end of the range."
        )
    if "base_inductance" in comparison:
        notes.append(_OF_INDUCTANCES[str(said.get("measured_capacitance_from"))])
    return notes


def write_comparison_page(
    comparison: xr.Dataset, path: Path, names: tuple[str, str], outlines: Sequence[FloatArray] = ()
) -> None:
    """Write a comparison as a self-contained HTML page.

    `names` are of the measured and the simulated response. `outlines` are the corners of the coils
    in m from the map's origin, each of shape (m, 2).
    """
    tables, attrs = {table.name: table for table in comparison_tables(comparison)}, comparison.attrs
    made = {
        f"{who}, {key.replace('_', ' ')}": str(attrs[f"{who}_{key}"])
        for who in ("measured", "simulated")
        for key in ("source", "design", "design_hash", "coilarray_version", "recording")
        if f"{who}_{key}" in attrs
    } | {"compared with coilarray": metadata.version("coilarray"), "date": now()}
    deepest = f"{float(comparison.depth[-1]) * 1e3:g} mm deep"
    caption = f"Measured over simulated δ of every position, {deepest}; grey: equality."
    pictures = [draw("readings", caption, viz.plot_readings(comparison, -1))]
    if min(comparison.sizes["x"], comparison.sizes["y"]) > 1:
        caption = (
            f"Measured less simulated δ {deepest}, as simulated and scaled and shifted, grey where nothing was "
            "compared, with the outlines of the coils, and x0 of the ellipses of both, a band of two standard "
            "deviations."
        )
        pictures.insert(0, draw("residuals", caption, viz.comparison_figure(comparison, -1, outlines)))
    whose = [
        name + " (from the emulator: no real board was read)" * bool(comparison.attrs.get(f"{side}_emulated", 0))
        for name, side in zip(names, ("measured", "simulated"), strict=True)
    ]
    sections = [
        Section("Scale and shift", (
            "Scale of δ and shift in x and y that bring the simulated map onto the measured one best, coil by coil: "
            "measured(x, y) ≈ scale · simulated(x − shift x, y − shift y). ± is one standard deviation by the noise of "
            "the readings alone.",
            replace(tables["scales"], mark="yes"),
        )),
        Section("What remains", (
            "Measured less simulated δ, root mean square over the positions, and the correlation of the two maps: as "
            "simulated (before), and scaled and shifted (after). Where the rms after is well above the noise, the maps "
            "differ in more than scale and place.",
            tables["remains"],
            *pictures,
        )),
        Section("Ellipses", (
            "Both maps at the same positions through the same refinement, levels and ellipse fit: centre x0 and "
            "semi-axes A and B of every level of δ, neither scaled nor shifted.",
            tables["ellipses"],
            Details("x0, A and B over δ", (tables["curves"],)),
        )),
    ]  # fmt: skip
    if "inductances" in tables:
        sections.append(Section(tables["inductances"].title, (tables["inductances"],)))
    page = html_page(
        "Measured beside simulated",
        [f"Measured: **{whose[0]}**. Simulated: **{whose[1]}**.", *map(Warn, comparison_notes(comparison))],
        [*sections, provenance_section(made)],
        title=f"{names[0]} beside {names[1]}",
    )
    write_text(path, page)


def _problem(measured: str, simulated: str) -> str:
    if measured == simulated:
        return measured
    return "; ".join(f"{which}: {text}" for which, text in (("measured", measured), ("simulated", simulated)) if text)
