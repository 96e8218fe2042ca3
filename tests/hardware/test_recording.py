"""Recordings, with temperatures: what is written is read back to the last bit, and nothing else is taken for one."""

import os
import re
import signal
import time
from dataclasses import asdict, replace
from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from support.patience import until
from support.recorded_boards import (
    QuickWorld,
    changed,
    configured,
    quick_board,
    session_of,
    two_coils,
)
from support.refusals import refused

from coilarray.cli.position import read_readings
from coilarray.compute.netcdf import load_part, save_dataset
from coilarray.errors import HardwareError, LocalizeError, OutputError
from coilarray.hardware.record import recorder as recorder_module
from coilarray.hardware.record.recorded_response import recorded_series, series_csv
from coilarray.hardware.record.recorder import file_temperature, open_recorder, record_stream, thermometer
from coilarray.hardware.record.recording import (
    SCHEMA,
    GridPlace,
    Recording,
    iso_time,
    open_recording,
    summarize_recording,
)
from coilarray.hardware.scan.readings import RawSample, RawScan, SampleFault, read_scan
from coilarray.hardware.wire.buses import BoardRestarted

DESIGN = two_coils()
WORD = st.integers(0, 0xFFFF)
SAMPLE = st.one_of(
    st.builds(RawSample, WORD, WORD, WORD),
    st.sampled_from([RawSample(0, 0, 0, fault) for fault in SampleFault if fault]),
)
TIME = st.floats(0, 1e9)


@pytest.fixture
def board():
    with quick_board() as board:
        yield board


@pytest.fixture
def path(tmp_path):
    return tmp_path / "run.sqlite"


@pytest.fixture
def session(board):
    return session_of(board, configured(board), DESIGN)


@pytest.fixture
def recorder(path, session):
    """A recorder that is started."""
    with open_recorder(path) as recorder:
        recorder.start(session)
        yield recorder


def recorded(path, session, scans=(), plan=None, *, resume=False):
    with open_recorder(path, resume=resume) as recorder:
        recorder.start(session, plan)
        for scan in scans:
            recorder.add(scan, "stream")
    return path


def read(path, function):
    with open_recording(path) as recording:
        return function(recording)


def checked_sequences(path):
    with open_recording(path) as recording:
        recording.check()
        return [one.scan.sequence for one in recording.scans()]


def raw_scan(session, sequence, time=0.0):
    samples = (RawSample(0x0179, 0x82F3, 0x0048),) * 2
    return RawScan(sequence, time, 1.7e9, session.settings.hash, session.identity.boot, samples)


@pytest.mark.slow
@settings(max_examples=30, suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow])
@given(st.lists(st.tuples(st.integers(0, 2**32 - 1), TIME, TIME, SAMPLE, SAMPLE), max_size=6))
def test_every_bit_comes_back(tmp_path_factory, session, rows):
    path = tmp_path_factory.mktemp("run") / "a #?%20 run.sqlite"  # a name that must be quoted in an address
    scans = [RawScan(*row[:3], session.settings.hash, session.identity.boot, row[3:]) for row in rows]
    recorded(path, session, scans)
    assert [one.name for one in path.parent.iterdir()] == [path.name]  # nothing is left beside it
    with open_recording(path) as recording:
        assert [one.scan for one in recording.scans()] == scans
        assert [one.number for one in recording.scans()] == list(range(1, len(scans) + 1))
        assert recording.count() == len(scans)
        (kept,) = recording.sessions
        assert asdict(kept) == asdict(session)
        assert (kept.wiring, kept.design_hash, recording.emulated) == ("two_coils", DESIGN.digest, True)
        assert recording.design.digest == DESIGN.digest
        recording.check()


def test_self_tests_come_back(path, session, monkeypatch):
    days = iter([1.7e9, 1.8e9])  # the computer's own clock may be set back in between
    monkeypatch.setattr(recorder_module, "time", SimpleNamespace(time=lambda: next(days), monotonic=time.monotonic))
    with open_recorder(path) as recorder:
        recorder.start(session)
        recorder.add_self_test((), ())
        recorder.add_self_test(["coil1 is “odd”"], ["this\n", "that"])
    with open_recording(path) as recording:
        first, second = summarize_recording(recording)["self_tests"]
    nothing = {"session": 0, "time": iso_time(1.7e9), "passed": True, "symptoms": [], "findings": []}
    assert first == nothing
    found = {"passed": False, "symptoms": ["coil1 is “odd”"], "findings": ["this\n", "that"]}
    assert second == nothing | {"time": iso_time(1.8e9)} | found


def test_read_while_it_is_written_by_one_writer_at_a_time(path, board, recorder):
    for k in range(3):
        recorder.add(board.reader.scan(), "stream")
        assert read(path, Recording.count) == k + 1  # another connection, as of another process
    with pytest.raises(OutputError, match=r"another program is recording into .*run\.sqlite"), open_recorder(path):
        pass


def test_stream(board, session, recorder):
    reported = []
    assert record_stream(board.reader, recorder, scans=5, progress=lambda *now: reported.append(now)) == 5
    assert reported[-1] == (5, 5)
    count = record_stream(board.reader, recorder, seconds=2.0, progress=lambda *now: reported.append(now))
    assert reported[-1][1] == 20
    assert count == pytest.approx(2.0 / session.settings.period(), abs=1.5)  # the first and the last may just fit
    before = board.emulator.clock.now()
    record_stream(board.reader, recorder, scans=4, interval=0.5)
    # four scans, each half a second after the one before: three intervals and one scan
    assert board.emulator.clock.now() - before == pytest.approx(1.5 + session.settings.period(), rel=0.05)
    assert recorder.count() == 5 + count + 4
    assert board.emulator.seen.state is None  # closing the stream has grounded the coils


def test_resume(path, board, session):
    recorded(path, session, [board.reader.scan()])
    later = replace(session, identity=replace(session.identity, boot=7), started=session.started + 60)
    with open_recorder(path, resume=True) as recorder:
        recorder.start(later)
        recorder.add(replace(board.reader.scan(), boot=7), "stream")
    with open_recording(path) as recording:
        assert [one.session for one in recording.scans()] == [0, 1]
        assert [one.scan.boot for one in recording.scans()] == [session.identity.boot, 7]
        assert np.diff(recorded_series(recording).time) >= 0


@pytest.mark.parametrize(
    ("change", "plan", "message"),
    [
        (lambda s: replace(s, design_hash="0" * 64), "{}", "its design was .* now it is 000000000000"),
        (lambda s: replace(s, wiring="another"), "{}", "its wiring was two_coils; now it is another"),
        (lambda s: replace(s, settings=replace(s.settings, rcount=100)), "{}", "its hash of settings was .{4}; now it"),
        (lambda s: replace(s, settings=replace(s.settings, clock=43e6)), "{}", "its (hash of settings|clock) was"),
        (lambda s: replace(s, identity=replace(s.identity, emulated=False)), "{}", "its board was emulated; now it is"),
        (lambda s: s, None, "it is of a campaign"),
        (lambda s: s, '{"x": 1}', "it is of another campaign"),
    ],
)
def test_resume_refuses_something_else(path, session, change, plan, message):
    recorded(path, session, plan="{}")
    refused(HardwareError, message, recorded, path, change(session), (), plan, resume=True)
    assert len(read(path, lambda recording: recording.sessions)) == 1


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        (lambda s: replace(s, boot=s.boot ^ 1), BoardRestarted, "the board restarted"),
        (lambda s: replace(s, configuration=s.configuration ^ 1), HardwareError, "the board was set to"),
        (lambda s: replace(s, samples=s.samples[:1]), HardwareError, "and 1 states"),
        (lambda s: replace(s, time=float("nan")), HardwareError, "finite times"),
        (lambda s: replace(s, received=float("inf")), HardwareError, "finite times"),
    ],
)
def test_scans_that_are_not_of_the_session(session, recorder, change, error, message):
    refused(error, message, recorder.add, change(raw_scan(session, 3)), "stream")
    assert recorder.count() == 0
    recorder.add(raw_scan(session, 3), "stream")


def overwritten(path):
    """Damage every page but the first."""
    data = bytearray(path.read_bytes())
    for start in range(4096, len(data), 4096):
        data[start : start + 200] = bytes(200)
    path.write_bytes(data)


WRONG_FILES = {
    "missing": (lambda path: path.unlink(), "there is no file"),
    "folder": (lambda path: (path.unlink(), path.mkdir()), "cannot read .*: it is a folder"),
    "text": (lambda path: path.write_text("state,delta\n" * 100), "is not a recording: file is not a database"),
    "other": (lambda path: (path.unlink(), changed(path, "CREATE TABLE a (id INTEGER)")), "of another program"),
    "newer": (
        lambda path: changed(path, f"PRAGMA user_version = {SCHEMA + 1}"),
        f"is a recording of schema {SCHEMA + 1}, which another version .* reads schema {SCHEMA}",
    ),
    "no table": (lambda path: changed(path, "DROP TABLE campaign"), "damaged: the table campaign is missing"),
    "cut off": (lambda path: os.truncate(path, 6000), "damaged"),
    "zeros": (overwritten, "damaged"),
}


@pytest.mark.parametrize("name", WRONG_FILES)
def test_wrong_files(path, session, name):
    spoil, message = WRONG_FILES[name]
    recorded(path, session, [raw_scan(session, k) for k in range(300)])
    spoil(path)
    refused(HardwareError, message, read, path, Recording.check)
    if name != "missing":
        before = path.read_bytes() if path.is_file() else None
        refused((HardwareError, OutputError), ".", recorded, path, session, resume=True)
        assert before is None or path.read_bytes() == before  # not touched


@pytest.mark.slow
@pytest.mark.parametrize(
    "statement",
    [
        "UPDATE session SET settings = '{}'",
        "UPDATE self_test SET symptoms = '[1]'",
        "UPDATE sample SET msb = 70000 WHERE scan = 2",
        "UPDATE scan SET time = 'x' WHERE id = 2",
        "UPDATE scan SET position = 5 WHERE id = 2",
        "DELETE FROM scan WHERE id = 2",
    ],
)
def test_changed_values_are_noticed(path, session, statement):
    with open_recorder(path) as recorder:
        recorder.start(session)
        recorder.add_self_test((), ())
        for k in range(3):
            recorder.add(raw_scan(session, k), "stream")
    changed(path, statement)
    refused(HardwareError, f"{re.escape(str(path))} is damaged", read, path, Recording.check)


@pytest.mark.parametrize("place", ["no folder/run.sqlite", "\0.sqlite", "/proc/self/run.sqlite"])
def test_files_that_cannot_be_written(tmp_path, place):
    shown = str(tmp_path / place).replace("\0", "�")  # an error is one printable line
    with pytest.raises(OutputError, match=f"cannot write {shown}"), open_recorder(tmp_path / place):
        pass
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("moment", ["BEGIN", "INSERT INTO sample", "COMMIT", "PRAGMA synchronous = NORMAL"])
def test_interrupted_within_a_write(path, session, recorder, moment):
    """Ctrl-C does not break a write off, and nothing hides it."""
    came = []

    def interrupt(statement):
        if statement.startswith(moment) and not came:
            came.append(statement)
            signal.raise_signal(signal.SIGINT)

    recorder._connection.set_trace_callback(interrupt)
    with pytest.raises(KeyboardInterrupt):
        recorder.add(raw_scan(session, 0), "stream")
    assert came
    recorder.add(raw_scan(session, 1), "stream")
    assert checked_sequences(path) == [0, 1]


def test_series(path, board, session):
    def scan(k):
        if k == 4:
            board.emulator.indenter.press(0.0, 0.0, 1e-3)
        if k == 6:
            board.emulator.world.dead = {"coil2"}
            board.emulator.indenter.lift()
        return board.reader.scan()

    scans = [scan(k) for k in range(8)]
    recorded(path, session, scans)
    with open_recording(path) as recording:
        series = recorded_series(recording, baseline=4)
        twice = recorded_series(recording, baseline=4, capacitances=240e-12, clock=2 * session.settings.clock)
        summary = summarize_recording(recording)
    reading = read_scan(scans[0], session.settings, session.capacitances)
    assert series.inductance[0].values.tolist() == [state.inductance for state in reading.states]
    # a code is 4e-8 of the frequency and so 8e-8 of L; the losses, which L alone does not know, have R²C/L = 9e-4 of δ
    np.testing.assert_allclose(series.delta.sel(state="coil1"), [0] * 4 + [0.8e-3] * 2 + [0] * 2, rtol=1e-3, atol=2e-7)
    assert np.isnan(series.delta.sel(state="coil2")).values.tolist() == [False] * 6 + [True] * 2
    assert series.verdict.sel(state="coil2").values.tolist() == [0] * 6 + [2] * 2
    xr.testing.assert_allclose(series.delta, twice.delta)  # capacitance and clock cancel
    np.testing.assert_allclose(twice.inductance, series.inductance / 2 / 4)  # L = 1/((2πf)² C)
    for name in ("msb", "lsb"):
        assert [getattr(sample, name) for sample in scans[5].samples] == series[name][5].values.tolist()
    assert series.time.values.tolist() == [scan.time - scans[0].time for scan in scans]
    assert (series.attrs["emulated"], series.attrs["design"]) == (1, "two_coils")
    assert (summary["scans"], summary["lost_scans"], summary["states"][1]["bad"]) == (8, 0, 2)
    assert "does not oscillate" in str(summary["states"][1]["reasons"])


def test_series_as_csv_is_what_locate_reads_and_comes_back_from_netcdf(tmp_path, path, board, session):
    series = read(recorded(path, session, [board.reader.scan() for _ in range(4)]), recorded_series)
    (tmp_path / "run.csv").write_text(series_csv(series))
    assert series_csv(series).splitlines()[0] == "time_s,coil1,coil2,checksum"  # without a thermometer
    readings = read_readings(str(tmp_path / "run.csv"))
    assert [reading["coil2"] for reading in readings] == series.delta.sel(state="coil2").values.tolist()
    assert [reading["time_s"] for reading in readings] == series.time.values.tolist()
    lines = series_csv(series).splitlines(keepends=True)
    assert lines[-1].startswith("# coilarray checksum of 5 lines: ")
    time, _, *others = lines[2].split(",")
    for text, message in (
        ([*lines[:2], ",".join([time, "0.1", *others]), *lines[3:]], "line 3 is damaged"),
        (lines[:-1], "is cut"), (lines[:-2] + lines[-1:], "lines at its end are missing"),
    ):  # fmt: skip
        (tmp_path / "run.csv").write_text("".join(text))
        refused(LocalizeError, message, read_readings, str(tmp_path / "run.csv"))
    save_dataset(series, tmp_path / "run.nc")
    xr.testing.assert_identical(load_part(tmp_path / "run.nc").load(), series)


def test_lost_scans_are_counted(path, session):
    summary = read(recorded(path, session, [raw_scan(session, k, k) for k in (0, 1, 4, 5, 7)]), summarize_recording)
    assert (summary["scans"], summary["lost_scans"], summary["seconds"]) == (5, 3, 7.0)


def test_noise_of_the_summary(path):
    noise = 1e-6  # of the frequency: 25 codes, so that rounding does not matter
    with quick_board(noise=noise, seed=1, world=QuickWorld()) as board:
        session = session_of(board, configured(board), DESIGN)
        recorded(path, session, [board.reader.scan() for _ in range(300)])
    for state in read(path, summarize_recording)["states"]:
        # L has twice the relative noise of f; 300 values give it to 5 %, of which this is three times
        assert state["relative_noise"] == pytest.approx(2 * noise, rel=0.15)
        assert state["inductance_H"] == pytest.approx(52e-6, rel=1e-3)  # the losses of the tank: 1/Q² = 5e-4


def test_positions(path, session):
    places = [GridPlace(k, 0, 1e-3, 0.0, 1e-3 * k) for k in range(3)]
    with open_recorder(path) as recorder:
        recorder.start(session, "{}")
        for place in places:
            position = recorder.begin(place)
            recorder.add(raw_scan(session, 0), "baseline", position=position, depth=0.0)
            if place.number != 1:
                recorder.finish(position)
        assert recorder.finished() == {0, 2}
        again = recorder.begin(places[0])
        with pytest.raises(OutputError, match="UNIQUE"):  # a place counts once
            recorder.finish(again)
    with open_recording(path) as recording:
        assert list(recording.positions().values()) == [places[0], places[2]]
        assert [one.place for one in recording.scans()] == places
        assert {one.depth for one in recording.scans()} == {0.0}


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
    refused(HardwareError, "No such file or directory", file_temperature, tmp_path / "sensor")
    (tmp_path / "sensor").write_text(text)
    refused(HardwareError, "must hold a temperature from -100 to 300 °C", file_temperature, tmp_path / "sensor")


def test_it_is_read_again_and_outdated_when_it_is_gone(tmp_path, monkeypatch):
    monkeypatch.setattr(recorder_module, "PERIOD", 0.01)
    sensor = tmp_path / "sensor"
    sensor.write_text("20000")
    with thermometer(sensor) as temperature:
        assert temperature() == 20.0
        sensor.write_text("21000")
        until(lambda: temperature() == 21.0)
        monkeypatch.setattr(recorder_module, "_OUTDATED", 0.1)
        sensor.unlink()
        until(lambda: temperature() is None)
        sensor.write_text("22000")
        until(lambda: temperature() == 22.0)


def warming(path, scans=20, thermometer=None, resume=False):
    """Record a board that warms by 0.1 K/s, with the emulator's temperature or another one."""
    with open_recorder(path, resume=resume) as recorder, quick_board(drift=0.1) as board:
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
