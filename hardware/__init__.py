"""The real board: number formats of its chips, without any I/O."""

from coilarray.hardware.ldc1614 import code_to_frequency, frequency_to_code, inductance_from_frequency

__all__ = ["code_to_frequency", "frequency_to_code", "inductance_from_frequency"]
