"""Fixtures of the pictures' tests."""

import pytest


@pytest.fixture(scope="session")
def studio_libraries():
    """Skip a test where there can be no studio."""
    from support.browser import missing_studio

    if (problem := missing_studio()) is not None:
        pytest.skip(problem)


@pytest.fixture(scope="session")
def searched(tmp_path_factory):
    """Folder of a quick optimisation, and what it has found."""
    pytest.importorskip("optuna")
    from support.browser import quick_run

    folder = tmp_path_factory.mktemp("searched")
    return folder, quick_run(folder)


@pytest.fixture
def plotter(rendering):
    """An empty plotter without a window, where this machine can render."""
    import pyvista

    plotter = pyvista.Plotter(off_screen=True, window_size=(320, 180))
    yield plotter
    plotter.close()
