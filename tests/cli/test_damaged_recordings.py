"""``scan-info --verify`` and ``--recover``: what is damaged is named, and what is whole is saved."""

import shutil
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from support.command_line import runner, successes
from support.quick_recordings import campaign_file, stream_file
from support.recorded_boards import changed, without_checksums

from coilarray.compute.checksum import with_checksums
from coilarray.compute.netcdf import save_dataset
from coilarray.hardware.record.campaign import Campaign
from coilarray.hardware.record.recorded_response import recorded_response
from coilarray.hardware.record.recording import open_recording

PLAN = Campaign(x=(0.0, 4e-3), y=(0.0, 2e-3), depths=(1e-3,), scans=2)
scan_info, record = successes("scan-info")
refused = runner("scan-info")[1]


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
    without_checksums(stream)
    assert "can be read; an older version wrote them, without checksums" in scan_info(capsys, stream, "--verify")
    assert record(capsys, stream, "--verify")["checksums"] is False


def test_damaged_scans_are_named_and_the_others_recovered(capsys, stream, tmp_path):
    before = scans_of(stream)
    changed(stream, "UPDATE sample SET lsb = lsb + 1 WHERE scan = 3", "UPDATE scan SET time = time + 1e-6 WHERE id = 8",
            "DELETE FROM sample WHERE scan = 10")  # fmt: skip
    assert "scan 3: its checksum is wrong" in refused(capsys, stream)
    assert f"{stream} is damaged: scans 3, 8, 10 of 12." in refused(capsys, stream, "--verify")
    data, out = stream.read_bytes(), tmp_path / "out.sqlite"
    assert f"wrote {out}: 9 of 12 scans; lost: scans 3, 8, 10 of 12\n" in scan_info(capsys, stream, "--recover", out)
    assert scans_of(out) == [scan for number, scan in enumerate(before, start=1) if number not in (3, 8, 10)]
    assert stream.read_bytes() == data
    scan_info(capsys, out, "--verify")


def test_a_page_that_is_overwritten_costs_its_scans(capsys, tmp_path, made):
    """Four kilobytes of noise in the middle of the scans: all that lie on other pages are saved."""
    path = stream_file(tmp_path / "long.sqlite", 400, noise=1e-6)
    before, data = scans_of(path), bytearray(path.read_bytes())
    pages = [start for start in range(0, len(data), 4096) if data.count(b"stream", start, start + 4096) > 20]
    data[pages[1] : pages[1] + 4096] = np.random.default_rng(0).bytes(4096)
    path.write_bytes(data)
    assert "damaged: scans " in refused(capsys, path, "--verify")
    found = record(capsys, path, "--recover", tmp_path / "out.sqlite")
    kept = scans_of(tmp_path / "out.sqlite")
    assert kept == [scan for number, scan in enumerate(before, start=1) if number not in found["lost_scans"]]
    assert 300 < len(kept) == found["scans"] < 400


def test_a_position_that_lost_a_scan_is_to_be_measured_again(capsys, campaign, tmp_path):
    changed(campaign, "UPDATE scan SET depth = 2e-3 WHERE id = 8", "UPDATE self_test SET time = 0")
    out = tmp_path / "out.sqlite"
    printed = scan_info(capsys, campaign, "--recover", out)
    assert "lost: scan 8 of 16" in printed
    assert "1 positions of the campaign lack a scan: coilarray campaign --resume" in printed
    assert "is not complete: 1 of 4 positions are not measured yet" in refused(capsys, out, "--to", "nc")
    with open_recording(out) as recording:
        response = recorded_response(recording, partial=True)
    assert np.isnan(response.delta).sum() == 2  # the two coils, at one position


def test_what_hangs_on_a_lost_row_is_lost_too(capsys, campaign, tmp_path):
    changed(campaign, "UPDATE position SET x = x + 1e-3 WHERE id = 2")
    assert "damaged: scans 5, 6, 7, 8 of 16; position 2." in refused(capsys, campaign, "--verify")
    changed(campaign, "UPDATE session SET port = 'other'")
    assert "it has no session" in refused(capsys, campaign, "--recover", tmp_path / "out.sqlite")
    assert not (tmp_path / "out.sqlite").exists()


def test_a_recovery_replaces_nothing_without_being_told_to(capsys, stream, tmp_path):
    out = tmp_path / "out.sqlite"
    out.write_text("mine")
    assert "--force replaces it" in refused(capsys, stream, "--recover", out)
    assert out.read_text() == "mine"
    assert "nothing is lost" in scan_info(capsys, stream, "--recover", out, "--force")
    assert scans_of(out) == scans_of(stream)
    assert "must name another file than the recording" in refused(capsys, stream, "--recover", stream, "--force")
    assert "cannot be given together" in refused(capsys, stream, "--recover", out, "--verify")
    assert "there is no file" in refused(capsys, tmp_path / "none.sqlite", "--recover", tmp_path / "x.sqlite")
    assert "cannot write" in refused(capsys, stream, "--recover", tmp_path / "none" / "x.sqlite")


def test_files_with_one_checksum_at_their_end(capsys, tmp_path):
    path = tmp_path / "map.nc"
    dataset = xr.Dataset({"delta": ("x", np.arange(5.0))})
    save_dataset(dataset, path)
    assert scan_info(capsys, path, "--verify") == f"{path}: is as its checksum says\n"
    data = bytearray(path.read_bytes())
    data[data.index(np.float64(3.0).tobytes())] ^= 1
    path.write_bytes(data)
    assert "is damaged, or was changed by another program: its checksum is wrong" in refused(capsys, path, "--verify")
    dataset.to_netcdf(path, engine="h5netcdf")
    assert "carries no checksum: it is cut, or another program or a person" in scan_info(capsys, path, "--verify")
    assert "cannot read" in refused(capsys, tmp_path / "none.nc", "--verify")
    table = tmp_path / "table.csv"
    table.write_text(with_checksums("a,b\n1,2\n"))
    assert scan_info(capsys, table, "--verify") == f"{table}: is as its checksum says\n"
    table.write_text(table.read_text().replace("1,2", "1,3"))
    assert "line 2 is damaged" in refused(capsys, table, "--verify")
    table.write_text("a,b\n1,2\n")
    assert "carries no checksum" in scan_info(capsys, table, "--verify")
    path.with_suffix(".txt").write_text("text")
    assert "is not a recording" in refused(capsys, path.with_suffix(".txt"), "--verify")
