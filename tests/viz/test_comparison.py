"""Pictures of a comparison: that maps, dots and curves are those of the dataset, which is made up."""

import numpy as np
import pytest
from matplotlib.collections import QuadMesh
from matplotlib.patches import Polygon
from support.plot_results import comparison

from coilarray.viz.plots.measurement import comparison_figure, plot_readings, plot_residual


def mesh(ax):
    (found,) = [one for one in ax.collections if isinstance(one, QuadMesh)]
    return found


@pytest.mark.parametrize("stage", ["before", "after"])
def test_a_residual_map_is_the_datasets(stage):
    data = comparison()
    outline = np.array([[0.0, 0.0], [1e-3, 0.0], [1e-3, 1e-3]])
    ax = plot_residual(data, "coil1", 0, stage, None, [outline])
    values = mesh(ax).get_array()
    np.testing.assert_allclose(values, data[f"residual_{stage}"].sel(state="coil1")[0] * 1e6)
    assert values.mask.sum() == 1  # the gap is no value, and so grey
    low, high = mesh(ax).get_clim()
    both = np.stack([data[f"residual_{one}"].sel(state="coil1") for one in ("before", "after")])
    assert (-low, high) == pytest.approx([np.nanmax(np.abs(both)) * 1e6] * 2)  # of both stages, to compare
    (shape,) = [patch for patch in ax.patches if isinstance(patch, Polygon)]
    np.testing.assert_allclose(shape.get_xy()[:-1], outline * 1e3)
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("x (mm)", "y (mm)")
    assert ax.get_xlim() == pytest.approx((-5, 5))  # half a spacing beyond the positions, whatever the outlines
    assert ("as simulated" if stage == "before" else "scaled and shifted") in ax.get_title(loc="left")


def test_readings_are_dots_about_equality():
    data = comparison()
    ax = plot_readings(data)
    dots = {line.get_label(): line for line in ax.lines if not line.get_label().startswith("_")}
    line = dots["coil2, scale 1.250 ± 0.125"]
    np.testing.assert_allclose(line.get_xdata(), data.delta.sel(source="simulated", state="coil2").values.ravel() * 1e3)
    np.testing.assert_allclose(line.get_ydata(), data.delta.sel(source="measured", state="coil2").values.ravel() * 1e3)
    (equal,) = [line for line in ax.lines if line.get_label().startswith("_")]
    np.testing.assert_array_equal(equal.get_xdata(), equal.get_ydata())
    assert len(plot_readings(comparison(8)).lines) == 9


@pytest.mark.slow
def test_a_figure_has_a_row_a_state():
    figure = comparison_figure(comparison(3))
    titles = [ax.get_title(loc="left") for ax in figure.axes]
    assert titles[:2] == ["coil1, as simulated", "coil1, scaled and shifted"]
    assert len([title for title in titles if title]) == 6
    assert "1 mm deep" in figure.get_suptitle()
    many = comparison_figure(comparison(8))
    assert "(6 of 8 states)" in many.get_suptitle()
    line = comparison_figure(comparison(2, y=np.zeros(1)))
    assert len(line.axes) == 1


def test_bad_input():
    with pytest.raises(ValueError, match="state must be one of coil1, coil2; got 'coil9'"):
        plot_residual(comparison(), "coil9")
    with pytest.raises(ValueError, match="at least two x and two y; got 5 and 1"):
        plot_residual(comparison(2, y=np.zeros(1)), "coil1")
