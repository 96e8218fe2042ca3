"""Forward model: δ of every state as a smooth function of the position and depth of the indenter."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
import numpy.typing as npt
import xarray as xr
from scipy.interpolate import NdBSpline

from coilarray.circuit.network import Network
from coilarray.circuit.readability import readable_of
from coilarray.compute.arrays import BoolArray, FloatArray
from coilarray.compute.threads import Progress
from coilarray.design.model import Design
from coilarray.design.scan_states import referenced_names
from coilarray.errors import LocalizeError, require_positive
from coilarray.localize.whitening import Whitening, whitening
from coilarray.response.coordinates import is_of_target, over_depth
from coilarray.response.interpolation import (
    LEAST_POSITIONS,
    PARAMETERS,
    ResponseSpline,
    coil_extent,
    even_row,
    response_spline,
)
from coilarray.response.map import response_map
from coilarray.response.schema import checked_response
from coilarray.response.setup import indentation_of
from coilarray.response.target import target_map

NOISE = 1e-5
"""Standard deviation of δ of a response that does not say its own."""

_STEPS = 5  # positions of a table in the thickness of all sheets: the convergence study is in the tests
_DEEPEST = 1.7  # of a table, relative to the deepest indentation of the design
_DEPTHS = (0.12, 0.24, 0.41, 0.59, 0.79, 1.0)  # of a table, relative to its deepest one


@dataclass(frozen=True, eq=False, kw_only=True)
class ForwardModel(ResponseSpline):
    """δ of every state over position and depth, with derivatives.

    Parameters
    ----------
    x, y, depth, spline, in_root
        Table of the response, see `coilarray.response.interpolation.ResponseSpline`; its values have the shape
        (states,).
    states : tuple of str
        Names of the states in the order of every axis of states.
    parameters : tuple of str
        Names of the coordinates; the last one is the distance of a target.
    noise : float
        Standard deviation of δ of a reading, independent from state to state, where no other is given: that of the
        response, which a computed one has by the noise budget of its design, else `NOISE`.
    common : tuple of ndarray, shape (states,)
        Changes of δ by causes that are one random number for all states, each of one standard deviation; none by
        default. They count where no other noise is given.
    errors : tuple of float
        Error of δ of every state by the table itself, of δ there; none by default.
    unread : ndarray of bool, shape (x, y, depth, states), optional
        True where the converter cannot read a state, at the coordinates of the table; None where it reads all.
    """

    states: tuple[str, ...]
    parameters: tuple[str, ...] = PARAMETERS
    noise: float = NOISE
    common: tuple[FloatArray, ...] = ()
    errors: tuple[float, ...] = ()
    unread: BoolArray | None = None

    def unread_at(self, points: FloatArray) -> BoolArray | None:
        """Tell which states the converter cannot read at points (…, 3) in m, or at a neighbour of theirs in the table.

        Returns
        -------
        ndarray of bool, shape (…, states), or None
            True for what is not readable; None where it reads every state everywhere.
        """
        if self.unread is None:
            return None
        found = np.zeros((*points.shape[:-1], len(self.states)), dtype=np.bool_)
        corners = [
            {side: np.clip(axis.searchsorted(points[..., k], side) - (side == "right"), 0, len(axis) - 1)
             for side in ("left", "right")}
            for k, axis in enumerate((self.x, self.y, self.depth))
        ]  # fmt: skip
        for sides in product(("left", "right"), repeat=3):
            found |= self.unread[tuple(of[side] for of, side in zip(corners, sides, strict=True))]
        return found

    def select(self, states: Sequence[str]) -> ForwardModel:
        """Return the model of some of the states, in the given order; for example without a broken coil.

        LocalizeError as `chosen_states`.

        Returns
        -------
        ForwardModel
            The smaller model.
        """
        kept = [self.states.index(name) for name in chosen_states(self.states, states)]
        coefficients = np.ascontiguousarray(self.spline.c[..., kept])
        spline, errors = NdBSpline(self.spline.t, coefficients, self.spline.k), self.errors
        return replace(
            self, states=tuple(states), spline=spline, common=tuple(one[kept] for one in self.common),
            errors=tuple(errors[k] for k in kept if errors),
            unread=None if self.unread is None else self.unread[..., kept],
        )  # fmt: skip

    @property
    def common_noise(self) -> FloatArray:
        """Standard deviation of δ by all causes that are common to the states, shape (states,)."""
        return np.sqrt(np.sum(np.square(self.common), axis=0)) if self.common else np.zeros(len(self.states))

    def referenced(self, reference: Sequence[str]) -> ForwardModel:
        """Return the model of δ less the mean δ of reference coils, of the other states.

        It is that of readings of `coilarray.hardware.record.reference_coil.less_reference`, also where the indenter
        reaches a reference. What is common goes as far as it is equal, and the references' own noise is common to all
        others. LocalizeError for a reference that is not there or named twice, none, or no other state.

        Returns
        -------
        ForwardModel
            The model of the other states.
        """
        others = referenced_names(self.states, reference, LocalizeError)
        kept, taken = ([self.states.index(name) for name in names] for names in (others, reference))
        coefficients = self.spline.c[..., kept] - self.spline.c[..., taken].mean(axis=-1, keepdims=True)
        own = self.noise / math.sqrt(len(taken))
        spline, errors = NdBSpline(self.spline.t, coefficients, self.spline.k), self.errors
        common = (*(one[kept] - one[taken].mean() for one in self.common), np.full(len(kept), own))
        unread = self.unread
        if unread is not None:
            unread = unread[..., kept] | unread[..., taken].any(axis=-1, keepdims=True)
        return replace(
            self, states=others, spline=spline, common=common, errors=tuple(errors[k] for k in kept if errors),
            unread=unread,
        )  # fmt: skip

    def delta(self, points: npt.ArrayLike) -> FloatArray:
        """Return δ of every state, shape (…, states), at points (…, 3): x, y and depth in m.

        LocalizeError for another shape, or a point that is not in the table.

        Returns
        -------
        ndarray, shape (…, states)
            δ, a ratio.
        """
        return self.values_at(self._checked(points))

    def jacobian(self, points: npt.ArrayLike) -> FloatArray:
        """Slopes of `delta` at `points` (…, 3) in m by the unknowns among x, y and depth.

        Returns
        -------
        ndarray, shape (…, states, unknowns)
            Slopes in 1/m.
        """
        return self.linear(self._checked(points))[1]

    def linear(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """`delta` and `jacobian` at points in the table, unchecked: for solvers.

        Returns
        -------
        tuple of ndarray, shapes (…, states) and (…, states, unknowns)
            δ, a ratio, and its slopes in 1/m.
        """
        slopes = [self.values_at(points, axis) for axis in range(self.unknowns)]
        return self.values_at(points), np.stack(slopes, axis=-1)

    def _checked(self, points: npt.ArrayLike) -> FloatArray:
        array = np.asarray(points, dtype=np.float64)
        if array.ndim < 1 or array.shape[-1] != 3:
            raise LocalizeError(f"points must have x, y and depth on their last axis; got shape {array.shape}.")
        out = self.outside(array)
        if out is not None:
            axis, value = out
            raise LocalizeError(
                f"{self.parameters[axis]} of a point must be in the table, {self.lower[axis]:.4g} to "
                f"{self.upper[axis]:.4g} m; got {value:.4g} m."
            )
        return array


def chosen_states(known: Sequence[str], wanted: Sequence[str]) -> tuple[str, ...]:
    """Return the wanted states; LocalizeError for none, a name that is not known, or one that is given twice."""
    for name in wanted:
        if name not in known:
            raise LocalizeError(f"the model has no state {name!r}; there are {', '.join(known)}.")
    if not wanted or len(set(wanted)) < len(wanted):
        raise LocalizeError(f"states must be named once each, at least one; got {list(wanted)}.")
    return tuple(wanted)


def require_states(states: Sequence[str], unknowns: int) -> None:
    """Refuse fewer states than there are unknowns: LocalizeError."""
    if len(states) < unknowns:
        raise LocalizeError(f"{unknowns} unknowns need at least as many states; the model has {', '.join(states)}.")


def noise_of(model: ForwardModel, noise: npt.ArrayLike | None) -> FloatArray:
    """Return the standard deviation of δ of every state, shape (states,): the given one, else that of the model.

    LocalizeError as `checked_noise`.
    """
    return checked_noise(model.states, model.noise if noise is None else noise)


def whitening_of(
    model: ForwardModel,
    noise: npt.ArrayLike | None,
    delta: FloatArray | None = None,
    points: FloatArray | None = None,
) -> Whitening:
    """Return what divides differences of readings from the model, and its slopes, by their noise.

    A given noise is independent from state to state; the model's own has also what is common to them. The error of the
    table, as a part of δ, is added for δ (…, states) if given. States that the converter cannot read at points (…, 3)
    in m, if given, count for nothing. LocalizeError as `checked_noise`.
    """
    deviations = noise_of(model, noise)
    if delta is not None and any(model.errors):
        deviations = np.hypot(deviations, np.array(model.errors) * delta)
    unread = None if points is None else model.unread_at(points)
    if unread is not None:
        deviations = np.where(unread, np.inf, deviations)
    common = model.common if noise is None else ()
    return whitening(deviations, np.array(common).reshape(-1, len(model.states)).T)


def checked_noise(states: Sequence[str], noise: npt.ArrayLike) -> FloatArray:
    """Return the standard deviation of δ of every state, shape (states,).

    LocalizeError for values that are not positive and finite, or neither one number nor one for each state.
    """
    values = np.asarray(noise, dtype=np.float64)
    if values.shape not in ((), (len(states),)):
        raise LocalizeError(
            f"noise must be one number or one for each of the {len(states)} states; got shape {values.shape}."
        )
    if not (np.isfinite(values) & (values > 0)).all():
        raise LocalizeError(f"noise must be positive and finite; got {values.tolist()}.")
    return np.broadcast_to(values, (len(states),)).copy()


def forward_model(response: xr.Dataset, *, zero_plane: bool = True) -> ForwardModel:
    """Make a forward model of a response dataset, simulated or measured.

    Parameters
    ----------
    response : xarray.Dataset
        Response with ``delta`` (depth, y, x, state) and the coordinates depth, y, x in m and state. The attribute
        ``noise`` and the variable ``common_noise`` (drift_cause, state) are the model's noise. Where it has
        ``delta_error``, as a target's, its root mean square against that of δ is the model's error, state by state.
        Where ``readable`` says that the converter cannot read a state, δ of that state determines nothing.
    zero_plane : bool
        Add δ = 0 at the depth 0, where nothing is pressed, to a table of more than one depth that has no depth 0. Not
        to that of a target, whose distances are its depths here.

    Returns
    -------
    ForwardModel
        δ as a function of x, y and depth in m, with its noise.

    Raises
    ------
    LocalizeError
        A dataset without ``delta`` or with other dimensions, values that are not finite, coordinates that do not rise,
        2 or 3 positions along x or y, a single position and depth, a depth below 0, states that share a name.

    Notes
    -----
    Splines of `coilarray.response.interpolation.response_spline`.

    Examples
    --------
    >>> x, h = np.linspace(-9e-3, 9e-3, 7), [0.5e-3, 1e-3]
    >>> delta = np.array(h)[:, None, None, None] * np.ones((2, 7, 7, 1))
    >>> coords = {"depth": h, "y": x, "x": x, "state": ["coil1"]}
    >>> model = forward_model(xr.Dataset({"delta": (("depth", "y", "x", "state"), delta)}, coords))
    >>> np.round(model.delta([1e-3, 2e-3, 0.75e-3]), 12)
    array([0.00075])
    """
    zero_plane = zero_plane and not is_of_target(response)
    response = checked_response(response)
    delta, (x, y, depth) = _table(over_depth(response))
    names = tuple(str(name) for name in response["state"].values)
    table = response_spline(x, y, depth, delta, zero_plane=zero_plane)
    parameters = ("x", "y", "distance") if is_of_target(response) else PARAMETERS
    errors: tuple[float, ...] = ()
    if "delta_error" in response:
        over = tuple(dim for dim in response["delta"].dims if dim != "state")
        squares = [(response[name] ** 2).mean(over).values for name in ("delta_error", "delta")]
        errors = tuple(np.sqrt(squares[0] / squares[1]).tolist())
    common: tuple[FloatArray, ...] = ()
    if "common_noise" in response:
        common = tuple(response["common_noise"].transpose("drift_cause", "state").values.astype(np.float64))
    read = readable_of(over_depth(response)).transpose("x", "y", "depth", "state").values
    if len(table.depth) > len(depth):  # the zero plane
        read = np.concatenate((read[:, :, :1], read), axis=2)
    return ForwardModel(
        states=names, parameters=parameters, noise=float(response.attrs.get("noise", NOISE)), common=common,
        errors=errors, unread=None if read.all() else ~read,
        x=table.x, y=table.y, depth=table.depth, spline=table.spline,
    )  # fmt: skip


def _table(response: xr.Dataset) -> tuple[FloatArray, tuple[FloatArray, FloatArray, FloatArray]]:
    """δ with the axes x, y, depth, state, and the axes themselves; checked."""
    delta = response["delta"].transpose("x", "y", "depth", "state").values
    x, y, depth = (response[name].values for name in PARAMETERS)
    for name, axis in (("x", x), ("y", y)):
        if 1 < len(axis) < LEAST_POSITIONS:
            raise LocalizeError(
                f"a response must have one or at least {LEAST_POSITIONS} positions along {name}; got {len(axis)}."
            )
    if not any(len(axis) > 1 for axis in (x, y, depth)):
        raise LocalizeError("a response must have more than one position or depth.")
    return delta, (x, y, depth)


def table_grid(
    design: Design, *, spacing: float | None = None, deepest: float | None = None
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Choose the positions of a response that is fine enough for a forward model.

    Parameters
    ----------
    design : Design
        Design with an indentation.
    spacing : float, optional
        Distance of positions in m, at most; a fifth of the thickness of all sheets by default, which leaves errors of
        less than 1e-6 in δ between them (gast2020).
    deepest : float, optional
        Greatest depth in m; 1.7 times that of the design by default, since noise must not push a reading out of it.

    Returns
    -------
    depths, x, y : ndarray, shape (n,)
        Coordinates in m; x and y over the outlines of all coils, from the map's origin, as far as the contact at the
        greatest depth stays on the sample.

    Raises
    ------
    ElastomerError
        A design without an indentation.
    LocalizeError
        A spacing or depth that is not positive, or a sample that leaves no room over the coils.
    """
    setup = indentation_of(design)
    step = sum(sheet.thickness for sheet in design.sheets) / _STEPS if spacing is None else spacing
    end = _DEEPEST * max(setup.depths) if deepest is None else deepest
    for name, value in (("spacing", step), ("deepest", end)):
        require_positive(f"{name} of a table", value, " m", LocalizeError)
    (first, last), (least, greatest) = coil_extent(design), setup.reachable(end)
    low, high = np.maximum(first, least), np.minimum(last, greatest)
    if not (low < high).all():
        raise LocalizeError(
            f"the sample of {design.name} leaves no room over the coils for a depth of {end * 1e3:.3g} mm."
        )
    (x_min, y_min), (x_max, y_max) = low.tolist(), high.tolist()
    return end * np.array(_DEPTHS), even_row(x_min, x_max, step), even_row(y_min, y_max, step)


def table_for(design: Design, *, network: Network | None = None, progress: Progress | None = None) -> xr.Dataset:
    """Compute the response at the positions of `table_grid`, for `forward_model`: 10 s for the six coils of gast2020.

    The network of coils, switches and strays is that of `response_map` by default. Of a design with a target and no
    indentation it is the target's map at the places and distances of the design. ElastomerError for what
    `response_map` refuses, and MetalError for what `target_map` refuses.
    """
    if design.indentation is None and design.target is not None:
        return target_map(design, network=network, progress=progress)
    depths, x, y = table_grid(design)
    return response_map(design, depths=depths, x=x, y=y, reach="auto", network=network, progress=progress)
