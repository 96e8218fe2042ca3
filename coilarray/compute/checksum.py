"""Checksums of what is written and read back: a bit that flips on a disk is noticed, and never taken for a number.

Values, such as a row of a table, are kept with the `checksum` of them. A whole file ends in a line with the checksum of
all bytes before it, its seal. To readers of TOML that line is a comment, and readers of netCDF (HDF5) stop before it:
the format itself says where it ends. A program that writes into such a file takes the seal off. A file without one is
an older file, or that of another program.
"""

from __future__ import annotations

import csv
import dataclasses
import hashlib
import io
import json
import re
from pathlib import Path
from typing import IO, Any

import numpy as np

from coilarray.errors import DamagedError

COLUMN = "checksum"
"""Name of the last column of a CSV whose lines have checksums."""

_SEAL = re.compile(rb"\n# coilarray checksum ([0-9a-f]{32})\n")
_LENGTH = len("\n# coilarray checksum \n") + 32
_VALUE_BYTES, _FILE_BYTES = 8, 16
_AT_ONCE = 1 << 20  # bytes


def canonical(*parts: Any) -> bytes:
    """Return the bytes that stand for values in a checksum or a key: equal values have equal bytes on every machine.

    The parts are tables, lists, texts, numbers, arrays and dataclasses of these. The order of a table's entries does
    not matter; 1 and 1.0 are different.
    """
    return _ENCODER.encode(parts).encode()


def checksum(*parts: Any) -> str:
    """Return the checksum of values, as `canonical` takes them: 64 bits of BLAKE2b (RFC 7693), hexadecimal.

    Examples
    --------
    >>> checksum("coil1", 5.27e-05)
    '644f82e2f56f9764'
    """
    return checksum_of_bytes(canonical(*parts))


def checksum_of_bytes(data: bytes) -> str:
    """Return the checksum of bytes: 64 bits of BLAKE2b, hexadecimal."""
    return hashlib.blake2b(data, digest_size=_VALUE_BYTES).hexdigest()


def with_checksums(table: str) -> str:
    r"""Return a CSV with one more column, the checksum of the head and the cells of each line.

    Examples
    --------
    >>> print(with_checksums("a,b\n1,2\n"), end="")
    a,b,checksum
    1,2,7594a7c09dbff61f
    """
    head, *rows = csv.reader(io.StringIO(table))
    lines = io.StringIO()
    csv.writer(lines, lineterminator="\n").writerows([[*head, COLUMN], *([*row, checksum(head, row)] for row in rows)])
    return lines.getvalue()


def sealed(data: bytes) -> bytes:
    """Return the content of a file with its seal behind it."""
    return data + _seal(hashlib.blake2b(data, digest_size=_FILE_BYTES))


def unsealed(data: bytes, name: object) -> bytes:
    """Return the content of a file without its seal; DamagedError, which names the file, for one that does not fit."""
    seal = _SEAL.fullmatch(data[-_LENGTH:])
    if seal is None:
        return data
    content = data[:-_LENGTH]
    if sealed(content) != data:
        raise _damaged(name)
    return content


def seal_file(path: Path) -> None:
    """Put the seal behind a file, which is read in blocks; OSError if that fails."""
    with path.open("r+b") as file:
        file.write(_seal(_digest(file, path.stat().st_size)))


def check_seal(path: Path) -> bool:
    """Check a file against its seal, in blocks; return whether it has one.

    DamagedError if the two do not fit, OSError for a file that cannot be read.
    """
    with path.open("rb") as file:
        size = max(path.stat().st_size - _LENGTH, 0)
        file.seek(size)
        seal = file.read()
        if _SEAL.fullmatch(seal) is None:
            return False
        file.seek(0)
        if _seal(_digest(file, size)) != seal:
            raise _damaged(path)
        return True


def _digest(file: IO[bytes], size: int) -> hashlib.blake2b:
    """Take in so many bytes of a file from where it stands."""
    digest = hashlib.blake2b(digest_size=_FILE_BYTES)
    while size > 0 and (block := file.read(min(size, _AT_ONCE))):
        digest.update(block)
        size -= len(block)
    return digest


def _seal(digest: hashlib.blake2b) -> bytes:
    return f"\n# coilarray checksum {digest.hexdigest()}\n".encode("ascii")


def _damaged(name: object) -> DamagedError:
    return DamagedError(f"{name} is damaged, or was changed by another program: its checksum is wrong.")


def _plain(value: Any) -> Any:
    """Return arrays and dataclasses as JSON can hold them."""
    if isinstance(value, np.ndarray):
        return [value.dtype.str, value.shape, hashlib.sha256(np.ascontiguousarray(value).tobytes()).hexdigest()]
    if isinstance(value, bytes):  # what a damaged database has instead of a text
        return ["bytes", value.hex()]
    if isinstance(value, np.generic):
        return value.item()
    if dataclasses.is_dataclass(value):
        return [type(value).__name__, {item.name: getattr(value, item.name) for item in dataclasses.fields(value)}]
    raise TypeError(f"a {type(value).__name__} cannot be part of a key.")


_ENCODER = json.JSONEncoder(sort_keys=True, default=_plain)  # one for all: `json.dumps` makes a new one at every call
