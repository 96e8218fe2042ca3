"""Windings and inductance matrices for the tests of fields and circuits."""

import numpy as np

from coilarray.geometry import Conductor
from coilarray.geometry.arcs import coarser_line
from support.references import polygon


def random_matrix(n, seed, spread=0.15):
    """Inductances of about 50 µH with couplings of random sign: positive definite by construction."""
    rng = np.random.default_rng(seed)
    factor = np.eye(n) + spread * rng.standard_normal((n, n))
    return 50e-6 * factor @ factor.T


def at_height(line, z):
    """Points of a line in the plane at a height z, shape (n, 3)."""
    return np.column_stack((line, np.full(len(line), z)))


def spiral_path(spiral, layers=(0.0,), thickness=35e-6):
    """A spiral as one path through layers at these heights, vias included."""
    step = np.pi / 36
    lines = [at_height(coarser_line(spiral.centre_line(k), spiral.arcs(k), step)[0], z) for k, z in enumerate(layers)]
    return Conductor(np.vstack(lines), spiral.width, thickness)


def loop(radius, z=0.0, sides=72, centre=(0.0, 0.0)):
    """A circle in the plane as a closed polygon of the same area, shape (sides + 1, 3) in m."""
    return polygon(sides, radius * np.sqrt(2 * np.pi / sides / np.sin(2 * np.pi / sides)), z, centre=centre)
