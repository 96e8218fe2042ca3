"""Plots: what is drawn, where, and that the numbers written are the numbers given."""

import io
import itertools
import sys
import threading

import numpy as np
import pytest
import xarray as xr
from matplotlib import pyplot
from matplotlib.collections import QuadMesh
from matplotlib.colors import to_rgb
from matplotlib.patches import PathPatch
from support import plot_results as results
from support.boards import reference_board
from support.plot_results import legend

from coilarray import viz
from coilarray.errors import GeometryError
from coilarray.geometry.copper import copper_features, drills
from coilarray.report.page import image_of
from coilarray.viz.palette import COILS
from coilarray.viz.plots import style

NAMES = ("C1", "C2", "C3")


@pytest.fixture(scope="module")
def board():
    return reference_board(count=3, turns=5)


def texts(ax):
    """Texts in the cells by (row, column)."""
    return {(round(t.get_position()[1]), round(t.get_position()[0])): t.get_text() for t in ax.texts}


def area(patch):
    """Area of a patch; holes run the other way round and count negative."""
    return abs(sum(0.5 * np.sum(p[:-1, 0] * p[1:, 1] - p[1:, 0] * p[:-1, 1]) for p in patch.get_path().to_polygons()))


def test_boards_are_drawn_whole_with_one_patch_a_feature(board):
    ax = viz.plot_copper(board, "L1")
    features = [feature for feature in copper_features(board) if feature.layer == "L1"]
    patches = [patch for patch in ax.patches if isinstance(patch, PathPatch)]
    assert len(patches) == len(features) + 1
    for patch, feature in zip(patches, features, strict=False):
        assert area(patch) == pytest.approx(feature.shape.area * 1e6)  # mm²
        assert patch.get_facecolor()[:3] == to_rgb(COILS[board.names.index(feature.net)])
    (holes,) = ax.collections
    assert len(holes.get_paths()) == len(drills(board))
    assert [text.get_text() for text in ax.texts] == ["C1", "C3"]  # C2 has nothing but pads here
    with pytest.raises(GeometryError, match="no copper layer 'L9'"):
        viz.plot_copper(board, "L9")
    ax = viz.plot_board(board)
    x_min, _, x_max, _ = np.multiply(board.bounds, 1e3)
    assert ax.get_xlim()[0] < x_min < x_max < ax.get_xlim()[1]
    assert ax.get_aspect() == 1.0
    for text, name, centre in zip(ax.texts, board.names, board.centres, strict=False):
        assert text.get_text() == name
        assert text.get_position() == pytest.approx(1e3 * centre)
    assert legend(ax) == [f"copper L{k}" for k in (1, 2, 3, 4)]


def test_matrices_are_written_pair_by_pair():
    coupling = results.coupling()
    ax, k = viz.plot_coupling(coupling), coupling.coupling.values
    written = {place: float(text.replace("−", "-")) for place, text in texts(ax).items()}
    assert written == {place: pytest.approx(k[place], abs=5e-4) for place in itertools.permutations(range(3), 2)}
    assert ax.images[0].get_clim() == pytest.approx((-0.05, 0.05))
    assert [label.get_text() for label in ax.get_yticklabels()] == results.NAMES
    alone = coupling.isel(coil=[0], other=[0])
    for draw in (viz.plot_currents, viz.plot_coupling):
        ax = draw(alone)
        ax.figure.draw_without_rendering()
        assert not ax.texts


def test_currents_are_written_as_magnitude_and_phase():
    """The column is the active coil, which is the first dimension of the dataset."""
    currents = np.eye(3, dtype=complex)
    currents[0, 1] = 0.0382 * np.exp(1j * np.radians(-170))  # in coil 2 while coil 1 is active
    currents[1, 0] = 0.01j
    dims = ("coil", "other")
    coupling = xr.Dataset(
        {"current_real": (dims, currents.real), "current_imag": (dims, currents.imag)},
        {"coil": list(NAMES), "other": list(NAMES)},
    )
    ax = viz.plot_currents(coupling)
    assert (texts(ax)[1, 0], texts(ax)[0, 1], texts(ax).get((0, 0))) == ("38.2\n−170°", "10\n90°", None)
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("active coil", "passive coil")
    assert ax.child_axes[0].get_ylabel() == "current (mA per A)"


def test_fields_are_per_ampere_the_right_way_round():
    x = np.linspace(-20e-3, 20e-3, 41)
    fields = {"all": results.field(x, [0.0]), "half a turn": results.field(x, [0.0], current=0.5, peak=1e-3)}
    ax = viz.plot_field_lines(fields, coil=(-9e-3, 11e-3))
    for label, peak in (("all", 2.0), ("half a turn", 1.0)):  # mT, whatever the current
        curve = next(line for line in ax.lines if line.get_label() == label)
        np.testing.assert_allclose(curve.get_xdata(), x * 1e3)
        np.testing.assert_allclose(curve.get_ydata(), peak * np.exp(-((x / 5e-3) ** 2)))
    (span,) = ax.patches
    assert span.get_extents().transformed(ax.transData.inverted()).intervalx == pytest.approx((-9, 11))
    field = results.field([0.0, 1e-3, 2e-3], [0.0, 1e-3], current=2.0)
    field.B[:, :, 0, 2] = np.array([[1.0, 2.0], [3.0, 4.0], [5.0, -6.0]]) * 2e-6
    ax = viz.plot_field_map(field)
    (mesh,) = (c for c in ax.collections if isinstance(c, QuadMesh))
    np.testing.assert_allclose(mesh.get_array(), [[1, 3, 5], [2, 4, -6]])  # rows are y, µT per A
    assert mesh.get_clim() == pytest.approx((-6, 6))
    with pytest.raises(ValueError, match="one or more; got none"):
        viz.plot_field_lines({})
    with pytest.raises(ValueError, match=r"line along x, one y and one z; plane has .*'y': 2"):
        viz.plot_field_lines({"plane": results.field([0.0, 1e-3], [0.0, 1e-3])})
    with pytest.raises(ValueError, match="of a plane, two x and y or more"):
        viz.plot_field_map(results.field([0.0, 1e-3], [0.0]))


def test_pyplot_shows_a_plot_until_it_is_saved(board):
    """`pyplot.show()` of a script and notebooks display the figures that pyplot knows, and only those."""
    plan, figure = viz.plot_board(board).figure, viz.check_figure(board, [])
    assert [pyplot.figure(number) for number in pyplot.get_fignums()] == [plan, figure]
    style.save(plan, io.BytesIO(), format="png")
    image_of(figure, "figure", "a figure")
    assert pyplot.get_fignums() == []


def test_a_plot_is_shown_at_a_prompt_and_belongs_to_no_window_elsewhere(board, monkeypatch):
    """A notebook has a prompt too; commands, reports and the studio have none, and threads no windows."""
    drawn = []
    thread = threading.Thread(target=lambda: drawn.append(viz.plot_board(board)))
    thread.start()
    thread.join()
    assert len(drawn) == 1
    assert pyplot.get_fignums() == []
    monkeypatch.delitem(sys.modules, "matplotlib.pyplot")  # the program has not imported it
    viz.plot_board(board)
    assert "matplotlib.pyplot" not in sys.modules
    monkeypatch.setattr(sys, "ps1", ">>> ", raising=False)
    viz.plot_board(board)
    assert len(pyplot.get_fignums()) == 1


def test_a_figure_that_ends_a_cell_is_shown_once(board, monkeypatch):
    """A notebook shows what a cell returns, and then what pyplot knows."""
    figure = viz.check_figure(board, [])
    with pytest.raises(NotImplementedError):  # IPython goes on to the picture
        figure._ipython_display_()
    assert pyplot.get_fignums() == [figure.number]  # a window stays open
    monkeypatch.setattr(pyplot.matplotlib, "get_backend", lambda: "module://matplotlib_inline.backend_inline")
    with pytest.raises(NotImplementedError):
        figure._ipython_display_()
    assert pyplot.get_fignums() == []
