"""Which states of a response answer, and where: those to show first."""

from __future__ import annotations

from typing import Literal

import numpy as np
import xarray as xr

NO_ANSWER = 1e-8
"""Largest |δ| that counts as none: the converter's last digits."""
_ROUNDING = 1e-9  # m
_ANSWERS = 0.25  # of the largest |δ| of all states: those with less come last


def middle_state(response: xr.Dataset) -> str:
    """Return the state that answers nearest to the middle of the map, see `answering_states`."""
    return str(response.state.values[_middle_first(response)[0]])


def answering_states(response: xr.Dataset, most: int) -> list[int]:
    """Return the numbers of at most so many states, rising: those that answer, the nearest to the map's middle first.

    A state is where its |δ| is largest for the deepest dent; it answers with a quarter of what the strongest has.
    """
    return sorted(_middle_first(response)[:most])


def _middle_first(response: xr.Dataset) -> list[int]:
    """Numbers of all states: those that answer by their distance from the middle of the map, then the others."""
    size = np.abs(response.delta.isel(depth=-1).transpose("y", "x", "state").values)
    size = np.nan_to_num(size).reshape(-1, response.sizes["state"])
    y, x = np.meshgrid(response.y.values, response.x.values, indexing="ij")
    peak, at = size.max(axis=0), size.argmax(axis=0)
    middle = [(axis.min() + axis.max()) / 2 for axis in (x, y)]
    distance = np.hypot(x.ravel()[at] - middle[0], y.ravel()[at] - middle[1])
    # of equally near ones that with the larger peak, or the first: a symmetric board is that to the mesh's error only
    order = np.lexsort((-(peak / (peak.max() or 1.0)).round(2), distance.round(9), peak < _ANSWERS * peak.max()))
    return [int(k) for k in order]


def main_line(response: xr.Dataset, along: Literal["x", "y"], state: str | None = None) -> int:
    """Return the number of the line along x or y, counted across it, on which a state has the largest |δ|.

    Of the deepest dent, and by default of the middle state; of equal ones, to a part in 1e9, that nearest to the middle
    of the map.
    """
    across = "y" if along == "x" else "x"
    of = response.delta.isel(depth=-1).sel(state=middle_state(response) if state is None else state)
    size = np.abs(of).max(along).fillna(0.0).values
    largest = np.flatnonzero(size >= size.max() * (1 - 1e-9))
    middle = (response.sizes[across] - 1) / 2
    return int(largest[np.abs(largest - middle).argmin()])


def coils_outside(response: xr.Dataset) -> list[str]:
    """Return the names of the coils whose centres lie outside the positions of a map."""
    outside = np.zeros(response.sizes["coil"], dtype=np.bool_)
    for axis in ("x", "y"):
        at, centres = response[axis].values, response[f"coil_{axis}"].values
        if len(at) > 1:
            outside |= (centres < at.min() - _ROUNDING) | (centres > at.max() + _ROUNDING)
    return [str(name) for name in response.coil.values[outside]]
