"""Runs of the command line within the tests."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
import tomli_w

from coilarray.cli.main import main

_OF_THE_TERMINAL = ("COLUMNS", "LINES", "TERMINAL_WIDTH", "FORCE_COLOR", "TTY_COMPATIBLE", "TTY_INTERACTIVE")


@contextmanager
def no_terminal() -> Iterator[None]:
    """Let output look as in a pipe, whatever is said of the terminal in which the tests were started."""
    with pytest.MonkeyPatch.context() as patch:
        for variable in _OF_THE_TERMINAL:
            patch.delenv(variable, raising=False)
        yield


def runner(*first):
    """Return `run` and `refused` for command lines that begin with the given arguments."""

    def run(capsys, *arguments):
        """Run and return the exit code, standard output and standard error."""
        with no_terminal():
            code = main([*first, *(str(argument) for argument in arguments)])
        captured = capsys.readouterr()
        return code, captured.out, captured.err

    def refused(capsys, *arguments):
        """Run and return the one line of the error; warnings may stand before it."""
        code, out, err = run(capsys, *arguments)
        assert (code, out) == (2, "")
        assert "Traceback" not in err
        (line,) = (line for line in err.splitlines() if not line.startswith("coilarray: warning: "))
        assert line.startswith("coilarray: error: ")
        return line

    return run, refused


def successes(*first):
    """Return `good` and `answer` for command lines that begin with the given arguments and succeed in silence."""
    run, _ = runner(*first)

    def good(capsys, *arguments):
        """Run and return standard output."""
        code, out, err = run(capsys, *arguments)
        assert (code, err) == (0, "")
        return out

    def answer(capsys, *arguments):
        """Run and return what is printed as JSON."""
        return json.loads(good(capsys, *arguments, "--json"))

    return good, answer


def toml_file(path, **values):
    """Write a file of --settings or --plan; return its path."""
    path.write_text(tomli_w.dumps(values), encoding="utf-8")
    return path


def _files():
    return sorted(path for path in Path().rglob("*") if path.is_file())


def mistakes(refused, *cases):
    """Return a test that each of (arguments, words of the error) is refused in one line and leaves no file."""

    @pytest.mark.usefixtures("own_folder")
    @pytest.mark.parametrize(("arguments", "words"), cases)
    def test(capsys, arguments, words):
        before = _files()
        assert words in refused(capsys, *arguments)
        assert _files() == before

    return test
