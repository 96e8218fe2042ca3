"""Forward model: δ of every state as a smooth function of where the indenter is and how deep it presses.

A response dataset is a table over x, y and depth. Between its positions δ is a tensor product of cubic splines, so that
values and derivatives cost the same everywhere and the derivatives are exact for the interpolated function:

    δ_s(x, y, h) = Σ_ijk c_ijks B_i(x) B_j(y) B_k(h).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import numpy.typing as npt
import xarray as xr
from scipy.interpolate import NdBSpline, make_interp_spline

from coilarray.circuit.network import Network
from coilarray.compute.threads import Progress
from coilarray.design.model import Design
from coilarray.errors import LocalizeError
from coilarray.response.map import response_map

FloatArray = npt.NDArray[np.float64]

PARAMETERS = ("x", "y", "depth")
"""What is unknown of an indentation, in the order of every last axis of this package's arrays."""

_DEGREE = 3
_LEAST_PLACES = 4  # along x and along y; fewer carry no cubic
_STEPS = 5  # positions of a table in the thickness of all sheets: the convergence study is in the tests
_DEEPEST = 1.7  # of a table, in the deepest indentation of the design
_DEPTHS = (0.12, 0.24, 0.41, 0.59, 0.79, 1.0)  # of a table, in its deepest one


@dataclass(frozen=True, eq=False)
class ForwardModel:
    """δ of every state over position and depth, with derivatives.

    Parameters
    ----------
    states : tuple of str
        Names in the order of every axis of states.
    x, y, depth : ndarray, shape (n,)
        Where the response is known, in m. One depth alone is taken as known: then position is all that is unknown, and
        the depth of every point is of no effect.
    spline : NdBSpline
        Of x, y and, where there is more than one, the depth; values of shape (states,).
    """

    states: tuple[str, ...]
    x: FloatArray
    y: FloatArray
    depth: FloatArray
    spline: NdBSpline

    @property
    def lower(self) -> FloatArray:
        """Least x, y and depth in m, shape (3,)."""
        return np.array([self.x[0], self.y[0], self.depth[0]])

    @property
    def upper(self) -> FloatArray:
        """Greatest x, y and depth in m, shape (3,)."""
        return np.array([self.x[-1], self.y[-1], self.depth[-1]])

    @property
    def unknowns(self) -> int:
        """How many of x, y and depth are unknown: 3, or 2 where the table has one depth."""
        return 3 if len(self.depth) > 1 else 2

    def select(self, states: Sequence[str]) -> ForwardModel:
        """Return the model of some of the states, in the given order; for example without a broken coil.

        Raises
        ------
        LocalizeError
            A name that the model does not have, or one that is given twice.
        """
        for name in states:
            if name not in self.states:
                raise LocalizeError(f"the model has no state {name!r}; there are {', '.join(self.states)}.")
        if not states or len(set(states)) < len(states):
            raise LocalizeError(f"states must be named once each, at least one; got {list(states)}.")
        kept = [self.states.index(name) for name in states]
        coefficients = np.ascontiguousarray(self.spline.c[..., kept])
        return replace(self, states=tuple(states), spline=NdBSpline(self.spline.t, coefficients, self.spline.k))

    def delta(self, points: npt.ArrayLike) -> FloatArray:
        """Return the relative change of inductance of every state.

        Parameters
        ----------
        points : array_like, shape (…, 3)
            x, y and depth in m.

        Returns
        -------
        ndarray, shape (…, states)
            δ, without unit.

        Raises
        ------
        LocalizeError
            Another shape, or a point that is not in the table.
        """
        return self._spline_at(self._checked(points), None)

    def jacobian(self, points: npt.ArrayLike) -> FloatArray:
        """Differentiate δ of every state by x, y and depth.

        Parameters
        ----------
        points : array_like, shape (…, 3)
            x, y and depth in m.

        Returns
        -------
        ndarray, shape (…, states, unknowns)
            In 1/m; by x and y alone where the depth is known.

        Raises
        ------
        LocalizeError
            Another shape, or a point that is not in the table.
        """
        return self.linear(self._checked(points))[1]

    def linear(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """`delta` and `jacobian` at points in the table, unchecked: for solvers."""
        slopes = [self._spline_at(points, axis) for axis in range(self.unknowns)]
        return self._spline_at(points, None), np.stack(slopes, axis=-1)

    def _spline_at(self, points: FloatArray, axis: int | None) -> FloatArray:
        orders = np.zeros(self.unknowns, dtype=int)
        if axis is not None:
            orders[axis] = 1
        return np.asarray(self.spline(points[..., : self.unknowns], nu=orders))

    def _checked(self, points: npt.ArrayLike) -> FloatArray:
        array = np.asarray(points, dtype=np.float64)
        if array.ndim < 1 or array.shape[-1] != 3:
            raise LocalizeError(f"points must have x, y and depth on their last axis; got shape {array.shape}.")
        free = slice(self.unknowns)
        inside = (array[..., free] >= self.lower[free]) & (array[..., free] <= self.upper[free])
        if not inside.all():
            axis = int(np.argwhere(~inside)[0][-1])
            value = array[..., free][~inside][0]
            raise LocalizeError(
                f"{PARAMETERS[axis]} of a point must be in the table, {self.lower[axis]:.4g} to "
                f"{self.upper[axis]:.4g} m; got {value:.4g} m."
            )
        return array


def checked_noise(model: ForwardModel, noise: npt.ArrayLike) -> FloatArray:
    """Return the standard deviation of δ of every state, shape (states,).

    Raises
    ------
    LocalizeError
        Values that are not positive and finite, or neither one nor one a state.
    """
    values = np.asarray(noise, dtype=np.float64)
    if values.shape not in ((), (len(model.states),)):
        raise LocalizeError(
            f"noise must be one number or one for each of the {len(model.states)} states; got shape {values.shape}."
        )
    if not (np.isfinite(values) & (values > 0)).all():
        raise LocalizeError(f"noise must be positive and finite; got {values.tolist()}.")
    return np.broadcast_to(values, (len(model.states),)).copy()


def forward_model(response: xr.Dataset, *, zero_plane: bool = True) -> ForwardModel:
    """Make a forward model of a response dataset, simulated or measured.

    Parameters
    ----------
    response : xarray.Dataset
        With ``delta`` (depth, y, x, state) and the coordinates depth, y, x in m and state.
    zero_plane : bool
        Add δ = 0 at the depth 0, where nothing is pressed, to a table of more than one depth that has no depth 0.

    Returns
    -------
    ForwardModel

    Raises
    ------
    LocalizeError
        A dataset without ``delta`` or with other dimensions, values that are not finite, coordinates that do not rise,
        fewer than 4 positions along x or y, a depth below 0, states that share a name.

    Notes
    -----
    Cubic in x and y with C. de Boor's not-a-knot ends (A Practical Guide to Splines, ch. IV); in depth cubic from four
    planes on, with fewer the polynomial through them.

    Examples
    --------
    >>> x, h = np.linspace(-9e-3, 9e-3, 7), [0.5e-3, 1e-3]
    >>> delta = np.array(h)[:, None, None, None] * np.ones((2, 7, 7, 1))
    >>> coords = {"depth": h, "y": x, "x": x, "state": ["coil1"]}
    >>> model = forward_model(xr.Dataset({"delta": (("depth", "y", "x", "state"), delta)}, coords))
    >>> np.round(model.delta([1e-3, 2e-3, 0.75e-3]), 12)
    array([0.00075])
    """
    delta, (x, y, depth) = _table(response)
    if zero_plane and len(depth) > 1 and depth[0] > 0:
        depth = np.concatenate(([0.0], depth))
        delta = np.concatenate((np.zeros_like(delta[:, :, :1]), delta), axis=2)
    names = tuple(str(name) for name in response["state"].values)
    if len(set(names)) < len(names):
        raise LocalizeError(f"states of a response must have different names; got {', '.join(names)}.")
    if len(depth) == 1:
        return ForwardModel(names, x, y, depth, _tensor_spline((x, y), delta[:, :, 0]))
    return ForwardModel(names, x, y, depth, _tensor_spline((x, y, depth), delta))


def _table(response: xr.Dataset) -> tuple[FloatArray, tuple[FloatArray, FloatArray, FloatArray]]:
    """δ with the axes x, y, depth, state, and the axes themselves; checked."""
    wanted = {"depth", "y", "x", "state"}
    if "delta" not in response or set(response["delta"].dims) != wanted:
        raise LocalizeError("a response must have the variable delta with the dimensions depth, y, x and state.")
    missing = sorted(wanted - set(response.coords))
    if missing:
        raise LocalizeError(f"a response must have coordinates for all dimensions; {', '.join(missing)} is missing.")
    delta = np.asarray(response["delta"].transpose("x", "y", "depth", "state").values, dtype=np.float64)
    if not delta.size or not np.isfinite(delta).all():
        raise LocalizeError("delta of a response must be finite everywhere.")
    x, y, depth = (np.asarray(response[name].values, dtype=np.float64) for name in PARAMETERS)
    for name, axis, least in (("x", x, _LEAST_PLACES), ("y", y, _LEAST_PLACES), ("depth", depth, 1)):
        if len(axis) < least:
            raise LocalizeError(f"a response must have at least {least} positions along {name}; got {len(axis)}.")
        if not np.isfinite(axis).all() or (np.diff(axis) <= 0).any():
            raise LocalizeError(f"{name} of a response must be finite and rise; got {axis}.")
    if depth[0] < 0:
        raise LocalizeError(f"depth of a response must not be negative; got {depth[0]:.4g} m.")
    return delta, (x, y, depth)


def _tensor_spline(axes: Sequence[FloatArray], values: FloatArray) -> NdBSpline:
    """Interpolate along one axis after the other."""
    knots, degrees = [], []
    for k, axis in enumerate(axes):
        degree = min(_DEGREE, len(axis) - 1)
        spline = make_interp_spline(axis, np.moveaxis(values, k, 0), k=degree)
        values = np.moveaxis(spline.c, 0, k)
        knots.append(spline.t)
        degrees.append(degree)
    return NdBSpline(tuple(knots), np.ascontiguousarray(values), tuple(degrees))


def table_grid(
    design: Design, *, spacing: float | None = None, deepest: float | None = None
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Choose the positions of a response that is fine enough for a forward model.

    Parameters
    ----------
    design : Design
        With the tables ``[indenter]`` and ``[indentation]``.
    spacing : float, optional
        Distance of positions in m, at most; a fifth of the thickness of all sheets by default, which leaves errors of
        less than 1e-6 in δ between them (gast2020).
    deepest : float, optional
        Greatest depth in m; 1.7 times that of the design by default, since noise must not push a reading out of it.

    Returns
    -------
    depths, x, y : ndarray, shape (n,)
        In m; x and y over the outlines of all coils, from the map's origin.

    Raises
    ------
    LocalizeError
        A design that says nothing of an indentation, a spacing or depth that is not positive.

    Examples
    --------
    >>> from coilarray import load_design
    >>> depths, x, y = table_grid(load_design("gast2020"))
    >>> len(depths), len(x), len(y)
    (6, 55, 16)
    """
    setup = design.indentation
    if setup is None:
        raise LocalizeError(f"the design {design.name} has no [indenter] and [indentation].")
    step = sum(sheet.thickness for sheet in design.sheets) / _STEPS if spacing is None else spacing
    end = _DEEPEST * max(setup.depths) if deepest is None else deepest
    for name, value in (("spacing", step), ("deepest", end)):
        if not (math.isfinite(value) and value > 0):
            raise LocalizeError(f"{name} of a table must be positive and finite; got {value} m.")
    outlines = np.concatenate([place.to_board(place.coil.outline) for place in design.array.placements])
    (x_min, y_min), (x_max, y_max) = ((f(outlines, axis=0) - setup.origin_point).tolist() for f in (np.min, np.max))
    return end * np.array(_DEPTHS), _row(x_min, x_max, step), _row(y_min, y_max, step)


def table_for(
    design: Design,
    *,
    spacing: float | None = None,
    deepest: float | None = None,
    network: Network | None = None,
    parts: Path | None = None,
    progress: Progress | None = None,
) -> xr.Dataset:
    """Compute the response at the positions of `table_grid`, for `forward_model`.

    Parameters
    ----------
    design : Design
        With the tables ``[indenter]`` and ``[indentation]``.
    spacing, deepest : float, optional
        As in `table_grid`.
    network, parts, progress : optional
        As in `coilarray.response.map.response_map`.

    Returns
    -------
    xarray.Dataset
        The response over all coils; 10 s for the six of gast2020.

    Raises
    ------
    LocalizeError
        What `table_grid` refuses.
    ElastomerError
        What `response_map` refuses, for example positions at which the indenter leaves a small sample.
    """
    depths, x, y = table_grid(design, spacing=spacing, deepest=deepest)
    return response_map(design, depths=depths, x=x, y=y, network=network, parts=parts, progress=progress)


def _row(start: float, stop: float, step: float) -> FloatArray:
    """Equal steps of at most `step` from one end to the other."""
    return np.linspace(start, stop, max(_LEAST_PLACES, math.ceil((stop - start) / step - 1e-9) + 1))
