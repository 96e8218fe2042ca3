"""Version of the computing code: a hash of its source and of the versions of the libraries that it uses."""

from __future__ import annotations

import functools
import hashlib
import os
from importlib import metadata
from pathlib import Path

_ROOT = Path(__file__).parent.parent
_COMPUTES_WITH = ("numpy", "scipy", "numba")
_SHOWS = frozenset({"cli", "report", "viz", "__pycache__"})  # folders without influence on results


@functools.cache
def code_version() -> str:
    """Return the version with a hash of the code.

    It is the version of coilarray. The hash covers its source and the versions of numpy, scipy and numba. Two machines
    compute the same numbers only if it is equal, and a number kept on disk is valid only as long as it stays. The
    package's version alone does not change when a working copy is edited or numpy is updated. The processor and its
    mathematical library are not included. They change last digits.
    """
    digest = hashlib.sha256(" ".join(map(metadata.version, _COMPUTES_WITH)).encode() + b"\0")
    for path in _sources():
        digest.update(path.relative_to(_ROOT).as_posix().encode() + b"\0" + path.read_bytes() + b"\0")
    return f"{metadata.version('coilarray')}+{digest.hexdigest()[:12]}"


def _sources() -> list[Path]:
    """Return the source and data files that decide results.

    They are in the same order on every machine.
    """
    found = []
    for folder, inside, files in os.walk(_ROOT, followlinks=True):  # geometry is a link in a working copy
        inside[:] = [name for name in inside if name not in _SHOWS]
        found += [Path(folder, name) for name in files if name.endswith((".py", ".toml", ".csv"))]
    return sorted(found, key=lambda path: path.relative_to(_ROOT).as_posix())
