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
    """Return the state with the largest δ where the deepest dent is in the middle of the map."""
    deepest = response.delta.isel(depth=-1)
    at_middle = deepest.isel(x=response.sizes["x"] // 2, y=response.sizes["y"] // 2).fillna(-np.inf)
    return str(response.state.values[int(at_middle.argmax("state"))])


def answering_states(response: xr.Dataset, most: int) -> list[int]:
    """Return the numbers of at most so many states, rising: those that answer, the nearest to the map's middle first.

    A state is where its |δ| is largest for the deepest dent; it answers with a quarter of what the strongest has.
    """
    size = np.abs(response.delta.isel(depth=-1).transpose("y", "x", "state").values)
    size = np.nan_to_num(size).reshape(-1, response.sizes["state"])
    y, x = np.meshgrid(response.y.values, response.x.values, indexing="ij")
    peak, at = size.max(axis=0), size.argmax(axis=0)
    middle = [(axis.min() + axis.max()) / 2 for axis in (x, y)]
    distance = np.hypot(x.ravel()[at] - middle[0], y.ravel()[at] - middle[1])
    order = np.lexsort((-peak, distance.round(9), peak < _ANSWERS * peak.max()))
    return sorted(order[:most].tolist())


def main_line(response: xr.Dataset, along: Literal["x", "y"]) -> int:
    """Return the number of the line along x or y, counted across it, on which the deepest dent has the largest |δ|.

    Of equal ones, to a part in 1e9, that nearest to the middle.
    """
    across = "y" if along == "x" else "x"
    size = np.abs(response.delta.isel(depth=-1)).max(("state", along)).fillna(0.0).values
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
