"""Smooth boards of known formula for the tests of `coilarray.localize`: a bell with a negative ring over every coil."""

import numpy as np
import xarray as xr

ROW = [(-13e-3, 0.0), (0.0, 0.0), (13e-3, 0.0), (26e-3, 0.0)]
"""Coils in a line, as on a board that is symmetric in y."""

FIELD = [(-8e-3, -7e-3), (8e-3, -6e-3), (0.0, 8e-3), (-13e-3, 6e-3), (14e-3, 7e-3)]
"""Coils without any symmetry."""


def bells(points, centres, peak=4e-3, width=7e-3):
    """δ of every coil, shape (…, coils), at points (…, 3): peak at a depth of 1 mm, a little wider where deeper."""
    x, y, h = np.moveaxis(np.asarray(points, dtype=float), -1, 0)
    delta = []
    for at_x, at_y in centres:
        far = ((x - at_x) ** 2 + (y - at_y) ** 2) / (width * (1 + 100 * h)) ** 2
        delta.append(peak * (h / 1e-3) ** 1.6 * (1.15 * np.exp(-far) - 0.15 * np.exp(-far / 4)))
    return np.stack(delta, axis=-1)


def response(function, states, x, y, depth):
    """Dataset of a function of points (…, 3) in m with values (…, states), over a grid."""
    X, Y, H = np.meshgrid(x, y, depth, indexing="ij")
    values = function(np.stack([X, Y, H], axis=-1))
    coords = {"x": x, "y": y, "depth": depth, "state": list(states)}
    table = xr.Dataset({"delta": (("x", "y", "depth", "state"), values)}, coords)
    return table.transpose("depth", "y", "x", "state")


def board(centres, step=1e-3, depth=None, **shape):
    """Response of the bells over all coils, in steps of `step`."""
    x = np.arange(min(c[0] for c in centres) - 8e-3, max(c[0] for c in centres) + 8.1e-3, step)
    y = np.arange(-10e-3, 10.1e-3, step)
    h = np.linspace(0.2e-3, 1.8e-3, 9) if depth is None else depth
    names = [f"coil{k + 1}" for k in range(len(centres))]
    return response(lambda points: bells(points, centres, **shape), names, x, y, h)
