"""Access of a page to one folder's design files.

It has access to nothing else on the disk.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from coilarray.compute.files import write_text
from coilarray.design import bundled
from coilarray.design.model import load_design_file, parse_design, parse_design_file
from coilarray.errors import CoilarrayError, DesignError, OutputError
from coilarray.viz.studio.work import Work, work_on

_NAME = re.compile(r"[A-Za-z0-9_+][A-Za-z0-9_.+-]{0,125}")  # short enough for any file system


@dataclass(frozen=True)
class Shelf:
    """Design files of one folder, and the bundled designs.

    The folder must exist.
    """

    folder: Path

    def names(self) -> list[str]:
        """Names of the files of the folder.

        The names of the bundled designs follow.
        """
        try:
            files = sorted(path.name for path in self.folder.glob("*.toml") if _NAME.fullmatch(path.name))
        except OSError:
            files = []
        return [*files, *bundled.names()]

    def open(self, name: str) -> Work:
        """Read a design.

        An unknown name or an invalid file raises a DesignError.
        """
        if name in bundled.names():
            return work_on(parse_design_file(bundled.read(name), name), name)
        path = self.path(name)
        if not path.is_file():
            raise DesignError(f"there is no file {name} in {self.folder}.")
        return work_on(load_design_file(path), name)

    def save(self, work: Work, name: str) -> Work:
        """Write a design into the folder in one step.

        It is returned with its new file.

        Raises
        ------
        OutputError
            If the name is not allowed, or the file cannot be written.
        """
        path = self.path(name)
        text = work.text()
        parse_design(text, name)  # refuses a file that would not be readable
        write_text(path, text)
        return work.saved_as(name)

    def would_lose(self, work: Work, name: str) -> bool:
        """Check if saving a design replaces another file.

        The file, or its comments, differs from the file from which the design was read. The OutputError is the same as
        in `path`.
        """
        path = self.path(name)
        if not path.exists():
            return False
        try:
            return name != work.file or load_design_file(path).text != work.kept_text
        except CoilarrayError:
            return True

    def files(self, suffix: str) -> list[str]:
        """Names of the files of the folder with a suffix.

        The latest file comes first.
        """
        try:
            found = [path for path in self.folder.glob(f"*{suffix}") if _NAME.fullmatch(path.name)]
            return [path.name for path in sorted(found, key=lambda path: path.stat().st_mtime, reverse=True)]
        except OSError:
            return []

    def file(self, name: str, suffixes: Sequence[str]) -> Path:
        """Path of a file of the folder.

        A name that is not allowed raises an OutputError.
        """
        if not (_NAME.fullmatch(name) and name.lower().endswith(tuple(suffixes))):
            raise OutputError(
                f"a file must have a plain, short name that ends in {' or '.join(suffixes)}; got {name[:60]!r}."
            )
        return self.folder / name

    def path(self, name: str) -> Path:
        """Path of a design file, as in `file`."""
        return self.file(name, (".toml",))
