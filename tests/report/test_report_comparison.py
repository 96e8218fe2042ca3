"""Tables and page of a comparison: the numbers of its dataset, in SI in the files, and what was not compared named."""

import csv
import io
import re
from functools import partial

import numpy as np
import pytest
from support.localize_boards import ROW, bells, response

import coilarray.studies.comparison
from coilarray.errors import OutputError
from coilarray.report.measurement import (
    comparison_notes,
    comparison_tables,
    curve_table,
    ellipse_table,
    inductance_table,
    remains_table,
    scale_table,
    write_comparison_page,
)
from coilarray.studies.comparison import compare_responses

pytestmark = pytest.mark.slow

STATES = ["coil1", "coil2"]


def world(scale=1.0, step=2e-3, reach=20e-3, depth=(1e-3,)):
    x, y = (np.arange(-r, r + step / 2, step) for r in (reach, 8e-3))
    return response(lambda points: scale * bells(points, ROW[:2], peak=1.2e-3), STATES, x, y, list(depth))


fine = partial(world, step=1e-3, reach=25e-3)


@pytest.fixture(scope="module", autouse=True)
def four_copies():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(coilarray.studies.comparison, "REPLICATES", 4)
        yield


@pytest.fixture(scope="module")
def comparison():
    delta = world(1.1).delta
    noise = 1e-5 * np.random.default_rng(0).standard_normal(delta.shape)
    measured = world(1.1).assign(
        delta=delta + noise, delta_std=0 * delta + 1e-5, base_inductance=("state", [50e-6, 51e-6])
    )
    simulated = fine().assign(base_inductance=("state", [51e-6, 51e-6]))
    return compare_responses(measured.assign_attrs(emulated=1, source="measured"), simulated)


def test_rows_are_the_datasets_numbers(comparison):
    (first, second) = scale_table(comparison).records()
    assert (first["state"], second["state"]) == ("coil1", "coil2")
    assert (first["depth_m"], first["scale"]) == (1e-3, float(comparison.scale[0, 0]))
    assert first["shift_y_std_m"] == float(comparison.shift_std[0, 0, 1])
    assert (first["points"], first["at_limit"]) == (float(comparison.points[0, 0]), False)
    for row, state in zip(remains_table(comparison).records(), STATES, strict=True):
        for name in ("noise", "rms_before", "rms_after_std", "correlation_after"):
            assert row[name] == float(comparison[name].sel(state=state)[0])
    rows = {(row["state"], row["parameter"]): row for row in ellipse_table(comparison).records()}
    assert len(rows) == 6
    of = comparison.sel(state="coil2").isel(depth=0)
    apart = (of.A[0] - of.A[1])[~of.undetermined.any("source").values]
    row = rows["coil2", "A"]
    assert row["mean_difference_m"] == pytest.approx(float(apart.mean()), rel=1e-12)
    assert row["rms_difference_m"] == pytest.approx(float(np.sqrt((apart**2).mean())), rel=1e-12)
    assert row["levels"] == int(np.isfinite(apart).sum())
    assert row["rms_noise_m"] > 0
    assert inductance_table(comparison).records()[0]["ratio"] == pytest.approx(50 / 51)
    levels = curve_table(comparison).records()
    assert levels[3]["x0_measured_m"] == float(comparison.x0[0, 0, 0, 3])
    assert levels[3]["B_simulated_std_m"] == ""
    assert all(any(row[f"x0_{side}_m"] != "" for side in ("measured", "simulated")) for row in levels)


def test_files_are_in_si_and_the_page_in_millimetres(comparison):
    table = scale_table(comparison)
    (row, _) = csv.DictReader(io.StringIO(table.csv()))
    assert float(row["shift_x_m"]) == float(comparison["shift"][0, 0, 0])
    shown = table.cells()[0]
    assert float(shown[4].replace("−", "-")) == pytest.approx(float(comparison["shift"][0, 0, 0]) * 1e3, abs=5e-4)
    names = [one.name for one in comparison_tables(comparison)]
    assert names == ["scales", "remains", "ellipses", "inductances", "curves"]


def test_what_is_not_determined_is_empty():
    flat = world().assign(delta=0 * world().delta)
    found = compare_responses(flat, fine())
    (row, _) = scale_table(found).records()
    assert (row["scale"], row["shift_x_m"], row["shift_x_std_m"]) == (0.0, "", "")
    (row, _) = ellipse_table(found).records()
    assert row["problem"].startswith("measured: the map has no closed curves")
    assert (row["parameter"], row["mean_difference_m"]) == ("", "")
    both = compare_responses(flat, flat)
    assert ellipse_table(both).records()[0]["problem"].startswith("the map has no closed curves")  # said once
    assert curve_table(both).rows == ()
    assert inductance_table(found) is None
    assert "inductances" not in [one.name for one in comparison_tables(found)]


def test_notes_say_what_was_not_compared(comparison):
    assert comparison_notes(comparison) == [
        "The tank capacitances of the measured L_0 were not calibrated; they are those of the recording."
    ]
    measured = world(depth=[1e-3, 3e-3]).assign_coords(state=["coil1", "b"])
    measured.delta[0, 0, 0, 0] = np.nan
    notes = comparison_notes(compare_responses(measured, world(reach=10e-3)))
    assert notes[0] == "Only measured, not compared: b."
    assert notes[1] == "Only simulated, not compared: coil2."
    assert notes[2] == "Measured at depths that the simulated response does not reach, not compared: 3 mm."
    assert re.match(r"\d+ readings at positions outside of the simulated map were not compared", notes[3])
    assert notes[4] == "1 readings of the grid are not measured yet."
    assert notes[5].startswith("The measured response has no noise figures")
    moved = world().assign_coords(x=world().x + 1e-3)
    for measured, largest, said in ((world(), 0.1e-3, False), (moved, 0.5e-3, True)):
        notes = comparison_notes(compare_responses(measured, fine(), largest_shift=largest))
        assert any("beyond the range that was searched" in note for note in notes) == said
    known = {"design": "is no test of either", "known inductances": "calibrated with known inductances"}
    for said, words in known.items():
        assert words in comparison_notes(comparison.assign_attrs(measured_capacitance_from=said))[-1]


@pytest.mark.usefixtures("pictures_of_nothing")
def test_the_page_needs_no_other_file(comparison, tmp_path):
    outline = np.array([[0.0, 0.0], [5e-3, 0.0], [5e-3, 5e-3]])
    write_comparison_page(comparison, tmp_path / "page.html", ("run <1>", "gast2020"), [outline])
    page = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert "run &lt;1&gt;" in page
    assert "from the emulator: no real board was read" in page
    assert page.count("<svg") == 2
    assert not re.search(r'(src|href)="(?!data:)', page)
    shown = scale_table(comparison).cells()[1]
    assert all(f"<td>{cell}</td>" in page for cell in shown)
    real = comparison.assign_attrs(measured_emulated=0)
    write_comparison_page(real, tmp_path / "page.html", ("run", "gast2020"))
    assert "emulator" not in (tmp_path / "page.html").read_text(encoding="utf-8")
    line = compare_responses(world().sel(y=[0.0], method="nearest"), fine())
    write_comparison_page(line, tmp_path / "page.html", ("run", "gast2020"))
    assert (tmp_path / "page.html").read_text(encoding="utf-8").count("<svg") == 1
    with pytest.raises(OutputError, match="cannot write"):
        write_comparison_page(comparison, tmp_path / "none" / "page.html", ("a", "b"))
