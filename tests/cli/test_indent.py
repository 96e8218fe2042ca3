"""The command ``indent``: its table is that of the library, and every mistake is one line."""

import csv
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from support.command_line import mistakes, runner, successes

from coilarray import load_design
from coilarray.design.bundled import read
from coilarray.elastomer.contact import indent

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("own_folder")]

run, refused = runner("indent")
good, answer = successes("indent")


LINEAR = ("--strain", "linear")  # quick, where the test is not about the strain


def library(**options):
    """What the library says of the starter at the depths of its file."""
    design = load_design("starter")
    return indent(design.sheets, design.indentation.indenter, design.indentation.depths, base="bonded", **options)


@pytest.fixture(scope="module")
def linear():
    return library(strain="linear")


def test_the_table_is_that_of_the_library(capsys):
    expected = library()
    data = answer(capsys, "starter")
    assert data["design_hash"] == load_design("starter").digest
    assert (data["indenter"], data["base"]) == ("hemisphere", "bonded")
    rows = data["dents"]
    np.testing.assert_allclose([row["depth_m"] for row in rows], [0.3e-3, 0.6e-3], rtol=1e-12)
    # the same computation once more
    np.testing.assert_allclose([row["force_N"] for row in rows], expected.force, rtol=1e-9)
    np.testing.assert_allclose([row["contact_radius_m"] for row in rows], expected.contact_radius, rtol=1e-9)
    for sheet in ("base", "magnetic"):
        on_axis = expected.displacement_z.sel(interface=sheet).isel(r=0)
        np.testing.assert_allclose([row[f"{sheet}_displacement_m"] for row in rows], on_axis, rtol=1e-9)
    # the tip has gone as deep as it should: to the mean gap of the innermost hat of pressure
    np.testing.assert_allclose([row["magnetic_displacement_m"] for row in rows], [-0.3e-3, -0.6e-3], rtol=1e-3)
    assert all(-row["magnetic_displacement_m"] > -row["base_displacement_m"] > 0 for row in rows)
    # the ring is the highest point outside of the contact
    top = expected.displacement_z.isel(interface=-1)
    for k, row in enumerate(rows):
        highest = int(top.isel(depth=k).values.argmax())
        # a parabola through nodes lies a little above them, and its vertex between their neighbours
        assert 1.0 <= row["ring_height_m"] / float(top[k, highest]) < 1.02
        assert float(top.r[highest - 1]) < row["ring_radius_m"] < float(top.r[highest + 1])
        assert row["ring_radius_m"] > row["contact_radius_m"]


def test_values_that_nobody_gave_are_named(capsys):
    out = good(capsys, "gast2020", *LINEAR)
    assert "hemisphere, base seat of 5.3 kPa/mm" in out
    for key in ("elastomer.0.youngs_modulus_kPa = 55: ", "elastomer.1.youngs_modulus_kPa = 152: ", "indentation.base"):
        assert f"assumed: {key}" in out
    assert "origin" not in out  # where the dent is made does not change it
    assert "relative_permeability" not in out
    not_given = answer(capsys, "gast_fem", *LINEAR)["not_given"]
    assert {"indenter.radius_mm", "indentation.depths_mm", "indentation.base"} <= {row["key"] for row in not_given}
    assert next(row["value"] for row in not_given if row["key"] == "indentation.depths_mm") == [0.5, 1.0, 1.5]
    chosen = answer(capsys, "gast_fem", "--depth-mm", "1", "--base", "bonded", *LINEAR)["not_given"]
    assert not {"indentation.depths_mm", "indentation.base"} & {row["key"] for row in chosen}


def test_a_default_is_named_too(capsys):
    Path("d.toml").write_text(read("starter").replace("poissons_ratio = 0.4999", "#", 1), encoding="utf-8")
    assert "default: elastomer.0.poissons_ratio = 0.4999\n" in run(capsys, "d.toml", "--depth-mm", "0.3", *LINEAR)[1]


def test_a_slipping_base_is_softer(capsys, linear):
    data = answer(capsys, "starter", "--base", "frictionless", "--depth-mm", "0.3:0.6:2", *LINEAR)
    assert data["base"] == "frictionless"
    np.testing.assert_allclose([row["depth_m"] for row in data["dents"]], [0.3e-3, 0.6e-3], rtol=1e-12)
    assert all(row["force_N"] < force for row, force in zip(data["dents"], linear.force.values, strict=True))


def test_files(capsys, linear):
    out = good(capsys, "starter", *LINEAR, "--out", "dent.nc", "--plot", "dent.svg")
    assert out.endswith("wrote dent.nc\nwrote dent.svg\n")
    with xr.open_dataset("dent.nc", engine="h5netcdf") as saved:
        np.testing.assert_allclose(saved.displacement_z, linear.displacement_z, rtol=1e-9, atol=1e-15)
        assert saved.attrs["design_hash"] == load_design("starter").digest
        assert saved.force.attrs["units"] == "N"
    assert Path("dent.svg").read_text(encoding="utf-8").startswith("<?xml")
    good(capsys, "starter", *LINEAR, "--out", "dent.csv", "--plot", "dent.png", "--depth-mm", "0.3")
    (row,) = csv.DictReader(Path("dent.csv").read_text(encoding="utf-8").splitlines())
    # the mesh is made for the depths asked for; its error is about 0.1 %
    assert float(row["force_N"]) == pytest.approx(float(linear.force[0]), rel=2e-3)
    assert Path("dent.png").read_bytes()[:4] == b"\x89PNG"


def test_a_cylinder_has_force_a_metre(capsys):
    Path("d.toml").write_text(read("starter").replace('"hemisphere"', '"cylinder_edge"', 1), encoding="utf-8")
    out = good(capsys, "d.toml", *LINEAR, "--depth-mm", "0.3", "--out", "d.csv")
    assert "force on the indenter (N/m)" in out
    assert "half width of the contact (mm)" in out
    assert Path("d.csv").read_text(encoding="utf-8").startswith("depth_m,force_N_per_m,")


test_mistakes_are_one_line_and_leave_nothing = mistakes(
    runner("indent", "starter")[1],
    (("--depth-mm", "0"), "--depth-mm must be above zero; got '0'"),
    (("--depth-mm", "-1"), "--depth-mm must be above zero; got '-1'"),
    (("--depth-mm", "1,0.5"), "--depth-mm must be rising numbers of mm, such as 0.5,1 or START:STOP:COUNT"),
    (("--depth-mm", "40"), "thickness of all sheets"),
    (("--base", "glued"), "'glued' is not one of 'bonded', 'frictionless'"),
    (("--base", ""), "'' is not one of 'bonded', 'frictionless'"),
)


def test_a_design_without_an_indenter(capsys):
    text = read("starter")
    bare = text[: text.index("# What presses")] + text[text.index("[circuit]") :]
    Path("d.toml").write_text(bare, encoding="utf-8")
    assert "the design starter has no [indenter] and [indentation]" in refused(capsys, "d.toml")


def test_a_sample_with_sides_counts_as_wide_and_a_line_says_so(capsys):
    sides = "sample_x_mm = [-30, 30]\nsample_y_mm = [-30, 30]\n"
    Path("sides.toml").write_text(
        read("starter").replace("[indentation]\n", "[indentation]\n" + sides), encoding="utf-8"
    )
    assert "The sample counts as wide here" in good(capsys, "sides.toml", *LINEAR)
    wide = answer(capsys, "starter", *LINEAR)["dents"]
    assert answer(capsys, "sides.toml", *LINEAR)["dents"] == wide
