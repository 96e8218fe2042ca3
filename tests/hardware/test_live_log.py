"""Logs of a live display: what stands in them, what a kill leaves, and what is never replaced."""

import csv
import os
import signal
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr
from support.refusals import refused

from coilarray.compute.checksum import with_checksums
from coilarray.compute.netcdf import load_part
from coilarray.errors import OutputError
from coilarray.hardware.record.live_log import check_log, open_log, read_log
from coilarray.hardware.record.live_tracking import LiveReading, LiveState
from coilarray.localize.inverse import Location, Mode
from coilarray.localize.presses import Press

STATES = ("coil1", "coil2")
FOUND = Location("found", modes=(Mode(1e-3, -2e-3, 5e-4, np.diag([1e10, 4e10, 1e2]), 0.5),))
"""Standard deviations of 10 and 5 µm; that of the depth, 0.1 m, counts as unknown."""


def reading(number, *, location=None, press=None, temperature=20.5, delta=(1e-4, None)):
    states = (LiveState("coil1", delta[0], "good"), LiveState("coil2", delta[1], "bad", ("watchdog",)))
    return LiveReading(
        number, 7.0 + number, 0.25 * number, states, 0, location, "", 1e-5, 4.0, 0, press, 1.7e9 + number, temperature
    )


def written(path, *readings, temperature=True, **options):
    with open_log(path, STATES, emulated=True, temperature=temperature, attributes={"design": "two"}, **options) as log:
        for one in readings:
            log.add(one)
    return path


PRESSED = reading(1, location=FOUND, press=Press(3, 0.25, None, 1e-4, FOUND))


def test_a_line_for_every_scan(tmp_path):
    lines = written(tmp_path / "run.csv", reading(0), PRESSED).read_text().splitlines()
    assert lines.pop().startswith("# coilarray checksum of 3 lines: ")
    rows = list(csv.DictReader(lines))
    first, second = rows
    assert first.pop("checksum") != second.pop("checksum")
    assert first == {
        "time_s": "0.0", "unix_s": "1700000000.0", "sequence": "0", "emulated": "1", "coil1": "0.0001", "coil2": "",
        "coil1 verdict": "good", "coil2 verdict": "bad", "status": "", "x_m": "", "y_m": "", "depth_m": "",
        "sigma_x_m": "", "sigma_y_m": "", "sigma_depth_m": "", "press": "", "temperature_C": "20.5",
    }  # fmt: skip
    assert [second[name] for name in ("status", "x_m", "y_m", "depth_m", "press")] == [
        "found", "0.001", "-0.002", "0.0005", "3"
    ]  # fmt: skip
    assert (float(second["sigma_x_m"]), float(second["sigma_y_m"])) == pytest.approx((1e-5, 5e-6))
    assert second["sigma_depth_m"] == ""


def test_without_a_thermometer_there_is_no_column(tmp_path):
    path = written(tmp_path / "run.csv", reading(0, temperature=None), temperature=False)
    assert "temperature_C" not in path.read_text()
    assert "temperature" not in read_log(path)


def test_netcdf_has_the_same(tmp_path):
    found = load_part(written(tmp_path / "run.nc", reading(0), PRESSED, reading(2, temperature=None)))
    assert os.listdir(tmp_path) == ["run.nc"]  # the lines are gone
    xr.testing.assert_equal(
        found, read_log(written(tmp_path / "run.csv", reading(0), PRESSED, reading(2, temperature=None)))
    )
    np.testing.assert_array_equal(found.delta, [[1e-4, np.nan]] * 3)
    np.testing.assert_array_equal(found.verdict, [[0, 2]] * 3)
    np.testing.assert_array_equal(found.press, [0, 3, 0])
    np.testing.assert_array_equal(found.temperature, [20.5, 20.5, np.nan])
    np.testing.assert_array_equal(found.x, [np.nan, 1e-3, np.nan])
    assert found.status.values.tolist() == ["", "found", ""]
    assert (found.attrs["design"], int(found.attrs["emulated"])) == ("two", 1)
    assert (found.x.attrs["units"], found.temperature.attrs["units"]) == ("m", "degC")


def test_a_log_without_a_scan(tmp_path):
    assert load_part(written(tmp_path / "run.nc")).sizes == {"scan": 0, "state": 2}


@pytest.mark.parametrize("name", ["run.csv", "run.nc"])
def test_an_error_keeps_what_was_measured(tmp_path, name):
    def interrupted():
        with open_log(tmp_path / name, STATES, emulated=False, temperature=True, attributes={}) as log:
            log.add(reading(0))
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    path = tmp_path / name
    assert (load_part(path) if path.suffix == ".nc" else read_log(path)).sizes["scan"] == 1


KILLED = """
import os, signal, sys
from pathlib import Path
sys.path[:0] = sys.argv[1:3]
from test_live_log import STATES, open_log, reading
with open_log(Path(sys.argv[3]), STATES, emulated=True, temperature=True, attributes={}) as log:
    for k in range(500):
        log.add(reading(k))
    os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.mark.slow
def test_a_kill_leaves_every_line(tmp_path):
    path = tmp_path / "run.nc"
    here = Path(__file__).parent
    ended = subprocess.run([sys.executable, "-c", KILLED, str(here), str(here.parent), str(path)], check=False)
    assert ended.returncode == -signal.SIGKILL
    lines = tmp_path / "run.nc.csv"
    refused(OutputError, "run.nc.csv is cut: its last line", read_log, lines)
    assert read_log(lines, cut=True).sizes["scan"] == 500
    refused(OutputError, "the lines of a log that was not finished, exists", check_log, path)
    lines.write_text(lines.read_text()[:-20])  # as a power cut may leave it
    found = read_log(lines, cut=True)
    assert (found.sizes["scan"], found.attrs["cut"]) == (499, 1)


def test_nothing_is_replaced_without_force(tmp_path):
    path = written(tmp_path / "run.csv", reading(0))
    refused(OutputError, "run.csv exists; name another log, or replace it with --force", check_log, path)
    refused(OutputError, "exists", written, path)
    assert read_log(written(path, reading(0), reading(1), force=True)).sizes["scan"] == 2


def test_a_log_that_is_cut_is_read_only_where_that_is_asked_for(tmp_path):
    path = written(tmp_path / "run.csv", reading(0), reading(1))
    whole, full = path.read_text(), read_log(path)
    assert full.attrs["cut"] == 0
    xr.testing.assert_identical(read_log(path, cut=True), full)
    head, first, second, end = whole.splitlines(keepends=True)
    for text, scans in ((head, 0), (head + first, 1), (head + first + second[:-1], 1), (whole[:-1], 2)):
        path.write_text(text)
        refused(OutputError, "run.csv is cut", read_log, path)
        assert read_log(path, cut=True).sizes["scan"] == scans
    for text in (head + second + first, head + second, head + first + first, first + second):
        path.write_text(text)  # also of a log that is cut
        refused(OutputError, "damaged|not a log", read_log, path, cut=True)
        path.write_text(text + end)
        refused(OutputError, "damaged", read_log, path)


def test_a_log_of_which_a_line_could_not_be_written_stays_cut(tmp_path, monkeypatch):
    def full():
        with open_log(tmp_path / "run.csv", STATES, emulated=True, temperature=True, attributes={}) as log:
            log.add(reading(0))
            monkeypatch.setattr(log, "_file", SimpleNamespace(name="run.csv", write=no_room))
            log.add(reading(1))

    def no_room(text):
        raise OSError(28, "No space left on device")

    refused(OutputError, "cannot write run.csv: No space", full)
    refused(OutputError, "run.csv is cut", read_log, tmp_path / "run.csv")
    assert read_log(tmp_path / "run.csv", cut=True).sizes["scan"] == 1


@pytest.mark.parametrize(("old", "new", "message"), [
    (",20.5", "", "line 3: must have 17 columns; got 16"),
    ("0.25,", "soon,", "line 3, column time_s: must be a number; got 'soon'"),
    (",1,1,0.0001", ",1.5,1,0.0001", "line 3, column sequence: must be a whole number; got '1.5'"),
    ("bad", "odd", "line 3, column coil2 verdict: must be good, doubtful, bad; got 'odd'"),
])  # fmt: skip
def test_a_line_that_no_log_has_is_told(tmp_path, old, new, message):
    path = written(tmp_path / "run.csv", reading(0), reading(1))
    whole = path.read_text()
    texts = [line.rpartition(",")[0] for line in whole.splitlines()[:-1]]
    assert old in texts[-1]
    assert with_checksums("\n".join(texts)) == whole
    path.write_text(with_checksums("\n".join([*texts[:-1], texts[-1].replace(old, new, 1)])))
    refused(OutputError, f"run.csv, {message}", read_log, path)


def test_a_line_that_has_changed_is_told(tmp_path):
    path = written(tmp_path / "run.csv", reading(0), reading(1))
    path.write_text(path.read_text().replace("0.0001", "0.0003", 1))
    refused(OutputError, "run.csv, line 2 is damaged, or lines before it .*: its checksum is wrong", read_log, path)


def test_what_is_no_log(tmp_path):
    for text in ("", "time_s,coil1\n0,1\n", "\x00"):
        (tmp_path / "run.csv").write_text(text)
        refused(OutputError, "run.csv is not a log of a live display", read_log, tmp_path / "run.csv")
    refused(OutputError, "cannot read", read_log, tmp_path / "none.csv")
    refused(OutputError, "cannot write", written, tmp_path / "none" / "run.csv")
