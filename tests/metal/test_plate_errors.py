"""Stated errors of plates with an outline cover the true ones, which independent solutions give.

Who checks whom: finite elements about the axis (tests/support/axial_plates.py) against the infinite plate and the ball,
which have closed forms; the stream function of thin plates (tests/support/thin_plates.py) against them; the package
against rows of tests/reference/ref_plates.csv, which these two wrote and `benchmarks/plate_errors.py` reads in full.
"""

import numpy as np
import pytest
from skfem import MeshQuad, MeshQuad2
from support.axial_plates import AxialPlate, axial_change, change_on, lines
from support.coil_paths import loop
from support.references import rows
from support.thin_plates import Case, thin_truth

from coilarray.geometry import Ball, Material, Plate
from coilarray.metal.ball import ball_inductance
from coilarray.metal.finite_plates import moving_plate
from coilarray.metal.flat_plates import plate_inductance

# quick ones of several kinds: discs, rings, rectangles, holes and slots, thick and thin, tilted, and iron
ROWS = [rows("plates")[k] for k in (1, 6, 11, 15, 21, 32, 43)]


@pytest.mark.slow
@pytest.mark.parametrize(("permeability", "frequency"), [(1.0, 1e6), (100.0, 1e4)])
def test_axial_elements_of_a_wide_disc_are_the_infinite_plate(permeability, frequency):
    """Twenty radii wide; currents fall as the fourth power beyond the loop. The elements err by 1e-4."""
    disc = AxialPlate(0.0, 0.1, -0.5e-3, 0.5e-3, 7e6, permeability)
    found = axial_change([(5e-3, -1.5e-3)], disc, frequency)
    plate = Plate("plate", 1e-3, 1e-3, Material("metal", 7e6, permeability))
    expected = plate_inductance([loop(5e-3, sides=720)], [plate], [frequency])[0, 0, 0]
    assert found.real == pytest.approx(expected.real, rel=2e-4)
    assert found.imag == pytest.approx(expected.imag, rel=5e-4)


@pytest.mark.slow
@pytest.mark.parametrize(("permeability", "frequency"), [(1.0, 3e4), (200.0, 1e3)])
def test_axial_elements_of_a_ball(permeability, frequency):
    """On a mesh of arcs; an empty one of a thousandth of its radius is at the centre."""
    a, height, metal = 2.5e-3, 4e-3, Material("metal", 7e6, permeability)
    rho = lines([(a * 1e-3, a * 1e-3), (a, metal.skin_depth(frequency) / 4), (60 * a, 60 * a)], 1.4)
    flat = MeshQuad2.from_mesh(MeshQuad.init_tensor(rho, np.linspace(0, np.pi, 31)))
    distance, angle = flat.doflocs
    mesh = MeshQuad2(np.array([distance * np.sin(angle), distance * np.cos(angle)]), flat.t)
    inside = distance[flat.t].max(axis=0) < a * (1 + 1e-9)
    ball = AxialPlate(0.0, a, -a, a, metal.conductivity, permeability)
    found = change_on(mesh, inside, [(6e-3, -height)], ball, frequency)
    expected = ball_inductance([loop(6e-3, sides=720)], Ball(a, metal), [[0.0, 0.0, height]], [frequency]).item()
    assert found == pytest.approx(expected, rel=2e-4)


@pytest.mark.slow
def test_thin_plates_are_those_of_axial_elements():
    """A ring of an eighth of its inscribed radius in thickness, within both own errors."""
    ring = Case("axial", 360, (7.0, 5.5), "ring", (8.0, 6.0), 0, 0, 1.06, 0.12, 0, 0, 1e7, 1, 2e5)
    one, own = ring.truth()
    other, error = thin_truth(ring.paths, ring.plate, ring.frequency, (150, 600))
    assert abs(one.real - other.real) < own.real + error.real < 5e-3 * abs(one.real)
    assert abs(one.imag - other.imag) < own.imag + error.imag < 5e-3 * abs(one.imag)


@pytest.mark.slow
@pytest.mark.parametrize("row", ROWS, ids=lambda row: f"{row['outline']} {row['frequency']} Hz")
def test_stated_errors_cover(row):
    """Of ΔL and of ΔR apart."""
    case = Case.of_row(row)
    plate, ohms = case.plate, 2e3 * np.pi * case.frequency
    error = moving_plate(case.paths, plate, [plate.centre], [case.frequency])
    found, stated = error.change.sum(), error.absolute.sum()
    assert abs(found.real * 1e9 - float(row["dL_nH"])) <= stated.real * 1e9
    assert abs(-found.imag * ohms - float(row["dR_mOhm"])) <= stated.imag * ohms
