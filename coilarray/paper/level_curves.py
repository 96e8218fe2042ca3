"""x0, A and B over the levels of δ of a map, and their scatter under noise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import xarray as xr

from coilarray.compute.arrays import FloatArray
from coilarray.errors import LocalizeError
from coilarray.paper.ellipse import PARAMETERS, STEP, fit_ellipses

_LEAST_SHARE = 0.5  # of the noisy maps: if fewer have a level, its scatter is NaN


@dataclass(frozen=True, eq=False)
class LevelCurves:
    """Ellipses of the levels STEP, 2·STEP, … of δ.

    They are for one state at one depth. `values` and `deviations`, shape (3, levels), are x0, A and B in m and their
    standard deviations. They are NaN if a level has no ellipse, and the deviations are also NaN if no noise is known.
    `undetermined`, shape (levels,), marks the levels whose points do not determine the ellipse, see
    `coilarray.paper.ellipse`. `problem` is the reason why there is no ellipse at all, empty if there are some.
    """

    values: FloatArray
    deviations: FloatArray
    undetermined: npt.NDArray[np.bool_]
    problem: str = ""


def level_curves(
    response: xr.Dataset, noise: npt.ArrayLike | None = None, *, replicates: int = 16, seed: int = 0
) -> LevelCurves:
    """Fit the ellipses of a map and of noisy copies.

    The map has one depth and one state. The copies give the standard deviations. `fit_ellipses` is used with its own
    settings. `noise`, shape (y, x), is the standard deviation of δ. Fewer than 2 `replicates` give no standard
    deviations. The copies add noise to a map that may already have it. Their scatter is still right if the noise is
    small compared with the width of a level.
    """
    try:
        if not np.isfinite(response.delta.values).all():
            raise LocalizeError("the map has gaps.")
        fits = fit_ellipses(response).isel(state=0)
    except LocalizeError as error:
        return LevelCurves(np.empty((3, 0)), np.empty((3, 0)), np.empty(0, dtype=bool), str(error))
    values, undetermined = _parameters(fits), fits.undetermined.values
    unknown = np.full_like(values, np.nan)
    if noise is None or replicates < 2:
        return LevelCurves(values, unknown, undetermined)
    sigma = xr.DataArray(np.asarray(noise, dtype=np.float64), dims=("y", "x"))
    random = np.random.default_rng(seed)
    runs = np.full((replicates, *values.shape), np.nan)
    for run in runs:
        try:
            shaken = response.assign(delta=response.delta + sigma * random.standard_normal(sigma.shape))
            noisy = _parameters(fit_ellipses(shaken).isel(state=0))
        except LocalizeError:  # the noise has removed the hill
            continue
        run[:, : noisy.shape[1]] = noisy[:, : values.shape[1]]
    count = np.isfinite(runs).sum(axis=0)
    known = np.isfinite(values) & (count >= max(2.0, _LEAST_SHARE * replicates))
    mean = np.nansum(runs, axis=0) / np.maximum(count, 1)
    scatter = np.sqrt(np.nansum((runs - mean) ** 2, axis=0) / np.maximum(count - 1, 1))
    return LevelCurves(values, np.where(known, scatter, unknown), undetermined)


def level_axis(count: int) -> FloatArray:
    """Return the δ of the first `count` levels."""
    return np.asarray(STEP * np.arange(1, count + 1), dtype=np.float64)


def _parameters(fits: xr.Dataset) -> FloatArray:
    """x0, A and B, shape (3, levels)."""
    return fits[[*PARAMETERS]].to_dataarray().values
