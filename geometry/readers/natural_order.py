"""Names with numbers in them, in the order in which people count."""

from __future__ import annotations

import re


def natural_order(name: str) -> list[tuple[bool, int, str]]:
    """Return a key that sorts "A2" before "A10", and numbers before letters.

    Examples
    --------
    >>> sorted(["A10", "A2", "B1", "7"], key=natural_order)
    ['7', 'A2', 'A10', 'B1']
    """
    parts = re.findall(r"[0-9]+|[^0-9]+", name)
    return [(not part.isdecimal(), int(part) if part.isdecimal() else 0, part) for part in parts]
