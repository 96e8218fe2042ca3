"""
Where is it, and how deep?
==========================

A forward model of the board, one reading with noise, and every position that explains it, with its uncertainty.
"""

import numpy as np

import coilarray as ca

design = ca.load_design("gast2020")
depths = [0.4e-3, 0.6e-3, 0.8e-3, 1e-3]
x, y = np.linspace(-26e-3, 26e-3, 27), np.linspace(-10e-3, 10e-3, 11)
table = ca.response_map(design, depths=depths, x=x, y=y)
model = ca.forward_model(table)
truth = ca.response_map(design, depths=[0.7e-3], x=[5e-3], y=[3e-3])
reading = {str(state): float(truth.delta.sel(state=state).squeeze()) for state in truth.state.values}
location = ca.locate(model, reading, noise=1e-6)
for mode in location.modes:
    print(f"x {mode.x * 1e3:.2f} mm, y {mode.y * 1e3:.2f} mm, depth {mode.depth * 1e3:.3f} mm")
