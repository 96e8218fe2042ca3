"""Recorders that are killed with signal 9 at random moments: whole files, at most one scan lost.

A campaign on an emulated board in virtual time runs in a process of its own, which tells over a pipe of every scan that
the board returned, before it is recorded. The processes are forked from one that has imported everything.
"""

import os
import random
import select
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from support.patience import PATIENCE

from coilarray.errors import HardwareError
from coilarray.hardware.record.campaign import Campaign
from coilarray.hardware.record.recorded_response import recorded_response
from coilarray.hardware.record.recording import open_recording

pytestmark = pytest.mark.skipif(os.name != "posix", reason="signal 9 and forks are for POSIX systems")

KILLS = 6
LATER = 10
"""Scans at most from those after which it is to be killed: a signal that comes late meets a board that waits for it."""
CAMPAIGN = Campaign(x=tuple(1e-3 * np.arange(-6, 7)), y=(-4e-3, 4e-3), depths=(0.5e-3, 1e-3), repeats=2)
SCRIPT = """
import os, signal, sys
from pathlib import Path

sys.path.insert(0, sys.argv[1])
from support.recorded_boards import configured, quick_board, session_of, two_coils
from coilarray.hardware.record.campaign import Campaign, EmulatedStage, run_campaign
from coilarray.hardware.record.recorder import open_recorder

DESIGN = two_coils()


def campaign(path, plan, left):
    with open_recorder(Path(path), resume=True) as recorder, quick_board(seed=3) as board:
        scan = board.reader.scan

        def telling():
            nonlocal left
            if left == 0:
                signal.pause()
            left -= 1
            scanned = scan()
            os.write(1, b".")
            return scanned

        board.reader.scan = telling
        recorder.start(session_of(board, configured(board), DESIGN), plan.to_json())
        run_campaign(plan, board.reader, EmulatedStage(board.emulator), recorder, board.emulator.clock)


for line in sys.stdin:
    path, scans, text = line.rstrip("\\n").split("\\t")
    child = os.fork()
    if child == 0:
        try:
            campaign(path, Campaign.from_json(text), int(scans))
            os.write(1, b"done")
        finally:
            os._exit(0)
    os.write(2, f"{child}\\n".encode())
    os.waitpid(child, 0)
    os.write(2, b"ended\\n")
"""


class Runner:
    """Runs campaigns in processes of their own, one at a time."""

    def __init__(self, folder):
        (folder / "runner.py").write_text(SCRIPT)
        program = [sys.executable, folder / "runner.py", os.path.dirname(os.path.dirname(__file__))]
        pipes = dict.fromkeys(("stdin", "stdout", "stderr"), subprocess.PIPE)
        environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}
        self.process = subprocess.Popen(program, bufsize=0, env=environment, **pipes)

    def run(self, path, kill=None):
        """Run, killed a time in s after a number of scans, and return what was reported."""
        most = -1 if kill is None else kill[0] + LATER
        self.process.stdin.write(f"{path}\t{most}\t{CAMPAIGN.to_json()}\n".encode())
        child = int(self.process.stderr.readline())
        reported = b""
        if kill is not None:
            scans, seconds = kill
            while len(reported) < scans:
                reported += self.process.stdout.read(1)
            time.sleep(seconds)
            os.kill(child, signal.SIGKILL)
        assert self.process.stderr.readline() == b"ended\n"
        while select.select([self.process.stdout], [], [], 0)[0]:
            reported += self.process.stdout.read(65536)
        return reported.decode()

    def close(self):
        self.process.stdin.close()
        self.process.wait(PATIENCE)
        for pipe in (self.process.stdout, self.process.stderr):
            pipe.close()


@pytest.fixture
def runner(tmp_path_factory):
    runner = Runner(tmp_path_factory.mktemp("runner"))
    yield runner
    runner.close()


def delta_of(path):
    with open_recording(path) as recording:
        recording.check()
        return recorded_response(recording)


@pytest.mark.slow
def test_killed_again_and_again_and_resumed(tmp_path, runner):
    whole = tmp_path / "whole.sqlite"
    assert runner.run(whole) == "." * (2 * CAMPAIGN.size) + "done"
    chance, path, before = random.Random(8), tmp_path / "run.sqlite", 0
    for _ in range(KILLS):  # up to 7 scans, and those of 12 ms: all of them take less than the whole campaign
        reported = runner.run(path, kill=(chance.randint(0, 7), chance.uniform(0.0, 12e-3)))
        assert set(reported) <= {"."}
        try:
            with open_recording(path) as recording:
                recording.check()
                count = recording.count()
        except HardwareError as error:  # killed before the first session began
            assert "no file" in str(error) or "it is empty" in str(error)  # noqa: PT017
            assert (reported, before) == ("", 0)
            count = 0
        assert before + len(reported) - count in (0, 1)  # a scan that came but was not added yet
        before = count
    assert 0 < before < 2 * CAMPAIGN.size
    assert runner.run(path).endswith("done")
    resumed, undisturbed = delta_of(path), delta_of(whole)
    for name in ("depth", "y", "x", "state", "delta", "delta_std", "base_inductance", "doubtful"):
        np.testing.assert_array_equal(resumed[name].values, undisturbed[name].values)  # to the last bit
    with open_recording(path) as recording:
        assert len(recording.positions()) == CAMPAIGN.size
        assert len(recording.sessions) > KILLS / 2  # the others were killed before theirs began
    assert sorted(one.name for one in tmp_path.iterdir()) == ["run.sqlite", "whole.sqlite"]
