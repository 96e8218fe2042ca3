"""Fisher information and Cramér–Rao bound of position and depth.

For Gaussian noise of known covariance Σ in δ, and J the derivatives of the model by the unknowns,

    F = Jᵀ Σ⁻¹ J,      cov(θ̂) ≥ F⁻¹

for every unbiased estimate (S. M. Kay, Fundamentals of Statistical Signal Processing, vol. 1, sect.
3.9). The bound is of first order. On the middle line of a symmetric board δ has no slope across the
line. The information is singular there, and δ determines y² alone.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import xarray as xr

from coilarray.compute.arrays import FloatArray
from coilarray.compute.netcdf import variables
from coilarray.errors import LocalizeError
from coilarray.localize.forward import ForwardModel, checked_noise, whitening_of

_SINGULAR = 1e-12  # least eigenvalue of a scaled information: slopes are known to some 1e-6 of the largest


def fisher_information(model: ForwardModel, points: npt.ArrayLike, noise: npt.ArrayLike | None = None) -> FloatArray:
    """Fisher information of one reading of all states, in 1/m².

    The shape is (…, unknowns, unknowns) for points (…, 3) in m. A given noise is independent from
    state to state. The table's error counts, and states that the converter cannot read do not.
    """
    at = np.asarray(points, dtype=np.float64)
    scaled = whitening_of(model, noise, model.delta(at), at).slopes(model.jacobian(at))
    return np.asarray(scaled.swapaxes(-1, -2) @ scaled)


def covariance_of(information: FloatArray) -> FloatArray:
    """Invert Fisher information (…, n, n) to covariances in m².

    If the information is singular to rounding, all variances are infinite and the covariances 0.

    >>> covariance_of(np.array([[4.0, 0.0], [0.0, 0.0]]))
    array([[inf,  0.],
           [ 0., inf]])
    """
    values, vectors, scale = _scaled_eigen(information)
    singular = values[..., 0] <= _SINGULAR
    safe = np.where(singular[..., None], 1.0, values)
    inverse = np.einsum("...ik,...k,...jk->...ij", vectors, 1 / safe, vectors)
    inverse = inverse / (scale[..., :, None] * scale[..., None, :])
    unknown = np.where(np.eye(information.shape[-1], dtype=bool), np.inf, 0.0)
    return np.where(singular[..., None, None], unknown, inverse)


def identifiability(
    model: ForwardModel,
    depth: float,
    *,
    noise: npt.ArrayLike | None = None,
    x: npt.ArrayLike | None = None,
    y: npt.ArrayLike | None = None,
) -> xr.Dataset:
    """Map the Cramér–Rao bound over the board.

    The `depth` in m has no effect if the `model` has only one. `noise`, a number or of shape
    (states,), is the standard deviation of δ, by default the noise of the model. `x` and `y` are
    rows of positions in m, by default those of the table. Raises LocalizeError for positions or a
    depth outside the table.

    Over y and x, ``sigma_x``, ``sigma_y`` and, if the depth is unknown, ``sigma_h`` are the least
    standard deviations in m, infinite where the information is singular. ``condition`` is the ratio
    of the largest to the least eigenvalue of the information, with x and y in one unit and the
    depth in its own. It shows how far the unknowns can replace each other, and is infinite where
    singular. The attributes are depth in m, noise and common_noise of every state.
    """
    along, across = (
        np.atleast_1d(np.asarray(axis, dtype=np.float64))
        for axis in (model.x if x is None else x, model.y if y is None else y)
    )
    if along.ndim != 1 or across.ndim != 1:
        raise LocalizeError(f"x and y must be rows of positions; got shapes {along.shape} and {across.shape}.")
    X, Y = np.meshgrid(along, across)
    sigma = checked_noise(model.states, model.noise if noise is None else noise)
    common = model.common_noise if noise is None else np.zeros_like(sigma)
    information = fisher_information(model, np.stack([X, Y, np.full_like(X, depth)], axis=-1), noise)
    deviations = np.sqrt(np.diagonal(covariance_of(information), axis1=-2, axis2=-1))
    values, _, _ = _scaled_eigen(information)
    singular = values[..., 0] <= _SINGULAR
    condition = np.where(singular, np.inf, values[..., -1] / np.where(singular, 1.0, values[..., 0]))
    where, names = ("y", "x"), [("x", "y", "h")[axis] for axis in model.free]
    return xr.Dataset(
        variables(
            *(
                (f"sigma_{name}", where, deviations[..., k], "m", f"least standard deviation of {name}")
                for k, name in enumerate(names)
            ),
            ("condition", where, condition, "1", "condition of the information"),
        ),
        coords={"y": ("y", across, {"units": "m"}), "x": ("x", along, {"units": "m"})},
        attrs={"depth": float(depth), "noise": sigma.tolist(), "common_noise": common.tolist()},
    )


def _scaled_eigen(information: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Rising eigenvalues and vectors of the information, and its scale.

    x and y have one scale, and the depth another. With a scale of its own an unknown that does not
    affect δ beyond rounding would look like any other.
    """
    diagonal = np.diagonal(information, axis1=-2, axis2=-1).copy()
    diagonal[..., :2] = diagonal[..., :2].max(axis=-1, keepdims=True)
    scale = np.sqrt(np.where(diagonal > 0, diagonal, 1.0))
    values, vectors = np.linalg.eigh(information / (scale[..., :, None] * scale[..., None, :]))
    return values, vectors, scale
