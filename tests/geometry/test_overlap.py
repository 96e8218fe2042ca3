"""Copper in copper: the same verdict as the fabrication rules give, on boards whose overlap is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.boards import FOUR_LAYERS, VIA
from support.refusals import refused

from coilarray import CoilArray, FabRules, Placement, check_rules, inductance_matrix, load_design, path_coil, vary
from coilarray.design.bundled import DESIGNS
from coilarray.errors import GeometryError
from coilarray.geometry.overlap import require_apart

WIDTH = 1e-3
BAR = path_coil([[(0, 0), (10e-3, 0)]], WIDTH, WIDTH, VIA)
HAIRPIN = [(0, 0), (10e-3, 0), (10e-3, 2e-3), (0, 2e-3)]


def board(*placements):
    return CoilArray(FOUR_LAYERS, placements)


def bars(y, *, x=0.0, turn=0.0, layer="L1"):
    return board(Placement("A", BAR, ("L1",), 0, 0), Placement("B", BAR, (layer,), x, y, turn))


def loop(gap):
    """One coil whose second run comes back beside the first one, a gap away."""
    return board(
        Placement(
            "A", path_coil([[(x, np.sign(y) * (WIDTH + gap)) for x, y in HAIRPIN]], WIDTH, WIDTH, VIA), ("L1",), 0, 0
        )
    )


@pytest.mark.parametrize(
    ("array", "text"),
    [
        (bars(0.9e-3), r"copper of A – B overlaps on layer L1 at \(.*\) mm, by 0.1 mm"),
        (bars(0.998e-3), "by 0.002 mm"),
        (bars(0.0), "by 1 mm"),
        (bars(-5e-3, x=5e-3, turn=np.pi / 2), "by 1 mm"),  # across
        (loop(-0.4e-3), r"copper of A overlaps on layer L1 at \(.*\) mm, by 0.4 mm"),
    ],
)
def test_overlapping_traces_are_refused_as_by_the_rules(array, text):
    refused(GeometryError, text, require_apart, array)
    refused(GeometryError, text, inductance_matrix, array)
    assert min(one.value for one in check_rules(array, FabRules())) < 0


@pytest.mark.parametrize(
    "array",
    [
        bars(1e-3),  # they touch
        bars(0.9995e-3),  # less deep than the rules forgive
        bars(0.0, layer="L2"),
        bars(0.0, x=10e-3),  # end to end
        bars(1e-3, x=10e-3, turn=np.pi / 4),  # the bounds overlap
        loop(0.05e-3),  # nearer than the rules allow, but apart
    ],
)
def test_traces_that_are_apart_are_computed(array):
    require_apart(array)
    assert (np.linalg.eigvalsh(inductance_matrix(array)) > 0).all()


def test_a_sharp_corner_is_one_piece_of_copper():
    require_apart(
        board(Placement("A", path_coil([[(0, 0), (10e-3, 0), (2e-3, 7e-3)]], WIDTH, WIDTH, VIA), ("L1",), 0, 0))
    )


@pytest.mark.parametrize("name", DESIGNS.names())
def test_bundled_boards_are_apart(name):
    require_apart(load_design(name).array)


def test_all_coils_on_one_pair_of_layers_overlap():
    design = load_design("starter")
    flat = vary(design, {"array.layers": [["L1", "L2"]], "array.pitch_mm": 10.0}).array
    refused(GeometryError, "copper of coil1 – coil2 overlaps on layer L1", inductance_matrix, flat)
    wide = replace(flat, placements=tuple(replace(one, x=2 * one.x) for one in flat.placements))
    require_apart(wide)
