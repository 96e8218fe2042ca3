"""Messages of the board.

Every field is checked against its exact form, because a port may send anything.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum, IntEnum

from coilarray.hardware.scan.reader import RawSample, SampleFault

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

    sequence: int  # since the start of the stream; 0 for a single scan
    time: int  # of its start in µs by the board's clock, which wraps at 2³²
    configuration: int  # hash of the settings of the board
    boot: int  # number of the board's session
    samples: tuple[RawSample, ...]


@dataclass(frozen=True)
class Heartbeat:
    """Message of a board that has nothing else to send.

    Its fields have the same meaning as in `ScanMessage`.
    """

    boot: int
    time: int
    configuration: int
    mode: Mode


@dataclass(frozen=True)
class StreamEnd:
    """Message of a board that ended the stream by itself.

    The coils are grounded, and the converter sleeps.
    """

    reason: StreamEndReason
    configuration: int
    boot: int
    text: str


@dataclass(frozen=True)
class Answer:
    """Reply to a command that was carried out.

    It has the fields of the reply.
    """

    command: int
    fields: tuple[str, ...]


@dataclass(frozen=True)
class Refusal:
    """Reply to a command that was not carried out.

    It has the number of the error and a text.
    """

    command: int
    code: int
    text: str


Message = ScanMessage | Heartbeat | StreamEnd | Answer | Refusal


def hexadecimal(field: str, digits: int) -> int:
    """Return the number of a hexadecimal field.

    The field must have exactly `digits` upper-case digits. Otherwise a MessageError is raised.
    """
    if not _HEX[digits].fullmatch(field):
        raise MessageError(f"a field must be {digits} hexadecimal digits; got {field!r}.")
    return int(field, 16)


def decimal(field: str) -> int:
    """Return the number of a decimal field.

    The field must have 1 to 10 digits. Otherwise a MessageError is raised.
    """
    if not _DECIMAL.fullmatch(field):
        raise MessageError(f"a field must be a decimal number; got {field!r}.")
    return int(field)


def parse_message(text: str) -> Message:
    """Read the text of an intact line.

    Another kind of line, or a field of another form, raises a MessageError.

    >>> parse_message("H1234ABCD,000F4240,0000,u").mode
    <Mode.UNCONFIGURED: 'u'>
    """
    kind, fields = text[:1], text[1:].split(",")
    if kind not in _KINDS:
        raise MessageError(f"a line must begin with S, H, E or <; got {kind!r}.")
    return _KINDS[kind](fields)


def read_scan(fields: Sequence[str]) -> ScanMessage:
    """Read the fields of a scan.

    A field of another form raises a MessageError.
    """
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
        return RawSample(msb=0, lsb=0, status=0, fault=SampleFault(_from_one(word[1:], max(SampleFault), "a fault")))
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


def _from_one(field: str, largest: int, what: str) -> int:
    number = hexadecimal(field, 1)
    if not 1 <= number <= largest:
        raise MessageError(f"{what} must be 1 to {largest:d}; got {number}.")
    return number


def _heartbeat(fields: Sequence[str]) -> Heartbeat:
    boot, time, configuration, mode = _exactly(4, fields)
    return Heartbeat(hexadecimal(boot, 8), hexadecimal(time, 8), hexadecimal(configuration, 4), _mode(mode))


def _mode(field: str) -> Mode:
    if field not in {member.value for member in Mode}:
        raise MessageError(f"a mode must be u, i or s; got {field!r}.")
    return Mode(field)


def _stream_end(fields: Sequence[str]) -> StreamEnd:
    code, configuration, boot, text = _exactly(4, fields)
    reason = StreamEndReason(_from_one(code, max(StreamEndReason), "the reason of an end"))
    return StreamEnd(reason, hexadecimal(configuration, 4), hexadecimal(boot, 8), text)


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


_KINDS: Mapping[str, Callable[[Sequence[str]], Message]] = {
    "S": read_scan, "H": _heartbeat, "E": _stream_end, "<": _reply,
}  # fmt: skip


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
    manufacturer: int  # identity registers of the converter; 0 if it does not answer
    device: int
    most_states: int  # that a configuration may have
    most_devices: int
    capabilities: frozenset[str]  # "readback" if the end of the chain of switches is wired back


@dataclass(frozen=True)
class Pong:
    """Reply to PING.

    It has the session, the time in µs (wraps at 2³²), the mode, and the number of lines dropped by the board.
    """

    boot: int
    time: int
    mode: Mode
    dropped: int


def read_version(fields: Sequence[str]) -> tuple[int, int]:
    """Read major and minor version of a reply to HELLO.

    The other fields of the reply may differ in another major version.
    """
    major, dot, minor = (fields[0] if fields else "").partition(".")
    if not dot:
        raise MessageError(f"a version must be two numbers with a dot; got {major!r}.")
    return decimal(major), decimal(minor)


def read_greeting(fields: Sequence[str]) -> Greeting:
    """Read the fields of a reply to HELLO.

    A field of another form raises a MessageError.
    """
    if len(fields) < 8:  # a later minor version may have more
        raise MessageError(f"a greeting must have 8 fields; got {len(fields)}.")
    _, firmware, boot, manufacturer, device, states, devices, capabilities = fields[:8]
    return Greeting(
        version=read_version(fields),
        firmware=firmware,
        boot=hexadecimal(boot, 8),
        manufacturer=hexadecimal(manufacturer, 4),
        device=hexadecimal(device, 4),
        most_states=decimal(states),
        most_devices=decimal(devices),
        capabilities=frozenset(capabilities.split("+")) - {"-", ""},
    )


def read_pong(fields: Sequence[str]) -> Pong:
    """Read the fields of a reply to PING.

    A field of another form raises a MessageError.
    """
    if len(fields) < 4:
        raise MessageError(f"a reply to PING must have 4 fields; got {len(fields)}.")
    boot, time, mode, dropped = fields[:4]
    return Pong(hexadecimal(boot, 8), hexadecimal(time, 8), _mode(mode), decimal(dropped))
