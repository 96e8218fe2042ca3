"""Optional libraries, which come with an extra of the package."""

import importlib
import importlib.util
import json
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

from coilarray.errors import MissingDependencyError


def import_extra(module: str, purpose: str, *, package: str, extra: str) -> ModuleType:
    """Import an optional library, for plural work like "STEP files"."""
    try:
        return importlib.import_module(module)
    except ImportError as error:
        spec = importlib.util.find_spec(module.partition(".")[0])
        if spec is None or (spec.origin is None and isinstance(error, ModuleNotFoundError)):  # or a part of a namespace
            line = not_installed(purpose, package, extra)
        else:  # an extension module hides the error that stopped it, even Ctrl-C, behind an ImportError
            cause = error.__cause__ or error
            if isinstance(cause, KeyboardInterrupt):
                raise cause from None
            line = f"{purpose} need {package}, which cannot be loaded: {str(cause) or type(cause).__name__}."
        raise MissingDependencyError(line) from None


def not_installed(purpose: str, package: str, extra: str) -> str:
    """Return the message on how to install a package."""
    from importlib.metadata import PackageNotFoundError, distribution  # every command imports this module
    from urllib.parse import urlsplit
    from urllib.request import url2pathname

    try:
        record = distribution("coilarray").read_text("direct_url.json")  # written by pip, except from an index
    except PackageNotFoundError:
        record = None
    origin: dict[str, Any] = {"url": ""} if record is None else json.loads(record)
    address = urlsplit(origin["url"])
    path = Path(url2pathname(address.path))
    if "vcs_info" in origin:
        wanted = f'"coilarray[{extra}] @ {origin["vcs_info"]["vcs"]}+{origin["url"]}"'
    elif address.scheme != "file" or not path.exists():
        wanted = f'"coilarray[{extra}]"'
    else:
        editable = "-e " if origin.get("dir_info", {}).get("editable") else ""
        wanted = f'{editable}"{"." if path == Path.cwd() else path}[{extra}]"'
    command = f"{python_command(Path.cwd())} -m pip install {wanted}"
    return f"{purpose} need {package}, which is not installed: {command}."


def python_command(folder: Path) -> str:
    """Return the running Python, as typed in a folder."""
    path = Path(sys.executable or "python")
    typed = str(path.relative_to(folder) if path.is_relative_to(folder) else path)
    return f'"{typed}"' if " " in typed else typed
