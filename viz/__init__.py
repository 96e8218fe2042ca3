"""Pictures: datasets and scenes in three dimensions, and flat plots.

Importing it loads neither VTK nor Matplotlib; the first picture does.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

from coilarray.viz.datasets import barrel_mesh, board_mesh, copper_mesh, field_grid, path_lines, sheet_meshes
from coilarray.viz.offscreen import rendering_problem
from coilarray.viz.scenes import board_scene, save_board_picture, show_board

if TYPE_CHECKING:
    from coilarray.viz.plots import (
        plot_board,
        plot_copper,
        plot_currents,
        plot_effective_inductance,
        plot_field_lines,
        plot_field_map,
        plot_matrix,
    )
    from coilarray.viz.sweep_plots import plot_sweep

__all__ = [
    "barrel_mesh",
    "board_mesh",
    "board_scene",
    "copper_mesh",
    "field_grid",
    "path_lines",
    "plot_board",
    "plot_copper",
    "plot_currents",
    "plot_effective_inductance",
    "plot_field_lines",
    "plot_field_map",
    "plot_matrix",
    "plot_sweep",
    "rendering_problem",
    "save_board_picture",
    "sheet_meshes",
    "show_board",
]


def __getattr__(name: str) -> object:
    """Load the plots, and with them Matplotlib, when the first of them is asked for."""
    if name in __all__:
        module = "sweep_plots" if name == "plot_sweep" else "plots"
        return getattr(importlib.import_module(f"coilarray.viz.{module}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
