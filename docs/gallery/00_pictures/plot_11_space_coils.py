"""
Wire coils in space
===================

A solenoid, a Helmholtz pair, a saddle, a toroid, a coil on a rectangular former and a twisted pair, each at its own
size. Every one is a current path, or two, that field, inductance and forces take.
"""

import math

import pyvista

from coilarray.geometry import Pose, helix, helmholtz_pair, saddle, solenoid, toroid, twisted_pair

former = [(-9e-3, -5e-3), (9e-3, -5e-3), (9e-3, 5e-3), (-9e-3, 5e-3)]
coils = [
    [solenoid(diameter=16e-3, length=24e-3, turns=14, wire=1e-3)],
    helmholtz_pair(radius=12e-3, wire=1.2e-3, turns=4),
    [saddle(radius=8e-3, length=24e-3, angle=2 * math.pi / 3, wire=1.2e-3)],
    [toroid(radius=10e-3, section_radius=4e-3, turns=30, wire=0.6e-3)],
    [helix(former, turns=8, pitch=2e-3, wire=1e-3)],
    [
        path.posed(Pose(x=-14e-3, turn=(0, math.pi / 2, 0)))
        for path in twisted_pair(28e-3, 2e-3, pitch=8e-3, wire=1.2e-3)
    ],
]
plotter = pyvista.Plotter(window_size=(1600, 900))
for number, paths in enumerate(coils):
    place = Pose(x=38e-3 * (number % 3), y=-44e-3 * (number // 3))
    for path in paths:
        line = pyvista.MultipleLines(place.apply(path.vertices))
        wire = math.sqrt(4 / math.pi * path.areas[0])
        plotter.add_mesh(line.tube(radius=wire / 2, n_sides=24), color="#b87333", smooth_shading=True, specular=0.6)
plotter.camera_position = [(0.045, -0.16, 0.12), (0.038, -0.022, 0.0), (0.0, 0.0, 1.0)]
plotter.camera.zoom(1.35)
plotter.show()
