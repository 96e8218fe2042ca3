"""Files: written completely or not at all, and with checksums that reveal any change.

A row of a database is kept with the `checksum` of its values. A TOML file ends in a comment with
the checksum of all bytes before it, its seal.

In a CSV the last column of each line is a checksum of the table up to there. The last line, a
comment, has the number of lines and a checksum of all. Missing, doubled or swapped lines are thus
noticed, and so is a table that is cut. Nothing is repaired.
"""

import csv
import dataclasses
import errno
import hashlib
import io
import json
import os
import re
import shutil
import stat
import tempfile
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from coilarray.errors import CoilarrayError, DamagedError, OutputError

FOLDER_VARIABLE = "COILARRAY_CACHE"
"""Environment variable that names the folder of the store of results."""
MOST_BYTES = 1_000_000_000
"""Largest size in bytes of a file that is read into memory."""
_LEFT = re.compile(r"\..*-coilarray-(\d+)-[a-z0-9_]{8}(\..*)?", re.DOTALL)
_COLUMN = "checksum"  # last column of a CSV whose lines have checksums
_LAST_LINE = "# coilarray checksum of "
_SEAL = re.compile(rb"\n# coilarray checksum ([0-9a-f]{32})\n")
_SEAL_BYTES = len("\n# coilarray checksum \n") + 32
_OF_PAGE = b'name="generator" content="coilarray"'  # in the first bytes of every page
_VALUE_BYTES, _FILE_BYTES = 8, 16

_UMASK = os.umask(0o022)  # the mask cannot be read without setting it, once before any thread runs
os.umask(_UMASK)


def write_atomically(path: str | Path, write: Callable[[Path], object]) -> None:
    """Write a file whole by filling another and renaming it."""
    path = Path(path)
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
    """Whether a process exists, True on Windows, where a look ends it."""
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


def write_text(path: str | Path, text: str) -> None:
    """Write a UTF-8 text file completely or not at all."""
    write_atomically(path, lambda temporary: temporary.write_text(text, encoding="utf-8"))


def write_bytes(path: str | Path, data: bytes) -> None:
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
    at_once = getattr(os, "O_NONBLOCK", 0)  # without waiting at a pipe
    with open(path, "rb", opener=lambda name, flags: os.open(name, flags | at_once)) as file:
        found = os.fstat(file.fileno())
        if not (stat.S_ISREG(found.st_mode) or stat.S_ISFIFO(found.st_mode)):
            raise OSError(errno.EINVAL, "it is neither a file nor a pipe", str(path))
        if hasattr(os, "set_blocking"):
            os.set_blocking(file.fileno(), True)
        data = b"" if found.st_size > most else file.read(most + 1)
    if max(found.st_size, len(data)) > most:
        raise OSError(errno.EFBIG, f"it must be at most {most} bytes long", str(path))
    return data


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


def canonical(*parts: Any) -> bytes:
    """Canonical bytes of values, for checksums and keys.

    They are equal on every machine and for every order of a table's entries. 1 is not 1.0.
    """
    return _ENCODER.encode(parts).encode()


def checksum(*parts: Any) -> str:
    """BLAKE2b (RFC 7693) of `canonical` as 16 hexadecimal digits."""
    return hashlib.blake2b(canonical(*parts), digest_size=_VALUE_BYTES).hexdigest()


def _lines_with_checksums(texts: Iterable[str]) -> list[str]:
    """Lines of a CSV with checksums, and the last line."""
    digest = hashlib.blake2b(digest_size=_VALUE_BYTES)
    lines: list[str] = []
    for text in texts:
        digest.update(f"{text}\n".encode())
        lines.append(f"{text},{digest.hexdigest() if lines else _COLUMN}\n")
    digest.update(b"end")
    return [*lines, f"{_LAST_LINE}{len(lines)} lines: {digest.hexdigest()}\n"]


def with_checksums(table: str) -> str:
    r"""Return a CSV with checksums of its lines.

    No cell may have a line break.

    >>> print(with_checksums("a,b\n1,2\n"), end="")
    a,b,checksum
    1,2,c2b2943baeea3e28
    # coilarray checksum of 2 lines: 0c491b64314daa7d
    """
    return "".join(_lines_with_checksums(table.splitlines()))


def has_checksums(table: str) -> bool:
    """Whether a CSV has checksums, even if it is cut."""
    return table.split("\n", 1)[0].endswith(f",{_COLUMN}") or _LAST_LINE in table


def checked_rows(table: str, name: object) -> list[list[str]]:
    """Return the cells of a `with_checksums` CSV, or DamagedError."""
    *lines, rest = table.split("\n")
    last = lines.pop() if lines and not rest and lines[-1].startswith(_LAST_LINE) else None
    if last is None:
        raise DamagedError(f"{name} is cut: its last line, which has the number of lines and a checksum, is missing.")
    texts = [line.rpartition(",")[0] for line in lines]
    *right, end = _lines_with_checksums(texts)
    for number, (line, expected) in enumerate(zip(lines, right, strict=True), start=1):
        if expected != f"{line}\n":
            raise DamagedError(
                f"{name}, line {number} is damaged, or lines before it are missing or swapped: its checksum is wrong."
            )
    if end != f"{last}\n":
        raise DamagedError(f"{name} is damaged, or lines at its end are missing: the checksum of all lines is wrong.")
    return list(csv.reader(texts))


def sealed(data: bytes) -> bytes:
    """Return a file's content with its seal at the end."""
    digest = hashlib.blake2b(data, digest_size=_FILE_BYTES).hexdigest()
    return data + f"\n# coilarray checksum {digest}\n".encode("ascii")


def has_seal(data: bytes) -> bool:
    """Whether a file ends in a seal, right or wrong."""
    return _SEAL.fullmatch(data[-_SEAL_BYTES:]) is not None


def unsealed(data: bytes, name: object) -> bytes:
    """Return a file's content without its seal, checked."""
    if not has_seal(data):
        raise DamagedError(f"{name} is cut: its last line, a checksum, is missing.")
    content = data[:-_SEAL_BYTES]
    if sealed(content) != data:
        raise DamagedError(f"{name} is damaged, or was changed by another program: its checksum is wrong.")
    return content


def is_own(path: Path) -> bool:
    """Whether a file under a default name may be replaced.

    It is missing, netCDF, a page of coilarray, or sealed as a calibration is.
    """
    if not path.is_file():
        return True
    with writing(path), path.open("rb") as file:
        head = file.read(500)  # of a result that may be large
        return head.startswith((b"\x89HDF", b"CDF")) or _OF_PAGE in head or has_seal(head + file.read())


def _plain(value: Any) -> Any:
    """Return arrays and dataclasses in a form for JSON."""
    import numpy as np  # not above: commands import this module before they set the number of threads of NumPy

    if isinstance(value, np.ndarray):
        return [value.dtype.str, value.shape, hashlib.sha256(np.ascontiguousarray(value).tobytes()).hexdigest()]
    if isinstance(value, bytes):  # a damaged database has bytes instead of a text
        return ["bytes", value.hex()]
    if isinstance(value, np.generic):
        return value.item()
    if dataclasses.is_dataclass(value):
        return [type(value).__name__, {item.name: getattr(value, item.name) for item in dataclasses.fields(value)}]
    raise TypeError(f"a {type(value).__name__} cannot be part of a key.")


_ENCODER = json.JSONEncoder(sort_keys=True, default=_plain)  # one for all: `json.dumps` makes a new one at every call
