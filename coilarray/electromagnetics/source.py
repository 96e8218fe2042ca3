"""Common input of coils: an array, conductors, or plain vertices."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from coilarray.errors import GeometryError
from coilarray.geometry import CoilArray, Conductor

Source: TypeAlias = CoilArray | Conductor | npt.NDArray[np.float64] | Sequence[Conductor | npt.ArrayLike]
"""Current paths: an array, a conductor, a polyline (n + 1, 3) in m, or a sequence of conductors or polylines."""


def as_conductors(source: Source) -> tuple[Conductor, ...]:
    """Return the current paths of any coil description.

    Plain arrays are polylines in m, which are thin filaments. No path at all, or an array that is not a polyline,
    raises a GeometryError.

    >>> square = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 0]]
    >>> len(as_conductors(np.array(square))), len(as_conductors([square, square]))
    (1, 2)
    """
    if isinstance(source, CoilArray):
        return source.conductors()
    if isinstance(source, Conductor):
        return (source,)
    if isinstance(source, np.ndarray) and source.ndim == 2:
        return (Conductor(source, name="path 1"),)
    items = list(source)
    if not items:
        raise GeometryError("at least one current path is needed; got none.")
    if not any(isinstance(item, Conductor) for item in items) and np.ndim(items[0]) == 1:
        return (Conductor(np.asarray(items, dtype=np.float64), name="path 1"),)
    return tuple(
        item if isinstance(item, Conductor) else Conductor(item, name=f"path {k + 1}") for k, item in enumerate(items)
    )
