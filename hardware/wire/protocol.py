"""Lines, messages and scans of the microcontroller's protocol.

`hardware/firmware/PROTOCOL.md` defines it. Every field is checked against its exact form, because a
port may send anything.
"""

from __future__ import annotations

import binascii
import random
import re
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from enum import Enum, IntEnum
from typing import TypeVar

from coilarray.errors import HardwareError
from coilarray.hardware.scan.readings import RawSample, SampleFault
from coilarray.hardware.scan.settings import ScanSettings
from coilarray.hardware.scan.wiring import SWITCHES
from coilarray.hardware.wire.buses import (
    BoardRestarted,
    BusFault,
    Clock,
    CommandRefused,
    ComputerClock,
    DeviceLost,
    NoAnswer,
    NotABoard,
    VersionMismatch,
)
from coilarray.hardware.wire.ports import OpenSerialPort

VERSION = (2, 0)
"""Major and minor version of this package's protocol."""
_GOOD_STATUS = 0x0048
"""STATUS of a word that has no status: DRDY and UNREADCONV0, no error."""
_HEX = {digits: re.compile(rf"[0-9A-F]{{{digits}}}") for digits in (1, 2, 4, 8)}
_DECIMAL = re.compile(r"0|[1-9][0-9]{0,9}")
_WORDS = re.compile(r"([0-9A-F]{4})([0-9A-F]{4})(?:\.([0-9A-F]{4}))?(?::([0-9A-F]{4}))?")


class MessageError(ValueError):
    """Intact line that is no message of this version."""


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
    fields: tuple[str, ...]


@dataclass(frozen=True)
class Refusal:
    """Reply to a command that was not carried out."""

    command: int
    code: int
    text: str


Message = ScanMessage | Heartbeat | StreamEnd | Answer | Refusal


def hexadecimal(field: str, digits: int) -> int:
    """Return the number of a hexadecimal field."""
    if not _HEX[digits].fullmatch(field):
        raise MessageError(f"a field must be {digits} hexadecimal digits; got {field!r}.")
    return int(field, 16)


def decimal(field: str) -> int:
    """Return the number of a decimal field."""
    if not _DECIMAL.fullmatch(field):
        raise MessageError(f"a field must be a decimal number; got {field!r}.")
    return int(field)


def parse_message(text: str) -> Message:
    """Read the text of an intact line."""
    kind, fields = text[:1], text[1:].split(",")
    if kind == "S":
        return read_scan(fields)
    if kind == "H":
        boot, time, configuration, mode = _exactly(4, fields)
        hexadecimal(configuration, 4)
        return _heartbeat(boot, time, mode)
    if kind == "E":
        code, configuration, boot, said = _exactly(4, fields)
        hexadecimal(configuration, 4)
        return StreamEnd(_member(StreamEndReason, code), hexadecimal(boot, 8), said)
    if kind == "<":
        return _reply(fields)
    raise MessageError(f"a line must begin with S, H, E or <; got {kind!r}.")


def read_scan(fields: Sequence[str]) -> ScanMessage:
    """Read the fields of a scan."""
    if len(fields) < 5:
        raise MessageError(f"a scan must have at least 5 fields; got {len(fields)}.")
    sequence, time, configuration, boot, *words = fields
    return ScanMessage(
        sequence=hexadecimal(sequence, 8),
        time=hexadecimal(time, 8),
        configuration=hexadecimal(configuration, 4),
        boot=hexadecimal(boot, 8),
        samples=tuple(_sample(word) for word in words),
    )


def _sample(word: str) -> RawSample:
    """Read the word of a sample."""
    if word[:1] == "!":
        return RawSample(msb=0, lsb=0, status=0, fault=_member(SampleFault, word[1:]))
    match = _WORDS.fullmatch(word)
    if not match:
        raise MessageError(
            f"a word must be 8 hexadecimal digits, with status and drive current or not, or a fault; got {word!r}."
        )
    msb, lsb, status, drive = match.groups()
    return RawSample(
        msb=int(msb, 16),
        lsb=int(lsb, 16),
        status=_GOOD_STATUS if status is None else int(status, 16),
        drive=None if drive is None else int(drive, 16),
    )


_Code = TypeVar("_Code", bound=IntEnum)


def _member(kind: type[_Code], field: str) -> _Code:
    """Return the reason or fault of a field."""
    number = hexadecimal(field, 1)
    if not 1 <= number <= max(kind):
        raise MessageError(f"a {kind.__name__} must be 1 to {max(kind):d}; got {number}.")
    return kind(number)


def _heartbeat(boot: str, time: str, mode: str) -> Heartbeat:
    try:
        return Heartbeat(hexadecimal(boot, 8), hexadecimal(time, 8), Mode(mode))
    except ValueError as error:
        raise MessageError(f"a mode must be u, i or s: {error}.") from None


def _reply(fields: Sequence[str]) -> Answer | Refusal:
    """Read the fields of a reply."""
    if len(fields) < 2:
        raise MessageError(f"a reply must have at least 2 fields; got {len(fields)}.")
    command, verdict, *rest = fields
    number = hexadecimal(command, 2)
    if verdict == "OK":
        return Answer(number, tuple(rest))
    if verdict == "ERR":
        code, text = _exactly(2, rest)
        return Refusal(number, hexadecimal(code, 1), text)
    raise MessageError(f"a reply must say OK or ERR; got {verdict!r}.")


def _exactly(count: int, fields: Sequence[str]) -> Sequence[str]:
    if len(fields) != count:
        raise MessageError(f"the line must have {count} fields; got {len(fields)}.")
    return fields


@dataclass(frozen=True)
class Greeting:
    """Reply to HELLO."""

    version: tuple[int, int]  # of the board's protocol, major and minor
    firmware: str
    boot: int  # number of the session, which changes at every start
    manufacturer: int  # identity registers of the converter, 0 if it does not answer
    device: int
    most_states: int  # that a configuration may have
    most_devices: int


def read_version(fields: Sequence[str]) -> tuple[int, int]:
    """Read major and minor version of a reply to HELLO."""
    major, dot, minor = (fields[0] if fields else "").partition(".")
    if not dot:
        raise MessageError(f"a version must be two numbers with a dot; got {major!r}.")
    return decimal(major), decimal(minor)


def read_greeting(fields: Sequence[str]) -> Greeting:
    """Read the fields of a reply to HELLO."""
    if len(fields) < 8:  # the last are its capabilities. A later minor version may have more
        raise MessageError(f"a greeting must have 8 fields; got {len(fields)}.")
    _, firmware, boot, manufacturer, device, states, devices = fields[:7]
    return Greeting(
        version=read_version(fields),
        firmware=firmware,
        boot=hexadecimal(boot, 8),
        manufacturer=hexadecimal(manufacturer, 4),
        device=hexadecimal(device, 4),
        most_states=decimal(states),
        most_devices=decimal(devices),
    )


def read_pong(fields: Sequence[str]) -> Heartbeat:
    """Read the fields of a reply to PING."""
    if len(fields) < 4:
        raise MessageError(f"a reply to PING must have 4 fields; got {len(fields)}.")
    decimal(fields[3])  # lines that the board could not read
    return _heartbeat(*fields[:3])


MAX_LINE = 512
"""Characters of a line with its checksum, without the line feed."""
IDS = 0x100
"""Commands are numbered 00 to FF and then from 00 again."""
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
        """Return the board's time without wraps in µs.

        `microseconds` may be older than a previous time. `now` is the computer's monotonic time in
        s.
        """
        if self._newest is None:
            self._newest, self._then = microseconds, now
            return microseconds
        expected = self._newest + (now - self._then) * 1e6
        unwrapped = microseconds + _WRAP * round((expected - microseconds) / _WRAP)
        if unwrapped > self._newest:
            self._newest, self._then = unwrapped, now
        return unwrapped


_MEANINGS: dict[int, tuple[type[HardwareError], str]] = {
    1: (CommandRefused, "unknown command"),
    2: (CommandRefused, "bad argument"),
    3: (CommandRefused, "out of order"),
    4: (CommandRefused, "illegal switching"),
    5: (CommandRefused, "hash differs or settings are incomplete"),
    6: (BusFault, "a chip does not answer"),
    7: (BusFault, "a register reads back otherwise than it was written"),
    8: (BusFault, "the converter is another chip"),
    9: (CommandRefused, "busy with a stream"),
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
    """Session with a board on a serial port.

    The constructor stops the board and greets it. All messages except replies come in order from
    `receive`.
    """

    def __init__(self, port: OpenSerialPort, *, times: LinkTimes, clock: Clock | None = None) -> None:
        self._port, self.times, self.clock = port, times, clock or ComputerClock()
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
        version, greeting = self.ask(_hello, "HELLO")
        if greeting is None:
            raise VersionMismatch(
                f"the board at {self.name} speaks version {version[0]}.{version[1]} of the protocol, this package "
                f"{VERSION[0]}.{VERSION[1]}; flash the firmware that belongs to it."
            )
        self._boot = greeting.boot
        self.greeting = greeting
        """Reply of the board to HELLO."""
        self.ping()

    @property
    def name(self) -> str:
        """Name of the port."""
        return self._port.name

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
        """Return the next message before a time in s.

        Bytes that came before that time are still read after it. Replies that no command waits for
        are skipped.
        """
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
                for text in texts:
                    with suppress(MessageError):
                        self._kept.append(parse_message(text))
            if left <= 0 and not self._kept:
                return None

    def ask(self, reading: Callable[[tuple[str, ...]], T], verb: str, *arguments: str, patience: float = 0.0) -> T:
        """Send a command until its reply comes, and read it."""
        self.post(verb, *arguments)
        number = self._number
        self._early.clear()
        for attempt in range(self.times.attempts):
            if attempt:
                self._write(command_line(number, verb, *arguments))
            until = self.clock.now() + self.times.reply + patience
            while (message := self.receive(until)) is not None:
                if isinstance(message, Refusal):
                    kind, meaning = _MEANINGS.get(message.code, (CommandRefused, "unknown reason"))
                    if kind is CommandRefused and self._boot is not None and verb != "PING":
                        self.ping(patience)  # raises BoardRestarted in another session
                    said = f": {message.text}" if message.text else ""
                    raise kind(f"the board refused {verb} (error {message.code:X}, {meaning}){said}.")
                if isinstance(message, Answer):
                    with suppress(MessageError):
                        return reading(message.fields)
                elif isinstance(message, ScanMessage | StreamEnd):
                    self._early.append(message)
        raise self.silence_fault(f"the board at {self.name} did not answer {verb} in {self.times.attempts} attempts.")

    def recall_early(self) -> None:
        """Receive scans again that came before a reply."""
        self._kept.extendleft(reversed(self._early))
        self._early.clear()

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
                raise BoardRestarted(
                    f"the board at {self.name} has restarted (session {boot:08X} after {self._boot:08X}), "
                    "so its settings are gone; open it again."
                )

    def silence_fault(self, otherwise: str) -> HardwareError:
        """Return NotABoard if bytes come but no lines, else NoAnswer."""
        return NoAnswer(otherwise) if self._foreign < self.times.foreign else self._not_a_board()

    def close(self) -> None:
        """End the session and close the port, and never raise."""
        self._port.close()
        self.end = self.end or DeviceLost(f"{self.name} was closed.")

    def _wake_and_stop(self) -> None:
        """Stop the board and discard its earlier messages."""
        self.wake()
        try:
            self.ask(read_nothing, "STOP")
        except BusFault:  # the board has received the command. Configuring shows the fault of its converter
            pass
        except NoAnswer:
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
        except (DeviceLost, BoardRestarted) as fault:
            self.end = fault
            raise

    def _not_a_board(self) -> NotABoard:
        return NotABoard(
            f"{self.name} sends bytes but no intact line ({self._foreign} since the last one): "
            "another device, or another baud rate."
        )


def read_nothing(fields: tuple[str, ...]) -> None:
    """Read the reply to a command without fields."""


def _hello(fields: tuple[str, ...]) -> tuple[tuple[int, int], Greeting | None]:
    """Read the version and the greeting."""
    version = read_version(fields)
    return version, read_greeting(fields) if version[0] == VERSION[0] else None
