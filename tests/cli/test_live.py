"""The command ``live`` against the emulator, recordings, broken boards, a terminal, and a reader that goes away."""

import contextlib
import dataclasses
import itertools
import json
import os
import pty
import select
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from support import recorded_boards
from support.command_line import runner, toml_file
from support.contacts import coarse_maps
from support.emulated_reader import at_rest
from support.patience import PATIENCE, until
from support.recorded_boards import configured, quick_board, stream_file

from coilarray import load_design, noise_budget
from coilarray.cli import shared
from coilarray.cli.board import live as live_command
from coilarray.hardware.emulator import board as emulator
from coilarray.hardware.emulator.board import VirtualClock
from coilarray.hardware.record.live_tracking import LiveReading, LiveState
from coilarray.hardware.wire.buses import DeviceLost
from coilarray.response.map import response_map

run, refused = runner("board", "live")

FINGER = [(0.0, 0.0, 0.0, 0.0), (4.0, 1e-3, 0.0, 0.0), (4.5, 1e-3, 0.0, 1e-3), (90.0, 1e-3, 0.0, 1e-3)]
"""Lifted for the baseline, then pressed: time in s, x, y and depth in m."""


board = recorded_boards.board
FAST = ("--settings", "fast.toml")


def settings(**values):
    """Option for a file of settings."""
    return "--settings", toml_file(Path("settings.toml"), **values)


@pytest.fixture(scope="module", autouse=True)
def _coarse():
    """Coarse meshes for the board as it is emulated and for the table that its position is found with."""
    with coarse_maps():
        yield


@pytest.fixture(scope="module")
def kept(board):
    """Table for positions of one depth."""
    axis = np.linspace(-8e-3, 8e-3, 9)
    return response_map(load_design(str(board[0])), x=axis, y=axis)


@pytest.fixture
def table(kept, monkeypatch):
    monkeypatch.setattr(shared, "stored_table", lambda design, progress: kept)


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    """Sixty scans of the quick board, at rest for 4 s and then pressed."""
    return stream_file(tmp_path_factory.mktemp("run") / "run.sqlite", 60, noise=1e-7, path_of_finger=FINGER)


@pytest.fixture(scope="module")
def long_recording(tmp_path_factory):
    """A thousand scans, of which nobody waits for the last: at the board's own speed they take 98 s."""
    return stream_file(tmp_path_factory.mktemp("long") / "long.sqlite", 1000, noise=1e-7, path_of_finger=FINGER)


@pytest.fixture
def virtual_time(monkeypatch):
    """Emulated boards with a clock of their own: on a busy computer scans come late, and find the finger elsewhere."""
    monkeypatch.setattr(emulator, "PacedClock", VirtualClock)


@pytest.fixture(autouse=True)
def _in_a_folder_of_its_own(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    toml_file(Path("fast.toml"), replay_speed=0.0)


def ran(capsys, *arguments):
    """Run without an error, and return the lines."""
    code, out, err = run(capsys, *arguments)
    assert (code, err) == (0, "")
    return out.splitlines()


def answers_of(capsys, *arguments):
    return [json.loads(line) for line in ran(capsys, *arguments, "--json")]


@pytest.mark.slow
def test_a_recording_is_replayed(capsys, recording):
    answers = answers_of(capsys, "--recording", recording, *FAST, "--no-locate")
    assert [answer["emulated"] for answer in answers] == [True] * 60
    assert [answer["baseline_scans_missing"] for answer in answers[:11]] == [9, 8, 7, 6, 5, 4, 3, 2, 1, 0, 0]
    assert answers[0]["delta"] == {"coil1": None, "coil2": None}
    assert abs(answers[20]["delta"]["coil1"]) < 2e-6  # ten times the noise
    assert answers[-1]["delta"]["coil1"] == pytest.approx(0.8e-3 * np.exp(-1 / 64), rel=3e-3)  # Q: 1e-3 of it
    assert answers[-1]["rate_per_s"] == pytest.approx(19 / (answers[-1]["time_s"] - answers[-20]["time_s"]))
    assert {answer["position"] for answer in answers} == {None}
    assert set(answers[-1]["verdicts"].values()) == {"good"}


def test_presses(capsys, recording):
    answers = answers_of(capsys, "--recording", recording, *FAST, "--no-locate")
    assert "temperature_C" not in answers[0]  # the recording has none
    numbers = [answer["press"] and answer["press"]["number"] for answer in answers]
    first = numbers.index(1)
    assert numbers == [None] * first + [1] * (60 - first)
    # the finger moves from 4 s on by the board's clock, which began before the first scan; two scans take 0.2 s
    assert 3.9 < answers[first]["press"]["begin_s"] < 4.4
    assert answers[-1]["press"]["end_s"] is None
    assert answers[-1]["press"]["delta"] == pytest.approx(0.8e-3 * np.exp(-1 / 64), rel=3e-3)
    lines = ran(capsys, "--recording", recording, *FAST, "--no-locate")
    assert lines[-1].endswith(f"press 1 since {answers[first]['press']['begin_s']:.2f} s")


@pytest.mark.slow
def test_positions_of_a_recording(capsys, recording, board, table):
    """The quick board's bells are no response of the design: what counts is that the library is asked and answers."""
    answers = answers_of(capsys, board[0], "--recording", recording, *FAST)
    assert (answers[5]["position"], answers[20]["position"]["status"]) == (None, "nothing pressed")
    assert answers[-1]["position"]["status"] != "nothing pressed"
    assert "x_m" in answers[-1]["position"]
    # of each coil what the recording has, 2e-7 of L and that of ten scans: 18 values tell it to 17 %; the budget would
    # have 3e-7. The rest is common, with the clock of the board
    assert answers[-1]["noise"] == pytest.approx(2e-7 * np.sqrt(1.1), rel=0.35)
    common = [np.abs(change) for change in noise_budget(load_design(board[0])).common.values()]
    assert answers[-1]["common_noise"] == pytest.approx(np.sqrt(np.square(common).sum(axis=0)).max(), rel=0.01)


@pytest.mark.slow
@pytest.mark.usefixtures("virtual_time")
def test_the_emulator_is_located(capsys, board, table, monkeypatch):
    monkeypatch.setattr(live_command, "_LOCATE", 0.0)  # each scan: by the board's own clock they come in no time
    way = ((0.0, 4e-3, 2e-3, 0.0), (0.2, 4e-3, 2e-3, 1e-3))
    monkeypatch.setattr(live_command, "tour", lambda setup, start: [(start + at, *place) for at, *place in way])
    options = ("--rate", "40", "--scans", "40", *settings(baseline_scans=5, noise=2e-6))
    answers = answers_of(capsys, *board, *options)
    assert (len(answers), answers[4]["position"]["status"]) == (40, "nothing pressed")
    pressed = [one["position"] for one in answers[-20:]]
    x, y = load_design(str(board[0])).indentation.origin_point  # the path counts from it, positions from the board's
    for position in pressed:
        assert position["status"] == "located"
        near = min(abs(mode["x_m"] - x - 4e-3) + abs(abs(mode["y_m"] - y) - 2e-3) for mode in position["modes"])
        assert near < 0.5e-3  # two coils tell x and |y|


@pytest.mark.slow
@pytest.mark.usefixtures("virtual_time")
def test_without_a_path_a_finger_goes_round(capsys, board, monkeypatch):
    begun, tour = [], live_command.tour
    monkeypatch.setattr(live_command, "tour", lambda setup, start: begun.append(start) or tour(setup, start))
    answers = answers_of(capsys, *board, "--no-locate", "--rate", "30", "--scans", "75", *settings(baseline_scans=3))
    after = [(answer["time_s"] - begun[-1], answer["delta"]["coil1"]) for answer in answers[3:]]
    assert all(abs(delta) < 10e-6 for time, delta in after if time < 0.5)  # the finger comes down from then on
    assert max(abs(delta) for time, delta in after if time > 1.0) > 30e-6


@pytest.mark.slow
@pytest.mark.usefixtures("virtual_time")
def test_a_finger_that_presses_is_not_in_the_baseline(capsys, board):
    options = (
        "--no-locate",
        "--rate",
        "30",
        "--scans",
        "15",
        *settings(baseline_scans=5),
        "--emulate",
        "press=-6.64,0,1",
    )
    answers = answers_of(capsys, *board, *options)
    assert {answer["temperature_C"] for answer in answers} == {25.0}
    assert abs(answers[4]["delta"]["coil1"]) < 1e-5  # noise: ten times that of a scan at this rate
    # a conversion may have begun before the finger came
    assert all(answer["delta"]["coil1"] > 3e-4 for answer in answers[7:])


@pytest.mark.slow
def test_a_board_that_warms_is_at_room_temperature_when_it_is_opened(capsys, board):
    options = ("--no-locate", "--rate", "30", "--scans", "10", "--emulate", "drift=0.5")
    first, *_, last = [answer["temperature_C"] for answer in answers_of(capsys, *board, *options)]
    assert 25.0 <= first < last < 25.0 + 0.5 * PATIENCE


GONE = DeviceLost("the port /dev/ttyACM0 is gone.")


@pytest.mark.parametrize(
    ("after", "fault", "arguments", "code", "lines", "error"),
    [
        (3, GONE, (), 2, 4, f"coilarray: error: {GONE}\n"),  # one line says who answers
        (3, GONE, ("--json",), 2, 3, f"coilarray: error: {GONE}\n"),
        (5, KeyboardInterrupt(), ("--json",), 130, 5, "coilarray: interrupted\n"),
        (99, KeyboardInterrupt(), ("--scans", "2"), 0, 3, ""),
    ],
)
def test_every_end_leaves_the_board_at_rest(capsys, board, monkeypatch, after, fault, arguments, code, lines, error):
    """A quick board, which stops with an error after some scans."""
    quick = quick_board()
    scans = quick.reader.scans

    def failing_scans(interval=0.0):
        yield from itertools.islice(scans(interval), after)
        raise fault

    @contextlib.contextmanager
    def opened_board(options, design, *, real_time, progress=None):
        with quick:
            quick.reader.scans = failing_scans
            yield quick, configured(quick)

    monkeypatch.setattr(live_command, "opened_board", opened_board)
    ended, out, err = run(capsys, board[0], "--no-locate", *arguments)
    assert (ended, len(out.splitlines()), err) == (code, lines, error)
    assert at_rest(quick.emulator, quick.wiring)


@pytest.mark.slow
def test_a_reader_that_goes_away(capsys, recording, monkeypatch):
    def written(reading):
        raise BrokenPipeError

    dropped = []
    monkeypatch.setattr(live_command, "_lines", lambda text: written)
    monkeypatch.setattr(shared, "drop_output", lambda: dropped.append(True))
    assert run(capsys, "--recording", recording, "--no-locate", "--json") == (0, "", "")
    assert dropped == [True]


PROGRAM = [sys.executable, "-c", "from coilarray.cli.main import run; run()"]


def command(*arguments):
    return subprocess.Popen([*PROGRAM, *arguments], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def on_terminal(*arguments, keys=()):
    """Run on a terminal of its own; press each key, or none, once its text is shown, one after the other.

    Returns the exit code and what was shown before each key and after the last one.
    """
    here, there = pty.openpty()
    environment = {**os.environ, "TERM": "xterm", "COLUMNS": "120", "LINES": "30"}
    pipes = dict.fromkeys(("stdin", "stdout", "stderr"), there)
    process = subprocess.Popen([*PROGRAM, *map(str, arguments)], env=environment, close_fds=True, **pipes)
    os.close(there)
    shown, left = [b""], list(keys)

    def ended():
        if not select.select([here], [], [], 0.2)[0]:
            return False
        try:
            shown[-1] += os.read(here, 65536)
        except OSError:  # the other side has ended
            return True
        if left and left[0][0].encode() in shown[-1]:
            os.write(here, left.pop(0)[1].encode())
            shown.append(b"")
        return False

    try:
        until(ended, pause=0.0, within=5 * PATIENCE)  # a program is started for it
        code = process.wait(timeout=PATIENCE)
    finally:
        process.kill()  # which is nothing to one that has ended
        process.wait()
        os.close(here)
    assert left == []
    return code, *(text.decode(errors="replace") for text in shown)  # a key may come within a letter


@pytest.mark.slow
def test_bars_and_keys_on_a_terminal(long_recording):
    keys = [("█", "z"), ("scans without an indentation still", ""), ("noise of δ", "q")]
    code, first, *_ = on_terminal("board", "live", "--recording", long_recording, "--no-locate", keys=keys)
    assert code == 0  # by the key, as the recording takes 49 s
    for text in ("[emulator] coil1", "scans/s", "baseline: scans without an indentation still wanted: 9"):
        assert text in first
    drawn = [line for line in first.replace("\x1b[2K", "").splitlines() if "coil1" in line or "scans/s" in line]
    assert all("[emulator] " in line for line in drawn)


def test_screen_lines():
    states = (
        LiveState("coil1", 1e-3, "good"),
        LiveState("coil22", -5e-4, "doubtful", ("amplitude below 1.2 V",)),
        LiveState("coil3", None, "bad", ("under-range",)),
    )
    reading = LiveReading(7, 99.0, 1.5, states, 0, None, "too few", 1e-5, 3.4, 2)
    _, first, second, third, place, last = live_command.screen_lines(
        dataclasses.replace(reading, common_noise=4e-6), 1e-3
    )
    assert first.startswith("coil1    +1000.0 ")
    assert first.count("█") == 2 * second.count("█") == 40
    assert second.startswith("coil22    −500.0 ")
    assert second.endswith("doubtful: amplitude below 1.2 V")
    assert (third.split()[:2], third.count("█"), place) == (["coil3", "bad"], 0, "too few")
    assert third.endswith("bad: under-range")
    assert last.startswith("3.40 scans/s, 2 lost, noise of δ 10·10⁻⁶ of each coil, 4·10⁻⁶ common to all")
    assert live_command.plain_line(reading) == "1.500 s  coil1 +1000.0  coil22 −500.0  coil3 bad  too few"
    full = live_command.screen_lines(reading, 1e-4)
    assert full[1].count("█") == 40  # longer than the bar is the whole bar


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--port", "/dev/ttyNOTTHERE"), "/dev/ttyNOTTHERE"),
        (("--port", "nonsense"), "port 'nonsense' is not valid"),
        (("--recording", "text.sqlite"), "text.sqlite"),
        (("--recording", "RUN", "--port", "COM5"), "cannot be given with --port"),
        (("--recording", "RUN", "--rate", "30"), "cannot be given with --rate, which is for a board"),
        (("--scans", "0"), "--scans must be 1 to"),
        (("--recording", "RUN", "--out", "x.sqlite"), "--out records a board"),
        (
            ("--recording", "RUN", "--no-locate", "--reference", "coil9"),
            "a reference coil must be one of coil1, coil2; got 'coil9'",
        ),
        (("--plot", "--json"), "--plot cannot be given with --json"),
        (("none.toml",), "none.toml"),
        (("--rate", "1e9", "--no-locate"), "--rate must be at most"),
        (("--emulate", "noise=x"), "--emulate noise must be a finite number"),
    ],
)
def test_bad_input(capsys, recording, board, arguments, words):
    Path("text.sqlite").write_text("not a recording")
    given = [recording if one == "RUN" else one for one in arguments]
    if "--recording" not in given and "none.toml" not in given:
        given = [*board, "--no-locate", *given]
    assert words in refused(capsys, *given)


@pytest.mark.parametrize("arguments", [("--port", "/dev/none"), ("--recording", "none.sqlite")])
def test_a_wrong_port_costs_no_table(capsys, monkeypatch, arguments):
    def computed(design, progress):
        raise AssertionError("the table is computed for nothing")

    monkeypatch.setattr(shared, "stored_table", computed)
    assert arguments[1] in refused(capsys, "gast2020", *arguments)


def test_a_window_serves_the_board_and_says_what_failed(capsys, board, monkeypatch):
    def served(work, shelf, services, *_, ready, **__):
        assert (services.alone, services.log, services.port) == (True, "touches.sqlite", "emulator")
        ready("http://127.0.0.1:1/")
        services.failed("the board is gone.")

    monkeypatch.setattr("coilarray.viz.studio.server.serve", served)
    monkeypatch.setattr(live_command.webbrowser, "open", lambda url: None)
    options = (*board, "--no-locate", "--plot", "--out", "touches.sqlite")
    code, out, err = run(capsys, *options)
    assert (code, err) == (2, "coilarray: error: the board is gone.\n")
    assert out.startswith("live display: http://127.0.0.1:1/")
    Path("touches.sqlite").touch()
    assert "touches.sqlite exists" in refused(capsys, *options)
