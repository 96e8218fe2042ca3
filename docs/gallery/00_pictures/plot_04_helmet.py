"""
A helmet of receive loops
=========================

Sixteen loops wrapped onto a dome, where neighbours overlap on other levels. Colours are their levels.
"""

import pyvista

import coilarray as ca

design = ca.load_design("helmet")
dome = design.array.form.carrier
plotter = pyvista.Plotter(window_size=(1600, 900))
plotter.add_mesh(pyvista.make_tri_mesh(dome.vertices * 1e3, dome.faces), color="#d8d2c8", smooth_shading=True)
colours = ["#1b6ca8", "#c8553d", "#3a7d44", "#8a5fa8", "#b8860b"]
for board in design.placed:
    level = round((board.array.form.height - board.array.stackup.thickness) / 1e-3)
    (path,) = board.conductors()
    plotter.add_mesh(pyvista.lines_from_points(path.vertices * 1e3).tube(radius=1.2), color=colours[level])
plotter.camera_position = "yz"
plotter.camera.azimuth = 40
plotter.camera.elevation = 25
plotter.camera.zoom(1.3)
plotter.show()
