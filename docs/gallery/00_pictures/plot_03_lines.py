"""
Field lines in three dimensions
===============================

Lines of B around the measured coil with its neighbours grounded. The view takes any of the items of
`coilarray view --show`.
"""

import pyvista

import coilarray as ca
from coilarray.viz import View, draw, scene_of_design

design = ca.load_design("starter")
plotter = pyvista.Plotter(window_size=(1600, 900))
draw(scene_of_design(design, View(show=("board", "lines"))), plotter)
plotter.show()
