"""Read TOML files, given or bundled; every problem is one line of the caller's class of errors."""

from __future__ import annotations

import tomllib
from importlib import resources
from pathlib import Path
from typing import Any

from coilarray.errors import CoilarrayError

_LONGEST_NAME = 200  # characters shown of a file name


def read_text(path: str | Path, missing: str, error: type[CoilarrayError]) -> str:
    """Read a text file in UTF-8.

    Parameters
    ----------
    path : str or Path
        File to read; some editors put a byte order mark first, which is skipped.
    missing : str
        Message where there is no such file.
    error : type
        Class of the errors to raise.
    """
    shown = str(path)[:_LONGEST_NAME]
    try:
        return Path(path).read_text(encoding="utf-8-sig")
    except FileNotFoundError:
        raise error(missing) from None
    except UnicodeDecodeError:
        raise error(f"{shown} is no text file in UTF-8.") from None
    except OSError as problem:
        raise error(f"cannot read {shown}: {problem.strerror}.") from None
    except ValueError as problem:  # a name with a zero byte
        raise error(f"cannot read {shown!r}: {problem}.") from None


def parse_toml(text: str, origin: str, error: type[CoilarrayError]) -> dict[str, Any]:
    """Parse TOML; `origin` names the text in messages."""
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as problem:
        raise error(f"{origin}: not valid TOML: {problem}.") from None
    except RecursionError:
        raise error(f"{origin}: not valid TOML: nested too deeply.") from None


def bundled_names(package: str) -> tuple[str, ...]:
    """Return the names of the TOML files in a package, sorted."""
    entries = resources.files(package).iterdir()
    return tuple(sorted(entry.name.removesuffix(".toml") for entry in entries if entry.name.endswith(".toml")))


def bundled_text(package: str, name: str) -> str:
    """Return the text of a TOML file in a package; KeyError where there is none."""
    if name not in bundled_names(package):
        raise KeyError(name)
    return resources.files(package).joinpath(f"{name}.toml").read_text(encoding="utf-8")
