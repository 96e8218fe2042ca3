"""
Torque of a rotor
=================

A coil turns in the field of a Helmholtz pair. Its torque is its area times the field and the sine of the angle, as
long as the field is even over the coil.
"""

import matplotlib.pyplot as plt
import numpy as np

import coilarray as ca
from coilarray.electromagnetics.forces import forces
from coilarray.geometry import Pose, helmholtz_pair, solenoid

stator = helmholtz_pair(radius=40e-3, wire=1e-3, turns=10)
rotor = solenoid(diameter=30e-3, length=10e-3, turns=10, wire=0.8e-3)
angles = np.linspace(0, 2 * np.pi, 73)
torque = [forces(rotor.posed(Pose(turn=(angle, 0, 0))), stator, 1.0, 2.0)[1][0, 0] for angle in angles]
field = ca.magnetic_field(stator, [[0, 0, 0]], [2.0, 2.0])[0, 2]
figure, ax = plt.subplots(figsize=(7, 4), layout="constrained")
ax.plot(np.degrees(angles), np.array(torque) * 1e6, label="along the wire")
ax.plot(np.degrees(angles), -rotor.area[2] * field * np.sin(angles) * 1e6, "k:", label="area × field at the middle")
ax.set(xlabel="angle (°)", ylabel="torque about x (µN m)", xticks=range(0, 361, 60))
ax.legend()
