"""Temperatures from files as Linux has them, beside scans, and in recordings that older and newer versions read."""

import numpy as np
import pytest
from support.patience import until
from support.quick_recordings import DESIGN, stream_file
from support.recorded_boards import configured, quick_board, session_of
from support.refusals import refused

from coilarray.errors import HardwareError
from coilarray.hardware.emulator import Drift
from coilarray.hardware.record import recorder as module
from coilarray.hardware.record.recorded_response import recorded_series, series_csv
from coilarray.hardware.record.recorder import file_temperature, open_recorder, record_stream, thermometer
from coilarray.hardware.record.recording import open_recording

# as the kernel's documentation of the sensor DS18B20 shows it
SLAVE = "72 01 4b 46 7f ff 0e 10 57 : crc=57 YES\n72 01 4b 46 7f ff 0e 10 57 t=23125\n"


@pytest.mark.parametrize(
    ("text", "celsius"),
    [("42375\n", 42.375), ("-1500\n", -1.5), (SLAVE, 23.125), (SLAVE.replace("=23", "=-3"), -3.125), ("21.5", 21.5)],
)
def test_what_linux_and_users_write(tmp_path, text, celsius):
    (tmp_path / "sensor").write_text(text)
    assert file_temperature(tmp_path / "sensor") == pytest.approx(celsius)


@pytest.mark.parametrize("text", ["", "warm", "nan", "inf.", "999999999", SLAVE.replace("YES", "NO"), "21.5 °C"])
def test_what_is_no_temperature(tmp_path, text):
    (tmp_path / "sensor").write_text(text)
    refused(HardwareError, "must hold a temperature from -100 to 300 °C", file_temperature, tmp_path / "sensor")


def test_a_file_that_is_not_there(tmp_path):
    refused(HardwareError, "No such file or directory", file_temperature, tmp_path / "sensor")
    refused(HardwareError, "cannot read the temperature", file_temperature, tmp_path)


def test_it_is_read_again_and_outdated_when_it_is_gone(tmp_path, monkeypatch):
    monkeypatch.setattr(module, "PERIOD", 0.01)
    sensor = tmp_path / "sensor"
    sensor.write_text("20000")
    with thermometer(sensor) as temperature:
        assert temperature() == 20.0
        sensor.write_text("21000")
        until(lambda: temperature() == 21.0)
        monkeypatch.setattr(module, "_OUTDATED", 0.1)
        sensor.unlink()
        until(lambda: temperature() is None)
        sensor.write_text("22000")
        until(lambda: temperature() == 22.0)


def warming(path, scans=20, thermometer=None, resume=False):
    """Record a board that warms by 0.1 K/s, with the emulator's temperature or another one."""
    with open_recorder(path, resume=resume) as recorder, quick_board(drift=Drift(rate=0.1)) as board:
        recorder.start(session_of(board, configured(board), DESIGN), thermometer=thermometer or board.thermometer)
        record_stream(board.reader, recorder, scans=scans)
    return path


def test_the_emulators_temperature_is_recorded(tmp_path):
    with open_recording(warming(tmp_path / "run.sqlite")) as recording:
        recording.check()
        scans = list(recording.scans())
        series = recorded_series(recording)
    took = scans[1].scan.time - scans[0].scan.time  # it is read as the scan arrives
    expected = [25.0 + 0.1 * (one.scan.time + took) for one in scans]
    np.testing.assert_allclose(series.temperature, expected, atol=2e-3)
    assert series.temperature.attrs["units"] == "degC"
    first = series_csv(series).splitlines()[:2]
    assert first[0] == "time_s,coil1,coil2,temperature_C,checksum"
    assert first[1].split(",")[-2] == f"{expected[0]:.3f}"


def test_without_a_thermometer_there_is_no_column(tmp_path):
    with open_recording(stream_file(tmp_path / "run.sqlite", 5)) as recording:
        assert [one.temperature for one in recording.scans()] == [None] * 5
        series = recorded_series(recording)
    assert "temperature" not in series.coords
    assert series_csv(series).splitlines()[0] == "time_s,coil1,coil2,checksum"
