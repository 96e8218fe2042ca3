"""The folder that a page reads designs from and writes them to, and nothing else of the disk."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from coilarray.compute.files import write_text
from coilarray.design import bundled
from coilarray.design.model import load_design_file, parse_design, parse_design_file
from coilarray.errors import CoilarrayError, DesignError, OutputError
from coilarray.viz.studio.work import Work, work_on

_FILE = re.compile(r"[A-Za-z0-9_+][A-Za-z0-9_.+-]{0,120}\.toml")  # no name that a file system finds too long


@dataclass(frozen=True)
class Shelf:
    """Design files of one folder, and the bundled designs.

    Parameters
    ----------
    folder : Path
        Must exist.
    """

    folder: Path

    def names(self) -> list[str]:
        """Return what can be opened: files of the folder, then bundled designs."""
        try:
            files = sorted(path.name for path in self.folder.glob("*.toml") if _FILE.fullmatch(path.name))
        except OSError:
            files = []
        return [*files, *bundled.names()]

    def open(self, name: str) -> Work:
        """Read a design.

        Raises
        ------
        DesignError
            A name that is not in `names`, or a file that is no design.
        """
        if name in bundled.names():
            return work_on(parse_design_file(bundled.read(name), name), name)
        path = self.path(name)
        if not path.is_file():
            raise DesignError(f"there is no file {name} in {self.folder}.")
        return work_on(load_design_file(path), name)

    def save(self, work: Work, name: str) -> Work:
        """Write a design into the folder; the file appears, or is replaced, whole.

        Returns
        -------
        Work
            As it is kept now.

        Raises
        ------
        OutputError
            A name that is no file name, or a file that cannot be written.
        """
        path = self.path(name)
        text = work.text()
        parse_design(text, name)  # what is written can be read
        write_text(path, text)
        return work.saved_as(name)

    def would_lose(self, work: Work, name: str) -> bool:
        """Whether saving a design under a name replaces a file that says something it was not read from.

        Raises
        ------
        OutputError
            A name that is no file name.
        """
        path = self.path(name)
        if not path.exists():
            return False
        try:
            return name != work.file or load_design_file(path).document != work.kept
        except CoilarrayError:
            return True

    def path(self, name: str) -> Path:
        """Return the path of a file of the folder; OutputError for what is not the name of one."""
        if not _FILE.fullmatch(name):
            raise OutputError(
                f"a design file must have a plain, short name that ends in .toml, as better.toml; got {name[:60]!r}."
            )
        return self.folder / name
