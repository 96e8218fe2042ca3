"""Drift correction by reference coils.

The reference coils lie away from the indenter. Their δ is subtracted from δ of the other coils. A clock or a tank
capacitor that drifts changes δ of all coils alike, as do supply and expansion of the board. Unequal changes remain, and
each reference adds its own noise. `coilarray.circuit.noise_budget.NoiseBudget.referenced` computes both, and
`coilarray.localize.forward.ForwardModel.referenced` is the model of the remaining δ.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt
import xarray as xr

from coilarray.compute.arrays import FloatArray
from coilarray.design.scan_states import referenced_names
from coilarray.errors import HardwareError


def less_reference(delta: Mapping[str, npt.ArrayLike], reference: Sequence[str]) -> dict[str, FloatArray]:
    """Return δ less the mean δ of the reference coils.

    Parameters
    ----------
    delta : mapping of str to array_like
        δ of every state by name: a number of one scan, or an array over scans, alike for all. NaN if unknown.
    reference : sequence of str
        Names of the states of the reference coils.

    Returns
    -------
    dict of str to ndarray
        δ of the other states. It is NaN if a state or any reference has no value. A mean over fewer references would
        jump by their noise.

    Raises
    ------
    HardwareError
        A reference that is missing or named twice, an empty `reference`, or no other state.

    Notes
    -----
    A drift d multiplies every L by 1 + d, so that δ becomes δ + d + δ d. The last term, 10⁻⁸ for d = 10⁻⁵ and δ = 10⁻³,
    remains.

    Examples
    --------
    >>> left = less_reference({"coil1": [5e-6, 7e-4 + 9e-6], "far": [5e-6, 9e-6]}, ["far"])
    >>> np.round(left["coil1"], 9)
    array([0.    , 0.0007])
    """
    others = referenced_names(tuple(delta), reference, HardwareError)
    mean = np.mean([np.asarray(delta[name], dtype=np.float64) for name in reference], axis=0)
    return {name: np.asarray(np.asarray(delta[name], dtype=np.float64) - mean) for name in others}


def response_less_reference(response: xr.Dataset, reference: Sequence[str]) -> xr.Dataset:
    """Return a response less the reference coils.

    The response is measured or simulated. The mean δ of the reference coils is subtracted from δ of the other states.
    If the response has ``delta_std``, the noise of the mean is added to it. A HardwareError is raised as in
    `less_reference`.
    """
    others = list(referenced_names(tuple(response.state.values.tolist()), reference, HardwareError))
    mean = response.delta.sel(state=list(reference)).mean("state", skipna=False)
    left = response.sel(state=others)
    left["delta"] = (left.delta - mean).assign_attrs(response.delta.attrs)
    if "delta_std" in left:
        taken = response.delta_std.sel(state=list(reference))
        added = (taken**2).sum("state", skipna=False) / len(reference) ** 2
        left["delta_std"] = np.sqrt(left.delta_std**2 + added).assign_attrs(response.delta_std.attrs)
    return left.assign_attrs(reference_coils=", ".join(reference))
