"""
Two-dimensional model against the full one
==========================================

In a two-dimensional model the dent is as long as the coil, and δ is more than twice as large.
"""

import matplotlib.pyplot as plt
import numpy as np

import coilarray as ca
from coilarray.paper.two_dimensional import line_response

design = ca.load_design("gast_fem")
x = np.linspace(-15e-3, 15e-3, 31)
line = line_response(design, depths=[1e-3], x=x)
full = ca.response_map(design, depths=[1e-3], x=x, y=[0.0])
figure, ax = plt.subplots(figsize=(7, 4), layout="constrained")
ax.plot(x * 1e3, np.ravel(line.delta) * 1e4, label="two dimensions")
ax.plot(x * 1e3, np.ravel(full.delta.isel(state=0)) * 1e4, label="three dimensions")
ax.set(xlabel="x (mm)", ylabel="δ ($10^{-4}$)")
ax.legend()
