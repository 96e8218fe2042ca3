"""Compare every number of two report folders, to show that a change of the code keeps them.

    python benchmarks/compare_reports.py OLD NEW [--tolerance 1e-9] [--rename coils.csv:inductance_H=open_inductance_H]

Reads CSV, JSON and netCDF files. Rows of tables are matched by their texts (names of coils, states, …) and, among equal
ones, by their order; columns and variables by their names. Prints each changed number with its relative change, and
what one folder lacks. The exit code is 1 where anything differs.
"""

from __future__ import annotations

import argparse
import csv
import json
import math
import sys
from collections.abc import Iterator, Mapping, Sequence, Set
from pathlib import Path

import xarray as xr

Number = float | str
RENAMED = {"coils": {"inductance_H": "open_inductance_H"}}
"""Columns that have another name now, by the name of their table: the old name and the new one."""
CHANGING = ("date", "coilarray_version", "design_hash")
"""Entries that say when and with what a report was made."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Compare two report folders and return the exit code.

    Parameters
    ----------
    arguments : sequence of str, optional
        Command line without the program's name; that of the process by default.

    Returns
    -------
    int
        0 where all numbers agree, 1 where any differs or one folder lacks something.
    """
    parser = argparse.ArgumentParser(description="Compare every number of two report folders.")
    parser.add_argument("old", type=Path, help="Folder with the report's data before the change.")
    parser.add_argument("new", type=Path, help="Folder with the report's data after the change.")
    parser.add_argument("--tolerance", type=float, default=1e-9, help="Largest relative change that is none.")
    parser.add_argument(
        "--rename", action="append", default=[], metavar="TABLE:OLD=NEW", help="A column with another name now."
    )
    given = parser.parse_args(arguments)
    renamed = {table: dict(names) for table, names in RENAMED.items()}
    for text in given.rename:
        table, _, names = text.partition(":")
        old, _, new = names.partition("=")
        renamed.setdefault(table.removesuffix(".csv"), {})[old] = new
    lines = list(differences(given.old, given.new, given.tolerance, renamed))
    print(*lines, sep="\n", end="\n" if lines else "")
    print(f"{len(lines)} differences" if lines else f"no number changed by more than {given.tolerance:g} of its size")
    return 1 if lines else 0


def differences(
    old: Path, new: Path, tolerance: float = 1e-9, renamed: Mapping[str, Mapping[str, str]] = RENAMED
) -> Iterator[str]:
    """Describe each difference between two report folders in one line.

    Parameters
    ----------
    old, new : Path
        Folders with CSV, JSON and netCDF files.
    tolerance : float
        Largest change that is none, relative to the larger of the two numbers; for an array relative to its largest
        number, so that rounding around zero counts as none.
    renamed : mapping of str to mapping of str to str
        Columns that have another name now, by the name of their table: old names and new names.

    Yields
    ------
    str
        Place, both values and the relative change; or what is missing or new.
    """
    suffixes = {".csv": _csv_values, ".json": _json_values, ".nc": _netcdf_values}
    first, second = ({path.name for path in folder.iterdir() if path.suffix in suffixes} for folder in (old, new))
    if not first:
        yield f"{old}: no CSV, JSON or netCDF file"
    yield from _missing_and_new("file", first, second)
    for name in sorted(first & second):
        read = suffixes[Path(name).suffix]
        before, after = read(old / name, renamed), read(new / name, {})
        groups = sorted(before.keys() & after.keys())
        kind = "column" if name.endswith(".csv") else "variable" if name.endswith(".nc") else "entry"
        yield from (f"{name}: {line}" for line in _missing_and_new(kind, before.keys(), after.keys()))
        for group in groups:
            yield from (f"{name}: {group}{line}" for line in _compared(before[group], after[group], tolerance))


def _missing_and_new(kind: str, old: Set[str], new: Set[str]) -> Iterator[str]:
    yield from (f"missing {kind} {name}" for name in sorted(old - new))
    yield from (f"new {kind} {name}" for name in sorted(new - old))


def _compared(old: Mapping[str, Number], new: Mapping[str, Number], tolerance: float) -> Iterator[str]:
    """Differences of the values of one column or variable, each with its place."""
    yield from (f" {line}" for line in _missing_and_new("value at", old.keys(), new.keys()))
    numbers = [abs(value) for value in old.values() if isinstance(value, float) and math.isfinite(value)]
    rounding = tolerance * 1e-3 * max(numbers, default=0.0)
    for place, before in old.items():
        if place not in new or before == new[place]:
            continue
        after = new[place]
        if isinstance(before, str) or isinstance(after, str):
            yield f"{place}: {before!r} → {after!r}"
        elif not (math.isnan(before) and math.isnan(after)):
            change = abs(after - before)
            size = max(abs(before), abs(after))
            if not change <= max(tolerance * size, rounding):
                yield f"{place}: {before:.12g} → {after:.12g} ({(after - before) / size:+.3g})"


def _value(text: str) -> Number:
    try:
        return float(text)
    except ValueError:
        return text


def _csv_values(path: Path, renamed: Mapping[str, Mapping[str, str]]) -> dict[str, dict[str, Number]]:
    """Values of a table by column and row."""
    with path.open(encoding="utf-8", newline="") as lines:
        return _table_values(list(csv.DictReader(lines)), renamed.get(path.stem, {}))


def _table_values(rows: Sequence[Mapping[str, object]], renamed: Mapping[str, str]) -> dict[str, dict[str, Number]]:
    """Values by column and row; a row is named by its texts and the number of rows before it with the same ones."""
    values: dict[str, dict[str, Number]] = {}
    seen: dict[str, int] = {}
    for row in rows:
        cells = {renamed.get(key, key): _value(str(value)) for key, value in row.items()}
        texts = ", ".join(value for value in cells.values() if isinstance(value, str) and value)
        seen[texts] = seen.get(texts, 0) + 1
        for key, value in cells.items():
            values.setdefault(key, {})[f" [{texts} #{seen[texts]}]"] = value
    return values


def _json_values(path: Path, renamed: Mapping[str, Mapping[str, str]]) -> dict[str, dict[str, Number]]:
    """Values of a JSON file by entry; lists of mappings are tables."""
    values: dict[str, dict[str, Number]] = {}
    for key, entry in json.loads(path.read_text(encoding="utf-8")).items():
        if isinstance(entry, list) and entry and all(isinstance(row, dict) for row in entry):
            table = _table_values(entry, renamed.get(key, {}))
            values |= {f"{key}.{column}": column_values for column, column_values in table.items()}
        else:
            values[key] = dict(_leaves(entry))
    return values


def _leaves(entry: object, place: str = "") -> Iterator[tuple[str, Number]]:
    """Yield the place and value of every number and text in nested mappings and lists."""
    parts = entry.items() if isinstance(entry, dict) else enumerate(entry) if isinstance(entry, list) else None
    if parts is None:
        yield place, _value(str(entry))
        return
    for key, part in parts:
        if key not in CHANGING:
            yield from _leaves(part, f"{place}.{key}")


def _netcdf_values(path: Path, renamed: Mapping[str, Mapping[str, str]]) -> dict[str, dict[str, Number]]:
    """Values of a netCDF file by variable and position, coordinates included, and its attributes."""
    with xr.open_dataset(path, engine="h5netcdf") as dataset:
        names = renamed.get(path.stem, {})
        values: dict[str, dict[str, Number]] = {
            "attributes": {f" {key}": _value(str(value)) for key, value in dataset.attrs.items() if key not in CHANGING}
        }
        for name, variable in dataset.variables.items():
            flat = variable.values.ravel().tolist()
            shape = "×".join(map(str, variable.shape))
            places = (f" [{k} of {shape}]" for k in range(len(flat)))
            key = names.get(str(name), str(name))
            values[key] = {place: _value(str(value)) for place, value in zip(places, flat, strict=True)}
    return values


if __name__ == "__main__":
    sys.exit(main())
