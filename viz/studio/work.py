"""Design of a page as a value, and its folder."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from coilarray.compute.files import write_text
from coilarray.design import bundled
from coilarray.design.model import Design, DesignFile, build_design_file, load_design_file, parse_design_file
from coilarray.design.vary import vary_chosen
from coilarray.design.write import file_text
from coilarray.errors import DesignError, OutputError

MOST_COILS = 64
"""Largest number of coils of a design in the studio."""

MOST_SEGMENTS = 400_000
"""Largest number of straight segments of all windings together."""

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
        """Document with other entries, without making a board.

        >>> from coilarray.design.model import load_design_file
        >>> work = work_on(load_design_file("gast2020"), "gast2020")
        >>> work.with_document(work.document_with({"array.pitch_mm": 14})).opened.values["array.pitch_mm"]
        14.0
        >>> work.with_document(work.document_with({"array.pitch_mm": -1}))
        Traceback (most recent call last):
        coilarray.errors.DesignError: array.pitch_mm must be greater than 0; got -1.
        """
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
    count = len(design.array.names)
    if count > MOST_COILS:
        raise DesignError(f"the studio follows at most {MOST_COILS} coils; the array has {count}.")
    segments = sum(len(line) - 1 for place in design.array.placements for line in place.coil.lines)
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
        path, text = self.path(name), file_text(work.opened)
        parse_design_file(text, name)  # refuses a file that would not be readable
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
