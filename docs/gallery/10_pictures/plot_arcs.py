"""
Coupling as arcs
================

Every pair of coils joined by an arc, as thick as k is large and coloured by its sign.
"""

import pyvista

import coilarray as ca
from coilarray.viz import draw
from coilarray.viz.scenes.of_design import View, scene_of_design

design = ca.load_design("gast2020")
plotter = pyvista.Plotter(window_size=(900, 500))
draw(scene_of_design(design, View(show=("board", "coupling"))), plotter)
plotter.show()
