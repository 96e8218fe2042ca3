"""Lines, messages, commands, time and sequence of the protocol, without a port.

| what                    | against                                                                          |
| ----------------------- | -------------------------------------------------------------------------------- |
| checksum                | the catalogue's check value, and the division bit by bit                         |
| lines                   | any cut of the bytes, every damage of a kind that CRC-16 must see, any bytes     |
| messages                | texts put together here from PROTOCOL.md                                         |
| commands of settings    | the hash, computed from the commands alone as a board would                      |
| time                    | a clock that runs as long as it likes                                            |
"""

import itertools

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from support.emulated_reader import settings_of
from support.scripted_board import crc16

from coilarray.hardware.scan.readings import RawSample, SampleFault
from coilarray.hardware.scan.wiring import load_wiring
from coilarray.hardware.wire.protocol import MAX_LINE, LineParser, command_line, draft_commands, seal

from coilarray.hardware.wire.protocol import (  # isort: skip
    Answer, Greeting, Heartbeat, Mode, Refusal, ScanMessage, StreamEnd, StreamEndReason,
    parse_message, read_greeting, read_pong,
)  # fmt: skip
from coilarray.hardware.wire.protocol import BoardTime

TEXTS = st.text(st.characters(min_codepoint=0x20, max_codepoint=0x7E), min_size=1, max_size=MAX_LINE - 5)
SCAN = "S00000007,000F4240,D9A4,1234ABCD,01798210,01798211.1048,!3,0179FFFF,01790000,0ABCDEF0"


def lines_of(data):
    return LineParser().feed(data)


@example("123456789")  # of the catalogue: 29B1
@given(TEXTS)
def test_checksum_is_the_division_bit_by_bit(text):
    assert seal(text) == text.encode() + b"*%04X\n" % crc16(text.encode())
    assert crc16(b"123456789") == 0x29B1


@pytest.mark.parametrize("text", ["", "a\n", "tab\t", "\x7f", "µ", "x" * (MAX_LINE - 4)])
def test_only_a_line_can_be_sealed(text):
    with pytest.raises(ValueError, match="a line must be 1 to 507 printable ASCII characters"):
        seal(text)


@pytest.mark.slow
@given(st.lists(TEXTS, max_size=6), st.lists(st.integers(0, 3000), max_size=12), st.sampled_from([b"", b"\r"]))
def test_lines_come_out_however_the_bytes_are_cut(texts, cuts, carriage_return):
    data = b"".join(seal(text)[:-1] + carriage_return + b"\n" for text in texts)
    parser = LineParser()
    ends = sorted(min(cut, len(data)) for cut in cuts)
    pieces = [data[a:b] for a, b in itertools.pairwise([0, *ends, len(data)])]
    assert [text for piece in pieces for text in parser.feed(piece)] == texts


def test_bad_lines_are_left_out():
    parser = LineParser()
    good = seal("H1234ABCD,000F4240,0000,u")
    longest = seal("x" * (MAX_LINE - 5))
    assert len(parser.feed(b"\n\r\n" + good + longest)) == 2
    for bad in (
        good.replace(b"u", b"i") + good.lower() + good[:-6] + b"\n",
        good.replace(b"u", b"\x00") + good.replace(b"u", b"\xb5") + b"\r" + good,
        b"x" * (MAX_LINE + 1) + b"\n" + b"x" * MAX_LINE + b"\r\r\n" + b"x" * 5000 + b"\n",
    ):
        assert parser.feed(bad) == []
    assert parser.feed(good) == ["H1234ABCD,000F4240,0000,u"]


def test_a_scan_is_read():
    samples = (
        RawSample(0x0179, 0x8210, 0x0048), RawSample(0x0179, 0x8211, 0x1048), RawSample(0, 0, 0, SampleFault.NO_RESULT),
        RawSample(0x0179, 0xFFFF, 0x0048), RawSample(0x0179, 0x0000, 0x0048), RawSample(0x0ABC, 0xDEF0, 0x0048),
    )  # fmt: skip
    assert parse_message(SCAN) == ScanMessage(7, 1_000_000, 0xD9A4, 0x1234ABCD, samples)
    # replies to HELLO and PING
    hello = "2.0,XMC 2Go 1,1234ABCD,5449,3055,16,8,readback,later"
    assert read_greeting(hello) == Greeting((2, 0), "XMC 2Go 1", 0x1234ABCD, 0x5449, 0x3055, 16, 8)
    assert read_pong("1234ABCD,000F4240,i,12") == Heartbeat(0x1234ABCD, 1_000_000, Mode.IDLE)


@pytest.mark.parametrize(("text", "message"), [
    ("H1234ABCD,000F4240,0000,u", Heartbeat(0x1234ABCD, 1_000_000, Mode.UNCONFIGURED)),
    ("H1234ABCD,000F4240,D9A4,s", Heartbeat(0x1234ABCD, 1_000_000, Mode.STREAMING)),
    ("E2,D9A4,1234ABCD,reset", StreamEnd(StreamEndReason.CONVERTER_RESET, 0x1234ABCD, "reset")),
    ("<FE,OK", Answer(0xFE, "")),
    ("<FE,OK,5449", Answer(0xFE, "5449")),
    ("<00,ERR,4,two coils on INA", Refusal(0, 4, "two coils on INA")),
])  # fmt: skip
def test_other_messages_are_read(text, message):
    assert parse_message(text) == message


@pytest.mark.parametrize("text", [
    "", "X00", ">00,STOP", "S", SCAN.lower(), SCAN.replace("S0", "S"), SCAN[:33], SCAN + ",",
    *(SCAN.replace("!3", fault) for fault in ("!0", "!6", "!")), SCAN.replace(".1048", "."),
    *(SCAN.replace("0179FFFF", word) for word in ("0179FFF", "0179 FFF", "+179FFFF", "0179FFFF:", "!1:0280")),
    "H1234ABCD,000F4240,0000,x",
    "H1234ABCD,000F4240,0000", "H1234ABCD,000F4240,0000,u,1", "E0,D9A4,1234ABCD,", "E5,D9A4,1234ABCD,",
    "E2,D9A4,1234ABCD", "<00", "<0,OK", "<00,ok", "<00,ERR,4", "<00,ERR,4,a,b", "<00,ERR,44,a",
])  # fmt: skip
def test_another_form_is_refused(text):
    assert parse_message(text) is None


def told(settings):
    """Bytes of the hash as a board puts them together from the commands that it has heard."""
    commands = [",".join(command).split(",") for command in draft_commands(settings)]
    of = {verb: [c[1:] for c in commands if c[0] == verb] for verb in {c[0] for c in commands}}
    ((devices, states),) = of["BEGIN"]
    assert [c[0] for c in (commands[0], commands[-1])] == ["BEGIN", "COMMIT"]
    assert [int(index, 16) for index, _ in of["WIRE"]] == list(range(int(devices, 16)))
    assert [int(index, 16) for index, _, _ in of["STATE"]] == list(range(int(states, 16)))
    parts = [b"coilarray1".hex(), devices, *(digits for _, digits in of["WIRE"]), of["SAFE"][0][0]]
    wait, timeout, discard, again = of["WAIT"][0]
    parts += [*(address + value for address, value in of["REG"]), wait, timeout]
    parts += [discard, again, states] if int(discard, 16) else [states]
    parts += [words + drive for _, words, drive in of["STATE"]]
    return bytes.fromhex("".join(parts)), of["COMMIT"][0][0]


@pytest.mark.parametrize("discard", [0, 15])
@pytest.mark.parametrize("wiring", ["six_coils", "six_coils_4"])
def test_the_commands_tell_all_that_the_hash_is_of(wiring, discard):
    settings = settings_of(load_wiring(wiring), rcount=1000, drives=17, discard=discard)
    data, hashed = told(settings)
    assert data == settings.canonical
    assert int(hashed, 16) == crc16(data)
    for number, command in enumerate(draft_commands(settings)):  # each fits its line and goes through the parser
        assert lines_of(command_line(number, *command)) == [",".join((f">{number:02X}", *command))]


@pytest.mark.slow
@settings(max_examples=30)
@given(st.integers(0, 2**33), st.lists(st.tuples(st.floats(0, 2e5), st.booleans()), min_size=1, max_size=20),
       st.floats(-0.01, 0.01))  # fmt: skip
def test_time_is_unwrapped_over_pauses_of_any_length(start, steps, skew):
    """Pauses to 55 hours: 1 % of that is the 33 minutes by which the clocks may part."""
    clock, board, now = BoardTime(), start, 0.0
    first = clock.unwrap(board % 2**32, now)
    for pause, ahead in steps:
        now += pause
        board += round(pause * (1 + (skew if ahead else 0)) * 1e6)
        assert clock.unwrap(board % 2**32, now) - first == board - start


def test_an_older_time_stays_older():
    clock = BoardTime()
    assert (clock.unwrap(2**32 - 10, 0.0), clock.unwrap(5, 0.1)) == (2**32 - 10, 2**32 + 5)
    assert (clock.unwrap(2**32 - 20, 0.2), clock.unwrap(6, 0.3)) == (2**32 - 20, 2**32 + 6)
