"""Where the positions of a response are on the board: a map counts them from an origin of its own."""

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
"""Attribute of a map: the window (x_min, y_min, x_max, y_max) in m to which ellipses are fitted."""

_BOARD = "board"
_NEAR = 1e-9  # m
_PICOMETRE = 12  # digits of m: what a shift adds to a number of few digits


def origin_attributes(setup: Indentation | Target) -> dict[str, str | float]:
    """Return the attributes of a response that say what its positions count from: a name, and x and y in m."""
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
    """Return the coordinates of a map that it shares with all others: places, states and coils.

    Places `x` and `y` in m count from the map's origin, the coils' `centres`, shape (coils, 2), from the board's.
    """
    return {
        "y": ("y", y, {"units": "m"}),
        "x": ("x", x, {"units": "m"}),
        "state": list(states),
        "other": list(coils),
        **coil_coordinates(setup, coils, centres),
    }


def coil_coordinates(setup: Indentation | Target | None, coils: Sequence[str], centres: FloatArray) -> dict[str, Any]:
    """Return the coordinates of the coils in a map: their names, and their `centres` on the board from its origin."""
    from_origin = centres - map_origin(setup)
    return {
        "coil": list(coils),
        "coil_x": ("coil", from_origin[:, 0], {"units": "m", "long_name": "centre of the coil, x"}),
        "coil_y": ("coil", from_origin[:, 1], {"units": "m", "long_name": "centre of the coil, y"}),
    }


def map_origin(setup: Indentation | Target | None) -> tuple[float, float]:
    """Return x and y in m on the board from which a map counts; the board's own origin where there is no setup."""
    return (0.0, 0.0) if setup is None else setup.origin_point


def from_board(positions: Iterable[float], origin: float) -> tuple[float, ...]:
    """Return positions in m along one axis of the board as counted from a map's origin, which lies at `origin` in m."""
    return tuple(round(float(position) - origin, _PICOMETRE) for position in positions)


def origin_of(response: xr.Dataset) -> tuple[float, float]:
    """Return x and y in m on the board from which the positions of a response count; zero where it does not say."""
    return float(response.attrs.get("origin_x", 0.0)), float(response.attrs.get("origin_y", 0.0))


def on_board(response: xr.Dataset) -> xr.Dataset:
    """Return a response whose positions, and the centres of its coils, count from the board's origin.

    Parameters
    ----------
    response : xarray.Dataset
        Response, simulated or measured, with the coordinates x and y, and perhaps coil_x and coil_y, in m.

    Returns
    -------
    xarray.Dataset
        The same values at the places on the board where they are; the response itself where it counts from there.

    Raises
    ------
    LocalizeError
        A response, as of an earlier version, that counts from a coil and does not say where that is on the board.

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
    """Return the part of a map to which ellipses are fitted.

    All of it, unless the map has a window for that.
    """
    window = response.attrs.get(ELLIPSE_WINDOW)
    if window is None:
        return response
    x_min, y_min, x_max, y_max = (float(edge) for edge in window)
    x, y = response.x, response.y
    within = {"x": (x > x_min - _NEAR) & (x < x_max + _NEAR), "y": (y > y_min - _NEAR) & (y < y_max + _NEAR)}
    return response.isel({axis: there.values for axis, there in within.items()})


def is_of_target(response: xr.Dataset) -> bool:
    """Whether a response is over the distance of a target, not over the depth of an indentation."""
    return "distance" in response.dims


def as_depths(response: xr.Dataset) -> xr.Dataset:
    """Return a target's map in the form of an indentation's: its distances as depths, the nearest one last.

    A response of an indentation is returned as it is.
    """
    if not is_of_target(response):
        return response
    return over_depth(response.isel(distance=slice(None, None, -1)))


def over_depth(response: xr.Dataset) -> xr.Dataset:
    """Return a target's map with its distances called depths, in their order; a response of an indentation as it is."""
    return response.rename(distance="depth").assign_attrs(over="distance") if is_of_target(response) else response


def depth_words(response: xr.Dataset, depth: int) -> str:
    """Write a depth of a response by its index, as "1 mm deep"; that of a target's map as "1 mm away"."""
    return f"{MM.text(response.depth[depth])} {'away' if response.attrs.get('over') == 'distance' else 'deep'}"


def axis_label(response: xr.Dataset, axis: str) -> str:
    """Return the label of an axis of positions in mm, with the coil from which they count where it is not the board."""
    name = response.attrs.get("origin", _BOARD)
    if name != _BOARD:
        return f"{axis} from {name} (mm)"
    return f"{axis} (mm)" if origin_of(response) == (0.0, 0.0) else f"{axis} from the map's origin (mm)"
