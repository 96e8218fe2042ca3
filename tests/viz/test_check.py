"""The picture of a check: one panel a layer, and a circle with the right number wherever a margin says."""

import math
from dataclasses import replace

import pytest
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from support.boards import reference_board

from coilarray.geometry import FabRules, Margin, check_rules
from coilarray.viz import check_figure
from coilarray.viz.palette import INK

pytestmark = pytest.mark.slow

RULES = FabRules(min_trace=0.12e-3, max_layers=2, max_inner_copper=20e-6)


@pytest.fixture(scope="module")
def array():
    return reference_board(count=2, turns=5)


def at(x, y, layer="L1", *, margin=-0.02e-3, unit="m"):
    return Margin("trace width", layer, "C1", margin, 0.12e-3, 0.12e-3 + margin, x, y, unit)


def panels(figure):
    """The panel of each layer by its name, without the enlarged places."""
    return {ax.get_title(loc="left").removeprefix("Copper "): ax for ax in figure.axes if ax not in details(figure)}


def details(figure):
    return [ax for ax in figure.axes if not ax.get_title(loc="left").startswith("Copper ")]


def marks(ax):
    """Numbers, place in m and colour of every circle, in the order in which they were drawn."""
    circles = [line for line in ax.lines if line.get_gid() is not None]
    numbers = [text.get_text() for text in ax.texts if not text.get_text().startswith("C")]  # and not the coils' names
    for shown, line in zip(numbers, circles, strict=True):
        first, *others = line.get_gid().split(", ")
        # all of them, if there are few; many would lie over those of the next circle
        assert shown == (line.get_gid() if len(others) < 2 else f"{first}, …")
    return [
        (line.get_gid(), (line.get_xdata()[0] * 1e-3, line.get_ydata()[0] * 1e-3), to_rgb(line.get_markeredgecolor()))
        for line in circles
    ]


def numbers(label):
    return {int(number) for number in label.split(", ")}


def test_one_panel_a_layer_and_every_place_is_marked_on_its_own(array):
    margins = check_rules(array, RULES)
    figure = check_figure(array, margins)
    assert isinstance(figure, Figure)
    whole = panels(figure)
    assert list(whole) == list(array.stackup.names)
    x_min, y_min, x_max, y_max = array.bounds
    near = 0.025 * math.hypot(x_max - x_min, y_max - y_min)  # places nearer than that share a circle
    marked = {}
    for layer, ax in whole.items():
        left, right = ax.get_xlim()
        assert left < x_min * 1e3 < x_max * 1e3 < right
        for label, place, _ in marks(ax):
            for number in numbers(label):
                assert number not in marked
                marked[number] = layer
                margin = margins[number - 1]
                assert margin.layer == layer
                assert math.dist(place, (margin.x, margin.y)) <= near
            first = margins[min(numbers(label)) - 1]
            assert place == pytest.approx((first.x, first.y), abs=1e-12)  # m to mm and back
    assert set(marked) == {k for k, margin in enumerate(margins, start=1) if margin.x is not None}
    assert len(marked) < len(margins)  # layers and copper have no place


def test_broken_places_are_red_and_close_ones_share_a_circle(array):
    figure = check_figure(array, [at(0, 0), at(20e-3, 0, margin=0.0), at(-20e-3, 0, margin=1e-3)])
    (_, _, broken), (_, _, touching), (_, _, kept) = marks(panels(figure)["L1"])
    assert touching == kept == to_rgb(INK)
    red, green, blue = broken
    assert red > 3 * max(green, blue)
    x_min, y_min, x_max, y_max = array.bounds
    step = 0.02 * math.hypot(x_max - x_min, y_max - y_min)  # below the 0.025 at which places part
    places = [at(0, 0), at(step, 0), at(0, step), at(3 * step, 0), at(0, -step), at(0, 0, "L2")]
    figure = check_figure(array, places)
    assert [label for label, _, _ in marks(panels(figure)["L1"])] == ["1, 2, 3, 5", "4"]
    assert [label for label, _, _ in marks(panels(figure)["L2"])] == ["6"]


def test_the_first_place_of_a_layer_is_enlarged(array):
    figure = check_figure(array, [at(10e-3, 2e-3, "L3"), at(-10e-3, 0, "L3"), at(5e-3, 1e-3)])
    one, three = details(figure)
    for ax, (x, y), number in ((three, (10, 2), 1), (one, (5, 1), 3)):
        left, right = ax.get_xlim()
        bottom, top = ax.get_ylim()
        assert ((left + right) / 2, (bottom + top) / 2) == pytest.approx((x, y), abs=1e-9)
        # ten times the 0.12 mm of the limit
        assert right - left == pytest.approx(top - bottom) == pytest.approx(1.2)
        assert ax.get_title(loc="left") == f"{number}: trace width of C1,\n0.1 mm, limit 0.12 mm"
    worst = replace(at(0, 0, unit=""), rule="aspect ratio", value=3.925, limit=2.0, margin=-1.925)
    (detail,) = details(check_figure(array, [worst]))
    assert detail.get_title(loc="left") == "1: aspect ratio of C1,\n3.925, limit 2"
    left, right = detail.get_xlim()
    assert right - left == pytest.approx(1.0)
