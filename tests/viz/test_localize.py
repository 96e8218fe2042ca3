"""Pictures of the localization: that curves and maps are those of the numbers given, which are made up."""

from itertools import pairwise

import numpy as np
import pytest
import xarray as xr
from matplotlib.patches import Ellipse as EllipsePatch
from matplotlib.patches import Polygon
from support.localize_boards import ROW, board
from support.plot_results import bounds, curves, distortion, x_error

from coilarray import viz
from coilarray.paper.ellipse import fit_ellipses
from coilarray.paper.ellipse_model import ellipse_model, intersect, published_map, published_model

DELTA = np.array([1e-4, 5e-4, 1e-3])


@pytest.fixture(scope="module")
def fits():
    return fit_ellipses(published_map())


def test_markers_are_the_fits_and_lines_the_polynomials(fits):
    model = ellipse_model(fits)
    ax = viz.plot_ellipse_parameters(fits, model, "coil2", None, published_model())
    of = fits.sel(state="coil2")
    markers = [line for line in ax.lines if line.get_marker() in "os^"]
    assert len(markers) == 3
    for key, line in zip(("A", "B", "x0"), markers, strict=True):
        np.testing.assert_allclose(line.get_xdata(), of.delta * 1e3)
        np.testing.assert_allclose(line.get_ydata(), of[key] * 1e3)
    for key, label in (("A", "A"), ("B", "B"), ("x0", "$x_0$")):
        line = curves(ax)[label]
        at = line.get_xdata() * 1e-3
        np.testing.assert_allclose(line.get_ydata(), np.polyval(getattr(model["coil2"], key), at) * 1e3, atol=1e-9)
    line = curves(ax)["Table A1"]
    expected = np.polyval(published_model()["coil2"].A, line.get_xdata() * 1e-3) * 1e3
    np.testing.assert_allclose(line.get_ydata(), expected, atol=1e-9)
    assert "Table A1" not in curves(viz.plot_ellipse_parameters(fits, model, "coil2"))
    with pytest.raises(ValueError, match="state must be one of coil1, coil2, coil3; got 'coil9'"):
        viz.plot_ellipse_parameters(fits, model, "coil9")


@pytest.mark.slow
@pytest.mark.parametrize("count", [1, 4])
def test_every_coil_of_a_model_has_a_panel(count):
    states = [f"coil{k + 1}" for k in range(count)]
    fits = fit_ellipses(board(ROW, 2e-3, [1e-3]), states=states, refinement=2, step=2e-4)
    figure = viz.ellipse_parameter_figure(fits, ellipse_model(fits))
    assert [ax.get_title(loc="left") for ax in figure.axes] == [f"Ellipses of coil{k + 1}" for k in range(count)]
    figure.draw_without_rendering()
    boxes = [ax.get_window_extent() for ax in figure.axes]
    boxes += [legend.get_window_extent() for legend in figure.legends]
    assert len(boxes) == count + 1  # one legend, which hides no point
    assert not any(box.overlaps(other) for k, box in enumerate(boxes) for other in boxes[:k])


def test_two_ellipses_and_where_they_meet():
    model, deltas = published_model(), {"coil1": 8.0895e-4, "coil2": 6.4684e-4}
    ellipses = {name: model[name].ellipse(delta) for name, delta in deltas.items()}
    place = intersect(model, deltas, "coil1", "coil2")
    ax = viz.plot_ellipses(ellipses, place, (-8.75e-3, -3.6e-3))
    shapes = {patch.get_label(): patch for patch in ax.patches if isinstance(patch, EllipsePatch)}
    assert list(shapes) == ["coil1", "coil2"]
    dots = next(line for line in ax.lines if line.get_label().startswith("x = −8.75 mm, two points"))
    np.testing.assert_allclose(dots.get_xydata(), np.array([[place.x, place.y], [place.x, -place.y]]) * 1e3)
    for name, shape in shapes.items():
        assert (shape.width, shape.height) == pytest.approx((2e3 * ellipses[name].A, 2e3 * ellipses[name].B))
        assert shape.center == pytest.approx((ellipses[name].x0 * 1e3, 0.0))
        assert abs(float(ellipses[name].distance(place.x, place.y))) < 1e-9
    with pytest.raises(ValueError, match="one or more"):
        viz.plot_ellipses({})


def test_a_map_of_errors_is_symmetric_about_zero_and_grey_where_there_is_none():
    error = x_error()
    outline = np.array([[-1e-3, -1e-3], [1e-3, -1e-3], [0, 5e-3]])
    ax = viz.plot_x_error(error, None, [outline])
    (image,) = ax.collections
    np.testing.assert_allclose(np.ma.filled(image.get_array(), np.nan), error.values * 1e3)
    assert image.get_clim() == pytest.approx((-0.4, 0.4))
    assert ax.get_ylim()[1] == pytest.approx(1.5)  # of the map, not of the outline
    (shape,) = [patch for patch in ax.patches if isinstance(patch, Polygon)]
    np.testing.assert_allclose(shape.get_xy()[:-1], outline * 1e3)
    for bad in (error * np.nan, error[:1]):
        with pytest.raises(ValueError, match="at least two x and two y and one value"):
            viz.plot_x_error(bad)


@pytest.mark.slow
def test_distortion_of_a_coil_and_its_ranked_causes():
    data = distortion()
    lines = curves(viz.plot_distortion(data, "coil1"))
    assert list(lines) == ["neighbours grounded", "neighbours open", "Table A1", "centre of the coil"]
    np.testing.assert_allclose(lines["neighbours grounded"].get_xydata(), np.c_[DELTA * 1e3, [1.0, 2.0, 3.0]])
    np.testing.assert_allclose(lines["neighbours open"].get_ydata(), [1.5, 2.5, 3.5])
    np.testing.assert_allclose(lines["Table A1"].get_ydata(), [0.5, 1.0, 1.5])
    assert "Table A1" not in curves(viz.plot_distortion(data, "coil2"))
    hidden = data.assign(published_undetermined=data.published_x0 < 0.7e-3)
    crossed = curves(viz.plot_distortion(hidden, "coil1"))["undetermined"]
    np.testing.assert_allclose(crossed.get_xydata(), [[DELTA[0] * 1e3, 0.5]])
    for draw in (viz.plot_distortion, viz.plot_causes):
        with pytest.raises(ValueError, match="state must be one of coil1, coil2; got 'coil3'"):
            draw(data, "coil3")
    ax = viz.plot_causes(distortion(), "coil1")
    assert list(curves(ax)) == ["noise, 0.40", "all neighbours, 0.20", "neighbour coil2, 0.10"]
    np.testing.assert_allclose(curves(ax)["all neighbours, 0.20"].get_ydata(), 0.2)
    drawn = sorted(float(line.get_ydata()[0]) for line in ax.lines if len(line.get_ydata()) == 3)
    np.testing.assert_allclose(drawn, [0.001, 0.1, 0.2, 0.4])
    assert len(viz.distortion_figure(distortion()).axes) == 4


def test_bounds_are_shown_in_millimetres_and_infinite_ones_grey():
    found = bounds()
    ax = viz.plot_identifiability(found, "sigma_h")
    (image,) = ax.collections
    shown = image.get_array()
    assert (np.ma.getmaskarray(shown) == ~np.isfinite(found.sigma_h.values)).all()
    assert np.ma.getmaskarray(shown).any()  # y = 0, where the board is symmetric
    np.testing.assert_allclose(shown.compressed(), found.sigma_h.values[np.isfinite(found.sigma_h)] * 1e3)
    wide = found.assign(sigma_y=found.sigma_y.copy())
    wide.sigma_y[0, 0], wide.sigma_y[0, 1] = 1.01 * np.ptp(found.y.values), 1e-9
    ax = viz.plot_identifiability(wide, "sigma_y")
    assert np.ma.getmaskarray(ax.collections[0].get_array())[0].tolist()[:2] == [True, False]  # larger than the map
    assert ax.collections[0].colorbar.extend == "max"  # as the largest is above three decades
    with pytest.raises(ValueError, match="quantity must be one of sigma_x, sigma_y, sigma_h; got 'condition'"):
        viz.plot_identifiability(found, "condition")
    with pytest.raises(ValueError, match="one finite value"):
        viz.plot_identifiability(found * np.inf)
    with pytest.raises(ValueError, match="no finite standard deviation"):
        viz.identifiability_figure(found * np.inf)


@pytest.mark.slow
def test_bounds_of_a_square_board_stand_side_by_side_and_no_title_is_cut():
    at = np.linspace(-15e-3, 15e-3, 5)
    sigma = xr.DataArray(np.full((5, 5), 1e-5) * np.arange(1, 6), {"y": at, "x": at}, ("y", "x"))
    attributes = {"depth": 0.6e-3, "noise": [3e-7, 4e-7], "common_noise": [4.6e-6]}
    figure = viz.identifiability_figure(
        xr.Dataset(dict.fromkeys(("sigma_x", "sigma_y", "sigma_h"), sigma), attrs=attributes)
    )
    assert "noise 0.3·10⁻⁶ to 0.4·10⁻⁶ in δ, 4.6·10⁻⁶ common" in figure.get_suptitle()
    figure.draw_without_rendering()
    maps = [ax for ax in figure.axes if ax.get_xlabel() == "x (mm)"]
    assert [ax.get_title(loc="left") for ax in maps] == ["of x", "of y", "of depth"]
    boxes = [ax.get_tightbbox() for ax in maps]
    assert all(left.x1 <= right.x0 for left, right in pairwise(boxes))
    for box in (*boxes, figure._suptitle.get_window_extent()):
        assert figure.bbox.x0 <= box.x0 < box.x1 <= figure.bbox.x1
