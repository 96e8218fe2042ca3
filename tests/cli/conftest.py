"""What the tests of the commands share."""

import pytest


@pytest.fixture
def own_folder(tmp_path, monkeypatch):
    """Run a test in an empty folder."""
    monkeypatch.chdir(tmp_path)
    return tmp_path
