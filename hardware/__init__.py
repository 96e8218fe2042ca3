"""The real board: number formats and limits of its chips, without any I/O."""

from coilarray.hardware.ldc1614 import code_to_frequency, frequency_to_code, inductance_from_frequency
from coilarray.hardware.ldc1614_limits import Drive, Limit, check_channel, drive_for, settle_count

__all__ = [
    "Drive",
    "Limit",
    "check_channel",
    "code_to_frequency",
    "drive_for",
    "frequency_to_code",
    "inductance_from_frequency",
    "settle_count",
]
