"""The commands ``fit``, ``distortion`` and ``locate``: numbers of the library, one line for every mistake, streams."""

import csv
import io
import json
import sys
from pathlib import Path

import numpy as np
import pytest
from support.command_line import mistakes, runner
from support.contacts import coarse_maps, first_coils
from support.localize_boards import FIELD, ROW, bells, board
from support.made_up import made_up_distortion
from support.plot_results import calibration

import coilarray.localize.forward
import coilarray.paper.distortion
import coilarray.response.map
from coilarray import load_design
from coilarray.cli.main import main
from coilarray.compute.netcdf import save_dataset
from coilarray.elastomer.contact_grid import ContactMesh
from coilarray.localize.forward import forward_model
from coilarray.localize.inverse import locate
from coilarray.paper.ellipse import fit_ellipses
from coilarray.paper.ellipse_model import (
    ellipse_model,
    locate_x,
    model_from_json,
    published_map,
    published_model,
    table_a1,
)
from coilarray.response.map import Imperfections, response_map

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("own_folder")]

run, refused = runner()

NAMES = [f"coil{k + 1}" for k in range(len(FIELD))]
POINT = (3e-3, 2e-3, 1e-3)


@pytest.fixture(scope="module")
def maps(tmp_path_factory):
    """Folder with a board without symmetry, one with it, and the map of Table A1."""
    folder = tmp_path_factory.mktemp("maps")
    save_dataset(board(FIELD), folder / "field.nc")
    save_dataset(board(ROW), folder / "row.nc")
    save_dataset(published_map(), folder / "a1.nc")
    return folder


def reading(point=POINT, centres=FIELD):
    """δ of the coils at a point, by name."""
    return {f"coil{k + 1}": float(value) for k, value in enumerate(bells(np.array(point), centres))}


def text_of(values):
    return ",".join(f"{name}={value!r}" for name, value in values.items())


def answered(capsys, *arguments):
    """What a command prints as JSON; there is no NaN in it."""
    code, out, _ = run(capsys, *arguments, "--json")
    assert code == 0
    return json.loads(out, parse_constant=pytest.fail)


def positions(capsys, *arguments):
    return answered(capsys, "locate", *arguments)["positions"]


def streamed(monkeypatch, capsys, data, *arguments):
    """Run a stream of bytes through ``locate``; one mapping a line."""
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(data)))
    code, out, err = run(capsys, "locate", *arguments, "-")
    return code, [json.loads(line) for line in out.splitlines()], err


def test_fit_is_that_of_the_library(capsys, maps):
    answer = answered(capsys, "paper", "fit", maps / "a1.nc", "--out", "m.json", "--plot", "m.svg")
    fits = fit_ellipses(published_map())
    model, written = ellipse_model(fits), Path("m.json").read_text(encoding="utf-8")
    assert (model_from_json(written), json.loads(written)["schema"]) == (model, 1)
    assert Path("m.svg").read_text(encoding="utf-8").startswith("<?xml")
    rows = {(row["coil"], row["parameter"], row["source"]): row for row in answer["polynomials"]}
    assert len(rows) == 18
    powers = [f"p{power}_m" for power in (4, 3, 2, 1, 0)]
    for coil in model.coils:
        for key in ("A", "B", "x0"):
            found, printed = ([rows[coil.name, key, of][p] for p in powers] for of in ("this map", "Table A1"))
            assert found == list(getattr(coil, key))
            np.testing.assert_allclose(printed, np.array(table_a1()[key, coil.name]) * 1e-3, rtol=1e-12)
    steps = {row["coil"]: row for row in answer["fits"]}
    at = np.linspace(1e-4, 1e-3, 37)
    apart = np.polyval(model["coil2"].A, at) - np.polyval(published_model()["coil2"].A, at)
    assert steps["coil2"]["A_less_published_rms_m"] == pytest.approx(np.sqrt(np.mean(apart**2)), rel=1e-12)
    of = fits.sel(state="coil2")
    assert steps["coil2"]["steps"] == (of.refused == "").sum()
    assert steps["coil2"]["ellipse_rms_m"] == pytest.approx(float(np.sqrt((of.rms**2).mean())), rel=1e-12)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("text.nc",), "cannot read text.nc: it is no netCDF file"),
        (("flat.nc",), "the map has no closed curves"),
        (("a1.nc", "--coil", "coil9"), "the response has no state 'coil9'"),
        (("a1.nc", "--depth-mm", "0.7"), "the response has the depths 1 mm; got 0.7 mm"),
        (("a1.nc", "--depth-mm", "-1"), "--depth-mm must be above 0"),
        (("a1.nc", "--out", "m.txt"), "--out must end in .json; got m.txt"),
        (("a1.nc", "--plot", "m.gif"), "--plot must end in .png, .svg or .pdf; got m.gif"),
        (("gast2020", "--coil", "coil9"), "--coil must be one of coil1, coil2, coil3, coil4, coil5, coil6; got coil9"),
        (("proximity",), "has no [indenter] and [indentation], which say what presses on the board"),
    ],
)
def test_mistakes_of_fit(capsys, monkeypatch, arguments, message):
    monkeypatch.setattr(coilarray.response.map, "response_map", lambda *_, **__: pytest.fail("work has begun"))
    save_dataset(published_map(), Path("a1.nc"))
    Path("text.nc").write_text("no netCDF", encoding="utf-8")
    save_dataset(published_map() * 0, Path("flat.nc"))
    assert message in refused(capsys, "paper", "fit", *arguments)


@pytest.fixture
def quick(monkeypatch):
    """No maps are computed; what was asked for is kept."""
    asked = []

    def split(design, states, *, imperfections, draws, progress):
        asked.append(("distortion", design.indentation.base, list(states)))
        found = made_up_distortion(design, states)
        if draws:
            asked.append((imperfections, draws))
            found = found.assign({f"{name}_std": 0.1 * np.abs(found[name]) for name in ("x0", "effect", "rms")})
        return found

    monkeypatch.setattr(coilarray.paper.distortion, "distortion", split)
    return asked


def test_distortion_tells_what_remains(capsys, quick):
    code, out, err = run(capsys, "paper", "distortion", "gast2020", "--out", "d.csv", "--plot", "d.svg")
    assert (code, err) == (0, "")
    assert quick == [("distortion", load_design("gast2020").indentation.base, ["coil1", "coil2", "coil3"])]
    rows = {line.split("  ")[0]: line.split() for line in out.splitlines() if line}
    assert rows["all neighbours"][2:] == ["0.300"] * 3
    last = out.splitlines()[-3]
    # 1 mm predicted, 0.25 mm published; coil3 has nothing to compare with
    left_out = "Levels of δ left out as undetermined: 1."
    assert last.endswith(f"rms: coil1 0.75 of 0.25 mm; coil2 0.75 of 0.25 mm. {left_out}")
    assert Path("d.svg").read_text(encoding="utf-8").startswith("<?xml")
    with Path("d.csv").open(encoding="utf-8") as lines:
        table = list(csv.DictReader(lines))
    assert len(table) == 9
    assert [table[0][key] for key in ("coil", "delta", "x0_grounded_m", "x0_open_m", "x0_published_m")] == [
        "coil1", "0.0001", "0.001", "0.0005", "0.00025",
    ]  # fmt: skip
    assert (table[2]["x0_grounded_m"], table[0]["effect_all_neighbours_m"]) == ("", "0.0003")


def test_distortion_with_the_error_of_a_calibration(capsys, quick):
    save_dataset(calibration(), Path("calibration.nc"))
    save_dataset(published_map(), Path("map.nc"))
    options = ("--posterior", "calibration.nc", "--draws", "3", "--out", "d.csv", "--plot", "d.svg")
    code, out, err = run(capsys, "paper", "distortion", "gast2020", *options)
    assert (code, err) == (0, "")
    imperfections, draws = quick[1]
    assert imperfections == Imperfections()
    assert len({design.digest for design, _ in draws}) == 3
    row = next(line.split() for line in out.splitlines() if line.startswith("all neighbours"))
    assert row[2:] == ["0.300", "0.030"] * 3
    with Path("d.csv").open(encoding="utf-8") as lines:
        assert next(csv.DictReader(lines))["x0_grounded_std_m"] == "0.0001"
    assert "map.nc must have value, posterior" in refused(
        capsys, "paper", "distortion", "gast2020", "--posterior", "map.nc"
    )
    assert "there is no file n.nc" in refused(capsys, "paper", "distortion", "gast2020", "--posterior", "n.nc")


test_mistakes_of_distortion = mistakes(
    runner("paper", "distortion", "gast2020")[1],
    (("--coil", "coil9"), "a state must be measured and named after its coil; got 'coil9'"),
    (("--out", "d.txt"), "--out must end in .nc or .csv; got d.txt"),
    (("--plot", "d.gif"), "--plot must end in .png, .svg or .pdf"),
    (("--out", "no/d.nc"), "there is no folder no"),
)


def test_one_reading_is_that_of_the_library(capsys, maps):
    (found,) = positions(capsys, "--model", maps / "field.nc", text_of(reading()))
    expected = locate(forward_model(board(FIELD)), reading())
    best = expected.best
    assert found["status"] == "located"
    place, sigma = ([found[f"{what}{name}_m"] for name in ("x", "y", "depth")] for what in ("", "sigma_"))
    assert place == pytest.approx([best.x, best.y, best.depth], abs=1e-9)
    np.testing.assert_allclose(sigma, best.deviations, rtol=1e-6)
    assert len(found["modes"]) == len(expected.modes)
    np.testing.assert_allclose(place, POINT, atol=1e-5)  # the table is 1 mm fine; the bells are 7 mm wide


def test_both_signs_of_y_are_told(capsys, maps):
    code, out, _ = run(capsys, "locate", "--model", maps / "row.nc", text_of(reading(centres=ROW)))
    assert code == 0
    *lines, noise = out.splitlines()
    assert noise == "noise of δ 10·10⁻⁶ of each coil by default, as the response states none"
    _, header, *rows = [line.replace("−", "-").split() for line in lines]
    assert header[:3] == ["reading", "status", "x"]
    assert sorted(row[3] for row in rows) == ["-2.000", "2.000"]
    assert {tuple(row[:3]) for row in rows} == {("1", "located", "3.000")}


def test_files_of_readings(capsys, maps):
    values = [reading(), reading((-4e-3, 1e-3, 0.8e-3))]
    with Path("r.csv").open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(NAMES)
        writer.writerows([[*one.values()] for one in values])
        writer.writerow([1e-3])
        writer.writerow([*"abcde"])
    lines = [*map(json.dumps, (*values, "word", list(values[1].values())))]
    Path("r.jsonl").write_text("\n".join(lines), encoding="utf-8")
    found = positions(capsys, "--model", maps / "field.nc", "r.csv", "r.jsonl")
    assert {k: one["error"] for k, one in enumerate(found) if one.get("status") != "located"} == {
        2: "a line must have 5 values; got 1.",
        3: "δ of coil1 must be a number; got 'a'.",
        6: """a reading must be an object or a list of numbers; got '"word"'.""",
    }
    assert [found[k]["x_m"] for k in (1, 5, 7)] == pytest.approx([-4e-3] * 3, abs=1e-5)
    assert len(found) == 8
    code, out, _ = run(capsys, "locate", "--model", maps / "field.nc", "r.csv")
    assert code == 0
    assert "reading 3: a line must have 5 values; got 1." in out.splitlines()


def test_a_reference_coil_takes_a_drift_away(capsys, monkeypatch, maps):
    """A drift of 3e-5 of all coils; the reference may be pressed too."""
    drifted = {name: value + 3e-5 for name, value in reading().items()}
    options = ("--model", str(maps / "field.nc"), "--reference", NAMES[-1])
    (found,) = positions(capsys, *options, text_of(drifted))
    assert (found["x_m"], found["y_m"], found["depth_m"]) == pytest.approx(POINT, abs=1e-8)
    (off,) = positions(capsys, *options[:2], text_of(drifted))
    assert off["status"] != "located" or abs(off["x_m"] - POINT[0]) > 1e-6
    lines = [drifted, {name: drifted[name] for name in NAMES[:-1]}, {**drifted, NAMES[0]: 5.0}]
    code, answers, _ = streamed(monkeypatch, capsys, "\n".join(map(json.dumps, lines)).encode(), *options)
    assert code == 0
    assert ["error" in one for one in answers] == [False, True, True]
    assert answers[0]["x_m"] == found["x_m"]
    line = refused(capsys, "locate", *options, "--reference", "coil9", text_of(drifted))
    assert "a reference coil must be one of" in line


BAD_LINES = [
    b"", b"   ", b"word", b"{", b"3", b"null", b"true", b'"coil1"', b"\xff\xfe", b"[" * 100_000, b"[]", b"{}",
    b"[1e-4]", b'{"coil1": 1e-4}', b"[[0, 0, 0, 0, 0]]",
    *(b'{"coil1": %b, "coil2": 0, "coil3": 0, "coil4": 0, "coil5": 0}' % value for value in (
        b"NaN", b"Infinity", b'"1e-4"', b"true", b"null", b"[0]", b"5", b"1" + b"0" * 400, b"1" + b"0" * 5000,
    )),
]  # fmt: skip


def test_a_stream_outlives_every_bad_line(monkeypatch, capsys, maps):
    good, arguments = json.dumps(reading((0.0, 2e-3, 1e-3))).encode(), ("--model", maps / "field.nc")
    lines = [part for bad in BAD_LINES for part in (bad, good)]
    code, found, err = streamed(monkeypatch, capsys, b"\n".join(lines) + b"\n", *arguments)
    assert (code, err) == (0, "")
    assert len(found) == len(lines)
    assert {one["status"] for one in found[1::2]} == {"located"}
    for bad, one in zip(BAD_LINES, found[::2], strict=True):
        assert list(one) == ["error"], bad
        assert "\n" not in one["error"]
        assert len(one["error"]) < 250


def test_a_stream_is_answered_line_by_line(monkeypatch, capsys, maps):
    written = []

    def source():
        for k in range(3):
            assert len(capsys.readouterr().out.splitlines()) == (k > 0)  # the answer to the line before, flushed
            written.append(k)
            yield json.dumps(reading()).encode()

    class Live:
        buffer = source()

    monkeypatch.setattr(sys, "stdin", Live())
    assert (main(["locate", "--model", str(maps / "field.nc"), "-"]), written) == (0, [0, 1, 2])


@pytest.mark.parametrize("data", [b"", b"\n".join(BAD_LINES)])
def test_a_stream_of_nothing_is_bad_input(monkeypatch, capsys, maps, data):
    code, found, err = streamed(monkeypatch, capsys, data, "--model", maps / "field.nc")
    assert code == 2
    assert all(list(one) == ["error"] for one in found)
    (line,) = err.splitlines()
    assert line.startswith("coilarray: error: there is no reading in the stream")


def test_status_of_readings_without_a_position(monkeypatch, capsys, maps):
    beyond = 1.8 * bells(np.array([6e-3, 2e-3, 1.8e-3]), FIELD)
    data = [[0.0] * 5, [0.0, 0.0, 0.0, 1e-3, 1e-3], beyond.tolist()]
    lines = b"\n".join(json.dumps(one).encode() for one in data)
    code, (nothing, unfit, outside), _ = streamed(monkeypatch, capsys, lines, "--model", maps / "field.nc")
    assert code == 0
    assert [one["status"] for one in (nothing, unfit, outside)] == ["nothing pressed", "no position fits", "outside"]
    assert ("x_m" in nothing, nothing["modes"]) == (False, [])
    assert ("noise" in unfit["reason"], "depth" in outside["reason"]) == (True, True)


def test_the_ellipse_model_of_a_file_and_of_table_a1(capsys, maps):
    values = {"coil1": 8.0895e-4, "coil2": 6.4684e-4, "coil3": 0.0}
    assert run(capsys, "paper", "fit", maps / "a1.nc", "--out", "m.json")[0] == 0
    fitted = model_from_json(Path("m.json").read_text(encoding="utf-8"))
    for name, model in (("published", published_model()), ("m.json", fitted)):
        (found,) = positions(capsys, "--model", name, text_of(values))
        place = locate_x(model.with_semiaxis_addition(), values)
        assert (found["x_m"], found["y_m"]) == pytest.approx((place.x, place.y), rel=1e-9)
        assert [mode["y_m"] for mode in found["modes"]] == pytest.approx([place.y, -place.y], rel=1e-9)
        assert found["coils"] == ["coil1", "coil2"]


def test_the_table_of_a_design_is_computed_once(capsys, monkeypatch):
    design, computed = load_design("starter"), []

    def table(given, *, progress):
        computed.append(given.name)
        return board(FIELD).isel(state=slice(3)).assign_attrs(design_hash=given.digest, origin_x=1e-3, origin_y=-2e-3)

    monkeypatch.setenv("COILARRAY_CACHE", "cache")
    monkeypatch.setattr(coilarray.localize.forward, "table_for", table)
    three = {name: value for name, value in reading().items() if name in design.array.names}
    command = ("locate", "--model", "starter", text_of(three), "--json")
    first, second = run(capsys, *command), run(capsys, *command)
    assert (first, first[0], computed) == (second, 0, ["starter"])
    (found,) = json.loads(first[1])["positions"]
    on_board = POINT[0] + 1e-3, POINT[1] - 2e-3  # the board's coordinates, not the map's
    assert min(np.hypot(m["x_m"] - on_board[0], m["y_m"] - on_board[1]) for m in found["modes"]) < 1e-4


@pytest.mark.parametrize(("arguments", "message"), [
    (("coil1=1e-4,coil2=1e-4",), "a reading must have δ of every state; coil3 is missing. --coil takes only"),
    (("coil1=1e-4", "--coil", "coil1", "--coil", "coil2", "--coil", "coil3"), "coil2, coil3 are missing."),
    (("coil1=1e-4,coil2=100,coil3=0",), "δ must be a number between -1 and 1; that of coil2 is 100.0"),
    (("coil1=1e-4,coil2=0,coil3=0", "--coil", "coil9"), "the model has no state 'coil9'"),
    (("coil1=1e-4,coil2=0,coil3=0", "--coil", "coil1"), "the model has coil1. A map at one place, as of coilarray"),
    (("coil1=1e-4,coil2=0,coil3=0", "--noise", "0"), "--noise must be above 0"),
    (("twice.jsonl",), "name a coil once; got 'coil1' again"),
    (("two.jsonl",), "there is no reading in two.jsonl: a reading must have one δ for each of 3 states"),
])  # fmt: skip
def test_mistakes_before_the_table_is_computed(capsys, monkeypatch, arguments, message):
    Path("two.jsonl").write_text("[1e-4]\n[2]", encoding="utf-8")
    Path("twice.jsonl").write_text('{"coil1": 1e-4, "coil1": 2e-4, "coil2": 0, "coil3": 0}\n', encoding="utf-8")
    monkeypatch.setattr("coilarray.cli.shared.kept_table", lambda *_: pytest.fail("the table comes last"))
    assert message in refused(capsys, "locate", "--model", "starter", *arguments)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("coil1",), "READINGS must be coil1=7.1e-4,coil2=..., a file .csv or .jsonl, or -; got 'coil1'"),
        (("coil1=a",), "δ of coil1 must be a number; got 'a'"),
        (("coil1=1e-4,coil1=1e-4",), "must name a coil once; got 'coil1' again"),
        (("coil1=1e-4",), "every state; coil2, coil3"),
        (("coil9=1e-4",), "coil1, coil2, coil3, coil4, coil5 are missing"),
        (("none.csv",), "cannot read none.csv: No such file"),
        *(((name,), f"there is no reading in {name}") for name in ("empty.csv", "names.csv")),
        (("twice.csv",), "the first line must name every coil once"),
        (("bytes.csv",), "cannot read bytes.csv: it is not UTF-8 text"),
        (("word.jsonl",), "a reading must be JSON; got 'word'"),
        (("-", "coil1=1e-4"), "a stream (-) must be the only READINGS"),
        (("GOOD", "--noise", "0"), "--noise must be above 0 and at most 1; got 0"),
        (("GOOD", "--coil", "coil9"), "the model has no state 'coil9'"),
        (("GOOD", "--coil", "coil1", "--coil", "coil2"), "3 unknowns need at least as many states"),
        (("GOOD", "--model", "m.json"), "cannot read m.json"),
        (("GOOD", "--model", "word.json"), "an ellipse model must be a JSON file"),
        (("GOOD", "--model", "published", "--coil", "coil9"), "the model has no state 'coil9'"),
        (("GOOD", "--model", "published", "--coil", "coil1"), "2 unknowns need at least as many states"),
        (("coil1=1e-4", "--model", "published"), "coil2, coil3 are missing"),
        ((), "READINGS"),
    ],
)
def test_mistakes_of_locate(capsys, maps, arguments, message):
    files = {"empty": b"", "names": b"coil1,coil2\n", "twice": b"coil1,coil1\n1,1\n", "bytes": b"\xff\xfe\xff"}
    for name, content in files.items():
        Path(f"{name}.csv").write_bytes(content)
    for name in ("word.json", "word.jsonl"):
        Path(name).write_text("word", encoding="utf-8")
    given = [text_of(reading()) if one == "GOOD" else one for one in arguments]
    model = () if "--model" in given else ("--model", maps / "field.nc")
    assert message in refused(capsys, "locate", *model, *given)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"schema": 2}, "the schema of an ellipse model must be 1; got 2"),
        ({"kind": "map"}, 'must have "kind": "coilarray ellipse model"'),
        ({"coils": None}, "must have a list of coils"),
        ({"coils": []}, "a model must have at least one coil"),
        ({"coils": [1]}, "a coil of an ellipse model must have a name"),
        ({"coils": [{"name": "a"}]}, "a of an ellipse model must have x0_m, A_m, B_m"),
        *(({"A_m": wrong}, "must have 5 numbers in x0_m, A_m and B_m") for wrong in ([1, 2], ["a"] * 5, 3)),
        ({"lowest": None}, "must have 5 numbers"),
        ({"lowest": 1.0}, "the range of δ of coil1 must rise"),
    ],
)
def test_model_files_that_are_none(capsys, maps, change, message):
    assert run(capsys, "paper", "fit", maps / "a1.nc", "--out", "m.json")[0] == 0
    data = json.loads(Path("m.json").read_text(encoding="utf-8"))
    del data["checksum"]  # or the change itself would be refused
    (data if set(change) & set(data) else data["coils"][0]).update(change)
    Path("m.json").write_text(json.dumps(data), encoding="utf-8")
    assert message in refused(capsys, "locate", "--model", "m.json", "coil1=1e-4,coil2=1e-4,coil3=0")


def test_the_table_of_a_real_board_finds_what_pressed_on_it(capsys):
    """The whole way, but for the meshes: table of the design, map of the design, position and depth."""
    place = (4.3e-3, 3.1e-3, 1.15e-3)
    Path("three.toml").write_text(first_coils(3), encoding="utf-8")
    with coarse_maps(ContactMesh(12, 1.5)):
        pressed = response_map(load_design("three.toml"), depths=[place[2]], x=[place[0]], y=[place[1]])
        delta = pressed.delta[0, 0, 0]
        given = {str(name): float(value) for name, value in zip(delta.state.values, delta.values, strict=True)}
        (answer,) = positions(capsys, "--model", "three.toml", text_of(given), "--noise", "3e-7")
    assert answer["status"] == "located"
    # the map counts from there, a location from the board's
    origin = load_design("three.toml").indentation.origin_point
    near = min(answer["modes"], key=lambda mode: abs(mode["y_m"] - origin[1] - place[1]))
    # the spacing of the table and the meshes of its depths err by up to 1e-3 of δ, 1 % of the depth and 0.1 mm here
    assert near["x_m"] - origin[0] == pytest.approx(place[0], abs=0.1e-3)
    assert near["y_m"] - origin[1] == pytest.approx(place[1], abs=0.1e-3)
    assert near["depth_m"] == pytest.approx(place[2], rel=0.01)
