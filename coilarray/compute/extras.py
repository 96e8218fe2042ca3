"""Libraries that only some work needs, and that come with an extra of the package."""

from __future__ import annotations

import importlib
import importlib.util
import json
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

from coilarray.errors import MissingDependencyError


def import_extra(module: str, purpose: str, *, package: str, extra: str) -> ModuleType:
    """Import a module, by its dotted name, of an optional library that `purpose` needs ("STEP files", in the plural).

    MissingDependencyError says how to install it, `package` by the `extra` of coilarray, or why it cannot be loaded.
    """
    try:
        return importlib.import_module(module)
    except ImportError as error:
        if importlib.util.find_spec(module.partition(".")[0]) is None:
            line = not_installed(purpose, package, extra)
        else:  # an extension module hides what stopped it, even Ctrl-C, behind an ImportError
            cause = error.__cause__ or error
            if isinstance(cause, KeyboardInterrupt):
                raise cause from None
            line = f"{purpose} need {package}, which cannot be loaded: {str(cause) or type(cause).__name__}."
        raise MissingDependencyError(line) from None


def not_installed(purpose: str, package: str, extra: str) -> str:
    """Return the line that says how to install `package` by an extra of coilarray; `purpose` is in the plural."""
    return f"{purpose} need {package}, which is not installed: {_install_command(extra)}."


def _install_command(extra: str) -> str:
    """Return the command that adds an extra, by the Python that runs, to coilarray as it was installed."""
    return f"{python_command(Path.cwd())} -m pip install {_requirement(extra)}"


def python_command(folder: Path) -> str:
    """Return the Python that runs, as one types it in a folder."""
    path = Path(sys.executable or "python")
    typed = str(path.relative_to(folder) if path.is_relative_to(folder) else path)
    return f'"{typed}"' if " " in typed else typed


def _requirement(extra: str) -> str:
    """Return what pip needs in order to find this coilarray again: a name, a folder, a file or an address."""
    from importlib.metadata import PackageNotFoundError, distribution  # every command imports this module
    from urllib.parse import urlsplit
    from urllib.request import url2pathname

    try:
        record = distribution("coilarray").read_text("direct_url.json")  # written by pip, except from an index
    except PackageNotFoundError:
        record = None
    origin: dict[str, Any] = {"url": ""} if record is None else json.loads(record)
    if "vcs_info" in origin:
        return f'"coilarray[{extra}] @ {origin["vcs_info"]["vcs"]}+{origin["url"]}"'
    address = urlsplit(origin["url"])
    path = Path(url2pathname(address.path))
    if address.scheme != "file" or not path.exists():
        return f'"coilarray[{extra}]"'
    editable = "-e " if origin.get("dir_info", {}).get("editable") else ""
    return f'{editable}"{"." if path == Path.cwd() else path}[{extra}]"'
