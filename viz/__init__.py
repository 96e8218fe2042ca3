"""Pictures: datasets and scenes in three dimensions, and flat plots.

Importing it loads neither VTK nor Matplotlib; the first picture does.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

from coilarray.viz.datasets import (
    arc_tubes,
    barrel_mesh,
    board_mesh,
    copper_mesh,
    coupling_arcs,
    dented_sheet_meshes,
    draped_outlines,
    field_arrows,
    field_grid,
    field_lines,
    field_surfaces,
    flux_density,
    indenter_mesh,
    path_lines,
    response_surface,
    sheet_meshes,
    uncertainty_ellipse,
)
from coilarray.viz.offscreen import rendering_problem, window_problem
from coilarray.viz.scenes import (
    Scene,
    board_scene,
    dent_scene,
    draw,
    save_board_picture,
    save_dent_picture,
    save_movie,
    save_page,
    save_picture,
    save_vtk,
    show,
    show_board,
)

if TYPE_CHECKING:
    from coilarray.viz.indentation_plots import indentation_figure, plot_dent, plot_force_depth
    from coilarray.viz.localize_plots import (
        distortion_figure,
        ellipse_parameter_figure,
        identifiability_figure,
        plot_causes,
        plot_distortion,
        plot_ellipse_parameters,
        plot_ellipses,
        plot_identifiability,
        plot_x_error,
    )
    from coilarray.viz.plots import (
        plot_board,
        plot_copper,
        plot_currents,
        plot_effective_inductance,
        plot_field_lines,
        plot_field_map,
        plot_matrix,
    )
    from coilarray.viz.response_plots import plot_response, plot_response_profile, response_figure
    from coilarray.viz.sweep_plots import plot_sweep

__all__ = [
    "Scene",
    "arc_tubes",
    "barrel_mesh",
    "board_mesh",
    "board_scene",
    "copper_mesh",
    "coupling_arcs",
    "dent_scene",
    "dented_sheet_meshes",
    "distortion_figure",
    "draped_outlines",
    "draw",
    "ellipse_parameter_figure",
    "field_arrows",
    "field_grid",
    "field_lines",
    "field_surfaces",
    "flux_density",
    "identifiability_figure",
    "indentation_figure",
    "indenter_mesh",
    "path_lines",
    "plot_board",
    "plot_causes",
    "plot_copper",
    "plot_currents",
    "plot_dent",
    "plot_distortion",
    "plot_effective_inductance",
    "plot_ellipse_parameters",
    "plot_ellipses",
    "plot_field_lines",
    "plot_field_map",
    "plot_force_depth",
    "plot_identifiability",
    "plot_matrix",
    "plot_response",
    "plot_response_profile",
    "plot_sweep",
    "plot_x_error",
    "rendering_problem",
    "response_figure",
    "response_surface",
    "save_board_picture",
    "save_dent_picture",
    "save_movie",
    "save_page",
    "save_picture",
    "save_vtk",
    "sheet_meshes",
    "show",
    "show_board",
    "uncertainty_ellipse",
    "window_problem",
]

_HOME = {
    "indentation_plots": ("indentation_figure", "plot_dent", "plot_force_depth"),
    "localize_plots": (
        "distortion_figure",
        "ellipse_parameter_figure",
        "identifiability_figure",
        "plot_causes",
        "plot_distortion",
        "plot_ellipse_parameters",
        "plot_ellipses",
        "plot_identifiability",
        "plot_x_error",
    ),
    "response_plots": ("plot_response", "plot_response_profile", "response_figure"),
    "sweep_plots": ("plot_sweep",),
}


def __getattr__(name: str) -> object:
    """Load the plots, and with them Matplotlib, when the first of them is asked for."""
    if name in __all__:
        module = next((home for home, names in _HOME.items() if name in names), "plots")
        return getattr(importlib.import_module(f"coilarray.viz.{module}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
