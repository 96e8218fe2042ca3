"""The colours of the pictures as eyes see them: distances in CIELAB, for normal and for colour-blind vision.

Vision with one kind of cones missing is simulated by Machado, Oliveira & Fernandes, "A physiologically-based model for
simulation of color vision deficiency", IEEE Trans. Vis. Comput. Graph. 15, 1291 (2009), severity 1, in linear sRGB.
"""

from itertools import combinations, pairwise

import matplotlib
import numpy as np
import pytest
from matplotlib.colors import Normalize, to_rgb

from coilarray.viz import palette
from coilarray.viz.palette import DIVERGING, SEQUENTIAL, coil_colours, curve_look
from coilarray.viz.plots.circuit import _heat_map

# rows give red, green and blue as they are seen
VISIONS = {
    "all cones": np.eye(3),
    "no long-wave cones": np.array(
        [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]]
    ),
    "no medium-wave cones": np.array(
        [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]]
    ),
    "no short-wave cones": np.array(
        [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.303900]]
    ),
}
TO_XYZ = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])  # IEC 61966-2-1

# A difference of 2.3 is just noticeable (Mahy, Van Eycken & Oosterlinck 1994); six times that is told apart without
# having both side by side.
TOLD_APART = 15.0


def linear(colours):
    """Linear red, green and blue of sRGB from 0 to 1."""
    rgb = np.asarray(colours, dtype=float)
    return np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)


def lab(colours, vision="all cones"):
    """CIELAB coordinates of sRGB colours, shape (n, 3), as they are seen."""
    seen = np.clip(linear(colours) @ VISIONS[vision].T, 0.0, 1.0)
    ratio = seen @ TO_XYZ.T / TO_XYZ.sum(axis=1)  # to white
    f = np.where(ratio > (6 / 29) ** 3, np.cbrt(ratio), ratio / (3 * (6 / 29) ** 2) + 4 / 29)
    return np.column_stack((116 * f[:, 1] - 16, 500 * (f[:, 0] - f[:, 1]), 200 * (f[:, 1] - f[:, 2])))


def nearest(colours, vision):
    """Least distance of two colours of a set."""
    seen = lab([to_rgb(colour) for colour in colours], vision)
    return min(float(np.linalg.norm(a - b)) for a, b in combinations(seen, 2))


def of_map(name, vision):
    """CIELAB coordinates of the 256 colours of a map."""
    return lab(matplotlib.colormaps[name](np.arange(256))[:, :3], vision)


def test_the_simulation_keeps_white_and_finds_what_is_known():
    """Red, green and blue in CIELAB as tabled for sRGB (Lindbloom); greys are seen as greys by everyone."""
    np.testing.assert_allclose(
        lab(np.eye(3)),
        [[53.24, 80.09, 67.20], [87.73, -86.18, 83.18], [32.30, 79.19, -107.86]],
        atol=0.06,  # of the four digits of the matrix
    )
    for vision in VISIONS:
        grey = lab(np.full((3, 3), 1.0) * [[0.2], [0.5], [1.0]], vision)
        np.testing.assert_allclose(grey[:, 1:], 0.0, atol=0.05)
    red, green = [(0.8, 0.2, 0.2)], [(0.45, 0.42, 0.2)]  # alike without medium-wave cones, and far apart with them
    assert np.linalg.norm(lab(red) - lab(green)) > 2 * np.linalg.norm(
        lab(red, "no medium-wave cones") - lab(green, "no medium-wave cones")
    )
    assert nearest(("#B03030", "#707020"), "no medium-wave cones") < TOLD_APART
    # It was made so in CAM02-UCS, lightness included, from which CIELAB's differs by some ten per cent.
    steps = np.diff(of_map(SEQUENTIAL, "all cones")[:, 0])
    assert steps.max() / steps.min() < 1.5


@pytest.mark.parametrize("vision", VISIONS)
@pytest.mark.parametrize("name", ["COILS", "LAYERS", "SHEETS", "KINDS"])
def test_colours_of_a_set_are_told_apart(name, vision):
    assert nearest(getattr(palette, name), vision) > TOLD_APART


@pytest.mark.parametrize(("columns", "rows", "shift"), [(4, 4, 0.0), (16, 1, 0.0), (8, 8, 0.0), (8, 8, 0.5)])
def test_each_of_64_coils_has_a_colour_of_its_own_and_neighbours_differ_most(columns, rows, shift):
    places = np.array([(x + shift * (y % 2), y) for y in range(rows) for x in range(columns)])
    names = [f"coil{k}" for k in range(len(places))]
    colours = list(coil_colours(names, places).values())
    assert len(set(colours)) == len(names)
    assert nearest(colours, "all cones") > 10.0
    near = [(a, b) for a, b in combinations(range(len(names)), 2) if np.linalg.norm(places[a] - places[b]) < 1.2]
    for vision in VISIONS:
        if vision == "all cones" or len(names) <= 16:  # with fewer cones 64 colours cannot be told apart: names can
            seen = lab([to_rgb(colour) for colour in colours], vision)
            assert min(np.linalg.norm(seen[a] - seen[b]) for a, b in near) > TOLD_APART
    assert coil_colours(names[:6], places[:6]) == dict(zip(names, palette.COILS, strict=False))


def test_neighbours_among_curves_differ_in_more_than_colour():
    looks = [curve_look(k) for k in range(18)]
    assert len({(look["color"], look["linestyle"]) for look in looks}) == 18
    for one, other in combinations(looks, 2):
        if one["color"] == other["color"]:
            assert one["linestyle"] != other["linestyle"]
    assert all(a["linestyle"] != b["linestyle"] for a, b in pairwise(looks))


@pytest.mark.parametrize("vision", VISIONS)
def test_the_maps_grow_lighter_to_one_end_or_to_zero_and_tell_signs_apart(vision):
    lightness = of_map(SEQUENTIAL, vision)[:, 0]
    assert (np.diff(lightness) > 0).all()
    assert np.ptp(lightness) > 70  # of 100
    for one_sign in (of_map(palette.POSITIVE, vision)[::-1, 0], of_map(palette.NEGATIVE, vision)[:, 0]):
        assert (np.diff(one_sign) > 0).all()
        assert np.ptp(one_sign) > 65
    below, above = np.split(of_map(DIVERGING, vision), 2)
    assert below[-1, 0] > 95
    assert (np.diff(below[:, 0]) > 0).all()
    assert (np.diff(above[:, 0]) < 0).all()
    apart = np.linalg.norm(below - above[::-1], axis=1)  # of values of one magnitude
    magnitude = np.linspace(1, 0, len(below))
    assert apart[magnitude >= 0.2].min() > TOLD_APART
    # Those that stand in one picture: measured and simulated, before and after, with text and grey.
    assert nearest((palette.BLUE, palette.VERMILLION, palette.GREEN, palette.INK), vision) > TOLD_APART
    assert nearest((palette.VERMILLION, palette.PALE, palette.INK), vision) > TOLD_APART
    assert nearest((palette.BLUE, palette.SKY, palette.INK, palette.GREY), vision) > TOLD_APART


@pytest.mark.parametrize("signed", [False, True])
def test_numbers_in_cells_are_read_on_every_colour(signed):
    """Contrast of WCAG 2.1, 1.4.3: (L1 + 0.05)/(L2 + 0.05) of relative luminances, at least 4.5."""
    count = 12
    values = np.linspace(-1, 1, count**2).reshape(count, count)
    colours = (DIVERGING, Normalize(-1, 1)) if signed else (SEQUENTIAL, Normalize(-1, 1))
    texts = [["8"] * count] * count
    ax = _heat_map(np.ma.array(values), texts, [str(k) for k in range(count)], "", "", colours, None)
    image, worst = ax.images[0], np.inf
    for text in ax.texts:
        x, y = text.get_position()
        cell = image.to_rgba(values)[round(y), round(x), :3]
        luminance = sorted(float(linear(colour) @ TO_XYZ[1]) for colour in (cell, to_rgb(text.get_color())))
        worst = min(worst, (luminance[1] + 0.05) / (luminance[0] + 0.05))
    assert worst > 4.5
