"""The bundled design files, each a board that was published."""

from __future__ import annotations

from importlib import resources

STARTER = "gast2020"
"""The design that commands take when none is named."""


def names() -> tuple[str, ...]:
    """Names of the bundled designs, sorted."""
    folder = resources.files("coilarray.design.bundled")
    return tuple(sorted(entry.name.removesuffix(".toml") for entry in folder.iterdir() if entry.name.endswith(".toml")))


def read(name: str) -> str:
    """Text of the bundled design `name`.

    Raises
    ------
    KeyError
        No such design.
    """
    if name not in names():
        raise KeyError(name)
    return resources.files("coilarray.design.bundled").joinpath(f"{name}.toml").read_text(encoding="utf-8")
