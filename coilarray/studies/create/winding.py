"""Winding of a wanted inductance: number of turns and width of the trace."""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq

from coilarray.errors import DesignError

_TRACE_STEP = 1e-6  # m, to which a trace is drawn
_MOST_COUNTS = 8  # numbers of turns that are tried, of all that are possible


@dataclass(frozen=True)
class Winding:
    """Turns per layer, trace width and gap of a winding.

    Width and gap are in m.
    """

    turns: int
    trace_width: float
    gap: float


@dataclass(frozen=True)
class Room:
    """Limits for a winding.

    Parameters
    ----------
    radius : float
        Distance in m from the centre to the outer edge of the copper's nearest side.
    hole : float
        Distance in m from the centre to the inner edge, which the innermost turn may not pass.
    trace_width : float
        Narrowest trace in m.
    gap : float
        Distance of the turns in m. The inner end of a circle lies a pitch further in than its last turn. Polygons get
        the same room, though their last turn ends on its own sides.
    widest_trace : float
        Widest trace in m.
    """

    radius: float
    hole: float
    trace_width: float
    gap: float
    widest_trace: float = math.inf

    def widest(self, turns: int) -> float:
        """Return the widest trace for the turns.

        It is in m. It is below zero if not even their gaps fit.
        """
        return min((self.radius - self.hole - turns * self.gap) / (turns + 1), self.widest_trace)

    @property
    def most_turns(self) -> int:
        """Most turns that fit, with the narrowest trace.

        0 if there is no room for a turn.
        """
        pitch = self.trace_width + self.gap
        return max(math.floor((self.radius - self.hole - self.trace_width) / pitch * (1 + 1e-9)), 0)

    @property
    def fullest(self) -> Winding:
        """Winding of the most turns, which has the most inductance."""
        return Winding(self.most_turns, self.trace_width, self.gap)


def wind(
    inductance: float,
    room: Room,
    inductance_of: Callable[[Winding], float],
    resistance_of: Callable[[Winding], float],
    keeping: int | None = None,
) -> Winding:
    """Find the winding of a wanted inductance with least resistance.

    More turns of the narrowest trace have more inductance. So have narrower traces of equally many turns, as they lie
    further out. For each possible number of turns the width of the trace is solved for and rounded to 1 µm.

    Parameters
    ----------
    inductance : float
        Wanted inductance in H.
    room : Room
        Limits for the winding.
    inductance_of, resistance_of : callable
        Functions that return the inductance in H of a winding, and its resistance.
    keeping : int, optional
        Number of turns that was found before. It is kept if it gives the inductance.

    Raises
    ------
    DesignError
        If the inductance cannot be reached. The message is one line with the possible range.
    """
    if room.most_turns < 1:
        raise DesignError(
            f"there is no room for a turn of {room.trace_width * 1e3:g} mm trace between {room.hole * 1e3:.3g} and "
            f"{room.radius * 1e3:.3g} mm from the centre."
        )

    def of(turns: int, width: float) -> float:
        return inductance_of(Winding(turns, width, room.gap))

    if (reached := inductance_of(room.fullest)) < inductance:
        most = f"at most {reached * 1e6:.4g} µH can, with {room.most_turns} turns a layer"
        raise DesignError(_out_of_reach(inductance, most, room))
    fewest = _first(lambda turns: of(turns, room.trace_width) >= inductance, room.most_turns)
    last = _first(lambda turns: of(turns, room.widest(turns)) > inductance, room.most_turns) - 1
    if last < 1 and fewest == 1:
        least = f"at least {of(1, room.widest(1)) * 1e6:.3g} µH can, with 1 turn a layer"
        raise DesignError(_out_of_reach(inductance, least, room))
    if last < fewest:  # between two numbers of turns: the nearer one
        ends = [(fewest, room.widest(fewest)), (max(last, 1), room.trace_width)]
        turns, width = min(ends, key=lambda end: abs(of(*end) - inductance))
        return Winding(turns, _drawn(width, room.widest(turns)), room.gap)
    counts = np.unique(np.linspace(fewest, last, _MOST_COUNTS).round().astype(int)).tolist()
    found = []
    for turns in [keeping] if keeping is not None and fewest <= keeping <= last else counts:
        narrowest, widest = room.trace_width, room.widest(turns)

        def missing(width: float, turns: int = turns) -> float:
            return of(turns, width) - inductance

        width = float(brentq(missing, narrowest, widest, xtol=_TRACE_STEP / 4))
        found.append(Winding(turns, max(_drawn(width, widest), narrowest), room.gap))
    return found[0] if len(found) == 1 else min(found, key=resistance_of)


def _drawn(width: float, widest: float) -> float:
    """Return the nearest width that fits.

    It is in m and can be drawn.
    """
    return min(round(width / _TRACE_STEP), math.floor(widest / _TRACE_STEP * (1 + 1e-9))) * _TRACE_STEP


def _first(holds: Callable[[int], bool], most: int) -> int:
    """Return the least number that fulfils a condition.

    Numbers are whole and begin with 1. A condition that holds for a number must hold for all larger numbers. `most` + 1
    if it does not hold.
    """
    return 1 + bisect_left(range(1, most + 1), True, key=holds)


def _out_of_reach(inductance: float, what_can: str, room: Room) -> str:
    return (
        f"an inductance of {inductance * 1e6:.4g} µH cannot be reached: {what_can}, traces of at least "
        f"{room.trace_width * 1e3:g} mm and gaps of {room.gap * 1e3:g} mm."
    )
