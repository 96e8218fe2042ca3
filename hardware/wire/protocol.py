"""Lines, messages and scans of the microcontroller's protocol.

`hardware/firmware/PROTOCOL.md` defines it. Every field is checked against its exact form, because a
port may send anything.
"""

from __future__ import annotations

import binascii
import re
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum, IntEnum
from typing import TypeVar

from coilarray.hardware.scan.readings import RawSample, SampleFault
from coilarray.hardware.scan.settings import ScanSettings
from coilarray.hardware.scan.switching import SWITCHES

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
