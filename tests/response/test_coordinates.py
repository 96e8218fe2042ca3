"""Where a response is on the board."""

import numpy as np
import pytest
import xarray as xr

from coilarray import load_design
from coilarray.response.dataset import (
    ELLIPSE_WINDOW,
    axis_label,
    in_ellipse_window,
    middle_state,
    on_board,
    origin_attributes,
    origin_of,
)

AXIS = [-1e-3, 0.0, 2e-3]


def a_map(**attributes):
    delta = (("y", "x"), np.arange(9.0).reshape(3, 3))
    coords = {"x": ("x", AXIS, {"units": "m"}), "y": AXIS, "coil": ["a"], "coil_x": ("coil", [13e-3])}
    return xr.Dataset({"delta": delta}, coords, attributes)


def test_positions_are_moved_to_the_board_once_and_values_stay():
    setup = load_design("gast2020").indentation
    given = a_map(**origin_attributes(setup))
    assert origin_of(given) == setup.origin_point
    moved = on_board(given)
    np.testing.assert_array_equal(moved.x, np.add(AXIS, -19.92e-3))
    np.testing.assert_array_equal(moved.y, AXIS)
    assert float(moved.coil_x[0]) == pytest.approx(-6.92e-3)
    assert moved.x.attrs == {"units": "m"}
    np.testing.assert_array_equal(moved.delta, given.delta)
    assert on_board(moved) is moved
    assert float(given.x[0]) == -1e-3


def test_an_axis_names_its_origin_where_it_is_not_the_board():
    assert axis_label(a_map(), "x") == "x (mm)"
    assert axis_label(a_map(origin="coil2", origin_x=-0.02, origin_y=0.0), "y") == "y from coil2 (mm)"
    assert axis_label(a_map(origin="board", origin_x=1e-3, origin_y=0.0), "x") == "x from the map's origin (mm)"


def test_of_equally_near_states_the_first_is_the_middle_one():
    """As `Array.middle_coil`: what a mesh makes of equal peaks does not count, a peak twice as high does."""
    places = {"depth": [1e-3], "y": [0.0], "x": [-1e-2, 1e-2], "state": ["left", "right"]}
    for higher, middle in ((1.001, "left"), (2.0, "right")):
        delta = (("depth", "y", "x", "state"), [[[[1e-4, 0.0], [0.0, higher * 1e-4]]]])
        assert middle_state(xr.Dataset({"delta": delta}, places)) == middle


def test_the_window_of_the_ellipses_goes_along_to_the_board_and_cuts_the_same_places():
    window = {ELLIPSE_WINDOW: [-1e-3, 0.0, 0.0, 2e-3]}
    given = a_map(**origin_attributes(load_design("gast2020").indentation), **window)
    cut = in_ellipse_window(given)
    assert (cut.x.values.tolist(), cut.y.values.tolist()) == ([-1e-3, 0.0], [0.0, 2e-3])
    np.testing.assert_array_equal(in_ellipse_window(on_board(given)).delta, cut.delta)
    plain = a_map()
    assert in_ellipse_window(plain) is plain
