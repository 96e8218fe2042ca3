"""Bundled profiles of board houses, with sources and dates."""

from __future__ import annotations

from coilarray.design.toml_file import TomlFiles
from coilarray.errors import DesignError

PROFILES = TomlFiles("fab profile", DesignError, __name__)
"""Profiles of board houses."""

names, read = PROFILES.names, PROFILES.read
