"""The commands measure and campaign when they are broken off, and with the real firmware behind a pseudo-terminal."""

import contextlib
import json
import os
import re
import subprocess
import sys

import numpy as np
import pytest
from support import recorded_boards
from support.command_line import runner, successes, toml_file
from support.firmware_host import FirmwareHost, needs_compiler
from support.patience import PATIENCE, until
from support.recorded_boards import dent, quick_board

from coilarray.cli import shared
from coilarray.cli.board import measure as measure_command
from coilarray.compute.netcdf import load_part
from coilarray.errors import HardwareError
from coilarray.hardware.board import microcontroller
from coilarray.hardware.record.recording import open_recording
from coilarray.hardware.wire.protocol import LinkTimes

pytestmark = pytest.mark.slow

board = recorded_boards.board
measure, measure_refused = runner("board", "measure")
measured, _ = successes("board", "measure")
measure_campaign, _ = runner("board", "campaign")
scan_info, scan_info_refused = runner("board", "info")


@pytest.fixture(autouse=True)
def _patient_with_the_board(monkeypatch, patient_writing):
    """The board is a thread of this process: where the process is stopped, it is as silent as a board that is gone."""
    times = LinkTimes(reply=PATIENCE, least_gap=PATIENCE, heartbeat=PATIENCE)
    monkeypatch.setattr(microcontroller.protocol, "LinkTimes", lambda: times)


@contextlib.contextmanager
def firmware(world=None):
    """Quick coils behind the firmware."""
    emulator = quick_board(world=world).emulator
    with FirmwareHost(emulator.bus, emulator.chain, emulator.clock, safe_words=b"\x11\x11") as host:
        yield emulator, host


@needs_compiler
def test_stream_of_a_microcontroller(board, tmp_path, capsys, monkeypatch):
    path = tmp_path / "run.sqlite"

    @contextlib.contextmanager
    def unplugging(_):
        """In place of a progress bar, pull the cable at the twentieth scan of the session."""
        yield lambda done, _: host.unplug() if done == 50 else None

    with firmware() as (emulator, host):
        out = measured(capsys, *board, "--port", host.port, "--scans", 30, "--rate", 50, "--out", path)
        with host.paused():
            assert emulator.chip.asleep
            assert emulator.chain.words == b"\x11\x11"
        # another session of the same firmware, in which the cable is pulled
        arguments = ("--port", host.port, "--scans", 1_000_000, "--rate", 50, "--out", path, "--resume")
        with monkeypatch.context() as patch:
            patch.setattr(shared, "progress_bar", unplugging)
            code, out_of_lost, err = measure(capsys, *board, *arguments)
        assert code == 2
        kept, error = err.splitlines()
        assert re.fullmatch(rf"coilarray: \d+ scans are kept in {path}; --resume continues from there", kept)
        assert error.startswith("coilarray: error: ")
        port = host.replug()
        scans = int(kept.split()[1])
        arguments = ("--port", port, "--scans", scans + 10, "--rate", 50, "--out", path, "--resume", "--json")
        code, out_of_last, _ = measure(capsys, *board, *arguments)
        assert code == 0
    assert "[emulator]" not in out + out_of_lost  # for the program it is a real board
    record = json.loads(out_of_last)
    assert (record["emulated"], record["scans"]) == (False, scans + 10)
    assert [session["scans"] for session in record["sessions"]] == [30, scans - 30, 10]
    assert len({session["boot"] for session in record["sessions"]}) == 2  # replugged: restarted
    assert all(state["bad"] == 0 for state in record["states"])
    # a board and an emulator do not go into one recording
    refusal = measure_refused(capsys, *board, "--rate", 50, "--out", path, "--resume")
    assert "its board was real; now it is emulated" in refusal


@needs_compiler
def test_campaign_of_a_microcontroller_that_restarts(board, tmp_path, capsys, monkeypatch):
    """A person at the keyboard, the firmware, and the indenter in between: the bell of `dent` comes out.

    The board that restarts is opened again, and the position measured anew: nobody has to run the command again.
    """
    path = tmp_path / "run.sqlite"
    plan = toml_file(tmp_path / "plan.toml", x_mm=[-3.0, 0.0, 2.0], y_mm=[0.0], depth_mm=[1.0], dwell_s=0.01)
    grid = ("--plan", plan, "--rate", 20)
    where, presses = 0.0, 0
    with firmware() as (emulator, host):

        def ask(text):
            nonlocal where, presses
            with host.paused():
                if text.startswith("Move"):
                    where = float(re.search(r"x = (\S+),", text)[1]) * 1e-3
                elif text.startswith("Press"):
                    presses += 1
                    emulator.indenter.press(where, 0.0, 1e-3)
                else:
                    emulator.indenter.lift()
            if text.startswith("Press") and presses == 2:
                host.reset()

        monkeypatch.setattr(measure_command, "_ask", ask)
        # quick coils do not feel each other, which the self-test misses
        code, _, err = measure_campaign(capsys, *board, *grid, "--port", host.port, "--out", path, "--ignore-self-test")
    assert code == 0
    assert err.splitlines() == [f"{k} of 3 positions are measured." for k in range(4)]
    assert presses == 4
    with open_recording(path) as recording:
        assert len({session.identity.boot for session in recording.sessions}) == len(recording.sessions) == 2
    scan_info(capsys, path, "--out", tmp_path / "run.nc")
    delta = load_part(tmp_path / "run.nc").delta.sel(state="coil1").values.ravel()
    expected = [dent("coil1", x, 0.0, 1e-3) for x in (-3e-3, 0.0, 2e-3)]
    # the losses have 9e-4 of δ; a code at 20 scans/s is 4e-8 of the frequency as well
    np.testing.assert_allclose(delta, expected, rtol=1e-3, atol=2e-7)


def started(board, *arguments):
    program = [sys.executable, "-c", "from coilarray.cli.main import run; run()", "board", "campaign"]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    return subprocess.Popen([*program, *map(str, (*board, *arguments))], **pipes)


def has_scans(path, count):
    """Whether a recording, which may not be there yet, has some scans."""
    with contextlib.suppress(HardwareError), open_recording(path) as recording:
        return recording.count() >= count


@pytest.mark.skipif(os.name != "posix", reason="signals are for POSIX systems")
def test_broken_off_and_resumed(board, tmp_path, capsys):
    """A kill by signal 9 is tested with the recorder, and Ctrl-C within a process."""
    path = tmp_path / "run.sqlite"
    # so long that it is not over before the signal, however late this process is to send it
    x, y = np.linspace(-6, 6, 200).tolist(), np.linspace(-4, 4, 100).tolist()
    plan = toml_file(tmp_path / "plan.toml", x_mm=x, y_mm=y, depth_mm=[0.5])
    grid = ("--plan", plan, "--out", path)
    with started(board, *grid, "--emulate", "noise=0") as process:
        # it computes the physics of the board first
        until(lambda: process.poll() is not None or has_scans(path, 20), within=5 * PATIENCE)
        process.terminate()
        _, err = process.communicate(timeout=PATIENCE)
    assert process.returncode == 143, err
    assert "Traceback" not in err
    with open_recording(path) as recording:
        recording.check()
        kept = recording.count()
    assert f"[emulator] coilarray: {kept} scans are kept in {path}; --resume continues from there" in err
    assert sorted(one.name for one in tmp_path.iterdir()) == ["plan.toml", "run.sqlite"]
    code, out, _ = scan_info(capsys, path)
    assert (code, "of 20000 positions are measured" in out) == (0, True)
    assert "is not complete" in scan_info_refused(capsys, path, "--out", tmp_path / "run.nc")
    assert scan_info(capsys, path, "--out", tmp_path / "run.nc", "--partial")[0] == 0
    part = load_part(tmp_path / "run.nc")
    assert kept // 2 - 1 <= int(part.delta.notnull().all("state").sum()) <= kept // 2
