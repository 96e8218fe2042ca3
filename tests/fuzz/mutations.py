"""Mutations of files, all functions of a seeded generator: bytes, text, trees, datasets, databases, archives."""

from __future__ import annotations

import copy
import io
import json
import sqlite3
import tempfile
import tomllib
import warnings
import zipfile
import zlib
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w
import xarray as xr

from coilarray.compute.netcdf import netcdf_in

Mutation = Callable[[np.random.Generator, bytes], bytes]

NUMBERS = (
    0, -1, 1, 2, 3, 255, 1 << 31, 1 << 63, 10**40, -0.0, 0.5, 1e-300, 5e-324, 1e-9, 1e-3, 1e3, 1e6, 1e9, 1e150, 1e308,
    -1e308, float("nan"), float("inf"), float("-inf"),
)  # fmt: skip
"""Numbers that are put in place of others."""

VALUES = (
    *NUMBERS, True, False, "", " ", "x", "coil1", "x" * 2000, "a\nb", "\x00", "\u202ené", "../x", "NaN", "1e400", [],
    {}, [[]], [1, 2], [[1, 2], [3]], {"a": 1}, ["x", "x"], [None], None,
)  # fmt: skip
"""Values of a tree that are put in place of others."""

_TEXTS = (
    b"nan", b"inf", b"-inf", b"1e400", b"-1", b"0", b"99999999999999999999", b"1e-320", b"", b" ", b"\xff\xfe", b"\x00",
    b'"', b"[", b"]", b"{", b"(", b")", b"=", b"#", b"\n", b"\r", b",", b"..", b"0x10", b"true", b"\xf0\x9f\x98\x80",
)  # fmt: skip
_DIGITS = frozenset(b"0123456789.eE+-")


def _pick(random: np.random.Generator, values: Any) -> Any:
    return values[int(random.integers(len(values)))]


def bytes_changed(random: np.random.Generator, data: bytes) -> bytes:
    """Flip, set, insert, delete, double or cut bytes, at one to eight places."""
    changed = bytearray(data)
    for _ in range(int(random.integers(1, 9))):
        if not changed:
            break
        at = int(random.integers(len(changed)))
        length = int(random.integers(1, 1 + min(64, len(changed))))
        match int(random.integers(6)):
            case 0 | 1:
                changed[at] ^= 1 << int(random.integers(8))
            case 2:
                changed[at] = int(random.integers(256))
            case 3:
                changed[at:at] = random.bytes(length)
            case 4:
                del changed[at : at + length]
            case _:
                changed[at:at] = changed[at : at + length]
    if random.random() < 0.1:
        del changed[int(random.integers(len(changed) + 1)) :]
    return bytes(changed)


def one_bit(random: np.random.Generator, data: bytes) -> bytes:
    """Flip one bit."""
    changed = bytearray(data)
    changed[int(random.integers(len(changed)))] ^= 1 << int(random.integers(8))
    return bytes(changed)


def text_changed(random: np.random.Generator, data: bytes) -> bytes:
    """Replace a number or a word, or delete, double, swap or cut lines."""
    lines = data.split(b"\n")
    at = int(random.integers(len(lines)))
    match int(random.integers(6)):
        case 0 | 1:
            line = lines[at]
            spans = _number_spans(line)
            if spans:
                start, end = _pick(random, spans)
                lines[at] = line[:start] + _pick(random, _TEXTS) + line[end:]
            else:
                lines[at] = _pick(random, _TEXTS) + line
        case 2:
            del lines[at]
        case 3:
            lines.insert(at, lines[at])
        case 4:
            other = int(random.integers(len(lines)))
            lines[at], lines[other] = lines[other], lines[at]
        case _:
            start = int(random.integers(len(lines[at]) + 1))
            lines[at] = lines[at][:start] + _pick(random, _TEXTS) + lines[at][start:]
    return b"\n".join(lines)


def lines_changed(random: np.random.Generator, data: bytes) -> bytes:
    """Delete, double, move or shuffle whole lines."""
    lines = data.splitlines(keepends=True)
    at, to = (int(random.integers(len(lines))) for _ in range(2))
    match int(random.integers(4)):
        case 0:
            del lines[at : at + int(random.integers(1, 4))]
        case 1:
            lines.insert(to, lines[at])
        case 2:
            lines.insert(to, lines.pop(at))
        case _:
            random.shuffle(lines)
    return b"".join(lines)


def cut(random: np.random.Generator, data: bytes) -> bytes:
    """Cut a file at any place."""
    return data[: int(random.integers(len(data)))]


def _number_spans(line: bytes) -> list[tuple[int, int]]:
    spans, start = [], None
    for k, byte in enumerate(line + b" "):
        inside = byte in _DIGITS
        if inside and start is None:
            start = k
        elif not inside and start is not None:
            if any(48 <= one <= 57 for one in line[start:k]):
                spans.append((start, k))
            start = None
    return spans


def tree_changed(random: np.random.Generator, tree: Any) -> Any:
    """Change one to three places of a tree of tables, lists and values: replaced, scaled, deleted, renamed, doubled."""
    changed = json.loads(json.dumps(tree, default=str))
    for _ in range(int(random.choice([1, 1, 1, 2, 3]))):
        _change_place(random, changed)
    return changed


def _change_place(random: np.random.Generator, tree: Any) -> None:
    places = list(_places(tree))
    if not places:
        return
    holder, key = _pick(random, places)
    value, kind = holder[key], int(random.integers(10))
    if isinstance(value, int | float) and not isinstance(value, bool) and kind < 5:
        with np.errstate(all="ignore"):
            factor = float(_pick(random, (-1, 0.1, 0.5, 0.99, 1 + 1e-12, 1.01, 2, 10, 1e3, 1e6, 1e-6)))
        holder[key] = type(value)(value * factor) if isinstance(value, float) else int(value * factor)
    elif kind < 7:
        holder[key] = copy.deepcopy(_pick(random, VALUES))  # a later change may be made within it
    elif kind == 7:
        del holder[key]
    elif kind == 8 and isinstance(holder, dict):
        holder[_pick(random, (key + "x", "", "unknown", "a b", key.upper()))] = holder.pop(key)
    elif isinstance(holder, list):
        holder.insert(key, copy.deepcopy(value))
    else:
        holder[key] = [value]


def _places(tree: Any) -> Any:
    items = tree.items() if isinstance(tree, dict) else enumerate(tree) if isinstance(tree, list) else ()
    for key, value in items:
        yield tree, key
        yield from _places(value)


def toml_changed(random: np.random.Generator, data: bytes) -> bytes:
    """Change places of the tables of a TOML file."""
    tree = tree_changed(random, tomllib.loads(data.decode("utf-8-sig")))
    return tomli_w.dumps(_without_none(tree)).encode("utf-8", "replace")


def _without_none(tree: Any) -> Any:
    if isinstance(tree, dict):
        return {key: _without_none(value) for key, value in tree.items() if value is not None}
    if isinstance(tree, list):
        return [_without_none(value) for value in tree if value is not None]
    return tree


def json_changed(random: np.random.Generator, data: bytes) -> bytes:
    """Change places of a JSON file."""
    return json.dumps(tree_changed(random, json.loads(data))).encode()


def dataset_changed(random: np.random.Generator, data: bytes) -> bytes:
    """Change one to three variables, dimensions or attributes of a netCDF file, or cut it where that fails."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        dataset = _opened(data).copy(deep=True)
        for _ in range(int(random.choice([1, 1, 1, 2, 3]))):
            try:
                dataset = _dataset_change(random, dataset)
            except (ValueError, TypeError, KeyError, OverflowError, AttributeError, xr.MergeError):
                continue
        memory = io.BytesIO()
        try:
            with netcdf_in(memory, dataset, invalid_netcdf=True):
                pass
            return memory.getvalue()
        except Exception:  # not every dtype and attribute can be written
            return data[: int(random.integers(len(data)))]


@cache
def _opened(data: bytes) -> xr.Dataset:
    with xr.open_dataset(io.BytesIO(data), engine="h5netcdf") as opened:
        return opened.load()


def _dataset_change(random: np.random.Generator, dataset: xr.Dataset) -> xr.Dataset:
    name = str(_pick(random, list(dataset.variables)))
    variable = dataset.variables[name]
    dim = str(_pick(random, list(dataset.sizes))) if dataset.sizes else ""
    match int(random.integers(14)):
        case 0:
            return dataset.drop_vars(name)
        case 1:
            return dataset.rename({name: f"{name}_other"})
        case 2:
            return dataset.rename_dims({dim: f"{dim}_other"}) if dim not in dataset.coords else dataset.drop_vars(dim)
        case 3 | 4:
            values = variable.values.copy()
            if values.size and values.dtype.kind in "fiu":
                values = values.astype(np.float64)
                values.flat[int(random.integers(values.size))] = float(_pick(random, NUMBERS))
            return _with_values(dataset, name, values)
        case 5:
            with np.errstate(all="ignore"):
                factor = float(_pick(random, NUMBERS))
                return _with_values(dataset, name, np.asarray(variable.values, dtype=np.float64) * factor)
        case 6:
            kind = _pick(random, ("S", "U", "c16", "i1", "f4", "b", "datetime64[ns]", "timedelta64[ns]", "u8", "i8"))
            with warnings.catch_warnings(), np.errstate(all="ignore"):
                warnings.simplefilter("ignore")
                return _with_values(dataset, name, variable.values.astype(kind))
        case 7:
            return dataset.isel({dim: slice(None, None, -1)})
        case 8:
            return dataset.isel({dim: slice(0, int(random.integers(0, 4)))})
        case 9:
            values = variable.values.copy()
            if values.size > 1:
                values.flat[0] = values.flat[-1]
            return _with_values(dataset, name, values)
        case 10:
            return dataset.assign({name: (tuple(random.permutation(variable.dims)), variable.values.T, variable.attrs)})
        case 11:
            key = str(_pick(random, list(dataset.attrs))) if dataset.attrs else "noise"
            value = _pick(random, (*NUMBERS, "", "x", "x" * 5000, "a\nb", [1.0, 2.0], ["a", "b"]))
            return dataset.assign_attrs({key: float(value) if isinstance(value, int) else value})
        case 12:
            dataset = dataset.copy()
            key = _pick(
                random, ("units", "_FillValue", "scale_factor", "add_offset", "calendar", "dtype", "coordinates")
            )
            unit = _pick(random, ("mm", "1", "", "days since 2000-01-01", "seconds", 3.0, "x", float("nan"), "y x"))
            dataset[name].attrs[key] = unit
            return dataset
        case _:
            length = int(_pick(random, (0, 1, 5, 1000)))
            return dataset.drop_vars(name).assign({name: (("foreign",), random.standard_normal(length))})


def _with_values(dataset: xr.Dataset, name: str, values: Any) -> xr.Dataset:
    new = (dataset.variables[name].dims, values, dataset.variables[name].attrs)
    return dataset.assign_coords({name: new}) if name in dataset.coords else dataset.assign({name: new})


def database_changed(random: np.random.Generator, data: bytes) -> bytes:
    """Change cells or rows of a SQLite file, or a table as a whole."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "changed.sqlite")
        path.write_bytes(data)
        connection = sqlite3.connect(path)
        try:
            for _ in range(int(random.choice([1, 1, 2]))):
                _database_change(random, connection)
                connection.commit()
        except sqlite3.Error:
            connection.rollback()
        finally:
            connection.close()
        return path.read_bytes()


def _is_tree(text: str) -> bool:
    """Whether a text is a JSON object or list; the change before may have cut it."""
    try:
        return isinstance(json.loads(text), dict | list)
    except ValueError:
        return False


def _database_change(random: np.random.Generator, connection: sqlite3.Connection) -> None:
    query = "SELECT name FROM sqlite_master WHERE type = 'table' ORDER BY name"
    table = str(_pick(random, [name for (name,) in connection.execute(query)]))
    columns = [row[1] for row in connection.execute(f"PRAGMA table_info({table})")]
    column = str(_pick(random, columns))
    keys = columns[:2] if table == "sample" else columns[:1]
    rows = connection.execute(f"SELECT {', '.join(keys)} FROM {table} ORDER BY 1").fetchall()
    connection.execute("PRAGMA foreign_keys = OFF")
    if not rows:
        return
    row = _pick(random, rows)
    where = " AND ".join(f"{key} = ?" for key in keys)
    match int(random.integers(8)):
        case 0:
            connection.execute(f"DELETE FROM {table} WHERE {where}", row)
        case 1:
            connection.execute(f"DROP TABLE {table}")
        case 2:
            connection.execute(f"UPDATE {table} SET {column} = CAST(x'80ff41' AS TEXT) WHERE {where}", row)
        case 3 | 4:
            (old,) = connection.execute(f"SELECT {column} FROM {table} WHERE {where}", row).fetchone()
            if isinstance(old, str) and _is_tree(old):
                new: Any = json.dumps(tree_changed(random, json.loads(old)))
            elif isinstance(old, str):
                new = old[: int(random.integers(len(old) + 1))]
            else:
                new = _pick(random, (0, -1, 1 << 40, -1e308, 1e308, 1e-300, "x", b"\xff", (old or 0) + 1))
            connection.execute(f"UPDATE {table} SET {column} = ? WHERE {where}", (new, *row))
        case _:
            value = _pick(random, (0, -1, 65535, 65536, 1 << 62, 1e308, "", "x", "{}", "[]", b"", b"\xff\x00", 0.5))
            connection.execute(f"UPDATE {table} SET {column} = ? WHERE {where}", (value, *row))


def zip_changed(random: np.random.Generator, data: bytes) -> bytes:
    """Change a file in an archive, how it is compressed, its name or its checksum, or leave it out or double it."""
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        files = [(name, archive.read(name)) for name in archive.namelist()]
    at = int(random.integers(len(files)))
    name, text = files[at]
    kind = int(random.integers(9))
    methods = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA)
    method = int(_pick(random, methods))
    if kind < 4:
        files[at] = (name, text_changed(random, text))
    elif kind == 4:
        files[at] = (name, bytes_changed(random, text))
    elif kind == 5:
        del files[at]
    elif kind == 6:
        files[at] = (str(_pick(random, ("x.gbr", name + "x", "a/" + name, "x.GTL", "x.drl", "é.gbl"))), text)
    elif kind == 7:
        files.append((f"copy-{name}", text))
    buffer = io.BytesIO()
    with warnings.catch_warnings(), zipfile.ZipFile(buffer, "w", method if kind == 8 else zipfile.ZIP_DEFLATED) as new:
        warnings.simplefilter("ignore")
        for each, content in files:
            new.writestr(zipfile.ZipInfo(each), content, new.compression)
    whole = buffer.getvalue()
    if kind == 8 and random.random() < 0.7:  # damage within what is compressed
        start = whole.find(b"PK\x01\x02")
        where = int(random.integers(30, max(start, 31)))
        whole = whole[:where] + bytes([whole[where] ^ 0x55]) + whole[where + 1 :]
    return whole


def seed_of(name: str) -> int:
    """Return the number of a kind that enters the seed of its cases."""
    return zlib.crc32(name.encode())
