"""The log beside a recording that was killed: whole, broken off, or damaged."""

from __future__ import annotations

import sqlite3
from contextlib import closing

import numpy as np
import pytest
from support.quick_recordings import DESIGN, killed_file
from support.recorded_boards import configured, quick_board, session_of
from support.refusals import refused

from coilarray.errors import HardwareError
from coilarray.hardware.record.recorder import open_recorder
from coilarray.hardware.record.recording import open_recording
from coilarray.hardware.record.recovery import find_damage, recover_recording
from coilarray.hardware.record.write_ahead_log import log_damage

HEADER, FRAME = 32, 24 + 4096


@pytest.fixture
def killed(tmp_path):
    """Path of a recording of 12 scans, and of its log, in which they are."""
    path = killed_file(tmp_path / "killed.sqlite", 12)
    return path, tmp_path / "killed.sqlite-wal"


def flip(log, at):
    data = bytearray(log.read_bytes())
    data[at] ^= 1
    log.write_bytes(data)


def count(path):
    with open_recording(path) as recording:
        recording.check()
        return recording.count()


def test_a_whole_log_is_read(killed):
    path, log = killed
    assert (len(log.read_bytes()) - HEADER) % FRAME == 0
    assert (log_damage(path), count(path)) == ("", 12)
    log.unlink()
    assert log_damage(path) == ""


def test_a_write_that_was_broken_off_is_no_damage(killed):
    path, log = killed
    log.write_bytes(log.read_bytes()[:-100])
    assert count(path) == 11


def test_frames_of_an_earlier_log_are_no_damage(tmp_path):
    """SQLite writes a new log over an old one, whose end stays behind it."""
    path, copy = tmp_path / "any.sqlite", tmp_path / "copy.sqlite"
    with closing(sqlite3.connect(path, isolation_level=None)) as connection:
        connection.execute("PRAGMA journal_mode = WAL")
        connection.execute("CREATE TABLE a (b)")
        for k in range(20):
            connection.execute("INSERT INTO a VALUES (?)", (f"{k}" * 3000,))
        long = (tmp_path / "any.sqlite-wal").stat().st_size
        connection.execute("PRAGMA wal_checkpoint")
        connection.execute("INSERT INTO a VALUES (1)")
        data = (tmp_path / "any.sqlite-wal").read_bytes()
        assert len(data) == long
        (tmp_path / "copy.sqlite-wal").write_bytes(data)
        assert log_damage(copy) == ""
        flip(tmp_path / "copy.sqlite-wal", HEADER + 1000)  # in the first frame, which is of the new one
        assert log_damage(copy).startswith("frame 1 of copy.sqlite-wal")


def test_a_recorder_that_goes_on_writes_at_the_end_of_its_log_alone(killed):
    """Over what a killed one left there, or over an older log, a write that is broken off would look like damage."""
    path, log = killed
    left, sizes = log.stat().st_size, []
    with open_recorder(path, resume=True) as recorder, quick_board(noise=1e-6) as board:
        recorder.start(session_of(board, configured(board), DESIGN))
        sizes.append(log.stat().st_size)
        for _ in range(300):
            recorder.add(board.reader.scan(), "stream")
            sizes.append(log.stat().st_size)
    assert sizes[0] < left / 2  # the session alone
    grown = np.diff(sizes)
    assert (grown != 0).all()
    assert (grown < 0).sum() == 1  # it was taken into the file
    assert count(path) == 312


@pytest.mark.parametrize(
    ("at", "text"),
    [
        (3, "the head of killed.sqlite-wal: its checksum is wrong"),  # magic number
        (17, "the head of"),  # salt
        (HEADER + 20 * FRAME, "frame 21 of killed.sqlite-wal: its checksum is wrong"),  # page number
        (HEADER + 20 * FRAME + 9, "frame 21 of"),  # salt, as if of an earlier log
        (HEADER + 20 * FRAME + 18, "frame 21 of"),  # checksum
        (HEADER + 20 * FRAME + 999, "frame 21 of"),  # page
    ],
)
def test_a_flipped_bit_is_refused_and_what_is_before_it_recovered(killed, tmp_path, at, text):
    path, log = killed
    flip(log, at)
    kept = log.read_bytes(), path.read_bytes()
    refused(HardwareError, f"is damaged: {text}", count, path)
    with pytest.raises(HardwareError, match=text), open_recorder(path, resume=True):
        pass
    assert (log.read_bytes(), path.read_bytes()) == kept
    if at < HEADER:  # nothing of the log can be read, and all is in it
        refused(HardwareError, "not a recording: it is empty", find_damage, path)
        return
    assert any("what is behind it is lost" in one for one in find_damage(path).others)
    damage = recover_recording(path, tmp_path / "new.sqlite")
    assert 0 < count(tmp_path / "new.sqlite") < 12
    assert any(text in one for one in damage.others)
