"""One rule for all commands that write: each replaces what it wrote itself, and nothing else without --force.

A command recognises its own file by size and time of modification, which are kept in the store: a file that was edited
since, or that another command or program wrote, is not its own. If the store cannot be written or was deleted, no file
is.
"""

from __future__ import annotations

import os
import stat
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING

from coilarray.errors import OutputError

if TYPE_CHECKING:
    from coilarray.compute.store import Store


@contextmanager
def replacing(command: str, *paths: Path, force: bool) -> Iterator[None]:
    """Refuse as `require_own` before the block; afterwards remember the files that it wrote."""
    require_own(command, paths, force=force)
    before = [_state(path) for path in paths]
    try:
        yield
    finally:
        remember(command, [path for path, state in zip(paths, before, strict=True) if _state(path) != state])


def require_own(command: str, paths: Iterable[Path], *, force: bool) -> None:
    """Raise OutputError for a file that exists and is not as the command left it, without `force`."""
    for path in () if force else paths:
        state = _state(path)
        if state is not None and _remembered(path) != [command, *state]:
            raise OutputError(f"{path} exists and is not as `coilarray {command}` left it; --force replaces it.")


def remember(command: str, paths: Iterable[Path]) -> None:
    """Keep in the store that the command wrote these files."""
    for path in paths:
        state = _state(path)
        if state is not None:
            with suppress(OutputError, OSError):
                store, key = _entry(path)
                store.put(key, [command, *state])


def _state(path: Path) -> list[int] | None:
    """Return size and time of a file; None if there is none."""
    try:
        found = path.stat()
    except (OSError, ValueError):  # ValueError: a name with a zero byte
        return None
    return [found.st_size, found.st_mtime_ns] if stat.S_ISREG(found.st_mode) else None


def _remembered(path: Path) -> object:
    """Return which command wrote a file last, and the file's state then; None if unknown."""
    with suppress(OutputError, OSError):
        store, key = _entry(path)
        return store.get(key)
    return None


def _entry(path: Path) -> tuple[Store, str]:
    """Return the store, and its key for a file, the same for all versions of the code."""
    import hashlib

    from coilarray.compute.store import Store, open_store

    return Store(open_store().folder / "written"), hashlib.sha256(b"written " + os.fsencode(path.resolve())).hexdigest()
