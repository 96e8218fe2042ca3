"""The slow three-dimensional check of the dented layer, itself checked on coarse meshes.

Against the image series of the flat slab (a layer lifted as a whole), against Born's integral of a loop's closed-form
field (a weak layer under a real dent, which no flat formula sees), and against itself: a dent turned about a circular
loop, mesh refinement at the predicted order, reciprocity, and every bad input.
"""

import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.special import ellipe, ellipk
from support.references import circle, polygon, rows

from coilarray.constants import MU_0

pytest.importorskip("pyamg", reason="the benchmark extra is not installed")
sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
from dented_layer_3d import ORDER, Box, SmoothDent, dent_inductance_change, graded, richardson

pytestmark = pytest.mark.slow

LAYER = (6e-3, 8e-3)
DENT = SmoothDent(1e-3, 3e-3)
# identities hold on any mesh
COARSE = Box(60e-3, 60e-3, cell=2.5e-3, side_cells=4, layer_cells=1, air_cells=3)
LEVELS = [Box(50e-3, 50e-3, cell=5e-3, side_cells=4, layer_cells=1, air_cells=2).refined(n) for n in (1, 2)]
LOOP = circle(360, 8e-3)
PAIR = [polygon(6, 8e-3, turn=np.pi / 6), polygon(6, 8e-3, -0.5e-3, np.pi / 6, (13e-3, 0.0))]


def change(paths, mesh=COARSE, permeability=2.7, bottom=DENT.bottom, top=DENT.top, centre=(0.0, 0.0)):
    return dent_inductance_change(paths, *LAYER, permeability, bottom, top, centre, mesh)


@pytest.fixture(scope="module")
def pair_change():
    """Two hexagons, the dent beside the middle of the first."""
    return change(PAIR, centre=(3e-3, 1e-3))


def test_dent_has_a_ring_and_no_volume():
    x, weight = np.polynomial.legendre.leggauss(200)
    ring = weight * (1 + x) * DENT.top(0.05 * (1 + x))
    assert abs(ring.sum()) < 1e-12 * abs(ring).sum()  # rounding
    r = np.linspace(0, 0.1, 10001)
    top = DENT.top(r)
    assert top[0] == -1e-3
    # the narrow part still takes 1e-4 of the ring's height at the top of the ring
    assert top.max() == pytest.approx(1e-3 / (np.e * 3.84**2), rel=1e-3)
    assert DENT.bottom(r) == pytest.approx(0.64 * top, rel=1e-14)


def test_mesh_grows_from_the_dent_and_keeps_its_nodes():
    nodes = graded(60e-3, 4, 2.5e-3)
    assert nodes[[0, -1]] == pytest.approx([0, 60e-3], abs=1e-15)
    assert (np.diff(nodes, 2) > 0).all()
    assert 1 < nodes[1] / 2.5e-3 < 1.3  # 2.5 mm is the slope at the dent; the first cell has grown a little already
    assert COARSE.refined(2).axes(*LAYER)[0][::2] == pytest.approx(COARSE.axes(*LAYER)[0], abs=1e-15)
    assert COARSE.widened(2).axes(*LAYER)[0][2:-2] == pytest.approx(COARSE.axes(*LAYER)[0], abs=1e-12)


def test_no_dent_changes_nothing(pair_change):
    # the second potential starts from the first, which solves the same equations to 1e-9; energies square that
    assert np.abs(change(PAIR, bottom=np.zeros_like, top=np.zeros_like)).max() < 1e-9 * np.abs(pair_change).max()
    assert (change(PAIR, permeability=1.0) == 0).all()  # air is no layer


def order(errors):
    return np.log2(errors[0] / errors[1])


def test_lifted_layer_is_the_image_series():
    images = {tuple(row.values())[:7]: float(row["dM_images_nH"]) * 1e-9 for row in rows("slab_circular_filament")}
    exact = images["8.0", "8.0", "8", "8", "2", "2.7", "0.0"] - images["8.0", "8.0", "6", "6", "2", "2.7", "0.0"]

    def lifted(r):
        return np.full_like(r, 2e-3)

    errors = np.abs(np.array([change([LOOP], mesh, bottom=lifted, top=lifted)[0, 0] for mesh in LEVELS]) / exact - 1)
    assert errors[1] < 1e-3  # measured 3.8e-4, of which the polygon has 1e-4
    # predicted 4, of the energy of second-order elements; measured 4.5 on these coarse meshes
    assert order(errors) > 3.5


def loop_field_squared(r, z, radius):
    """B² of a circular filament with 1 A at distance r from its axis and height z (Smythe, Electricity, ch. 7)."""
    outer, inner = (radius + r) ** 2 + z**2, (radius - r) ** 2 + z**2
    K, E = (integral(4 * radius * r / outer) for integral in (ellipk, ellipe))
    factor = MU_0 / (2 * np.pi * np.sqrt(outer))
    along = factor * (K + (radius**2 - r**2 - z**2) / inner * E)
    return along**2 + (factor * z / r * (-K + (radius**2 + r**2 + z**2) / inner * E)) ** 2


def born(dent, susceptibility, radius):
    """First order in µr − 1: µ0 H_s² over the volume that the dented layer gains, less what it loses."""
    x, weight = np.polynomial.legendre.leggauss(12)

    def along_z(r, low, high):
        return (high - low) / 2 * weight @ loop_field_squared(r, (low + high) / 2 + (high - low) / 2 * x, radius)

    def ring(r):
        above = along_z(r, LAYER[1], LAYER[1] + dent.top(r))
        return 2 * np.pi * r * (above - along_z(r, LAYER[0], LAYER[0] + dent.bottom(r)))

    return susceptibility / MU_0 * quad(ring, 1e-9, 0.06, epsrel=1e-10, epsabs=0, limit=200)[0]


def test_weak_layer_is_borns_integral():
    weak = 1e-6
    exact = born(DENT, weak, 8e-3)
    errors = np.abs(np.array([change([LOOP], mesh, permeability=1 + weak)[0, 0] for mesh in LEVELS]) / exact - 1)
    assert errors[1] < 2e-3  # measured 8.5e-4; the polygon has 1e-4 of it
    assert order(errors) > 3.5  # measured 5: the quadrature and the second-order shape of the dented faces


def test_dent_turned_about_a_loop():
    mesh = Box(60e-3, 60e-3, cell=2.5e-3, side_cells=5, layer_cells=2, air_cells=3)
    places = [(8e-3 * np.cos(turn), 8e-3 * np.sin(turn)) for turn in (0, np.pi / 4)]
    first, second = (change([LOOP], mesh, centre=place)[0, 0] for place in places)
    # nothing but the mesh knows a direction: measured 4e-3, falling to 5e-5 on a mesh twice as fine
    assert second == pytest.approx(first, rel=1e-2)


def test_dent_and_coils_moved_together_and_turned_round(pair_change):
    # residuals of 1e-9 in either layer's share, which is 1e3 times the difference at most
    assert pair_change[0, 1] == pytest.approx(pair_change[1, 0], rel=1e-6)
    shift = np.array([0.3, -0.2, 0.0])
    moved = change([PAIR[1][::-1] + shift, PAIR[0] + shift], centre=np.array([3e-3, 1e-3]) + shift[:2])
    # rounding of the places shows in the steps of the solver only
    assert moved == pytest.approx(np.array([[1, -1], [-1, 1]]) * pair_change[::-1, ::-1], rel=1e-6)


def test_extrapolation_is_exact_at_the_predicted_order():
    values = [np.array([[2.0 + 3.0 / level**ORDER]]) for level in (2.0, 3.0)]
    assert richardson(values, (2.0, 3.0)) == pytest.approx(2.0, rel=1e-14)
