"""Interpolation of responses over position and depth.

The interpolant is a tensor product of cubic splines, with exact derivatives. The depth may enter by
its root, with zero slope at 0. Every blunt or sharp body presses with a power of the depth of at
least 1, so that a change begins with the second power of the root or a higher power.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.interpolate import NdBSpline, make_interp_spline

from coilarray.compute.arrays import FloatArray
from coilarray.design.model import Design
from coilarray.response.setup import indentation_of

PARAMETERS = ("x", "y", "depth")  # unknowns of an indentation in the order of the last axis of this package's arrays
LEAST_POSITIONS = 4  # fewest positions along x and along y for a cubic

_DEGREE = 3
_ROUNDING = 1e-12  # m


@dataclass(frozen=True, eq=False, kw_only=True)
class ResponseSpline:
    """Values over position and depth, with derivatives.

    A coordinate (n,) in m with a single value has no effect at a point. `spline` is over the other
    coordinates, and over the root of the depth if `in_root` is set.
    """

    x: FloatArray
    y: FloatArray
    depth: FloatArray
    spline: NdBSpline
    in_root: bool = False

    @property
    def lower(self) -> FloatArray:
        """Least x, y and depth in m, shape (3,)."""
        return np.array([self.x[0], self.y[0], self.depth[0]])

    @property
    def upper(self) -> FloatArray:
        """Greatest x, y and depth in m, shape (3,)."""
        return np.array([self.x[-1], self.y[-1], self.depth[-1]])

    @property
    def free(self) -> list[int]:
        """Numbers of the coordinates with more than one value."""
        return [k for k, axis in enumerate((self.x, self.y, self.depth)) if len(axis) > 1]

    @property
    def unknowns(self) -> int:
        """Number of unknowns, 2 if the table has one depth."""
        return len(self.free)

    def outside(self, points: FloatArray) -> tuple[int, float] | None:
        """Return the first coordinate outside the table, and its value.

        Points (…, 3) are in m. A picometre beyond the edge counts as rounding, as for places
        counted from another origin.
        """
        free = self.free
        low, high = self.lower[free] - _ROUNDING, self.upper[free] + _ROUNDING
        inside = (points[..., free] >= low) & (points[..., free] <= high)
        if inside.all():
            return None
        return free[int(np.argwhere(~inside)[0][-1])], float(points[..., free][~inside][0])

    def values_at(self, points: FloatArray, axis: int | None = None) -> FloatArray:
        """Interpolate at points (…, 3), or differentiate by an unknown."""
        orders = np.zeros(self.unknowns, dtype=int)
        if axis is not None:
            orders[axis] = 1
        at = np.clip(points[..., self.free], self.lower[self.free], self.upper[self.free])
        if self.in_root:
            at[..., -1] = np.sqrt(at[..., -1])
        return np.asarray(self.spline(at, nu=orders))


def response_spline(
    x: FloatArray, y: FloatArray, depth: FloatArray, values: FloatArray, *, zero_plane: bool, in_root: bool = False
) -> ResponseSpline:
    """Interpolate values (x, y, depth, …) by cubic splines.

    In x and y, with one or at least 4 positions each, the spline has C. de Boor's not-a-knot ends
    (A Practical Guide to Splines, ch. IV). In depth it is cubic from four planes on, else the
    polynomial through them. `zero_plane` adds 0 at the depth 0. `in_root` interpolates over the
    root of the depth.
    """
    if zero_plane and len(depth) > 1 and depth[0] > 0:
        depth = np.concatenate(([0.0], depth))
        values = np.concatenate((np.zeros_like(values[:, :, :1]), values), axis=2)
    axes = [x, y, np.sqrt(depth) if in_root else depth]
    known = tuple(k for k, axis in enumerate(axes) if len(axis) == 1)
    axes, values = [axis for axis in axes if len(axis) > 1], values.squeeze(known)
    knots, degrees = [], []
    for k, axis in enumerate(axes):
        along = np.moveaxis(values, k, 0)
        if in_root and k == len(axes) - 1:
            ends: Any = ([(1, np.zeros(along.shape[1:]))], None)  # zero slope. Not-a-knot at the other end
            t = np.concatenate((np.repeat(axis[0], _DEGREE), axis[:-2], np.repeat(axis[-1], _DEGREE + 1)))
            spline = make_interp_spline(axis, along, k=_DEGREE, t=t, bc_type=ends)
        else:
            spline = make_interp_spline(axis, along, k=min(_DEGREE, len(axis) - 1))
        values = np.moveaxis(spline.c, 0, k)
        knots.append(spline.t)
        degrees.append(spline.k)
    tensor = NdBSpline(tuple(knots), np.ascontiguousarray(values), tuple(degrees))
    return ResponseSpline(x=x, y=y, depth=depth, spline=tensor, in_root=in_root)


def coil_extent(design: Design) -> FloatArray:
    """Extent (2, 2) of all coils from the map's origin."""
    return np.reshape(design.array.outline_bounds, (2, 2)) - indentation_of(design).origin_point


def even_row(start: float, stop: float, step: float) -> FloatArray:
    """Return at least 4 even positions, at most `step` apart."""
    return np.linspace(start, stop, max(LEAST_POSITIONS, math.ceil((stop - start) / step - 1e-9) + 1))
