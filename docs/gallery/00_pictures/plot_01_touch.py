"""
A touch that the coils feel
===========================

A ball is pressed into the magnetic elastomer and moves along the board. The copper has the colour of δ, the relative
change of each coil's inductance, and its number stands under the coil. The dent is drawn three times as deep as it is.
The picture shows B of the middle coil with it.
"""

# %%
# The whole film is one command:
#
# .. film::
#
#    coilarray view starter --out touch.gif

import pyvista

import coilarray as ca
from coilarray.viz import View, draw, scene_of_design

design = ca.load_design("starter")
plotter = pyvista.Plotter(window_size=(1600, 900))
draw(scene_of_design(design, View(show=("board", "dent", "field"), at=(5.5e-3, 0.0))), plotter)
plotter.show()
