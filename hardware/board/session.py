"""Session with a microcontroller board.

It lasts from the greeting of the board until the port is lost or the board restarts.
"""

from __future__ import annotations

import random
from collections.abc import Callable
from typing import TypeVar

from coilarray.hardware.wire.buses import Clock
from coilarray.hardware.wire.faults import (
    BusFault,
    CommandRefused,
    DeviceLost,
    NoAnswer,
    VersionMismatch,
)
from coilarray.hardware.wire.link import Link, LinkTimes
from coilarray.hardware.wire.protocol.lines import IDS
from coilarray.hardware.wire.protocol.messages import (
    VERSION,
    Greeting,
    Pong,
    read_greeting,
    read_pong,
    read_version,
)
from coilarray.hardware.wire.protocol.scan_stream import BoardTime
from coilarray.hardware.wire.serial_ports import BytePort

_QUIET = 0.05  # s without a line after which all old lines have come

T = TypeVar("T")


class Session(Link):
    """Session with a board on a serial port.

    The constructor stops the board and greets it. The session stores its number, its clock and its end.

    `close` closes the port, but this constructor does not if it raises. It raises NoAnswer, NotABoard, VersionMismatch
    or DeviceLost if no board of this protocol answers. The clock, the computer's by default, is used for all deadlines.
    """

    def __init__(self, port: BytePort, *, times: LinkTimes, clock: Clock | None = None) -> None:
        super().__init__(port, times=times, clock=clock, number=random.randrange(IDS))
        self._time = BoardTime()
        self.dropped_by_board = 0
        """Lines of this computer that the board dropped, from its last report."""
        self.newest = 0
        """Latest present time of the board in µs, without wraps."""
        self._silence()
        self.greeting = self._greet()
        """Reply of the board to HELLO."""
        self.ping()

    def check(self) -> None:
        """Raise the fault that has ended the session.

        Nothing happens if the session goes on.
        """
        if self.end is not None:
            raise type(self.end)(f"this session has ended: {self.end}")

    def ask(self, reading: Callable[[tuple[str, ...]], T], verb: str, *arguments: str, patience: float = 0.0) -> T:
        """Send a command with `Link.ask`.

        After a refusal it checks whether the board has restarted.
        """
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
        """Store the reply to PING.

        It has the board's time and the lines that it dropped.
        """
        self.check_boot(pong.boot)
        self.dropped_by_board = pong.dropped
        self.present(pong.time)

    def present(self, microseconds: int) -> bool:
        """Store the board's present time.

        True is returned if it is later than all previous times.
        """
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
    """Read the reply to a command without fields.

    A later minor version may have fields.
    """


def _hello(fields: tuple[str, ...]) -> tuple[tuple[int, int], Greeting | None]:
    """Read the version and the greeting.

    The greeting is read only if it is of this major version.
    """
    version = read_version(fields)
    return version, read_greeting(fields) if version[0] == VERSION[0] else None
