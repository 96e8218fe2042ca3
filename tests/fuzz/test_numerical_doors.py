"""Extreme coordinates and values at the public numerical functions: an exact answer, a documented value, or an error.

Who checks whom: sizes from 1 µm to 10 m against scaling laws, which hold exactly; places 1 km from the origin against
the same problem at the origin, within what the rounding of coordinates of that size does; points on wires and on their
extensions against the law of Biot and Savart; segments in pieces against the whole; bad values against a refusal.
"""

from __future__ import annotations

import dataclasses
from itertools import pairwise, product

import mpmath
import numpy as np
import pytest
import xarray as xr
from support.boards import FOUR_LAYERS, SHEETS, SMALL, VIA, small_board
from support.refusals import refused

import coilarray as ca
from coilarray import (
    Conductor,
    coupling_matrix,
    dc_resistance,
    geometry,
    inductance_matrix,
    magnetic_field,
    mutual_inductance,
    self_inductance,
)
from coilarray.circuit.coupling import operating_currents
from coilarray.constants import MU_0
from coilarray.electromagnetics.capacitance import coil_capacitance, elastomer_effect
from coilarray.electromagnetics.field import grid_points, vector_potential
from coilarray.electromagnetics.inductance import rectangular_bars, straight_filaments
from coilarray.electromagnetics.resistance import resistance_matrix
from coilarray.errors import CoilarrayError, GeometryError

ROUNDING = 1e-12
"""Of sums of some hundred terms, each with the rounding of float64."""

FAR = 1e3
"""Offset of the problem in m. A coordinate there is known to 1.1e-13 m."""


def square(side, *, z=0.0, turns=2):
    """A square spiral of constant pitch, side/20 between its turns."""
    corners, pitch = [], side / 20
    for k in range(turns):
        a = side / 2 - k * pitch
        corners += [(-a, -a, z), (a, -a, z), (a, a, z), (-a, a, z)]
    return np.array([*corners, (-side / 2 + turns * pitch, -side / 2 + turns * pitch, z)])


def bars(size, *, at=(0.0, 0.0, 0.0)):
    """Two square spirals of rectangular wire one above the other."""
    return [
        Conductor(square(size, z=z) + np.array(at), size / 100, size / 200, name=name)
        for name, z in (("lower", 0.0), ("upper", size / 10))
    ]


@pytest.mark.parametrize("size", [1e-6, 1e-3, 10.0])
def test_inductance_and_resistance_scale_with_the_size(size):
    """L is proportional to the size and R to its inverse; the kernels have no length of their own."""
    one, other = bars(1.0), bars(size)
    np.testing.assert_allclose(inductance_matrix(other), size * inductance_matrix(one), rtol=ROUNDING)
    np.testing.assert_allclose(self_inductance(other), size * self_inductance(one), rtol=ROUNDING)
    np.testing.assert_allclose(mutual_inductance(*other), size * mutual_inductance(*one), rtol=ROUNDING)
    np.testing.assert_allclose(dc_resistance(other), dc_resistance(one) / size, rtol=ROUNDING)


@pytest.mark.parametrize("size", [1e-6, 1e-3, 10.0])
def test_field_and_potential_scale_with_the_size(size):
    points = np.random.default_rng(1).uniform(-1, 1, (50, 3))
    np.testing.assert_allclose(
        magnetic_field([square(size)], size * points) * size, magnetic_field([square(1.0)], points), rtol=1e-9
    )  # 1e-9: beside the wire, at 1e-3 of its length, the difference of near coordinates has lost three digits
    np.testing.assert_allclose(
        vector_potential([square(size)], size * points), vector_potential([square(1.0)], points), rtol=1e-9, atol=1e-18
    )


@pytest.mark.parametrize("size", [1e-3, 1e-2, 1.0])
def test_a_problem_1_km_away_is_the_one_at_the_origin(size):
    """Coordinates there are rounded to 1.1e-13 m: every distance is off by so much, L relatively by that over the gap.

    The gap of two wires is size/20 less the width; the bound is ten roundings over it.
    """
    bound = 10 * 1.14e-13 / (size / 25)
    here, there = bars(size), bars(size, at=(FAR, -FAR, FAR))
    np.testing.assert_allclose(inductance_matrix(there), inductance_matrix(here), rtol=bound)
    np.testing.assert_allclose(dc_resistance(there), dc_resistance(here), rtol=bound)
    points = size * np.array([[0.1, 0.2, 0.3], [0.0, 0.0, 0.1], [2.0, 0.0, 0.0]])
    B = [magnetic_field([square(size) + at], points + at) for at in (np.zeros(3), np.array([FAR, -FAR, FAR]))]
    np.testing.assert_allclose(B[1], B[0], rtol=0, atol=bound * np.abs(B[0]).max())


def test_segments_in_pieces_are_the_whole():
    """A straight run of many vertices has the field and the inductance of one segment."""
    whole = square(1e-2)
    doubled = np.concatenate([np.linspace(a, b, 9)[:-1] for a, b in pairwise(whole)])
    doubled = np.vstack((doubled, whole[-1]))
    points = np.array([[1e-3, 2e-3, 3e-3], [0.0, 0.0, 1e-3]])
    np.testing.assert_allclose(magnetic_field([doubled], points), magnetic_field([whole], points), rtol=1e-11)
    L = [self_inductance([Conductor(path, 1e-4, 5e-5)])[0] for path in (whole, doubled)]
    assert L[1] == pytest.approx(L[0], rel=1e-9)


@pytest.mark.parametrize("length", [0.0, 1e-40, 1e-18])
def test_a_segment_without_length_is_refused(length):
    refused(
        CoilarrayError,
        "segment 1 of path has length zero",
        Conductor,
        [[0, 0, 0], [1, 0, 0], [1, length, 0], [2, 0, 0]],
    )


def bars_exactly(first, second, offset):
    """Hoer and Love's closed form, with all the digits that it loses; without the constant."""

    def part(x, y, z):
        r = mpmath.sqrt(x * x + y * y + z * z)

        def logarithm(a, b, c):
            s = b * b + c * c
            return (b * b * c * c / 4 - b**4 / 24 - c**4 / 24) * a * mpmath.log((a + r) / mpmath.sqrt(s)) if s else s

        def angle(a, b, c):
            return a * b * c**3 / 6 * mpmath.atan(a * b / (c * r)) if a * b * c else a * b * c

        turned = ((x, y, z), (y, z, x), (z, x, y))
        powers = x**4 + y**4 + z**4 - 3 * (x * x * y * y + y * y * z * z + z * z * x * x)
        return powers * r / 60 + sum(logarithm(*one) - angle(*one) for one in turned)

    with mpmath.workdps(220):
        a, b, d = ([mpmath.mpf(value) for value in values] for values in (first, second, offset))
        ends = [((d[k] - a[k], 1), (d[k] + b[k] - a[k], -1), (d[k] + b[k], 1), (d[k], -1)) for k in range(3)]
        total = sum(i * j * k * part(abs(x), abs(y), abs(z)) for (x, i), (y, j), (z, k) in product(*ends))
        return float(total / (a[1] * a[2] * b[1] * b[2]))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("decades", "accuracy"),  # of all sizes; the accuracy is that of the docstring
    [(1, 1e-10), (4, 1e-7), (8, 1e-4)],
)
def test_bars_of_any_proportions_are_exact_or_refused(decades, accuracy):
    """Plates, wires and grains, crossed, inside each other, and up to 10⁴ sizes apart."""
    random, refusals = np.random.default_rng(23), 0
    for _ in range(25):
        first, second = 10.0 ** random.uniform(-decades, 0, (2, 3))
        offset = random.choice([-1, 1], 3) * 10.0 ** random.uniform(-decades, random.uniform(-1, 4), 3)
        try:
            found = rectangular_bars(tuple(first), tuple(second), tuple(offset))
        except GeometryError:
            refusals += 1
        else:
            assert found == pytest.approx(MU_0 / (4 * np.pi) * bars_exactly(first, second, offset), rel=accuracy)
        alone = bars_exactly(first, first, (0.0, 0.0, 0.0))
        assert rectangular_bars(tuple(first)) == pytest.approx(MU_0 / (4 * np.pi) * alone, rel=accuracy)
    assert refusals <= (4 if decades == 8 else 0)


@pytest.mark.parametrize("length", [1e-4, 1e-8, 1e-12])
def test_short_filaments_far_apart_are_those_of_the_distance(length):
    """Of filaments of length l at a distance d, M is µ0 l²cos/4πd; (l/d)² is left out here, 1e-8 for the longest."""
    way = np.array([0.6, 0.8, 0.0])
    for start, direction in (([0, 1, 0], [1, 0, 0]), ([1, 0, 0], [1, 0, 0]), ([0, 1, 0], way)):
        middle = np.array(start, dtype=float)
        ends = [0.5 * length * np.array(one) for one in ([-1, 0, 0], [1, 0, 0])]
        M = straight_filaments(
            *ends, middle - 0.5 * length * np.array(direction), middle + 0.5 * length * np.array(direction)
        )
        assert M == pytest.approx(
            MU_0 / (4 * np.pi) * length**2 * direction[0], rel=2e-8 + 1e-16 / length
        )  # of its coordinates


def test_points_on_a_wire_get_nothing_of_it():
    """On a straight wire and beyond its ends B is zero, as documented, and µ0/2πr beside it, down to 1 nm."""
    wire = [[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]]
    on = np.array([[x, 0.0, 0.0] for x in (-1.0, -0.3, 0.0, 1.0, 1.0 + 1e-9, 1.5, -2.0, 1e6)])
    assert (magnetic_field([wire], on) == 0).all()
    assert np.isfinite(vector_potential([wire], on)).all()
    for distance in (1e-9, 1e-6, 1e-3):
        B = magnetic_field([wire], [0.0, distance, 0.0])
        assert B[2] == pytest.approx(MU_0 / (2 * np.pi * distance) / np.hypot(1, distance), rel=1e-9)
        assert B[:2].tolist() == [0.0, 0.0]


def test_points_on_a_corner_are_finite():
    path = square(1e-2)
    B, A = magnetic_field([path], path), vector_potential([path], path)
    assert np.isfinite(B).all()
    assert np.isfinite(A).all()


def test_widths_beyond_any_integer_are_told_apart():
    """Equal shapes are computed once, and wide and wider bars are not equal: L falls as the width grows."""
    paths = [Conductor([[0, 0, 0], [1e-3, 0, 0]], width, 1e-5, name=f"{width}") for width in (1e9, 2e9)]
    both = self_inductance(paths)
    assert both.tolist() == [self_inductance(path)[0] for path in paths]
    assert both[1] < both[0]


_NUMBERS = [np.nan, np.inf, -np.inf]
_WIRE = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]
_STARTER = ca.load_design("starter")
_BARE = dataclasses.replace(_STARTER, sheets=(), indentation=None)
_AIMED = dataclasses.replace(_BARE, target=ca.Target(ca.Ball(1e-3, ca.MATERIALS["aluminium"]), (1e-3,), (0.0,), (0.0,)))


def _coupling(number):
    names, currents = list(_BARE.array.names), np.eye(len(_BARE.array.names))
    currents[0, 1] = number
    return xr.Dataset({f"current_{part}": (("coil", "other"), currents) for part in ("real", "imag")}, {"coil": names})


_BEYOND = {
    "frequency": lambda bad: resistance_matrix(Conductor(_WIRE, 1e-3, 1e-3), [1e6, bad]),
    "permittivity": lambda bad: coil_capacitance(_BARE.array, relative_permittivity=bad),
    "permittivity of an effect": lambda bad: elastomer_effect(_BARE.array, bad, 1e-10),
    "undisturbed": lambda bad: elastomer_effect(_BARE.array, 2.0, 1e-10, undisturbed=bad),
    "radius of a sample": lambda bad: ca.indent(_STARTER.sheets, ca.Hemisphere(2.5e-3), [1e-3], radius=bad),
    "pitch of a connector": lambda bad: geometry.Connector(pitch=bad),
    "place of a connector": lambda bad: geometry.Connector(at=bad),
    "rule": lambda bad: ca.FabRules(min_gap=bad),
    "clock": lambda bad: ca.Readout(clock=bad),
    "fineness": lambda bad: ca.target_map(_AIMED, accuracy=bad),
    "coupling": lambda bad: operating_currents(_BARE, _coupling(bad), "coil1"),
    "corner of a path": lambda bad: ca.path_coil([[(0.0, 0.0), (1e-2, bad)]], 1e-4, 1e-4, VIA),
}
_DOORS = {
    "current of a field": lambda bad: ca.operating_field(_BARE, None, "coil1", 0.0, 0.0, 1e-3, current=bad),
    "vertices": lambda bad: magnetic_field([[[0.0, 0.0, bad], [1.0, 0.0, 0.0]]], [0, 0, 1]),
    "points": lambda bad: magnetic_field([_WIRE], [0, bad, 1]),
    "currents": lambda bad: magnetic_field([_WIRE], [0, 0, 1], bad),
    "points of A": lambda bad: vector_potential([_WIRE], [[0, 0, 1], [bad, 0, 0]]),
    "grid": lambda bad: grid_points([0, bad], [0], [0]),
    "widths": lambda bad: Conductor(_WIRE, bad, 1e-3),
    "thicknesses": lambda bad: Conductor(_WIRE, 1e-3, bad),
    "areas": lambda bad: Conductor(_WIRE, 1e-3, 1e-3, bad),
    "resistivity": lambda bad: dc_resistance(Conductor(_WIRE, 1e-3, 1e-3), bad),
    "matrix": lambda bad: coupling_matrix([[1.0, bad], [bad, 1.0]]),
    "filament": lambda bad: straight_filaments([0, 0, 0], [1, 0, 0], [0, bad, 0], [1, 1, 0]),
    "bar": lambda bad: rectangular_bars((1.0, bad, 1.0)),
    "offset": lambda bad: rectangular_bars((1.0, 1.0, 1.0), (1.0, 1.0, 1.0), (0.0, bad, 0.0)),
    "polyline": lambda bad: inductance_matrix([np.array([[0.0, 0.0, 0.0], [bad, 0.0, 0.0]])]),
}


@pytest.mark.parametrize("door", _BEYOND)
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 1e300])
def test_what_no_formula_can_take_is_refused(door, bad):
    with pytest.raises(ValueError, match=r"finite|at least 1|must be") as caught:
        _BEYOND[door](bad)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("bad", _NUMBERS)
@pytest.mark.parametrize("door", _DOORS)
def test_what_is_not_finite_is_refused(door, bad):
    with pytest.raises(ValueError, match=r"finite|positive|must be") as caught:
        _DOORS[door](bad)
    assert "\n" not in str(caught.value)


_METAL = ca.Material("metal", 1e6, 2.0)
_VALUES = (
    ca.Ball(1e-3, _METAL),
    ca.Circuit(),
    geometry.Connector(at=0.0, trace_width=1e-4, gap=1e-4),
    geometry.CylinderEdge(1e-3),
    ca.Design(small_board()),
    ca.Disc(1e-3),
    ca.FabRules(max_outer_copper=1e-4, max_inner_copper=1e-4, max_aspect_ratio=8.0, max_board=(0.1, 0.1)),
    ca.FinitePlate("disc", ca.Disc(1e-3), (0.0, 0.0, 1e-3), 1e-4, _METAL),
    geometry.FlatPunch(1e-3, 1e-4),
    ca.Hemisphere(1e-3),
    ca.Imperfections(),
    ca.Indentation(ca.Hemisphere(1e-3), (1e-4,), (0.0,), (0.0,)),
    geometry.Leads(1e-3, 1e-3, VIA),
    geometry.Paraboloid(1e-3),
    ca.Placement("A", SMALL, ("L1", "L2"), 0.0, 0.0),
    ca.Plate("plate", 1e-3, 1e-4, _METAL),
    ca.PlatedHole(0.2e-3, 0.5e-3),
    geometry.Polygon(((0.0, 0.0), (1e-2, 0.0), (0.0, 1e-2))),
    ca.Readout(clock_per_kelvin=1e-6, clock_per_volt=1e-6),
    ca.Rectangle(1e-3, 1e-3),
    geometry.Ring(2e-3, 1e-3),
    ca.RoundedSpiral(1e-2, 1e-2, 3.0, 1e-4, 1e-4, 1e-3),
    geometry.Seat(1e6),
    SHEETS[1],
    ca.Spiral(6, 10e-3, 3.0, 1e-4, 1e-4),
    FOUR_LAYERS,
    ca.Switches(),
    ca.Target(ca.Ball(1e-3, _METAL), (1e-3,), (0.0,), (0.0,)),
)
"""Good values of every kind whose numbers must all be finite. A cone's radius and a conductivity may be infinite; a
lattice and a state of a scan are values that are checked where an array or design is made of them."""


def _with(value, bad):
    """The value with each of its numbers, in nested tuples too, replaced in turn."""
    if isinstance(value, float):
        yield bad
    elif isinstance(value, tuple):
        for k, one in enumerate(value):
            yield from ((*value[:k], new, *value[k + 1 :]) for new in _with(one, bad))


@pytest.mark.parametrize("value", _VALUES, ids=lambda value: type(value).__name__)
def test_no_value_takes_a_number_that_is_not_finite(value):
    tried = 0
    for entry in (one for one in dataclasses.fields(value) if one.name != "rest"):  # which may be infinite
        for bad in _NUMBERS:
            for new in _with(getattr(value, entry.name), bad):
                tried += 1
                with pytest.raises(CoilarrayError) as caught:
                    dataclasses.replace(value, **{entry.name: new})
                assert len(str(caught.value)) <= 300
    assert tried


@pytest.mark.parametrize("bad", _NUMBERS)
def test_a_lattice_and_a_load_are_checked_where_they_are_used(bad):
    for change in ({"pitch": bad}, {"direction": bad}, {"rotation": bad}):
        lattice = dataclasses.replace(ca.Lattice("linear", 1e-2, 2), **change)
        with pytest.raises(CoilarrayError, match="finite"):
            ca.lattice_array(FOUR_LAYERS, SMALL, lattice)
    board = small_board()
    loaded = ca.ScanState("A", (("A", 1),), load_resistance=bad)
    with pytest.raises(CoilarrayError, match="load_resistance of state A must be positive"):
        ca.Design(board, circuit=ca.Circuit(scan=(loaded,)))
