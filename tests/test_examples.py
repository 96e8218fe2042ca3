"""Every example runs: docstrings of all modules, and the README with its output."""

import contextlib
import doctest
import importlib
import io
import pkgutil
import re
from pathlib import Path

import pytest
from support.command_line import no_terminal

import coilarray
from coilarray.cli.main import main
from coilarray.report.write import Report

pytestmark = pytest.mark.slow

README = Path(__file__).parent.parent / "README.md"
PROGRAMS = README.parent / "docs" / "programs.md"
MODULES = sorted({module.name for module in pkgutil.walk_packages(coilarray.__path__, "coilarray.")} | {"coilarray"})


@pytest.mark.parametrize("name", MODULES)
def test_docstrings(name):
    result = doctest.testmod(importlib.import_module(name), optionflags=doctest.NORMALIZE_WHITESPACE)
    assert result.failed == 0


def test_all_names_exist():
    for name in coilarray.__all__:
        assert name.isupper() or getattr(coilarray, name).__doc__, name  # constants have none
    assert dir(coilarray) == sorted(coilarray.__all__)
    with pytest.raises(AttributeError, match="No coilarray attribute nothing"):
        _ = coilarray.nothing


def _blocks(language, page=README):
    return re.findall(rf"```{language}\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL)


def _run(code):
    """Return what a program prints."""
    printed = io.StringIO()
    with no_terminal(), contextlib.redirect_stdout(printed):
        exec(code, {})
    return printed.getvalue()


def test_readme_example(monkeypatch):
    shown = []
    monkeypatch.setattr("coilarray.viz.scenes.pictures.show", shown.append)
    (code,) = _blocks("python")
    assert len(code.splitlines()) == 6
    assert _run(code) == _blocks("text")[1]
    assert [text.text for text in shown[0].texts[:3]] == ["coil1", "coil2", "coil3"]


def test_programs(tmp_path, monkeypatch):
    """Each of the five has at most twelve lines, runs, and prints what stands below it; the last draws a picture."""
    monkeypatch.chdir(tmp_path)
    programs, shown = _blocks("python", PROGRAMS), _blocks("text", PROGRAMS)
    assert len(programs) == 5
    for code, text in zip(programs, [*shown, ""], strict=True):
        assert len([line for line in code.splitlines() if line]) <= 12
        assert _run(code) == text
    assert (tmp_path / "coupling.png").stat().st_size > 10_000


def test_readme_report(tmp_path, monkeypatch, capsys):
    """What the command prints; tests/report has what it writes."""

    def computed(file, where, **_):
        return Report(where / "report.html", where / "report", coilarray.couple_design(file.design), {}, None)

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("coilarray.report.write.write_report", computed)
    with no_terminal():
        assert main(["report"]) == 0
    assert capsys.readouterr().out == _blocks("text")[0]
