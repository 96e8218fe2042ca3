"""Write files whole or not at all."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from coilarray.errors import CoilarrayError, OutputError

# there is no way to read the mask without setting it; once, before any thread runs
_UMASK = os.umask(0o022)
os.umask(_UMASK)


def write_atomically(path: Path, write: Callable[[Path], None]) -> None:
    """Let `write` fill a temporary file beside `path` with the same suffix, then give it the name `path`.

    OutputError if the file cannot be written; `path` is then as it was before.
    """
    with writing(path):
        handle, name = tempfile.mkstemp(prefix=f".{path.stem}-", suffix=path.suffix, dir=path.parent)
        temporary = Path(name)
        try:
            os.close(handle)
            write(temporary)
            temporary.chmod(0o666 & ~_UMASK)  # mkstemp's 0600 is for secrets
            temporary.replace(path)
        finally:
            temporary.unlink(missing_ok=True)


@contextmanager
def writing(path: object, *others: type[Exception]) -> Iterator[None]:
    """Turn what the system says of a file that it cannot write into an OutputError that names the file.

    `others` are errors that say the same, such as ValueError for a name with a zero byte.
    """
    failures: tuple[type[Exception], ...] = (OSError, *others)
    try:
        yield
    except failures as error:
        raise OutputError(f"cannot write {path}: {getattr(error, 'strerror', None) or error}.") from None


def write_text(path: Path, text: str) -> None:
    """Write a UTF-8 text file, whole or not at all; OutputError if that fails."""

    def write(temporary: Path) -> None:
        temporary.write_text(text, encoding="utf-8")

    write_atomically(path, write)


def write_bytes(path: Path, data: bytes) -> None:
    """Write a file, whole or not at all; OutputError if that fails."""

    def write(temporary: Path) -> None:
        temporary.write_bytes(data)

    write_atomically(path, write)


def require_suffix(path: Path, *suffixes: str) -> None:
    """Raise OutputError for a file with another suffix."""
    if path.suffix.lower() not in suffixes:
        allowed = " or ".join(filter(None, (", ".join(suffixes[:-1]), suffixes[-1])))
        raise OutputError(f"cannot write {path}: the suffix must be {allowed}; got {path.suffix!r}.")


def read_text(path: Path, error: type[CoilarrayError]) -> str:
    """Read a UTF-8 text file, with or without a byte order mark; `error`, one line, where that fails."""
    try:
        return path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError:
        raise error(f"cannot read {path}: it is not UTF-8 text.") from None
    except (OSError, ValueError) as reason:  # ValueError: a name with a zero byte
        raise error(f"cannot read {path}: {getattr(reason, 'strerror', reason)}.") from None


def make_folder(path: Path) -> None:
    """Make a folder and its parents where they do not exist; OutputError if that fails."""
    try:
        path.mkdir(parents=True, exist_ok=True)
    except (FileExistsError, NotADirectoryError):
        raise OutputError(f"cannot make the folder {path}: a file has that name.") from None
    except OSError as error:
        raise OutputError(f"cannot make the folder {path}: {error.strerror}.") from None
