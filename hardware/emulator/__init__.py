"""An emulated board with chips and coils.

The chips are emulated at the level of their registers, and the coils by this package's physics.
"""

from __future__ import annotations

from coilarray.hardware.emulator.board import EmulatedBoard, Netlist
from coilarray.hardware.emulator.conditions import Conditions, Drift, Oscillator, PacedClock, VirtualClock
from coilarray.hardware.emulator.ldc1614_chip import Ldc1614, OpenPoints, UndocumentedUse
from coilarray.hardware.emulator.make import emulated_board

__all__ = [
    "Conditions",
    "Drift",
    "EmulatedBoard",
    "Ldc1614",
    "Netlist",
    "OpenPoints",
    "Oscillator",
    "PacedClock",
    "UndocumentedUse",
    "VirtualClock",
    "emulated_board",
]
