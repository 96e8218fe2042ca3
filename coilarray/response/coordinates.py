"""Positions of a response on the board.

A map counts positions from an origin of its own.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

import xarray as xr

from coilarray.compute.arrays import FloatArray
from coilarray.compute.display_units import MM
from coilarray.errors import LocalizeError

if TYPE_CHECKING:
    from coilarray.design.model import Indentation
    from coilarray.geometry import Target

ELLIPSE_WINDOW = "ellipse_window"
"""Attribute of a map for the window of ellipses.

The window (x_min, y_min, x_max, y_max) in m is the area to which ellipses are fitted.
"""

_BOARD = "board"
_NEAR = 1e-9  # m
_PICOMETRE = 12  # digits of m, for the sum of a shift and a number of few digits


def origin_attributes(setup: Indentation | Target) -> dict[str, str | float]:
    """Return the attributes for the origin of a response.

    They are its name, and x and y in m.
    """
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
    """Return the coordinates that a map shares with all others.

    They are places, states and coils. Places `x` and `y` in m count from the map's origin. The coils' `centres`, shape
    (coils, 2), count from the board's origin.
    """
    return {
        "y": ("y", y, {"units": "m"}),
        "x": ("x", x, {"units": "m"}),
        "state": list(states),
        "other": list(coils),
        **coil_coordinates(setup, coils, centres),
    }


def coil_coordinates(setup: Indentation | Target | None, coils: Sequence[str], centres: FloatArray) -> dict[str, Any]:
    """Return the coordinates of the coils in a map.

    They are their names, and their `centres` on the board from its origin.
    """
    from_origin = centres - map_origin(setup)
    return {
        "coil": list(coils),
        "coil_x": ("coil", from_origin[:, 0], {"units": "m", "long_name": "centre of the coil, x"}),
        "coil_y": ("coil", from_origin[:, 1], {"units": "m", "long_name": "centre of the coil, y"}),
    }


def map_origin(setup: Indentation | Target | None) -> tuple[float, float]:
    """Return the origin of a map on the board.

    The origin is x and y in m. Without a setup it is the board's own origin.
    """
    return (0.0, 0.0) if setup is None else setup.origin_point


def from_board(positions: Iterable[float], origin: float) -> tuple[float, ...]:
    """Return positions on the board from a map's origin.

    The positions are in m along one axis. The map's origin lies at `origin` in m.
    """
    return tuple(round(float(position) - origin, _PICOMETRE) for position in positions)


def origin_of(response: xr.Dataset) -> tuple[float, float]:
    """Return the origin of a response on the board.

    Its x and y in m are zero if the response does not state them.
    """
    return float(response.attrs.get("origin_x", 0.0)), float(response.attrs.get("origin_y", 0.0))


def on_board(response: xr.Dataset) -> xr.Dataset:
    """Return a response with positions from the board's origin.

    The centres of its coils count from there as well.

    Parameters
    ----------
    response : xarray.Dataset
        Response, simulated or measured, with the coordinates x and y, and perhaps coil_x and coil_y, in m.

    Returns
    -------
    xarray.Dataset
        The same values at their places on the board. If the response already counts from there, it is returned itself.

    Raises
    ------
    LocalizeError
        A response of an earlier version that counts from a coil and does not state the coil's place on the board.

    Examples
    --------
    >>> from coilarray import load_design
    >>> from coilarray.response.map import response_map
    >>> response = response_map(load_design("gast2020"), x=[0], y=[0])  # counted from coil2
    >>> float(response.x[0]), float(on_board(response).x[0])
    (0.0, -0.01992)
    """
    name = response.attrs.get("origin", _BOARD)
    if name != _BOARD and "origin_x" not in response.attrs:
        raise LocalizeError(
            f"the positions of the response count from {name}, and the file does not say where that is on the board; "
            "compute it again."
        )
    origin = origin_of(response)
    if origin == (0.0, 0.0):
        return response
    moved = {
        name: response[name].copy(data=response[name].values + shift)
        for axis, shift in zip("xy", origin, strict=True)
        for name in (axis, f"coil_{axis}")
        if name in response.coords
    }
    window = response.attrs.get(ELLIPSE_WINDOW)
    about = (
        {}
        if window is None
        else {ELLIPSE_WINDOW: [float(edge) + at for edge, at in zip(window, 2 * origin, strict=True)]}
    )
    return response.assign_coords(moved).assign_attrs(about, origin=_BOARD, origin_x=0.0, origin_y=0.0)


def in_ellipse_window(response: xr.Dataset) -> xr.Dataset:
    """Return the part of a map for fitting ellipses.

    It is the whole map if the map has no window for ellipses.
    """
    window = response.attrs.get(ELLIPSE_WINDOW)
    if window is None:
        return response
    x_min, y_min, x_max, y_max = (float(edge) for edge in window)
    x, y = response.x, response.y
    within = {"x": (x > x_min - _NEAR) & (x < x_max + _NEAR), "y": (y > y_min - _NEAR) & (y < y_max + _NEAR)}
    return response.isel({axis: there.values for axis, there in within.items()})


def is_of_target(response: xr.Dataset) -> bool:
    """Check whether a response is over a target's distance.

    Otherwise it is over the depth of an indentation.
    """
    return "distance" in response.dims


def as_depths(response: xr.Dataset) -> xr.Dataset:
    """Return a target's map in the form of an indentation's.

    Its distances become depths, the nearest last. A response of an indentation is returned unchanged.
    """
    if not is_of_target(response):
        return response
    return over_depth(response.isel(distance=slice(None, None, -1)))


def over_depth(response: xr.Dataset) -> xr.Dataset:
    """Return a target's map with its distances called depths.

    Their order stays. A response of an indentation is returned unchanged.
    """
    return response.rename(distance="depth").assign_attrs(over="distance") if is_of_target(response) else response


def depth_words(response: xr.Dataset, depth: int) -> str:
    """Write a depth of a response by its index.

    The text is, for example, "1 mm deep", or for a target's map "1 mm away".
    """
    return f"{MM.text(response.depth[depth])} {'away' if response.attrs.get('over') == 'distance' else 'deep'}"


def axis_label(response: xr.Dataset, axis: str) -> str:
    """Return the label of an axis of positions in mm.

    It names the coil from which they count, if they do not count from the board.
    """
    name = response.attrs.get("origin", _BOARD)
    if name != _BOARD:
        return f"{axis} from {name} (mm)"
    return f"{axis} (mm)" if origin_of(response) == (0.0, 0.0) else f"{axis} from the map's origin (mm)"
