"""Files of a zip or folder of fabrication data, and their functions."""

from __future__ import annotations

import json
import lzma
import os
import re
import struct
import sys
import zipfile
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path, PurePosixPath
from types import ModuleType
from typing import Any, Literal

from coilarray.compute.extras import import_extra
from coilarray.compute.memory import require_memory
from coilarray.errors import BoardError, GeometryError, shown
from coilarray.geometry.readers.board_copper import Slab, filled_copper, filled_dielectrics, united
from coilarray.geometry.stackup import Stackup

_FILE_FUNCTION = re.compile(r"TF\.FileFunction,([^*\r\n]+)")
_GERBER = re.compile(r"%\s*FS[LTD]?[AI]|^G04\b", re.MULTILINE)
_EXCELLON = re.compile(r"^\s*M48\s*$", re.MULTILINE)
# names that promise a layer or a drill file, whatever made them
_PROMISES_DATA = re.compile(r".*\.(gbr|ger|g[tb][los]|gp?\d+|drl|xln)", re.IGNORECASE)
_NOT_PLATED = re.compile(r"npth|(non|un)\W?plated", re.IGNORECASE)


@dataclass(frozen=True)
class DataFile:
    """Gerber, Excellon or job file.

    `label` is its place for messages: path of the zip or folder, and name in it. `function` has the fields of the X2
    attribute .FileFunction, from the file or from the rules for its name. It is empty if neither gives a function.
    """

    label: str
    text: str
    kind: Literal["gerber", "excellon", "job"]
    function: tuple[str, ...]


def find_files(path: Path) -> list[DataFile]:
    """Find the Gerber, Excellon and job files of a board.

    The zip or folder may hold other files. The functions of the layers come from the X2 attributes if at least one
    copper file has one. Otherwise they come from gerbonara's rules for the names given by the usual programs. Raises
    BoardError if the path is neither a zip nor a folder, an archive is damaged, a file named as a layer holds no layer,
    or two files hold the same layer.
    """
    files = [file for label, data in _contents(path) if (file := _recognized(label, data)) is not None]
    if not any(file.function[:1] == ("Copper",) for file in files) and any(file.kind == "gerber" for file in files):
        files = _named(files)
    for k, file in enumerate(files):
        if file.kind == "excellon" and not file.function:
            not_plated = _NOT_PLATED.search(PurePosixPath(file.label).name)
            files[k] = replace(file, function=("NonPlated" if not_plated else "Plated",))
    seen: dict[tuple[str, ...], str] = {}
    for file in files:
        if file.function[:1] == ("Copper",):
            first = seen.setdefault(file.function[:2], file.label)
            if first != file.label:
                raise BoardError(f"{file.label}: is copper layer {file.function[1]}, and so is {first}.")
    return files


def gerbonara(module: str) -> ModuleType:
    """Import one of gerbonara's modules.

    Raises MissingDependencyError, in one line, if it is missing or broken.
    """
    loaded = sys.modules.get(f"gerbonara.{module}")  # needed for every object
    if loaded is not None and sys.modules.get("gerbonara") is not None:
        return loaded
    return import_extra(f"gerbonara.{module}", "Gerber files", package="gerbonara", extra="fab")


def _contents(path: Path) -> Iterator[tuple[str, bytes]]:
    """Yield label and bytes of every file.

    The files are in the order of their names.
    """
    try:
        if path.is_dir():
            for file in sorted(_files_in(path)):
                if file.is_file() and not _hidden(file.relative_to(path)):
                    require_memory(file.stat().st_size, str(file))
                    yield str(file), file.read_bytes()
            return
        with zipfile.ZipFile(path) as archive:
            require_memory(sum(entry.file_size for entry in archive.infolist()), str(path))
            for name in sorted(archive.namelist()):
                if not (name.endswith("/") or _hidden(PurePosixPath(name))):
                    yield f"{path}/{name}", archive.read(name)
    except FileNotFoundError:
        raise BoardError(f"{path}: there is no such file or folder.") from None
    except (zipfile.BadZipFile, zlib.error, lzma.LZMAError, EOFError, RuntimeError, ValueError, struct.error) as error:
        raise BoardError(f"{path}: must be a folder or an intact zip of Gerber files; {shown(str(error))}.") from None
    except OSError as error:
        raise BoardError(f"{error.filename or path}: cannot be read: {error.strerror or error}.") from None


def _files_in(folder: Path) -> Iterator[Path]:
    """Yield all files in a folder and its subfolders.

    Raises OSError for a folder that cannot be listed, which rglob would skip.
    """

    def refuse(error: OSError) -> None:
        raise error

    for root, _, names in os.walk(folder, onerror=refuse):
        yield from (Path(root, name) for name in names)


def _hidden(name: Path | PurePosixPath) -> bool:
    return any(part.startswith((".", "__MACOSX")) for part in name.parts)


def _recognized(label: str, data: bytes) -> DataFile | None:
    """Recognize a Gerber, Excellon or job file.

    None for other files.
    """
    if label.lower().endswith(".gbrjob"):
        return DataFile(label, _text(data), "job", ())
    text = "" if b"\0" in data else _text(data)
    kind: Literal["gerber", "excellon"]
    if _GERBER.search(text):
        kind = "gerber"
    elif _EXCELLON.search(text):
        kind = "excellon"
    elif _PROMISES_DATA.fullmatch(label):
        raise BoardError(f"{label}: is neither a Gerber nor an Excellon file.")
    else:
        return None
    found = _FILE_FUNCTION.search(text)
    return DataFile(label, text, kind, tuple(found[1].strip().split(",")) if found else ())


def _text(data: bytes) -> str:
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("latin-1")


def _named(files: Sequence[DataFile]) -> list[DataFile]:
    """Add functions to Gerber files without X2 attributes.

    The rules are the rules of the program that names most of the files.
    """
    best: dict[int, tuple[str, int]] = {}
    for rules in gerbonara("layer_rules").MATCH_RULES.values():
        found: dict[int, tuple[str, int]] = {}
        for use, pattern in rules.items():
            for k, file in enumerate(files):
                if not isinstance(pattern, str) or use is None or k in found or file.kind != "gerber":
                    continue
                match = re.fullmatch(pattern, PurePosixPath(file.label).name, re.IGNORECASE)
                if match:
                    number = next((int(group) for group in match.groups() if group and group.isdecimal()), 0)
                    found[k] = use, number
        if len(found) > len(best):
            best = found
    inner = sorted({number for use, number in best.values() if use == "inner copper"})
    functions: dict[str, tuple[str, ...]] = {
        "top copper": ("Copper", "L1", "Top"),
        "bottom copper": ("Copper", f"L{len(inner) + 2}", "Bot"),
        "top mask": ("Soldermask", "Top"),
        "bottom mask": ("Soldermask", "Bot"),
        "mechanical outline": ("Profile",),
    }
    named = []
    for k, file in enumerate(files):
        use, number = best.get(k, ("", 0))
        function = functions.get(use, ())
        if use == "inner copper":
            function = ("Copper", f"L{inner.index(number) + 2}", "Inr")
        named.append(replace(file, function=function or file.function))
    return named


_FILES = "the files do"
_MM = 1e-3


def job_stackup(job: DataFile | None, copper_layers: int, source: str) -> tuple[Stackup, dict[str, str]]:
    """Read the stack-up from a job file.

    The file may be missing. Assumed values are returned as in `BoardCopper`. Layers are named as in the job file,
    otherwise L1, L2, …. `source` is the zip or folder, for messages. Raises BoardError if the file is not JSON, the
    number of layers differs, or thicknesses are impossible.
    """
    document = {} if job is None else _document(job)
    where = source if job is None else job.label
    listed = document.get("MaterialStackup")
    layers = [layer for layer in listed if isinstance(layer, dict)] if isinstance(listed, list) else []
    at = [k for k, layer in enumerate(layers) if layer.get("Type") == "Copper"]
    if at and len(at) != copper_layers:
        raise BoardError(f"{where}: the stack-up has {len(at)} copper layers and there are files for {copper_layers}.")
    assumed: dict[str, str] = {}
    names = tuple(str(layers[k]["Name"]) for k in at if layers[k].get("Name"))
    if len(set(names)) != copper_layers:
        names = tuple(f"L{k + 1}" for k in range(copper_layers))
        assumed["stackup.layers"] = "the files give the order of the layers, not their names"
    slabs: list[Slab] = [
        united(
            [
                (_length(layer, "Thickness"), _positive(layer, "DielectricConstant"))
                for layer in layers[first:last]
                if layer.get("Type") == "Dielectric"
            ]
        )
        for first, last in pairwise(at)
    ]
    copper = filled_copper([_length(layers[k], "Thickness") for k in at] or [None] * copper_layers, _FILES, assumed)
    board = _length(document.get("GeneralSpecs"), "BoardThickness")
    dielectrics = filled_dielectrics(slabs or [(None, None)] * (copper_layers - 1), copper, board, _FILES, assumed)
    try:
        return Stackup(names, copper, *dielectrics), assumed
    except GeometryError as error:
        raise BoardError(f"{where}: {error}") from None


def _document(job: DataFile) -> dict[str, Any]:
    try:
        document = json.loads(job.text)
    except json.JSONDecodeError as error:
        raise BoardError(f"{job.label}:{error.lineno}: is not a complete Gerber job file: {error.msg}.") from None
    return document if isinstance(document, dict) else {}


def _positive(node: Any, key: str) -> float | None:
    value = node.get(key) if isinstance(node, dict) else None
    if not isinstance(value, (int, float)) or isinstance(value, bool) or value <= 0:
        return None
    return float(value)


def _length(node: Any, key: str) -> float | None:
    value = _positive(node, key)
    return None if value is None else value * _MM
