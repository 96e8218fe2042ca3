"""Session with a microcontroller: commands, replies and messages.

It lasts from the greeting of the board until the port is lost or the board restarts.
"""

from __future__ import annotations

import random
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import TypeVar

from coilarray.errors import HardwareError
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
from coilarray.hardware.wire.protocol import (
    IDS,
    VERSION,
    Answer,
    BoardTime,
    Greeting,
    Heartbeat,
    LineParser,
    Message,
    MessageError,
    Refusal,
    ScanMessage,
    StreamEnd,
    command_line,
    parse_message,
    read_greeting,
    read_pong,
    read_version,
)
from coilarray.hardware.wire.serial_ports import OpenSerialPort

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
