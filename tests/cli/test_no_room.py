"""No room for a file: every command that writes ends in one line and exit code 2, and leaves nothing half-written.

Each is refused twice: a file may have no byte at all, which stops it at its first file, and 6 kB, which stops it later,
where what it writes is larger. What each writes without a limit is tested with the command.
"""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import tomli_w
from support.board_text import board as kicad_text
from support.board_text import path
from support.command_line import runner
from support.made_up import made_up_distortion, made_up_ellipses
from support.no_room import file_limit, small_disk
from support.quick_recordings import GRID, campaign_file, quick_map, stream_file
from support.recorded_boards import WIRING_TEXT, two_coils_document

import coilarray.localize.distortion
import coilarray.studies.calibrate.calibration
from coilarray.cli.main import COMMANDS
from coilarray.compute.netcdf import save_dataset
from coilarray.design.bundled import read
from coilarray.hardware.record.live_log import read_log

run, refused = runner()

BOARD = ("two.toml", "--wiring", "wiring.toml")
AT = ("--x-mm", "-6.64", "--y-mm", "0", "--depth-mm", "0.5")
PITCH = ("--vary", "array.pitch_mm=12:14:3", "--workers", "1")
READ = ("two.toml", "--recording", "rest.sqlite", "--speed", "1000", "--no-locate")
FIELD = ("field", "bare.toml", "--spacing-mm", "4", "--out")
TARGET = ("target", "ball.toml", "--ideal", "--distance-mm", "1:4:4")
CALIBRATE = ("calibrate", "gast2020", "published", "--unknown", "coils.hexagon.gap_mm=0.05:0.1", "--workers", "1")
FILM = ("--path-mm", "-3,0 3,1", "--depth-mm", "0.3", "--frames", "3", "--size", "160x90")
# whether it writes more than 6 kB in one file, and the command
WRITES = [
    (True, "init", "new.toml", "--from", "starter"),
    (False, "check", "starter", "--out", "rules.csv"),
    (True, "export", "starter", "--to", "svg", "--out", "b.svg"),
    (True, "export", "starter", "--to", "kicad", "--out", "board"),
    (True, "export", "starter", "--to", "gerber", "--out", "b.zip"),
    (True, "export", "starter", "--to", "dxf", "--out", "b.dxf"),
    (True, "export", "starter", "--to", "stl", "--out", "b.stl"),
    (False, "import", "two.kicad_pcb", "--out", "new.toml"),
    (True, "check", "starter", "--picture", "rules.png"),
    (True, "view", "starter", "--vtk", "v.vtm"),
    (True, "matrix", "bare.toml", "--out", "m.nc"),
    (True, "matrix", "bare.toml", "--out", "m.s1p"),
    (True, *FIELD, "f.nc"),
    (False, *FIELD, "f.vtr"),
    (True, *FIELD, "f.nc", "--large"),
    (False, "impedance", "bare.toml", "--out", "i.csv"),
    (True, "indent", "two.toml", "--depth-mm", "0.5", "--out", "d.nc"),
    (True, "response", "two.toml", *AT, "--out", "r.nc"),
    (True, "response", "two.toml", *AT, "--plot", "r.png"),
    (True, "indent", "two.toml", "--depth-mm", "0.5", "--plot", "d.png"),
    (True, "impedance", "bare.toml", "--plot", "i.png"),
    (False, *TARGET, "--out", "t.csv"),
    (True, *TARGET, "--plot", "t.png"),
    (True, *TARGET, "--maps", "m.png"),
    (True, *CALIBRATE, "--out", "folder"),
    (True, *CALIBRATE, "--plot", "c.png"),
    (True, "distortion", "gast2020", "--out", "d.nc"),
    (True, "distortion", "gast2020", "--plot", "d.png"),
    (False, "fit", "quick.nc", "--out", "model.json"),
    (True, "fit", "quick.nc", "--plot", "fit.svg"),
    (False, "sweep", "starter", *PITCH, "--quantity", "span_mm", "--out", "s.csv"),
    (True, "sweep", "starter", *PITCH, "--quantity", "span_mm", "--plot", "s.png"),
    (True, "optimize", "starter", *PITCH, "--goal", "minimize span_mm", "--trials", "3"),
    (False, "optimize", "starter", "worst_k", "--template", "goal.toml"),
    (True, "tolerance", "starter", "-q", "span_mm", "--samples", "8", "--out", "t.json", "--workers", "1"),
    (True, "tolerance", "starter", "-q", "span_mm", "--samples", "8", "--plot", "t.png", "--workers", "1"),
    (False, "tolerance", "--template", "tolerance.toml"),
    (True, "board", "two.toml", "--noise", "rest.sqlite", "--plot", "n.png"),
    (True, "measure", *BOARD, "--scans", "5", "--out", "run.sqlite"),
    (True, "campaign", *BOARD, *AT, "--out", "run.sqlite"),
    (True, "scan-info", "campaign.sqlite", "--to", "nc", "--out", "c.nc"),
    (True, "scan-info", "rest.sqlite", "--recover", "whole.sqlite"),
    (False, "scan-info", "rest.sqlite", "--to", "csv", "--out", "c.csv"),
    (False, "calibrate-board", "rest.sqlite", "--out", "board.toml"),
    (True, "compare", "campaign.sqlite", "quick.nc", "--replicates", "0", "--out", "folder"),
    (False, "live", *READ, "--log", "log.csv"),
    (False, "live", *READ, "--log", "log.nc"),
    (True, "compare", "campaign.sqlite", "quick.nc", "--picture", "c.png"),
    (True, "view", "starter", "--screenshot", "v.png"),
    (True, "view", "two.toml", *FILM, "--movie", "v.gif"),
    (True, "report", "bare.toml", "--out", "folder"),
    (True, "view", "starter", "--html", "v.html"),
]
# these take long to draw, and are only stopped later: s.png and n.png, which are written alike, at their first byte too
PICTURES = {"c.png", "d.png", "i.png", "m.png", "r.png", "rules.png", "t.png"}
SLOW = PICTURES | {"folder", "m.s1p", "r.nc", "v.gif", "v.html", "v.png"}
WRITES_NOTHING = {"locate", "noise", "studio", "docs"}
BALL = """[target]
shape = "sphere"
diameter_mm = 8
material = "aluminium"
distances_mm = [1, 2, 3, 4]
x_mm = [-2, 2]
y_mm = [-2, 2]
step_mm = 2
"""


@pytest.fixture(scope="module")
def inputs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("inputs")
    text = read("gast_fem")  # one coil, without elastomer: the quickest of all
    bare = text[: text.index("[[elastomer]]")] + text[text.index("[circuit]") : text.index("[assumed]")]
    (folder / "bare.toml").write_text(bare, encoding="utf-8")
    (folder / "ball.toml").write_text(bare + BALL, encoding="utf-8")
    (folder / "two.toml").write_text(tomli_w.dumps(two_coils_document()), encoding="utf-8")
    (folder / "wiring.toml").write_text(WIRING_TEXT, encoding="utf-8")
    stream_file(folder / "rest.sqlite", 30, noise=1e-7)
    campaign_file(folder / "campaign.sqlite", noise=1e-7)
    spiral = [(0, 0), (4, 0), (4, 4), (0, 4), (0, 1), (3, 1), (3, 3), (1, 3), (1, 2)]
    two = path(*spiral), path(*[(x + 8, y) for x, y in spiral], net="2")
    (folder / "two.kicad_pcb").write_text(kicad_text(*two), encoding="utf-8")
    save_dataset(quick_map(np.array(GRID.x), np.array(GRID.y)), folder / "quick.nc")
    return folder


def content():
    return {path: path.read_bytes() for path in Path().rglob("*") if path.is_file()}


@pytest.mark.usefixtures("own_folder")
@pytest.mark.parametrize(
    "case",
    [pytest.param(one, marks=[pytest.mark.slow] * (one[-1] in SLOW), id=f"{one[1]} {one[-1]}") for one in WRITES],
)
def test_a_command_that_may_not_write_leaves_everything_as_it_was(capsys, inputs, monkeypatch, case):
    large, *command = case
    monkeypatch.setenv("COILARRAY_THREADS", "1")  # pictures are drawn in this process, which has the limit
    # half a minute each; what they write is theirs all the same
    monkeypatch.setattr(coilarray.localize.distortion, "distortion", made_up_distortion)
    monkeypatch.setattr(coilarray.studies.calibrate.calibration, "evaluate_model", made_up_ellipses)
    shutil.copytree(inputs, Path(), dirs_exist_ok=True)
    before = content()
    for size in (6000,) if command[-1] in PICTURES else (0, 6000) if large else (0,):
        with file_limit(size):
            line = refused(capsys, *command)
        assert "cannot write" in line or "cannot use" in line or "cannot read" in line
        left = {path: data for path, data in content().items() if path.name != "study.lock"}
        assert left == before


@pytest.mark.usefixtures("own_folder")
def test_a_log_that_finds_no_room_in_the_end_stays_as_its_lines(capsys, inputs):
    shutil.copytree(inputs, Path(), dirs_exist_ok=True)
    before = content()
    assert run(capsys, "live", *READ)[0] == 0  # keeps its table of responses, which would find no room before the log
    with file_limit(6000):  # room for the lines, and not for the netCDF file that they become
        code, _, err = run(capsys, "live", *READ, "--log", "log.nc")
    assert (code, err) == (2, "coilarray: error: cannot write log.nc: File too large.\n")
    assert content().keys() - before.keys() == {Path("log.nc.csv")}
    assert read_log(Path("log.nc.csv")).sizes["scan"] == 30


def test_every_command_is_looked_at():
    written = {case[1] for case in WRITES}
    assert written | WRITES_NOTHING == set(COMMANDS)
    assert not written & WRITES_NOTHING


@pytest.mark.usefixtures("own_folder")
def test_a_full_disk_ends_in_one_line_and_what_was_there_stays(capsys, inputs, monkeypatch):
    monkeypatch.setenv("COILARRAY_THREADS", "1")
    shutil.copytree(inputs, Path(), dirs_exist_ok=True)
    with small_disk(Path("disk"), 16 * 4096) as disk:
        for name, command in (
            ("x.nc", ("field", "bare.toml", "--spacing-mm", "2", "--out")),
            ("x.nc", ("scan-info", "campaign.sqlite", "--to", "nc", "--out")),
            ("x.svg", ("export", "starter", "--to", "svg", "--out")),
            ("x.vtm", ("view", "starter", "--vtk")),
            ("x.sqlite", ("measure", *BOARD, "--scans", "5", "--out")),
        ):
            kept = disk / "kept"
            kept.write_bytes(bytes(13 * 4096))
            line = refused(capsys, *command, disk / name)
            assert "full" in line or "No space left" in line or "disk I/O error" in line
            assert [path.name for path in disk.iterdir()] == ["kept"]
            assert kept.read_bytes() == bytes(13 * 4096)


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device that is full")
def test_output_that_cannot_be_written_is_one_line():
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    with Path("/dev/full").open("w", encoding="utf-8") as full:
        done = subprocess.run(
            [sys.executable, "-m", "coilarray", "check", "starter", "--json"],
            check=False, stdout=full, stderr=subprocess.PIPE, text=True, env=environment,
        )  # fmt: skip
    assert done.returncode == 2
    assert done.stderr == "coilarray: error: cannot write the output: No space left on device.\n"


def test_a_kernel_that_cannot_be_kept_is_compiled_all_the_same(own_folder, monkeypatch):
    numba = pytest.importorskip("numba")
    if numba.config.DISABLE_JIT:
        pytest.skip("numba is switched off")
    from coilarray.electromagnetics.kernels.compiled import kernel

    monkeypatch.setattr(numba.config, "CACHE_DIR", str(own_folder))

    def twice(x):
        return 2 * x

    with file_limit(0):
        assert kernel(twice)(21.0) == 42.0
    assert not [path for path in own_folder.rglob("*") if path.is_file()]
