"""States of a response to show first.

They are ordered by where they respond.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
import xarray as xr

NO_ANSWER = 1e-8
"""Largest |δ| that counts as zero.

It covers the converter's last digits.
"""
_ROUNDING = 1e-9  # m
_ANSWERS = 0.25  # of the largest |δ| of all states; weaker states come last


def middle_state(response: xr.Dataset) -> str:
    """Return the state that responds nearest to the map's middle.

    See `answering_states`.
    """
    return str(response.state.values[_middle_first(response)[0]])


def answering_states(response: xr.Dataset, most: int) -> list[int]:
    """Return the numbers of responding states, rising.

    At most the given number of states is returned. The responding states nearest to the map's middle are taken first.
    The place of a state is the position of its largest |δ| for the deepest dent. A state responds if it reaches a
    quarter of the strongest state.
    """
    return sorted(_middle_first(response)[:most])


def _middle_first(response: xr.Dataset) -> list[int]:
    """Numbers of all states, from the middle outwards.

    The responding states come first, by their distance from the middle of the map, then the others.
    """
    size = np.abs(response.delta.isel(depth=-1).transpose("y", "x", "state").values)
    size = np.nan_to_num(size).reshape(-1, response.sizes["state"])
    y, x = np.meshgrid(response.y.values, response.x.values, indexing="ij")
    peak, at = size.max(axis=0), size.argmax(axis=0)
    middle = [(axis.min() + axis.max()) / 2 for axis in (x, y)]
    distance = np.hypot(x.ravel()[at] - middle[0], y.ravel()[at] - middle[1])
    # Of equally near states, the state with the larger peak or the first is taken. A symmetric board is symmetric only
    # to the mesh's error.
    order = np.lexsort((-(peak / (peak.max() or 1.0)).round(2), distance.round(9), peak < _ANSWERS * peak.max()))
    return [int(k) for k in order]


def main_line(response: xr.Dataset, along: Literal["x", "y"], state: str | None = None) -> int:
    """Return the line along an axis with largest |δ|.

    The line runs along x or y, and its number is counted across it. The deepest dent counts, and by default
    the middle state. Of lines equal to a part in 1e9, the nearest to the middle of the map is taken.
    """
    across = "y" if along == "x" else "x"
    of = response.delta.isel(depth=-1).sel(state=middle_state(response) if state is None else state)
    size = np.abs(of).max(along).fillna(0.0).values
    largest = np.flatnonzero(size >= size.max() * (1 - 1e-9))
    middle = (response.sizes[across] - 1) / 2
    return int(largest[np.abs(largest - middle).argmin()])


def coils_outside(response: xr.Dataset) -> list[str]:
    """Return the names of coils outside a map's positions.

    The centres of the coils count.
    """
    outside = np.zeros(response.sizes["coil"], dtype=np.bool_)
    for axis in ("x", "y"):
        at, centres = response[axis].values, response[f"coil_{axis}"].values
        if len(at) > 1:
            outside |= (centres < at.min() - _ROUNDING) | (centres > at.max() + _ROUNDING)
    return [str(name) for name in response.coil.values[outside]]
