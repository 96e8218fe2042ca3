"""The turns of a path without its leads, the poles it winds about, and cuts across the turns."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.boards import round_spiral, square_turns

from coilarray.geometry import Spiral
from coilarray.geometry.winding import FlatPath, find_turns, turns_about


def path_of(*lines, width=0.2):
    """A path of lines, a via between them; lengths in any unit."""
    arrays = [np.array(line, dtype=np.float64) for line in lines]
    return FlatPath.of_lines(arrays, [np.full(len(line) - 1, width) for line in arrays])


@pytest.mark.parametrize("gone", [-2.0, 2.0, 5.0, 8.0, 12.0, 16.0, 20.0, 200.0])
def test_leads_are_no_turns_however_far_they_go(gone):
    turns = square_turns(8, 5.0, 0.5)
    end = turns[-1]
    bare = find_turns(path_of(turns, [end, (end[0], end[1] - 0.3)]))
    led = find_turns(path_of([(gone, -7), (-5, -7), *turns], [end, (end[0], -6), (gone, -6)]))
    before = gone + 5 + 2  # along the lead
    assert (led.begin - before, led.end - before) == pytest.approx((bare.begin, bare.end), abs=1e-9)  # rounding
    for one, other in zip(led.poles, bare.poles, strict=True):
        assert (one.x, one.y, one.turns) == pytest.approx((other.x, other.y, other.turns), abs=1e-9)
    assert led.pitch == pytest.approx(0.5, rel=0.02)  # some neighbours of the leads are counted


def test_a_lead_through_the_centre_is_none_of_the_turns():
    turns = square_turns(3, 8.0, 1.0)
    inner = turns[-1]
    for x in (0.0, 0.4):
        found = find_turns(path_of([*turns, (inner[0], 0.5), (x, 0.5)], [(x, 0.5), (x, -12.0)]))
        # up to where the innermost side ends beside the next one
        assert found.end == pytest.approx(find_turns(path_of([*turns, (inner[0], 0.5)])).end, abs=1e-9)
        (pole,) = found.poles
        assert round(pole.turns) == 3


@pytest.mark.parametrize("way", [-9.0, -5.0])  # far away, and two pitches from the outermost turns
@pytest.mark.parametrize("senses", [(1, 1), (1, -1), (-1, -1)])
def test_two_poles_with_their_own_turns(senses, way):
    first, second = (square_turns(5, 4.0, 0.5, at, sense) for at, sense in zip((-6.0, 6.0), senses, strict=True))
    path = path_of([*first[::-1], (-6.0, way), (6.0, way), *second])
    found = find_turns(path)
    assert len(found.poles) == 2
    left, right = sorted(found.poles, key=lambda pole: pole.x)
    assert (left.x, right.x) == pytest.approx((-6.0, 6.0), abs=0.5)  # half a pitch and the straight line that closes it
    for pole, sense in ((left, -senses[0]), (right, senses[1])):
        # a ray in 180 at each end; the innermost side has no neighbour where it begins
        assert found.own_turns(pole) == pytest.approx(5 * sense, abs=0.1)
        # the way to the other pole adds or takes up to half a turn
        assert turns_about(path.points, (pole.x, pole.y)) == pytest.approx(5 * sense, abs=0.6)


def test_cut_of_a_spiral():
    coil = Spiral(6, 20e-3, 8, 0.15e-3, 0.15e-3).coil()
    found = find_turns(FlatPath.of_lines(coil.lines, coil.widths))
    assert found.pitch == pytest.approx(0.3e-3, rel=1e-3)
    for cut in found.cuts(5):
        line = found.path.line[cut.piece]
        assert [int((line == k).sum()) for k in (0, 1)] == pytest.approx([8, 8], abs=1)
        assert len(set(cut.sign)) == 1
        for k in (0, 1):
            # the sides of a spiral are not quite at right angles to any ray
            np.testing.assert_allclose(np.diff(cut.across[line == k]), 0.3e-3, rtol=1e-2)


def test_every_turn_of_a_round_winding_is_cut_once():
    coil = round_spiral(10e-3, 6, 0.5e-3, 0.2e-3).coil()
    cuts = find_turns(FlatPath.of_lines(coil.lines, coil.widths)).cuts(8)
    assert len(cuts) == 8
    assert {len(cut.piece) for cut in cuts} == {12}


@settings(max_examples=20, deadline=None)
@given(
    angle=st.one_of(st.floats(0, 6.3), st.sampled_from(np.radians([30, 45, 60, 90, 120, 270]).tolist())),
    mirrored=st.booleans(),
    shift=st.tuples(st.floats(-50, 50), st.floats(-50, 50)),
    sides=st.sampled_from([3, 4, 6, 8]),
)  # fmt: skip
def test_turned_and_mirrored_paths_are_cut_alike(angle, mirrored, shift, sides):
    coil = Spiral(sides, 20e-3, 6, 0.3e-3, 0.2e-3, layers=1, leads=None).coil()
    line = 1e3 * coil.lines[0]
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    flip = np.array([1.0, -1.0 if mirrored else 1.0])
    as_it_is, moved = (find_turns(path_of(points, width=0.3)) for points in (line, line * flip @ turn + shift))
    for one, other in zip(moved.cuts(6), as_it_is.cuts(6), strict=True):
        np.testing.assert_array_equal(one.piece, other.piece)
        np.testing.assert_allclose(one.across, other.across, rtol=1e-8)  # poles are found on a grid of 1e-9 of the size
        np.testing.assert_array_equal(one.sign, -other.sign if mirrored else other.sign)


@pytest.mark.parametrize("lines", [
    [[(0, 0), (1, 0)]], [[(0, 0), (10, 0)], [(10, 0), (0, 0)]],
    [[(6 * np.cos(a), 6 * np.sin(a)) for a in np.radians(np.linspace(10, 350, 60))]],
], ids=["straight", "there and back", "single loop"])  # fmt: skip
def test_paths_without_turns_beside_each_other(lines):
    assert find_turns(path_of(*lines)) is None
