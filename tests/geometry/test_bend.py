"""Bent boards: lengths are kept, and a bent coil is the coil sampled densely on the bent surface."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from coilarray import Array, Spiral, inductance_matrix, mutual_inductance
from coilarray.errors import GeometryError
from coilarray.geometry import Conductor
from coilarray.geometry.bend import Bend, Zone

BENDS = {
    "cylinder": Bend((Zone(8e-3),), axis=0.4),
    "upwards": Bend((Zone(-20e-3, at=3e-3),), neutral=-0.1e-3),
    "zones": Bend((Zone(5e-3, at=-6e-3, width=4e-3), Zone(-4e-3, at=5e-3, width=6e-3)), axis=1.2),
    "cone": Bend((Zone(15e-3),), axis=-0.7, apex=60e-3),
    "cone upwards": Bend((Zone(-15e-3),), apex=-60e-3),
}


@pytest.mark.parametrize("bend", BENDS.values(), ids=BENDS)
def test_the_neutral_plane_keeps_its_lengths(bend):
    rng = np.random.default_rng(1)
    points = np.column_stack((rng.uniform(-12e-3, 12e-3, (400, 2)), np.full(400, bend.neutral)))
    steps = np.column_stack((rng.normal(size=(400, 2)), np.zeros(400)))
    steps *= 1e-7 / np.linalg.norm(steps, axis=1, keepdims=True)
    moved = bend.surface(points + steps / 2) - bend.surface(points - steps / 2)
    # central differences: the cube of step over radius, and rounding of 1e-18 m
    np.testing.assert_allclose(np.linalg.norm(moved, axis=1), 1e-7, rtol=1e-8)
    np.testing.assert_allclose(bend.turned(points, steps), moved, atol=1e-13)


@pytest.mark.parametrize("bend", BENDS.values(), ids=BENDS)
def test_heights_are_along_the_normal(bend):
    points = np.random.default_rng(2).uniform(-10e-3, 10e-3, (50, 3)) * (1, 1, 0.01)
    up = bend.turned(points, np.tile((0.0, 0.0, 1.0), (50, 1)))
    np.testing.assert_allclose(
        bend.surface(points + np.array([0, 0, 1e-4])) - bend.surface(points), 1e-4 * up, atol=1e-15
    )
    on_plane = np.tile((1.0, 0.0, 0.0), (50, 1))
    assert np.abs((bend.turned(points, on_plane) * up).sum(axis=1)).max() < 1e-12


@pytest.mark.parametrize("bend", BENDS.values(), ids=BENDS)
def test_the_origin_stays(bend):
    zone = any(abs(zone.at) < zone.width / 2 for zone in bend.zones)
    place = bend.surface([[0.0, 0.0, bend.neutral]])[0]
    np.testing.assert_allclose(place, (0, 0, bend.neutral), atol=1e-15)
    assert zone or np.allclose(bend.surface([[1e-3, 0, 0.0]]), [[1e-3, 0, 0]])


def test_a_quarter_and_a_whole_turn():
    bend = Bend((Zone(2e-3),))
    quarter = bend.surface([[1e-3, math.pi * 1e-3, 0.0], [0, 2 * math.pi * 2e-3, 0], [0, 0, 0.5e-3]])
    np.testing.assert_allclose(quarter, [[1e-3, 2e-3, -2e-3], [0, 0, 0], [0, 0, 0.5e-3]], atol=1e-15)


@pytest.mark.slow
@settings(max_examples=10, deadline=None)
@given(st.floats(4e-3, 1.0), st.floats(0, 3), st.booleans())
def test_a_bent_coil_is_sampled_finely_enough(radius, axis, up):
    """Chords are right to 1e-4 of L, against chords a sixth as long."""
    coil = Array.row(Spiral(6, 12e-3, 4, 0.3e-3, 0.3e-3), 1).conductors()[0]
    bend = Bend((Zone(-radius if up else radius),), axis)
    path = bend.bent(coil)
    pieces = 6
    fine = np.concatenate([
        start + np.arange(pieces)[:, None] / pieces * (stop - start)
        for start, stop in zip(coil.vertices, coil.vertices[1:], strict=False)
    ] + [coil.vertices[-1:]])  # fmt: skip
    dense = type(coil)(fine, *(np.repeat(size, pieces) for size in (coil.widths, coil.thicknesses, coil.areas)))
    other = [[x, y, 6e-3] for x, y in ((-9e-3, -5e-3), (8e-3, -6e-3), (2e-3, 9e-3), (-9e-3, -5e-3))]
    found, expected = (mutual_inductance([bend.bent(one)], [other])[0, 0] for one in (coil, dense))
    size = math.sqrt(inductance_matrix(path, allow_overlaps=True)[0, 0] * 30e-9)
    assert abs(found - expected) < 1e-4 * size
    assert path.lengths.sum() == pytest.approx(coil.lengths.sum(), rel=0.1)


def test_a_slight_bend_changes_little():
    coils = Array.row(Spiral(6, 12e-3, 6, 0.3e-3, 0.3e-3), 2, 13e-3).conductors()
    flat = inductance_matrix(coils)
    middle = float(np.unique(coils[0].vertices[:, 2]).mean())  # lengths above and below it change by height over radius
    bend = Bend((Zone(10.0),), neutral=middle)
    bent = inductance_matrix([bend.bent(coil) for coil in coils], allow_overlaps=True)
    np.testing.assert_allclose(bent, flat, atol=1e-6 * flat[0, 0])  # (size/radius)² is 1e-6


@pytest.mark.parametrize(("make", "named"), [
    (lambda: Zone(0.0), "radius"), (lambda: Zone(1e-3, width=-1.0), "width"), (lambda: Zone(math.nan), "nan"),
    (lambda: Bend(()), "one zone"), (lambda: Bend((Zone(1e-3), Zone(2e-3, 1e-3, 1e-3))), "overlap"),
    (lambda: Bend((Zone(1e-3, width=1e-3),), apex=1e-2), "cone"),
])  # fmt: skip
def test_impossible_bends_are_refused(make, named):
    with pytest.raises(GeometryError, match=named):
        make()


def test_a_trace_along_the_axis_of_a_cone_follows_its_surface():
    path = Conductor([[-20e-3, 20e-3, 0], [20e-3, 20e-3, 0]], 1e-4, 35e-6)
    bent = Bend((Zone(10e-3),), apex=30e-3).bent(path)
    assert bent.lengths.sum() == pytest.approx(40e-3, rel=1e-4)  # chords: 1/24 of the square of 0.03 rad


@pytest.mark.parametrize(("bend", "named"), [
    (Bend((Zone(-1e-3),), neutral=-2e-3), "larger than the heights"), (Bend((Zone(0.999e-3),), neutral=1e-3), "larger"),
    (Bend((Zone(10e-3),), apex=5e-3), "apex"), (Bend((Zone(1e-12),)), "chords"),
])  # fmt: skip
def test_boards_that_cannot_be_bent_so_are_refused(bend, named):
    with pytest.raises(GeometryError, match=named):
        bend.bent(Conductor([[10e-3, -4e-3, 0], [10e-3, 4e-3, 0]], 1e-4, 35e-6))


def test_only_a_current_path_is_bent():
    with pytest.raises(GeometryError, match="path must be a Conductor"):
        Bend((Zone(8e-3),)).bent(Spiral(6, 12e-3, 4, 0.3e-3, 0.3e-3))
