"""
A dent in three dimensions
==========================

The deformed sheets over a coil, a quarter cut out.
"""

import pyvista

import coilarray as ca
from coilarray.viz import dent_scene, draw

design = ca.load_design("gast2020")
setup = design.indentation
pressed = ca.indent(design.sheets, setup.indenter, [1e-3], base=setup.base)
plotter = pyvista.Plotter(window_size=(1600, 900))
centre = tuple(design.array.centres[2])
draw(dent_scene(design.array, design.sheets, pressed, setup.indenter, centre=centre), plotter, side="cut")
plotter.show()
