"""Store of computed results on disk, and the file lock.

The name of an entry is the SHA-256 of everything that decides the result: the inputs, the source
code of the package and the versions of numpy, scipy and numba. The processor is not part of it,
although it changes last digits. Entries are written completely or not at all. The folder may be
deleted at any time, and several runs may use it at once.
"""

from __future__ import annotations

import dataclasses
import functools
import hashlib
import json
import os
import re
import sqlite3
from collections.abc import Callable, Iterable, Iterator
from contextlib import closing, contextmanager, suppress
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any

from coilarray.compute.files import FOLDER_VARIABLE, canonical, default_folder, make_folder, write_bytes, writing
from coilarray.errors import OutputError

if TYPE_CHECKING:
    import xarray as xr

_ROOT = Path(__file__).parent.parent
_COMPUTES_WITH = ("numpy", "scipy", "numba")
_SHOWS = frozenset({"cli", "report", "viz", "__pycache__"})  # folders without influence on results
Keep = Callable[[Iterable[Any], Callable[[], "xr.Dataset"]], "xr.Dataset"]
"""Returns the dataset kept for some parts, as in `content_key`, or computes and keeps it."""
_ENTRY = re.compile(r"([0-9a-f]{64})\.(json|nc)")


@functools.cache
def code_version() -> str:
    """Version of coilarray with a hash of its code.

    Only with the same version, also of numpy, scipy and numba, do two machines compute the same
    numbers, apart from last digits by the processor.
    """
    digest = hashlib.sha256(" ".join(map(metadata.version, _COMPUTES_WITH)).encode() + b"\0")
    sources: dict[str, Path] = {}
    for folder, inside, files in os.walk(_ROOT, followlinks=True):  # geometry is a link in a working copy
        inside[:] = [name for name in inside if name not in _SHOWS]
        paths = (Path(folder, name) for name in files if name.endswith((".py", ".toml", ".csv")))
        sources |= {path.relative_to(_ROOT).as_posix(): path for path in paths}
    for name, path in sorted(sources.items()):
        digest.update(name.encode() + b"\0" + path.read_bytes() + b"\0")
    return f"{metadata.version('coilarray')}+{digest.hexdigest()[:12]}"


@dataclasses.dataclass(frozen=True)
class Store:
    """Results in subfolders by the keys' first two digits."""

    folder: Path

    def get(self, key: str) -> Any | None:
        """Return the JSON value of a key, None if unreadable."""
        path = self._path(key, "json")
        try:
            return json.loads(path.read_bytes())
        except (OSError, ValueError, RecursionError):
            return None

    def put(self, key: str, value: Any) -> None:
        """Keep a JSON value under a key."""
        path = self._path(key, "json")
        make_folder(path.parent)
        write_bytes(path, json.dumps(value).encode())

    def dataset(self, parts: Iterable[Any], compute: Callable[[], xr.Dataset]) -> xr.Dataset:
        """Return the kept dataset, or compute and keep it."""
        from coilarray.compute.netcdf import load_part, save_dataset

        path = self._path(content_key(*parts), "nc")
        found = load_part(path)
        if found is None:
            found = compute()
            with suppress(OutputError):  # a full disk is no reason to lose it
                make_folder(path.parent)
                save_dataset(found, path)
        return found

    def keys(self) -> set[str]:
        """Return the keys of all entries."""
        return {match[1] for path in self.folder.glob("??/*") if (match := _ENTRY.fullmatch(path.name))}

    def discard(self, keys: Iterable[str]) -> None:
        """Delete entries, and the store's folder once it is empty."""
        for key in keys:
            for suffix in ("json", "nc"):
                self._path(key, suffix).unlink(missing_ok=True)
            with suppress(OSError):  # other entries are in it
                self._path(key, "").parent.rmdir()
        with suppress(OSError):
            self.folder.rmdir()

    def _path(self, key: str, suffix: str) -> Path:
        return self.folder / key[:2] / f"{key}.{suffix}"


def open_store(folder: str | Path | None = None) -> Store:
    """Open a store, in a new folder if needed."""
    folder = default_folder() if folder is None else Path(folder)
    make_folder(folder)
    return Store(folder)


def store_to_keep(keep: bool | str | Path) -> Store | None:
    """Open the default store, or a folder's, if wanted."""
    return open_store(None if keep is True else keep) if keep else None


def kept_dataset(parts: Iterable[Any], compute: Callable[[], xr.Dataset]) -> xr.Dataset:
    """Compute a dataset, or return it from the process's store."""
    if not os.environ.get(FOLDER_VARIABLE):
        return compute()
    try:
        store = open_store()
    except OutputError:
        return compute()
    return store.dataset(parts, compute)


def not_kept(parts: Iterable[Any], compute: Callable[[], xr.Dataset]) -> xr.Dataset:
    """Compute a dataset and keep nothing."""
    return compute()


def content_key(*parts: Any) -> str:
    """SHA-256 of `code_version` and all that decides a result."""
    return hashlib.sha256(canonical(code_version(), *parts)).hexdigest()


@contextmanager
def locked_database(path: Path, message: str) -> Iterator[sqlite3.Connection]:
    """Open a SQLite file in autocommit mode, locked to this process.

    The lock ends with the process on every system. OutputError has `message` if the file is locked.
    """
    with writing(path, sqlite3.Error, ValueError):
        there = path.exists()
        connection = sqlite3.connect(path.absolute(), timeout=0, isolation_level=None)
    with closing(connection):
        try:
            connection.execute("PRAGMA locking_mode = EXCLUSIVE")
            (journal,) = connection.execute("PRAGMA journal_mode").fetchone()
            connection.execute("PRAGMA journal_mode = MEMORY")  # no file remains if the process is killed
            connection.execute("BEGIN EXCLUSIVE")
            connection.execute("COMMIT")  # in this mode the lock stays
            connection.execute(f"PRAGMA journal_mode = {journal}")
        except sqlite3.Error as error:
            locked = "locked" in str(error)
            if not (there or locked):
                path.unlink(missing_ok=True)
            raise OutputError(message if locked else f"cannot use {path}: {error}.") from None
        yield connection


def delete_database(path: Path) -> None:
    """Delete a closed SQLite file and its auxiliary files."""
    for end in ("", "-wal", "-shm", "-journal"):
        Path(f"{path}{end}").unlink(missing_ok=True)
