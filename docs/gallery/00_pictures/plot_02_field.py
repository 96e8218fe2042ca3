"""
B of one coil over its grounded neighbours
==========================================

|B| on an upright plane through the middle of the measured coil, with contours at 1, 2 and 5 times powers of ten. The
neighbours are grounded, and their currents push the field back.
"""

import pyvista

import coilarray as ca
from coilarray.viz import View, draw, scene_of_design

design = ca.load_design("gast2020")
plotter = pyvista.Plotter(window_size=(1600, 900))
draw(scene_of_design(design, View(show=("board", "field"), coil="coil3")), plotter)
plotter.show()
