"""The one rule of all commands that write: each replaces what it wrote itself, and nothing else without --force.

What a command wrote is known by the file's size and time, which are kept in the store: a file that was edited since, or
that another command or program wrote, is not the command's own. Where the store cannot be written, or was deleted,
nothing is.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING

from coilarray.errors import OutputError

if TYPE_CHECKING:
    from coilarray.compute.store import Store


@contextmanager
def replacing(command: str, *paths: Path, force: bool) -> Iterator[None]:
    """Refuse to replace files that the command did not write, and remember those that the block writes.

    OutputError for a file that exists and is not the command's own, without `force`.
    """
    before = {path: _state(path) for path in paths}
    for path, state in before.items():
        if state is not None and not force and _written(path) != [command, *state]:
            raise OutputError(f"{path} exists, and `coilarray {command}` did not write it so; --force replaces it.")
    try:
        yield
    finally:
        for path, state in before.items():
            now = _state(path)
            if now is not None and now != state:
                with suppress(OutputError, OSError):
                    store, key = _entry(path)
                    store.put(key, [command, *now])


def _state(path: Path) -> list[int] | None:
    """Size and time of a file, None where there is none."""
    try:
        found = path.stat()
    except OSError:
        return None
    return [found.st_size, found.st_mtime_ns]


def _written(path: Path) -> object:
    """Return which command wrote a file last, and the state in which it left it; None where none is known."""
    with suppress(OutputError, OSError):
        store, key = _entry(path)
        return store.get(key)
    return None


def _entry(path: Path) -> tuple[Store, str]:
    """Return the store and the key under which it keeps what is known of a file, for all versions of the code."""
    import hashlib

    from coilarray.compute.store import open_store

    return open_store(), hashlib.sha256(f"written {path.resolve()}".encode()).hexdigest()
