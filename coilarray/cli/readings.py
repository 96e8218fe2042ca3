"""Readings of the coils from the command line, from files and from streams of JSON lines."""

from __future__ import annotations

import csv
import json
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TypeVar

from coilarray.compute.files import read_text
from coilarray.errors import DamagedError, LocalizeError, shown

Reading = dict[str, float] | list[float]
"""δ by the names of the coils, or in the order of the model."""
_Value = TypeVar("_Value")
_FILES = (".csv", ".json", ".jsonl")


def read_readings(text: str) -> list[Reading | LocalizeError]:
    """Read one argument: coil1=7.1e-4,coil2=3e-4,... or the name of a file, .csv, .json or .jsonl.

    Returns the readings in the order of the file, or what is wrong with each. LocalizeError for another text, a file
    that cannot be read at all, and one without a reading.
    """
    path = Path(text)
    suffix = path.suffix.lower()
    if suffix not in _FILES:
        if "=" not in text:
            raise LocalizeError(
                f"READINGS must be coil1=7.1e-4,coil2=..., a file .csv, .json or .jsonl, or -; got {shown(text)}."
            )
        return [_pairs(text)]
    content = read_text(path, LocalizeError)
    if suffix == ".csv":
        readings = list(_csv_readings(content, path))
    elif suffix == ".jsonl":
        readings = list(line_readings(line.encode() for line in content.splitlines()))
    else:
        readings = _json_file(content)
    if not readings:
        raise LocalizeError(f"there is no reading in {path}.")
    return readings


def typed_names(texts: Iterable[str]) -> list[str]:
    """Return the names in readings on the command line."""
    pairs = (text for text in texts if Path(text).suffix.lower() not in _FILES)
    return [part.partition("=")[0].strip() for text in pairs for part in text.split(",")]


def line_readings(lines: Iterable[bytes]) -> Iterator[Reading | LocalizeError]:
    """Yield one reading, or what is wrong with it, for each line of JSON."""
    for line in lines:
        try:
            yield _json_reading(_parsed(line.decode("utf-8")))
        except UnicodeDecodeError:
            yield LocalizeError("a line must be UTF-8 text.")
        except LocalizeError as error:
            yield error


def _json_reading(value: object) -> Reading | LocalizeError:
    """Return a JSON value as a reading, an object or a list of numbers, or what is wrong with it."""
    try:
        if isinstance(value, dict):
            return {name: _number(name, one) for name, one in value.items()}
        if isinstance(value, list):
            return [_number(f"number {k + 1}", one) for k, one in enumerate(value)]
    except LocalizeError as error:
        return error
    return LocalizeError(f"a reading must be an object or a list of numbers; got {shown(json.dumps(value))}.")


def _json_file(content: str) -> list[Reading | LocalizeError]:
    """Read one reading, or a list of them."""
    value = _parsed(content)
    several = value if isinstance(value, list) and any(isinstance(one, (dict, list)) for one in value) else [value]
    return [_json_reading(one) for one in several]


def _csv_readings(content: str, path: Path) -> Iterator[Reading | LocalizeError]:
    from coilarray.compute.checksum import checked_rows, has_checksums  # it loads NumPy

    try:
        rows = checked_rows(content, path)[0] if has_checksums(content) else list(csv.reader(content.splitlines()))
    except DamagedError as error:
        raise LocalizeError(str(error)) from None
    except csv.Error as error:
        raise LocalizeError(f"cannot read {path}: {error}.") from None
    names = [name.strip() for name in rows[0]] if rows else []
    if len(set(names)) < len(names):
        raise LocalizeError(f"the first line must name every coil once; got {shown(', '.join(names))}.")
    for row in rows[1:]:
        try:
            if len(row) != len(names):
                raise LocalizeError(f"a line must have {len(names)} values; got {len(row)}.")
            yield {name: _from_text(name, value) for name, value in zip(names, row, strict=True)}
        except LocalizeError as error:
            yield error


def _pairs(text: str) -> Reading:
    parts = (part.partition("=") for part in text.split(","))
    named = _named_once([(name.strip(), value) for name, _, value in parts])
    return {name: _from_text(name, value) for name, value in named.items()}


def _parsed(text: str) -> object:
    if not text.strip():
        raise LocalizeError("the line is empty.")
    try:
        return json.loads(text, object_pairs_hook=_named_once)
    except LocalizeError:
        raise
    except (ValueError, RecursionError):
        raise LocalizeError(f"a reading must be JSON; got {shown(text.strip())}.") from None


def _named_once(pairs: list[tuple[str, _Value]]) -> dict[str, _Value]:
    found = dict(pairs)
    if len(found) < len(pairs):
        again = next(name for k, (name, _) in enumerate(pairs) if name in dict(pairs[:k]))
        raise LocalizeError(f"a reading must name a coil once; got {shown(again)} again.")
    return found


def _from_text(name: str, value: str) -> float:
    try:
        return float(value)
    except ValueError:
        raise LocalizeError(f"δ of {name} must be a number; got {shown(value)}.") from None


def _number(name: str, value: object) -> float:
    if isinstance(value, (int, float)) and not isinstance(value, bool):
        try:
            return float(value)
        except OverflowError:
            pass  # an integer of hundreds of digits
    raise LocalizeError(f"δ of {shown(name)} must be a number; got {shown(str(value))}.")
