"""The command line: what it prints, its exit codes, and one line for every mistake."""

from __future__ import annotations

import csv
import json
import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from support.command_line import runner

from coilarray import couple_design, load_design
from coilarray.cli.main import app, main
from coilarray.viz import rendering_problem

pytestmark = pytest.mark.usefixtures("own_folder")
run, refused = runner()


@pytest.mark.slow
def test_help_names_every_command(capsys):
    code, out, _ = run(capsys)
    assert code == 0
    for command in (registered.name for registered in app.registered_commands):
        assert f"\n  {command} " in out
        code, text, _ = run(capsys, command, "--help")
        assert code == 0
        assert f"Example: coilarray {command}" in text


def test_version(capsys):
    code, out, _ = run(capsys, "--version")
    assert code == 0
    assert out.startswith("coilarray 0.")


@pytest.mark.slow
def test_init_writes_a_design_that_works(capsys):
    code, out, _ = run(capsys, "init")
    assert code == 0
    assert "design.toml" in out
    text = Path("design.toml").read_text(encoding="utf-8")
    assert text.count("#") > 30  # commented
    assert load_design("design.toml").name == "starter"
    assert "exists; --force replaces it" in refused(capsys, "init")
    assert run(capsys, "init", "--force", "--from", "gast2020")[0] == 0
    assert load_design("design.toml").name == "gast2020"
    assert "no bundled design 'x'" in refused(capsys, "init", "y.toml", "--from", "x")
    code, out, _ = run(capsys, "check", "design.toml")
    assert code == 0
    assert "all margins are kept" in out


@pytest.mark.slow
def test_matrix(capsys):
    code, out, _ = run(capsys, "matrix", "starter", "--json", "--out", "m.nc")
    assert code == 0
    data = json.loads(out)
    expected = couple_design(load_design("starter"))
    np.testing.assert_allclose(data["inductance_H"], expected.inductance, rtol=1e-12)
    np.testing.assert_allclose(data["coupling"], expected.coupling, rtol=1e-12)
    with xr.open_dataset("m.nc", engine="h5netcdf") as saved:
        np.testing.assert_allclose(saved.inductance, expected.inductance, rtol=1e-12)
        assert saved.attrs["design_hash"] == data["design_hash"]
        assert saved.inductance.attrs["units"] == "H"
    code, out, _ = run(capsys, "matrix", "starter", "--out", "m.csv")
    assert code == 0
    assert f"{float(expected.inductance[0, 0]) * 1e6:.4f}" in out
    with Path("m.csv").open(encoding="utf-8") as lines:
        assert len(list(csv.DictReader(lines))) == 6


@pytest.mark.slow
def test_field_plane_and_volume(capsys):
    code, out, _ = run(capsys, "field", "starter", "--spacing-mm", "2", "--json", "--current-mA", "2")
    assert code == 0
    data = json.loads(out)
    with xr.open_dataset("field.nc", engine="h5netcdf") as saved:
        assert saved.B.dims == ("x", "y", "z", "component")
        assert saved.z.values == pytest.approx([3e-3])
        assert float(abs(saved.B.sel(component="z")).max()) == pytest.approx(data["peak_Bz_T"])
        assert saved.attrs["active_current_A"] == 2e-3
    arguments = ("--coil", "coil1", "--z-mm", "1:3", "--spacing-mm", "2", "--out", "f.vtr", "--others-open")
    code, out, _ = run(capsys, "field", "starter", *arguments)
    assert code == 0
    assert "× 2 points, coil1 active" in out
    import pyvista

    grid = pyvista.read("f.vtr")
    assert grid.bounds[4:] == pytest.approx((1, 3))  # mm


@pytest.mark.slow
def test_impedance(capsys):
    code, out, _ = run(capsys, "impedance", "starter", "--points", "5", "--json", "--out", "s.nc", "--plot", "s.svg")
    assert code == 0
    data = json.loads(out)
    assert [row["state"] for row in data["states"]] == ["coil1", "coil2", "coil3"]
    assert len(data["sweep"]) == 15
    assert data["close_channels"]
    assert all(row["kept"] for row in data["ldc1614"])
    with xr.open_dataset("s.nc", engine="h5netcdf") as saved:
        assert saved.frequency.values[[0, -1]] == pytest.approx([1e5, 1e7])
        assert float(saved.impedance_imag[0, 0]) == pytest.approx(data["sweep"][0]["impedance_imag_ohm"], rel=1e-12)
    assert Path("s.svg").read_text(encoding="utf-8").startswith("<?xml")
    code, out, _ = run(capsys, "impedance", "starter", "--points", "2", "--out", "s.csv")
    assert code == 0
    assert "LDC1614: all limits are kept" in out
    assert "closer than 3 % in frequency" in out
    with Path("s.csv").open(encoding="utf-8") as lines:
        assert len(list(csv.DictReader(lines))) == 6


@pytest.mark.slow
def test_matrix_for_other_programs(capsys):
    for suffix, beginning in ((".cir", "* starter"), (".inp", "* starter"), (".s3p", "!")):
        assert run(capsys, "matrix", "starter", "--out", f"m{suffix}")[0] == 0
        assert Path(f"m{suffix}").read_text(encoding="utf-8").startswith(beginning)


@pytest.mark.slow
@pytest.mark.skipif(rendering_problem() is not None, reason=f"no 3-D rendering: {rendering_problem()}")
def test_view_screenshot(capsys):
    code, out, _ = run(capsys, "view", "starter", "--screenshot", "board.png")
    assert code == 0
    assert out == "wrote board.png\n"
    assert Path("board.png").read_bytes()[:4] == b"\x89PNG"


def _broken_design():
    """Three coils that share one layer pair and overlap."""
    main(["init", "d.toml"])
    text = Path("d.toml").read_text(encoding="utf-8")
    Path("d.toml").write_text(text.replace('[["L1", "L2"], ["L3", "L4"]]', '[["L1", "L2"]]'), encoding="utf-8")


@pytest.mark.slow
@pytest.mark.parametrize("command", ["report", "matrix", "field", "view"])
def test_a_broken_rule_is_refused_unless_allowed(capsys, command):
    _broken_design()
    capsys.readouterr()
    line = refused(capsys, command, "d.toml")
    # rule, nets, layer and margin
    assert re.search(r"clearance of coil1 – coil2 on layer L[12] is -.* mm at .* mm, margin -.* mm", line)
    assert sorted(path.name for path in Path().iterdir()) == ["d.toml"]
    if command == "matrix":
        # crossing coils on one layer: the numbers are still finite
        assert run(capsys, command, "d.toml", "--allow-violations")[0] == 0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("repot",), "No such command 'repot'"),
        (("report", "--bogus"), "--bogus"),
        (("report", "none.toml"), "there is no design file none.toml"),
        (("matrix", "starter", "--out", "m.xlsx"), "--out must end in .nc, .csv, .cir, .sub, .sNp or .inp; got m.xlsx"),
        (("field", "starter", "--out", "f.png"), "--out must end in .nc or .vtr; got f.png"),
        (("field", "starter", "--coil", "coil9"), "--coil must be one of coil1, coil2, coil3; got coil9"),
        (("field", "starter", "--spacing-mm", "0"), "--spacing-mm must be 1e-06 to 100000; got 0"),
        (("field", "starter", "--spacing-mm", "1e-320"), "--spacing-mm must be 1e-06 to 100000"),
        (("field", "starter", "--z-mm", "1e300"), "--z-mm must be a number or FROM:TO"),
        (("field", "starter", "--z-mm", "0:90000"), "points; at most 20000000 are allowed"),
        (("check", ""), "the name of a design file must not be empty"),
        (("field", "starter", "--spacing-mm", "x"), "'--spacing-mm'"),
        (("field", "starter", "--spacing-mm", "0.001"), "points; at most 20000000 are allowed"),
        (
            ("field", "starter", "--z-mm", "3:1"),
            "--z-mm must be a number or FROM:TO with FROM below TO, at most 100000; got '3:1'",
        ),
        (("field", "starter", "--z-mm", "nan"), "--z-mm must be a number"),
        (("field", "starter", "--current-mA", "inf"), "--current-mA must be at most 1e+09; got inf"),
        (("impedance", "starter", "--from-MHz", "5", "--to-MHz", "1"), "--from-MHz must be at least 1e-06 and below"),
        (("impedance", "starter", "--points", "1"), "--points must be 2 to 10000; got 1"),
        (("impedance", "starter", "--out", "s.txt"), "--out must end in .nc or .csv; got s.txt"),
        (("impedance", "starter", "--plot", "s.gif"), "--plot must end in .png, .svg or .pdf; got s.gif"),
        (("matrix", "starter", "--out", "m.s2p"), "a Touchstone file of 3 ports must end in .s3p; got m.s2p"),
        (("view", "starter", "--screenshot", "b.bmp"), "--screenshot must end in .png; got b.bmp"),
        (("matrix", "starter", "--out", "no/such/folder/m.csv"), "cannot write no/such/folder/m.csv: No such file"),
        (("init", "."), ". is a folder; name a file in it"),
        (("init", "no/such/folder/d.toml"), "cannot write no/such/folder/d.toml"),
    ],
)
def test_mistakes_are_one_line(capsys, arguments, message):
    assert message in refused(capsys, *arguments)
    assert list(Path().iterdir()) == []


def test_a_folder_that_cannot_be_written(capsys):
    Path("taken").write_text("a file, not a folder", encoding="utf-8")
    line = refused(capsys, "report", "starter", "--out", "taken")
    assert "cannot make the folder taken: a file has that name" in line
    assert Path("taken").read_text(encoding="utf-8") == "a file, not a folder"


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root may write everywhere")
def test_a_read_only_folder(capsys):
    folder = Path("locked")
    folder.mkdir(mode=0o555)
    assert "Permission denied" in refused(capsys, "report", "starter", "--out", "locked")
    assert list(folder.iterdir()) == []


@pytest.mark.slow
def test_a_folder_without_permission(capsys, monkeypatch):
    # root may write everywhere, so the refusal of the system is played
    original = tempfile.mkstemp

    def refuse(*arguments, **options):
        if Path(options["dir"]).name == "report":
            raise PermissionError(13, "Permission denied")
        return original(*arguments, **options)

    monkeypatch.setattr("coilarray.compute.files.tempfile.mkstemp", refuse)
    assert "cannot write report/coils.csv: Permission denied" in refused(capsys, "report", "starter")
    assert not [path for path in Path().rglob("*") if path.is_file()]


@pytest.mark.slow
def test_two_coils_in_one_place(capsys):
    main(["init", "d.toml", "--from", "gast_fem"])
    text = Path("d.toml").read_text(encoding="utf-8")
    first = text[text.index("[[array.placements]]") : text.index("[board]")]
    text = text.replace(first, first + first.replace('"coil1"', '"coil2"'))
    Path("d.toml").write_text(text, encoding="utf-8")
    capsys.readouterr()
    assert "clearance of coil1 – coil2" in refused(capsys, "matrix", "d.toml")
    assert "must be positive definite" in refused(capsys, "matrix", "d.toml", "--allow-violations")


@pytest.mark.slow
def test_a_failed_report_leaves_nothing_half_written(capsys, monkeypatch):
    # the disk is full while the netCDF file is written
    def full(dataset, path, **_):
        path.write_bytes(b"half of it")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("xarray.Dataset.to_netcdf", full)
    assert "No space left on device" in refused(capsys, "report", "starter")
    left = [path.name for path in Path().rglob("*") if path.is_file()]
    assert not [name for name in left if name.startswith(".") or name.endswith(".nc")]
    assert "report.html" not in left


@pytest.mark.slow
def test_the_installed_program():
    """The program in a process of its own: exit code, no traceback, and quick help without numba."""

    def python(script):
        return subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)

    done = python("import sys; from coilarray.cli.main import main; sys.exit(main(['report', 'none.toml']))")
    assert done.returncode == 2
    assert done.stderr.startswith("coilarray: error: ")
    done = python(
        "import sys; import coilarray, coilarray.cli.main; bad = {'vtk', 'pyvista', 'serial', 'numba', 'matplotlib'}"
        " & set(sys.modules); sys.exit(str(bad) if bad else 0)"
    )
    assert done.returncode == 0, done.stderr
