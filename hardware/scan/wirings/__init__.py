"""The bundled wirings: which switch joins which coil to what."""

from __future__ import annotations

from importlib import resources

STARTER = "six_coils"
"""The wiring that is taken when none is named."""


def names() -> tuple[str, ...]:
    """Names of the bundled wirings, sorted."""
    folder = resources.files("coilarray.hardware.scan.wirings")
    return tuple(sorted(entry.name.removesuffix(".toml") for entry in folder.iterdir() if entry.name.endswith(".toml")))


def read(name: str) -> str:
    """Text of the bundled wiring `name`.

    Raises
    ------
    KeyError
        No such wiring.
    """
    if name not in names():
        raise KeyError(name)
    return resources.files("coilarray.hardware.scan.wirings").joinpath(f"{name}.toml").read_text(encoding="utf-8")
