"""The driver of a board against a board in memory on a clock of its own: every wait is exact, none is real.

Every way in which a stream or a session ends has its name, its time, and a way on. Faults of the chips behind the real
firmware are in test_board_firmware.py.
"""

import itertools
import math
import re
from dataclasses import replace

import pytest
from support.emulated_reader import quick_settings
from support.refusals import refused
from support.scripted_board import (
    LONGEST,
    REPLY,
    SCAN_TIME,
    SETTINGS,
    TIMES,
    Lasting,
    ScriptedBoard,
    configured,
    opened,
    verbs,
)

from coilarray.errors import HardwareError
from coilarray.hardware.board.microcontroller import MicrocontrollerReader
from coilarray.hardware.scan.readings import SampleFault
from coilarray.hardware.scan.wiring import wired_to_channels
from coilarray.hardware.wire.buses import (
    BoardRestarted,
    BusFault,
    CommandRefused,
    DeviceLost,
    NoAnswer,
    NotABoard,
    SwitchFault,
    VersionMismatch,
)  # fmt: skip


@pytest.fixture
def board():
    return ScriptedBoard()


@pytest.fixture
def reader(board):
    return configured(board)


def test_opening_stops_the_board_before_it_greets_it(board):
    reader = opened(board)
    assert verbs(board) == ["STOP", "HELLO", "PING"]
    assert reader.identity.kind == "scripted 1, protocol 2.0"
    assert (reader.identity.manufacturer, reader.identity.device) == (0x5449, 0x3055)
    assert (reader.identity.boot, reader.identity.emulated) == (0x1234ABCD, False)
    board.version = "2.7"  # another minor version is told
    assert opened(board).identity.kind.endswith("protocol 2.7")


def test_a_board_whose_converter_does_not_obey_can_be_opened(board):
    board.refuse["STOP"] = (6, "converter not put to sleep")
    reader = opened(board)
    refused(BusFault, "refused STOP", reader.rest)
    reader.configure(SETTINGS)  # and is not asked to STOP once more
    assert verbs(board).count("STOP") == 2


def test_opening_goes_through_a_running_stream_and_half_a_line(board):
    board.hash, board.mode = 0x1111, "s"
    board.send(b"S0000")
    board.clock.sleep(3.0)
    reader = opened(board)
    assert board.mode == "i"
    refused(HardwareError, "must be configured", reader.scan)


ATTEMPTS = TIMES.attempts * TIMES.reply
SILENT = {"deaf": True, "silent": True}
SPOILT = {"deaf": True, "spoil": lambda line: bytes(byte | 0x80 for byte in line)}
OLDER, NEWER = ({"version": version, "greeting_tail": "something else"} for version in ("1.0", "3.0"))


@pytest.mark.parametrize(
    ("changes", "fault", "text", "least", "most"),
    [
        (SILENT, NoAnswer, "did not answer STOP in 3 attempts", ATTEMPTS, ATTEMPTS),
        (SPOILT, NotABoard, "another device, or another baud rate", 0.0, 2 * ATTEMPTS),
        ({"deaf": True}, NoAnswer, "did not answer STOP", 0.0, 3 * ATTEMPTS),
        ({"greeting_tail": "54,3055,64,8"}, NoAnswer, "did not answer HELLO", 0.0, 3 * ATTEMPTS),
        (OLDER, VersionMismatch, "speaks version 1.0 of the protocol, this package 2.0; flash", 0.0, 1.0),
        (NEWER, VersionMismatch, "speaks version 3.0 of the protocol, this package 2.0; flash", 0.0, 1.0),
    ],
)
def test_what_is_no_board_of_this_protocol_is_named_in_time(board, changes, fault, text, least, most):
    board.clock.sleep(1.0)
    for attribute, value in changes.items():
        setattr(board, attribute, value)
    with Lasting(board) as it, pytest.raises(fault, match=text):
        opened(board)
    assert least - 0.01 <= it.seconds <= most + 0.01


def test_settings_are_told_in_order(board):
    opened(board).configure(SETTINGS)
    assert verbs(board)[3:] == ["BEGIN", *["WIRE"] * 6, "SAFE", *["REG"] * 7, "WAIT", *["STATE"] * 6, "COMMIT"]
    assert board.sent[-1] == ("COMMIT", f"{SETTINGS.hash:04X}")


def test_too_many_states_and_illegal_switching_are_refused_before_anything_is_sent(board):
    board.greeting_tail = "5449,3055,5,8"
    reader = opened(board)
    board.sent.clear()
    first, *others = SETTINGS.states
    two = replace(first, words=bytes(a | b for a, b in zip(first.words, others[0].words, strict=True)))
    refused(HardwareError, "must have at most 5 states; got 6", reader.configure, SETTINGS)
    refused(HardwareError, "coil1", reader.configure, replace(SETTINGS, states=(two, *others[:4])))
    assert board.sent == []
    # coils at channels are not for the firmware
    settings = quick_settings(wired_to_channels(["left", "right"], [0, 1]))
    refused(HardwareError, "the firmware converts channel 0 alone", opened(board).configure, settings)
    assert "BEGIN" not in verbs(board)


@pytest.mark.parametrize(
    ("verb", "code"),
    [("BEGIN", 1), ("REG", 2), ("STATE", 4), *(("COMMIT", code) for code in (5, 6, 7, 8)), ("SAFE", "F")],
)
def test_a_refusal_has_its_name_and_reason(board, verb, code):
    reader, fault = opened(board), BusFault if code in (6, 7, 8) else CommandRefused
    board.refuse[verb] = (code, "because")
    refused(fault, rf"refused {verb} \(error {code}, .+\): because\.", reader.configure, SETTINGS)
    refused(HardwareError, "must be configured", reader.scan)
    del board.refuse[verb]
    reader.configure(SETTINGS)
    assert reader.scan().configuration == SETTINGS.hash


def test_a_scan_is_what_the_board_said(board, reader):
    board.words = lambda number: ["01798210", "01798211.1048", "!3", "0179FFFF", "01790000", "0ABCDEF0"]
    scan = reader.scan()
    assert [sample.fault for sample in scan.samples] == [0, 0, SampleFault.NO_RESULT, 0, 0, 0]
    assert (scan.samples[1].msb, scan.samples[1].lsb, scan.samples[1].status) == (0x0179, 0x8211, 0x1048)
    assert (scan.sequence, scan.configuration, scan.boot) == (0, SETTINGS.hash, board.boot)
    assert reader.check_chain() == "none"


def test_a_lost_command_and_a_lost_reply_cost_one_repeat_each(board, reader):
    board.deaf = True
    board.spoil = lambda line: (setattr(board, "deaf", False), line)[1]  # hears again after the next heartbeat
    board.clock.sleep(0.8)
    reader.scan()
    lost = iter([True])
    board.spoil = lambda line: b"" if next(lost, False) else line
    board.sent.clear()
    reader.scan()
    assert verbs(board) == ["SCAN"]  # the board measured once


def test_no_answer_in_time(board, reader):
    board.deaf = board.silent = True
    with Lasting(board) as it, pytest.raises(NoAnswer, match="did not answer SCAN in 3 attempts"):
        reader.scan()
    assert it.seconds == pytest.approx(REPLY, abs=0.01)
    board.deaf = board.silent = False
    board.sent.clear()
    assert reader.scan().samples
    assert verbs(board) == ["STOP", "SCAN"]  # the unanswered one might still be under way


@pytest.mark.parametrize(
    ("attribute", "value", "text"),
    [
        ("hash", 0x1111, "measures with the settings 1111"),
        ("words", lambda number: ["!4"] * 6, "the converter was reset; configure it again"),
    ],
)
def test_a_scan_with_other_settings_or_after_a_reset_is_not_taken(board, reader, attribute, value, text):
    before = getattr(board, attribute)
    setattr(board, attribute, value)
    refused(BoardRestarted, text, reader.scan)
    refused(HardwareError, "must be configured", reader.scan)
    setattr(board, attribute, before)
    reader.configure(SETTINGS)
    assert reader.scan().configuration == SETTINGS.hash


@pytest.mark.parametrize(("word", "fault"), [("!1", BusFault), ("!5", SwitchFault), ("01798210", CommandRefused)])
def test_a_board_that_measures_no_more_is_named_after_its_last_scan(board, reader, word, fault):
    board.words = lambda number: [word] * 6
    reader.scan()
    board.refuse["SCAN"] = (3, "not configured")
    with pytest.raises(fault):
        reader.scan()
    refused(HardwareError, "must be configured", reader.scan)


def steps(scans, count):
    times = [scan.time for scan in itertools.islice(scans, count)]
    return [after - before for before, after in itertools.pairwise(times)]


def test_a_stream_is_in_order_and_stops_with_its_iterator(board, reader):
    stream = reader.scans()
    scans = list(itertools.islice(stream, 20))
    assert [scan.sequence for scan in scans] == list(range(20))
    assert steps(scans, 20) == pytest.approx([SCAN_TIME] * 19, abs=2e-6)  # the board's microseconds
    assert [scan.samples[0].lsb for scan in scans] == list(range(20))
    stream.close()
    assert (board.mode, verbs(board)[-1], next(reader.scans()).sequence) == ("i", "STOP", 0)


def test_an_interval_is_kept(board, reader):
    assert steps(reader.scans(2.5), 8) == pytest.approx([2.5] * 7, abs=2e-6)
    assert ("START", f"{2_500_000:08X}") in board.sent
    for interval in (-1.0, 2148.0, math.nan, math.inf):
        refused(HardwareError, "interval must be 0 to 2147 s", reader.scans, interval)


def test_the_lease_is_renewed_while_the_stream_is_fetched_and_while_a_long_interval_is_waited_for(board, reader):
    for scan in reader.scans():
        if scan.time > 60.0:
            break
    assert 60 / TIMES.ping * 0.8 < verbs(board).count("PING") <= 60 / TIMES.ping + 2
    assert steps(reader.scans(100.0), 3) == pytest.approx([100.0] * 2)


def test_who_does_not_fetch_loses_the_stream(board, reader):
    stream = reader.scans()
    next(stream)
    board.clock.sleep(15.0)
    refused(NoAnswer, "heard nothing of this computer in time", list, stream)
    assert reader.scan().samples


def test_only_one_stream_runs_and_nothing_else_meanwhile(board, reader):
    stream = reader.scans()
    next(stream)
    for call in (reader.scan, lambda: next(reader.scans()), reader.check_chain, lambda: reader.configure(SETTINGS)):
        refused(HardwareError, "a stream is running; close its iterator first", call)
    reader.rest()
    assert list(stream) == []
    assert reader.scan().samples


def test_damaged_lines_are_gaps_that_are_counted(board, reader):
    damaged = re.compile(rb"S.{7}[37]")
    board.spoil = lambda line: line.replace(b"0179", b"0178", 1) if damaged.match(line) else line
    sequences = [scan.sequence for scan in itertools.islice(reader.scans(), 20)]
    assert sequences == [n for n in range(24) if n % 16 not in (3, 7)][:20]


def test_scans_that_come_twice_or_late_pass_once(board, reader):
    lines = []

    def again(line):
        """Send every scan twice, and the one before it once more."""
        if not line.startswith(b"S"):
            return line
        lines.append(line)
        return lines[-1] * 2 + lines[-2 if len(lines) > 1 else -1]

    board.spoil = again
    assert [scan.sequence for scan in itertools.islice(reader.scans(), 10)] == list(range(10))


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
