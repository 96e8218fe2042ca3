"""Small designs for the tests of `coilarray.studies.tolerance`: two round loops, one above the other."""

from __future__ import annotations

import math

import numpy as np
from scipy.special import ellipe, ellipk

from coilarray.constants import MU_0
from coilarray.design.model import parse_design

RADIUS = 5e-3  # m
WIDTH, COPPER, DIELECTRIC = 20e-6, 10e-6, 1e-3
SIDES = 100
DEPTH_OF_LOOP = DIELECTRIC + COPPER  # m, from centre to centre of the two


def loops(shift_mm: float = 0.0, *, sheets: str = "", extra: str = ""):
    """Two loops of one turn on L1 and L2, the lower one beside the upper one's axis by a shift along x."""
    angle = np.linspace(0, 2 * math.pi * (1 - 1e-4), SIDES + 1)  # open by 3 µm
    # corners so far out that the polygon has the area of the circle
    r = RADIUS * math.sqrt(2 * math.pi / SIDES / math.sin(2 * math.pi / SIDES))
    line = [[float(x), float(y)] for x, y in np.column_stack((np.cos(angle), np.sin(angle))) * r * 1e3]
    return parse_design(
        f"""
schema = 1
name = "loops"
[stackup]
layers = ["L1", "L2"]
copper_thickness_um = [{COPPER * 1e6}, {COPPER * 1e6}]
dielectric_thickness_mm = [{DIELECTRIC * 1e3}]
dielectric_epsilon_r = [4.5]
[coils.loop]
shape = "path"
lines_mm = [{line}]
trace_width_mm = {WIDTH * 1e3}
gap_mm = 1.0
terminals = false
[array]
lattice = "free"
[[array.placements]]
name = "upper"
coil = "loop"
layers = ["L1"]
x_mm = 0.0
y_mm = 0.0
[[array.placements]]
name = "lower"
coil = "loop"
layers = ["L2"]
x_mm = {shift_mm}
y_mm = 0.0
{sheets}
{extra}
"""
    )


def coaxial_loops(distance: float, radius: float = RADIUS) -> float:
    """Mutual inductance in H of two equal thin loops on one axis, by Maxwell's formula."""
    m = 4 * radius**2 / (4 * radius**2 + distance**2)
    k = math.sqrt(m)
    return MU_0 * radius * ((2 / k - k) * ellipk(m) - 2 / k * ellipe(m))


def coaxial_loops_slope(distance: float, radius: float = RADIUS) -> float:
    """Its derivative by the distance in H/m, the force of two unit currents.

    Smythe, Static and Dynamic Electricity, sect. 8.06.
    """
    m = 4 * radius**2 / (4 * radius**2 + distance**2)
    k = math.sqrt(m)
    return -MU_0 * distance * k / (4 * radius) * ((2 - m) / (1 - m) * ellipe(m) - 2 * ellipk(m))
