"""
A bent board in three dimensions
================================

A strip of three coils around a finger of 8 mm radius. What is made stays flat; coils, fields and solids are bent.
"""

import math

import pyvista

import coilarray as ca
from coilarray.geometry import Bend, Zone
from coilarray.viz import board_scene, draw

strip = ca.Array.row(ca.Spiral(6, 10e-3, 6, 0.15e-3, 0.15e-3), 3, pitch=10.5e-3)
middle = strip.stackup.thickness / 2
finger = Bend((Zone(8e-3 + middle),), axis=math.pi / 2, neutral=-middle)
plotter = pyvista.Plotter(window_size=(1600, 900))
draw(board_scene(strip.bent(finger)), plotter)
plotter.show()
