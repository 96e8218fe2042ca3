"""What the tests of the commands share."""

import itertools

import pytest
from support.screen import CODES, NUMBER, require_fits

from coilarray.cli import shared
from coilarray.compute.table import Table, fill


@pytest.fixture
def own_folder(tmp_path, monkeypatch):
    """Run a test in an empty folder."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


WIDTHS = (60, 80, 100, 120)


@pytest.fixture(autouse=True)
def _everything_fits(monkeypatch):
    """Whatever a command of any test prints fits into terminals of four widths, its numbers whole."""
    said = shared.say

    def say(text, *, err=False, emulated=False):
        for width in WIDTHS:
            inside = width - len(shared.MARK) * emulated
            shown = text.text(inside) if isinstance(text, Table) else fill(text, inside)
            require_fits(shown, inside)
            words = CODES.sub("", shown).split()
            for cell in itertools.chain(*text.known().cells()) if isinstance(text, Table) else ():
                assert not NUMBER.fullmatch(cell) or cell in words, (width, cell, shown)
        said(text, err=err, emulated=emulated)

    monkeypatch.setattr(shared, "say", say)
    monkeypatch.setattr("coilarray.cli.main.say", say)
