"""Current path of a coil, made of straight bars."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from coilarray.compute.arrays import FloatArray
from coilarray.errors import LARGEST, GeometryError

SMALLEST = 1 / LARGEST
"""Least length in m."""

_STRAIGHT = 1e-6  # rad: less is not a bend


@dataclass(frozen=True, eq=False)
class Conductor:
    """Current path of straight segments, each a rectangular bar.

    A bar runs from vertex to vertex. Its width lies in the x-y plane across the segment, for a
    vertical segment along x. Its thickness is perpendicular to both. A width and thickness of zero
    stand for a thin filament.

    Raises GeometryError if there are fewer than two vertices, values that are not finite or beyond
    1e30 m, a segment of length zero, a negative width, or a bar with a width and no thickness.

    Parameters
    ----------
    vertices : array_like, shape (n + 1, 3)
        Points of the path in m, in the direction of the current, up to 1e30. Neighbours must differ
        by at least 1e-30.
    widths, thicknesses : array_like, shape (n,) or scalar
        Cross-section in m that determines the inductance. Both are zero or both positive.
    areas : array_like, shape (n,) or scalar, optional
        Conducting cross-section in m² that determines the resistance. By default it is width ×
        thickness.
    name : str
        Name shown in messages and results.

    Examples
    --------
    >>> wire = Conductor([[0, 0, 0], [1e-2, 0, 0]], 0.15e-3, 35e-6)
    >>> wire.lengths
    array([0.01])
    """

    vertices: FloatArray
    widths: FloatArray
    thicknesses: FloatArray
    areas: FloatArray
    name: str

    def __init__(
        self,
        vertices: npt.ArrayLike,
        widths: npt.ArrayLike = 0.0,
        thicknesses: npt.ArrayLike = 0.0,
        areas: npt.ArrayLike | None = None,
        name: str = "path",
    ) -> None:
        try:
            points = np.array(vertices, dtype=np.float64, order="C")
        except (TypeError, ValueError):
            raise GeometryError(f"vertices of {name} must be numbers of shape (n + 1, 3).") from None
        if points.ndim != 2 or points.shape[1] != 3 or points.shape[0] < 2:
            raise GeometryError(f"vertices of {name} must have shape (n + 1 >= 2, 3); got {points.shape}.")
        wild = ~np.isfinite(points).all(axis=1)
        if wild.any():
            raise GeometryError(f"vertices of {name} must be finite; vertex {np.argmax(wild)} is not.")
        if np.abs(points).max() > LARGEST:
            raise GeometryError(f"vertices of {name} must be at most {LARGEST:g} m; got {np.abs(points).max():g} m.")
        n = len(points) - 1
        lengths = np.linalg.norm(np.diff(points, axis=0), axis=1)
        if (lengths <= max(1e-13 * np.ptp(points), SMALLEST)).any():
            raise GeometryError(f"segment {int(np.argmin(lengths))} of {name} has length zero.")
        given = {"widths": widths, "thicknesses": thicknesses}
        if areas is not None:
            given["areas"] = areas
        sizes: dict[str, FloatArray] = {}
        for key, value in given.items():
            try:
                array = np.array(np.broadcast_to(np.asarray(value, dtype=np.float64), (n,)), order="C")
            except (TypeError, ValueError):
                message = f"{key} of {name} must be one number or {n}, one a segment; got {value!r}."
                raise GeometryError(message) from None
            if not (np.isfinite(array).all() and (array >= 0).all()):
                raise GeometryError(f"{key} of {name} must be finite and not negative; got {array.min()}.")
            sizes[key] = array
        if ((sizes["widths"] > 0) != (sizes["thicknesses"] > 0)).any():
            raise GeometryError(f"widths and thicknesses of {name} must be both zero or both positive.")
        for key in ("widths", "thicknesses"):
            if ((sizes[key] > 0) & ~((SMALLEST <= sizes[key]) & (sizes[key] <= LARGEST))).any():
                raise GeometryError(f"{key} of {name} must be zero or {SMALLEST:g} to {LARGEST:g} m.")
        if "areas" not in sizes:
            sizes["areas"] = sizes["widths"] * sizes["thicknesses"]
        for key, array in {"vertices": points, **sizes}.items():
            array.setflags(write=False)
            object.__setattr__(self, key, array)
        object.__setattr__(self, "name", name)

    @property
    def lengths(self) -> FloatArray:
        """Length of every segment in m, shape (n,)."""
        return np.asarray(np.linalg.norm(np.diff(self.vertices, axis=0), axis=1))

    def straightened(self) -> Conductor:
        """Return the path without vertices on straight runs.

        A vertex is left out if the segments at it have the same cross-section and direction.

        Returns
        -------
        Conductor
            The same path with as few segments as possible.

        Examples
        --------
        >>> Conductor([[0, 0, 0], [1e-3, 0, 0], [2e-3, 0, 0], [2e-3, 1e-3, 0]]).straightened().vertices[:, 0].tolist()
        [0.0, 0.002, 0.002]
        """
        along = np.diff(self.vertices, axis=0) / self.lengths[:, None]
        bend = np.linalg.norm(np.diff(along, axis=0), axis=1)
        section = np.column_stack((self.widths, self.thicknesses, self.areas))
        turns = (bend > _STRAIGHT) | (np.diff(section, axis=0) != 0).any(axis=1)
        if turns.all():
            return self
        first = np.concatenate(([True], turns))
        vertices = self.vertices[np.append(first, True)]
        return Conductor(vertices, self.widths[first], self.thicknesses[first], self.areas[first], self.name)

    @property
    def is_filament(self) -> bool:
        """Whether any segment has no cross-section."""
        return bool((self.widths == 0).any())
