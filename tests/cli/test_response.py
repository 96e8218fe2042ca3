"""The command ``response``: the numbers of the library, one line for every mistake, and maps that go on."""

import csv
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from support.command_line import mistakes, runner, successes
from support.contacts import IDEAL as CIRCUIT

import coilarray.response.changes
from coilarray import load_design, parse_design
from coilarray.design.bundled import read
from coilarray.elastomer.contact import indent
from coilarray.errors import ElastomerError
from coilarray.response.map import Imperfections, response_map

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("own_folder", "own_store")]

run, refused = runner("response")
good, answer = successes("response")

X = [0.0, 5e-3]
GRID = ("--x-mm", "0,5", "--y-mm", "0", "--depth-mm", "0.3")
SMALL = ("linear.toml", *GRID)
IDEAL = (*SMALL, "--ideal")  # strays of their own for every thickness and seed take seconds, and show nothing more here


LINEAR = read("starter").replace('strain = "finite"', 'strain = "linear"')  # quick


@pytest.fixture(autouse=True)
def _linear(own_folder):
    Path("linear.toml").write_text(LINEAR, encoding="utf-8")


@pytest.fixture(scope="module")
def starter():
    return parse_design(LINEAR)


def library(design, **changes):
    return response_map(design, **{"depths": [0.3e-3], "x": X, "y": [0.0], **changes})


@pytest.fixture(scope="module")
def expected(starter):
    """What the library says of two positions over the starter."""
    return library(starter)


@pytest.fixture(scope="module")
def ideal(starter):
    """δ (position, state) that the library says without strays."""
    return library(starter, imperfections=CIRCUIT).delta.values[0, 0]


def written():
    """Names of what is in the folder but for the store of computed results."""
    return sorted(path.name for path in Path().iterdir() if path.name not in ("cache", "linear.toml"))


def delta_of(path):
    """δ (position, state) of a map of a single depth and row in a CSV file."""
    rows = list(csv.DictReader(Path(path).read_text(encoding="utf-8").splitlines()))
    assert list(rows[0]) == ["depth_m", "y_m", "x_m", "state", "delta"]
    return np.array([float(row["delta"]) for row in rows]).reshape(-1, 3)


def test_positions_are_those_on_the_board(capsys, monkeypatch):
    """Those of the options and of the table; the file counts from the map's origin, and says where that is."""
    asked = []

    def told(design, **choices):
        asked.append((choices["x"], choices["y"]))
        raise ElastomerError("enough.")

    monkeypatch.setattr("coilarray.response.map.response_map", told)
    x, y = (1e3 * v for v in load_design("gast2020").indentation.origin_point)
    refused(capsys, "gast2020", "--x-mm", f"{x:.6g},{x + 5:.6g}", "--y-mm", f"{y:g}")
    assert asked == [((0.0, 5e-3), (0.0,))]


def test_json_tells_the_peaks_and_the_file_is_the_dataset_of_the_library(capsys, expected, starter):
    data = answer(capsys, *SMALL, "--out", "r.nc", "--plot", "r.svg")
    assert (data["design_hash"], data["file"]) == (starter.digest, "r.nc")
    rows = data["response"]
    assert [row["state"] for row in rows] == ["coil1", "coil2", "coil3"]
    delta = expected.delta.values[0, 0]
    # the same computation once more
    np.testing.assert_allclose([row["peak_delta"] for row in rows], delta.max(axis=0), rtol=1e-9)
    np.testing.assert_allclose([row["lowest_delta"] for row in rows], delta.min(axis=0), rtol=1e-9)
    assert [row["peak_x_m"] for row in rows] == [X[k] for k in delta.argmax(axis=0)]
    assert {row["peak_y_m"] for row in rows} == {0.0}
    assert [row["depth_m"] for row in rows] == pytest.approx([0.3e-3] * 3, rel=1e-12)
    with xr.open_dataset("r.nc", engine="h5netcdf") as saved:
        assert set(saved.variables) == set(expected.variables)
        for name in expected.data_vars:
            np.testing.assert_allclose(saved[name], expected[name], rtol=1e-9, atol=1e-18)
        assert (saved.attrs, saved.delta.attrs["units"]) == (expected.attrs, "1")
    assert Path("r.svg").read_text(encoding="utf-8").startswith("<?xml")
    assert written() == ["r.nc", "r.svg"]


def test_the_table_and_every_value_as_csv(capsys, expected):
    out = good(capsys, *SMALL, "--out", "r.csv")
    title, header, *rows, last = out.splitlines()
    assert (title, header.split("  ")[0]) == ("Response", "depth (mm)")
    assert last == "wrote r.csv: 1 × 1 × 2 × 3 values over depth, y, x, state"
    cells = [row.split() for row in rows]
    assert [row[1] for row in cells] == ["coil1", "coil2", "coil3"]
    shown = [float(row[2].replace("−", "-")) for row in cells]
    # two decimals of 10⁻⁶
    np.testing.assert_allclose(shown, expected.delta.values[0, 0].max(axis=0) * 1e6, rtol=0, atol=0.005001)
    np.testing.assert_allclose(delta_of("r.csv"), expected.delta.values[0, 0], rtol=1e-9, atol=1e-18)
    assert written() == ["r.csv"]


def test_imperfections_of_the_experiment(capsys, monkeypatch):
    """They reach the library in m; tests/response has what they do."""
    seen = []

    def perfect(design, *, imperfections, **given):
        seen.append(imperfections)
        return response_map(design, **given)

    monkeypatch.setattr(coilarray.response.map, "response_map", perfect)
    errors = "tilt_x_mrad=10 tilt_y_mrad=-20 offset_x_mm=-0.3 offset_y_mm=0.4 depth_error_mm=0.05 noise=1e-6 seed=7"
    sheets = " thickness_error_mm.base=-0.2 thickness_error_mm.magnetic=0.1"
    options = [word for one in (errors + sheets).split() for word in ("--experiment", one)]
    good(capsys, *IDEAL, *options, "--out", "r.csv")
    lengths = {"offset": (-0.3 * 1e-3, 0.4 * 1e-3), "depth_error": 0.05 * 1e-3}
    thicknesses = {"base": -0.2 * 1e-3, "magnetic": 0.1 * 1e-3}
    assert seen == [
        Imperfections((0.01, -0.02), **lengths, thickness_errors=thicknesses, noise=1e-6, seed=7, network="ideal")
    ]


def test_large_boards_count_the_coils_near_the_indenter(capsys, monkeypatch, starter, ideal):
    wanted = library(starter, accuracy=1e-3, imperfections=CIRCUIT).delta.values[0, 0]
    assert 0 < np.abs(wanted - ideal).max() < 1e-3 * np.abs(wanted).max()
    monkeypatch.setattr(coilarray.response.map, "_AUTO_VALUES", 10)  # the map has 18
    out = good(capsys, *IDEAL, "--out", "r.csv")
    assert "mm from the indenter are included: the error of δ is up to 0.001 of its peak; --reach all includes" in out
    np.testing.assert_allclose(delta_of("r.csv"), wanted, rtol=1e-9)
    assert answer(capsys, *IDEAL, "--reach", "all", "--out", "all.csv")["error_of_peak"] == 0.0
    np.testing.assert_allclose(delta_of("all.csv"), ideal, rtol=1e-9, atol=1e-18)
    assert written() == ["all.csv", "r.csv"]


def test_how_far_a_sample_rises_off_its_seat_is_said(capsys):
    seat = """base = "seat"
seat_stiffness_kPa_per_mm = 4.3
seat_lifts = true
sample_x_mm = [-15, 15]
sample_y_mm = [-15, 15]"""
    Path("light.toml").write_text(LINEAR.replace('base = "bonded"', seat, 1), encoding="utf-8")
    one = ("--x-mm", "4", "--y-mm", "0", "--depth-mm", "0.3", "--ideal", "--out", "r.nc")
    out = good(capsys, "light.toml", *one)
    assert "note: the sample rises off its seat by up to " in out
    assert "mm; without seat_weight_Pa only the indenter holds it down" in out


# the first position lies half a millimetre west of the origin, so that a tilt lowers the sample there
test_mistakes_are_one_line_and_leave_nothing = mistakes(
    runner("response", "starter", "--x-mm", "-0.5,5", *GRID[2:])[1],
    (("--depth-mm", "1,0.5"), "--depth-mm must be rising numbers of mm, such as 0.5,1 or START:STOP:COUNT"),
    (("--depth-mm", "-0.1"), "depth of an indentation must be at least 0"),
    (("--x-mm", "east"), "--x-mm must be rising numbers of mm"),
    (("--y-mm", "2e5"), "--y-mm must be rising numbers of mm, at most 100000,"),
    (("--experiment", "tilt_x_mrad=nan"), "tilt, offset, errors, drift and noise must be finite"),
    (("--experiment", "tilt_x_mrad=1000"), "tilt must be at most 0.1"),
    (("--experiment", "tilt=1"), "--experiment must be KEY=VALUE with a key of depth_error_mm, tilt_x_mrad,"),
    (("--experiment", "drift=fast"), "--experiment drift must be a number; got 'fast'"),
    (("--experiment", "seed=0.5"), "--experiment seed must be a whole number; got 0.5"),
    (("--experiment", "thickness_error_mm.foam=1"), "names the sheet 'foam'; there are base, magnetic"),
    (("--experiment", "drift=1", "--experiment", "drift=2"), "--experiment must name drift once"),
    (("--reach", "near"), "--reach must be all, auto or 0.0001 to 0.1, an error of δ; got 'near'"),
    (("--reach", "1e-5"), "--reach must be all, auto or 0.0001 to 0.1, an error of δ; got '1e-5'"),
)


def test_an_interrupted_map_goes_on(capsys, monkeypatch, starter):
    solve, asked = coilarray.response.changes.dent_inductance, []

    def interrupted(source, dents, positions, *rest, **named):
        asked.append(np.array(positions))
        if len(asked) == 2:
            raise KeyboardInterrupt
        return solve(source, dents, positions, *rest, **named)

    monkeypatch.setattr(coilarray.response.changes, "_POSITIONS", 1)
    monkeypatch.setattr(coilarray.response.changes, "dent_inductance", interrupted)
    command = (*IDEAL, "--out", "r.nc")
    code, out, _ = run(capsys, *command)
    assert (code, out) == (130, "")
    assert [path.name for path in Path().glob("r.*")] == ["r.nc.parts"]
    assert len(list(Path("r.nc.parts").iterdir())) == 1
    # a mistake in between costs nothing
    refused(capsys, *command, "--experiment", "depth_error_mm=nan")
    refused(capsys, *command, "--experiment", "depth_error_mm=-1")
    assert len(list(Path("r.nc.parts").iterdir())) == 1

    good(capsys, *command)
    assert [path.name for path in Path().glob("r.*")] == ["r.nc"]
    np.testing.assert_allclose(np.array(asked)[2:, 0, 0], [5e-3], rtol=0, atol=1e-12)  # from the origin, coil 2
    monkeypatch.setattr(coilarray.response.changes, "dent_inductance", solve)
    whole = library(starter, imperfections=CIRCUIT)  # in the same blocks
    with xr.open_dataset("r.nc", engine="h5netcdf") as saved:
        # every block is the same computation, apart from the order of sums in parallel kernels
        np.testing.assert_allclose(saved.inductance_change, whole.inductance_change, rtol=1e-9, atol=1e-18)
        np.testing.assert_allclose(saved.delta, whole.delta, rtol=1e-9, atol=1e-15)


def test_the_table_of_a_dent_is_that_of_the_library(capsys):
    design = parse_design(LINEAR)
    setup = design.indentation
    expected = indent(design.sheets, setup.indenter, setup.depths, base="bonded", strain="linear")
    data = answer(capsys, "linear.toml", "--dent", "--out", "dent.nc", "--plot", "dent.svg")
    assert data["design_hash"] == design.digest
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
    with xr.open_dataset("dent.nc", engine="h5netcdf") as saved:
        np.testing.assert_allclose(saved.displacement_z, expected.displacement_z, rtol=1e-9, atol=1e-15)
        assert saved.force.attrs["units"] == "N"
    assert Path("dent.svg").read_text(encoding="utf-8").startswith("<?xml")


def test_assumed_values_of_a_dent_are_named(capsys):
    out = good(capsys, "gast2020", "--dent", "--depth-mm", "0.5")
    assert "hemisphere, base seat of 5.3 kPa/mm" in out
    for key in ("elastomer.0.youngs_modulus_kPa = 55: ", "elastomer.1.youngs_modulus_kPa = 152: ", "indentation.base"):
        assert f"assumed: {key}" in out
    assert "elastomer.0.youngs_modulus_kPa" in answer(capsys, "gast2020", "--dent", "--depth-mm", "0.5")["assumed"]


def test_a_cylinder_has_force_a_metre(capsys):
    Path("edge.toml").write_text(LINEAR.replace('"hemisphere"', '"cylinder_edge"', 1), encoding="utf-8")
    out = good(capsys, "edge.toml", "--dent", "--depth-mm", "0.3", "--out", "d.csv")
    assert "force on the indenter (N/m)" in out
    assert "half width of the contact (mm)" in out
    assert Path("d.csv").read_text(encoding="utf-8").startswith("depth_m,force_N_per_m,")


test_mistakes_of_a_dent_are_one_line = mistakes(
    runner("response", "starter", "--dent")[1],
    (("--depth-mm", "0"), "--depth-mm must be above zero with --dent; got 0"),
    (("--depth-mm", "1,0.5"), "--depth-mm must be rising numbers of mm, such as 0.5,1 or START:STOP:COUNT"),
    (("--depth-mm", "40"), "thickness of all sheets"),
)
