"""
Eddy currents in a plate
========================

An aluminium plate 3 mm over the coils carries the mirror image of their currents. The arrows show the current per width
at the instant when it is strongest.
"""

from dataclasses import replace

import pyvista

import coilarray as ca
from coilarray.viz import View, draw, scene_of_design

design = ca.load_design("starter")
lid = ca.Plate("lid", 3e-3, 1e-3, ca.MATERIALS["aluminium"])
design = replace(design, sheets=(), indentation=None, plates=(lid,))
plotter = pyvista.Plotter(window_size=(1600, 900))
draw(scene_of_design(design, View(show=("board", "plates", "eddies"))), plotter, dark=True)
plotter.show()
