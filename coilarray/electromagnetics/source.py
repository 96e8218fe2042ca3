"""Common input of coils: current paths, conductors, or plain vertices."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, Protocol, TypeAlias

import numpy as np
import numpy.typing as npt

from coilarray.errors import GeometryError
from coilarray.geometry import Conductor


class HasConductors(Protocol):
    """Spiral, coil, array or design."""

    def conductors(self) -> tuple[Conductor, ...]:
        """Return the current paths."""


Source: TypeAlias = (
    HasConductors | Conductor | npt.NDArray[np.float64] | Sequence[HasConductors | Conductor | npt.ArrayLike]
)
"""Current paths: spiral, coil, array, design, conductor, polyline (n + 1, 3) in m, or several."""


def as_conductors(source: Source) -> tuple[Conductor, ...]:
    """Return the current paths of any coil description.

    Plain arrays are polylines in m, which are thin filaments.

    >>> square = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 0]]
    >>> len(as_conductors(np.array(square))), len(as_conductors([square, square]))
    (1, 2)
    """
    if isinstance(source, np.ndarray) and source.ndim == 2:
        return (Conductor(source, name="path 1"),)
    if isinstance(source, Conductor) or hasattr(source, "conductors"):
        return _paths_of(source, 1)
    if not isinstance(source, Iterable) or isinstance(source, str):
        raise GeometryError(
            "current paths must be a Spiral, Coil, Array, Design or Conductor, points, or a list of them; "
            f"got {source!r:.60}."
        )
    items = list(source)
    if not items:
        raise GeometryError("at least one current path is needed; got none.")
    if not isinstance(items[0], Conductor) and not hasattr(items[0], "conductors") and np.ndim(items[0]) == 1:
        return (Conductor(items, name="path 1"),)
    return tuple(path for k, item in enumerate(items) for path in _paths_of(item, k + 1))


def _paths_of(item: Any, number: int) -> tuple[Conductor, ...]:
    if isinstance(item, Conductor):
        return (item,)
    found = getattr(item, "conductors", None)
    return (Conductor(item, name=f"path {number}"),) if found is None else tuple(found())
