"""``board info --verify``: what is damaged is named."""

import shutil
from pathlib import Path

import pytest
from support.command_line import runner, successes
from support.recorded_boards import campaign_file, changed, stream_file

from coilarray.compute.files import sealed, with_checksums
from coilarray.hardware.record.campaign import Campaign
from coilarray.hardware.record.recording import open_recording

PLAN = Campaign(x=(0.0, 4e-3), y=(0.0, 2e-3), depths=(1e-3,), scans=2)
scan_info, record = successes("board", "info")
refused = runner("board", "info")[1]


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder = tmp_path_factory.mktemp("damaged")
    return stream_file(folder / "stream.sqlite", 12, noise=1e-6), campaign_file(folder / "campaign.sqlite", PLAN)


@pytest.fixture
def stream(made, tmp_path):
    return Path(shutil.copy(made[0], tmp_path))


@pytest.fixture
def campaign(made, tmp_path):
    return Path(shutil.copy(made[1], tmp_path))


def scans_of(path):
    with open_recording(path) as recording:
        recording.check()
        return [(scan.stage, scan.place, scan.scan) for scan in recording.scans()]


def test_a_whole_recording_is_as_its_checksums_say(capsys, stream):
    assert scan_info(capsys, stream, "--verify") == f"{stream}: 12 scans, which are as their checksums say\n"
    assert record(capsys, stream, "--verify") == {"file": str(stream), "checksums": True}


@pytest.mark.parametrize(("statement", "damage"), [
    ("UPDATE sample SET lsb = lsb + 1 WHERE scan = 3", "scan 3: its checksum is wrong"),
    ("UPDATE scan SET time = time + 1e-6 WHERE id = 8", "scan 8: its checksum is wrong"),
    ("DELETE FROM sample WHERE scan = 10", "scan 10"),
])  # fmt: skip
def test_a_damaged_scan_is_named(capsys, stream, statement, damage):
    changed(stream, statement)
    for option in ((), ("--verify",)):
        assert damage in refused(capsys, stream, *option)


def test_files_with_one_checksum_at_their_end(capsys, tmp_path):
    path = tmp_path / "board.toml"
    path.write_bytes(sealed(b"a = 1\n"))
    assert scan_info(capsys, path, "--verify") == f"{path}: is as its checksum says\n"
    path.write_bytes(path.read_bytes().replace(b"1", b"2", 1))
    assert "is damaged, or was changed by another program: its checksum is wrong" in refused(capsys, path, "--verify")
    path.write_bytes(b"a = 1\n")
    assert "carries no checksum: it is cut, or another program or a person" in scan_info(capsys, path, "--verify")
    assert "cannot read" in refused(capsys, tmp_path / "none.toml", "--verify")
    table = tmp_path / "table.csv"
    table.write_text(with_checksums("a,b\n1,2\n"))
    assert scan_info(capsys, table, "--verify") == f"{table}: is as its checksum says\n"
    table.write_text(table.read_text().replace("1,2", "1,3"))
    assert "line 2 is damaged" in refused(capsys, table, "--verify")
    table.write_text("a,b\n1,2\n")
    assert "carries no checksum" in scan_info(capsys, table, "--verify")
    path.with_suffix(".txt").write_text("text")
    assert "is not a recording" in refused(capsys, path.with_suffix(".txt"), "--verify")
