"""PDF of a page by an installed browser."""

import os
import shutil
import subprocess
import tempfile
from pathlib import Path

from coilarray.compute.files import writing
from coilarray.errors import MissingDependencyError, OutputError

_NAMES = (
    "chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "microsoft-edge", "microsoft-edge-stable",
    "msedge", "chrome",
)  # fmt: skip
_PLACES = (
    "/Applications/Chromium.app/Contents/MacOS/Chromium",
    "/Applications/Google Chrome.app/Contents/MacOS/Google Chrome",
    "/Applications/Microsoft Edge.app/Contents/MacOS/Microsoft Edge",
    r"C:\Program Files (x86)\Microsoft\Edge\Application\msedge.exe",
    r"C:\Program Files\Google\Chrome\Application\chrome.exe",
)
_PATIENCE = 300.0  # s


def browser() -> str:
    """Return the path of Chromium, Chrome or Edge, or raise MissingDependencyError."""
    for name in (*_NAMES, *_PLACES):
        if (found := shutil.which(name)) is not None:
            return found
    raise MissingDependencyError("a PDF needs Chromium, Chrome or Edge, and none is installed; print the page instead.")


def write_pdf(page: Path, program: str) -> Path:
    """Print a page into a PDF beside it, by the `browser` at a path."""
    target = page.with_suffix(".pdf")
    with writing(str(target)), tempfile.TemporaryDirectory() as folder:
        made = Path(folder) / target.name
        options = ["--headless", "--disable-gpu", "--no-first-run", "--no-pdf-header-footer"]
        options += [f"--user-data-dir={folder}/profile", f"--print-to-pdf={made}"]
        if getattr(os, "geteuid", lambda: 1)() == 0:
            options.append("--no-sandbox")  # the sandbox refuses to start for root
        try:
            command = [program, *options, page.resolve().as_uri()]
            subprocess.run(command, capture_output=True, timeout=_PATIENCE, check=False, stdin=subprocess.DEVNULL)
        except (OSError, subprocess.TimeoutExpired) as error:
            raise OutputError(f"{program} could not print {page}: {error}.") from error
        if not made.exists():
            raise OutputError(f"{program} wrote no PDF of {page}; print the page instead.")
        shutil.move(made, target)
    return target
