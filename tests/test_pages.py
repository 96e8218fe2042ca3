"""Pages made from the code: every key of every file has a meaning, every command a page with an example."""

import sys
from pathlib import Path

import pytest

DOCS = Path(__file__).parent.parent / "docs"
sys.path.insert(0, str(DOCS / "extensions"))

import command_pages  # noqa: E402 - from the folder above
import file_pages  # noqa: E402

from coilarray.cli.main import COMMANDS  # noqa: E402

_PLAIN = {"shape", "lattice", "schema"}  # which the heading or the version of the file says


@pytest.mark.parametrize("kind", file_pages.FILES, ids=lambda kind: kind[0])
def test_every_key_has_a_meaning(kind):
    rows = [line.split(" | ") for line in file_pages.page(*kind[1:]).splitlines() if line.startswith("| `")]
    assert rows
    without = [key for key, *_, meaning in rows if not meaning.strip(" |") and key.strip("| `") not in _PLAIN]
    assert not without, f"{kind[0]}: no meaning of {', '.join(without)}"


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_has_a_page_with_an_example(name):
    page = command_pages.page(name)
    assert f"```sh\ncoilarray {name}" in page
    options = [line for line in page.splitlines() if line.startswith("| ``")]
    assert options
    assert all(line.removesuffix(" |").rsplit("|", 1)[1].strip() for line in options), "an option without a meaning"
