"""Screening: how far the sums over a few turns are from those over all."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.boards import round_spiral

from coilarray import Conductor, coupling_matrix, inductance_matrix, load_design, mutual_inductance
from coilarray.circuit.coupling import design_inductance
from coilarray.electromagnetics.flat_layer import layer_inductance
from coilarray.electromagnetics.kernels.turns import find_series, series_members, series_rules
from coilarray.electromagnetics.neumann import segment_table
from coilarray.geometry import PlatedHole, Spiral, Stackup
from coilarray.geometry.array import Array, Placement

VIA = PlatedHole(0.2e-3, 0.45e-3)
BOARD = Stackup(("L1", "L2", "L3", "L4"), (35e-6,) * 4, (0.2e-3,) * 3, (4.5,) * 3)


def overlapping(sides, turns, apart, angle=0.0, rotation=0.0):
    """Two equal spirals on different layers."""
    turns = (turns, 0.12e-3, 0.12e-3)
    coil = replace(round_spiral(10e-3, *turns) if sides > 8 else Spiral(sides, 20e-3, *turns), leads=None).coil()
    shift = apart * np.array([np.cos(angle), np.sin(angle)])
    upper, lower = (0.0, 0.0), (*shift.tolist(), rotation)
    places = Placement("A", coil, ("L1", "L2"), *upper), Placement("B", coil, ("L3", "L4"), *lower)
    return Array(BOARD, places).conductors()


@pytest.mark.slow
@pytest.mark.parametrize("name", ["gast2020", "starter", "gast_fem"])
def test_bundled_designs(name):
    """The figures that `coilarray.electromagnetics.inductance.Accuracy` states."""
    design = load_design(name)
    full, _ = design_inductance(design)
    screened, _ = design_inductance(design, accuracy="screen")
    np.testing.assert_allclose(np.diag(screened), np.diag(full), rtol=1e-4)
    assert abs(coupling_matrix(screened) - coupling_matrix(full)).max() < 5e-5
    np.testing.assert_array_equal(screened, screened.T)


@pytest.mark.slow
@settings(max_examples=8)
@given(
    st.sampled_from([3, 4, 6, 24]), st.integers(6, 12), st.floats(0, 30e-3), st.floats(0, 3.2), st.floats(0, 3.2)
)  # fmt: skip
def test_any_overlap(sides, turns, apart, angle, rotation):
    paths = overlapping(sides, turns, apart, angle, rotation)
    full, screened = inductance_matrix(paths), inductance_matrix(paths, accuracy="screen")
    np.testing.assert_allclose(np.diag(screened), np.diag(full), rtol=1e-4)
    # ends that pass close over a trace are a kink that few turns may miss: in 260 drawn pairs at most 4.4e-4 where
    # |k| < 0.15, and 0.8 % of k where they lie on each other
    k = coupling_matrix(full)[0, 1]
    assert abs(coupling_matrix(screened)[0, 1] - k) < 1e-3 + 0.02 * abs(k)


def test_far_windings_are_those_of_all_turns():
    full, screened = (inductance_matrix(overlapping(6, 25, 40e-3), accuracy=way) for way in ("full", "screen"))
    # the cross-section is worth (0.12 mm / 20 mm)²/12 = 3e-6 there, the five turns' rule less
    assert screened[0, 1] == pytest.approx(full[0, 1], rel=1e-5)


def test_sheet_part():
    design = load_design("gast2020")
    full = layer_inductance(design.array, design.sheets)
    assert abs(layer_inductance(design.array, design.sheets, accuracy="screen") - full).max() < 1e-3 * full.max()


def test_without_turns_every_segment_counts():
    """A single turn has no series: what remains is the shorter reach of the cross-sections."""
    square = Conductor([[0, 0, 0], [2e-2, 0, 0], [2e-2, 2e-2, 0], [0, 2e-2, 0], [0, 1e-4, 0]], 0.1e-3, 35e-6)
    moved = Conductor(square.vertices + np.array([5e-3, 3e-3, 1e-3]), 0.1e-3, 35e-6)
    full, screened = (inductance_matrix([square, moved], accuracy=way) for way in ("full", "screen"))
    np.testing.assert_allclose(screened, full, rtol=1e-4)
    thin = [[[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 0, 0]]], [[[0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 0, 1]]]
    np.testing.assert_allclose(mutual_inductance(*thin, accuracy="screen"), mutual_inductance(*thin), rtol=1e-12)


def test_series_cover_every_segment_once():
    for conductor in load_design("gast2020").array.conductors()[:2]:
        table = segment_table(conductor)
        series = find_series(table)
        rows = np.concatenate([first + step * np.arange(n) for first, step, n in series])
        np.testing.assert_array_equal(np.sort(rows), np.arange(len(table)))
        # 30 turns of six sides on two layers, and what leads to them
        assert (series[:, 2] == 30).sum() == 12
        segments, weights = series_members(series, *series_rules(30))
        assert weights.sum() == pytest.approx(len(table), rel=1e-12)
        # lengths step evenly but for the tilt of the turns
        assert (weights * conductor.lengths[segments]).sum() == pytest.approx(conductor.lengths.sum(), rel=1e-8)


@pytest.mark.parametrize("n", [1, 2, 5, 6, 7, 12, 30, 101])
def test_rules_are_exact_for_polynomials(n):
    members, weights, check, counts = (table[n] for table in series_rules(101))
    at = np.arange(n) / max(n - 1, 1)
    for rule, degree in ((weights, 4), (check, 3)):
        for power in range(degree + 1):
            found = (rule[:counts] * at[members[:counts]] ** power).sum()
            assert found == pytest.approx((at**power).sum(), rel=1e-10)
    assert len(set(members[:counts].tolist())) == counts
