"""What every flat plot keeps: a result and an optional axis in, the axis out, units on it, and nothing left behind."""

import importlib
import inspect
import itertools
import pkgutil
import re

import matplotlib
import numpy as np
import pytest
from matplotlib import pyplot
from matplotlib.figure import Figure
from matplotlib.text import Text
from support import plot_results as results

import coilarray.viz.plots
from coilarray.geometry import Hemisphere
from coilarray.paper.ellipse import Ellipse

LINE, PLANE = np.linspace(-20e-3, 20e-3, 9), np.linspace(-10e-3, 10e-3, 5)


MODULES = [
    importlib.import_module(module.name)
    for module in pkgutil.iter_modules(coilarray.viz.plots.__path__, "coilarray.viz.plots.")
]
PUBLIC = {
    name: function
    for module in MODULES
    for name, function in inspect.getmembers(module, inspect.isfunction)
    if not name.startswith("_") and function.__module__ == module.__name__
}
PLOTS = {name: function for name, function in PUBLIC.items() if name.startswith("plot_")}
BELLS = {"coil1": Ellipse(0.0, 8e-3, 6e-3), "coil2": Ellipse(9e-3, 8e-3, 6e-3)}


def neighbours():
    """Couplings, the outlines of their coils in a row, and the first of them."""
    square = 1e-3 * np.array([[0, 0], [9, 0], [9, 9], [0, 9]])
    outlines = {name: square + np.array([0.01 * k, 0]) for k, name in enumerate(results.NAMES)}
    return results.coupling(), outlines, results.NAMES[0]


ARGUMENTS = {
    "plot_bell_curve": lambda: (results.response(),), "plot_board": lambda: (results.board(),),
    "plot_boards": lambda: (results.tolerances(), "worst_k"), "plot_causes": lambda: (results.distortion(), "coil1"),
    "plot_centres": lambda: (results.comparison(), "coil1"), "plot_copper": lambda: (results.board(), "L1"),
    "plot_coupling": lambda: (results.coupling(),), "plot_coupling_sweep": lambda: (results.pitch_sweep(),),
    "plot_currents": lambda: (results.coupling(),), "plot_dent": lambda: (results.dents(), Hemisphere(2.5e-3)),
    "plot_distortion": lambda: (results.distortion(), "coil1"),
    "plot_equivalent_circuit": lambda: ({"L": "9.3 µH", "R": "2 Ω", "tank": "1 nF"},),
    "plot_evidence": lambda: (results.calibration(),),
    "plot_ellipse_parameters": lambda: (*results.ellipses(), "coil1"), "plot_ellipses": lambda: (BELLS,),
    "plot_field_lines": lambda: ({"open": results.field(LINE, [0.0])},),
    "plot_field_map": lambda: (results.field(LINE, PLANE),), "plot_force_depth": lambda: (results.dents(),),
    "plot_frequency_sweep": lambda: (results.frequency_sweep(),), "plot_identifiability": lambda: (results.bounds(),),
    "plot_neighbours": neighbours,
    "plot_stack": lambda: (results.board().stackup,),
    "plot_readings": lambda: (results.comparison(),),
    "plot_response": lambda: (results.response(), "coil1"), "plot_response_profile": lambda: (results.response(),),
    "plot_shares": lambda: (results.tolerances(),),
    "plot_stability": lambda: (results.noise(),),
    "plot_sweep_lines": lambda: (results.pitch_sweep(), "worst_k"),
    "plot_sweep_map": lambda: (results.grid_sweep(), "span_mm"),
    "plot_sweep_points": lambda: (results.grid_sweep(), "span_mm", "array.pitch_mm"),
    "plot_target": lambda: (results.target(),),
    "plot_x_error": lambda: (results.x_error(),),
}  # fmt: skip

# these take numbers of no particular result, and are tested with what they draw
PLAIN_NUMBERS = {"plot_convergence", "plot_front"}
DRAWN = sorted(PLOTS.keys() - PLAIN_NUMBERS)

# axes of texts, counts, pure numbers, and quantities whose names say the unit
NO_UNIT = {"Allan deviation of δ",
    "", "active coil", "passive coil", "k with coil1", "coupling coefficient k", "k", "worst_k", "span_mm",
    "array.columns", "trial",
    "|δ|",
    "ln evidence − best",
}  # fmt: skip


@pytest.mark.parametrize("name", DRAWN)
def test_a_plot_draws_into_the_axis_that_is_given_and_leaves_nothing_behind(name):
    windows, settings = pyplot.get_fignums(), dict(matplotlib.rcParams)
    left, right = Figure(figsize=(6.0, 4.0)).subplots(1, 2)
    left.plot([0, 1], [0, 1])
    before = [len(ax.get_children()) for ax in (left, right)]
    assert PLOTS[name](*ARGUMENTS[name](), ax=right) is right
    assert len(left.get_children()) == before[0]
    assert len(right.get_children()) > before[1]
    assert pyplot.get_fignums() == windows
    assert dict(matplotlib.rcParams) == settings


@pytest.mark.parametrize("name", DRAWN)
def test_a_plot_of_its_own_has_units_and_nothing_is_cut_off(name, monkeypatch):
    """Titles, labels, legends and numbers lie on the figure, also where the machine is slow.

    Matplotlib warns where it took a second to find the best place of a legend, unless "best" was asked for.
    """
    ax = PLOTS[name](*ARGUMENTS[name]())
    monkeypatch.setattr("matplotlib.legend.time.perf_counter", itertools.count(0.0, 10.0).__next__)
    ax.figure.draw_without_rendering()
    labels = [text for axis in (ax, *ax.child_axes) for text in (axis.get_xlabel(), axis.get_ylabel())]
    assert any(labels) or name in ("plot_coupling", "plot_board", "plot_equivalent_circuit", "plot_stack")
    for text in labels:
        assert text in NO_UNIT or re.search(r"\((mm|s|µH|MHz|Ω|A|mT per A|mA per A|mN|%|10⁻[³⁶])\)", text), text
    page = ax.figure.bbox
    for one in itertools.chain.from_iterable((whole, *whole.child_axes) for whole in ax.figure.axes):
        texts = [text for text in one.get_children() if isinstance(text, Text)]
        texts += [one.xaxis.label, one.yaxis.label, *(one.get_legend().get_texts() if one.get_legend() else ())]
        for text in texts:
            if text.get_text() and text.get_visible():
                box = text.get_window_extent()
                # the bounding box of a text is up to a pixel wider than its ink
                inside = (box.x0 - page.x0, page.x1 - box.x1, box.y0 - page.y0, page.y1 - box.y1)
                assert min(inside) >= -1, text.get_text()
