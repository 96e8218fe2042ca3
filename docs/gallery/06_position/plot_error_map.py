"""
How well is a position known?
=============================

The least standard deviation of x and y that any method can reach (the Cramér–Rao bound), over the board, at a known
depth and the noise of the readings. Grey: no information.
"""

import numpy as np

import coilarray as ca
from coilarray.localize.identifiability import identifiability
from coilarray.viz import identifiability_figure

design = ca.load_design("gast2020")
table = ca.response_map(design, depths=[1e-3], x=np.linspace(-40e-3, 40e-3, 41), y=np.linspace(-12e-3, 12e-3, 13))
bounds = identifiability(ca.forward_model(table), 1e-3, noise=1e-5)
identifiability_figure(bounds, [place.to_board(place.coil.outline) for place in design.array.placements])
