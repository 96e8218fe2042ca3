"""Where and how deep a map presses, and the contact there: what every kind of response map begins with."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
import numpy.typing as npt
import xarray as xr

from coilarray.design.model import Design, Indentation
from coilarray.elastomer.compliance import Base
from coilarray.elastomer.contact import indent
from coilarray.errors import ElastomerError
from coilarray.geometry import Indenter, Sheet

FloatArray = npt.NDArray[np.float64]

_FARTHEST = 1.0  # m


def indentation_of(design: Design) -> Indentation:
    """Return how a design is indented; ElastomerError where it says nothing of it."""
    if design.indentation is None:
        raise ElastomerError(f"the design {design.name} has no [indenter] and [indentation].")
    return design.indentation


def map_axis(name: str, values: npt.ArrayLike) -> FloatArray:
    """Return depths or positions in m, shape (n,); ElastomerError where they are not finite and rising."""
    array = np.atleast_1d(np.asarray(values, dtype=np.float64))
    if array.ndim != 1 or not array.size or not np.isfinite(array).all() or (np.diff(array) <= 0).any():
        raise ElastomerError(f"{name} must be finite and rising, in m; got {array}.")
    if np.abs(array).max() > _FARTHEST:
        raise ElastomerError(f"{name} must be at most {_FARTHEST} m from the map's origin; got {array} m.")
    return array


def contact_at(setup: Indentation, sheets: Sequence[Sheet], depths: FloatArray) -> xr.Dataset:
    """As `coilarray.elastomer.contact.indent`; what was solved last is kept, as coils may change under one sheet."""
    return _kept_contact(
        tuple(sheets), setup.indenter, setup.base, setup.sample_radius, tuple(np.atleast_1d(depths).tolist())
    )


@lru_cache(maxsize=8)
def _kept_contact(
    sheets: tuple[Sheet, ...], indenter: Indenter, base: Base, radius: float | None, depths: tuple[float, ...]
) -> xr.Dataset:
    return indent(sheets, indenter, depths, base=base, radius=radius)


def require_inside(setup: Indentation, places: FloatArray, contact_radius: float) -> None:
    """Refuse places, shape (n, 2) in m from the map's origin, where the contact leaves the sample: ElastomerError."""
    if setup.sample_bounds is None:
        return
    x_min, y_min, x_max, y_max = setup.sample_bounds
    low, high = [x_min + contact_radius, y_min + contact_radius], [x_max - contact_radius, y_max - contact_radius]
    out = (places < low) | (places > high)
    if out.any():
        x, y = places[int(np.flatnonzero(out.any(axis=1))[0])] * 1e3
        raise ElastomerError(
            f"at ({x:.4g}, {y:.4g}) mm the contact of {contact_radius * 1e3:.3g} mm radius is outside the sample, "
            f"which reaches from ({x_min * 1e3:.4g}, {y_min * 1e3:.4g}) to ({x_max * 1e3:.4g}, {y_max * 1e3:.4g}) mm."
        )
