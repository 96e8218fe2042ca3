"""Every way in which a stream or a session with a board ends: by name, within its time, and with a way on."""

import itertools

import pytest
from support.refusals import refused
from support.scripted_board import LONGEST, REPLY, SETTINGS, TIMES, Lasting, ScriptedBoard, configured, verbs

from coilarray.errors import HardwareError
from coilarray.hardware.board.microcontroller import MicrocontrollerReader
from coilarray.hardware.scan.readings import SampleFault
from coilarray.hardware.wire.buses import BoardRestarted, BusFault, DeviceLost, NoAnswer, SwitchFault


@pytest.fixture
def board():
    return ScriptedBoard()


@pytest.fixture
def reader(board):
    return configured(board)


def stream_of(reader, scans=3):
    stream = reader.scans()
    for _ in range(scans):
        next(stream)
    return stream


@pytest.mark.parametrize(
    ("code", "fault", "text"),
    [
        (1, NoAnswer, "heard nothing of this computer"),
        (2, BoardRestarted, "the converter was reset"),
        (3, BusFault, "the converter does not answer"),
        (4, SwitchFault, "switches do not hold"),
    ],
)
def test_an_end_has_its_name(board, reader, code, fault, text):
    stream = stream_of(reader)
    board.end(code, "because")
    refused(fault, f"{text}.* \\(because\\)", list, stream)
    if code != 1:
        refused(HardwareError, "must be configured", reader.scan)
        reader.configure(SETTINGS)
    assert len(list(itertools.islice(reader.scans(), 3))) == 3


@pytest.mark.parametrize(
    ("words", "fault"),
    [("01798210", NoAnswer), ("!1", BusFault), ("!2", BusFault), ("!3", NoAnswer), ("!5", SwitchFault)],
)
def test_an_end_whose_line_was_lost_is_named_after_the_last_scan(board, reader, words, fault):
    board.words = lambda number: ["01798210"] * 5 + [words]
    stream = stream_of(reader)
    board.mode = "i"
    with Lasting(board) as it, pytest.raises(fault):
        list(stream)
    assert it.seconds < TIMES.gap * SETTINGS.period() + TIMES.reply


def test_a_scan_after_a_reset_is_the_last(board, reader):
    stream = stream_of(reader)
    board.words = lambda number: ["!4"] * 6
    assert {sample.fault for sample in next(stream).samples} == {SampleFault.CONVERTER_RESET}
    refused(BoardRestarted, "configure it again", next, stream)


def test_a_restart_ends_the_session(board, reader):
    stream = stream_of(reader)
    board.restart()
    refused(BoardRestarted, "session 1234ABCE after 1234ABCD", list, stream)
    for call in (reader.scan, lambda: reader.configure(SETTINGS), reader.rest):
        refused(BoardRestarted, "this session has ended", call)
    reader.close()


def test_a_heartbeat_tells_of_an_end(board, reader):
    stream = reader.scans(50.0)
    next(stream)
    board.mode = "i"
    with Lasting(board) as it, pytest.raises(NoAnswer, match="its reason was lost"):
        next(stream)
    assert it.seconds < 1.1  # heartbeats are a second apart


def test_a_stalled_stream_is_no_answer_in_time(board, reader):
    stream = stream_of(reader)
    board.silent = board.deaf = True
    with Lasting(board) as it, pytest.raises(NoAnswer, match="no scan came"):
        next(stream)
    gap = max(TIMES.gap * SETTINGS.period(), TIMES.least_gap + LONGEST)
    assert it.seconds == pytest.approx(gap + REPLY, abs=0.05)  # and a STOP that nobody answers
    board.silent = board.deaf = False
    assert reader.scan().samples
    assert "STOP" in verbs(board)  # it was owed


def test_unplugging_is_a_lost_device_for_good(board, reader):
    stream = stream_of(reader)
    board.unplugged = True
    with Lasting(board) as it, pytest.raises(DeviceLost, match="is gone"):
        next(stream)
    assert it.seconds == 0.0
    board.unplugged = False
    refused(DeviceLost, "this session has ended: scripted is gone", reader.scan)


def test_closing_rests_the_board_and_never_raises(board, reader):
    stream = stream_of(reader)
    reader.close()
    assert (board.mode, board.closed) == ("i", True)
    reader.close()
    refused(DeviceLost, "was closed", reader.scan)
    assert list(stream) == []


def test_a_silent_board_is_waited_for_once_after_an_interrupt(board, reader):
    stream = stream_of(reader)
    board.silent = board.deaf = True

    def read(seconds):
        del board.read
        raise KeyboardInterrupt

    board.read = read
    with Lasting(board) as it, pytest.raises(KeyboardInterrupt):
        next(stream)
    assert it.seconds == pytest.approx(REPLY, abs=0.05)
    with Lasting(board) as it:
        reader.close()
    assert (it.seconds, board.closed) == (0.0, True)


def test_reconnecting_is_a_new_session_without_settings(board, reader):
    sessions = []

    def reopen():
        sessions.append(board.clock.now())
        if len(sessions) < 4:
            raise HardwareError("port scripted does not exist.")
        board.closed = False
        return MicrocontrollerReader(board, clock=board.clock, reopen=reopen)

    first = MicrocontrollerReader(board, clock=board.clock, reopen=reopen)
    board.restart()
    second = first.reconnect(patience=1.0)
    assert len(sessions) == 4
    assert second is not first
    assert second.identity.boot == first.identity.boot + 1
    refused(HardwareError, "must be configured", second.scan)
    refused(BoardRestarted, "this session has ended", first.scan)
    sessions.clear()
    refused(HardwareError, "does not exist", second.reconnect)
    refused(HardwareError, "cannot be opened again by this reader", reader.reconnect)
