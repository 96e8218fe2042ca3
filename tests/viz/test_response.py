"""Pictures of the response: that maps and profiles are those of the numbers given, which are made up."""

import functools

import numpy as np
import pytest
import xarray as xr
from matplotlib.contour import QuadContourSet
from matplotlib.patches import Polygon
from support import plot_results as results
from support.plot_results import curves

from coilarray.viz import plot_response, plot_response_profile, response_figure

response = functools.partial(results.response, y=(-6e-3, -2e-3, 3e-3), centre=5e-3, width=6e-3)


def contours(ax):
    """The filled bands and, where they are drawn, the lines of zero."""
    sets = [artist for artist in ax.collections if isinstance(artist, QuadContourSet)]
    return [s for s in sets if s.filled], [s for s in sets if not s.filled]


def test_a_map_stands_the_right_way_round_and_marks_where_it_changes_sign():
    ax = plot_response(response(lambda x, y, state, depth: depth * (x - 2e-3) + 0 * y), "coil2", 1)
    _, (zero,) = contours(ax)
    assert zero.levels == [0.0]
    # linear between samples, so the line is exact
    np.testing.assert_allclose(zero.get_paths()[0].vertices[:, 0], 2.0, atol=1e-9)
    upright = plot_response(response(lambda x, y, state, depth: y + 1e-3 + 0 * x), "coil2")
    np.testing.assert_allclose(contours(upright)[1][0].get_paths()[0].vertices[:, 1], -1.0, atol=1e-9)
    assert ax.get_aspect() == 1.0
    assert ax.get_xlim() == pytest.approx((-20, 20))


def test_colours_hold_every_value_and_zero_is_drawn_where_there_is_something():
    data = response(lambda x, y, state, depth: 7.4e-4 * np.exp(-((x / 5e-3) ** 2)) - 2e-5 + 0 * y)
    ax = plot_response(data, "coil1")
    (bands,), _ = contours(ax)
    np.testing.assert_allclose(bands.levels, -bands.levels[::-1], atol=1e-9)
    assert bands.levels[-1] >= 720  # 7.2e-4 in 10⁻⁶
    assert bands.get_clim() == pytest.approx((bands.levels[0], bands.levels[-1]))
    # nothing is 1 % of the largest; beyond it the negative ring never shares a band with the bell
    assert np.abs(bands.levels).min() == pytest.approx(7.2, rel=1e-9)
    assert ax.child_axes[0].get_ylabel() == "δ (10⁻⁶)"
    positive = plot_response(response(), "coil1")
    assert not contours(positive)[1]
    assert contours(positive)[0][0].levels[0] > 0  # of one sign: all colours from what is nothing up


def test_outlines_and_names_of_the_coils():
    square = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]) * 8e-3
    near, far, above = (square + np.array(middle) for middle in ([5e-3, 0], [60e-3, 30e-3], [5e-3, 20e-3]))
    ax = plot_response(response(), "coil1", outlines=[near, far, above])
    shapes = [patch.get_xy()[:-1] for patch in ax.patches if isinstance(patch, Polygon)]
    np.testing.assert_allclose(shapes, [near * 1e3, far * 1e3, above * 1e3])
    low, high = ax.get_ylim()
    assert low < -8 < 8 < high < 10  # all of the near coil, nothing of those that the map does not touch
    # the names stand towards the lower end of the outline, so that they leave the peaks free
    places = {text.get_text(): text.get_position() for text in ax.texts}
    assert places == {"coil1": (-5, pytest.approx(-0.8 * 8)), "coil2": (5, pytest.approx(-0.8 * 8))}
    with pytest.raises(ValueError, match="state must be one of coil1, coil2; got 'coil9'"):
        plot_response(response(), "coil9")
    with pytest.raises(ValueError, match="depth must be the position of one of 2 depths; got 2"):
        plot_response(response(), "coil1", 2)
    with pytest.raises(ValueError, match="at least two x and two y; got 21 and 1"):
        plot_response(response(y=(0.0,)), "coil1")


def test_profiles_of_all_states_or_all_depths_along_x_or_y():
    data = response()
    states = plot_response_profile(data, depth=1)
    assert list(curves(states)) == ["coil1", "coil2"]
    row = data.delta.sel(y=-2e-3)  # the nearest to zero
    for name, line in curves(states).items():
        np.testing.assert_allclose(line.get_xdata(), data.x * 1e3)
        np.testing.assert_allclose(line.get_ydata() * 1e-6, row.sel(state=name).isel(depth=1), rtol=1e-12)
    assert states.get_title(loc="left") == "Response at y = −2 mm, 1 mm deep"
    depths = plot_response_profile(data, "coil2", None)
    assert list(curves(depths)) == ["0.5 mm", "1 mm"]
    np.testing.assert_allclose(
        curves(depths)["0.5 mm"].get_ydata() * 1e-6, row.sel(state="coil2").isel(depth=0), rtol=1e-12
    )
    assert list(curves(plot_response_profile(data, depth=None))) == [
        "coil1, 0.5 mm", "coil2, 0.5 mm", "coil1, 1 mm", "coil2, 1 mm",
    ]  # fmt: skip
    alone = plot_response_profile(data, "coil1", 0)
    assert list(curves(alone)) == ["coil1"]
    np.testing.assert_allclose(
        curves(alone)["coil1"].get_ydata() * 1e-6, row.sel(state="coil1").isel(depth=0), rtol=1e-12
    )
    data = response(lambda x, y, state, depth: depth * (1 + state) * y * np.exp(-(((x - 4e-3) / 6e-3) ** 2)))
    ax = plot_response_profile(data, "coil2", -1, along="y")
    (line,) = curves(ax).values()
    np.testing.assert_allclose(line.get_xdata(), [-6, -2, 3])
    np.testing.assert_allclose(line.get_ydata(), 2e-3 * data.y * 1e6, rtol=1e-12)  # where it answers most, at x = 4 mm
    assert ax.get_xlabel() == "y (mm)"
    assert ax.get_title(loc="left") == "Response at x = 4 mm, coil2, 1 mm deep"


def crowd(count):
    """The response of as many states, each with its number times the depth everywhere but at the edges of the map."""
    data = response(lambda x, y, state, depth: depth * (np.abs(x) < 15e-3) + 0 * y + 0 * state)
    states = [data.delta.isel(state=0) * (k + 1) for k in range(count)]
    delta = xr.concat(states, "state").assign_coords(state=[f"s{k}" for k in range(count)])
    return data.drop_vars(["delta", "state"]).assign(delta=delta.transpose("depth", "y", "x", "state"))


def maps_of(figure):
    """The maps of a figure by their titles."""
    return {ax.get_title(loc="left"): ax for ax in figure.axes if ax.get_title(loc="left")}


@pytest.mark.slow
def test_every_state_has_a_map_of_the_deepest_dent():
    outline = np.array([[-4e-3, -9e-3], [4e-3, -9e-3], [0, 9e-3]])
    figure = response_figure(crowd(3), [outline])
    maps = maps_of(figure)
    assert list(maps) == ["s0", "s1", "s2"]
    assert len(figure.axes) == 4  # and one colour bar
    limits = set()
    for k, ax in enumerate(maps.values()):
        (bands,), _ = contours(ax)
        limits.add(bands.get_clim())
        # bands from (k + 1) · 1 mm of 3 mm, in units of 10⁻³: the highest one that is filled holds the value
        filled = [low for low, path in zip(bands.levels, bands.get_paths(), strict=False) if len(path.vertices)]
        assert filled[-1] < k + 1 <= filled[-1] + np.diff(bands.levels).max()
        assert ax.get_ylim()[0] < -9 < 9 < ax.get_ylim()[1]
        assert ax.get_aspect() == 1.0
        (shape,) = [patch for patch in ax.patches if isinstance(patch, Polygon)]
        np.testing.assert_allclose(shape.get_xy()[:-1], outline * 1e3)
    assert len(limits) == 1
    assert figure.axes[-1].get_ylabel() == "δ (10⁻³)"
    assert figure.get_suptitle() == "Response, 1 mm deep"
    assert list(maps_of(response_figure(crowd(16)))) == [f"s{k}" for k in range(16)]


@pytest.mark.slow
@pytest.mark.parametrize(("count", "stretch"), [(1, 0.1), (2, 1.0), (6, 0.1), (12, 10.0)])
def test_figures_of_any_shape_fit_on_a_page(count, stretch):
    data = crowd(count).assign_coords(y=np.array([-6e-3, -2e-3, 3e-3]) * stretch)
    figure = response_figure(data)
    width, height = figure.get_size_inches()
    assert 3 < width < 10
    assert 2 < height < 11
    figure.draw_without_rendering()
    boxes = [ax.get_window_extent() for ax in maps_of(figure).values()]
    assert len(boxes) == count
    for k, box in enumerate(boxes):
        assert not any(box.overlaps(other) for other in boxes[:k])
    # names of the axes stand at the left and below the lowest map of every column
    left = min(box.x0 for box in boxes)
    for ax, box in zip(maps_of(figure).values(), boxes, strict=True):
        assert bool(ax.get_ylabel()) == (box.x0 < left + 1)
        lowest = not any(abs(other.x0 - box.x0) < 1 and other.y0 < box.y0 - 1 for other in boxes)
        assert bool(ax.get_xlabel()) == lowest


def test_a_single_line_is_drawn_as_profiles():
    data = response()
    for along, fixed in (("x", {"y": 1}), ("y", {"x": 4})):
        (ax,) = response_figure(data.isel({name: [k] for name, k in fixed.items()})).axes
        np.testing.assert_allclose(curves(ax)["coil1"].get_xdata(), data[along] * 1e3)
        np.testing.assert_allclose(curves(ax)["coil1"].get_ydata() * 1e-6, data.delta.isel(depth=-1, state=0, **fixed))
    assert ax.get_title(loc="left") == "Response at x = −12 mm, 1 mm deep"
    (ax,) = response_figure(data.isel(x=[4], y=[1])).axes
    assert curves(ax)["coil1"].get_marker() == "o"  # a line of one point would not be seen
    (ax,) = response_figure(crowd(17).isel(y=[0])).axes
    assert list(curves(ax)) == [f"s{k}" for k in range(1, 17)]  # the others answer more
    assert ax.get_title(loc="left").endswith("1 mm deep (16 of 17 states, those nearest to the middle)")
