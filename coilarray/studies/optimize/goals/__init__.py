"""The bundled goal files, each an example for the bundled designs."""

from __future__ import annotations

from coilarray.design.toml_file import TomlFiles
from coilarray.errors import GoalError

GOALS = TomlFiles("goal", GoalError, __name__)
"""Goal files."""

names, read = GOALS.names, GOALS.read
