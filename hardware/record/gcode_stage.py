"""A stage that speaks G-code over a serial port: GRBL or Marlin, in mm, every line answered by ``ok``.

The machine must be homed and its work origin set: x and y of the map, z = 0 where the indenter just touches, z upwards.
Only ``G21``, ``G90``, ``G0``, ``G1`` and the firmware's own way to wait for the end of a movement are ever sent.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Literal, get_args

from coilarray.errors import HardwareError
from coilarray.hardware.record.recording import GridPlace
from coilarray.hardware.record.stages import require_reach
from coilarray.hardware.wire.serial_ports import BytePort

Dialect = Literal["grbl", "marlin"]
"""Firmware of the machine."""

_WAIT = {"grbl": "G4 P0.01", "marlin": "M400"}  # answered when all movements before it are over
_REFUSALS = ("error", "alarm", "!!", "resend")  # begin what GRBL and Marlin say of a line that failed
_GREETINGS = ("grbl ", "start")  # of a machine that has just started
_LONGEST_LINE, _MOST_AT_ONCE = 512, 4096  # bytes that are kept of a line that does not end
_MOST_BYTES = 65536  # of answers to one line
_QUIET = 0.3  # s after the greeting, for its last lines
_SHOWN = 80  # characters of an answer
_FARTHEST, _HIGHEST = 1.0, 0.1  # m


@dataclass(frozen=True)
class Reach:
    """Where the machine may go; nothing outside is ever sent.

    Parameters
    ----------
    x, y : tuple of float
        Least and greatest position in m.
    depth : float
        Greatest depth below the point of contact in m.
    clearance : float
        Height above the point of contact in m at which the indenter travels and baselines are measured.

    Raises
    ------
    HardwareError
        A range that is none.
    """

    x: tuple[float, float]
    y: tuple[float, float]
    depth: float
    clearance: float = 2e-3

    def __post_init__(self) -> None:
        for name, (low, high) in (("x", self.x), ("y", self.y)):
            if not -_FARTHEST <= low <= high <= _FARTHEST:
                raise HardwareError(f"{name} of a stage must rise and be at most {_FARTHEST} m; got {low} to {high} m.")
        for name, value in (("depth", self.depth), ("clearance", self.clearance)):
            if not 0 < value <= _HIGHEST:
                raise HardwareError(f"{name} of a stage must be positive and at most {_HIGHEST} m; got {value} m.")


class GcodeStage:
    """A machine with three axes.

    Parameters
    ----------
    port : BytePort
        As `coilarray.hardware.wire.serial_ports.open_serial_port` returns it.
    reach : Reach
        Where it may go.
    dialect : {"grbl", "marlin"}
        Its firmware.
    greeting : float
        How long in s it may take to start after the port was opened.
    patience : float
        How long in s an answer may take, beside the time of the movement itself.
    longest : float
        How long in s a movement between positions may take.
    now : callable
        Clock of the deadlines in s.

    Raises
    ------
    HardwareError
        Another dialect; a machine that does not answer, or refuses. Then the port is closed.
    """

    def __init__(
        self,
        port: BytePort,
        reach: Reach,
        dialect: Dialect = "grbl",
        *,
        greeting: float = 3.0,
        patience: float = 5.0,
        longest: float = 120.0,
        now: Callable[[], float] = time.monotonic,
    ) -> None:
        if dialect not in get_args(Dialect):
            raise HardwareError(f"the stage must speak {' or '.join(get_args(Dialect))}; got {dialect!r}.")
        self._port, self._reach, self._dialect = port, reach, dialect
        self._patience, self._longest, self._now = patience, longest, now
        self._rest = b""  # of a line that has not ended yet
        self._due = 0  # lines that were sent and not answered: more than one after an interrupt
        self._ready = False
        try:
            self._pass_greeting(greeting)
            for line in ("G21", "G90"):
                self._send(line, 0.0)
        except BaseException:
            port.close()
            raise
        self._ready = True

    def check(self, places: Sequence[GridPlace]) -> None:
        """Refuse places out of reach."""
        require_reach(places, self._reach.x, self._reach.y, self._reach.depth, f"the stage at {self._port.name}")

    def move(self, x: float, y: float) -> None:
        """Lift off and go to a position in m."""
        self.check([GridPlace(0, 0, 0.0, y, x)])
        self._go(f"G0 Z{_mm(self._reach.clearance)}", self._longest)
        self._go(f"G0 X{_mm(x)} Y{_mm(y)}", self._longest)

    def indent(self, depth: float, speed: float) -> None:
        """Touch, then press in to a depth in m at a speed in m/s."""
        if not 0 < depth <= self._reach.depth:
            raise HardwareError(
                f"depth of the stage must be positive and at most {self._reach.depth * 1e3:g} mm; "
                f"got {depth * 1e3:g} mm."
            )
        way = self._reach.clearance + depth
        self._go(f"G1 Z{_mm(-depth)} F{_feed(speed)}", way / speed)

    def relax(self, speed: float) -> None:
        """Lift off at a speed in m/s."""
        way = self._reach.clearance + self._reach.depth
        self._go(f"G1 Z{_mm(self._reach.clearance)} F{_feed(speed)}", way / speed)

    def retreat(self) -> None:
        """Lift off; never raises."""
        if self._ready:
            with suppress(HardwareError):
                self._go(f"G0 Z{_mm(self._reach.clearance)}", self._longest)

    def close(self) -> None:
        """Let go of the port; never raises."""
        self._port.close()

    def _go(self, line: str, seconds: float) -> None:
        """Move and wait until the movement is over: ``ok`` alone says only that the line was understood."""
        self._send(line, seconds)
        self._send(_WAIT[self._dialect], seconds)

    def _send(self, line: str, seconds: float) -> None:
        self._due += 1
        self._port.write(f"{line}\n".encode("ascii"))
        until = self._now() + seconds + self._patience
        for answer in self._answers(until):
            low = answer.lower()
            if low == "ok" or low.startswith("ok "):
                self._due -= 1
                if not self._due:
                    return
            if low.startswith(_REFUSALS):
                raise self._failed(f"refused {line!r}: {_shown(answer)}")
            if self._ready and low.startswith(_GREETINGS):
                raise self._failed(f"restarted at {line!r}, so it may not know where it is")
        raise self._failed(f"did not answer {line!r} within {seconds + self._patience:.3g} s")

    def _failed(self, what: str) -> HardwareError:
        self._ready = False  # it is moved by nobody but its user now
        return HardwareError(f"the stage at {self._port.name} {what}.")

    def _answers(self, until: float) -> Iterator[str]:
        """Lines that come before a deadline; those that have come are looked at however late it is."""
        taken = 0
        while True:
            while b"\n" in self._rest:
                line, _, self._rest = self._rest.partition(b"\n")
                yield line.decode("ascii", "replace").strip()
            left = until - self._now()
            data = self._port.read(max(left, 0.0))
            if left <= 0 and not data:
                return
            taken += len(data)
            self._rest = (self._rest + data)[-_LONGEST_LINE - _MOST_AT_ONCE :]
            if taken > _MOST_BYTES:
                raise self._failed("sends without end; is it a stage")

    def _pass_greeting(self, seconds: float) -> None:
        """Many a machine restarts when its port is opened, and says so; what it says first is no answer to anything."""
        for answer in self._answers(self._now() + seconds):
            if answer.lower().startswith(_GREETINGS):
                break
        for _ in self._answers(self._now() + _QUIET):
            pass


def _mm(value: float) -> str:
    return f"{value * 1e3:.4f}"


def _feed(speed: float) -> str:
    """Speed in mm/min."""
    if not (math.isfinite(speed) and speed > 0):
        raise HardwareError(f"speed of the stage must be positive; got {speed} m/s.")
    return f"{speed * 60e3:.2f}"


def _shown(text: str) -> str:
    return repr(text[:_SHOWN])
