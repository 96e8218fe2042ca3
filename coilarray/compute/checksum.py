"""Checksums that reveal any change of measured data on disk.

A row of a database is kept with the `checksum` of its values. A TOML file ends in a comment with
the checksum of all bytes before it, its seal.

In a CSV the last column of each line is a checksum of the table up to there. The last line, a
comment, has the number of lines and a checksum of all. Missing, doubled or swapped lines are thus
noticed, and so is a table that is cut. Nothing is repaired.
"""

from __future__ import annotations

import csv
import dataclasses
import hashlib
import json
import re
from typing import Any

import numpy as np

from coilarray.errors import DamagedError

COLUMN = "checksum"
"""Name of the last column of a CSV whose lines have checksums."""
_LAST_LINE = "# coilarray checksum of "
_SEAL = re.compile(rb"\n# coilarray checksum ([0-9a-f]{32})\n")
_LENGTH = len("\n# coilarray checksum \n") + 32
_VALUE_BYTES, _FILE_BYTES = 8, 16


def canonical(*parts: Any) -> bytes:
    """Canonical bytes of values, for checksums and keys.

    Equal values have equal bytes on every machine. The order of a table's entries does not matter.
    1 and 1.0 are different.
    """
    return _ENCODER.encode(parts).encode()


def checksum(*parts: Any) -> str:
    """BLAKE2b (RFC 7693) of `canonical` as 16 hexadecimal digits."""
    return hashlib.blake2b(canonical(*parts), digest_size=_VALUE_BYTES).hexdigest()


class _TableSeal:
    """Checksums of a CSV's lines in their order."""

    def __init__(self) -> None:
        self._digest = hashlib.blake2b(digest_size=_VALUE_BYTES)
        self._lines = 0

    def line(self, text: str) -> str:
        """Return the next line with its checksum and end."""
        self._digest.update(f"{text}\n".encode())
        self._lines += 1
        return f"{text},{COLUMN if self._lines == 1 else self._digest.hexdigest()}\n"

    def end(self) -> str:
        """Return the last line of the file."""
        digest = self._digest.copy()
        digest.update(b"end")
        return f"{_LAST_LINE}{self._lines} lines: {digest.hexdigest()}\n"


def with_checksums(table: str) -> str:
    r"""Return a CSV with checksums of its lines.

    No cell may have a line break.

    >>> print(with_checksums("a,b\n1,2\n"), end="")
    a,b,checksum
    1,2,c2b2943baeea3e28
    # coilarray checksum of 2 lines: 0c491b64314daa7d
    """
    seal = _TableSeal()
    return "".join(map(seal.line, table.splitlines())) + seal.end()


def has_checksums(table: str) -> bool:
    """Whether a CSV has checksums, even if it is cut."""
    return table.split("\n", 1)[0].endswith(f",{COLUMN}") or _LAST_LINE in table


def checked_rows(table: str, name: object) -> list[list[str]]:
    """Return the cells of a `with_checksums` CSV, checked.

    DamagedError is also raised if the last line is missing, as a killed program leaves it.
    """
    *lines, rest = table.split("\n")
    last = lines.pop() if lines and not rest and lines[-1].startswith(_LAST_LINE) else None
    if last is None:
        raise DamagedError(f"{name} is cut: its last line, which has the number of lines and a checksum, is missing.")
    seal, texts = _TableSeal(), [line.rpartition(",")[0] for line in lines]
    for number, (line, text) in enumerate(zip(lines, texts, strict=True), start=1):
        if seal.line(text) != f"{line}\n":
            raise DamagedError(
                f"{name}, line {number} is damaged, or lines before it are missing or swapped: its checksum is wrong."
            )
    if seal.end() != f"{last}\n":
        raise DamagedError(f"{name} is damaged, or lines at its end are missing: the checksum of all lines is wrong.")
    return list(csv.reader(texts))


def sealed(data: bytes) -> bytes:
    """Return a file's content with its seal at the end."""
    digest = hashlib.blake2b(data, digest_size=_FILE_BYTES).hexdigest()
    return data + f"\n# coilarray checksum {digest}\n".encode("ascii")


def has_seal(data: bytes) -> bool:
    """Whether a file ends in a seal, right or wrong."""
    return _SEAL.fullmatch(data[-_LENGTH:]) is not None


def unsealed(data: bytes, name: object) -> bytes:
    """Return a file's content without its seal, checked."""
    if not has_seal(data):
        raise DamagedError(f"{name} is cut: its last line, a checksum, is missing.")
    content = data[:-_LENGTH]
    if sealed(content) != data:
        raise DamagedError(f"{name} is damaged, or was changed by another program: its checksum is wrong.")
    return content


def _plain(value: Any) -> Any:
    """Return arrays and dataclasses in a form for JSON."""
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
