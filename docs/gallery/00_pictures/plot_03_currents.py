"""
Currents that a measured coil induces
=====================================

The third coil is measured, the others are grounded. The colour of their copper is the current per ampere in the
measured coil, and the arrows show which way it flows: against it where the coupling k is positive, with it where k is
negative.
"""

import pyvista

import coilarray as ca
from coilarray.viz import View, draw, scene_of_design

design = ca.load_design("gast2020")
plotter = pyvista.Plotter(window_size=(1600, 900))
draw(scene_of_design(design, View(show=("currents",), coil="coil3")), plotter)
plotter.show()
