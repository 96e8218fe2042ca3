"""
Coils of four shapes
====================

A polygon, a circle, a rectangle with round corners and a racetrack; `path_coil` takes any polyline of your own. Red:
the upper layer; blue: the lower one.
"""

import matplotlib.pyplot as plt
import numpy as np

import coilarray as ca

turns = (6, 0.4e-3, 0.3e-3)  # number of turns, width of the trace, gap between turns
windings = {
    "hexagon": ca.Spiral(6, 9e-3, *turns, first_corner=np.pi / 2),
    "circle": ca.RoundedSpiral(18e-3, 18e-3, *turns, corner_radius=9e-3),
    "rectangle": ca.RoundedSpiral(22e-3, 16e-3, *turns, corner_radius=2e-3),
    "racetrack": ca.RoundedSpiral(24e-3, 14e-3, *turns, corner_radius=7e-3),
}
figure, axes = plt.subplots(2, 2, figsize=(7, 6), layout="constrained")
for ax, (name, winding) in zip(axes.flat, windings.items(), strict=True):
    coil = ca.spiral_coil(winding, 2, ca.PlatedHole(drill=0.3e-3, pad=0.6e-3))
    for line, colour in zip(coil.lines, ("tab:red", "tab:blue"), strict=True):  # one line a layer
        ax.plot(line[:, 0] * 1e3, line[:, 1] * 1e3, color=colour, linewidth=1)
    ax.set(title=name, aspect="equal", xlabel="x (mm)", ylabel="y (mm)")
