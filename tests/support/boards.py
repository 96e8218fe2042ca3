"""Boards that several tests of the geometry share."""

from __future__ import annotations

import math

from coilarray.geometry import (
    Coil,
    CoilArray,
    Leads,
    Placement,
    PlatedHole,
    Sheet,
    Spiral,
    Stackup,
    apothem_from_size,
    lattice,
    spiral_coil,
)

VIA = PlatedHole(0.2e-3, 0.45e-3)
LEADS = Leads(2e-3, 1.5e-3, PlatedHole(0.5e-3, 1e-3))
FOUR_LAYERS = Stackup(("L1", "L2", "L3", "L4"), (35e-6,) * 4, (0.215e-3,) * 3, (4.5,) * 3)
SHEETS = (Sheet("base", 6e-3), Sheet("magnetic", 2e-3, 2.7))


def many_layers(count: int) -> Stackup:
    """Stack-up of `count` copper layers L1, L2, …"""
    names = tuple(f"L{k + 1}" for k in range(count))
    return Stackup(names, (35e-6,) * count, (0.2e-3,) * (count - 1), (4.5,) * (count - 1))


def one_coil(coil: Coil, *, rotation: float = 0.0, through_holes: bool = True) -> CoilArray:
    """Board of just this coil on as many layers as it has."""
    stackup = many_layers(len(coil.lines))
    return CoilArray(stackup, (Placement("A", coil, stackup.names, 0, 0, rotation),), through_holes=through_holes)


def reference_board(*, count: int = 6, turns: int = 30, through_holes: bool = True) -> CoilArray:
    """Two-layer coils C1, C2, … of hexagonal turns in a row, alternately on L1, L2 and on L3, L4."""
    apothem = apothem_from_size(23e-3, 6, across="corners")
    coil = spiral_coil(Spiral(6, apothem, turns, 0.1e-3, 0.1e-3, first_corner=math.pi / 2), 2, VIA, LEADS)
    points, _ = lattice("linear", 13.28e-3, count)
    pairs = (("L1", "L2"), ("L3", "L4"))
    placements = tuple(Placement(f"C{k + 1}", coil, pairs[k % 2], x, y) for k, (x, y) in enumerate(points.tolist()))
    return CoilArray(FOUR_LAYERS, placements, through_holes=through_holes)
