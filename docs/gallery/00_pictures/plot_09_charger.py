"""
A charger and its receiver
==========================

Lines of B of the charging coil through the coil of the receiver, which lies 3 mm above it. Between two lines of a
half-plane there is the same flux.
"""

# %%
# The receiver moves across the charger, and the coupling k is written beside it:
#
# .. film::
#
#    coilarray link charger --move receiver --x-mm -40:40:8 --film receiver.gif

import pyvista

import coilarray as ca
from coilarray.viz import View, draw, scene_of_design

design = ca.load_design("charger")
plotter = pyvista.Plotter(window_size=(1600, 900))
draw(scene_of_design(design, View(show=("board", "lines"), spacing=2e-3)), plotter)
plotter.show()
