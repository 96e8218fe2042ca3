"""Standard output and standard error as their readers can take them, whatever the encoding.

Where an encoding lacks a character, a readable one takes its place: um for µm, Ohm for Ω, delta for δ. Numbers that a
program may read have the minus sign of ASCII; on a terminal they keep U+2212.
"""

from __future__ import annotations

import codecs
import io
import re
import sys
import unicodedata
from collections.abc import Callable

_OTHERS = {
    "−": "-", "–": "-", "—": "-", "µ": "u", "μ": "u", "Ω": "Ohm", "…": "...", "·": "*", "×": "x", "±": "+/-", "≤": "<=",
    "≥": ">=", "≈": "~", "→": "->", "°": " deg", "√": "sqrt ", "∞": "inf", "⁄": "/", "“": '"', "”": '"', "‘": "'",
    "’": "'", "•": "*",
}  # fmt: skip
_SUPERSCRIPTS = re.compile("[⁰¹²³⁴⁵⁶⁷⁸⁹⁻⁺]+")
_HANDLER = "coilarray.readable"


def readable(text: str, encoding: str) -> str:
    """Return a text with something readable for each character that an encoding lacks.

    Examples
    --------
    >>> readable("δ = −3·10⁻⁶, 1 kΩ, 2 µm, 5 m²", "ascii")
    'delta = -3*10^-6, 1 kOhm, 2 um, 5 m^2'
    >>> readable("2 µm, δ", "cp1252")
    '2 µm, delta'
    """
    return text.encode(encoding, _HANDLER).decode(encoding)


def prepare_output() -> None:
    """Let both streams of this process take every text."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # there may be none
            _prepare(stream)


def _prepare(stream: io.TextIOWrapper) -> None:
    encoding, for_programs = codecs.lookup(stream.encoding).name, not stream.isatty()
    if encoding == "utf-8":  # names of files may have bytes that are no UTF-8, and are written as they are
        stream.reconfigure(errors="surrogateescape")
        if not for_programs:
            return
    elif encoding == "ascii":  # which typer would replace by UTF-8
        stream.reconfigure(encoding="latin-1")
    write: Callable[[str], int] = stream.write

    def write_readable(text: str) -> int:
        if for_programs:
            text = text.replace("−", "-")
        write(text if encoding == "utf-8" else readable(text, encoding))
        return len(text)

    stream.write = write_readable  # type: ignore[method-assign]


def _replaced(error: UnicodeError) -> tuple[str, int]:
    """Return ASCII for characters that an encoding lacks."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    lacking = _SUPERSCRIPTS.sub(lambda found: f"^{_plain(found[0])}", error.object[error.start : error.end])
    return "".join(_OTHERS.get(one) or _named(one) for one in lacking), error.end


def _named(character: str) -> str:
    """Return a character's ASCII letters, Greek name, or similar sign."""
    if character.isascii():
        return character
    name = unicodedata.name(character, "").replace("LAMDA", "LAMBDA")
    if name.startswith("GREEK SMALL LETTER"):
        return name.rpartition(" ")[2].lower()
    if name.startswith("GREEK CAPITAL LETTER"):
        return name.rpartition(" ")[2].capitalize()
    if name.startswith("BOX DRAWINGS"):
        return "|" if "VERTICAL" in name else "-"
    if name.endswith("BLOCK"):
        return "#"
    return _plain(character) or "?"


def _plain(text: str) -> str:
    return unicodedata.normalize("NFKD", text).replace("−", "-").replace("⁄", "/").encode("ascii", "ignore").decode()


codecs.register_error(_HANDLER, _replaced)
