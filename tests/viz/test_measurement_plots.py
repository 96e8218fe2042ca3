"""Pictures of comparisons and calibrations: their curves, bands, dots and bars are those of the dataset."""

import numpy as np
import pytest
import xarray as xr
from matplotlib.collections import QuadMesh
from matplotlib.patches import Polygon
from support.plot_results import calibration, comparison, curves

from coilarray import viz
from coilarray.viz.plots import localize as drawing
from coilarray.viz.plots.localize import comparison_figure, plot_centres, plot_readings


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


def test_centres_of_both_are_drawn_with_a_band():
    data = comparison()
    ax = plot_centres(data, "coil1")
    lines = {line.get_label(): line for line in ax.lines}
    np.testing.assert_allclose(lines["measured"].get_ydata(), 0.0)
    np.testing.assert_allclose(lines["simulated"].get_ydata(), 1.0)
    np.testing.assert_allclose(lines["measured"].get_xdata(), [0.1, 0.2, 0.3, 0.4])
    np.testing.assert_allclose(lines["centre of the coil"].get_ydata(), 0.0)
    band = ax.collections[0].get_paths()[0].vertices[:, 1]
    assert (band.min(), band.max()) == pytest.approx((-0.2, 0.2))  # two standard deviations
    empty = plot_centres(data, "coil2")
    assert [text.get_text() for text in empty.texts] == ["no ellipses"]
    with pytest.raises(ValueError, match="state must be one of coil1, coil2; got 'coil9'"):
        plot_centres(data, "coil9")


@pytest.mark.slow
def test_a_figure_has_a_row_a_state():
    data, outline = comparison(3), np.array([[0.0, 0.0], [1e-3, 0.0], [1e-3, 1e-3]])
    figure = comparison_figure(data, outlines=[outline])
    assert len([ax for ax in figure.axes if ax.get_title(loc="left")]) == 9
    both = np.stack([data[f"residual_{stage}"].sel(state="coil1")[0] for stage in ("before", "after")])
    for ax, values in zip(figure.axes, both, strict=False):
        (mesh,) = (one for one in ax.collections if isinstance(one, QuadMesh))
        np.testing.assert_allclose(mesh.get_array(), values * 1e6)
        # of both stages, to compare
        assert np.abs(mesh.get_clim()) == pytest.approx([np.nanmax(np.abs(both)) * 1e6] * 2)
        (shape,) = [patch for patch in ax.patches if isinstance(patch, Polygon)]
        np.testing.assert_allclose(shape.get_xy()[:-1], outline * 1e3)
        assert ax.get_xlim() == pytest.approx((-5, 5))  # half a spacing beyond the positions, whatever the outlines
    assert figure.axes[0].collections[0].get_array().mask.sum() == 1  # the gap is no value, and so grey
    many = comparison_figure(comparison(8))
    assert "(6 of 8 states)" in many.get_suptitle()
    line = comparison_figure(comparison(2, y=np.zeros(1)))
    assert len(line.axes) == 1


@pytest.mark.slow
def test_ellipses_are_drawn_with_their_band_and_what_remains():
    data = calibration()
    figure = viz.calibration_figure(data)
    left, right = figure.axes[:2]
    of = data.isel(combination=0)
    A = of.isel(datum=np.flatnonzero((of.state == "coil1") & (of.quantity == "A")))
    np.testing.assert_allclose(curves(left)["A"].get_xydata(), np.c_[A.level * 1e3, A.model * 1e3])
    np.testing.assert_allclose(curves(right)["A"].get_ydata(), A.residual.values)
    assert [curves(right)[name].get_linestyle() for name in ("A", "$x_0$")] == ["-", "--"]  # x0 is predicted only
    hidden = data.copy(deep=True)
    hidden.model[0, np.flatnonzero((of.state == "coil1") & (of.quantity == "x0"))[0]] = np.nan
    for ax in viz.calibration_figure(hidden).axes[:2]:  # where the window does not show the ellipse there is no line
        assert np.isnan(curves(ax)["A"].get_ydata()[0])
    assert len(figure.axes) == 6
    figure.draw_without_rendering()


@pytest.mark.slow
def test_a_response_is_drawn_along_x_and_by_position():
    data = calibration("response")
    figure = viz.calibration_figure(data)
    left, right = figure.axes[:2]
    of = data.isel(combination=0)
    first = of.isel(datum=np.flatnonzero((of.state == "coil1") & (of.y == of.y.min())))
    np.testing.assert_allclose(curves(left)["measured"].get_ydata(), first.measured * 1e3)
    np.testing.assert_allclose(curves(left)["fitted"].get_ydata(), first.model * 1e3)
    whole = of.isel(datum=np.flatnonzero(of.state == "coil1"))
    np.testing.assert_allclose(right.collections[0].get_array(), whole.residual.values)
    figure.draw_without_rendering()


@pytest.mark.slow
def test_of_many_states_those_with_the_largest_values_are_drawn(monkeypatch):
    data = calibration("response")
    assert viz.calibration_figure(data).get_suptitle() == ""
    monkeypatch.setattr(drawing, "MOST_STATES", 1)
    larger = data.assign(measured=data.measured * xr.where(data.state == "coil2", 10.0, 1.0))
    for dataset, drawn in ((data, "coil1"), (larger, "coil2")):
        figure = viz.calibration_figure(dataset)
        assert figure.get_suptitle() == "The 1 of 2 states with the largest values"
        assert [ax.get_title(loc="left").split(",")[0] for ax in figure.axes[:1]] == [drawn]


def test_the_posterior_is_the_draws_of_one_combination():
    data = calibration()
    free = data.combination.values.tolist().index("free")
    figure = viz.posterior_figure(data, free)
    assert len(figure.axes) == 3
    pair = figure.axes[1]
    np.testing.assert_array_equal(pair.lines[0].get_ydata(), data.posterior[free, :, 1])
    assert pair.lines[1].get_xydata()[0] == pytest.approx(data["value"].values[free])
    assert pair.get_xlabel() == "gap_mm"
    assert len(viz.posterior_figure(data, 1 - free).axes) == 1
    figure.draw_without_rendering()
