"""Responses between the positions and depths at which they were computed or measured.

Values are a tensor product of cubic splines, so that they and their derivatives cost the same everywhere, and the
derivatives are exact for the interpolated function:

    v(x, y, h) = Σ_ijk c_ijk B_i(x) B_j(y) B_k(h).

The depth may enter by its root with no slope at 0: every blunt or sharp body presses with a power of the depth of one
or more, so that a change begins with the second power of the root or a higher one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.interpolate import NdBSpline, make_interp_spline

from coilarray.compute.arrays import FloatArray
from coilarray.design.model import Design
from coilarray.response.setup import indentation_of

PARAMETERS = ("x", "y", "depth")
"""Unknowns of an indentation, in the order of every last axis of this package's arrays."""
LEAST_POSITIONS = 4
"""Fewest positions along x and along y that carry a cubic."""

_DEGREE = 3
_ROUNDING = 1e-12  # m


@dataclass(frozen=True, eq=False, kw_only=True)
class ResponseSpline:
    """Values over position and depth, with derivatives.

    `x`, `y` and `depth` are the coordinates in m, shape (n,) each, at which the response is known. A coordinate of one
    value is taken as known: then only the others are unknown, and that of a point has no effect. `spline` is over
    those that have more, over the root of the depth where `in_root` is set.
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
        """Numbers of the coordinates that are unknown, among x, y and depth: those of more than one value."""
        return [k for k, axis in enumerate((self.x, self.y, self.depth)) if len(axis) > 1]

    @property
    def unknowns(self) -> int:
        """Number of unknowns: 3 for x, y and depth, or 2 where the table has one depth."""
        return len(self.free)

    def outside(self, points: FloatArray) -> tuple[int, float] | None:
        """Return number and value in m of the first coordinate of points (…, 3) outside the table; None for none.

        A picometre beyond its edge is rounding, as of places counted from another origin.
        """
        free = self.free
        low, high = self.lower[free] - _ROUNDING, self.upper[free] + _ROUNDING
        inside = (points[..., free] >= low) & (points[..., free] <= high)
        if inside.all():
            return None
        return free[int(np.argwhere(~inside)[0][-1])], float(points[..., free][~inside][0])

    def values_at(self, points: FloatArray, axis: int | None = None) -> FloatArray:
        """Interpolate at points (…, 3) in m, or differentiate once by the unknown `axis`, as `free` counts them."""
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
    """Interpolate values (x, y, depth, …) along one axis after the other, at rising coordinates in m, shape (n,) each.

    Cubic in x and y, of one or at least 4 positions each, with C. de Boor's not-a-knot ends (A Practical Guide to
    Splines, ch. IV); in depth cubic from four planes on, with fewer the polynomial through them. `zero_plane` adds
    values of 0 at the depth 0 to a table of more than one depth that has no depth 0. `in_root` interpolates over the
    root of the
    depth, with no slope at the first one, which must be 0.
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
            ends: Any = ([(1, np.zeros(along.shape[1:]))], None)  # no slope; at the other end no knot next to it
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
    """Least and greatest x and y of all coils' outlines in m from the map's origin, shape (2, 2)."""
    return np.reshape(design.array.outline_bounds, (2, 2)) - indentation_of(design).origin_point


def even_row(start: float, stop: float, step: float) -> FloatArray:
    """Equal steps of at most `step` from one end to the other, for at least 4 positions."""
    return np.linspace(start, stop, max(LEAST_POSITIONS, math.ceil((stop - start) / step - 1e-9) + 1))
