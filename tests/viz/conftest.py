"""Fixtures of the pictures' tests."""

import pytest

from coilarray.viz import rendering_problem


@pytest.fixture
def plotter():
    """An empty plotter without a window, where this machine can render."""
    problem = rendering_problem()
    if problem is not None:
        pytest.skip(problem)
    import pyvista

    plotter = pyvista.Plotter(off_screen=True, window_size=(320, 180))
    yield plotter
    plotter.close()
