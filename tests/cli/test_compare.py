"""The command ``compare``: every kind of source on either side, numbers of the library, one line for every mistake."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import tomli_w
from support.command_line import runner
from support.quick_recordings import GRID, campaign_file, quick_map, stream_file
from support.recorded_boards import two_coils_document

from coilarray.cli.main import main
from coilarray.compute.netcdf import load_part, save_dataset
from coilarray.hardware.record.recorded_response import recorded_response
from coilarray.hardware.record.recording import open_recording
from coilarray.localize.comparison import compare_responses
from coilarray.localize.published import published_map
from coilarray.report.comparison import scale_table

pytestmark = pytest.mark.slow

run, refused = runner("compare")
fit, fit_refused = runner("fit")
locate, locate_refused = runner("locate")

WIDE = (np.arange(-12e-3, 25.1e-3, 1e-3), np.arange(-10e-3, 10.1e-3, 1e-3))


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """Folder with a recording of the quick board, its simulated map, and a calibration."""
    folder = tmp_path_factory.mktemp("files")
    campaign_file(folder / "quick.sqlite", noise=2e-7)
    save_dataset(quick_map(*WIDE), folder / "quick.nc")
    main(["calibrate-board", str(folder / "quick.sqlite"), "--inductance-uH", "52", "-o", str(folder / "board.toml")])
    return folder


@pytest.fixture(autouse=True)
def _in_a_folder_of_its_own(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def marked(text):
    lines = text.splitlines()
    return bool(lines) and all(line.startswith("[emulator]") for line in lines)


def test_help_has_an_example(capsys):
    code, out, _ = run(capsys, "--help")
    assert code == 0
    assert "Example:" in out


def test_a_recording_beside_its_simulation(capsys, files):
    code, out, err = run(
        capsys, files / "quick.sqlite", files / "quick.nc", "--json", "--replicates", "2",
        "--out", "out", "--picture", "p.svg",
    )  # fmt: skip
    assert (code, err) == (0, "")
    answer = json.loads(out)
    with open_recording(files / "quick.sqlite") as recording:
        expected = compare_responses(recorded_response(recording), quick_map(*WIDE), replicates=2)
    assert answer["scales"] == json.loads(json.dumps(scale_table(expected).records()))
    assert answer["emulated"] is True
    assert (answer["noise_from"], answer["only_measured"], answer["points_missing"]) == ("delta_std", [], 0)
    for row in answer["scales"]:
        assert abs(row["scale"] - 1) < 4 * row["scale_std"] + 1e-5
    names = ["comparison.html", "comparison.nc", "scales.csv", "remains.csv", "ellipses.csv", "curves.csv"]
    assert answer["files"] == [str(Path("out") / name) for name in names] + ["p.svg"]
    assert all(Path(name).stat().st_size > 100 for name in answer["files"])
    np.testing.assert_array_equal(load_part(Path("out/comparison.nc")).scale, expected.scale)
    assert "no real board was read" in Path("out/comparison.html").read_text(encoding="utf-8")


def test_every_line_of_an_emulated_board_says_so(capsys, files):
    code, out, err = run(capsys, files / "quick.sqlite", files / "quick.nc", "--replicates", "0", "--out", "page.html")
    assert (code, err) == (0, "")
    assert marked(out)
    assert "wrote page.html" in out
    page = Path("page.html").read_text(encoding="utf-8").strip()
    assert page.startswith("<!DOCTYPE html>")
    assert page.endswith("</html>")
    assert sorted(Path().iterdir()) == [Path("page.html")]
    code, out, _ = run(capsys, files / "quick.nc", files / "quick.sqlite", "--replicates", "0")
    assert marked(out)  # on either side
    run(capsys, files / "quick.nc", files / "quick.sqlite", "--replicates", "0", "--out", "other.html")
    lead = Path("other.html").read_text(encoding="utf-8").split("<h2>")[0]
    assert "quick.sqlite</strong> (from the emulator: no real board was read)" in lead
    assert lead.count("from the emulator") == 1
    code, out, _ = run(capsys, files / "quick.nc", files / "quick.nc", "--replicates", "0")
    assert "emulator" not in out
    assert "1.0000" in out


def test_a_recording_is_known_by_its_content(capsys, files):
    """Whatever its name is; and what asks for a response says how to make one."""
    plain = run(capsys, files / "quick.sqlite", files / "quick.nc", "--replicates", "0", "--json")[1]
    for name in ("renamed.db", "renamed.nc"):
        Path(name).write_bytes((files / "quick.sqlite").read_bytes())
        code, out, err = run(capsys, name, files / "quick.nc", "--replicates", "0", "--json")
        assert (code, err) == (0, "")
        assert json.loads(out)["scales"] == json.loads(plain)["scales"]
        wanted = f"{name} is a recording; make a response of it: coilarray scan-info {name} --to nc"
        assert wanted in fit_refused(capsys, name)
        assert wanted in locate_refused(capsys, "--model", name, "coil1=1e-4,coil2=1e-4")


def test_emulated_maps_are_told_once(capsys, files):
    with open_recording(files / "quick.sqlite") as recording:
        save_dataset(recorded_response(recording), Path("emulated.nc"))
    line = "[emulator] emulated.nc is of an emulated board: no real one was measured.\n"
    assert locate(capsys, "--model", "emulated.nc", "coil1=1e-4,coil2=1e-4")[::2] == (0, line)
    assert fit(capsys, "emulated.nc", "--coil", "coil1")[2].startswith(line)
    assert locate(capsys, "--model", files / "quick.nc", "coil1=1e-4,coil2=1e-4")[::2] == (0, "")


def test_what_does_not_belong_together_is_told(capsys, files):
    with open_recording(files / "quick.sqlite") as recording:
        other = recorded_response(recording).assign_attrs(design="other", design_hash="f" * 64)
    save_dataset(other, Path("other.nc"))
    answer = json.loads(run(capsys, files / "quick.sqlite", "other.nc", "--replicates", "0", "--json")[1])
    (note,) = [note for note in answer["notes"] if "different designs" in note]
    assert note.startswith("The two are of different designs: measured two_coils (")
    assert note.endswith("simulated other (ffffffffffff).")
    text = (files / "board.toml").read_text(encoding="utf-8")
    Path("board.toml").write_text(text.replace('board = "emulator"', 'board = "XMC 2Go"'), encoding="utf-8")
    options = ("--calibration", "board.toml", "--replicates", "0", "--json")
    answer = json.loads(run(capsys, files / "quick.sqlite", files / "quick.nc", *options)[1])
    assert "The calibration is of the board “XMC 2Go”, the measurement of “emulator”." in answer["notes"]
    assert not [note for note in answer["notes"] if "different designs" in note]


def test_a_calibration_is_applied(capsys, files):
    options = ("--calibration", files / "board.toml", "--replicates", "0", "--json")
    with_it = json.loads(run(capsys, files / "quick.sqlite", files / "quick.nc", *options)[1])
    without = json.loads(run(capsys, files / "quick.sqlite", files / "quick.nc", *options[2:])[1])
    # L_0 from all baselines together instead of one
    assert with_it["remains"][0]["noise"] == pytest.approx(without["remains"][0]["noise"] / np.sqrt(2), rel=0.2)
    assert with_it["remains"][0]["rms_after"] < without["remains"][0]["rms_after"]


def test_published_and_responses(capsys, files):
    save_dataset(published_map(), Path("a1.nc"))
    code, out, _ = run(capsys, "a1.nc", "published", "--json")
    assert code == 0
    for row in json.loads(out)["scales"]:
        assert row["scale"] == pytest.approx(1.0, abs=1e-9)
        assert abs(row["shift_x_m"]) < 1e-12
        assert row["points"] == 189  # Table A1 is continued around the measured positions
    answer = json.loads(run(capsys, "published", "a1.nc", "--json", "--largest-shift-mm", "1")[1])
    assert answer["scales"][0]["points"] == 25 * 5
    assert run(capsys, "published", "published", "--json", "--replicates", "0")[0] == 0
    answer = json.loads(run(capsys, "a1.nc", files / "quick.nc", "--json")[1])
    assert answer["only_measured"] == ["coil3"]
    assert answer["only_simulated"] == []
    assert answer["points_left_out"] > 0
    assert answer["notes"][0] == "Only measured, not compared: coil3."


def test_an_unfinished_campaign_is_compared_as_far_as_it_is(capsys, tmp_path):
    import sqlite3

    path = campaign_file(tmp_path / "run.sqlite")
    with sqlite3.connect(path) as connection:
        connection.execute("UPDATE position SET finished = NULL WHERE place >= 60")
    save_dataset(quick_map(*WIDE), Path("quick.nc"))
    answer = json.loads(run(capsys, path, "quick.nc", "--json")[1])
    missing = 2 * (GRID.size - 60)
    assert answer["points_missing"] == missing
    assert f"{missing} readings of the grid are not measured yet." in answer["notes"]
    assert answer["ellipses"][0]["problem"].startswith("measured: the map has gaps.")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("none.nc", "published"), "there is no file none.nc"),
        (("none.sqlite", "published"), "none.sqlite"),
        (("none", "published"), "none"),
        (("published", "text.nc"), "cannot read text.nc: it is no netCDF file"),
        (("text.sqlite", "published"), "text.sqlite"),
        (("a1.nc", "flat.toml"), "the design flat has no [indenter] and [indentation]"),
        (("a1.nc", "other.nc"), "no state in common: measured coil1, coil2, coil3; simulated a, b"),
        (("a1.nc", "deep.nc"), "no depth in common: measured 1 mm; simulated 2 mm"),
        (("a1.nc", "far.nc"), "no measured position is in the simulated map"),
        (("a1.nc", "published", "--reach-mm", "-1"), "--largest-shift-mm must be 0 to 1000; got -1"),
        (("a1.nc", "published", "--largest-shift-mm", "nan"), "--largest-shift-mm must be 0 to 1000; got nan"),
        (("a1.nc", "published", "--largest-shift-mm", "x"), "largest-shift-mm"),
        (("a1.nc", "published", "--replicates", "-1"), "replicates"),
        (("a1.nc", "published", "--picture", "p.txt"), "--picture must end in .png, .svg or .pdf"),
        (("a1.nc", "published", "--out", "none/page.html"), "there is no folder none"),
        (("a1.nc", "published", "--out", "a1.nc"), "a file has that name"),
        (("a1.nc", "published", "--calibration", "board.toml"), "--calibration is for a recording; a1.nc is none"),
        (("a1.nc",), "SIMULATED"),
        ((), "MEASURED"),
    ],
)
def test_bad_input(capsys, arguments, words):
    a1 = published_map()
    save_dataset(a1, Path("a1.nc"))
    save_dataset(a1.isel(state=[0, 1]).assign_coords(state=["a", "b"]), Path("other.nc"))
    save_dataset(a1.assign_coords(depth=[2e-3]), Path("deep.nc"))
    save_dataset(a1.assign_coords(x=a1.x + 1), Path("far.nc"))
    Path("text.nc").write_text("no netCDF")
    document = two_coils_document()
    flat = {key: value for key, value in document.items() if key not in ("indenter", "indentation")}
    Path("flat.toml").write_text(tomli_w.dumps({**flat, "name": "flat"}))
    Path("text.sqlite").write_text("no SQLite, but long enough to be read as a page" * 100)
    assert words in refused(capsys, *arguments)


def test_recordings_that_are_none(capsys, files, tmp_path):
    stream = stream_file(tmp_path / "stream.sqlite", 5)
    assert "holds no campaign" in refused(capsys, stream, files / "quick.nc")
    assert "there is no calibration" in refused(
        capsys, files / "quick.sqlite", files / "quick.nc", "--calibration", "none.toml"
    )
    real = (files / "board.toml").read_text(encoding="utf-8").replace("emulated = true", "emulated = false")
    Path("real.toml").write_text(real, encoding="utf-8")
    assert "is of a real board" in refused(
        capsys, files / "quick.sqlite", files / "quick.nc", "--calibration", "real.toml"
    )
