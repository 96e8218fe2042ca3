"""Design of a page: its file, folder, and entries with a slider."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

from coilarray.compute.files import write_text
from coilarray.design import bundled
from coilarray.design.keys import Key, entry_unit, key_in_si, keys_of
from coilarray.design.model import Design, DesignFile, build_design_file, load_design_file, parse_design_file
from coilarray.design.tables import Document
from coilarray.design.vary import vary_chosen
from coilarray.design.write import file_text
from coilarray.errors import CoilarrayError, DesignError, OutputError

MOST_COILS = 64  # largest number of coils of a design in the studio
MOST_SEGMENTS = 400_000  # largest number of straight segments of all windings together
_LATTICE_SIZES = {"columns": 1, "rows": 1, "rings": 0}


@dataclass(frozen=True, eq=False)
class Work:
    """Design and its file."""

    opened: DesignFile
    file: str  # name of the file or bundled design
    kept: Mapping[str, Any]  # document as read or last saved
    kept_text: str  # text of the file at this time

    @property
    def design(self) -> Design:
        """Current design."""
        return self.opened.design

    @property
    def changed(self) -> bool:
        """True if it differs from its file."""
        return bool(self.opened.document != self.kept)

    @property
    def unsaved(self) -> str:
        """Line for the page if changes would be lost."""
        return f"The changes of {self.file} are not saved; Discard loses them."

    def document_with(self, changes: Mapping[str, Any]) -> dict[str, Any]:
        """Document with other entries, without making a board, or DesignError."""
        values = {**self.opened.values, **changes}
        sizes = (values.get(f"array.{name}", default) for name, default in _LATTICE_SIZES.items())
        columns, rows, rings = (size if isinstance(size, int | float) else 1 for size in sizes)
        coils = columns * rows + 3 * rings * (rings + 1)
        if coils > MOST_COILS:  # before they are built
            key = next(iter(changes))
            raise DesignError(f"{key} must leave at most {MOST_COILS} coils for the studio to follow; got {coils:g}.")
        return vary_chosen(self.opened.document, changes)

    def with_document(self, document: Mapping[str, Any]) -> Work:
        """Replace the document, or raise the same kind of DesignError."""
        name = str(document.get("name", self.design.name))
        try:
            opened = build_design_file(document, name, self.opened.text)
        except DesignError as error:
            raise DesignError(str(error).removeprefix(f"{name}: ")) from None
        require_small(opened.design)
        return replace(self, opened=opened)

    def called(self, name: str, title: str) -> Work:
        """Change the name and title, which change no number."""
        if (name, title or name) == (self.design.name, self.design.title):
            return self
        document = {key: value for key, value in self.opened.document.items() if key != "title"}
        return self.with_document({**document, "name": name, **({"title": title} if title else {})})

    def of_file(self, other: Work) -> Work:
        """Use as the changed contents of another file."""
        called = self.called(other.design.name, str(other.opened.document.get("title", "")))
        return replace(called, file=other.file, kept=other.kept, kept_text=other.kept_text)


def work_on(opened: DesignFile, file: str) -> Work:
    """Begin to work on a file of limited size."""
    require_small(opened.design)
    return Work(opened, file, opened.document, opened.text)


def require_small(design: Design) -> None:
    """Raise DesignError for a design too large for the studio."""
    count = len(design.coil_names)
    if count > MOST_COILS:
        raise DesignError(f"the studio follows at most {MOST_COILS} coils; the design has {count}.")
    placements = [place for board in design.placed for place in board.array.placements]
    segments = sum(len(line) - 1 for place in placements for line in place.coil.lines)
    if segments > MOST_SEGMENTS:
        raise DesignError(f"the studio follows at most {MOST_SEGMENTS} segments of winding; there are {segments}.")


_NAME = re.compile(r"[A-Za-z0-9_+][A-Za-z0-9_.+-]{0,125}")  # short enough for any file system


@dataclass(frozen=True)
class Shelf:
    """Design files of one folder, and the bundled designs."""

    folder: Path

    def names(self) -> list[str]:
        """Names of the designs."""
        return [*sorted(self.files(".toml")), *bundled.names()]

    def open(self, name: str) -> Work:
        """Read a design, or raise DesignError."""
        if name in bundled.names():
            return work_on(parse_design_file(bundled.read(name), name), name)
        path = self.path(name)
        if not path.is_file():
            raise DesignError(f"there is no file {name} in {self.folder}.")
        return work_on(load_design_file(path), name)

    def save(self, work: Work, name: str) -> Work:
        """Write a design, and return it with its new file."""
        path, text = self.path(name), file_text(work.opened, self.folder)
        parse_design_file(text, name, self.folder)  # refuses a file that would not be readable
        write_text(path, text)
        opened = replace(work.opened, text=text)
        return replace(work, opened=opened, file=name, kept=opened.document, kept_text=text)

    def would_lose(self, work: Work, name: str) -> bool:
        """Whether saving replaces another file or changes of others."""
        path = self.path(name)
        return path.exists() and (
            name != work.file or path.read_text(encoding="utf-8", errors="replace") != work.kept_text
        )

    def files(self, suffix: str) -> list[str]:
        """Names of the files with a suffix, the newest first."""
        try:
            found = [path for path in self.folder.glob(f"*{suffix}") if _NAME.fullmatch(path.name)]
            return [path.name for path in sorted(found, key=lambda path: path.stat().st_mtime, reverse=True)]
        except OSError:
            return []

    def file(self, name: str, suffixes: Sequence[str]) -> Path:
        """Path of a file of the folder, its name checked."""
        if not (_NAME.fullmatch(name) and name.lower().endswith(tuple(suffixes))):
            raise OutputError(
                f"a file must have a plain, short name that ends in {' or '.join(suffixes)}; got {name[:60]!r}."
            )
        return self.folder / name

    def path(self, name: str) -> Path:
        """Path of a design file, as in `file`."""
        return self.file(name, (".toml",))


SYMBOLS = {"deg": "°", "ohm": "Ω", "1": ""}  # of units, as the page writes them
_GROUPS = {  # tables whose numbers have sliders, with headings, in shown order
    "boards.N": "Board", "coils.NAME": "Coil", "coils.NAME.leads": "Coil", "array": "Array", "connector": "Connector",
    "elastomer.N": "Elastomer", "plate.N": "Plate", "target": "Target", "indentation": "Indentation",
    "indenter": "Indenter", "circuit": "Circuit", "stackup": "Board", "board": "Board", "field": "Field",
    "fab": "Limits of the board house",
}  # fmt: skip
_NOT_OF = {"single": ("rows", "direction_deg"), "rings": ("rows",), "triangle": ("rows",)}
"""Keys of [array] that a lattice lacks."""
_STEPS_IN_A_DECADE = 100
_TURN = 180.0  # range of an angle in degrees to both sides
_RANGE_OF_ZERO = 10.0  # upper end of a slider whose value is zero


@dataclass(frozen=True)
class Entry:
    """Entry with a slider."""

    key: str  # dotted, as for `coilarray.design.vary.vary`
    label: str  # key in words, without the unit
    meaning: str  # sentence of the reference
    unit: str  # of all numbers, or empty
    group: str  # heading above the entry
    value: float
    low: float
    high: float
    step: float


def entries_of(file: DesignFile) -> tuple[Entry, ...]:
    """List the numbers of a design in the shown order."""
    values, known = file.values, _keys()
    found: dict[str, list[Entry]] = {path: [] for path in _GROUPS}
    without = _NOT_OF.get(str(values.get("array.lattice")), ())
    for dotted, value in values.items():
        path = re.sub(r"\.\d+\.", ".N.", dotted)
        name = re.match(r"coils\.(.+?)\.(leads\.)?\w+$", dotted)
        placed = re.match(r"boards\.(.+)\.\w+$", dotted)
        if name:
            path = dotted.replace(f"coils.{name[1]}.", "coils.NAME.", 1)
        elif placed:
            path = dotted.replace(f"boards.{placed[1]}.", "boards.N.", 1)
        key = known.get(path)
        if key is None or key.path not in _GROUPS or (key.path == "array" and key.name in without):
            continue
        table = dotted.removesuffix(f".{key.name}")
        of = f" {name[1]}" if name else f" {values[f'{table}.name']}" if key.path.endswith(".N") else ""
        group = _GROUPS[key.path] + of
        words = key_in_si(key.name)[0].replace("_", " ") + (" of the leads" if key.path.endswith(".leads") else "")
        numbers = value if isinstance(value, list) else [value]
        for k, number in enumerate(numbers):
            if isinstance(number, int | float) and not isinstance(number, bool):
                many = isinstance(value, list)
                which = f"about {'xyz'[k]}" if key.name == "turn_deg" else k + 1
                label, at = (f"{words} {which}", f"{dotted}.{k}") if many else (words, dotted)
                found[key.path].append(_entry(key, at, label, group, float(number)))
    return tuple(entry for entries in found.values() for entry in entries)


@cache
def _keys() -> dict[str, Key]:
    """Keys of a design, stored because collecting them is slow."""
    return {key.dotted: key for key in reversed(keys_of(Document))}


def _entry(key: Key, dotted: str, label: str, group: str, value: float) -> Entry:
    """Make an entry with the range of its slider."""
    unit = entry_unit(key.name)
    unit = SYMBOLS.get(unit, unit)
    allowed = re.search(r", ([−\d.]+) to ([\d.\u202f]+)", key.allowed)
    if unit == "°" and key.name != "half_angle_deg":
        low, high, step = min(-_TURN, value), max(_TURN, value), 1.0
    elif key.allowed.startswith("whole number"):
        low, high, step = 1.0, max(2 * value, 8.0), 1.0
    elif key.path == "boards.N":
        high, step = max(2 * abs(value), 2 * _RANGE_OF_ZERO), _RANGE_OF_ZERO / 100
        low = -high
    elif value <= 0:
        low, high, step = min(value, 0.0), _RANGE_OF_ZERO, _RANGE_OF_ZERO / 100
    else:
        step = 10.0 ** math.floor(math.log10(value)) / _STEPS_IN_A_DECADE
        low, high = (round(round(bound / step) * step, 12) for bound in (value / 2, 2 * value))
        step = round(step, 12)
        if key.name == "turns_per_layer":
            low, high, step = max(math.floor(low), 1.0), math.ceil(high), 1.0
    if allowed:
        least, most = (float(bound.replace("−", "-").replace("\u202f", "")) for bound in allowed.groups())
        low, high = max(low, least), min(high, most)
    return Entry(dotted, label, key.meaning, unit, group, value, low, high, step)


_HALVINGS = 12


def feasible_range(work: Work, entry: Entry) -> tuple[float, float]:
    """Values of an entry's slider with which there is a board, about the present value."""
    if "connector" in work.opened.document:  # to route its leads takes seconds each time
        return entry.low, entry.high

    def last(end: float) -> float:
        good, bad = entry.value, end
        if _is_possible(work, entry.key, end):
            return end
        for _ in range(_HALVINGS):
            middle = round((good + bad) / 2 / entry.step) * entry.step
            if middle in (good, bad):
                break
            good, bad = (middle, bad) if _is_possible(work, entry.key, middle) else (good, middle)
        return good

    return last(entry.low), last(entry.high)


def _is_possible(work: Work, key: str, value: float) -> bool:
    try:
        work.with_document(work.document_with({key: value}))
    except CoilarrayError:
        return False
    return True


def number_of(key: str, text: str) -> float:
    """Read a typed number, or raise DesignError with its key."""
    try:
        if "_" in text:  # only Python reads it as a number
            raise ValueError
        value = float(text.strip().replace("−", "-"))
    except ValueError:
        raise DesignError(f"{key} must be a number; got {text.strip()[:40]!r}.") from None
    if not math.isfinite(value):
        raise DesignError(f"{key} must be a finite number; got {text.strip()[:40]!r}.")
    return value


def place_text(value: float) -> str:
    """Text of a coordinate in m, shown in mm."""
    return f"{value * 1e3:.2f}".replace("-0.00", "0.00")


def text_of(value: float) -> str:
    """Text of a value with all its significant digits.

    >>> text_of(13.28), text_of(30.0), text_of(1.7e-8)
    ('13.28', '30', '1.7e-08')
    """
    return f"{value:.12g}"
