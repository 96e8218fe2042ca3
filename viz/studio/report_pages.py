"""Reports that the pages of one studio have written, each at an address that nobody can guess."""

from __future__ import annotations

import hashlib
import secrets
from pathlib import Path


class ReportPages:
    """Files of reports by a random key; a file that was changed after it was added is no longer given out."""

    def __init__(self) -> None:
        self._written: dict[str, tuple[Path, bytes]] = {}  # with the SHA-256 digest of the file

    def add(self, path: Path) -> str:
        """Return the key of a report that was just written; OSError where it cannot be read."""
        key = secrets.token_hex(16)
        self._written[key] = path, _digest(path.read_bytes())
        return key

    def read(self, key: str) -> bytes | None:
        """Return the report of a key; None for an unknown key, and for a file that is gone or another one now."""
        if key not in self._written:
            return None
        path, digest = self._written[key]
        try:
            page = path.read_bytes()
        except OSError:
            return None
        return page if _digest(page) == digest else None


def _digest(page: bytes) -> bytes:
    return hashlib.sha256(page).digest()
