"""What shapes answer about themselves: the numbers of the functions that compute them."""

from dataclasses import replace

import numpy as np
import pytest
from support.boards import LEADS, SMALL, VIA
from support.refusals import refused

import coilarray as ca
from coilarray.constants import RESISTIVITY_COPPER

SPIRAL = ca.Spiral(sides=6, diameter=16e-3, turns=12, width=0.15e-3, gap=0.15e-3)
ROW = ca.Array.row(SPIRAL, 3, pitch=11e-3)
POINTS = np.array([[0.0, 0.0, 1e-3], [3e-3, -2e-3, 2e-3]])


def test_a_spiral_and_its_coil_answer_alike():
    (path,) = ROW.conductors()[:1]
    for one in (SPIRAL, SPIRAL.coil(), ca.RoundedSpiral(16e-3, 16e-3, 12, 0.15e-3, 0.15e-3, sides=6)):
        assert one.inductance == float(ca.self_inductance(one)[0]) == float(ca.self_inductance(one.conductors())[0])
        assert one.resistance == float(ca.dc_resistance(one)[0])
        np.testing.assert_array_equal(one.field(POINTS, 2.0), ca.magnetic_field(one, POINTS, 2.0))
    assert SPIRAL.inductance == SPIRAL.coil().inductance
    # ρ Σ l / A of the bars
    assert SPIRAL.resistance == pytest.approx(RESISTIVITY_COPPER * (path.lengths / path.areas).sum(), rel=1e-12)


def test_an_array_answers_as_the_functions():
    L = ca.inductance_matrix(ROW.conductors())
    np.testing.assert_array_equal(ROW.inductance, L)
    np.testing.assert_array_equal(ROW.coupling, ca.coupling_matrix(L))
    np.testing.assert_array_equal(ROW.resistance, ca.dc_resistance(ROW))
    np.testing.assert_array_equal(ROW.field(POINTS, [1, 0, -2]), ca.magnetic_field(ROW, POINTS, [1, 0, -2]))
    assert ROW.coupling.dims == ("coil", "other")
    assert float(ROW.coupling.sel(coil="coil1", other="coil3")) == ROW.coupling[0, 2]
    # every coil of the row is the coil alone, to rounding of the place
    np.testing.assert_allclose(np.diag(ROW.inductance), SPIRAL.inductance, rtol=1e-9)


def test_every_kind_of_source():
    design = ca.Design(ROW)
    for source in (ROW, design, list(ROW.conductors()), [ROW]):
        np.testing.assert_array_equal(ca.inductance_matrix(source), ROW.inductance)
    np.testing.assert_array_equal(ca.couple_design(ROW).inductance, ca.couple_design(design).inductance)
    np.testing.assert_array_equal(ca.inductance_matrix([SPIRAL]), [[SPIRAL.inductance]])
    for nothing in (5, None, "gast2020", [None], [], [SPIRAL, 5]):
        refused(ca.errors.GeometryError, "path", ca.self_inductance, nothing)


def test_coils_that_overlap_have_layers_of_their_own():
    assert [place.layers for place in ROW.placements] == [("L1", "L2"), ("L3", "L4"), ("L1", "L2")]
    assert ROW.stackup.thickness == pytest.approx(1.6e-3)
    assert all(margin.margin >= 0 for margin in ca.check_rules(ROW, ca.FabRules()) if margin.rule == "clearance")
    side_by_side = ca.Array.row(SPIRAL, 3, pitch=16.2e-3)  # more than the gap apart
    assert side_by_side.stackup.names == ("L1", "L2")
    assert len(ca.Array.row(SPIRAL, 5, pitch=5e-3).stackup.names) == 8
    assert len(ca.Array.row(replace(SPIRAL, layers=4), 2, pitch=11e-3).stackup.names) == 8
    two = ca.Stackup.uniform(("top", "bottom"))
    assert ca.Array.row(replace(SPIRAL, stackup=two), 2, pitch=20e-3).stackup == two
    message = "need 4 copper layers, as 2 neighbours overlap; .* has 2"
    refused(ca.errors.GeometryError, message, ca.Array.row, SPIRAL, 2, 11e-3, stackup=two)
    refused(ca.errors.GeometryError, "pitch must be positive", ca.Array.row, SPIRAL, 2, 0.0)


def test_the_usual_construction():
    assert (SPIRAL.via, SPIRAL.leads) == (VIA, LEADS)
    assert SPIRAL.first_corner == pytest.approx(np.pi / 2)
    for sides in range(3, 13):  # a side faces the neighbour of a row
        outline = ca.Spiral(sides, 16e-3, 2, 0.15e-3, 0.15e-3).outline()
        assert np.sort(outline[:, 0])[-2:] == pytest.approx(8e-3, rel=1e-12)
    assert ca.Placement("A", SPIRAL, ("L1", "L2"), 0, 0).coil is SPIRAL.coil()


@pytest.mark.parametrize("value", [SMALL, ROW.placements[0], ROW, SPIRAL, ca.design_circuit(ca.Design(ROW))])
def test_values_print_on_one_short_line(value):
    assert len(repr(value)) < 200
    assert "\n" not in repr(value)
