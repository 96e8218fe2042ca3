"""Table of the inductance changes by an indentation.

It has the change of a board's inductance matrix at any position, stored and interpolated.
"""

from __future__ import annotations

import numpy as np
import xarray as xr

from coilarray.compute.arrays import FloatArray
from coilarray.compute.store import Store
from coilarray.compute.threads import Progress
from coilarray.design.model import Design, Indentation
from coilarray.errors import HardwareError
from coilarray.hardware.emulator.indenter import Place
from coilarray.response.interpolation import (
    LEAST_POSITIONS,
    PARAMETERS,
    ResponseSpline,
    coil_extent,
    even_row,
    response_spline,
)
from coilarray.response.map import inductance_changes
from coilarray.response.setup import map_axes

SPACING = 1.2e-3
"""Largest distance of positions in m. For gast2020 the table's inductances are then wrong by 7e-7 (root of the mean
square) and at most 2e-6 at 1 mm depth, where they change by up to 1.5e-3 (tests/hardware/test_emulator_world.py)."""
_PLANES = 6
_DEEPEST = 1.7  # relative to the deepest indentation of the design


class ResponseTable:
    """Changes of the inductance matrix over position and depth.

    They are known at coordinates x, y and depth in m from the map's origin, each of shape (n,). `change`, shape (depth,
    y, x, coil, coil), is the inductance in H, dented minus flat. `origin` is the map's origin on the board in m.
    """

    def __init__(
        self,
        x: FloatArray,
        y: FloatArray,
        depth: FloatArray,
        change: FloatArray,
        origin: tuple[float, float] = (0.0, 0.0),
    ) -> None:
        self._origin = (*origin, 0.0)
        values = change.transpose(2, 1, 0, 3, 4)
        self.spline: ResponseSpline = response_spline(x, y, depth, values, zero_plane=True, in_root=True)

    def check(self, place: Place) -> None:
        """Refuse a place outside the table.

        It raises a HardwareError for a coordinate outside its range.
        """
        outside = self.spline.outside(np.array(place))
        if outside is not None:
            axis, value = outside
            edges = (self.spline.lower[axis], self.spline.upper[axis], value)
            low, high, got = ((self._origin[axis] + edge) * 1e3 for edge in edges)
            where = " on the board" if axis < 2 else ""
            raise HardwareError(
                f"{PARAMETERS[axis]} of the emulated indenter must be {low:.4g} to {high:.4g} mm{where}; "
                f"got {got:.4g} mm."
            )

    def at(self, place: Place) -> FloatArray:
        """Return the change of the inductance matrix in H.

        The place is in the table. The shape is (coils, coils).
        """
        return self.spline.values_at(np.array(place))


def table_axes(design: Design) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Choose the axes of the table in m.

    They are depth, y and x, each of the shape (n,). x and y are at most `SPACING` apart. The axes cover all coils and
    all positions of the design's own map, down to 1.7 times its depth. For a sample with edges they are only the map's
    positions and depth. A design without an indentation raises a HardwareError.
    """
    setup = _setup(design)
    edges = np.array([[min(setup.x), min(setup.y)], [max(setup.x), max(setup.y)]])
    deepest = max(setup.depths)
    if setup.sample_bounds is None:
        deepest *= _DEEPEST
        edges = np.concatenate((edges, coil_extent(design)))
    (x_min, y_min), (x_max, y_max) = edges.min(axis=0), edges.max(axis=0)
    depth = deepest * (np.arange(1, _PLANES + 1) / _PLANES) ** 1.5
    return depth, even_row(y_min, y_max, SPACING), even_row(x_min, x_max, SPACING)


def response_table(
    design: Design,
    store: Store,
    axes: tuple[FloatArray, FloatArray, FloatArray] | None = None,
    *,
    frequency: float | None = None,
    progress: Progress | None = None,
) -> ResponseTable:
    """Return the response table of a design.

    It is computed if the store does not have it, which takes 12 s for gast2020. `axes` are depth, y and x in m, at
    least 3 of the first and 4 of the others. The default is `table_axes`. The material of an indenter counts at a
    `frequency` in Hz. Its losses do not count.

    Raises
    ------
    HardwareError
        A design without an indentation, or axes that carry no cubic.
    ElastomerError
        A sample that `coilarray.response.map.inductance_changes` refuses.
    """
    origin = _setup(design).origin_point
    depth, y, x = table_axes(design) if axes is None else axes
    if min(len(y), len(x)) < LEAST_POSITIONS or len(depth) < LEAST_POSITIONS - 1:
        raise HardwareError("a table of the response needs 4 positions along x and y and 3 depths.")

    def compute() -> xr.Dataset:
        change = inductance_changes(design, map_axes(design, depth, x, y), frequency=frequency, progress=progress)
        dims = ("depth", "y", "x", "coil", "other")
        return xr.Dataset({"inductance_change": (dims, change, {"units": "H"})})

    table = store.dataset(("response table", design.digest, depth, y, x, frequency), compute)
    return ResponseTable(x, y, depth, table.inductance_change.values, origin)


def _setup(design: Design) -> Indentation:
    if design.indentation is None:
        raise HardwareError(f"the design {design.name} has no [indenter] and [indentation]; nothing can press on it.")
    return design.indentation
