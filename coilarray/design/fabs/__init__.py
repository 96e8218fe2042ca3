"""The bundled profiles of board houses: their stated limits, each with its source and the date it was read."""

from __future__ import annotations

from coilarray.design.toml_file import TomlFiles
from coilarray.errors import DesignError

PROFILES = TomlFiles("fab profile", DesignError, __name__)
"""Profiles of board houses."""

names, read = PROFILES.names, PROFILES.read
