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


def test_of_an_index_by_its_name(installed):
    installed(None)
    assert told() == f'{PIP} "coilarray[step]".'


def test_of_a_clone_by_its_folder(installed, tmp_path, monkeypatch):
    installed({"url": tmp_path.as_uri(), "dir_info": {"editable": True}})
    assert told() == f'{PIP} -e ".[step]".'
    installed({"url": tmp_path.as_uri(), "dir_info": {}})
    assert told() == f'{PIP} ".[step]".'
    elsewhere = tmp_path / "with space"
    elsewhere.mkdir()
    monkeypatch.chdir(elsewhere)
    assert told() == f'{tmp_path.as_posix()}/{PIP} "{tmp_path.as_posix()}[step]".'


def test_of_a_clone_that_is_gone_by_the_name(installed, tmp_path):
    installed({"url": (tmp_path / "gone").as_uri(), "dir_info": {}})
    assert told() == f'{PIP} "coilarray[step]".'


def test_of_a_wheel_and_of_a_repository(installed, tmp_path):
    (tmp_path / "coilarray.whl").touch()
    installed({"url": (tmp_path / "coilarray.whl").as_uri(), "archive_info": {}})
    assert told() == f'{PIP} "{tmp_path.as_posix()}/coilarray.whl[step]".'
    installed({"url": "https://example.org/coilarray.git", "vcs_info": {"vcs": "git", "commit_id": "0"}})
    assert told() == f'{PIP} "coilarray[step] @ git+https://example.org/coilarray.git".'


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
