"""What the tests of the commands share."""

import pytest


@pytest.fixture
def own_folder(tmp_path, monkeypatch):
    """Run a test in an empty folder, with a cache of its own."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COILARRAY_CACHE", str(tmp_path / "cache"))
    return tmp_path
