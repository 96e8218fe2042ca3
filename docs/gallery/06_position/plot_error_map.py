"""
How accurate is a position?
===========================

The least standard deviation of x and y that any unbiased method can reach (the Cramér–Rao bound), over the board, at a
known depth and the noise of the readings. Grey: no information.
"""

import numpy as np

import coilarray as ca
from coilarray.localize.identifiability import identifiability
from coilarray.report.page import map_outlines
from coilarray.viz import identifiability_figure

design = ca.load_design("gast2020")
first, last = design.array.centres[[0, -1], 0] - design.indentation.origin_point[0]  # places count from a coil
table = ca.response_map(design, depths=[1e-3], x=np.linspace(first, last, 34), y=np.linspace(-12e-3, 12e-3, 13))
bounds = identifiability(ca.forward_model(table), 1e-3, noise=1e-5)
identifiability_figure(bounds, map_outlines(design, table))
