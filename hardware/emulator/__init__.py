"""An emulated board: chips at the level of their registers, coils by this package's physics."""

from __future__ import annotations

from coilarray.hardware.emulator.board import (
    Conditions,
    Drift,
    EmulatedBoard,
    Oscillator,
    PacedClock,
    VirtualClock,
    emulated_board,
)
from coilarray.hardware.emulator.ldc1614_chip import Ldc1614, UndocumentedUse

__all__ = [
    "Conditions",
    "Drift",
    "EmulatedBoard",
    "Ldc1614",
    "Oscillator",
    "PacedClock",
    "UndocumentedUse",
    "VirtualClock",
    "emulated_board",
]
