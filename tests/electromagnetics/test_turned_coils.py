"""However coils are turned, mirrored, shifted and put in order, they have the same L, R, C, k, f and Q."""

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.boards import VIA, many_layers, round_spiral, square_turns

from coilarray import Circuit, Switches, couple_design, load_design, scan_design
from coilarray.design.model import Design
from coilarray.electromagnetics.capacitance import coil_capacitance
from coilarray.electromagnetics.inductance import inductance_matrix
from coilarray.electromagnetics.resistance import resistance_matrix
from coilarray.geometry import Array, Material, Placement, Plate, RoundedSpiral, Spiral, path_coil

ROUNDING = 1e-6
"""Relative: asked for; coordinates differ by roundings, and the sections of turns are rounded to 1e-8 of the width."""
FREQUENCIES = [1e5, 1e6, 1e7]
PATH = [(-8, -8), (-8, 8), (8, 8), (8, -8), (-7, -8), (-7, 7), (7, 7), (7, -7), (-6, -7), (-6, 6), (6, 6), (6, -6),
        (-5, -6), (-5, 0.5), (0.4, 0.5)]  # fmt: skip
LEAD = [(0.4, 0.5), (0.4, -12)]


def coil_of(shape, layers, width, angle=0.0, *, mirrored=False):
    """A coil whose path is turned by an angle, after it was mirrored at the x axis; the width in mm."""
    sense = "cw" if mirrored else "ccw"
    if shape == "path":
        turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
        flip = np.array([1.0, -1.0 if mirrored else 1.0])
        return path_coil([1e-3 * np.array(line) * flip @ turn for line in (PATH, LEAD)], width * 1e-3, 0.3e-3, VIA)
    gap = min(width, 0.2) * 1e-3
    sizes = {"turns": 3, "width": width * 1e-3, "gap": gap, "winding": sense}
    if shape == "circle":
        spiral = round_spiral(5.731e-3, 3, width * 1e-3, gap, direction=angle, winding=sense)
    elif shape == "racetrack":
        spiral = RoundedSpiral(16e-3, 9e-3, corner_radius=4.5e-3, direction=angle, **sizes)
    else:
        spiral = Spiral({"square": 4, "hexagon": 6, "octagon": 8}[shape], 12e-3, first_corner=angle, **sizes)
    return replace(spiral, layers=layers).coil()


def numbers(coils, places, rotations, order, layers):
    """L, R and C of two coils beside each other, in one order."""
    stackup = many_layers(layers)
    placed = [
        Placement(name, coil, stackup.names, *place, rotation)
        for name, coil, place, rotation in zip("AB", coils, places, rotations, strict=True)
    ]
    array = Array(stackup, tuple(placed[k] for k in order))
    back = np.argsort(order)
    L = inductance_matrix(array)[np.ix_(back, back)]
    R = resistance_matrix(array, FREQUENCIES).resistance.values[:, back][:, :, back]
    C = coil_capacitance(array).coil_capacitance.values[back]
    return L, R, C


@lru_cache
def as_it_is(shape, layers, width):
    coil = coil_of(shape, layers, width)
    return numbers((coil, coil), ((0.0, 0.0), (31e-3, 4e-3)), (0.0, 0.0), (0, 1), layers)


@pytest.mark.slow
@pytest.mark.parametrize(("shape", "layers", "width"), [
    ("circle", 1, 0.3), ("circle", 2, 0.2), ("circle", 4, 0.1), ("hexagon", 2, 0.3), ("hexagon", 4, 0.2),
    ("octagon", 2, 0.1), ("square", 1, 0.1), ("square", 2, 0.2), ("square", 2, 0.3), ("racetrack", 2, 0.2),
    ("path", 2, 0.3),
])  # fmt: skip
@settings(max_examples=3, deadline=None)
@given(
    angle=st.one_of(st.floats(0, 2 * np.pi), st.sampled_from(np.radians([30, 45, 60, 90, 120, 240, 270]).tolist())),
    mirrored=st.booleans(), shift=st.tuples(st.floats(-0.1, 0.1), st.floats(-0.1, 0.1)), swapped=st.booleans(),
    of_path=st.booleans(),
)  # fmt: skip
def test_turned_mirrored_shifted_and_in_another_order(shape, layers, width, angle, mirrored, shift, swapped, of_path):
    expected = as_it_is(shape, layers, width)
    # the path itself is turned, or its place on the board
    coil = coil_of(shape, layers, width, angle if of_path else 0.0, mirrored=mirrored)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    there = turn @ (31e-3, -4e-3 if mirrored else 4e-3) + shift
    rotation = 0.0 if of_path else angle
    found = numbers((coil, coil), (shift, there), (rotation, rotation), (1, 0) if swapped else (0, 1), layers)
    np.testing.assert_allclose(found[0], expected[0], rtol=ROUNDING)
    for one, other in zip(found[1:], expected[1:], strict=True):
        own = np.abs(other).min(axis=-1, keepdims=True) if other.ndim == 1 else np.einsum("...ii->...i", other).min()
        np.testing.assert_allclose(one, other, rtol=0, atol=ROUNDING * np.min(own))


@pytest.mark.parametrize("distance", [31e-3, 60e-3, 150e-3, 500e-3])
@pytest.mark.parametrize("shape", ["hexagon", "octagon", "square"])
def test_weak_coupling_turns_with_the_board(shape, distance):
    """M down to 1e-7 of L: the far field and the widths count to a part of M, not of L."""
    coil, stackup = coil_of(shape, 2, 0.3), many_layers(2)

    def mutual(angle):
        c, s = np.cos(angle), np.sin(angle)
        places = (0.0, 0.0), (c * distance - s * 3e-3, s * distance + c * 3e-3)
        placed = [Placement(n, coil, stackup.names, *p, angle) for n, p in zip("AB", places, strict=True)]
        return float(inductance_matrix(Array(stackup, tuple(placed)))[0, 1])

    turned = [mutual(angle) for angle in np.radians([17.3, 30.0, 90.0, 120.0, 240.0, 270.0])]
    np.testing.assert_allclose(turned, mutual(0.0), rtol=ROUNDING)


@pytest.mark.slow
def test_turned_board_between_a_plate_and_a_sheet():
    """Coils, neighbours, metal below and the tank: f, Q, k and L of the whole circuit."""
    coil, stackup = coil_of("circle", 2, 0.3), many_layers(2)
    lid = Plate("lid", -5e-3, 1e-3, Material("aluminium", 3.5e7))
    sheets = load_design("gast2020").sheets

    def solved(turned):
        c, s = np.cos(turned), np.sin(turned)
        places = [(0.0, 0.0), (17e-3 * c, 17e-3 * s)]
        placed = [Placement(f"c{k}", coil, stackup.names, *place, turned) for k, place in enumerate(places)]
        design = Design(
            Array(stackup, tuple(placed)), sheets=sheets, plates=(lid,),
            circuit=Circuit(Switches(tank_capacitance=330e-12)),
        )  # fmt: skip
        scan, coupling = scan_design(design, elastomer=False), couple_design(design)
        return [scan[name].values for name in ("frequency", "quality_factor", "effective_inductance")] + [
            coupling.coupling.values, scan.winding_capacitance.values
        ]  # fmt: skip

    for one, other in zip(solved(np.radians(33.0)), solved(0.0), strict=True):
        np.testing.assert_allclose(one, other, rtol=ROUNDING)


@pytest.mark.slow
@pytest.mark.parametrize("turns", [3, 6])
def test_a_winding_is_the_same_from_its_other_end(turns):
    line = 1e-3 * np.array(square_turns(turns, 8.0, 1.0))
    forward, backward = (path_coil([points], 0.3e-3, 0.3e-3, VIA) for points in (line, line[::-1]))
    places = ((0.0, 0.0), (31e-3, 4e-3))
    expected, found = (numbers((coil, coil), places, (0.0, 0.0), (0, 1), 1) for coil in (forward, backward))
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_allclose(np.abs(one), np.abs(other), rtol=ROUNDING)
