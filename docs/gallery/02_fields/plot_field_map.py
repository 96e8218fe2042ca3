"""
A map of B above the board
==========================

The vertical flux density 4 mm above the board, per ampere in coil 1.
"""

import numpy as np

import coilarray as ca
from coilarray.viz import plot_field_map

design = ca.load_design("starter")
coupling = ca.couple_design(design)
x_min, y_min, x_max, y_max = design.array.bounds
x, y = np.linspace(x_min, x_max, 120), np.linspace(y_min, y_max, 80)
field = ca.operating_field(design, coupling, "coil1", x, y, 4e-3)
plot_field_map(field, outlines=[place.to_board(place.coil.outline) for place in design.array.placements])
