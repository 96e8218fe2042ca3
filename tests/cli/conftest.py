"""What the tests of the commands share."""

import pytest


@pytest.fixture
def own_folder(tmp_path, monkeypatch):
    """Run a test in an empty folder, with a cache of its own."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COILARRAY_CACHE", str(tmp_path / "cache"))
    return tmp_path


@pytest.fixture(scope="module")
def kept_circuits(tmp_path_factory):
    """A cache for all tests of a file: the circuit of an emulated board takes seconds."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("COILARRAY_CACHE", str(tmp_path_factory.mktemp("cache")))
        yield
