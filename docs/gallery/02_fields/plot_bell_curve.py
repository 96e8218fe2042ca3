"""
B above a coil, at six heights
==============================

The vertical flux density of a hexagonal coil on a line across it. Close to the copper it is largest above the turns,
further up in the middle.
"""

import matplotlib.pyplot as plt
import numpy as np

import coilarray as ca
from coilarray.electromagnetics.field import grid_points

design = ca.load_design("gast2020")
coil = design.array.conductors()[2]
x = np.linspace(-25e-3, 25e-3, 401) + design.array.centres[2, 0]
figure, ax = plt.subplots(figsize=(7, 4), layout="constrained")
for height in (1e-3, 2e-3, 4e-3, 6e-3, 8e-3, 12e-3):
    points = grid_points(x, [design.array.centres[2, 1]], [height]).reshape(-1, 3)
    field = ca.magnetic_field([coil], points)[..., 2].ravel()
    ax.plot(x * 1e3, field * 1e3, label=f"{height * 1e3:g} mm")
ax.set(xlabel="x (mm)", ylabel="$B_z$ (mT per A)")
ax.legend(title="height")
