"""Designs as documents and texts, whole or in their file."""

import inspect
import re
import textwrap
import tomllib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from difflib import SequenceMatcher
from functools import cache, partial
from pathlib import Path
from typing import Any, TypeVar

import tomlkit
from tomlkit.exceptions import TOMLKitError
from tomlkit.items import AoT

from coilarray.compute.files import write_text
from coilarray.design.board_tables import BoardTable, ConnectorTable, StackupTable, array_entries, coil_entries
from coilarray.design.body_tables import IndentationTable, PlateTable, SheetTable, indenter_entries, target_entries
from coilarray.design.fabs import FabTable
from coilarray.design.keys import MM, entry_of, sections_of
from coilarray.design.model import (
    Board,
    Design,
    DesignFile,
    build_design_file,
    design_of,
    load_design,
    relative_path,
    with_paths,
)
from coilarray.design.surface_tables import SurfaceArray
from coilarray.design.tables import SCHEMA, CircuitTable, Document, PlacedBoardTable, ReadoutTable, StateTable
from coilarray.errors import DesignError
from coilarray.geometry import Array, FinitePlate, Plate, Pose, Sheet
from coilarray.geometry.conductor import CurrentPaths
from coilarray.geometry.surface_array import OnSurface

_NOT_IN_NAMES = re.compile(r"[^A-Za-z0-9_.+-]+")
# A list of plain values as tomli-w writes it, one value per line.
_FLAT_LIST = re.compile(r"\[\n\s*([^\[\]{}\n]+(?:,\n\s*[^\[\]{}\n]+)*),\n\s*\]")
_HEADER = re.compile(r"^(\[\[?)(?=[\w\"'])", re.MULTILINE)
_LISTS_OF_NAMES = re.compile(r"""\[\n(?:\s*\["[^\[\]\n]*\],\n)+\s*\]""")
_TABLE = re.compile(r"\[\[?([^\]]+)\]\]?$")
_KEY = re.compile(r"""([\w"'.]+)\s*=\s""")
_TITLE = re.compile(r"``\[+[\w.]+\]+``: (.*?)\.?$")
_WIDTH, _LONGEST_LINE = 34, 120
_PLACES = ("lines_mm", "outline_mm", "corners_mm", "holes_mm", "x_mm", "y_mm", "z_mm")
_Body = TypeVar("_Body", Sheet, Plate | FinitePlate)


def design_document(design: Design | DesignFile) -> dict[str, Any]:
    """Return the tables of a design file for a design.

    Parameters
    ----------
    design : Design or DesignFile
        Read from a file or made in Python.

    Returns
    -------
    dict
        Plain tables, lists and values with all their digits. Entries of the circuit and of the
        board house are written only if they differ from the default. Names that a file cannot have
        are changed by `design_names`.

    Examples
    --------
    >>> from coilarray import load_design
    >>> from coilarray.design.model import build_design
    >>> design = load_design("gast2020")
    >>> document = design_document(design)
    >>> document["array"]["pitch_mm"], build_design(document).digest == design.digest
    (13.28, True)
    """
    design = design_of(design)
    array, led = design.array, design.array.routing
    if led is not None and led.placements != array.placements:
        led = None  # the placements have been changed since
    if led is not None:
        stackup, margin, through = array.stackup, array.board_margin, array.through_holes
        array = replace(led.array, stackup=stackup, board_margin=margin, through_holes=through)
    names, layers = design_names(array.names), design_names(array.stackup.names)
    names |= {name: name for name in design.coil_names if name not in names}
    shapes = shape_names(array)
    coils = {shape: place.coil for shape, place in zip(shapes, array.placements, strict=True)}
    made, boards = _made_on_surface(design), design.boards
    if made is not None:
        coils, boards = {made.coil.name or "shape1": made.coil}, boards[len(made.lattice.points) - 1 :]
    document: dict[str, Any] = {"schema": SCHEMA, "name": design_names([design.name])[design.name]}
    if design.title not in ("", design.name):
        document["title"] = design.title
    document |= {key: text for key in ("source", "author", "revision") if (text := getattr(design, key))}
    if led is not None:
        document["connector"] = ConnectorTable.entries_of(led.connector)
    document |= {
        "stackup": StackupTable.entries_of(array.stackup) | {"layers": list(layers.values())},
        "coils": {shape: coil_entries(coil) for shape, coil in coils.items()},
        "array": array_entries(array, shapes, names, layers) if made is None else SurfaceArray.of(made, names, layers),
        "board": BoardTable.of(design.array if made is None else design.array.flat),
    }
    if design.sheets:
        document["elastomer"] = _named_tables(design.sheets, SheetTable.entries_of)
        if (setup := design.indentation) is not None:
            document["indenter"] = indenter_entries(setup.indenter, setup.material)
            document["indentation"] = IndentationTable.of(setup, names)
    if design.plates:
        document["plate"] = _named_tables(design.plates, PlateTable.of)
    if design.target is not None:
        document["target"] = target_entries(design.target, names)
    document["circuit"] = CircuitTable.of(design.circuit, names)
    document["readout"] = ReadoutTable.not_by_default(ReadoutTable.entries_of(design.readout))
    if scan := design.circuit.scan:
        states = design_names(state.name for state in scan)
        document["scan"] = [StateTable.of(state, states[state.name], names) for state in scan]
    if made is None and (any(board.name == "" for board in boards) or design.pose != Pose()):
        raise DesignError(f"{design.name} has boards without names, or a moved board, which a file cannot hold.")
    if boards:
        document["boards"] = [
            PlacedBoardTable.of(board, name, _file_of(board) or design_document(board.design))
            for name, board in list(zip(design.board_names, design.boards, strict=True))[-len(boards) :]
        ]
    document["field"] = {"height_mm": entry_of(design.field_height, MM)}
    document["fab"] = FabTable.not_by_default(FabTable.entries_of(design.rules, without=("profile",)))
    return {key: table for key, table in document.items() if table != {}}


def _made_on_surface(design: Design) -> OnSurface | None:
    """Return what made the first boards of a design, if they are still as made."""
    made = design.array.lattice
    if not isinstance(made, OnSurface):
        return None
    count = len(made.lattice.points)
    boards = (Board(design.array, design.pose, ""), *design.boards[: count - 1])
    coils = [board.array.placements[0].coil for board in boards]
    same = len(boards) == count and all(
        board.name == "" and board.pose == pose
        for board, pose in zip(boards, made.lattice.poses(coils, design.array.stackup), strict=False)
    )
    return made if same else None


def _file_of(board: Board) -> str | None:
    """Return the file of a board, if it still holds the board."""
    try:
        return board.file if board.file and load_design(board.file).digest == board.design.digest else None
    except DesignError:
        return None


def _named_tables(bodies: Sequence[_Body], entries: Callable[[_Body], dict[str, Any]]) -> list[dict[str, Any]]:
    names = design_names(body.name for body in bodies)
    return [{"name": body.name} | entries(body) | {"name": names[body.name]} for body in bodies]


def as_file(given: Design | DesignFile | CurrentPaths) -> DesignFile:
    """Return a design, or coils, with a document."""
    if isinstance(given, DesignFile):
        return given
    design = design_of(given)
    return replace(build_design_file(design_document(design), design.name), design=design)


def design_text(design: Design, assumed: Mapping[str, str] | None = None, folder: Path | None = None) -> str:
    """Return the TOML text of a design, to 1 nm and 12 digits.

    `assumed` has dotted keys with reasons, ``coils.*.KEY`` of every shape, ``coils.NAME.KEY`` of
    one. Paths begin from a `folder`, if given.
    """
    document = _rounded(design_document(design))
    document = document if folder is None else with_paths(document, partial(relative_path, folder))
    of_coil = dict(zip(design.array.names, shape_names(design.array), strict=True))
    reasons: dict[str, str] = {}
    for key, reason in (assumed or {}).items():
        owners = [name for name in of_coil if key.startswith(f"coils.{name}.")]
        if key.startswith("coils.*."):
            reasons |= {f"coils.{shape}.{key.removeprefix('coils.*.')}": reason for shape in document["coils"]}
        elif owners:
            name = max(owners, key=len)
            reasons[f"coils.{of_coil[name]}.{key.removeprefix(f'coils.{name}.')}"] = reason
        else:
            reasons[key] = reason
    return document_text(document | ({"assumed": reasons} if reasons else {}))


def document_text(document: Mapping[str, Any]) -> str:
    """Return the TOML text of a document."""
    import tomli_w

    def is_tables(value: object) -> bool:
        return isinstance(value, list) and bool(value) and all(isinstance(item, dict) for item in value)

    plain = {key: value for key, value in document.items() if not (isinstance(value, dict) or is_tables(value))}
    blocks = [tomli_w.dumps(plain)] if plain else []
    for key, value in document.items():
        if is_tables(value):  # tomli-w writes short tables on one line
            blocks += [f"[[{key}]]\n" + _HEADER.sub(rf"\g<1>{key}.", tomli_w.dumps(table)) for table in value]
        elif key not in plain:
            blocks.append(tomli_w.dumps({key: value}))
    return _LISTS_OF_NAMES.sub(_on_one_line, _FLAT_LIST.sub(_on_one_line, "\n".join(blocks)))


def shape_names(array: Array) -> list[str]:
    """Return the name of each placement's coil table."""
    found: dict[int, str] = {}
    for place in array.placements:
        if id(place.coil) not in found:
            name = place.coil.name or f"shape{len(found) + 1}"
            found[id(place.coil)] = _different(name, found.values())
    return [found[id(place.coil)] for place in array.placements]


def design_names(names: Iterable[str]) -> dict[str, str]:
    """Return names that a file can have, of letters, digits, _ . + and, not first, -."""
    found: dict[str, str] = {}
    for name in names:
        found[name] = _different(name, found.values())
    return found


def _different(name: str, taken: Iterable[str]) -> str:
    allowed = _NOT_IN_NAMES.sub("_", name.lstrip("/")).lstrip("-") or "_"
    different, n, others = allowed, 1, set(taken)
    while different in others:
        n += 1
        different = f"{allowed}_{n}"
    return different


def save_design(design: Design | DesignFile, path: str | Path) -> None:
    """Write a design as a commented TOML file.

    Parameters
    ----------
    design : Design or DesignFile
        A file keeps its keys, comments and layout. Keys of a design made in Python are written with
        their meanings as comments.
    path : str or Path
        File to write. An existing file is replaced.

    Raises
    ------
    OutputError
        A file that cannot be written.
    """
    folder = Path(path).absolute().parent
    if isinstance(design, DesignFile):
        write_text(Path(path), file_text(design, folder))
    else:
        write_text(Path(path), with_comments(design_text(design, folder=folder)))


def file_text(file: DesignFile, folder: Path) -> str:
    """Return the text of a design file with its layout, for a folder from which its paths begin."""
    document = with_paths(file.document, partial(relative_path, folder))
    return edited_text(file.text, document) or with_comments(document_text(document))


def with_comments(text: str) -> str:
    """Return a design file's text with meanings behind entries."""
    titles, meanings = _meanings()
    lines, path, kind = [], "", ""
    for line in text.splitlines():
        comment = ""
        if found := _TABLE.match(line):
            path, kind = _path(found[1]), ""
            comment = titles.get(path, "")
        elif found := _KEY.match(line):
            key = found[1].strip("\"'")
            if key in ("shape", "lattice"):
                kind = line.partition("=")[2].strip(' "')
            comment = meanings.get((path, key, kind)) or meanings.get((path, key, ""), "")
        whole = [f"{line:{_WIDTH - 1}} # {words}" for words in (comment, re.split(r"; | \(|: ", comment)[0]) if words]
        lines.append(next((one for one in whole if len(one) <= _LONGEST_LINE), line))
    return "\n".join(lines) + "\n"


def _path(header: str) -> str:
    """Return the table of a header with NAME and N."""
    parts = header.split(".")
    if parts[0] == "coils":
        parts[1:2] = ["NAME"]
    lists = ("elastomer", "plate", "scan", "boards", "array.placements", "circuit.ports")
    return ".".join(parts + (["N"] if header in lists else []))


@cache
def _meanings() -> tuple[dict[str, str], dict[tuple[str, str, str], str]]:
    """Return the meanings of tables and keys by their paths."""
    titles: dict[str, str] = {}
    meanings: dict[tuple[str, str, str], str] = {}
    for section in sections_of(Document):
        title = (inspect.getdoc(section.table) or "").split("\n\n")[0].replace("\n", " ")
        if found := _TITLE.match(title):
            titles[section.path] = found[1]
        for key in section.keys:
            for kind in (*section.kinds, ""):
                meanings.setdefault((key.path, key.name, kind), key.meaning.rstrip("."))
    return titles, meanings


def _rounded(value: Any, key: str = "") -> Any:
    """Round places to 1 nm and numbers to 12 digits."""
    if isinstance(value, dict):
        return {name: _rounded(item, name) for name, item in value.items()}
    if isinstance(value, list):
        return [_rounded(item, key) for item in value]
    if not isinstance(value, float):
        return value
    return (round(value, 6) if key in _PLACES else float(f"{value:.12g}")) + 0.0


def _on_one_line(match: re.Match[str]) -> str:
    """Write a list of values or short lists on one line, values that do not fit on several."""
    text = "[" + " ".join(line.strip() for line in match[0].splitlines()[1:-1]).rstrip(",") + "]"
    if "[" in text[1:]:
        return text if len(text) <= _LONGEST_LINE // 2 else match[0]
    return text if len(text) <= _LONGEST_LINE else "\n".join(textwrap.wrap(text, _LONGEST_LINE))


def edited_text(text: str, document: Mapping[str, Any]) -> str | None:
    """Return a TOML text changed to `document`, None if it needs a new text."""
    if not text:
        return None
    try:
        file = tomlkit.parse(text)
        _edit(file, tomllib.loads(text), document)
        found = tomlkit.dumps(file)
        return found if tomllib.loads(found) == document else None
    except (TOMLKitError, tomllib.TOMLDecodeError):  # a layout that tomlkit cannot change
        return None


def _edit(table: Any, old: Mapping[str, Any], wanted: Mapping[str, Any]) -> None:
    for key in [key for key in old if key not in wanted]:
        del table[key]
    for key, value in wanted.items():
        if key not in old:
            table[key] = _item(value)
        elif _is_other(old[key], value):
            if isinstance(old[key], Mapping) and isinstance(value, Mapping):
                _edit(table[key], old[key], value)
            elif isinstance(table[key], AoT) and value and all(isinstance(item, Mapping) for item in value):
                _edit_tables(table[key], old[key], value)
            elif isinstance(old[key], list) and isinstance(value, list) and old[key] and value:
                _edit_list(table[key], old[key], value)
            else:
                table[key] = _item(value)


def _edit_tables(tables: AoT, old: Sequence[Mapping[str, Any]], wanted: Sequence[Mapping[str, Any]]) -> None:
    before, after, there = list(map(_known_by, old)), list(map(_known_by, wanted)), list(tables)
    found = []
    for k, (name, item) in enumerate(zip(after, wanted, strict=True)):
        renamed = len(old) == len(wanted) and before[k] not in after
        at = before.index(name) if name in before else k if renamed else None
        if at is None:
            found.append(_item(item))
        else:
            _edit(there[at], old[at], item)
            found.append(there[at])
    del tables[:]
    for table in found:
        tables.append(table)


def _edit_list(items: Any, old: Sequence[Any], wanted: Sequence[Any]) -> None:
    before, after = list(map(_known_by, old)), list(map(_known_by, wanted))
    for _, first, end, start, stop in SequenceMatcher(None, before, after, autojunk=False).get_opcodes()[::-1]:
        both = min(end - first, stop - start)
        for k in range(both):
            was, value = old[first + k], wanted[start + k]
            if isinstance(was, Mapping) and isinstance(value, Mapping):
                _edit(items[first + k], was, value)
            elif isinstance(was, list) and isinstance(value, list) and was and value:
                _edit_list(items[first + k], was, value)
            elif _is_other(was, value):
                items[first + k] = _item(value)
        del items[first + both : end]
        for k in range(both, stop - start):
            items.insert(first + k, _item(wanted[start + k]))


def _known_by(item: Any) -> str:
    return str(item["name"]) if isinstance(item, Mapping) and "name" in item else repr(item)


def _is_other(before: Any, after: Any) -> bool:
    """Check whether a value has changed: 23.0 is 23, but 1 is not true."""
    return bool(before != after) or isinstance(before, bool) != isinstance(after, bool)


def _item(value: Any) -> Any:
    """Return a new value in the layout of package files."""
    return tomlkit.parse(document_text({"k": value}))["k"]
