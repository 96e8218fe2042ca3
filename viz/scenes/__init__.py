"""Scenes: what is drawn, in which colour, seen from where; and what shows them: pictures, windows, films and pages.

`coilarray.viz.scenes.of_design` and `coilarray.viz.scenes.touch` compute scenes of a design; they load the physics, and
are not loaded here.
"""

from coilarray.viz.scenes.board import CoilColours, board_scene, scene_of_board, scene_of_lifted_board, scene_of_sheets
from coilarray.viz.scenes.camera import Side
from coilarray.viz.scenes.coupling import colours_of_currents, scene_of_coupling
from coilarray.viz.scenes.dent import dent_scene, scene_of_dent
from coilarray.viz.scenes.draw import draw, draw_parts
from coilarray.viz.scenes.field import scale_of_field, scene_of_lines, scene_of_slices, scene_of_surfaces
from coilarray.viz.scenes.location import scene_of_location
from coilarray.viz.scenes.movie import check_movie, save_movie
from coilarray.viz.scenes.page import check_page, save_page
from coilarray.viz.scenes.paraview import save_vtk
from coilarray.viz.scenes.pictures import check_rendering, save_board_picture, save_dent_picture, save_picture
from coilarray.viz.scenes.response import scene_of_response
from coilarray.viz.scenes.scene import Part, Scale, Scene, Text
from coilarray.viz.scenes.window import check_window, show, show_board

__all__ = [
    "CoilColours",
    "Part",
    "Scale",
    "Scene",
    "Side",
    "Text",
    "board_scene",
    "check_movie",
    "check_page",
    "check_rendering",
    "check_window",
    "colours_of_currents",
    "dent_scene",
    "draw",
    "draw_parts",
    "save_board_picture",
    "save_dent_picture",
    "save_movie",
    "save_page",
    "save_picture",
    "save_vtk",
    "scale_of_field",
    "scene_of_board",
    "scene_of_coupling",
    "scene_of_dent",
    "scene_of_lifted_board",
    "scene_of_lines",
    "scene_of_location",
    "scene_of_response",
    "scene_of_sheets",
    "scene_of_slices",
    "scene_of_surfaces",
    "show",
    "show_board",
]
