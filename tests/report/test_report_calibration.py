"""Tables and page of a calibration: the numbers of its dataset, and what the data cannot tell said in words."""

import csv
import io

import numpy as np
import pytest
from support.plot_results import calibration

from coilarray.errors import OutputError
from coilarray.paper.ellipse_model import published_model, undetermined_levels
from coilarray.report.measurement import (
    calibration_notes,
    calibration_tables,
    correlation_table,
    misfit_table,
    ranking_table,
    unknown_table,
    write_calibration_page,
)


def test_rows_are_the_datasets_numbers():
    data = calibration("response")
    ranking = ranking_table(data).records()
    assert [row["combination"] for row in ranking] == data.combination.values.tolist() == ["free", "2.5"]
    assert ranking[0]["log_evidence"] == 0.0
    assert ranking[1]["log_evidence"] == float(data.log_evidence[1] - data.log_evidence[0])
    assert sum(row["probability"] for row in ranking) == pytest.approx(1.0)
    (gap, mu) = unknown_table(data).records()
    assert (gap["unknown"], gap["unit"], mu["unit"]) == ("coils.hexagon.gap_mm", "mm", "1")
    assert (mu["value"], mu["std"], mu["at_bound"]) == (float(data["value"][0, 1]), float(data["std"][0, 1]), False)
    assert abs(gap["value"] - 0.1) < 4 * gap["std"]
    assert len(unknown_table(data, 1).records()) == 1  # the other combination has but one unknown
    first = correlation_table(data).records()[0]
    assert first["correlation_elastomer.1.relative_permeability"] == float(data.correlation[0, 0, 1])
    rows = misfit_table(data).records()
    assert [(row["state"], row["quantity"], row["count"]) for row in rows] == [
        ("coil1", "delta", 15), ("coil2", "delta", 15),
    ]  # fmt: skip
    assert rows[0]["after"] < rows[0]["before"]
    lines = list(csv.DictReader(io.StringIO(calibration_tables(data)[-1].csv())))
    assert len(lines) == data.sizes["datum"] == 30
    assert float(lines[7]["model"]) == float(data.model[0, 7])


def test_ends_of_ellipses_are_compared_within_the_window():
    data = calibration()
    rows = {(row["state"], row["quantity"]): row for row in misfit_table(data).records()}
    row = rows["all", "x0 ± A"]
    assert data.attrs["window_x_m"] == [-26e-3, 26e-3]
    levels, off = np.arange(1, 11) * 1e-4, []
    for name in ("coil1", "coil2", "coil3"):
        coil = published_model()[name]
        x0, A, _ = coil.curves(levels)
        known = (levels <= coil.highest) & ~undetermined_levels(coil, levels)
        ends = np.concatenate([x0 - A, x0 + A])
        seen = np.tile(known, 2) & (np.abs(ends) <= 26e-3)
        # the made-up model has x0 as published, and A in proportion to the gap
        off.append(np.tile(A, 2)[seen] * (float(data["start"][0, 0]) / 0.1 - 1))
    assert row["count"] == sum(map(len, off))
    assert row["before"] == pytest.approx(np.sqrt(np.mean(np.concatenate(off) ** 2)), rel=1e-9)
    assert (row["fitted"], rows["coil1", "x0"]["fitted"], rows["coil1", "A"]["fitted"]) == (False, False, True)


def test_notes_say_what_limits_the_figures():
    (scale,) = calibration_notes(calibration())
    assert scale.startswith("The scale of the noise is estimated from the residuals: ")
    data = calibration("response")
    assert calibration_notes(data) == []
    (scale,) = calibration_notes(data.assign(noise=0 * data.noise + 1).assign_attrs(noise_is="estimated"))
    assert scale.startswith("The noise of δ is estimated from the residuals, a standard deviation of ")
    notes = calibration_notes(data.assign(
        at_bound=data["value"] > 1, converged=data.converged & False, fit_probability=0 * data.fit_probability,
        undetermined=("combination", ["a by +1: changes the data by 0.1 of their noise", ""]),
        problem=("combination", ["", "no contact"]),
    ))  # fmt: skip
    for note, text in zip(notes, (
        "elastomer.1.relative_permeability is at a bound", "ended before it converged", "less than the priors: a by",
        "does not explain the data", "1 of 2 combinations have no fit",
    ), strict=True):  # fmt: skip
        assert text in note


@pytest.mark.slow
@pytest.mark.usefixtures("pictures_of_nothing")
@pytest.mark.parametrize("kind", ["ellipses", "response"])
def test_the_page_needs_no_other_file(tmp_path, kind):
    data = calibration(kind)
    write_calibration_page(data, tmp_path / "page.html", "campaign.sqlite")
    page = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert "campaign.sqlite" in page
    assert page.count("<svg") == 3
    assert "http" not in page
    for name in ("coils.hexagon.gap_mm", "free"):
        assert name in page
    with pytest.raises(OutputError):
        write_calibration_page(data, tmp_path / "no" / "page.html", "x")
