"""A board that is not there: the chips at the level of their registers, the coils by our own physics."""

from __future__ import annotations

from coilarray.hardware.emulator.board import Conditions, Drift, EmulatedBoard, Netlist
from coilarray.hardware.emulator.ldc1614_chip import Ldc1614, OpenPoints
from coilarray.hardware.emulator.make import emulated_board, plain_board
from coilarray.hardware.emulator.oscillator import Oscillator, any_oscillator
from coilarray.hardware.emulator.undocumented import UndocumentedUse
from coilarray.hardware.emulator.virtual_clock import VirtualClock

__all__ = [
    "Conditions",
    "Drift",
    "EmulatedBoard",
    "Ldc1614",
    "Netlist",
    "OpenPoints",
    "Oscillator",
    "UndocumentedUse",
    "VirtualClock",
    "any_oscillator",
    "emulated_board",
    "plain_board",
]
