"""Pictures of a calibration: that curves, bands, dots and bars are those of the dataset."""

import numpy as np
import pytest
import xarray as xr
from support.plot_results import calibration, curves

from coilarray import viz
from coilarray.viz.plots import measurement as drawing


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
