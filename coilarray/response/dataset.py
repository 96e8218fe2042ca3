"""Dataset of a response: schema, positions and main states.

The response may be computed, measured, of a target, or of another program. A map counts positions
from its origin.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import xarray as xr

from coilarray.compute.arrays import FloatArray
from coilarray.compute.display_units import MM
from coilarray.compute.netcdf import Entry, Schema
from coilarray.errors import LocalizeError

if TYPE_CHECKING:
    from coilarray.design.model import Indentation
    from coilarray.geometry import Target

ELLIPSE_WINDOW = "ellipse_window"  # attribute of a map for the window (x_min, y_min, x_max, y_max) in m of the ellipses

_BOARD = "board"
_NEAR = 1e-9  # m
_PICOMETRE = 12  # digits of m, for the sum of a shift and a number of few digits
_OVER = ("depth", "y", "x", "state")
_FARTHEST = 10.0  # m. Larger values are a map in mm
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
NO_ANSWER = 1e-8  # largest |δ| that counts as zero, the converter's last digits
_ROUNDING = 1e-9  # m
_ANSWERS = 0.25  # of the largest |δ| of all states. Weaker states come last


def origin_attributes(setup: Indentation | Target) -> dict[str, str | float]:
    """Return the origin's name, x and y as attributes."""
    x, y = setup.origin_point
    return {"origin": setup.origin or _BOARD, "origin_x": float(x), "origin_y": float(y)}


def map_coordinates(
    setup: Indentation | Target,
    x: FloatArray,
    y: FloatArray,
    states: Sequence[str],
    coils: Sequence[str],
    centres: FloatArray,
) -> dict[str, Any]:
    """Return the coordinates of places, states and coils.

    Places count from the map's origin, and `centres` (coils, 2) from the board's, in m.
    """
    return {
        "y": ("y", y, {"units": "m"}),
        "x": ("x", x, {"units": "m"}),
        "state": list(states),
        "other": list(coils),
        **coil_coordinates(setup, coils, centres),
    }


def coil_coordinates(setup: Indentation | Target | None, coils: Sequence[str], centres: FloatArray) -> dict[str, Any]:
    """Return the map's coordinates of coils, centred on the board."""
    from_origin = centres - map_origin(setup)
    return {
        "coil": list(coils),
        "coil_x": ("coil", from_origin[:, 0], {"units": "m", "long_name": "centre of the coil, x"}),
        "coil_y": ("coil", from_origin[:, 1], {"units": "m", "long_name": "centre of the coil, y"}),
    }


def map_origin(setup: Indentation | Target | None) -> tuple[float, float]:
    """Return the origin of a map on the board."""
    return (0.0, 0.0) if setup is None else setup.origin_point


def from_board(positions: Iterable[float], origin: float) -> tuple[float, ...]:
    """Return positions on the board from a map's origin."""
    return tuple(round(float(position) - origin, _PICOMETRE) for position in positions)


def origin_of(response: xr.Dataset) -> tuple[float, float]:
    """Return a response's origin on the board, by default zero."""
    return float(response.attrs.get("origin_x", 0.0)), float(response.attrs.get("origin_y", 0.0))


def on_board(response: xr.Dataset) -> xr.Dataset:
    """Return a response that counts from the board's origin.

    >>> from coilarray import load_design
    >>> from coilarray.response.map import response_map
    >>> response = response_map(load_design("gast2020"), x=[0], y=[0])  # counted from coil2
    >>> float(response.x[0]), float(on_board(response).x[0])
    (0.0, -0.01992)
    """
    origin = origin_of(response)
    if origin == (0.0, 0.0):
        return response
    moved = {
        name: response[name].copy(data=response[name].values + shift)
        for axis, shift in zip("xy", origin, strict=True)
        for name in (axis, f"coil_{axis}")
        if name in response.coords
    }
    about: dict[str, Any] = {"origin": _BOARD, "origin_x": 0.0, "origin_y": 0.0}
    if (window := response.attrs.get(ELLIPSE_WINDOW)) is not None:
        about[ELLIPSE_WINDOW] = [float(edge) + at for edge, at in zip(window, 2 * origin, strict=True)]
    return response.assign_coords(moved).assign_attrs(about)


def in_ellipse_window(response: xr.Dataset) -> xr.Dataset:
    """Return the part of a map for fitting ellipses."""
    window = response.attrs.get(ELLIPSE_WINDOW)
    if window is None:
        return response
    x_min, y_min, x_max, y_max = (float(edge) for edge in window)
    x, y = response.x, response.y
    within = {"x": (x > x_min - _NEAR) & (x < x_max + _NEAR), "y": (y > y_min - _NEAR) & (y < y_max + _NEAR)}
    return response.isel({axis: there.values for axis, there in within.items()})


def is_of_target(response: xr.Dataset) -> bool:
    """Return whether a response is over a target's distance."""
    return "distance" in response.dims


def as_depths(response: xr.Dataset) -> xr.Dataset:
    """Return a target's map with distances as depths, nearest last."""
    return over_depth(response.isel(distance=slice(None, None, -1)) if is_of_target(response) else response)


def over_depth(response: xr.Dataset) -> xr.Dataset:
    """Return a target's map with distances named depths, unsorted."""
    return response.rename(distance="depth").assign_attrs(over="distance") if is_of_target(response) else response


def depth_words(response: xr.Dataset, depth: int) -> str:
    """Return a depth in words, such as "1 mm deep"."""
    return f"{MM.text(response.depth[depth])} {'away' if response.attrs.get('over') == 'distance' else 'deep'}"


def axis_label(response: xr.Dataset, axis: str) -> str:
    """Return the label of an axis of positions in mm."""
    name = response.attrs.get("origin", _BOARD)
    if name != _BOARD:
        return f"{axis} from {name} (mm)"
    return f"{axis} (mm)" if origin_of(response) == (0.0, 0.0) else f"{axis} from the map's origin (mm)"


def checked_response(response: xr.Dataset) -> xr.Dataset:
    """Return a response or target map in float64, checked."""
    checked = (TARGET_MAP if is_of_target(response) else RESPONSE).checked(response, "a response")
    if bool(checked["delta"].isnull().any()):
        raise LocalizeError("delta of a response must be finite everywhere.")
    return checked


def middle_state(response: xr.Dataset) -> str:
    """Return the state that responds nearest to the map's middle."""
    return str(response.state.values[_middle_first(response)[0]])


def answering_states(response: xr.Dataset, most: int) -> list[int]:
    """Return at most `most` responding states nearest to the middle.

    The place of a state is the position of its largest |δ| for the deepest dent. A state responds
    if it reaches a quarter of the strongest state.
    """
    return sorted(_middle_first(response)[:most])


def _middle_first(response: xr.Dataset) -> list[int]:
    """All states from the middle outwards, the responding states first."""
    size = np.abs(response.delta.isel(depth=-1).transpose("y", "x", "state").values)
    size = np.nan_to_num(size).reshape(-1, response.sizes["state"])
    y, x = np.meshgrid(response.y.values, response.x.values, indexing="ij")
    peak, at = size.max(axis=0), size.argmax(axis=0)
    middle = [(axis.min() + axis.max()) / 2 for axis in (x, y)]
    distance = np.hypot(x.ravel()[at] - middle[0], y.ravel()[at] - middle[1])
    # Of equally near states, the larger peak counts, or the first: symmetric to the mesh's error.
    order = np.lexsort((-(peak / (peak.max() or 1.0)).round(2), distance.round(9), peak < _ANSWERS * peak.max()))
    return [int(k) for k in order]


def main_line(response: xr.Dataset, along: Literal["x", "y"], state: str | None = None) -> int:
    """Return the line along an axis with the largest |δ|.

    It is the |δ| of the deepest dent in the middle state by default. Of equal lines the nearest to
    the middle of the map is taken.
    """
    across = "y" if along == "x" else "x"
    of = response.delta.isel(depth=-1).sel(state=middle_state(response) if state is None else state)
    size = np.abs(of).max(along).fillna(0.0).values
    largest = np.flatnonzero(size >= size.max() * (1 - 1e-9))
    middle = (response.sizes[across] - 1) / 2
    return int(largest[np.abs(largest - middle).argmin()])


def coils_outside(response: xr.Dataset) -> list[str]:
    """Return the coils whose centres are outside a map."""
    outside = np.zeros(response.sizes["coil"], dtype=np.bool_)
    for axis in ("x", "y"):
        at, centres = response[axis].values, response[f"coil_{axis}"].values
        if len(at) > 1:
            outside |= (centres < at.min() - _ROUNDING) | (centres > at.max() + _ROUNDING)
    return [str(name) for name in response.coil.values[outside]]
