"""The command ``compare``: every kind of source on either side, numbers of the library, one line for every mistake."""

import json
import sqlite3
from pathlib import Path

import numpy as np
import pytest
import tomli_w
from support.command_line import runner, successes
from support.recorded_boards import (
    GRID,
    campaign_file,
    quick_map,
    stream_file,
    take_back,
    two_coils_document,
    unsealed_text,
)

from coilarray.cli.main import main
from coilarray.compute.netcdf import load_part, save_dataset
from coilarray.hardware.record.recorded_response import recorded_response
from coilarray.hardware.record.recording import open_recording
from coilarray.paper.ellipse_model import published_map
from coilarray.report.measurement import scale_table
from coilarray.studies.comparison import compare_responses

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("own_folder", "pictures_of_nothing", "no_noisy_copies")]

_, refused = runner("board", "compare")
good, answer = successes("board", "compare")
fit, fit_refused = runner("paper", "fit")
locate, locate_refused = runner("locate")

WIDE = (np.arange(-12e-3, 25.1e-3, 1e-3), np.arange(-10e-3, 10.1e-3, 1e-3))


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """Folder with a recording of the quick board, its simulated map, a calibration, Table A1, and bad ones."""
    folder = tmp_path_factory.mktemp("files")
    campaign_file(folder / "quick.sqlite", noise=2e-7)
    save_dataset(quick_map(*WIDE), folder / "quick.nc")
    save_dataset(published_map(), folder / "a1.nc")
    save_dataset(published_map().isel(state=[0, 1]).assign_coords(state=["a", "b"]), folder / "other.nc")
    main(
        ["board", "calibrate", str(folder / "quick.sqlite"), "--inductance-uH", "52", "-o", str(folder / "board.toml")]
    )
    stream_file(folder / "stream.sqlite", 5)
    (folder / "text.nc").write_text("no netCDF")
    (folder / "text.sqlite").write_text("no SQLite, but long enough to be read as a page" * 100)
    flat = {key: value for key, value in two_coils_document().items() if key not in ("indenter", "indentation")}
    (folder / "flat.toml").write_text(tomli_w.dumps({**flat, "name": "flat"}))
    return folder


@pytest.fixture(scope="module")
def both(files):
    """The recording and its simulation."""
    return files / "quick.sqlite", files / "quick.nc"


def marked(text):
    return bool(text) and all(line.startswith("[emulator]") for line in text.splitlines())


def test_a_recording_beside_its_simulation(capsys, both):
    data = answer(capsys, *both, "--out", "out", "--picture", "p.svg")
    with open_recording(both[0]) as recording:
        expected = compare_responses(recorded_response(recording), quick_map(*WIDE))
    assert data["scales"] == json.loads(json.dumps(scale_table(expected).records()))
    assert data["emulated"] is True
    assert (data["noise_from"], data["only_measured"], data["points_missing"]) == ("delta_std", [], 0)
    for row in data["scales"]:
        assert abs(row["scale"] - 1) < 4 * row["scale_std"] + 1e-5
    names = ["comparison.html", "comparison.nc", "scales.csv", "remains.csv", "ellipses.csv", "curves.csv"]
    assert data["files"] == [str(Path("out") / name) for name in names] + ["p.svg"]
    assert all(Path(name).stat().st_size > 100 for name in data["files"])
    np.testing.assert_array_equal(load_part(Path("out/comparison.nc")).scale, expected.scale)
    assert "no real board was read" in Path("out/comparison.html").read_text(encoding="utf-8")


def test_both_less_a_reference_coil(capsys, both):
    data = answer(capsys, *both, "--reference", "coil2")
    assert [row["state"] for row in data["scales"]] == ["coil1"]
    assert any("δ of both is less that of coil2" in note for note in data["notes"])
    (row,) = data["scales"]
    assert abs(row["scale"] - 1) < 4 * row["scale_std"] + 1e-5  # the same board still
    assert "a reference coil must be one of" in refused(capsys, *both, "--reference", "coil9")


def test_every_line_of_an_emulated_board_says_so(capsys, both):
    assert marked(good(capsys, *both, "--out", "page.html"))
    out = good(capsys, *reversed(both), "--out", "page.html")  # on either side, and over its own page
    assert marked(out)
    assert "wrote page.html" in out
    page = Path("page.html").read_text(encoding="utf-8").strip()
    assert (page[:15], page[-7:]) == ("<!DOCTYPE html>", "</html>")
    assert sorted(Path().iterdir()) == [Path("page.html")]
    lead = page.split("<h2>")[0]
    assert "quick.sqlite (from the emulator: no real board was read)" in lead
    assert lead.count("from the emulator") == 1
    out = good(capsys, both[1], both[1])
    assert ("emulator" in out, "1.0000" in out) == (False, True)


def test_a_recording_is_known_by_its_content(capsys, both):
    """Whatever its name is; and what asks for a response says how to make one."""
    plain = answer(capsys, *both)
    for name in ("renamed.db", "renamed.nc"):
        Path(name).write_bytes(both[0].read_bytes())
        assert answer(capsys, name, both[1])["scales"] == plain["scales"]
        wanted = f"{name} is a recording; convert it to a response: coilarray board info {name} --out map.nc"
        assert wanted in fit_refused(capsys, name)
        assert wanted in locate_refused(capsys, "--model", name, "coil1=1e-4,coil2=1e-4")


def test_what_does_not_belong_together_is_told(capsys, files, both):
    with open_recording(both[0]) as recording:
        other = recorded_response(recording).assign_attrs(design="other", design_hash="f" * 64)
    save_dataset(other, Path("other.nc"))
    (note,) = [note for note in answer(capsys, both[0], "other.nc")["notes"] if "different designs" in note]
    assert note.startswith("The two are of different designs: measured two_coils (")
    assert note.endswith("simulated other (ffffffffffff).")
    text = unsealed_text(files / "board.toml")
    Path("board.toml").write_text(text.replace('board = "emulator"', 'board = "XMC 2Go"'), encoding="utf-8")
    notes = answer(capsys, *both, "--calibration", "board.toml")["notes"]
    assert "The calibration is of the board “XMC 2Go”, the measurement of “emulator”." in notes
    assert not [note for note in notes if "different designs" in note]


def test_published_and_responses(capsys, files):
    a1 = files / "a1.nc"
    for row in answer(capsys, a1, "published")["scales"]:
        assert row["scale"] == pytest.approx(1.0, abs=1e-9)
        assert abs(row["shift_x_m"]) < 1e-12
        assert row["points"] == 189  # Table A1 is continued around the measured positions
    data = answer(capsys, "published", a1, "--largest-shift-mm", "1")
    assert data["scales"][0]["points"] == 25 * 5
    data = answer(capsys, a1, files / "quick.nc")
    assert (data["only_measured"], data["only_simulated"]) == (["coil3"], [])
    assert data["points_left_out"] > 0
    assert data["notes"][0] == "Only measured, not compared: coil3."


def test_an_unfinished_campaign_is_compared_as_far_as_it_is(capsys, both):
    Path("run.sqlite").write_bytes(both[0].read_bytes())
    with sqlite3.connect("run.sqlite") as connection:
        take_back(connection, "place >= 60")
    connection.close()
    data = answer(capsys, "run.sqlite", both[1])
    missing = 2 * (GRID.size - 60)
    assert data["points_missing"] == missing
    assert f"{missing} readings of the grid are not measured yet." in data["notes"]
    assert data["ellipses"][0]["problem"].startswith("measured: the map has gaps.")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("none.sqlite", "published"), "none.sqlite"),
        (("published", "text.nc"), "text.nc: it is no netCDF file"),
        (("text.sqlite", "published"), "text.sqlite"),
        (("a1.nc", "flat.toml"), "the design flat has no [indenter] and [indentation]"),
        (("a1.nc", "other.nc"), "no state in common: measured coil1, coil2, coil3; simulated a, b"),
        (("a1.nc", "published", "--largest-shift-mm", "-1"), "--largest-shift-mm must be 0 to 1000; got -1"),
        (("a1.nc", "published", "--out", "none/page.html"), "there is no folder none"),
        (("a1.nc", "published", "--out", "a1.nc"), "a file has that name"),
        (("a1.nc", "published", "--calibration", "board.toml"), "a1.nc is not one"),
        (("stream.sqlite", "quick.nc"), "holds no campaign"),
        (("quick.sqlite", "quick.nc", "--calibration", "none.toml"), "there is no calibration"),
    ],
)
def test_bad_input(capsys, files, arguments, words):
    assert words in refused(capsys, *(files / one if (files / one).exists() else one for one in arguments))
