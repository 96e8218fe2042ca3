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
    from coilarray.viz.plots.board import plot_board, plot_copper
    from coilarray.viz.plots.check import check_figure
    from coilarray.viz.plots.comparison import comparison_figure, plot_centres, plot_readings, plot_residual
    from coilarray.viz.plots.coupling import (
        plot_coupling,
        plot_currents,
        plot_effective_inductance,
        plot_inductance,
        plot_matrix,
    )
    from coilarray.viz.plots.field import plot_field_lines, plot_field_map
    from coilarray.viz.plots.frequency import plot_frequency_sweep
    from coilarray.viz.plots.indentation import indentation_figure, plot_dent, plot_force_depth
    from coilarray.viz.plots.localize import (
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
    from coilarray.viz.plots.optimize import (
        boards_figure,
        plot_convergence,
        plot_front,
        plot_importance,
        plot_pareto,
        plot_search,
    )
    from coilarray.viz.plots.response import plot_bell_curve, plot_response, plot_response_profile, response_figure
    from coilarray.viz.plots.sweep_grid import (
        plot_coupling_sweep,
        plot_sweep_lines,
        plot_sweep_map,
        plot_sweep_points,
        sweep_figure,
    )
    from coilarray.viz.plots.tolerance import plot_boards, plot_shares, tolerance_figure

__all__ = [
    "Scene",
    "arc_tubes",
    "barrel_mesh",
    "board_mesh",
    "board_scene",
    "boards_figure",
    "check_figure",
    "comparison_figure",
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
    "plot_bell_curve",
    "plot_board",
    "plot_boards",
    "plot_causes",
    "plot_centres",
    "plot_convergence",
    "plot_copper",
    "plot_coupling",
    "plot_coupling_sweep",
    "plot_currents",
    "plot_dent",
    "plot_distortion",
    "plot_effective_inductance",
    "plot_ellipse_parameters",
    "plot_ellipses",
    "plot_field_lines",
    "plot_field_map",
    "plot_force_depth",
    "plot_frequency_sweep",
    "plot_front",
    "plot_identifiability",
    "plot_importance",
    "plot_inductance",
    "plot_matrix",
    "plot_pareto",
    "plot_readings",
    "plot_residual",
    "plot_response",
    "plot_response_profile",
    "plot_search",
    "plot_shares",
    "plot_sweep_lines",
    "plot_sweep_map",
    "plot_sweep_points",
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
    "sweep_figure",
    "tolerance_figure",
    "uncertainty_ellipse",
    "window_problem",
]

_HOME = {
    "plots.board": ("plot_board", "plot_copper"),
    "plots.check": ("check_figure",),
    "plots.comparison": ("comparison_figure", "plot_centres", "plot_readings", "plot_residual"),
    "plots.coupling": ("plot_coupling", "plot_currents", "plot_effective_inductance", "plot_inductance", "plot_matrix"),
    "plots.field": ("plot_field_lines", "plot_field_map"),
    "plots.frequency": ("plot_frequency_sweep",),
    "plots.indentation": ("indentation_figure", "plot_dent", "plot_force_depth"),
    "plots.localize": (
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
    "plots.optimize": (
        "boards_figure",
        "plot_convergence",
        "plot_front",
        "plot_importance",
        "plot_pareto",
        "plot_search",
    ),
    "plots.response": ("plot_bell_curve", "plot_response", "plot_response_profile", "response_figure"),
    "plots.sweep_grid": (
        "plot_coupling_sweep",
        "plot_sweep_lines",
        "plot_sweep_map",
        "plot_sweep_points",
        "sweep_figure",
    ),
    "plots.tolerance": ("plot_boards", "plot_shares", "tolerance_figure"),
}


def __getattr__(name: str) -> object:
    """Load a plot, and with it Matplotlib, when it is asked for."""
    for module, names in _HOME.items():
        if name in names:
            return getattr(importlib.import_module(f"coilarray.viz.{module}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
