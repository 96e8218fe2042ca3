"""Outcomes of points on disk, one small file each, so that nothing is computed twice.

An outcome is kept under a hash of what decides it: the design with its changed entries, the quantities, the code, and
the versions of numpy, scipy and numba. The processor is not in it, which changes last digits. The folder may be deleted
at any time, and several runs may use it at once.
"""

from __future__ import annotations

import hashlib
import json
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from coilarray.compute.code_version import code_version
from coilarray.compute.files import make_folder, write_text

Outcome = dict[str, float] | str
"""Quantities of a point by name, or the one line why it has none."""

FOLDER_VARIABLE = "COILARRAY_CACHE"


@dataclass(frozen=True)
class PointCache:
    """Outcomes in a folder; `open_cache` makes one.

    Parameters
    ----------
    folder : Path
        Where the files are, in subfolders of the first two digits of their hash.
    """

    folder: Path

    def get(self, key: str) -> Outcome | None:
        """Return what is kept under a key; None where nothing is, or nothing that can be read."""
        try:
            entry = json.loads(self._path(key).read_text(encoding="utf-8"))
        except (OSError, ValueError):  # also where half a disk's block is lost
            return None
        match entry:
            case {"reason": str(reason)}:
                return reason
            case {"values": dict(values)} if all(isinstance(value, float) for value in values.values()):
                return values
        return None

    def put(self, key: str, outcome: Outcome) -> None:
        """Keep an outcome.

        Raises
        ------
        OutputError
            The file cannot be written.
        """
        path = self._path(key)
        make_folder(path.parent)
        write_text(path, json.dumps({"reason" if isinstance(outcome, str) else "values": outcome}) + "\n")

    def _path(self, key: str) -> Path:
        return self.folder / key[:2] / f"{key}.json"


def open_cache(folder: Path | None = None) -> PointCache:
    """Open a cache of points, made where there is none.

    Parameters
    ----------
    folder : Path, optional
        The folder that the environment variable ``COILARRAY_CACHE`` names by default, else the user's cache folder.

    Raises
    ------
    OutputError
        The folder cannot be made.
    """
    import platformdirs

    if folder is None:
        named = os.environ.get(FOLDER_VARIABLE)
        folder = Path(named) if named else Path(platformdirs.user_cache_dir("coilarray", appauthor=False), "points")
    make_folder(folder)
    return PointCache(folder)


def point_key(*parts: Any) -> str:
    """Return the name under which an outcome is kept.

    Parameters
    ----------
    *parts : object
        All that decides the outcome besides what computes it, as plain tables, lists, texts and numbers.

    Returns
    -------
    str
        SHA-256 of the parts and of `coilarray.compute.code_version.code_version`, hexadecimal. The order of a table's
        entries does not count; 1 and 1.0 are different.

    Examples
    --------
    >>> point_key({"a": 1, "b": [2.5]}) == point_key({"b": [2.5], "a": 1})
    True
    """
    text = json.dumps([code_version(), *parts], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()
