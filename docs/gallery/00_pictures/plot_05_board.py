"""
A board in three dimensions
===========================

The copper, the board and the elastomer sheets, which are lifted off.
"""

import pyvista

import coilarray as ca
from coilarray.viz import board_scene, draw

design = ca.load_design("gast2020")
plotter = pyvista.Plotter(window_size=(1600, 900))
draw(board_scene(design.array, design.sheets), plotter)
plotter.show()
