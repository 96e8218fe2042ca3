"""What an emulated board needs of the coils behind its switches; `SensorWorld` has all their physics."""

from __future__ import annotations

from typing import Protocol

from coilarray.design.scan_states import ScanState
from coilarray.hardware.emulator.conversion import Resonator
from coilarray.hardware.emulator.indenter import Place


class World(Protocol):
    """Physics of the coils behind the switches."""

    def check(self, place: Place) -> None:
        """Refuse a place where the indenter cannot go; HardwareError."""

    def resonator(self, state: ScanState, place: Place, temperature: float) -> Resonator | None:
        """Return the tank that the converter drives at its resonance; None where nothing oscillates.

        `state` has the measured coils and the terminations of the others; `temperature` is the board's in °C.
        """
