"""The bundled wirings of switches and coils."""

from __future__ import annotations

from coilarray.design.toml_file import TomlFiles
from coilarray.errors import HardwareError

STARTER = "six_coils"
"""The wiring that is taken when none is named."""

WIRINGS = TomlFiles("wiring", HardwareError, __name__)
"""Wiring files."""

names, read = WIRINGS.names, WIRINGS.read
