"""The bundled design files, each a board that was published."""

from __future__ import annotations

from coilarray.design.toml_file import TomlFiles
from coilarray.errors import DesignError

STARTER = "gast2020"
"""The design that commands take when none is named."""

DESIGNS = TomlFiles("design", DesignError, __name__)
"""Design files."""

names, read = DESIGNS.names, DESIGNS.read
