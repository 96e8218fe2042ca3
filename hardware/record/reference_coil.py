"""Correction of a drift that all coils have in common, by a coil that nothing touches.

The clock of the converter, its temperature, the capacitor and the board change all inductances by one factor. The
reference coil shows it, so that L_s/L_r no longer has it: δ_s becomes (1 + δ_s)/(1 + δ_r) − 1. The noise of the
reference is added to that of every coil, √2 of it for equal ones. What differs from coil to coil stays, and an
indentation that reaches the reference is taken from all others.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from coilarray.errors import HardwareError
from coilarray.hardware.scan.readings import Reason, ScanReading, StateReading


def require_reference(name: str, states: Sequence[str]) -> None:
    """Raise HardwareError where a reference is none of the states, or the only one."""
    if name not in states or len(states) < 2:
        others = f"one of {', '.join(states)}" if len(states) > 1 else f"another state than {states[0]}, the only one"
        raise HardwareError(f"the reference coil must be {others}; got {name!r}.")


class ReferenceCoil:
    """Corrects scan after scan by the state `name`; its level is that of the first scan in which it has a value."""

    def __init__(self, name: str) -> None:
        self.name = name
        self._level: float | None = None

    def corrected(self, scan: ScanReading) -> ScanReading:
        """Return a scan with the inductances corrected, except that of the reference itself.

        Where the reference has no value, neither has any other state. HardwareError for a scan without the reference.
        """
        require_reference(self.name, [state.name for state in scan.states])
        measured = scan.inductances.get(self.name)
        self._level = measured if self._level is None else self._level
        factor = None if measured is None or self._level is None else self._level / measured
        return replace(scan, states=tuple(self._state(state, factor) for state in scan.states))

    def _state(self, state: StateReading, factor: float | None) -> StateReading:
        if state.name == self.name or state.inductance is None:
            return state
        if factor is None:
            return replace(
                state, frequency=None, inductance=None, verdict="bad", reasons=(*state.reasons, Reason.NO_REFERENCE)
            )
        return replace(state, inductance=state.inductance * factor)
