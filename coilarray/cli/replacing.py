"""One rule for all commands that write: each replaces what it wrote itself, and nothing else without --force.

A command recognises its own file by size and time of modification, which are kept in the store: a file that was edited
since, or that another command or program wrote, is not its own. If the store cannot be written or was deleted, no file
is. What a file is about to become is kept before it gets its name, as well as what it was: a command that is killed in
between has left one of the two.
"""

from __future__ import annotations

import os
import stat
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING

from coilarray.compute.files import announce_to
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
    every = tuple(paths)
    for path in () if force else every:
        state = _state(path)
        if state is not None and [command, *state] not in _remembered(path):
            raise OutputError(f"{path} exists and is not as `coilarray {command}` left it; --force replaces it.")
    announce_to(_remember_coming(command, every))


def remember(command: str, paths: Iterable[Path]) -> None:
    """Keep in the store that the command wrote these files."""
    for path in paths:
        state = _state(path)
        if state is not None:
            with suppress(OutputError, OSError):
                store, key = _entry(path)
                store.put(key, [[command, *state]])


def _remember_coming(command: str, paths: Iterable[Path]) -> Callable[[Path, Path], None]:
    """Return what remembers a file that is about to get its name, if it is one of these or in a folder of them."""
    wanted = {path.absolute() for path in paths}
    busy = False

    def tell(temporary: Path, path: Path) -> None:
        nonlocal busy
        full = path.absolute()
        if busy or wanted.isdisjoint({full, *full.parents}):
            return
        busy = True  # the store writes files too
        try:
            states = [state for state in (_state(path), _state(temporary)) if state is not None]
            with suppress(OutputError, OSError):
                store, key = _entry(path)
                store.put(key, [[command, *state] for state in states])
        finally:
            busy = False

    return tell


def _state(path: Path) -> list[int] | None:
    """Return size and time of a file; None if there is none."""
    try:
        found = path.stat()
    except (OSError, ValueError):  # ValueError: a name with a zero byte
        return None
    return [found.st_size, found.st_mtime_ns] if stat.S_ISREG(found.st_mode) else None


def _remembered(path: Path) -> list[object]:
    """Return which command wrote a file last, with the states that it may have left; empty if unknown."""
    with suppress(OutputError, OSError):
        store, key = _entry(path)
        found = store.get(key)
        return found if isinstance(found, list) else []
    return []


def _entry(path: Path) -> tuple[Store, str]:
    """Return the store, and its key for a file, the same for all versions of the code."""
    import hashlib

    from coilarray.compute.store import Store, open_store

    return Store(open_store().folder / "written"), hashlib.sha256(b"written " + os.fsencode(path.resolve())).hexdigest()
