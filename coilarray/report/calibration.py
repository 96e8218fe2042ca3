"""Tables and page of a calibration from `coilarray.studies.calibrate.calibrate`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import xarray as xr

from coilarray import viz
from coilarray.compute.display_units import DisplayUnit
from coilarray.compute.files import write_text
from coilarray.compute.table import Details, Picture, Section, Table, Warn, dataset_table
from coilarray.report.figures import draw
from coilarray.report.page import html_page, now, provenance_section

_PLAIN = DisplayUnit(significant=True)
_FOUR = DisplayUnit(digits=4)
_MOST_ALTERNATIVES = 20  # rows of the posterior's picture
_LEAST_DOUBT = 1e-3  # probability of a larger χ² by chance, below which the data are not explained
_ESTIMATED = "estimated"


def ranking_table(result: xr.Dataset) -> Table:
    """Return all combinations of choices, the most probable first."""
    evidence = (result.log_evidence - result.log_evidence[0]).assign_attrs(long_name="ln evidence − best", units="1")
    names: tuple[str, ...] = (
        "combination",
        "probability",
        "log_evidence",
        "chi_square",
        "degrees_of_freedom",
        "noise_scale",
    )
    names += ("determined", "converged", "evaluations", "problem")
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


def calibration_pictures(result: xr.Dataset) -> list[Picture]:
    """Draw data, model, residuals and posterior."""
    pictures = [draw("model", "Measured and fitted, and the residuals.", viz.calibration_figure(result))]
    drawn = viz.posterior_figure(result)
    caption = "Posterior of the unknowns between their bounds: draws, and the most probable point as a cross."
    pictures.append(draw("posterior", caption, drawn))
    if result.sizes["combination"] > 1:
        shown = min(result.sizes["combination"], _MOST_ALTERNATIVES)
        caption = f"Evidence of the {shown} most probable combinations, relative to the best."
        pictures.append(draw("ranking", caption, viz.plot_evidence(result.isel(combination=slice(shown)))))
    return pictures


def write_calibration_page(result: xr.Dataset, path: Path, data: str) -> None:
    """Write a calibration to `data` as a self-contained HTML page."""
    tables, pictures = {table.name: table for table in calibration_tables(result)}, calibration_pictures(result)
    several = result.sizes["combination"] > 1
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
