"""Readings that coils must have for an indentation at a place, from their ellipses."""

from __future__ import annotations

import numpy as np
from scipy.optimize import brentq

_PARTS = 2000  # of the range in which a reading is looked for; the polynomials have few turns


def readings_at(coil, x, y):
    """Every δ, rising, at which the place is on the coil's ellipse: changes of sign of (x − x0)²/A² + y²/B² − 1."""

    def outside(delta):
        x0, A, B = coil.curves(delta)
        return np.hypot((x - x0) * B, y * A) - A * B  # times A B, which may vanish

    deltas = np.linspace(coil.lowest, coil.highest, _PARTS + 1)
    sign = outside(deltas) > 0
    changes = np.flatnonzero(sign[1:] != sign[:-1])
    return tuple(brentq(lambda d: float(outside(d)), deltas[k], deltas[k + 1], xtol=1e-15) for k in changes)
