"""Link to a board for commands, replies and messages.

All other messages come in order, within limits of time and size.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import TypeVar

from coilarray.errors import HardwareError
from coilarray.hardware.wire.buses import Clock, ComputerClock
from coilarray.hardware.wire.faults import BoardRestarted, BusFault, CommandRefused, DeviceLost, NoAnswer, NotABoard
from coilarray.hardware.wire.protocol.lines import IDS, LineCounts, LineParser, command_line
from coilarray.hardware.wire.protocol.messages import (
    Answer,
    Message,
    MessageError,
    Refusal,
    ScanMessage,
    StreamEnd,
    parse_message,
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
    """Limits of a link.

    The times are the longest waits in s.
    """

    reply: float = 0.5  # for the reply to a command, in addition to the time that the command itself takes
    attempts: int = 3  # of sending a command
    opening: float = 1.0  # for the first line of a board
    gap: float = 3.0  # for a scan of a stream, as a multiple of the time between two scans
    least_gap: float = 0.25  # lower limit of that wait, because computers pause
    heartbeat: float = 3.0  # for any line, in addition to the time of a scan
    ping: float = 2.0  # between two PING commands, well below the board's lease of 10 s
    foreign: int = 512  # bytes without an intact line that indicate another device
    most_bytes: float = 1e6  # per second that a board can send


@dataclass(frozen=True)
class LinkCounts:
    """Counts of a link."""

    lines: LineCounts = field(default_factory=LineCounts)
    bad_messages: int = 0  # intact lines of an unknown kind, and replies of another form
    unasked: int = 0  # replies that no command waits for, because they are repeated or too late
    repeats: int = 0  # commands sent again because no reply came in time
    overflowed: int = 0  # messages lost because they were not fetched in time


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
        self._parser, self._counts = LineParser(), LinkCounts()
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

    @property
    def counts(self) -> LinkCounts:
        """Counts so far."""
        return replace(self._counts, lines=self._parser.counts)

    def post(self, verb: str, *arguments: str) -> None:
        """Send a command without waiting.

        `receive` returns its reply, unless another command follows first.
        """
        self._number = (self._number + 1) % IDS
        self._pending = self._number
        self._write(command_line(self._number, verb, *arguments))

    def wake(self) -> None:
        """Send a line feed.

        It ends any line that the board has begun to read.
        """
        self._write(b"\n")

    def wait(self, seconds: float) -> Wait:
        """Return the deadline a number of seconds from now."""
        return Wait(self.clock.now() + seconds)

    def receive(self, wait: Wait) -> Message | None:
        """Return the next message, or None if none comes.

        None is returned after the deadline. Replies that no command waits for are skipped. DeviceLost is raised if the
        port is gone, NotABoard if it floods, and BoardRestarted if the board has another session than `boot`.
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

        The result is the value that `reading` makes from the reply's fields. `reading` raises MessageError for fields
        of another form. The command itself takes `patience` in s.

        Raises
        ------
        NoAnswer, NotABoard
            No reply to any attempt: no intact line came, or bytes that are not lines.
        CommandRefused, BusFault
            The board gives the reason.
        """
        self.post(verb, *arguments)
        number = self._number
        self._early.clear()
        for attempt in range(self.times.attempts):
            if attempt:
                self._counts = replace(self._counts, repeats=self._counts.repeats + 1)
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
                        self._count_bad()
                        continue
                    self._pending = None
                    return reply
                if isinstance(message, ScanMessage | StreamEnd):
                    self._early.append(message)
        self._pending = None
        raise self.silence_fault(f"the board at {self.name} did not answer {verb} in {self.times.attempts} attempts.")

    def recall_early(self) -> None:
        """Return early scans from `receive` once more.

        They came before the reply to the last command.
        """
        self._kept.extendleft(reversed(self._early))
        self._early.clear()

    def drain(self, seconds: float) -> None:
        """Discard messages until none comes for this time.

        Draining takes at most ten times as long.
        """
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
        intact = self._parser.counts.good
        texts = self._parser.feed(data)
        self.foreign = 0 if self._parser.counts.good > intact else self.foreign + len(data)
        for text in texts:
            try:
                message = parse_message(text)
            except MessageError:
                self._count_bad()
                continue
            if len(self._kept) < _MOST_KEPT:
                self._kept.append(message)
            else:
                self._counts = replace(self._counts, overflowed=self._counts.overflowed + 1)

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
            if message.command == self._pending:
                return True
            self._counts = replace(self._counts, unasked=self._counts.unasked + 1)
            return False
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
        """Return NotABoard if bytes come but no lines.

        Otherwise NoAnswer with the given text is returned.
        """
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

    def _count_bad(self) -> None:
        self._counts = replace(self._counts, bad_messages=self._counts.bad_messages + 1)

    def not_a_board(self) -> NotABoard:
        """Return the fault of a device that sends no lines.

        The device sends bytes.
        """
        return NotABoard(
            f"{self.name} sends bytes but no intact line ({self.foreign} since the last one): "
            "another device, or another baud rate."
        )


def _refused(verb: str, refusal: Refusal) -> HardwareError:
    kind, meaning = _MEANINGS.get(refusal.code, (CommandRefused, "unknown reason"))
    said = f": {refusal.text}" if refusal.text else ""
    return kind(f"the board refused {verb} (error {refusal.code:X}, {meaning}){said}.")
