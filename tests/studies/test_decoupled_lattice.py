"""Loops on a surface whose neighbours decouple, against the distances of flat loops."""

import math

import numpy as np
import pytest
from support.references import rows
from support.refusals import refused

from coilarray.errors import DesignError
from coilarray.geometry import PlatedHole, Stackup, Surface, SurfaceLattice, path_coil
from coilarray.studies.create.surface import decoupled_lattice, lattice_coupling

STRIP = Stackup(("L1",), (35e-6,), (), ())
TURN = np.radians(np.linspace(0.05, 359.95, 61))
# the turn of 60 sides has the area of a circle of 100 mm
LOOP = path_coil(
    [50e-3 * (1 + math.pi**2 / 3 / 60**2) * np.column_stack((np.cos(TURN), np.sin(TURN)))],
    0.2e-3, 0.2e-3, PlatedHole(1e-4, 2e-4),
)  # fmt: skip


@pytest.mark.parametrize(("count", "wrapped"), [
    pytest.param(2, False, marks=pytest.mark.slow), pytest.param(2, True, marks=pytest.mark.slow),
    (3, False), pytest.param(3, True, marks=pytest.mark.slow),
])  # fmt: skip
def test_nearly_flat_loops_decouple_as_flat_ones(count, wrapped):
    """On a radius of 2 m. Thin circles decouple at 0.7580 diameters, at a height of 0.001 radii (a step) 0.7581.

    Curvature of 0.05 radii, chords of 60 sides and a gap of 0.1° move that by less than 0.003.
    """
    dome = Surface.dome((2.0, 2.0, 2.0))
    angle = 2 * np.pi * np.arange(count) / count + 0.3
    points = dome.nearest(np.column_stack((40e-3 * np.cos(angle), 40e-3 * np.sin(angle), np.full(count, 2.0))))[0]
    start = SurfaceLattice(dome, points, ("L1",), [90e-3, 100e-3, 110e-3][:count], wrapped=wrapped)
    found = decoupled_lattice(start, LOOP, STRIP)
    assert lattice_coupling(found, LOOP, STRIP)[0] < 5e-4
    assert lattice_coupling(start, LOOP, STRIP)[0] > 1e-2
    flat = next(float(row["d_crit_normalised"]) for row in rows("geometric_decoupling_loops") if row["h_over_R"] == "0")
    # loops of unequal size decouple where the mean is nearly the same
    sizes = found.sizes
    for i in range(count):
        for k in range(i):
            apart = np.linalg.norm(found.points[i] - found.points[k]) / (sizes[i] + sizes[k]) * 2
            assert apart == pytest.approx(flat, abs=0.01)


def test_a_single_loop():
    dome = Surface.dome((2.0, 2.0, 2.0))
    lattice = SurfaceLattice(dome, [(0.0, 0.0, 2.0)], ("L1",), [90e-3])
    refused(DesignError, "several; got 1", decoupled_lattice, lattice, LOOP, STRIP)
