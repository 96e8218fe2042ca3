"""The command calibrate: what it prints, its files, and mistakes; its campaigns are in tests/studies."""

import json
from pathlib import Path

import pytest
from support.command_line import runner
from support.made_up import made_up_ellipses

import coilarray.studies.calibrate.calibration as calibration
from coilarray.compute.netcdf import save_dataset
from coilarray.design.bundled import read
from coilarray.paper.ellipse_model import model_to_json, published_map, published_model

run, refused = runner("calibrate")
GAP = "coils.hexagon.gap_mm"


@pytest.fixture
def quick(monkeypatch, tmp_path, pictures_of_nothing):
    """Instead of a map the ellipses of Table A1, wider with the gap."""
    monkeypatch.setattr(calibration, "evaluate_model", made_up_ellipses)
    monkeypatch.chdir(tmp_path)


@pytest.mark.slow
def test_ellipses_of_table_a1_or_of_a_file(capsys, quick):
    options = ("--unknown", f"{GAP}=0.05:0.1", "--workers", "1", "--cache", "kept")
    code, out, err = run(capsys, "gast2020", "published", *options, "--out", "fit", "--plot", "fit.svg")
    assert (code, err) == (0, "")
    row = next(line.split() for line in out.splitlines() if line.startswith(GAP))
    assert float(row[3]) == pytest.approx(0.08, rel=1e-3)
    for name in ("calibration.html", "calibration.nc", "calibrated.toml", "unknowns.csv", "data.csv"):
        assert f"wrote {Path('fit') / name}" in out
        assert (Path("fit") / name).is_file()
    kept = Path("fit/calibrated.toml")
    # the file that was calibrated, with its comments; only what was fitted is another value, and no longer assumed
    before, after = read("gast2020").splitlines(), kept.read_text(encoding="utf-8").splitlines()
    gone = [line for line in before if line not in after]
    assert [line.split(" = ")[0] for line in gone] == ["gap_mm", f'"{GAP}"']
    (fitted,) = [line for line in after if line not in before]
    assert float(fitted.removeprefix("gap_mm = ")) == pytest.approx(0.08, rel=1e-3)
    Path("model.json").write_text(model_to_json(published_model()), encoding="utf-8")
    code, again, _ = run(capsys, "gast2020", "model.json", *options)
    assert code == 0
    assert row in [line.split() for line in again.splitlines()]


def test_as_json(capsys, quick):
    plan = """
    title = "two sizes"
    [[unknown]]
    entry = "coils.hexagon.gap_mm"
    low = 0.05
    high = 0.1
    [[alternative]]
    name = "trace"
    [[alternative.choice]]
    name = "0.1 mm"
    [[alternative.choice]]
    name = "too wide"
    set = { "coils.hexagon.trace_width_mm" = 5 }
    """
    Path("plan.toml").write_text(plan, encoding="utf-8")
    options = ("--workers", "1", "--cache", "kept", "--json")
    code, out, err = run(capsys, "gast2020", "--plan", "plan.toml", *options)
    assert (code, err) == (0, "")
    answer = json.loads(out)
    assert (answer["best"], answer["design"]) == ("0.1 mm", "gast2020")
    assert answer["values"][GAP] == pytest.approx(0.08, rel=1e-3)
    first, second = answer["ranking"]
    assert (first["probability"], second["probability"]) == (1.0, 0.0)
    assert "coils.hexagon" in second["problem"]
    assert "1 of 2 combinations have no fit." in answer["notes"]
    assert len(answer["data"]) == 93


@pytest.mark.parametrize(("arguments", "message"), [
    (("no_design",), "no_design"),
    (("gast2020", "none.nc", "--unknown", f"{GAP}=0.05:0.1"), "there is no file none.nc"),
    (("gast2020", "none.json", "--unknown", f"{GAP}=0.05:0.1"), "cannot read none.json"),
    (("gast2020", "none.sqlite", "--unknown", f"{GAP}=0.05:0.1"), "none.sqlite"),
    (("gast2020", "map.nc"), "the unknown entries must be given: --plan FILE, or --unknown KEY=LOW:HIGH"),
    (("gast2020", "map.nc", "--plan", "a", "--unknown", "b=1:2"), "--plan and --unknown cannot be given together"),
    (("gast2020", "--unknown", f"{GAP}=0.05:0.1:3"), "--unknown must be KEY=LOW:HIGH; got the values"),
    (("gast2020", "--unknown", "=0.05:0.1"), "--unknown must be KEY="),
    (("gast2020", "--unknown", f"{GAP}=0.1:0.05"), "must have an interval from low to high"),
    (("gast2020", "--plan", "no_plan"), "there is no calibration plan file no_plan"),
    (("gast2020", "--plan", "word.toml"), "word.toml: not valid TOML"),
    (("gast2020", "--unknown", "coils.hexagon.gap=0.05:0.1", "--workers", "1"), "did you mean gap_mm"),
    (("gast2020", "--calibration", "board.toml"), "--calibration is for a recording; published is not one"),
    (("gast2020", "--workers", "2", "--cluster", "tcp://a:1"), "cannot be given with --cluster"),
    (("gast2020", "--plot", "fit.gif"), "--plot must end in .png, .svg or .pdf"),
    (("gast_fem",), "not the board of `published` (Table A1 of the paper): it has no coil2, coil3;"),
    (("starter", "--unknown", "array.pitch_mm=9:11"), "coil1 must be within 1 mm of x = -13.4 mm, y = 0"),
])  # fmt: skip
def test_mistakes(capsys, quick, arguments, message):
    save_dataset(published_map(), Path("map.nc"))
    Path("word.toml").write_text("word", encoding="utf-8")
    assert message in refused(capsys, *arguments, "--cache", "kept")
