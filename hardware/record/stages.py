"""What moves the indenter: a person, a machine that speaks G-code (`record.gcode_stage`), or the emulator.

The coordinates of every stage are those of the map: x and y from its origin, depth 0 where the indenter just touches.
Finding that point before a campaign is the user's part, as homing is.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Protocol

from coilarray.errors import HardwareError
from coilarray.hardware.record.recording import GridPlace

if TYPE_CHECKING:
    from coilarray.hardware.emulator import EmulatedBoard

_TRAVEL = 20e-3  # m/s, of the emulated stage between positions


class Stage(Protocol):
    """Moves the indenter; a method returns when the movement is over, or raises a HardwareError."""

    def check(self, places: Sequence[GridPlace]) -> None:
        """Refuse places that are out of reach, before anything moves."""

    def move(self, x: float, y: float) -> None:
        """Go to a position in m, lifted off."""

    def indent(self, depth: float, speed: float) -> None:
        """Press in from where the indenter touches to a depth in m, at a speed in m/s."""

    def relax(self, speed: float) -> None:
        """Lift off at a speed in m/s; nothing where it does not touch."""

    def retreat(self) -> None:
        """Lift off after a failure as far as it goes without a person. Never raises."""

    def close(self) -> None:
        """Let go of the machine. Never raises."""


class PersonStage:
    """A person who moves the indenter by hand.

    Parameters
    ----------
    ask : callable
        Shows a text and returns when it has been done; raises HardwareError where nobody is there.
    """

    def __init__(self, ask: Callable[[str], None]) -> None:
        self._ask = ask
        self._where = ""

    def check(self, places: Sequence[GridPlace]) -> None:
        """Accept everything: the person decides."""

    def move(self, x: float, y: float) -> None:
        """Ask for a position."""
        self._where = f"x = {_mm(x)}, y = {_mm(y)} mm"
        self._ask(f"Move the indenter to {self._where}, without touching.")

    def indent(self, depth: float, speed: float) -> None:
        """Ask for a depth."""
        self._ask(f"Press {_mm(depth)} mm deep at {self._where}, at {_mm(speed)} mm/s, and hold it.")

    def relax(self, speed: float) -> None:
        """Ask for lifting off."""
        self._ask(f"Lift the indenter off at {_mm(speed)} mm/s.")

    def retreat(self) -> None:
        """Do nothing: the person sees the error."""

    def close(self) -> None:
        """Do nothing."""


class EmulatedStage:
    """Moves the indenter of an emulated board, and takes the board's time for it.

    Parameters
    ----------
    board : EmulatedBoard
        As `coilarray.hardware.emulator.emulated_board` returns it.
    """

    def __init__(self, board: EmulatedBoard) -> None:
        self._board, self._indenter, self._clock = board, board.indenter, board.clock
        self._x = self._y = self._depth = 0.0

    def check(self, places: Sequence[GridPlace]) -> None:
        """Refuse places that the emulated sample does not have."""
        from coilarray.hardware.emulator.indenter import Place

        for place in places:
            self._board.world.check(Place(place.x, place.y, place.depth))

    def move(self, x: float, y: float) -> None:
        """Go to a position, lifted off."""
        self._indenter.lift()
        self._clock.sleep(math.hypot(x - self._x, y - self._y) / _TRAVEL)
        self._x, self._y = x, y

    def indent(self, depth: float, speed: float) -> None:
        """Press in."""
        self._clock.sleep(depth / speed)
        self._indenter.press(self._x, self._y, depth)
        self._depth = depth

    def relax(self, speed: float) -> None:
        """Lift off."""
        self._clock.sleep(self._depth / speed)
        self.retreat()

    def retreat(self) -> None:
        """Lift off at once."""
        self._indenter.lift()
        self._depth = 0.0

    def close(self) -> None:
        """Do nothing."""


def require_reach(
    places: Sequence[GridPlace], x: tuple[float, float], y: tuple[float, float], deepest: float, where: str
) -> None:
    """Refuse places outside the range of a machine.

    Raises
    ------
    HardwareError
        The first of them.
    """
    for place in places:
        if not (x[0] <= place.x <= x[1] and y[0] <= place.y <= y[1] and place.depth <= deepest):
            raise HardwareError(
                f"{where} reaches x {_mm(x[0])} to {_mm(x[1])}, y {_mm(y[0])} to {_mm(y[1])} mm and {_mm(deepest)} mm "
                f"deep; the campaign goes to x = {_mm(place.x)}, y = {_mm(place.y)}, depth {_mm(place.depth)} mm."
            )


def _mm(value: float) -> str:
    return f"{value * 1e3:.4g}"
