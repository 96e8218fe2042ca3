"""The bundled design files, published boards and examples."""

from coilarray.design.toml_file import TomlFiles
from coilarray.errors import DesignError

STARTER = "gast2020"  # name of the default design of commands
DESIGNS = TomlFiles("design", DesignError, __name__)  # design files
names, read = DESIGNS.names, DESIGNS.read


def names_with(table: str) -> tuple[str, ...]:
    """Names of the bundled designs with a table."""
    return tuple(name for name in names() if table in DESIGNS.parse(read(name), name))
