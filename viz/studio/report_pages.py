"""Reports that the pages of one studio have written.

Each report has an address that nobody can guess.
"""

from __future__ import annotations

import hashlib
import secrets
from pathlib import Path


class ReportPages:
    """Files of reports by a random key.

    A file that was changed after it was added is not served any more.
    """

    def __init__(self) -> None:
        self._written: dict[str, tuple[Path, bytes]] = {}  # with the SHA-256 digest of the file

    def add(self, path: Path) -> str:
        """Add a report that was just written.

        The key of the report is returned. A file that cannot be read raises an OSError.
        """
        key = secrets.token_hex(16)
        self._written[key] = path, _digest(path.read_bytes())
        return key

    def read(self, key: str) -> bytes | None:
        """Read the report of a key.

        The result is None for an unknown key, and for a file that is gone or was replaced.
        """
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
