"""A comparison of a measured with a simulated response as tables and as a page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path

import jinja2
import numpy as np
import numpy.typing as npt
import xarray as xr

from coilarray.compute.files import write_text
from coilarray.localize.level_curves import PARAMETERS
from coilarray.report import figures
from coilarray.report.localize_tables import number
from coilarray.report.tables import Column, Table, Value

FloatArray = npt.NDArray[np.float64]


def scale_table(comparison: xr.Dataset) -> Table:
    """One row for each depth and state: scale and shift of the simulated map onto the measured one.

    Parameters
    ----------
    comparison : xarray.Dataset
        As `coilarray.localize.comparison.compare_responses` returns it.

    Returns
    -------
    Table
        In m; standard deviations beside; empty where the map does not tell.
    """
    columns = (
        *_WHERE,
        Column("scale", "scale", 1, 4),
        Column("scale_std", "±", 1, 4),
        Column("shift_x_m", "shift x (mm)", 1e3, 3),
        Column("shift_x_std_m", "±", 1e3, 3),
        Column("shift_y_m", "shift y (mm)", 1e3, 3),
        Column("shift_y_std_m", "±", 1e3, 3),
        Column("at_limit", "beyond the reach"),
        Column("points", "positions", 1, 0),
    )
    rows = []
    for depth, state, at in _each(comparison):
        shifts = [number(at[name].sel(axis=axis)) for axis in ("x", "y") for name in ("shift", "shift_std")]
        scale = number(at.scale), number(at.scale_std)
        rows.append((depth, state, *scale, *shifts, bool(at.at_limit), float(at.points)))
    return Table("scales", "Scale and shift", columns, tuple(rows))


def remains_table(comparison: xr.Dataset) -> Table:
    """One row for each depth and state: root mean square of what remains and correlation, before and after.

    Parameters
    ----------
    comparison : xarray.Dataset
        As in `scale_table`.

    Returns
    -------
    Table
        δ as pure numbers.
    """
    columns = (
        *_WHERE,
        Column("noise", "noise (10⁻⁶)", 1e6, 2),
        Column("rms_before", "rms before (10⁻⁶)", 1e6, 2),
        Column("rms_before_std", "±", 1e6, 2),
        Column("rms_after", "rms after (10⁻⁶)", 1e6, 2),
        Column("rms_after_std", "±", 1e6, 2),
        Column("correlation_before", "correlation before", 1, 5),
        Column("correlation_before_std", "±", 1, 5),
        Column("correlation_after", "after", 1, 5),
        Column("correlation_after_std", "±", 1, 5),
    )
    names = [column.key for column in columns[2:]]
    rows = tuple((depth, state, *(number(at[name]) for name in names)) for depth, state, at in _each(comparison))
    return Table("remains", "What remains", columns, rows)


def ellipse_table(comparison: xr.Dataset) -> Table:
    """One row for each depth, state and parameter of the ellipses: measured less simulated over the levels of both.

    Parameters
    ----------
    comparison : xarray.Dataset
        As in `scale_table`.

    Returns
    -------
    Table
        In m: mean and root mean square of the difference, and of its standard deviation; empty where one has no
        ellipses, with the reason.
    """
    columns = (
        *_WHERE,
        Column("parameter", "parameter"),
        Column("levels", "levels of both", 1, 0),
        Column("mean_difference_m", "measured − simulated, mean (mm)", 1e3, 3),
        Column("rms_difference_m", "rms (mm)", 1e3, 3),
        Column("rms_noise_m", "of it by noise, rms (mm)", 1e3, 3),
        Column("problem", "why not"),
    )
    rows: list[tuple[Value, ...]] = []
    for depth, state, at in _each(comparison):
        problems = _problems(at)
        for name in PARAMETERS if not problems else PARAMETERS[:1]:
            apart = (at[name].sel(source="measured") - at[name].sel(source="simulated")).values
            both = np.isfinite(apart)
            spread = np.sqrt(np.nansum(at[f"{name}_std"].values ** 2, axis=0))
            known = spread[both & (spread > 0)]
            figures_of = (_mean(apart[both]), _rms(apart[both]), _rms(known))
            rows.append((depth, state, "" if problems else name, float(both.sum()), *figures_of, "; ".join(problems)))
    return Table("ellipses", "Ellipses", columns, tuple(rows))


def curve_table(comparison: xr.Dataset) -> Table:
    """One row for each depth, state and level of δ: x0, A and B of both, with their standard deviations.

    Parameters
    ----------
    comparison : xarray.Dataset
        As in `scale_table`.

    Returns
    -------
    Table
        In m; levels that neither has are left out.
    """
    series = [(source, name) for name in PARAMETERS for source in comparison.source.values.tolist()]
    columns: list[Column] = [*_WHERE, Column("delta", "δ (10⁻⁶)", 1e6, 0)]
    for source, name in series:
        columns += [
            Column(f"{name}_{source}_m", f"{name} {source} (mm)", 1e3, 3),
            Column(f"{name}_{source}_std_m", "±", 1e3, 3),
        ]
    rows: list[tuple[Value, ...]] = []
    for depth, state, at in _each(comparison):
        for k, level in enumerate(at.level.values.tolist()):
            values = [
                number(at[f"{name}{end}"].sel(source=source)[k]) for source, name in series for end in ("", "_std")
            ]
            if any(value != "" for value in values):
                rows.append((depth, state, level, *values))
    return Table("curves", "x0, A and B over δ", tuple(columns), tuple(rows))


def inductance_table(comparison: xr.Dataset) -> Table | None:
    """One row a state: L_0 of both; None where one does not tell it.

    Parameters
    ----------
    comparison : xarray.Dataset
        As in `scale_table`.

    Returns
    -------
    Table or None
        In H, and their ratio.
    """
    if "base_inductance" not in comparison:
        return None
    columns = (
        Column("state", "state"),
        Column("measured_H", "L_0 measured (µH)", 1e6, 4),
        Column("simulated_H", "simulated (µH)", 1e6, 4),
        Column("ratio", "measured/simulated", 1, 5),
    )
    rows: list[tuple[Value, ...]] = []
    for k, state in enumerate(comparison.state.values.tolist()):
        first, second = comparison.base_inductance.values[:, k].tolist()
        rows.append((str(state), number(first), number(second), number(first / second if second else np.nan)))
    return Table("inductances", "Inductances without an indentation", columns, tuple(rows))


def comparison_tables(comparison: xr.Dataset) -> list[Table]:
    """Every table of a comparison, the long one of all levels last."""
    inductances = inductance_table(comparison)
    return [
        scale_table(comparison),
        remains_table(comparison),
        ellipse_table(comparison),
        *([] if inductances is None else [inductances]),
        curve_table(comparison),
    ]


def comparison_notes(comparison: xr.Dataset) -> list[str]:
    """Sentences about what was not compared and what the figures do not tell.

    Parameters
    ----------
    comparison : xarray.Dataset
        As in `scale_table`.

    Returns
    -------
    list of str
        Empty where there is nothing to say.
    """
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
        notes.append("The measured response tells no noise: ± comes from the scatter of what remains.")
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
    """Write a comparison as an HTML page that needs no other file.

    Parameters
    ----------
    comparison : xarray.Dataset
        As in `scale_table`.
    path : Path
        Of the page; its folder must exist.
    names : tuple of str
        What was measured and what was simulated, for people.
    outlines : sequence of ndarray, each of shape (m, 2)
        Corners of the coils in m from the map's origin.

    Raises
    ------
    OutputError
        It cannot be written; an earlier page is left as it was.
    """
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("coilarray.report", "."),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    page = environment.get_template("comparison.html.j2").render(
        names=names,
        tables={table.name: table for table in comparison_tables(comparison)},
        notes=comparison_notes(comparison),
        pictures=figures.comparison_pictures(comparison, outlines),
        emulated=[bool(comparison.attrs.get(f"{side}_emulated", 0)) for side in ("measured", "simulated")],
        made=_provenance(comparison.attrs),
    )
    write_text(path, page)


# by the attribute ``capacitance_from`` of a measured response
_OF_INDUCTANCES = {
    "design": "The tank capacitances were calibrated with the simulated inductances: that measured and simulated L_0 "
    "agree is no test of either.",
    "known inductances": "The tank capacitances were calibrated with known inductances.",
    "None": "The tank capacitances of the measured L_0 were not calibrated; they are those of the recording.",
}

_WHERE = (Column("depth_m", "depth (mm)", 1e3, 3), Column("state", "state"))


def _each(comparison: xr.Dataset) -> list[tuple[float, str, xr.Dataset]]:
    """Depth, state and the part of the comparison that is theirs."""
    return [
        (depth, str(state), comparison.isel(depth=k, state=j))
        for k, depth in enumerate(comparison.depth.values.tolist())
        for j, state in enumerate(comparison.state.values.tolist())
    ]


def _problems(at: xr.Dataset) -> list[str]:
    """Why the maps have no ellipses, said once where it is the same."""
    texts = dict(zip(at.source.values.tolist(), map(str, at.ellipse_problem.values), strict=True))
    if len(set(texts.values())) == 1:
        return [text for text in set(texts.values()) if text]
    return [f"{source}: {text}" for source, text in texts.items() if text]


def _provenance(attrs: Mapping[str, object]) -> dict[str, str]:
    kept = ("source", "design", "design_hash", "coilarray_version", "recording")
    made = {
        f"{who}, {key.replace('_', ' ')}": str(attrs[f"{who}_{key}"])
        for who in ("measured", "simulated")
        for key in kept
        if f"{who}_{key}" in attrs
    }
    made["compared with coilarray"] = metadata.version("coilarray")
    made["date"] = datetime.now(UTC).isoformat(timespec="seconds")
    return made


def _mean(values: FloatArray) -> Value:
    return number(values.mean()) if len(values) else ""


def _rms(values: FloatArray) -> Value:
    return number(np.sqrt(np.mean(values**2))) if len(values) else ""
