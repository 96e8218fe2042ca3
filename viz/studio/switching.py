"""Switch states chosen by hand.

Measured, grounded and open coils, the readings of the converter, and the field.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, get_args

import numpy as np
import numpy.typing as npt

from coilarray.compute.arrays import FloatArray
from coilarray.design.model import Design
from coilarray.design.scan_states import ScanState
from coilarray.electromagnetics.field import grid_points, magnetic_field
from coilarray.errors import NetworkError
from coilarray.geometry.array import Array
from coilarray.viz.datasets.field import flux_grid, require_memory
from coilarray.viz.scenes.field import Span

if TYPE_CHECKING:
    import pyvista


Setting = Literal["measure", "ground", "open"]
"""Connection of a coil."""

SETTINGS: tuple[Setting, ...] = get_args(Setting)
SPACING = 1e-3
"""Default distance of the points on the plane of the field in m."""


@dataclass(frozen=True, eq=False)
class UnitFields:
    """B of one ampere in every coil alone.

    B is on a horizontal plane. Lengths are in m.
    """

    x: FloatArray  # shape (nx,)
    y: FloatArray  # shape (ny,)
    height: float  # height of the plane above the board
    fields: FloatArray  # T/A, shape (coils, nx, ny, 1, 3)

    def plane(self, currents: npt.ArrayLike) -> pyvista.RectilinearGrid:
        """Field of currents in A, shape (coils,).

        It is given in the form of `coilarray.viz.flux_density`.
        """
        B = np.tensordot(np.asarray(currents, dtype=np.float64), self.fields, axes=1)
        return flux_grid(self.x, self.y, [self.height], B)


def kept_settings(array: Array, settings: Mapping[str, Setting]) -> dict[str, Setting]:
    """Keep settings for other coils.

    Coils that still exist keep their setting. If no coil is measured, the middle coil is.
    """
    kept: dict[str, Setting] = {name: settings.get(name, "ground") for name in array.names}
    return kept if "measure" in kept.values() else {**dict.fromkeys(kept, "ground"), array.middle_coil: "measure"}


def state_of(settings: Mapping[str, Setting]) -> ScanState:
    """State of the multiplexer.

    Several measured coils are in series. Without a measured coil it raises a NetworkError.

    Examples
    --------
    >>> state = state_of({"a": "measure", "b": "open", "c": "ground"})
    >>> state.measured, state.others, state.exceptions
    ((('a', 1),), 'ground', {'b': 'open'})
    """
    measured = tuple((name, 1) for name, setting in settings.items() if setting == "measure")
    if not measured:
        raise NetworkError("at least one coil must be measured.")
    opened = [name for name, setting in settings.items() if setting == "open"]
    name = " + ".join(name for name, _ in measured)
    return ScanState(name, measured, others="ground", exceptions=dict.fromkeys(opened, "open"))


def unit_fields(design: Design, spacing: float = SPACING) -> UnitFields:
    """Compute B of every coil on a plane.

    The plane is at the design's field height. Too many points raise a GeometryError.
    """
    x_min, y_min, x_max, y_max = design.array.bounds
    x, y = Span(x_min, x_max, spacing), Span(y_min, y_max, spacing)
    conductors = design.array.conductors()
    require_memory(x.count * y.count * len(conductors), f"a spacing of {spacing * 1e3:g} mm")
    points = grid_points(x.points, y.points, design.field_height)
    fields = np.stack([magnetic_field([conductor], points) for conductor in conductors])
    return UnitFields(x.points, y.points, design.field_height, fields)
