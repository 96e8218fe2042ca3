"""
Where is it, and how deep?
==========================

One reading of the six coils, and the positions that explain it. There are two, because coils in a row cannot
distinguish their two sides. The black cross is the true position.
"""

import matplotlib.pyplot as plt
import numpy as np

import coilarray as ca
from coilarray.viz import plot_board

design = ca.load_design("gast2020")
depths = [0.4e-3, 0.6e-3, 0.8e-3, 1e-3]
x, y = np.linspace(-26e-3, 26e-3, 27), np.linspace(-10e-3, 10e-3, 11)
table = ca.response_map(design, depths=depths, x=x, y=y)
model = ca.forward_model(table)
truth = ca.response_map(design, depths=[0.7e-3], x=[5e-3], y=[3e-3])
reading = {str(state): float(truth.delta.sel(state=state).squeeze()) for state in truth.state.values}
location = ca.locate(model, reading, noise=1e-6)
figure, ax = plt.subplots(figsize=(8, 4), layout="constrained")
plot_board(design.array, ax).get_legend().remove()
ax.plot(5, 3, "k+", markersize=14)
for mode, colour in zip(location.modes, ("C3", "C4"), strict=True):
    (x, y, depth), (dx, dy, d_depth) = np.multiply((mode.x, mode.y, mode.depth), 1e3), mode.deviations * 1e3
    said = f"x {x:.2f} ± {dx:.2f} mm, y {y:.2f} ± {dy:.2f} mm, depth {depth:.2f} ± {d_depth:.2f} mm"
    ax.errorbar(x, y, dy, dx, "o", color=colour, label=said.replace("-", "−"))
figure.legend(loc="outside lower center")
