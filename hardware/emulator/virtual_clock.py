"""Time that passes only when somebody waits, so that hours of measuring take seconds."""

from __future__ import annotations

import math

from coilarray.errors import HardwareError


class VirtualClock:
    """A `coilarray.hardware.wire.buses.Clock` without real time.

    Parameters
    ----------
    start : float
        First time in s.

    Examples
    --------
    >>> clock = VirtualClock()
    >>> clock.sleep(0.25)
    >>> clock.now()
    0.25
    """

    def __init__(self, start: float = 0.0) -> None:
        self._now = start

    def now(self) -> float:
        """Return the time in s."""
        return self._now

    def sleep(self, seconds: float) -> None:
        """Let time pass.

        Raises
        ------
        HardwareError
            A time that is not finite.
        """
        if not math.isfinite(seconds):
            raise HardwareError(f"a wait must be finite; got {seconds} s.")
        self._now += max(seconds, 0.0)
