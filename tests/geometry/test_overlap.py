"""Copper in copper: the same verdict as the fabrication rules give, on known and on random boards, and bare paths."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.boards import FOUR_LAYERS, VIA
from support.refusals import refused

from coilarray import (
    Array,
    Conductor,
    FabRules,
    Lattice,
    Placement,
    Spiral,
    check_rules,
    inductance_matrix,
    lattice_array,
    mutual_inductance,
    path_coil,
)
from coilarray.errors import GeometryError
from coilarray.geometry.rules import KEPT_WITHIN, require_apart

WIDTH = 1e-3
BAR = path_coil([[(0, 0), (10e-3, 0)]], WIDTH, WIDTH, VIA)
HAIRPIN = [(0, 0), (10e-3, 0), (10e-3, 2e-3), (0, 2e-3)]


def apart(array):
    require_apart(array.conductors(), array.stackup)


def board(*placements):
    return Array(FOUR_LAYERS, placements)


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
    refused(GeometryError, text, apart, array)
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
    apart(array)
    assert (np.linalg.eigvalsh(inductance_matrix(array)) > 0).all()


def test_random_boards_have_the_verdict_of_the_rules():
    """Two paths of two straight runs each, on 10 mm; half of the boards have an overlap of some kind."""
    random, refusals = np.random.default_rng(23), 0
    for _ in range(60):
        width = 10.0 ** random.uniform(-4.5, -3)
        coils = [path_coil([random.uniform(-5e-3, 5e-3, (3, 2))], width, width, VIA) for _ in "AB"]
        array = board(*(Placement(name, coil, ("L1",), 0, 0) for name, coil in zip("AB", coils, strict=True)))
        worst = min(one.value for one in check_rules(array, FabRules()) if one.rule != "edge clearance")
        try:
            apart(array)
        except GeometryError:
            refusals += 1
            assert worst <= -KEPT_WITHIN
        else:
            assert worst > -KEPT_WITHIN
    assert 15 < refusals < 45


def bare(*lines, width=WIDTH, thickness=35e-6, z=0.0):
    """Bare paths in one plane, by x and y in mm."""
    return [
        Conductor([(1e-3 * x, 1e-3 * y, z) for x, y in line], width, thickness, name=name)
        for name, line in zip("AB", lines, strict=False)
    ]


SQUARE = [(0, 0), (10, 0), (10, 10), (0, 10)]
SPIRAL = Spiral(6, 16e-3, 12, 0.15e-3, 0.15e-3, leads=None).coil()


@pytest.mark.parametrize(
    ("paths", "text"),
    [
        (bare([(0, 0), (10, 0)], [(5, -5), (5, 5)]), r"copper of A – B overlaps on z 0 mm at \(5, .*\) mm, by 1 mm"),
        (bare([(0, 0), (10, 0)], [(0, 0), (10, 0)]), "copper of A – B .* by 1 mm"),
        (bare([(0, 0), (10, 0), (10, 0.6), (0, 0.6)]), "copper of A .* by 0.4 mm"),  # its ends meet
        (bare([(0, 0), (10, 10), (10, 0), (0, 10), (0, 0)]), "copper of A .* by 1 mm"),  # closed, and crosses itself
        (bare([(0, 0), (10, 0)]) + bare([(5, -5), (5, 5)], z=30e-6), "copper of A – A .* by 1 mm"),  # of 35 µm
    ],
)
def test_bare_paths_in_each_other_are_refused(paths, text):
    refused(GeometryError, text, inductance_matrix, paths)
    L = inductance_matrix(paths, allow_overlaps=True)
    assert L.shape == (len(paths), len(paths))
    if len(paths) == 2:
        assert L[0, 1] == mutual_inductance(paths[0], paths[1])[0, 0]


@pytest.mark.parametrize(
    "paths",
    [
        bare([*SQUARE, (0, 0)]),
        bare([*SQUARE, (0, 0.3)]),  # the end of a turn beside its beginning
        bare([(0, 5), *SQUARE, (0, 5)]),
        bare(5 * np.array([(np.cos(t), np.sin(t)) for t in np.linspace(0, 2 * np.pi, 97)])),
        bare([(0, 0), (10, 0)]) + bare([(5, -5), (5, 5)], z=35e-6),  # they lie on each other
        [Conductor([(0, 0, 0), (0, 0, 1e-2)], 1e-3, 1e-3), Conductor([(0, 0, 0), (1e-2, 0, 0)], 1e-3, 1e-3)],
    ],
)
def test_bare_paths_that_are_apart_or_closed_are_computed(paths):
    assert (np.linalg.eigvalsh(inductance_matrix(paths)) > 0).all()


def test_spirals_in_each_other_are_refused_by_name():
    """Half a pitch aside, turns that are parallel to the shift lie in the gaps, and the others in each other."""
    places = [Placement(name, SPIRAL, ("L1", "L2"), x, 0) for name, x in (("A", 0.0), ("B", 0.15e-3))]
    refused(GeometryError, "copper of A – B overlaps on layer L1", inductance_matrix, board(*places))
    refused(GeometryError, "copper of A – B overlaps on z -0.0175 mm", inductance_matrix, board(*places).conductors())
    turned = [Placement(name, SPIRAL, ("L1", "L2"), x, 0, x) for name, x in (("A", 0.0), ("B", 0.15e-3))]
    refused(GeometryError, "copper of A – B overlaps", inductance_matrix, board(*turned).conductors())


@pytest.mark.parametrize("kind", ["linear", "square", "hexagonal"])
def test_lattices_that_overlap_on_other_layers_are_apart(kind):
    layers = (("L1", "L2"), ("L3", "L4")) if kind != "hexagonal" else (("L1",), ("L2",), ("L3",))
    coil = SPIRAL if kind != "hexagonal" else Spiral(6, 16e-3, 12, 0.15e-3, 0.15e-3, layers=1, leads=None).coil()
    lattice = Lattice(kind, 12e-3, 3, 1 if kind == "linear" else 3, layers)
    array = lattice_array(FOUR_LAYERS, coil, lattice)
    apart(array)
    flat = replace(array, placements=tuple(replace(one, layers=layers[0]) for one in array.placements))
    refused(GeometryError, "copper of .* overlaps on layer L1", apart, flat)
