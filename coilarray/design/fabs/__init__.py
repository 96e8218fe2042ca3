"""The bundled profiles of board houses: their stated limits, each with its source and the date it was read."""

from __future__ import annotations

from importlib import resources


def names() -> tuple[str, ...]:
    """Names of the bundled profiles, sorted."""
    folder = resources.files("coilarray.design.fabs")
    return tuple(sorted(entry.name.removesuffix(".toml") for entry in folder.iterdir() if entry.name.endswith(".toml")))


def read(name: str) -> str:
    """Text of the bundled profile `name`.

    Raises
    ------
    KeyError
        No such profile.
    """
    if name not in names():
        raise KeyError(name)
    return resources.files("coilarray.design.fabs").joinpath(f"{name}.toml").read_text(encoding="utf-8")
