"""The command that a user is told for a library that is not there: pip must find this coilarray again by it."""

import importlib
import importlib.metadata
import json
import sys
from importlib.metadata import PackageNotFoundError

import pytest

from coilarray.compute import extras
from coilarray.errors import MissingDependencyError


@pytest.fixture
def installed(monkeypatch, tmp_path):
    """Say how pip installed coilarray, by the record that it writes (PEP 610)."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "executable", str(tmp_path / ".venv" / "bin" / "python"))

    class Record:
        def __init__(self, record):
            self.record = record

        def read_text(self, name):
            assert name == "direct_url.json"
            return None if self.record is None else json.dumps(self.record)

    return lambda record: monkeypatch.setattr(importlib.metadata, "distribution", lambda name: Record(record))


def told():
    with pytest.raises(MissingDependencyError) as caught:
        extras.import_extra("nobody_has_this", "STEP files", package="OCP", extra="step")
    begin, command = str(caught.value).split(": ", 1)
    assert begin == "STEP files need OCP, which is not installed"
    return command.replace("\\", "/")


PIP = ".venv/bin/python -m pip install"


@pytest.mark.parametrize(("record", "requirement"), [
    (None, '"coilarray[step]"'),  # from an index
    ({"url": "file://HERE", "dir_info": {"editable": True}}, '-e ".[step]"'),
    ({"url": "file://HERE", "dir_info": {}}, '".[step]"'),
    ({"url": "file://HERE/gone", "dir_info": {}}, '"coilarray[step]"'),
    ({"url": "https://example.org/c.git", "vcs_info": {"vcs": "git"}}, '"coilarray[step] @ git+https://example.org/c.git"'),
])  # fmt: skip
def test_pip_finds_this_coilarray_again(installed, tmp_path, record, requirement):
    installed(record and {**record, "url": record["url"].replace("HERE", tmp_path.as_posix())})
    assert told() == f"{PIP} {requirement}."


def test_without_installation_and_with_a_space_in_the_path(installed, tmp_path, monkeypatch):
    def missing(name):
        raise PackageNotFoundError(name)

    monkeypatch.setattr(importlib.metadata, "distribution", missing)
    monkeypatch.setattr(sys, "executable", str(tmp_path / "my venv" / "python"))
    assert told() == '"my venv/python" -m pip install "coilarray[step]".'


def test_a_library_that_breaks_is_not_called_missing(monkeypatch):
    def broken(name):
        raise ImportError("libGL.so.1: cannot open shared object file")

    monkeypatch.setattr(importlib, "import_module", broken)
    with pytest.raises(MissingDependencyError, match=r"^films need json, which cannot be loaded: libGL"):
        extras.import_extra("json", "films", package="json", extra="movie")


def test_an_interrupt_while_a_library_is_loaded_is_an_interrupt(monkeypatch):
    """An extension module raises an ImportError where Ctrl-C stops it."""

    def broken_off(module):
        raise ImportError("DLL load failed") from KeyboardInterrupt()

    monkeypatch.setattr(importlib, "import_module", broken_off)
    with pytest.raises(KeyboardInterrupt):
        extras.import_extra("json", "films", package="json", extra="movie")
