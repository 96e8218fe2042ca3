"""Names of `coilarray.hardware` and the modules that they come from; `lazy_loader` reads this file at run time."""

from .board.connect import Board, open_board
from .board.self_test import SelfTest, self_test
from .chips.ldc1614 import code_to_frequency, inductance_from_frequency, settle_count
from .scan.readings import Reader, read_scan
from .scan.settings import ConverterClock, ScanSettings, Sensor, design_settings, scan_settings
from .scan.wiring import Wiring, load_wiring

__all__ = [
    "Board",
    "ConverterClock",
    "Reader",
    "ScanSettings",
    "SelfTest",
    "Sensor",
    "Wiring",
    "code_to_frequency",
    "design_settings",
    "inductance_from_frequency",
    "load_wiring",
    "open_board",
    "read_scan",
    "scan_settings",
    "self_test",
    "settle_count",
]
