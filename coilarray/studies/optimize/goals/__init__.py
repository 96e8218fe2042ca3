"""The bundled goal files, each an example for the bundled designs."""

from __future__ import annotations

from importlib import resources


def names() -> tuple[str, ...]:
    """Names of the bundled goals, sorted."""
    folder = resources.files("coilarray.studies.optimize.goals")
    return tuple(sorted(entry.name.removesuffix(".toml") for entry in folder.iterdir() if entry.name.endswith(".toml")))


def read(name: str) -> str:
    """Text of the bundled goal `name`.

    Raises
    ------
    KeyError
        No such goal.
    """
    if name not in names():
        raise KeyError(name)
    return resources.files("coilarray.studies.optimize.goals").joinpath(f"{name}.toml").read_text(encoding="utf-8")
