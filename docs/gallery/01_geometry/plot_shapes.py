"""
Coils of four shapes
====================

A polygon, a circle, a rectangle with round corners and a racetrack; `path_coil` takes any polyline of your own. Red:
the upper layer; blue: the lower one.
"""

import matplotlib.pyplot as plt

import coilarray as ca

turns = {"turns": 6, "width": 0.4e-3, "gap": 0.3e-3, "leads": None}
spirals = {
    "hexagon": ca.Spiral(6, 18e-3, **turns),
    "circle": ca.RoundedSpiral(18e-3, 18e-3, corner_radius=9e-3, **turns),
    "rectangle": ca.RoundedSpiral(22e-3, 16e-3, corner_radius=2e-3, **turns),
    "racetrack": ca.RoundedSpiral(24e-3, 14e-3, corner_radius=7e-3, **turns),
}
figure, axes = plt.subplots(2, 2, figsize=(7, 6), layout="constrained")
for ax, (name, spiral) in zip(axes.flat, spirals.items(), strict=True):
    for line, colour in zip(spiral.coil().lines, ("tab:red", "tab:blue"), strict=True):  # one line a layer
        ax.plot(line[:, 0] * 1e3, line[:, 1] * 1e3, color=colour, linewidth=1)
    ax.set(title=name, aspect="equal", xlabel="x (mm)", ylabel="y (mm)")
