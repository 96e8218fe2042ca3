"""Write files completely or not at all."""

from __future__ import annotations

import errno
import io
import os
import re
import shutil
import stat
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from coilarray.errors import CoilarrayError, OutputError

FOLDER_VARIABLE = "COILARRAY_CACHE"
"""Environment variable that names the folder of the store of results."""
MOST_BYTES = 1_000_000_000
"""Largest size in bytes of a file that is read into memory."""
_LEFT = re.compile(r"\..*-coilarray-(\d+)-[a-z0-9_]{8}(\..*)?", re.DOTALL)

# the mask cannot be read without setting it, once before any thread runs
_UMASK = os.umask(0o022)
os.umask(_UMASK)


def write_atomically(path: Path, write: Callable[[Path], object]) -> None:
    """Write a file whole by filling another and renaming it."""
    with writing(path):
        remove_left(path.parent)
        handle, name = tempfile.mkstemp(prefix=hidden_prefix(path.stem), suffix=path.suffix, dir=path.parent)
        temporary = Path(name)
        try:
            os.close(handle)
            write(temporary)
            temporary.chmod(0o666 & ~_UMASK)  # mkstemp's 0600 is for secrets
            temporary.replace(path)
        finally:
            temporary.unlink(missing_ok=True)


def hidden_prefix(name: str) -> str:
    """Return the prefix of temporary files for `remove_left`."""
    return f".{name[:50]}-coilarray-{os.getpid()}-"


def remove_left(folder: Path) -> None:
    """Delete temporary files that killed programs here left behind."""
    with suppress(OSError):  # files that cannot be listed or deleted stay
        for entry in list(os.scandir(folder)):
            found = _LEFT.fullmatch(entry.name)
            if found is not None and not _is_alive(int(found[1])):
                if entry.is_dir(follow_symlinks=False):
                    shutil.rmtree(entry.path, ignore_errors=True)
                else:
                    os.unlink(entry.path)


def _is_alive(process: int) -> bool:
    """Whether a process exists.

    Always True on Windows, where the check would end it.
    """
    if os.name != "posix":
        return True
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except (OSError, OverflowError):
        return True
    return True


@contextmanager
def writing(path: object, *others: type[Exception]) -> Iterator[None]:
    """Convert errors of writing to OutputError with the file's name."""
    failures: tuple[type[Exception], ...] = (OSError, *others)
    try:
        yield
    except failures as error:
        raise OutputError(f"cannot write {path}: {getattr(error, 'strerror', None) or error}.") from None


def write_text(path: Path, text: str) -> None:
    """Write a UTF-8 text file completely or not at all."""
    write_atomically(path, lambda temporary: temporary.write_text(text, encoding="utf-8"))


def write_bytes(path: Path, data: bytes) -> None:
    """Write a file completely or not at all."""
    write_atomically(path, lambda temporary: temporary.write_bytes(data))


def require_suffix(path: Path, *suffixes: str) -> None:
    """Raise OutputError for a file with another suffix."""
    if path.suffix.lower() not in suffixes:
        allowed = " or ".join(filter(None, (", ".join(suffixes[:-1]), suffixes[-1])))
        raise OutputError(f"cannot write {path}: the suffix must be {allowed}; got {path.suffix!r}.")


def read_text(path: Path, error: type[CoilarrayError]) -> str:
    """Read a UTF-8 file, or raise `error` with one line."""
    try:
        return text_of_file(path)
    except UnicodeDecodeError:
        raise error(f"cannot read {path}: it is not UTF-8 text.") from None
    except (OSError, ValueError) as reason:  # ValueError: a name with a zero byte
        raise error(f"cannot read {path}: {getattr(reason, 'strerror', reason)}.") from None


def text_of_file(path: Path, most: int = MOST_BYTES) -> str:
    """Read a text file without its byte order mark."""
    return io.TextIOWrapper(io.BytesIO(bytes_of_file(path, most)), encoding="utf-8-sig").read()


def bytes_of_file(path: Path, most: int = MOST_BYTES) -> bytes:
    """Read a file or pipe of at most `most` bytes."""
    with open(path, "rb", opener=_open_at_once) as file:
        found = os.fstat(file.fileno())
        if not (stat.S_ISREG(found.st_mode) or stat.S_ISFIFO(found.st_mode)):
            raise OSError(errno.EINVAL, "it is neither a file nor a pipe", str(path))
        if hasattr(os, "set_blocking"):
            os.set_blocking(file.fileno(), True)
        data = b"" if found.st_size > most else file.read(most + 1)
    if max(found.st_size, len(data)) > most:
        raise OSError(errno.EFBIG, f"it must be at most {most} bytes long", str(path))
    return data


def _open_at_once(name: str, flags: int) -> int:
    """Open a file without waiting at a pipe."""
    return os.open(name, flags | getattr(os, "O_NONBLOCK", 0))


def default_folder() -> Path:
    """Return ``COILARRAY_CACHE``, or the user's cache folder."""
    import platformdirs

    return Path(os.environ.get(FOLDER_VARIABLE) or platformdirs.user_cache_dir("coilarray", appauthor=False))


def keep_results(folder: str | Path | None = None) -> None:
    """Keep slow results of this process and workers on disk.

    They are contacts, inductances, capacitances and resistances of copper.
    """
    os.environ[FOLDER_VARIABLE] = str(folder or default_folder())


def make_folder(path: Path) -> None:
    """Make a folder and its missing parents."""
    try:
        path.mkdir(parents=True, exist_ok=True)
    except (FileExistsError, NotADirectoryError):
        raise OutputError(f"cannot make the folder {path}: a file has that name.") from None
    except OSError as error:
        raise OutputError(f"cannot make the folder {path}: {error.strerror}.") from None
