"""
Coupling as arcs
================

An arc joins every pair of coils. Its thickness and its number show k, its colour the sign.
"""

import pyvista

import coilarray as ca
from coilarray.viz import View, draw, scene_of_design

design = ca.load_design("gast2020")
plotter = pyvista.Plotter(window_size=(1600, 900))
draw(scene_of_design(design, View(show=("board", "coupling"))), plotter)
plotter.show()
