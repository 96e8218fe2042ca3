"""A zip or folder of fabrication data: which file is which."""

from __future__ import annotations

import importlib
import importlib.util
import os
import re
import zipfile
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath
from types import ModuleType
from typing import Literal

from coilarray.errors import BoardError, MissingDependencyError

_FILE_FUNCTION = re.compile(r"TF\.FileFunction,([^*\r\n]+)")
_GERBER = re.compile(r"%\s*FS[LTD]?[AI]|^G04\b", re.MULTILINE)
_EXCELLON = re.compile(r"^\s*M48\s*$", re.MULTILINE)
# names that promise a layer or a drill file, whatever made them
_PROMISES_DATA = re.compile(r".*\.(gbr|ger|g[tb][los]|gp?\d+|drl|xln)", re.IGNORECASE)
_NOT_PLATED = re.compile(r"npth|(non|un)\W?plated", re.IGNORECASE)


@dataclass(frozen=True)
class DataFile:
    """One Gerber, Excellon or job file.

    Parameters
    ----------
    label : str
        Where it is, for messages: path of the zip or folder and name in it.
    text : str
        Its content.
    kind : {"gerber", "excellon", "job"}
        The format.
    function : tuple of str
        Fields of the X2 attribute .FileFunction, from the file or from the rules for its name; empty where neither
        says it.
    """

    label: str
    text: str
    kind: Literal["gerber", "excellon", "job"]
    function: tuple[str, ...]


def find_files(path: Path) -> list[DataFile]:
    """Find the Gerber, Excellon and job files of a board and what each is for.

    Parameters
    ----------
    path : Path
        A zip or a folder; files of other kinds in it are passed over.

    Returns
    -------
    list of DataFile
        The functions of the layers come from the X2 attributes where at least one file of copper has one, otherwise
        from gerbonara's rules for the names that the usual programs give.

    Raises
    ------
    BoardError
        A path that is neither, an archive that is damaged, a file that is named as a layer and holds none, or two
        files for one layer.
    MissingDependencyError
        gerbonara is not installed.
    """
    files = [file for label, data in _contents(path) if (file := _recognized(label, data)) is not None]
    if not any(file.function[:1] == ("Copper",) for file in files):
        files = _named(files)
    files = [
        replace(file, function=_drill_function(file)) if file.kind == "excellon" and not file.function else file
        for file in files
    ]
    seen: dict[tuple[str, ...], str] = {}
    for file in files:
        if file.function[:1] == ("Copper",):
            first = seen.setdefault(file.function[:2], file.label)
            if first != file.label:
                raise BoardError(f"{file.label}: is copper layer {file.function[1]}, and so is {first}.")
    return files


def gerbonara(module: str) -> ModuleType:
    """Import one of gerbonara's modules; MissingDependencyError with one line where it is not there or broken."""
    try:
        return importlib.import_module(f"gerbonara.{module}")
    except ImportError as error:
        if importlib.util.find_spec("gerbonara") is None:
            raise MissingDependencyError(
                'Gerber files need gerbonara, which is not installed: pip install "coilarray[fab]".'
            ) from None
        raise MissingDependencyError(
            f"Gerber files need gerbonara, which is installed and cannot be loaded: {error}."
        ) from error


def _contents(path: Path) -> Iterator[tuple[str, bytes]]:
    """Label and bytes of every file, in the order of the names."""
    try:
        if path.is_dir():
            for file in sorted(_files_in(path)):
                if file.is_file() and not _hidden(file.relative_to(path)):
                    yield str(file), file.read_bytes()
            return
        with zipfile.ZipFile(path) as archive:
            for name in sorted(archive.namelist()):
                if not (name.endswith("/") or _hidden(PurePosixPath(name))):
                    yield f"{path}/{name}", archive.read(name)
    except FileNotFoundError:
        raise BoardError(f"{path}: there is no such file or folder.") from None
    except (zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError, RuntimeError) as error:
        raise BoardError(f"{path}: must be a folder or a whole zip of Gerber files; {error}.") from None
    except OSError as error:
        raise BoardError(f"{error.filename or path}: cannot be read: {error.strerror or error}.") from None


def _files_in(folder: Path) -> Iterator[Path]:
    """Give all files in a folder and the ones in it; OSError for one that cannot be listed, which rglob passes over."""

    def refuse(error: OSError) -> None:
        raise error

    for root, _, names in os.walk(folder, onerror=refuse):
        yield from (Path(root, name) for name in names)


def _hidden(name: Path | PurePosixPath) -> bool:
    return any(part.startswith((".", "__MACOSX")) for part in name.parts)


def _recognized(label: str, data: bytes) -> DataFile | None:
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
    """Give Gerber files without X2 attributes their functions by the rules of the program that names most of them."""
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


def _drill_function(file: DataFile) -> tuple[str, ...]:
    return ("NonPlated",) if _NOT_PLATED.search(PurePosixPath(file.label).name) else ("Plated",)
