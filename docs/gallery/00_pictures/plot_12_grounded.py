"""
Neighbours open, grounded, and the difference
=============================================

B_z over the board while the third coil is measured. Grounding the other coils induces currents in them, whose field is
the difference of the two maps.
"""

import matplotlib.pyplot as plt
import numpy as np

import coilarray as ca
from coilarray.viz import plot_field_map

design = ca.load_design("gast2020")
coupling = ca.couple_design(design)
x, y = np.linspace(-40e-3, 28e-3, 137), np.linspace(-15e-3, 15e-3, 61)
open_, grounded = (
    ca.operating_field(design, coupling, "coil3", x, y, 3e-3, terminated=closed) for closed in (False, True)
)
difference = grounded.assign(B=(grounded.B - open_.B).assign_attrs(grounded.B.attrs))
outlines = [place.to_board(place.coil.outline) for place in design.array.placements]
figure, axes = plt.subplots(3, 1, figsize=(7, 9), layout="constrained")
titles = ("others open", "others grounded", "difference")
for ax, field, title in zip(axes, (open_, grounded, difference), titles, strict=True):
    plot_field_map(field, ax, outlines=outlines)
    ax.set_title(title, loc="left")
