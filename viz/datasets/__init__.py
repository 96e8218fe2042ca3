"""Datasets for pictures: the model's solids, paths and fields as PyVista meshes, with no window and no colours.

Every coordinate of a dataset is in mm, because people read pictures of boards in mm; the values of its arrays stay in
SI and their names say the unit, as in ``"B (T)"``. PyVista is imported when the first dataset is made.
"""

from coilarray.viz.datasets.board import (
    barrel_mesh,
    board_mesh,
    copper_mesh,
    outline_lines,
    path_lines,
    with_coil_values,
)
from coilarray.viz.datasets.coupling import arc_tubes, coupling_arcs
from coilarray.viz.datasets.elastomer import (
    at_depth,
    dented_sheet_meshes,
    indenter_mesh,
    indenter_outline,
    sheet_meshes,
)
from coilarray.viz.datasets.field import (
    field_arrows,
    field_grid,
    field_lines,
    field_surfaces,
    flux_density,
    require_memory,
)
from coilarray.viz.datasets.location import position_pin, uncertainty_ellipse
from coilarray.viz.datasets.response import draped_outlines, response_surface
from coilarray.viz.datasets.triangles import MM_PER_M, solid_mesh

__all__ = [
    "MM_PER_M",
    "arc_tubes",
    "at_depth",
    "barrel_mesh",
    "board_mesh",
    "copper_mesh",
    "coupling_arcs",
    "dented_sheet_meshes",
    "draped_outlines",
    "field_arrows",
    "field_grid",
    "field_lines",
    "field_surfaces",
    "flux_density",
    "indenter_mesh",
    "indenter_outline",
    "outline_lines",
    "path_lines",
    "position_pin",
    "require_memory",
    "response_surface",
    "sheet_meshes",
    "solid_mesh",
    "uncertainty_ellipse",
    "with_coil_values",
]
