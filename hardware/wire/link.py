"""Link to a microcontroller for commands, replies and messages, and its session.

All other messages come in order, within limits of time and size. A session lasts from the greeting of the board until
the port is lost or the board restarts.
"""

from __future__ import annotations

import random
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
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
    LineParser,
    Message,
    MessageError,
    Pong,
    Refusal,
    ScanMessage,
    StreamEnd,
    command_line,
    parse_message,
    read_greeting,
    read_pong,
    read_version,
)
from coilarray.hardware.wire.serial_ports import BytePort

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
_MOST_KEPT = 1024  # messages that wait for their reader; further messages are lost and show as a gap
_MOST_LATE = 1 << 16  # bytes to look at after a deadline: more than a system keeps for a port

T = TypeVar("T")


@dataclass(frozen=True)
class LinkTimes:
    """Limits of a link."""

    reply: float = 0.5  # for the reply to a command, in addition to the time that the command itself takes
    attempts: int = 3  # of sending a command
    opening: float = 1.0  # for the first line of a board
    gap: float = 3.0  # for a scan of a stream, as a multiple of the time between two scans
    least_gap: float = 0.25  # lower limit of that wait, because computers pause
    heartbeat: float = 3.0  # for any line, in addition to the time of a scan
    ping: float = 2.0  # between two PING commands, well below the board's lease of 10 s
    foreign: int = 512  # bytes without an intact line that indicate another device
    most_bytes: float = 1e6  # per second that a board can send


@dataclass
class Wait:
    """A deadline in s.

    Bytes that came before it are still read after it, up to a limit.
    """

    until: float
    late: int = 0  # bytes read after it


class Link:
    """Link that sends commands and sorts the received messages.

    Once `boot` is set, it detects the end of that session. `clock`, the computer's by default, is used for all
    deadlines. `number` is the number of the command before the first. The board does not repeat a command of the same
    number and text.
    """

    def __init__(self, port: BytePort, *, times: LinkTimes, clock: Clock | None = None, number: int = 0) -> None:
        self._port, self.times, self.clock = port, times, clock or ComputerClock()
        self._parser = LineParser()
        self._number = number % IDS
        self._kept: deque[Message] = deque()
        self._early: deque[Message] = deque(maxlen=_MOST_KEPT)
        self.foreign = 0
        """Bytes since the last intact line."""
        self._second, self._taken = self.clock.now(), 0  # for the rate
        self._pending: int | None = None  # command without its reply
        self.boot: int | None = None
        """Session of the board. A line of another session raises BoardRestarted."""
        self.end: HardwareError | None = None
        """Fault that ended the session."""

    @property
    def name(self) -> str:
        """Name of the port."""
        return self._port.name

    def post(self, verb: str, *arguments: str) -> None:
        """Send a command without waiting."""
        self._number = (self._number + 1) % IDS
        self._pending = self._number
        self._write(command_line(self._number, verb, *arguments))

    def wake(self) -> None:
        """Send a line feed."""
        self._write(b"\n")

    def wait(self, seconds: float) -> Wait:
        """Return the deadline a number of seconds from now."""
        return Wait(self.clock.now() + seconds)

    def receive(self, wait: Wait) -> Message | None:
        """Return the next message, or None if none comes.

        None is returned after the deadline. Replies that no command waits for are skipped.
        """
        while True:
            while self._kept:
                message = self._kept.popleft()
                if self._is_mine(message):
                    return message
            left = wait.until - self.clock.now()
            if wait.late > _MOST_LATE:
                return None
            with self._recording_end():
                data = self._port.read(max(left, 0.0))
            self._take(data)
            if left <= 0:
                if not data:
                    return None
                wait.late += len(data)

    def ask(self, reading: Callable[[tuple[str, ...]], T], verb: str, *arguments: str, patience: float = 0.0) -> T:
        """Send a command until its reply comes.

        The result is the value that `reading` makes from the reply's fields. The command itself takes `patience` in s.
        """
        self.post(verb, *arguments)
        number = self._number
        self._early.clear()
        for attempt in range(self.times.attempts):
            if attempt:
                self._write(command_line(number, verb, *arguments))
            wait = self.wait(self.times.reply + patience)
            while (message := self.receive(wait)) is not None:
                if isinstance(message, Refusal):
                    self._pending = None
                    raise _refused(verb, message)
                if isinstance(message, Answer):
                    try:
                        reply = reading(message.fields)
                    except MessageError:
                        continue
                    self._pending = None
                    return reply
                if isinstance(message, ScanMessage | StreamEnd):
                    self._early.append(message)
        self._pending = None
        raise self.silence_fault(f"the board at {self.name} did not answer {verb} in {self.times.attempts} attempts.")

    def recall_early(self) -> None:
        """Return early scans from `receive` once more."""
        self._kept.extendleft(reversed(self._early))
        self._early.clear()

    def drain(self, seconds: float) -> None:
        """Discard messages until none comes for this time."""
        end = self.clock.now() + 10 * seconds
        while self.clock.now() < end and self.receive(self.wait(seconds)) is not None:
            pass
        self._kept.clear()

    def close(self) -> None:
        """Close the port. Never raises."""
        self._port.close()

    def _take(self, data: bytes) -> None:
        """Parse received bytes and store their messages."""
        if not data:
            return
        self._limit_rate(len(data))
        texts = self._parser.feed(data)
        self.foreign = 0 if texts else self.foreign + len(data)
        for text in texts:
            try:
                message = parse_message(text)
            except MessageError:
                continue
            if len(self._kept) < _MOST_KEPT:
                self._kept.append(message)

    def _limit_rate(self, count: int) -> None:
        """Raise NotABoard if bytes come too fast."""
        now = self.clock.now()
        if now - self._second >= 1.0:
            self._second, self._taken = now, 0
        self._taken += count
        if self._taken > self.times.most_bytes:
            raise NotABoard(f"{self.name} sends more than {self.times.most_bytes:.0f} bytes a second.")

    def _is_mine(self, message: Message) -> bool:
        """Check whether a message belongs to the command or session."""
        if isinstance(message, Answer | Refusal):
            return message.command == self._pending
        self.check_boot(message.boot)
        return True

    def check_boot(self, boot: int) -> None:
        """Raise BoardRestarted for a message of another session."""
        if self.boot is not None and boot != self.boot:
            with self._recording_end():
                raise BoardRestarted(
                    f"the board at {self.name} has restarted (session {boot:08X} after {self.boot:08X}), "
                    "so its settings are gone; open it again."
                )

    def silence_fault(self, otherwise: str) -> HardwareError:
        """Return NotABoard if bytes come but no lines."""
        return NoAnswer(otherwise) if self.foreign < self.times.foreign else self.not_a_board()

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

    def not_a_board(self) -> NotABoard:
        """Return the fault of a device that sends no lines."""
        return NotABoard(
            f"{self.name} sends bytes but no intact line ({self.foreign} since the last one): "
            "another device, or another baud rate."
        )


def _refused(verb: str, refusal: Refusal) -> HardwareError:
    kind, meaning = _MEANINGS.get(refusal.code, (CommandRefused, "unknown reason"))
    said = f": {refusal.text}" if refusal.text else ""
    return kind(f"the board refused {verb} (error {refusal.code:X}, {meaning}){said}.")


_QUIET = 0.05  # s without a line after which all old lines have come


class Session(Link):
    """Session with a board on a serial port.

    The constructor stops the board and greets it. The session stores its number, its clock and its end.

    The clock, the computer's by default, is used for all deadlines.
    """

    def __init__(self, port: BytePort, *, times: LinkTimes, clock: Clock | None = None) -> None:
        super().__init__(port, times=times, clock=clock, number=random.randrange(IDS))
        self._time = BoardTime()
        self.newest = 0
        """Latest present time of the board in µs, without wraps."""
        self._silence()
        self.greeting = self._greet()
        """Reply of the board to HELLO."""
        self.ping()

    def check(self) -> None:
        """Raise the fault that has ended the session."""
        if self.end is not None:
            raise type(self.end)(f"this session has ended: {self.end}")

    def ask(self, reading: Callable[[tuple[str, ...]], T], verb: str, *arguments: str, patience: float = 0.0) -> T:
        """Send a command with `Link.ask`."""
        try:
            return super().ask(reading, verb, *arguments, patience=patience)
        except CommandRefused:
            if verb != "PING":
                self.ping(patience)
            raise

    def ping(self, patience: float = 0.0) -> None:
        """Send PING and keep the reply."""
        self.keep(self.ask(read_pong, "PING", patience=patience))

    def keep(self, pong: Pong) -> None:
        """Store the reply to PING."""
        self.check_boot(pong.boot)
        self.present(pong.time)

    def present(self, microseconds: int) -> bool:
        """Store the board's present time."""
        unwrapped = self.unwrap(microseconds)
        later = unwrapped > self.newest
        self.newest = max(self.newest, unwrapped)
        return later

    def unwrap(self, microseconds: int) -> int:
        """Return a board time in µs without its wraps."""
        return self._time.unwrap(microseconds, self.clock.now())

    def close(self) -> None:
        """End the session and close the port. Never raises."""
        super().close()
        self.end = self.end or DeviceLost(f"{self.name} was closed.")

    def _silence(self) -> None:
        """Stop the board and discard its earlier messages."""
        times = self.times
        end = self.wait(max(times.opening, times.attempts * times.reply)).until
        while True:
            self.wake()
            try:
                super().ask(read_nothing, "STOP")
                break
            except BusFault:  # the board has received the command; configuring shows the fault of its converter
                break
            except NoAnswer:
                if self.clock.now() < end:
                    continue
                if self.foreign:
                    raise self.not_a_board() from None
                raise
        self.drain(min(_QUIET, times.reply))

    def _greet(self) -> Greeting:
        """Greet the board and check its protocol version."""
        version, greeting = super().ask(_hello, "HELLO")
        if greeting is None:
            raise VersionMismatch(
                f"the board at {self.name} speaks version {version[0]}.{version[1]} of the protocol, this package "
                f"{VERSION[0]}.{VERSION[1]}; flash the firmware that belongs to it."
            )
        self.boot = greeting.boot
        return greeting


def read_nothing(fields: tuple[str, ...]) -> None:
    """Read the reply to a command without fields."""


def _hello(fields: tuple[str, ...]) -> tuple[tuple[int, int], Greeting | None]:
    """Read the version and the greeting."""
    version = read_version(fields)
    return version, read_greeting(fields) if version[0] == VERSION[0] else None
