"""The usual distance of a coil's turns, measured on its lines."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]

_ALONG = 0.9  # cosine of the angle between traces from which they run side by side


def turn_gap(lines: Sequence[FloatArray], layers: Sequence[str], widths: Sequence[FloatArray]) -> float | None:
    """Median distance, edge to edge, of traces side by side with the current in the same direction.

    Parameters
    ----------
    lines : sequence of ndarray, each of shape (n, 2)
        Centre lines in m.
    layers : sequence of str
        Copper layer of each line.
    widths : sequence of ndarray, each of shape (n − 1,)
        Of the segments in m.

    Returns
    -------
    float or None
        In m, weighted by length. None where no two traces of a layer run so: leads, opposite sides of a loop and the
        legs of a hairpin do not count.

    Examples
    --------
    >>> there_and_back = np.array([[0, 0], [9, 0], [9, 5], [-1, 5], [-1, 1], [8, 1.0]]) * 1e-3
    >>> round(turn_gap([there_and_back], ["L1"], [np.full(5, 0.2e-3)]) * 1e3, 6)
    0.8
    """
    gaps: list[float] = []
    weights: list[float] = []
    for layer in dict.fromkeys(layers):
        own = [k for k, name in enumerate(layers) if name == layer]
        start = np.vstack([lines[k][:-1] for k in own])
        step = np.vstack([np.diff(lines[k], axis=0) for k in own])
        width = np.concatenate([widths[k] for k in own])
        length = np.hypot(*step.T)
        along = step / length[:, None]
        for i in range(len(start)):
            gap = _nearest(start + step / 2, start, step, along, width, i)
            if gap is not None:
                gaps.append(gap)
                weights.append(float(length[i]))
    if not gaps:
        return None
    order = np.argsort(gaps)
    share = np.cumsum(np.array(weights)[order])
    return gaps[int(order[np.searchsorted(share, share[-1] / 2)])]


def _nearest(
    middle: FloatArray, start: FloatArray, step: FloatArray, along: FloatArray, width: FloatArray, i: int
) -> float | None:
    """Distance to either side of segment i, from its middle, to the nearest trace that runs the same way."""
    parallel = along @ along[i] > _ALONG
    parallel[i] = False
    from_middle, way = start[parallel] - middle[i], step[parallel]
    part = -(from_middle @ along[i]) / (way @ along[i])
    beside = (part >= 0) & (part <= 1)
    normal = np.array([-along[i, 1], along[i, 0]])
    across = np.abs((from_middle + part[:, None] * way) @ normal)[beside]
    gaps = across - (width[i] + width[parallel][beside]) / 2
    gaps = gaps[gaps > 0]
    return float(gaps.min()) if gaps.size else None
