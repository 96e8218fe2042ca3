"""No room for a file: every command that writes ends in one line and exit code 2, and leaves nothing half-written.

Each is refused twice: a file may have no byte at all, which stops it at its first file, and 6 kB, which stops it later,
where what it writes is larger. What each writes without a limit is tested with the command.
"""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from support.command_line import runner
from support.every_command import BOARD, PICTURES, SLOW, WRITES, WRITES_NOTHING, command_of, write_inputs
from support.made_up import made_up_distortion, made_up_ellipses
from support.no_room import file_limit, small_disk

import coilarray.paper.distortion
import coilarray.studies.calibrate.calibration
from coilarray.cli.main import COMMANDS

run, refused = runner()


@pytest.fixture(scope="module")
def inputs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("inputs")
    write_inputs(folder)
    return folder


def content():
    return {path: path.read_bytes() for path in Path().rglob("*") if path.is_file()}


@pytest.mark.usefixtures("own_folder")
@pytest.mark.parametrize(
    "case",
    [
        pytest.param(one, marks=[pytest.mark.slow] * (one[-1] in SLOW), id=f"{command_of(one[1:])} {one[-1]}")
        for one in WRITES
    ],
)
def test_a_command_that_may_not_write_leaves_everything_as_it_was(capsys, inputs, monkeypatch, case):
    large, *command = case
    monkeypatch.setenv("COILARRAY_THREADS", "1")  # pictures are drawn in this process, which has the limit
    # half a minute each; what they write is theirs all the same
    monkeypatch.setattr(coilarray.paper.distortion, "distortion", made_up_distortion)
    monkeypatch.setattr(coilarray.studies.calibrate.calibration, "evaluate_model", made_up_ellipses)
    shutil.copytree(inputs, Path(), dirs_exist_ok=True)
    before = content()
    for size in (6000,) if command[-1] in PICTURES else (0, 6000) if large else (0,):
        with file_limit(size):
            line = refused(capsys, *command)
        assert "cannot write" in line or "cannot use" in line or "cannot read" in line
        left = {path: data for path, data in content().items() if path.name != "study.lock"}
        assert left == before


def test_every_command_is_looked_at():
    written = {command_of(case) for _, *case in WRITES}
    assert written | WRITES_NOTHING == set(COMMANDS)
    assert not written & WRITES_NOTHING


@pytest.mark.usefixtures("own_folder")
def test_a_full_disk_ends_in_one_line_and_what_was_there_stays(capsys, inputs, monkeypatch):
    monkeypatch.setenv("COILARRAY_THREADS", "1")
    shutil.copytree(inputs, Path(), dirs_exist_ok=True)
    with small_disk(Path("disk"), 16 * 4096) as disk:
        for name, command in (
            ("x.nc", ("view", "bare.toml", "--spacing-mm", "2", "--out")),
            ("x.nc", ("board", "info", "campaign.sqlite", "--out")),
            ("x.svg", ("export", "starter", "--to", "svg", "--out")),
            ("x.vtm", ("view", "starter", "--out")),
            ("x.sqlite", ("board", "measure", *BOARD, "--scans", "5", "--out")),
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
