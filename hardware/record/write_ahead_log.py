"""Whether the log that SQLite writes ahead of a database is whole.

A recording that was killed has its last scans in the file ``-wal`` beside it. SQLite reads that log up to the first
frame whose checksum is wrong and takes the rest for the end of a broken-off write: a flipped bit there would silently
remove every scan after it.
"""

from __future__ import annotations

import struct
import time
from pathlib import Path

import numpy as np

from coilarray.errors import HardwareError

_HEADER, _FRAME = 32, 24  # bytes
_TIMES, _AGAIN = 2, 0.01  # s: what a recorder was writing at this moment is written then
_MAGIC = 0x377F0682  # its last bit: checksums of big-endian words


def require_whole_log(path: Path) -> None:
    """Raise HardwareError if the log beside a recording is damaged, see `log_damage`, or cannot be read."""
    try:
        for left in range(_TIMES, -1, -1):
            damage = log_damage(path)
            if not damage:
                return
            if left:
                time.sleep(_AGAIN)
    except OSError as error:
        raise HardwareError(f"cannot read {path}-wal: {error.strerror}.") from None
    raise HardwareError(f"{path} is damaged: {damage}.")


def log_damage(path: Path) -> str:
    """Say in words what is damaged in the log beside a database; empty if it is whole or there is none.

    A frame that is cut off at the end is not damage: its write was broken off. Frames of an earlier log, which SQLite
    leaves behind those of the present one, have both salts of that one. OSError for a log that cannot be read.

    Notes
    -----
    The format is that of https://www.sqlite.org/fileformat2.html#walformat: a header of 32 bytes, and frames of 24
    bytes and a page. Header and frames carry the checksum of everything from the header on.
    """
    log = Path(f"{path}-wal")
    data = log.read_bytes() if log.is_file() else b""
    if len(data) < _HEADER:
        return ""
    magic, _, page, _, *salts = struct.unpack(">6I", data[:24])
    sums = _summed((0, 0), data[:24], magic)
    if magic & ~1 != _MAGIC or sums != struct.unpack(">2I", data[24:_HEADER]):
        return f"the head of {log.name}: its checksum is wrong"
    size = _FRAME + page
    for number, start in enumerate(range(_HEADER, len(data) - size + 1, size), start=1):
        frame = data[start : start + size]
        found = list(struct.unpack(">2I", frame[8:16]))
        if found[0] != salts[0] and found[1] != salts[1]:
            return ""
        sums = _summed(_summed(sums, frame[:8], magic), frame[_FRAME:], magic)
        if found != salts or sums != struct.unpack(">2I", frame[16:_FRAME]):
            return f"frame {number} of {log.name}: its checksum is wrong"
    return ""


def _summed(sums: tuple[int, int], data: bytes, magic: int) -> tuple[int, int]:
    """Add words to the two sums of SQLite's checksum, modulo 2³²."""
    a, b = sums
    words = np.frombuffer(data, ">u4" if magic & 1 else "<u4").tolist()
    for first, second in zip(words[::2], words[1::2], strict=True):
        a = (a + first + b) & 0xFFFFFFFF
        b = (b + second + a) & 0xFFFFFFFF
    return a, b
