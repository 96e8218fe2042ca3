"""The independent numbers of tests/reference: one reader for all tests. Each file's header says where they are from."""

from __future__ import annotations

import csv
from pathlib import Path

FOLDER = Path(__file__).parent / "reference"


def rows(name: str) -> list[dict[str, str]]:
    """Rows of tests/reference/ref_NAME.csv as mappings from column to text."""
    with (FOLDER / f"ref_{name}.csv").open(encoding="utf-8", newline="") as lines:
        return list(csv.DictReader(line for line in lines if not line.startswith("#")))
