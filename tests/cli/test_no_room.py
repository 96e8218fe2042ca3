"""No room for a file: commands end in one line and exit code 2, and leave nothing half-written.

There is one for each way of writing: text, netCDF, pictures, boards, pages, folders and recordings.
"""

import os
import subprocess
import sys
from contextlib import contextmanager
from pathlib import Path

import pytest
import tomli_w
from support.command_line import runner
from support.recorded_boards import WIRING_TEXT, two_coils_document

from coilarray.design.bundled import read

pytestmark = pytest.mark.usefixtures("own_folder")
run, refused = runner()
BOARD = ("two.toml", "--wiring", "wiring.toml")
SPAN = ("--vary", "array.pitch_mm=12:14:3", "--workers", "1")
# limits in byte at which it is stopped, and the command: at its first file, and at one of more than 6 kB
ANY, BOTH, LATE = (0,), (0, 6000), (6000,)
WRITES = [
    (BOTH, "init", "new.toml", "--from", "starter"),
    (ANY, "check", "starter", "--out", "rules.csv"),
    (BOTH, "check", "starter", "--picture", "rules.png"),
    (BOTH, "export", "starter", "--to", "kicad", "--out", "board"),
    (BOTH, "export", "starter", "--to", "gerber", "--out", "b.zip"),
    (BOTH, "view", "starter", "--out", "v.vtm"),
    (BOTH, "view", "bare.toml", "--spacing-mm", "4", "--out", "f.nc"),
    (ANY, "impedance", "bare.toml", "--out", "i.csv"),
    (ANY, "optimize", "starter", *SPAN, "--goal", "minimize span_mm", "--trials", "3"),
    (BOTH, "tolerance", "starter", "-q", "span_mm", "--samples", "8", "--out", "t.json", "--workers", "1"),
    (BOTH, "board", "measure", *BOARD, "--scans", "5", "--out", "run.sqlite"),
    (LATE, "report", "bare.toml", "--out", "folder"),
]


@contextmanager
def file_limit(size):
    """Let no file of this process grow beyond a size in bytes within the block, as ``ulimit -f`` does.

    Python keeps no compiled module meanwhile, nor do its children: it would keep the beginning and load that later.
    """
    resource = pytest.importorskip("resource", reason="no limit of file sizes on this system")
    before = resource.getrlimit(resource.RLIMIT_FSIZE)  # Python ignores SIGXFSZ: a write fails instead
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "dont_write_bytecode", True)
        patch.setenv("PYTHONDONTWRITEBYTECODE", "1")
        resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
        try:
            yield
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, before)


def content():
    return {path: path.read_bytes() for path in Path().rglob("*") if path.is_file()}


@pytest.fixture(autouse=True)
def inputs(own_folder, monkeypatch):
    """Write the designs that the commands read; pictures are drawn in this process, which has the limit."""
    monkeypatch.setenv("COILARRAY_THREADS", "1")
    text = read("gast_fem")  # one coil, without elastomer: the quickest of all
    bare = text[: text.index("[[elastomer]]")] + text[text.index("[circuit]") : text.index("[assumed]")]
    texts = {"bare.toml": bare, "two.toml": tomli_w.dumps(two_coils_document()), "wiring.toml": WIRING_TEXT}
    for name, written in texts.items():
        Path(name).write_text(written, encoding="utf-8")


@pytest.mark.slow
@pytest.mark.parametrize("case", WRITES, ids=lambda case: f"{case[1]} {case[-1]}")
def test_a_command_that_may_not_write_leaves_everything_as_it_was(capsys, case):
    sizes, *command = case
    before = content()
    for size in sizes:
        with file_limit(size):
            line = refused(capsys, *command)
        assert "cannot write" in line or "cannot use" in line or "cannot read" in line
        # points of a search are kept one by one, and the same command goes on from them
        assert {path: data for path, data in content().items() if path.stem != "points"} == before


def test_a_full_disk_ends_in_one_line_and_what_was_there_stays(capsys):
    disk, size = Path("disk"), 16 * 4096
    disk.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", f"size={size}", "tmpfs", str(disk)]
    try:
        mounted = subprocess.run(mount, check=False, capture_output=True).returncode == 0
    except FileNotFoundError:
        mounted = False
    if not mounted:
        pytest.skip("no file system may be mounted here")
    try:
        kept = disk / "kept"
        kept.write_bytes(bytes(13 * 4096))
        for name, command in (
            ("x.nc", ("view", "bare.toml", "--spacing-mm", "2", "--out")),
            ("x.svg", ("export", "starter", "--to", "svg", "--out")),
            ("x.sqlite", ("board", "measure", *BOARD, "--scans", "5", "--out")),
        ):
            line = refused(capsys, *command, disk / name)
            assert "full" in line or "No space left" in line or "disk I/O error" in line
            assert [path.name for path in disk.iterdir()] == ["kept"]
            assert kept.read_bytes() == bytes(13 * 4096)
    finally:
        subprocess.run(["umount", str(disk)], check=True)


@pytest.mark.slow
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
