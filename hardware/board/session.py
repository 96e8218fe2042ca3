"""A session with a board: from its greeting until the port, or the board's memory, is gone."""

from __future__ import annotations

import random
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TypeVar

from coilarray.errors import HardwareError
from coilarray.hardware.wire.buses import Clock
from coilarray.hardware.wire.faults import (
    BoardRestarted,
    BusFault,
    CommandRefused,
    DeviceLost,
    NoAnswer,
    VersionMismatch,
)
from coilarray.hardware.wire.link import Link, LinkCounts, LinkTimes, Wait
from coilarray.hardware.wire.protocol.lines import IDS
from coilarray.hardware.wire.protocol.messages import (
    VERSION,
    Greeting,
    Message,
    Pong,
    read_greeting,
    read_pong,
    read_version,
)
from coilarray.hardware.wire.protocol.scan_stream import BoardTime
from coilarray.hardware.wire.serial_ports import BytePort

_QUIET = 0.05  # s without a line after which everything old has come

T = TypeVar("T")


class Session:
    """Starts a session: stops whatever the board does, greets it, and keeps its number, its clock and its end.

    Parameters
    ----------
    port : BytePort
        Open; `close` closes it.
    times : LinkTimes
    clock : Clock, optional
        Of all deadlines; the computer's by default.

    Raises
    ------
    NoAnswer, NotABoard, VersionMismatch, DeviceLost
        No board of this protocol; then the port is left open.
    """

    def __init__(self, port: BytePort, *, times: LinkTimes, clock: Clock | None = None) -> None:
        self._port, self._times = port, times
        self._link = Link(port, times=times, clock=clock, number=random.randrange(IDS))
        self._time = BoardTime()
        self._over: HardwareError | None = None  # why the session has ended
        self._dropped_by_board = 0
        self._newest = 0
        self._silence()
        self._greeting = self._greet()
        self.ping()

    @property
    def name(self) -> str:
        """Of the port."""
        return self._port.name

    @property
    def clock(self) -> Clock:
        """Clock of all deadlines."""
        return self._link.clock

    @property
    def times(self) -> LinkTimes:
        """How long to wait for what."""
        return self._times

    @property
    def greeting(self) -> Greeting:
        """What the board said of itself."""
        return self._greeting

    @property
    def counts(self) -> LinkCounts:
        """What was met so far."""
        return self._link.counts

    @property
    def dropped_by_board(self) -> int:
        """Lines of this computer that the board dropped, as it said last."""
        return self._dropped_by_board

    @property
    def newest(self) -> int:
        """Latest time in µs, unwrapped, that the board told as its present."""
        return self._newest

    def check(self) -> None:
        """Raise the fault that has ended the session, where one has."""
        if self._over is not None:
            raise type(self._over)(f"this session has ended: {self._over}")

    def ask(self, reading: Callable[[tuple[str, ...]], T], verb: str, *arguments: str, patience: float = 0.0) -> T:
        """As `Link.ask`; after a refusal it is asked whether the board has restarted."""
        with self._to_the_end():
            try:
                return self._link.ask(reading, verb, *arguments, patience=patience)
            except CommandRefused:
                if verb != "PING":
                    self.ping(patience)
                raise

    def ping(self, patience: float = 0.0) -> Pong:
        """Ask for a sign of life."""
        return self.told(self.ask(read_pong, "PING", patience=patience))

    def post_ping(self) -> None:
        """Give a sign of life; what the board replies comes out of `receive`."""
        with self._to_the_end():
            self._link.post("PING")

    def post_stop(self) -> None:
        """Tell the board to stop, and do not wait for its reply."""
        with self._to_the_end():
            self._link.wake()
            self._link.post("STOP")

    def receive(self, wait: Wait) -> Message | None:
        """As `Link.receive`."""
        with self._to_the_end():
            return self._link.receive(wait)

    def recall_early(self) -> None:
        """As `Link.recall_early`."""
        self._link.recall_early()

    def check_boot(self, boot: int) -> None:
        """BoardRestarted where the board is in another session."""
        with self._to_the_end():
            self._link.check_boot(boot)

    def told(self, pong: Pong) -> Pong:
        """Keep what a reply to PING says."""
        self.check_boot(pong.boot)
        self._dropped_by_board = pong.dropped
        self.present(pong.time)
        return pong

    def present(self, microseconds: int) -> bool:
        """Keep the board's present time; whether it is later than the ones before."""
        unwrapped = self.unwrap(microseconds)
        later = unwrapped > self._newest
        self._newest = max(self._newest, unwrapped)
        return later

    def unwrap(self, microseconds: int) -> int:
        """Return a time of the board in µs without its wraps."""
        return self._time.unwrap(microseconds, self.clock.now())

    def silence_fault(self, otherwise: str) -> HardwareError:
        """Fault of a board that says nothing sensible: NotABoard where bytes come, else NoAnswer with a text."""
        if self._link.foreign >= self._times.foreign:
            return self._link.not_a_board()
        return NoAnswer(otherwise)

    def close(self) -> None:
        """End the session and let go of the port. Never raises."""
        self._link.close()
        self._over = self._over or DeviceLost(f"{self.name} was closed.")

    @contextmanager
    def _to_the_end(self) -> Iterator[None]:
        """Keep the fault that ends the session."""
        try:
            yield
        except (DeviceLost, BoardRestarted) as fault:
            self._over = fault
            raise

    def _silence(self) -> None:
        """Stop what the board does, and throw away what it said before."""
        times, link = self._times, self._link
        end = link.wait(max(times.opening, times.attempts * times.reply)).until
        while True:
            link.wake()
            try:
                link.ask(read_nothing, "STOP")
                break
            except BusFault:  # it has heard; what is wrong with its converter shows when it is configured
                break
            except NoAnswer:
                if link.clock.now() < end:
                    continue
                if link.foreign:
                    raise link.not_a_board() from None
                raise
        link.drain(min(_QUIET, times.reply))

    def _greet(self) -> Greeting:
        version, greeting = self._link.ask(_hello, "HELLO")
        if greeting is None:
            raise VersionMismatch(
                f"the board at {self.name} speaks version {version[0]}.{version[1]} of the protocol, this package "
                f"{VERSION[0]}.{VERSION[1]}; flash the firmware that belongs to it."
            )
        self._link.boot = greeting.boot
        return greeting


def read_nothing(fields: tuple[str, ...]) -> None:
    """Read the reply to a command that has nothing to tell; a later minor version may."""


def _hello(fields: tuple[str, ...]) -> tuple[tuple[int, int], Greeting | None]:
    """Read the version, and the greeting where it is one of this major version."""
    version = read_version(fields)
    return version, read_greeting(fields) if version[0] == VERSION[0] else None
