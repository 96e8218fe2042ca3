"""Schema of a response.

The response may be computed, measured, of a target, or of another program.
"""

from __future__ import annotations

from dataclasses import replace

import xarray as xr

from coilarray.compute.netcdf import Entry, Schema
from coilarray.errors import LocalizeError
from coilarray.response.coordinates import is_of_target

_OVER = ("depth", "y", "x", "state")
_FARTHEST = 10.0  # m; larger values are a map in mm
_LARGEST = 100.0  # of δ, which is −1 for zero inductance
_PLACE = Entry("m", ("coil",), low=-_FARTHEST, high=_FARTHEST)

RESPONSE = Schema(
    LocalizeError, "delta over depth, y, x and state, with coordinates",
    {
        "delta": Entry("1", _OVER, needed=True, low=-_LARGEST, high=_LARGEST, gaps=True),
        "depth": Entry("m", ("depth",), needed=True, low=0.0, high=_FARTHEST, rising=True),
        "y": Entry("m", ("y",), needed=True, low=-_FARTHEST, high=_FARTHEST, rising=True),
        "x": Entry("m", ("x",), needed=True, low=-_FARTHEST, high=_FARTHEST, rising=True),
        "state": Entry(None, ("state",), needed=True),
        "delta_std": Entry("1", _OVER, low=0.0, high=_LARGEST, gaps=True, fewer_dims=True),
        "readable": Entry("", _OVER, fewer_dims=True, flag=True),
        "common_noise": Entry("1", ("drift_cause", "state"), low=-_LARGEST, high=_LARGEST),
        "base_inductance": Entry("H", ("state",), low=0.0, high=1e6, gaps=True),
        "coil": Entry(None, ("coil",)),
        "coil_x": _PLACE,
        "coil_y": _PLACE,
    },
    {
        "noise": Entry("1", low=1e-15, high=1.0),
        "repeats": Entry("1", low=1.0, high=1e9),
        "emulated": Entry("1", low=0.0, high=1.0),
        "origin": Entry(None),
        "origin_x": Entry("m", low=-_FARTHEST, high=_FARTHEST),
        "origin_y": Entry("m", low=-_FARTHEST, high=_FARTHEST),
    },
)  # fmt: skip
"""Response over the depth of an indentation.

δ and its deviation are NaN where a position was not measured.
"""

_OF_TARGET = tuple("distance" if dim == "depth" else dim for dim in _OVER)
TARGET_MAP = replace(
    RESPONSE, summary="delta over distance, y, x and state, with coordinates",
    variables={
        **{name: entry for name, entry in RESPONSE.variables.items() if name != "depth"},
        "delta": replace(RESPONSE.variables["delta"], dims=_OF_TARGET),
        "delta_std": replace(RESPONSE.variables["delta_std"], dims=_OF_TARGET),
        "readable": replace(RESPONSE.variables["readable"], dims=_OF_TARGET),
        "delta_error": Entry("1", _OF_TARGET, low=0.0, high=_LARGEST),
        "distance": replace(RESPONSE.variables["depth"], dims=("distance",)),
    },
)  # fmt: skip
"""Map over the distance of a target."""


def checked_response(response: xr.Dataset) -> xr.Dataset:
    """Return a response or target map in float64.

    A LocalizeError names any fault.
    """
    checked = (TARGET_MAP if is_of_target(response) else RESPONSE).checked(response, "a response")
    if bool(checked["delta"].isnull().any()):
        raise LocalizeError("delta of a response must be finite everywhere.")
    return checked
