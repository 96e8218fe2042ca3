"""A response map over the board."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from coilarray.viz.datasets.elastomer import at_depth
from coilarray.viz.datasets.response import DELTA, draped_outlines, response_surface
from coilarray.viz.palette import INK
from coilarray.viz.scenes.scene import Part, Scene, symmetric

if TYPE_CHECKING:
    import xarray as xr

_RELIEF = 0.06  # of the map's longer side
_OVER, _ABOVE = 1e-3, 0.1e-3  # m of the map above the board, and of the outlines above the map


def scene_of_response(
    response: xr.Dataset,
    state: str,
    depth: int = -1,
    *,
    origin: tuple[float, float] = (0.0, 0.0),
    outlines: Sequence[npt.ArrayLike] = (),
) -> Scene:
    """Return δ of one state draped over the board, higher where it is larger, with the outlines of the coils on it.

    Parameters
    ----------
    response, state, depth, origin
        As in `coilarray.viz.datasets.response_surface`.
    outlines : sequence of array_like, shape (n, 2)
        Of the coils on the board in m.
    """
    side = float(max(np.ptp(response.x.values), np.ptp(response.y.values)))
    relief = _RELIEF * side
    surface = response_surface(response, state, depth, origin=origin, height=_OVER, relief=relief)
    scale = symmetric(DELTA, f"δ of {state}", "", surface.point_data[DELTA])
    group, colour = f"response of {state}", scale.typical_colour(surface.point_data[DELTA])
    parts = [Part("response", surface, group, colour, scale, opacity=0.9, ambient=0.6, diffuse=0.45)]
    lines = draped_outlines(response, state, outlines, depth, origin=origin, height=_OVER + _ABOVE, relief=relief)
    if lines.n_cells:
        parts.append(Part("outlines", lines, "outlines of the coils", INK, lit=False, line_width=2.0))
    deep = float(at_depth(response, depth).depth) * 1e3
    return Scene(tuple(parts), notes=(f"δ of {state} where the indenter is, {deep:g} mm deep.",))
