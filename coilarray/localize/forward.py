"""Forward model: smooth δ over position and depth, with noise.

The drift of a clock or a capacitor of all coils changes every δ by one random number. With D the
variances of the noise that is independent from state to state, and C the drift of every state by
every common cause,

    Σ = D + C Cᵀ,    W = (1 − P Γ Pᵀ) D^(−1/2),    D^(−1/2) C = P S Qᵀ,    Γ = 1 − (1 + S²)^(−1/2),

has W Σ Wᵀ = 1, so that χ² = |W e|² for residuals e, and the Fisher information is (W J)ᵀ (W J). For
a single cause, with u = D^(−1/2) c, it is P = u/|u| and Γ = 1 − 1/√(1 + |u|²).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np
import numpy.typing as npt
import xarray as xr
from scipy.interpolate import NdBSpline

from coilarray.circuit.converter_limits import readable_of
from coilarray.circuit.network import Network
from coilarray.compute.arrays import BoolArray, FloatArray
from coilarray.compute.threads import Progress
from coilarray.design.model import Design
from coilarray.design.scan_states import referenced_names
from coilarray.errors import LocalizeError, require_positive
from coilarray.response import interpolation
from coilarray.response.dataset import checked_response, is_of_target, over_depth
from coilarray.response.map import Imperfections, response_map
from coilarray.response.setup import indentation_of
from coilarray.response.target import target_map

NOISE = 1e-5  # default standard deviation of δ, for a response without a noise of its own
_STEPS = 5  # positions of a table per thickness of all sheets, from a convergence study
_DEEPEST = 1.7  # of a table, relative to the deepest indentation of the design
_DEPTHS = (0.12, 0.24, 0.41, 0.59, 0.79, 1.0)  # of a table, relative to its greatest depth


@dataclass(frozen=True, eq=False)
class Whitening:
    """Whitening W of covariances, many along leading axes.

    `deviations` (…, states) are the roots of D, `directions` (…, states, rank) the orthonormal P,
    and `shares` (…, rank) Γ. The rank is 0 without common causes.
    """

    deviations: FloatArray
    directions: FloatArray
    shares: FloatArray

    def slopes(self, values: FloatArray) -> FloatArray:
        """Return W times columns (…, states, columns)."""
        scaled = values / self.deviations[..., None]
        if not self.shares.shape[-1]:
            return np.asarray(scaled)
        along = self.directions.swapaxes(-1, -2) @ scaled
        return np.asarray(scaled - self.directions @ (self.shares[..., None] * along))

    def residuals(self, values: FloatArray) -> FloatArray:
        """Return W times values of every state, shape (…, states)."""
        return self.slopes(values[..., None])[..., 0]

    def chi_square(self, values: FloatArray) -> FloatArray:
        """χ² of residuals (…, states), shape (…)."""
        return np.asarray((self.residuals(values) ** 2).sum(axis=-1))

    def of(self, rows: Any) -> Whitening:
        """Take some of many covariances, or the single one."""
        if self.deviations.ndim == 1:
            return self
        return Whitening(self.deviations[rows], self.directions[rows], self.shares[rows])


def whitening(deviations: FloatArray, common: FloatArray) -> Whitening:
    """Make W from independent deviations and common drifts.

    The shapes are (…, states) and (states, causes).

    >>> W = whitening(np.array([3e-7, 3e-7]), np.array([[4e-6], [4e-6]]))
    >>> covariance = np.diag([9e-14, 9e-14]) + 16e-12
    >>> np.round(W.slopes(W.slopes(covariance).T), 9) + 0.0
    array([[1., 0.],
           [0., 1.]])
    """
    directions, sizes, _ = np.linalg.svd(common / deviations[..., None], full_matrices=False)
    return Whitening(deviations, directions, 1 - 1 / np.sqrt(1 + sizes**2))


@dataclass(frozen=True, eq=False, kw_only=True)
class ForwardModel(interpolation.ResponseSpline):
    """δ of every state over position and depth, with derivatives.

    `x`, `y`, `depth`, `spline` and `in_root` are the table of a `ResponseSpline`. The last of
    `parameters` is the distance of a target. `noise` is the standard deviation of δ of a reading by
    the noise budget of the design, else `NOISE`. `common` (states,) are changes of δ of one
    standard deviation by causes that are one random number for all states. `errors` are the
    relative errors of δ by the table. `unread` (x, y, depth, states) is True where the converter
    cannot read.
    """

    states: tuple[str, ...]
    parameters: tuple[str, ...] = interpolation.PARAMETERS
    noise: float = NOISE
    common: tuple[FloatArray, ...] = ()
    errors: tuple[float, ...] = ()
    unread: BoolArray | None = None

    def unread_at(self, points: FloatArray) -> BoolArray | None:
        """Test which states (…, states) are unreadable at points (…, 3).

        It suffices that a neighbour in the table is unreadable. None if every state is read.
        """
        if self.unread is None:
            return None
        found = np.zeros((*points.shape[:-1], len(self.states)), dtype=np.bool_)
        corners = []
        for k, axis in enumerate((self.x, self.y, self.depth)):
            above, below = axis.searchsorted(points[..., k]), axis.searchsorted(points[..., k], "right") - 1
            corners.append((np.clip(above, 0, len(axis) - 1), np.clip(below, 0, len(axis) - 1)))
        for corner in product(*corners):
            found |= self.unread[corner]
        return found

    def select(self, states: Sequence[str]) -> ForwardModel:
        """Return the model of some states, in the given order."""
        kept = [self.states.index(name) for name in chosen_states(self.states, states)]
        unread = None if self.unread is None else self.unread[..., kept]
        return self._with(kept, self.spline.c[..., kept], tuple(one[kept] for one in self.common), unread)

    def _with(
        self, kept: list[int], coefficients: FloatArray, common: tuple[FloatArray, ...], unread: BoolArray | None
    ) -> ForwardModel:
        """Return the model of some states, with other coefficients."""
        return replace(
            self,
            states=tuple(self.states[k] for k in kept),
            spline=NdBSpline(self.spline.t, np.ascontiguousarray(coefficients), self.spline.k),
            common=common,
            errors=tuple(self.errors[k] for k in kept if self.errors),
            unread=unread,
        )

    @property
    def common_noise(self) -> FloatArray:
        """Standard deviation of δ (states,) by all common causes."""
        return np.asarray(np.sqrt(np.square(np.reshape(self.common, (-1, len(self.states)))).sum(axis=0)))

    def referenced(self, reference: Sequence[str]) -> ForwardModel:
        """Return the model of δ relative to reference coils.

        It is δ minus the mean δ of the references, also if the indenter reaches them. Common noise
        cancels as far as it is equal. The references' own noise becomes common to all others.
        """
        others = referenced_names(self.states, reference, LocalizeError)
        kept, taken = ([self.states.index(name) for name in names] for names in (others, reference))
        coefficients = self.spline.c[..., kept] - self.spline.c[..., taken].mean(axis=-1, keepdims=True)
        own = self.noise / math.sqrt(len(taken))
        common = (*(one[kept] - one[taken].mean() for one in self.common), np.full(len(kept), own))
        unread = self.unread
        if unread is not None:
            unread = unread[..., kept] | unread[..., taken].any(axis=-1, keepdims=True)
        return self._with(kept, coefficients, common, unread)

    def delta(self, points: npt.ArrayLike) -> FloatArray:
        """Compute the ratio δ at `points` in m, shapes (…, states) and (…, 3)."""
        return self.values_at(self._checked(points))

    def jacobian(self, points: npt.ArrayLike) -> FloatArray:
        """Compute the slopes of δ in 1/m, shape (…, states, unknowns), at `points`."""
        return self.linear(self._checked(points))[1]

    def linear(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Compute the ratio δ and its slopes in 1/m, shapes as above, at `points` in the table."""
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
    """Return the wanted states, each known and given once."""
    for name in wanted:
        if name not in known:
            raise LocalizeError(f"the model has no state {name!r}; there are {', '.join(known)}.")
    if not wanted or len(set(wanted)) < len(wanted):
        raise LocalizeError(f"states must be named once each, at least one; got {list(wanted)}.")
    return tuple(wanted)


def require_states(states: Sequence[str], unknowns: int, holder: str = "model") -> None:
    """Raise LocalizeError if states are fewer than unknowns."""
    if len(states) < unknowns:
        raise LocalizeError(f"{unknowns} unknowns need at least as many states; the {holder} has {', '.join(states)}.")


def whitening_of(
    model: ForwardModel, noise: npt.ArrayLike | None, delta: FloatArray | None = None, points: FloatArray | None = None
) -> Whitening:
    """Return the whitening of differences from the model.

    A given noise is independent from state to state. The error of the table counts with δ (…, states),
    states that are unreadable at points (…, 3) in m do not.
    """
    deviations = checked_noise(model.states, model.noise if noise is None else noise)
    if delta is not None and any(model.errors):
        deviations = np.hypot(deviations, np.array(model.errors) * delta)
    unread = None if points is None else model.unread_at(points)
    if unread is not None:
        deviations = np.where(unread, np.inf, deviations)
    common = model.common if noise is None else ()
    return whitening(deviations, np.array(common).reshape(-1, len(model.states)).T)


def checked_noise(states: Sequence[str], noise: npt.ArrayLike) -> FloatArray:
    """Return the standard deviation of δ of every state."""
    values = np.asarray(noise, dtype=np.float64)
    if values.shape not in ((), (len(states),)):
        raise LocalizeError(
            f"noise must be one number or one for each of the {len(states)} states; got shape {values.shape}."
        )
    if not (np.isfinite(values) & (values > 0)).all():
        raise LocalizeError(f"noise must be positive and finite; got {values.tolist()}.")
    return np.broadcast_to(values, (len(states),)).copy()


def forward_model(response: xr.Dataset, *, zero_plane: bool = True) -> ForwardModel:
    """Make a forward model of a simulated or measured response.

    Parameters
    ----------
    response : xarray.Dataset
        Response with ``delta`` (depth, y, x, state) and the coordinates depth, y, x in m and state.
        The attribute ``noise`` and the variable ``common_noise`` (drift_cause, state) are the
        model's noise. If it has ``delta_error``, as the response of a target has, the root mean
        square of ``delta_error`` over the root mean square of δ is the model's error, for each
        state. Where ``readable`` is False the converter cannot read a state, and its δ determines
        nothing.
    zero_plane : bool
        Add δ = 0 at the depth 0, where nothing is pressed, to a table of more than one depth
        without the depth 0. Not for the table of a target, whose distances take the place of
        depths.

    Returns
    -------
    ForwardModel
        δ as a function of x, y and depth in m, with its noise. LocalizeError is raised for a
        dataset without ``delta`` or with other dimensions, values that are not finite, coordinates
        that do not rise, 2 or 3 positions along x or y, a single position and depth, a depth below
        0, or states that share a name.

    Examples
    --------
    >>> x, h = np.linspace(-9e-3, 9e-3, 7), [0.5e-3, 1e-3]
    >>> delta = np.array(h)[:, None, None, None] * np.ones((2, 7, 7, 1))
    >>> coords = {"depth": h, "y": x, "x": x, "state": ["coil1"]}
    >>> model = forward_model(xr.Dataset({"delta": (("depth", "y", "x", "state"), delta)}, coords))
    >>> np.round(model.delta([1e-3, 2e-3, 0.75e-3]), 12)
    array([0.00075])
    """
    of_target = is_of_target(response)
    response = checked_response(response)
    whole = over_depth(response)
    x, y, depth = (whole[name].values for name in interpolation.PARAMETERS)
    for name, axis in (("x", x), ("y", y)):
        if 1 < len(axis) < interpolation.LEAST_POSITIONS:
            raise LocalizeError(
                f"a response must have one or at least {interpolation.LEAST_POSITIONS} positions along {name}; "
                f"got {len(axis)}."
            )
    if not any(len(axis) > 1 for axis in (x, y, depth)):
        raise LocalizeError("a response must have more than one position or depth.")
    delta = whole["delta"].transpose("x", "y", "depth", "state").values
    table = interpolation.response_spline(x, y, depth, delta, zero_plane=zero_plane and not of_target)
    errors: tuple[float, ...] = ()
    if "delta_error" in response:
        over = tuple(dim for dim in response["delta"].dims if dim != "state")
        squares = [(response[name] ** 2).mean(over).values for name in ("delta_error", "delta")]
        errors = tuple(np.sqrt(squares[0] / squares[1]).tolist())
    common: tuple[FloatArray, ...] = ()
    if "common_noise" in response:
        common = tuple(response["common_noise"].transpose("drift_cause", "state").values.astype(np.float64))
    read = readable_of(whole).transpose("x", "y", "depth", "state").values
    if len(table.depth) > len(depth):  # the zero plane
        read = np.concatenate((read[:, :, :1], read), axis=2)
    return ForwardModel(
        **vars(table),
        states=tuple(map(str, response["state"].values)),
        parameters=("x", "y", "distance") if of_target else interpolation.PARAMETERS,
        noise=float(response.attrs.get("noise", NOISE)),
        common=common,
        errors=errors,
        unread=None if read.all() else ~read,
    )


def table_grid(
    design: Design, *, spacing: float | None = None, deepest: float | None = None
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Choose depths and positions in m for a table.

    By default `spacing` is a fifth of the thickness of all sheets, which leaves errors of less than
    1e-6 in δ between the positions (gast2020). `deepest` is 1.7 times the greatest depth of the
    design, since noise must not push a reading out of the table.
    """
    setup = indentation_of(design)
    step = sum(sheet.thickness for sheet in design.sheets) / _STEPS if spacing is None else spacing
    end = _DEEPEST * max(setup.depths) if deepest is None else deepest
    for name, value in (("spacing", step), ("deepest", end)):
        require_positive(f"{name} of a table", value, " m", LocalizeError)
    (first, last), (least, greatest) = interpolation.coil_extent(design), setup.reachable(end)
    low, high = np.maximum(first, least), np.minimum(last, greatest)
    if not (low < high).all():
        raise LocalizeError(
            f"the sample of {design.name} leaves no room over the coils for a depth of {end * 1e3:.3g} mm."
        )
    (x_min, y_min), (x_max, y_max) = low.tolist(), high.tolist()
    return (
        end * np.array(_DEPTHS),
        interpolation.even_row(x_min, x_max, step),
        interpolation.even_row(y_min, y_max, step),
    )


def table_for(design: Design, *, network: Network | None = None, progress: Progress | None = None) -> xr.Dataset:
    """Compute the response at the positions of `table_grid`.

    It is the target's map at its own places for a design with a target and no indentation.
    """
    if design.indentation is None and design.target is not None:
        return target_map(design, network=network, progress=progress)
    depths, x, y = table_grid(design)
    board = Imperfections(network=network)
    return response_map(design, depths=depths, x=x, y=y, imperfections=board, accuracy="auto", progress=progress)
