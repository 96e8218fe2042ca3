"""Inductance of windings of arcs and of rectangles.

Who checks whom: rings by Maxwell's formula, Grover's rectangle and two-dimensional wires against coils of
`RoundedSpiral`; the pieces that stand for arcs against four times as many.
"""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.special import ellipe, ellipk
from support.boards import many_layers, one_coil, round_spiral

from coilarray import inductance_matrix
from coilarray.constants import MU_0
from coilarray.geometry import Placement, RoundedSpiral
from coilarray.geometry.array import Array

W, T = 0.2e-3, 35e-6
# ln of the geometric mean distance of the section of a trace from itself (Grover 1946, ch. 3)
LOG_GMD = math.log(0.22313 * (W + T))


def inductance(spiral, layers=1, **options):
    """Self-inductance of a bare coil in H."""
    return float(
        inductance_matrix(one_coil(replace(spiral, layers=layers, leads=None).coil()).conductors(**options))[0, 0]
    )


def rings(a, b):
    """Mutual inductance in H of rings in one plane with radii a and b (Maxwell)."""
    m = 4 * a * b / (a + b) ** 2
    k = np.sqrt(m)
    return MU_0 * np.sqrt(a * b) * ((2 / k - k) * ellipk(m) - 2 / k * ellipe(m))


def test_a_circle_is_the_sum_of_its_turns():
    turns, pitch = 10, 0.4e-3
    spiral = round_spiral(10e-3, turns, W, pitch - W)
    # the mean radius of a turn, see test_spiral.py
    r = 10e-3 - W / 2 - pitch * (np.arange(turns) + 0.5) + pitch * (1 / 4 - math.pi / 16) * 4 / (2 * math.pi)
    nodes, weights = np.polynomial.legendre.leggauss(4)
    x, y = (r + W / 2 * nodes[:, None])[:, None, :, None], (r + W / 2 * nodes[:, None])[None, :, None, :]
    # the diagonal, with a self-term that has no value here, is left out of the sum
    M = np.einsum("ijab,i,j->ab", rings(x, np.where(x == y, 2 * y, y)), weights / 2, weights / 2)
    own = MU_0 * r * (np.log(8 * r) - LOG_GMD - 2)
    expected = M.sum() - np.trace(M) + own.sum()
    assert inductance(spiral) == pytest.approx(expected, rel=2e-3)


@pytest.mark.parametrize("rule", ["parallel", "corner"])
def test_a_rectangle_of_one_turn_is_grovers(rule):
    a, b = 100e-3, 60e-3
    # centre lines of the sides, of a side that is in two halves on the mean of both
    spiral = RoundedSpiral(a + W + W, b + W + W, 1, W, W / 3, winding_rule=rule)
    inset = W / 2 + (4 / 3) * W * np.array([0, 1, 2, 3, 4]) / 4 * (rule == "corner")
    p = spiral.extent - (inset[0] + inset[4]) / 2 - inset[2], spiral.breadth - inset[1] - inset[3]
    d = math.hypot(*p)
    # Grover 1946, eq. 58, with the section's mean distance for the wire's
    logs = sum(side * (math.log(2 * side) - LOG_GMD) for side in p)
    angles = sum(side * math.asinh(side / other) for side, other in (p, p[::-1]))
    expected = MU_0 / math.pi * (logs + 2 * d - angles - 2 * sum(p))
    # measured −1.1e-3 and −3.4e-4: the turn is open where it ends a pitch further in, or before its last corner
    assert inductance(spiral) == pytest.approx(expected, rel=5e-4 if rule == "corner" else 1.2e-3)


@pytest.mark.parametrize(("rule", "further_in"), [("parallel", 0.0), ("corner", 0.5)])
def test_a_racetrack_grows_by_a_pair_of_wires_and_ends_as_a_circle(rule, further_in):
    turns, gap, more = 3, 0.2e-3, {"corner_radius": 5e-3, "winding_rule": rule}
    short, long = (inductance(RoundedSpiral(length, 10e-3, turns, W, gap, **more)) for length in (200e-3, 300e-3))
    y = 5e-3 - W / 2 - (W + gap) * (np.arange(turns) + further_in)
    apart = np.abs(y[:, None] - y)
    nodes, weights = np.polynomial.legendre.leggauss(8)
    shift = W / 2 * (nodes[:, None] - nodes)
    logs = np.einsum("abij,i,j->ab", np.log(np.abs(apart[..., None, None] + shift + 1e-30)), weights / 2, weights / 2)
    np.fill_diagonal(logs, LOG_GMD)
    back = np.log(y[:, None] + y)
    per_length = MU_0 / math.pi * (back - logs).sum()
    # measured −2.5e-4, of the sides that lie half a pitch further in on the way back
    assert (long - short) / 100e-3 == pytest.approx(per_length, rel=4e-4)
    if rule == "corner":  # which is that of circles
        circle = inductance(round_spiral(5e-3, turns, W, gap))
        assert inductance(RoundedSpiral(10.001e-3, 10e-3, turns, W, gap, **more)) == pytest.approx(circle, rel=3e-4)


ARCS = {
    "circle": round_spiral(10e-3, 10, W, W),
    "wide": round_spiral(15e-3, 2, 0.5e-3, W),
    "racetrack": RoundedSpiral(40e-3, 12e-3, 5, W, W, 6e-3),
    "rounded": RoundedSpiral(20e-3, 12e-3, 10, W, W, 2e-3),
    "hexagon": RoundedSpiral(20e-3, 20e-3, 5, W, W, 5e-3, 6),
}


@pytest.mark.slow
@pytest.mark.parametrize("spiral", ARCS.values(), ids=ARCS)
def test_pieces_of_arcs(spiral):
    """The study behind `coilarray.geometry.coil.CHORD`."""
    coarse, default, fine = (inductance(spiral, chord=chord) for chord in (4e-3, 1e-3, 1.25e-4))
    # measured: 8e-6 for the circle, 1.1e-5 for the rounded rectangle, 7e-5 for the wide trace, 1e-4 for the hexagon
    assert default == pytest.approx(fine, rel=1.1e-4)
    assert abs(default - fine) < abs(coarse - fine)


def test_a_turned_board_has_the_same_inductances():
    upper, lower = (replace(ARCS[name], leads=None).coil() for name in ("rounded", "hexagon"))

    def board(turn):
        c, s = math.cos(turn), math.sin(turn)
        places = (
            Placement("A", upper, ("L1", "L2"), 0.0, 0.0, turn),
            Placement("B", lower, ("L3", "L4"), 8e-3 * c, 8e-3 * s, turn),
        )
        return inductance_matrix(Array(many_layers(4), places))

    np.testing.assert_allclose(board(0.7), board(0.0), rtol=1e-7)  # of far pairs; measured
