"""The board's microseconds, which wrap every 71.6 minutes, as one time that does not."""

from __future__ import annotations

_WRAP = 1 << 32


class BoardTime:
    """Unwraps the 32-bit time of a board with the computer's clock as the guide.

    The two clocks may differ by half a wrap (35 minutes) between two readings, so pauses of any length are bridged: a
    board whose clock is off by 1 % may be silent for 59 hours.

    Examples
    --------
    >>> time = BoardTime()
    >>> time.unwrap(0xFFFFFFFF, now=100.0), time.unwrap(9, now=100.1)
    (4294967295, 4294967305)
    """

    def __init__(self) -> None:
        self._newest: int | None = None
        self._then = 0.0

    def unwrap(self, microseconds: int, now: float) -> int:
        """Return the time in µs since the wrap before the first reading.

        Parameters
        ----------
        microseconds : int
            As the board sent it, 0 to 2³² − 1; may be older than one before.
        now : float
            The computer's time in s, which never steps back.
        """
        if self._newest is None:
            self._newest, self._then = microseconds, now
            return microseconds
        expected = self._newest + (now - self._then) * 1e6
        unwrapped = microseconds + _WRAP * round((expected - microseconds) / _WRAP)
        if unwrapped > self._newest:
            self._newest, self._then = unwrapped, now
        return unwrapped
