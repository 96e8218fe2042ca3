"""Compile the kernels that the report of the README does not need, which its tests would compile at once."""

import numpy as np

import coilarray as ca
from coilarray.electromagnetics.field import vector_potential
from coilarray.electromagnetics.motion import moved_inductance
from coilarray.geometry import MATERIALS, Disc, FinitePlate
from coilarray.metal.finite_plates import moving_plate

coil = ca.Spiral(6, 10e-3, 5, 0.2e-3, 0.2e-3)
pair = ca.Array.row(coil, 2, pitch=12e-3)
ca.inductance_matrix(pair, accuracy="screen")
vector_potential(pair.conductors()[0], [[0.0, 0.0, 1e-3]])
moved_inductance(coil, coil, [ca.Pose(z=5e-3)])
loop = 5e-3 * np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]])
for metal in ("copper", "steel"):
    plate = FinitePlate("plate", Disc(3e-3), (0.0, 0.0, 2e-3), 1e-3, MATERIALS[metal])
    moving_plate([loop], plate, [plate.centre], [1e6], fineness=0.2)
