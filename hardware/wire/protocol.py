"""Lines, messages and session of the microcontroller's protocol.

`hardware/firmware/PROTOCOL.md` defines it. Every field is checked against its exact form, because a
port may send anything.
"""

from __future__ import annotations

import binascii
import random
import re
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from enum import Enum, IntEnum
from typing import TypeVar

from coilarray.errors import HardwareError
from coilarray.hardware.scan.readings import RawSample, SampleFault
from coilarray.hardware.scan.settings import ScanSettings
from coilarray.hardware.scan.wiring import SWITCHES
from coilarray.hardware.wire import buses
from coilarray.hardware.wire.ports import OpenSerialPort

VERSION = (2, 0)  # major and minor version of this package's protocol
_GOOD_STATUS = 0x0048  # STATUS of a word that has no status: DRDY and UNREADCONV0, no error
_H1, _H2, _H4, _H8 = (f"([0-9A-F]{{{digits}}})" for digits in (1, 2, 4, 8))
_DECIMAL = "(0|[1-9][0-9]{0,9})"
_VERSION = re.compile(rf"{_DECIMAL}\.{_DECIMAL}(?:,.*)?")
_GREETING = re.compile(rf"[^,]*,([^,]*),{_H8},{_H4},{_H4},{_DECIMAL},{_DECIMAL},.*")
_PONG = re.compile(rf"{_H8},{_H8},([uis]),{_DECIMAL}(?:,.*)?")
_SCAN = re.compile(rf"{_H8},{_H8},{_H4},{_H8}((?:,[^,]+)+)")
_WORD = re.compile(rf"!([1-5])|{_H4}{_H4}(?:\.{_H4})?(?::{_H4})?")
_HEARTBEAT = re.compile(rf"H{_H8},{_H8},{_H4},([uis])")
_END = re.compile(rf"E([1-4]),{_H4},{_H8},([^,]*)")
_ANSWER = re.compile(rf"<{_H2},OK(?:,(.*))?")
_REFUSAL = re.compile(rf"<{_H2},ERR,{_H1},([^,]*)")
ANYTHING = re.compile(".*").fullmatch  # reader of a reply to a command whose fields do not count


class Mode(Enum):
    """State of a board."""

    UNCONFIGURED = "u"
    IDLE = "i"
    STREAMING = "s"


class StreamEndReason(IntEnum):
    """Reasons why a board ended a stream by itself."""

    LEASE = 1
    CONVERTER_RESET = 2
    BUS_FAULT = 3
    SWITCHES_DIFFER = 4


@dataclass(frozen=True)
class ScanMessage:
    """A scan, with a sample for each state."""

    sequence: int  # since the start of the stream, 0 for a single scan
    time: int  # of its start in µs by the board's clock, which wraps at 2³²
    configuration: int  # hash of the settings of the board
    boot: int  # number of the board's session
    samples: tuple[RawSample, ...]


@dataclass(frozen=True)
class Heartbeat:
    """Message of an idle board, or its reply to PING."""

    boot: int
    time: int  # in µs, which wraps at 2³²
    mode: Mode


@dataclass(frozen=True)
class StreamEnd:
    """Message of a board that ended the stream by itself."""

    reason: StreamEndReason
    boot: int
    text: str


@dataclass(frozen=True)
class Answer:
    """Reply to a command that was carried out."""

    command: int
    text: str


@dataclass(frozen=True)
class Refusal:
    """Reply to a command that was not carried out."""

    command: int
    code: int
    text: str


Message = ScanMessage | Heartbeat | StreamEnd | Answer | Refusal


@dataclass(frozen=True)
class Greeting:
    """Reply to HELLO, of which only the version is known if its major number is another."""

    version: tuple[int, int]  # of the board's protocol, major and minor
    firmware: str = ""
    boot: int = 0  # number of the session, which changes at every start
    manufacturer: int = 0  # identity registers of the converter, 0 if it does not answer
    device: int = 0
    most_states: int = 0  # that a configuration may have
    most_devices: int = 0


def parse_message(text: str) -> Message | None:
    """Read the text of an intact line, None if it is no message of this version."""
    if text[:1] == "S":
        return read_scan(text[1:])
    if found := _HEARTBEAT.fullmatch(text):
        return Heartbeat(int(found[1], 16), int(found[2], 16), Mode(found[4]))
    if found := _END.fullmatch(text):
        return StreamEnd(StreamEndReason(int(found[1])), int(found[3], 16), found[4])
    if found := _ANSWER.fullmatch(text):
        return Answer(int(found[1], 16), found[2] or "")
    if found := _REFUSAL.fullmatch(text):
        return Refusal(int(found[1], 16), int(found[2], 16), found[3])
    return None


def read_scan(text: str) -> ScanMessage | None:
    """Read the fields of a scan."""
    found = _SCAN.fullmatch(text)
    words = [_WORD.fullmatch(word) for word in found[5][1:].split(",")] if found else [None]
    samples = [
        RawSample(0, 0, 0, SampleFault(int(word[1])))
        if word[1]
        else RawSample(
            msb=int(word[2], 16),
            lsb=int(word[3], 16),
            status=int(word[4], 16) if word[4] else _GOOD_STATUS,
            drive=int(word[5], 16) if word[5] else None,
        )
        for word in words
        if word
    ]
    if found is None or len(samples) < len(words):
        return None
    sequence, time, configuration, boot = (int(found[k], 16) for k in range(1, 5))
    return ScanMessage(sequence, time, configuration, boot, tuple(samples))


def read_greeting(text: str) -> Greeting | None:
    """Read the fields of a reply to HELLO. A later minor version may have more."""
    version, found = _VERSION.fullmatch(text), _GREETING.fullmatch(text)
    if version is None:
        return None
    numbers = int(version[1]), int(version[2])
    if numbers[0] != VERSION[0]:
        return Greeting(numbers)
    if found is None:
        return None
    boot, manufacturer, device = (int(found[k], 16) for k in (2, 3, 4))
    return Greeting(numbers, found[1], boot, manufacturer, device, int(found[5]), int(found[6]))


def read_pong(text: str) -> Heartbeat | None:
    """Read the fields of a reply to PING."""
    found = _PONG.fullmatch(text)
    return found and Heartbeat(int(found[1], 16), int(found[2], 16), Mode(found[3]))


MAX_LINE = 512  # characters of a line with its checksum, without the line feed
IDS = 0x100  # commands are numbered 00 to FF and then from 00 again
_PRINTABLE = bytes(range(0x20, 0x7F))
_CHECKSUM = 5  # characters: an asterisk and four digits


def seal(text: str) -> bytes:
    r"""Return a line with its checksum, CRC-16/CCITT-FALSE.

    It has 1 to 507 characters from 0x20 to 0x7E.

    >>> seal(">00,STOP")
    b'>00,STOP*3783\n'
    """
    data = text.encode("ascii", errors="replace") if text.isascii() else b""
    if not 0 < len(data) <= MAX_LINE - _CHECKSUM or data.translate(None, _PRINTABLE):
        raise ValueError(f"a line must be 1 to {MAX_LINE - _CHECKSUM} printable ASCII characters; got {text!r}.")
    return b"%b*%04X\n" % (data, binascii.crc_hqx(data, 0xFFFF))


class LineParser:
    r"""Parser from bytes to the texts of intact lines.

    It never keeps more than one line.

    >>> parser = LineParser()
    >>> parser.feed(b"noise\n>00,STOP*37")
    []
    >>> parser.feed(b"83\r\n")
    ['>00,STOP']
    """

    def __init__(self) -> None:
        self._begun = b""  # of the line that has not ended yet, cut after the longest line

    def feed(self, data: bytes) -> list[str]:
        """Take bytes in pieces of any size."""
        *lines, rest = (self._begun + data).split(b"\n")
        self._begun = rest[: MAX_LINE + 2]  # what is cut is too long already, with a carriage return
        texts = []
        for line in (line.removesuffix(b"\r") for line in lines):
            text, checksum = line[:-_CHECKSUM], line[-_CHECKSUM:]
            if not text or len(line) > MAX_LINE or line.translate(None, _PRINTABLE):
                continue
            if checksum == b"*%04X" % binascii.crc_hqx(text, 0xFFFF):
                texts.append(text.decode("ascii"))
        return texts


def command_line(number: int, verb: str, *arguments: str) -> bytes:
    r"""Return the line of a command."""
    return seal(",".join((f">{number:02X}", verb, *arguments)))


def draft_commands(settings: ScanSettings) -> tuple[tuple[str, ...], ...]:
    """Return the commands that send a board its settings."""
    wiring = settings.wiring
    devices = [wiring[first : first + SWITCHES] for first in range(0, len(wiring), SWITCHES)]
    return (
        ("BEGIN", f"{len(devices):02X}", f"{len(settings.states):02X}"),
        *(("WIRE", f"{index:02X}", switches.hex().upper()) for index, switches in enumerate(devices)),
        ("SAFE", settings.safe_words.hex().upper()),
        *(("REG", f"{address:02X}", f"{value:04X}") for address, value in settings.registers),
        (
            "WAIT",
            *(f"{time:08X}" for time in (settings.wait_us, settings.timeout_us)),
            f"{settings.discard:02X}",
            f"{settings.again_us:08X}",
        ),
        *(
            ("STATE", f"{index:02X}", state.words.hex().upper(), f"{settings.drive_register(state):04X}")
            for index, state in enumerate(settings.states)
        ),
        ("COMMIT", f"{settings.hash:04X}"),
    )


_WRAP = 1 << 32  # µs of the board's clock, 71.6 minutes


class BoardTime:
    """Unwrapped time of a board with a 32-bit clock.

    The computer's clock is the guide. The two clocks may differ by half a wrap (35 minutes) between
    two readings, so a board whose clock is off by 1 % may be silent for 59 hours.

    >>> time = BoardTime()
    >>> time.unwrap(0xFFFFFFFF, now=100.0), time.unwrap(9, now=100.1)
    (4294967295, 4294967305)
    """

    def __init__(self) -> None:
        self._newest: int | None = None
        self._then = 0.0

    def unwrap(self, microseconds: int, now: float) -> int:
        """Return the board's time without wraps in µs, at `now` in s."""
        # `microseconds` may be older than a previous time.
        if self._newest is None:
            self._newest, self._then = microseconds, now
            return microseconds
        expected = self._newest + (now - self._then) * 1e6
        unwrapped = microseconds + _WRAP * round((expected - microseconds) / _WRAP)
        if unwrapped > self._newest:
            self._newest, self._then = unwrapped, now
        return unwrapped


_MEANINGS: dict[int, tuple[type[HardwareError], str]] = {
    1: (buses.CommandRefused, "unknown command"),
    2: (buses.CommandRefused, "bad argument"),
    3: (buses.CommandRefused, "out of order"),
    4: (buses.CommandRefused, "illegal switching"),
    5: (buses.CommandRefused, "hash differs or settings are incomplete"),
    6: (buses.BusFault, "a chip does not answer"),
    7: (buses.BusFault, "a register reads back otherwise than it was written"),
    8: (buses.BusFault, "the converter is another chip"),
    9: (buses.CommandRefused, "busy with a stream"),
}
_MOST_EARLY = 1024  # messages before the reply to START. Older messages are lost and show as a gap
_QUIET = 0.05  # s without a line after which all old lines have come
T = TypeVar("T")


@dataclass(frozen=True)
class LinkTimes:
    """Limits of a link, in s."""

    reply: float = 0.5  # for the reply to a command, in addition to the time that the command itself takes
    attempts: int = 3  # of sending a command
    gap: float = 3.0  # for a scan of a stream, as a multiple of the time between two scans
    least_gap: float = 0.25  # lower limit of that wait, because computers pause
    heartbeat: float = 3.0  # for any line, in addition to the time of a scan
    ping: float = 2.0  # between two PING commands, well below the board's lease of 10 s
    foreign: int = 512  # bytes without an intact line that indicate another device


class Session:
    """Session with a board on a serial port, until the port is lost or the board restarts.

    The constructor stops the board and greets it. All messages except replies come in order from
    `receive`.
    """

    def __init__(self, port: OpenSerialPort, *, times: LinkTimes, clock: buses.Clock | None = None) -> None:
        self._port, self.name, self.times, self.clock = port, port.name, times, clock or buses.Clock()
        self._parser = LineParser()
        self._number = random.randrange(IDS)  # of the last command. The board does not repeat one of the same number
        self._kept: deque[Message] = deque()
        self._early: deque[Message] = deque(maxlen=_MOST_EARLY)
        self._foreign = 0  # bytes since the last intact line
        self._pending: int | None = None  # command without its reply
        self._boot: int | None = None  # number of the session
        self._time = BoardTime()
        self.end: HardwareError | None = None
        """Fault that ended the session."""
        self.newest = 0
        """Latest present time of the board in µs, without wraps."""
        self._wake_and_stop()
        self.greeting = self.ask(read_greeting, "HELLO")
        """Reply of the board to HELLO."""
        major, minor = self.greeting.version
        if major != VERSION[0]:
            raise buses.VersionMismatch(
                f"the board at {self.name} speaks version {major}.{minor} of the protocol, this package "
                f"{VERSION[0]}.{VERSION[1]}; flash the firmware that belongs to it."
            )
        self._boot = self.greeting.boot
        self.ping()

    def check(self) -> None:
        """Raise the fault that has ended the session."""
        if self.end is not None:
            raise type(self.end)(f"this session has ended: {self.end}")

    def post(self, verb: str, *arguments: str) -> None:
        """Send a command without waiting."""
        self._number = (self._number + 1) % IDS
        self._pending = self._number
        self._write(command_line(self._number, verb, *arguments))

    def wake(self) -> None:
        """Send a line feed."""
        self._write(b"\n")

    def receive(self, until: float) -> Message | None:
        """Return the next message before a time in s, without replies."""
        # Bytes that came before that time are still read after it.
        while True:
            while self._kept:
                message = self._kept.popleft()
                if not isinstance(message, Answer | Refusal):
                    self.check_boot(message.boot)
                    return message
                if message.command == self._pending:
                    return message
            left = until - self.clock.now()
            with self._recording_end():
                data = self._port.read(max(left, 0.0))
            if data:
                texts = self._parser.feed(data)
                self._foreign = 0 if texts else self._foreign + len(data)
                self._kept.extend(filter(None, map(parse_message, texts)))
            if left <= 0 and not self._kept:
                return None

    def ask(self, reading: Callable[[str], T | None], verb: str, *arguments: str, patience: float = 0.0) -> T:
        """Send a command until a reply comes that can be read."""
        # Scans that came before the reply to START are received after it.
        self.post(verb, *arguments)
        number = self._number
        self._early.clear()
        for attempt in range(self.times.attempts):
            if attempt:
                self._write(command_line(number, verb, *arguments))
            until = self.clock.now() + self.times.reply + patience
            while (message := self.receive(until)) is not None:
                if isinstance(message, Refusal):
                    kind, meaning = _MEANINGS.get(message.code, (buses.CommandRefused, "unknown reason"))
                    if kind is buses.CommandRefused and self._boot is not None and verb != "PING":
                        self.ping(patience)  # raises BoardRestarted in another session
                    said = f": {message.text}" if message.text else ""
                    raise kind(f"the board refused {verb} (error {message.code:X}, {meaning}){said}.")
                if isinstance(message, Answer) and (answer := reading(message.text)) is not None:
                    if verb == "START":
                        self._kept.extendleft(reversed(self._early))
                    return answer
                if isinstance(message, ScanMessage | StreamEnd):
                    self._early.append(message)
        raise self.silence_fault(f"the board at {self.name} did not answer {verb} in {self.times.attempts} attempts.")

    def ping(self, patience: float = 0.0) -> None:
        """Send PING and keep the reply."""
        self.keep(self.ask(read_pong, "PING", patience=patience))

    def keep(self, pong: Heartbeat) -> None:
        """Store the reply to PING."""
        self.check_boot(pong.boot)
        self.present(pong.time)

    def present(self, microseconds: int) -> bool:
        """Store the board's time, and return whether it is later."""
        unwrapped = self.unwrap(microseconds)
        later = unwrapped > self.newest
        self.newest = max(self.newest, unwrapped)
        return later

    def unwrap(self, microseconds: int) -> int:
        """Return a board time in µs without its wraps."""
        return self._time.unwrap(microseconds, self.clock.now())

    def check_boot(self, boot: int) -> None:
        """Raise BoardRestarted for a message of another session."""
        if self._boot is not None and boot != self._boot:
            with self._recording_end():
                raise buses.BoardRestarted(
                    f"the board at {self.name} has restarted (session {boot:08X} after {self._boot:08X}), "
                    "so its settings are gone; open it again."
                )

    def silence_fault(self, otherwise: str) -> HardwareError:
        """Return NotABoard if bytes come but no lines, else NoAnswer."""
        return buses.NoAnswer(otherwise) if self._foreign < self.times.foreign else self._not_a_board()

    def close(self) -> None:
        """End the session and close the port, and never raise."""
        self._port.close()
        self.end = self.end or buses.DeviceLost(f"{self.name} was closed.")

    def _wake_and_stop(self) -> None:
        """Stop the board and discard its earlier messages."""
        self.wake()
        try:
            self.ask(ANYTHING, "STOP")
        except buses.BusFault:  # the board has received the command. Configuring shows the fault of its converter
            pass
        except buses.NoAnswer:
            if self._foreign:
                raise self._not_a_board() from None
            raise
        quiet = min(_QUIET, self.times.reply)
        end = self.clock.now() + 10 * quiet
        while self.clock.now() < end and self.receive(self.clock.now() + quiet) is not None:
            pass
        self._kept.clear()

    def _write(self, data: bytes) -> None:
        with self._recording_end():
            self._port.write(data)

    @contextmanager
    def _recording_end(self) -> Iterator[None]:
        try:
            yield
        except (buses.DeviceLost, buses.BoardRestarted) as fault:
            self.end = fault
            raise

    def _not_a_board(self) -> buses.NotABoard:
        return buses.NotABoard(
            f"{self.name} sends bytes but no intact line ({self._foreign} since the last one): "
            "another device, or another baud rate."
        )
