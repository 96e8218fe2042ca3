"""The study that set the accuracy knobs of the inductance matrix: nodes, and how far the cross-section counts."""

import numpy as np
import pytest
from support.boards import round_spiral
from support.coil_paths import spiral_path
from support.references import polygon

from coilarray import load_design
from coilarray.constants import MU_0
from coilarray.electromagnetics.inductance import rectangular_bars
from coilarray.electromagnetics.kernels.bars import filament_pair
from coilarray.electromagnetics.kernels.paths import RULE_SIZE, bar_pair, mutual_sum, own_mutual_sum
from coilarray.electromagnetics.neumann import MUTUAL_NEAR_WIDTHS, OWN_NEAR_WIDTHS, segment_table
from coilarray.geometry import Conductor, Spiral

# W/G 0.1 mm and 0.15 mm, one and two layers, straight sides and arcs
SPIRALS = {
    "hexagon": Spiral(6, 20e-3, 20, 0.15e-3, 0.15e-3),
    "square": Spiral(4, 20e-3, 10, 0.15e-3, 0.15e-3),
    "circle": round_spiral(9e-3, 6, 0.15e-3, 0.15e-3),
    "tight": Spiral(6, 12e-3, 10, 0.2e-3, 0.05e-3),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", SPIRALS)
@pytest.mark.parametrize("layers", [(0.0,), (0.0, -0.25e-3)], ids=["one layer", "two layers"])
def test_own_nodes_and_near_widths(name, layers):
    table = segment_table(spiral_path(SPIRALS[name], layers))
    n = len(table)
    default = own_mutual_sum(table, 0, n, OWN_NEAR_WIDTHS, 0)
    # more nodes in every rule, and the cross-section everywhere: measured at most 7e-7, worst for the many touching
    # corners of the circle and for the narrow gaps of the tight spiral
    assert default == pytest.approx(own_mutual_sum(table, 0, n, 1e9, 4), rel=1e-6)


def corner_by_brute_force(one, other):
    """∬ dl·dl'/R of two bars in a plane, by nodes across both widths and the offset of the thickness, without cuts."""
    x, weight = np.polynomial.legendre.leggauss(40)
    z, of_z = np.polynomial.legendre.leggauss(6)
    apart, total = other[:3] - one[:3], 0.0
    for s, of_s in zip(one[10] / 2 * x, weight / 2, strict=True):
        for t, of_t in zip(other[10] / 2 * x, weight / 2, strict=True):
            at = apart + t * other[7:10] - s * one[7:10]
            for h, of_h in zip((1 + z) / 2, of_z, strict=True):  # density 1 − h of two layers' offset
                start = at[0], at[1], at[2] + one[11] * h
                pair = filament_pair(tuple(one[3:6]), one[6], start, tuple(other[3:6]), other[6])
                total += of_s * of_t * of_h * (1 - h) * pair
    return total


@pytest.mark.slow
@pytest.mark.parametrize("ratio", [2.9, 8.0, 29.0, 31.0])
@pytest.mark.parametrize("sides", [3, 6, 8])
def test_corners_of_wide_single_turns(sides, ratio):
    """Of single turns, sides of `ratio` widths, corners err by 1e-5 of L at most, also where the rule changes, at 30.

    Measured 8.3e-6 in the octagon of 2.9; brute force errs by 1e-7.
    """
    width = 1e-3
    turn = Conductor(polygon(sides, ratio * width / 2 / np.sin(np.pi / sides)), width, 35e-6)
    table = segment_table(turn)
    L = sides * rectangular_bars((table[0, 6], width, 35e-6)) * 4 * np.pi / MU_0
    L += own_mutual_sum(table, 0, sides, OWN_NEAR_WIDTHS, 0)
    rule = np.empty((RULE_SIZE, 4))
    pair = bar_pair(table[0], table[1], np.zeros(3), OWN_NEAR_WIDTHS, 0, rule)
    assert abs(pair - corner_by_brute_force(table[0], table[1])) * 2 * sides < 1e-5 * L
    assert bar_pair(table[1], table[0], np.zeros(3), OWN_NEAR_WIDTHS, 0, rule) == pytest.approx(pair, rel=1e-5)
    most = bar_pair(table[0], table[1], np.zeros(3), OWN_NEAR_WIDTHS, 16, rule)  # more nodes than there is room for
    assert abs(most - pair) * 2 * sides < 1e-5 * L


@pytest.mark.parametrize("gap", [0.3, 1.0, 3.0])
def test_pair_converges_geometrically(gap):
    # neighbouring turns, the gap in widths, against the exact bars
    width, thickness, length = 0.15e-3, 35e-6, 10e-3
    pitch = (1 + gap) * width
    row = segment_table(Conductor([[0, 0, 0], [length, 0, 0]], width, thickness))[0]
    exact = rectangular_bars((length, width, thickness), (length, width, thickness), (0, pitch, 0)) * 4 * np.pi / MU_0
    shift, rule = np.array([0, pitch, 0]), np.empty((RULE_SIZE, 4))
    errors = [abs(bar_pair(row, row, shift, OWN_NEAR_WIDTHS, extra, rule) / exact - 1) for extra in range(3)]
    # one node more in each rule takes at least nine tenths, down to rounding
    assert errors[0] < 1e-7
    assert errors[1] < errors[0] / 10
    assert errors[2] < max(errors[1] / 5, 1e-12)


@pytest.mark.slow
def test_mutual_nodes_and_near_widths():
    paths = load_design("gast2020").array.conductors()
    tables = [segment_table(path) for path in paths[:3]]
    own = own_mutual_sum(tables[0], 0, len(tables[0]), OWN_NEAR_WIDTHS, 0)
    for b in (1, 2):
        shift = paths[b].vertices[0] - paths[0].vertices[0]
        n = len(tables[0])
        default = mutual_sum(tables[0], tables[b], shift, 0, n, MUTUAL_NEAR_WIDTHS, 0)
        finer = mutual_sum(tables[0], tables[b], shift, 0, n, MUTUAL_NEAR_WIDTHS, 3)
        further = mutual_sum(tables[0], tables[b], shift, 0, n, 400.0, 0)
        # in terms of k, since M is a small difference of large parts: measured 5e-7
        assert abs(finer - default) / own < 1e-6
        assert abs(further - default) / own < 1e-6


@pytest.mark.parametrize("turns", [4, 10])
@pytest.mark.parametrize("shift", [(0, 0, -0.5e-3), (8e-3, 0, -0.5e-3), (10.4e-3, 0, -0.5e-3), (16.3e-3, 0, 0)])
def test_small_coils_on_and_beside_each_other(turns, shift):
    # 107 widths across: with 40 widths for the cross-section 6e-6 were left out of coils on each other
    table = segment_table(spiral_path(Spiral(6, 16e-3, turns, 0.15e-3, 0.15e-3)))
    n = len(table)
    own = own_mutual_sum(table, 0, n, OWN_NEAR_WIDTHS, 0)
    default = mutual_sum(table, table, np.array(shift), 0, n, MUTUAL_NEAR_WIDTHS, 0)
    # measured at most 3e-7
    assert abs(default - mutual_sum(table, table, np.array(shift), 0, n, 1e9, 4)) / own < 1e-6
