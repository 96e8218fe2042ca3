"""The bundled wirings of switches and coils."""

from __future__ import annotations

from coilarray.design.toml_file import TomlFiles
from coilarray.errors import HardwareError

STARTER = "six_coils"
"""Name of the default wiring."""

WIRINGS = TomlFiles("wiring", HardwareError, __name__)
"""Wiring files."""

names, read = WIRINGS.names, WIRINGS.read
