"""Readings that coils must have for an indentation at a place, from their ellipses, and errors of places found."""

import numpy as np
from scipy.optimize import brentq

from coilarray.errors import LocalizeError
from coilarray.paper.ellipse_model import locate_x

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


def x_errors(model, response):
    """Errors of x in m at the places between the outer centres that have a position, and how many have none."""
    errors, lost = [], 0
    between = response.delta.isel(depth=0).transpose("y", "x", "state").sel(x=np.abs(response.x) <= 13.3e-3)
    for row in between:
        for cell in row:
            try:
                found = locate_x(model, dict(zip(cell.state.values.tolist(), cell.values.tolist(), strict=True)))
                errors.append(found.x - float(cell.x))
            except LocalizeError:
                lost += 1
    return np.array(errors), lost
