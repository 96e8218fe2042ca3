"""The report of the first page of *Start*: written as a reader's own, shown whole, and its pictures one by one."""

from __future__ import annotations

import base64
import re
import shutil
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

import coilarray as ca
from coilarray.compute.store import code_version

if TYPE_CHECKING:
    from sphinx.application import Sphinx

FOLDER = "made/report"
_PAGE = "page"  # folder of what is copied as it is
_DESIGN = "gast2020"
_PICTURE = re.compile(
    r'<figure id="(\w+)"[^>]*>(?:(<svg.*?</svg>)|<img src="data:image/(\w+);base64,([^"]+)")', re.DOTALL
)


def pictures(page: str) -> dict[str, bytes]:
    """Return the pictures of a report by their file names."""
    found = _PICTURE.findall(page)
    return {f"{name}.{kind or 'svg'}": svg.encode() or base64.b64decode(data) for name, svg, kind, data in found}


def _write(app: Sphinx) -> None:
    folder = Path(app.srcdir) / FOLDER
    version = folder / "version"
    if version.exists() and version.read_text(encoding="utf-8") == code_version():
        return
    with tempfile.TemporaryDirectory() as made:
        report = ca.write_report(ca.load_design_file(_DESIGN), made)
        for name, picture in pictures(report.page.read_text(encoding="utf-8")).items():
            (folder / name).write_bytes(picture)
        shutil.move(report.page, folder / _PAGE / "first_report.html")
    version.write_text(code_version(), encoding="utf-8")


def setup(app: Sphinx) -> dict[str, bool]:
    """Write the report before Sphinx looks for its pictures; the report itself goes where the pages go."""
    (Path(app.srcdir) / FOLDER / _PAGE).mkdir(parents=True, exist_ok=True)
    app.config.html_extra_path = [*app.config.html_extra_path, f"{FOLDER}/{_PAGE}"]
    app.connect("builder-inited", _write)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
