"""The real board: open it, tell it its settings, scan, and read inductances from what it returns; and its emulator.

`open_board` opens a board of any kind, `load_wiring` reads how its switches are wired, `read_scan` turns what the board
returns into frequencies and inductances. The functions that make settings and test a board have the names of their
modules:
`coilarray.hardware.scan.settings.scan_settings`, `coilarray.hardware.scan.design_settings.design_settings` and
`coilarray.hardware.board.self_test.self_test`.

Importing it touches no port and loads nothing else; the first name that is asked for does.

Examples
--------
>>> from coilarray.hardware import load_wiring, read_scan
>>> from coilarray.hardware.scan.settings import scan_settings
>>> settings = scan_settings(load_wiring())
>>> len(settings.states)
6
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from coilarray.hardware.board.connect import Board, open_board
    from coilarray.hardware.board.self_test import SelfTest
    from coilarray.hardware.chips.ldc1614 import code_to_frequency, frequency_to_code, inductance_from_frequency
    from coilarray.hardware.chips.ldc1614_limits import Drive, Limit, check_channel, drive_for, settle_count
    from coilarray.hardware.scan.reader import Reader
    from coilarray.hardware.scan.readings import read_scan
    from coilarray.hardware.scan.settings import ScanSettings
    from coilarray.hardware.scan.wiring import Wiring, load_wiring

__all__ = [
    "Board",
    "Drive",
    "Limit",
    "Reader",
    "ScanSettings",
    "SelfTest",
    "Wiring",
    "check_channel",
    "code_to_frequency",
    "drive_for",
    "frequency_to_code",
    "inductance_from_frequency",
    "load_wiring",
    "open_board",
    "read_scan",
    "settle_count",
]

_HOME = {
    "board.connect": ("Board", "open_board"),
    "chips.ldc1614": ("code_to_frequency", "frequency_to_code", "inductance_from_frequency"),
    "chips.ldc1614_limits": ("Drive", "Limit", "check_channel", "drive_for", "settle_count"),
    "scan.reader": ("Reader",),
    "scan.readings": ("read_scan",),
    "scan.settings": ("ScanSettings",),
    "board.self_test": ("SelfTest",),
    "scan.wiring": ("Wiring", "load_wiring"),
}


def __getattr__(name: str) -> object:
    """Load the module of a name when it is asked for."""
    home = next((module for module, names in _HOME.items() if name in names), None)
    if home is None:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{home}"), name)
