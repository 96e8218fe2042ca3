"""The bundled goal files, each an example for the bundled designs."""

from __future__ import annotations

from coilarray.compute.toml_files import bundled_names, bundled_text


def names() -> tuple[str, ...]:
    """Return the names of the bundled goals, sorted."""
    return bundled_names(__name__)


def read(name: str) -> str:
    """Return the text of a bundled goal; KeyError where there is none of that name."""
    return bundled_text(__name__, name)
