"""Current paths of straight bars, and what shapes that carry currents know of themselves.

Physics and pictures lie above the shapes and are imported only when a value is asked for.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Protocol

import numpy as np
import numpy.typing as npt

from coilarray.compute.arrays import FloatArray, IntArray
from coilarray.errors import LARGEST, GeometryError
from coilarray.geometry.pose import Pose

if TYPE_CHECKING:
    import shapely
    import xarray as xr
    from matplotlib.axes import Axes

    from coilarray.geometry.array import Array
    from coilarray.geometry.coil import Coil

SMALLEST = 1 / LARGEST  # least length in m
CHORD = 1e-3  # deviation of straight pieces from a coil's largest arc, over half its size, by default
_STRAIGHT = 1e-6  # rad: less is not a bend
_VERTICAL = 1e-9  # sine of the angle to z, below which a segment is vertical
_TILTED = 1e-6  # rad of a width against the x-y plane; less is rounding
_ALONG = 1e-6  # sine of the angle between width and segment, below which no direction is left


@dataclass(frozen=True, eq=False)
class Conductor:
    """Current path of straight segments, each a rectangular bar.

    A bar runs from vertex to vertex. Its width lies in the x-y plane across the segment, for a
    vertical segment along x, unless `across` says otherwise. Its thickness is perpendicular to
    both. A width and thickness of zero stand for a thin filament.

    Raises GeometryError if there are fewer than two vertices, values that are not finite or beyond
    1e30 m, a segment of length zero, a negative width, a bar with a width and no thickness, or a
    width along its segment.

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
    across : array_like, shape (n, 3) or (3,), optional
        Direction of the width of every segment. Only its part perpendicular to the segment counts.
        Afterwards it holds unit vectors.

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
    across: FloatArray

    def __init__(
        self,
        vertices: npt.ArrayLike,
        widths: npt.ArrayLike = 0.0,
        thicknesses: npt.ArrayLike = 0.0,
        areas: npt.ArrayLike | None = None,
        name: str = "path",
        across: npt.ArrayLike | None = None,
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
        given = {"widths": widths, "thicknesses": thicknesses} | ({} if areas is None else {"areas": areas})
        sizes: dict[str, FloatArray] = {}
        for key, value in given.items():
            try:
                array = np.array(np.broadcast_to(np.asarray(value, dtype=np.float64), (n,)), order="C")
            except (TypeError, ValueError):
                message = f"{key} of {name} must be one number or {n}, one a segment; got {value!r}."
                raise GeometryError(message) from None
            if not (np.isfinite(array).all() and (array >= 0).all()):
                raise GeometryError(f"{key} of {name} must be finite and not negative; got {array.min()}.")
            if key != "areas" and ((array > 0) & ~((array >= SMALLEST) & (array <= LARGEST))).any():
                raise GeometryError(f"{key} of {name} must be zero or {SMALLEST:g} to {LARGEST:g} m.")
            sizes[key] = array
        if ((sizes["widths"] > 0) != (sizes["thicknesses"] > 0)).any():
            raise GeometryError(f"widths and thicknesses of {name} must be both zero or both positive.")
        sizes.setdefault("areas", sizes["widths"] * sizes["thicknesses"])
        sizes["across"] = _lateral(np.diff(points, axis=0) / lengths[:, None], across, name)
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

        >>> Conductor([[0, 0, 0], [1e-3, 0, 0], [2e-3, 0, 0], [2e-3, 1e-3, 0]]).straightened().vertices[:, 0].tolist()
        [0.0, 0.002, 0.002]
        """
        along = np.diff(self.vertices, axis=0) / self.lengths[:, None]
        bend = np.linalg.norm(np.diff(along, axis=0), axis=1)
        section = np.column_stack((self.widths, self.thicknesses, self.areas, np.round(self.across / _STRAIGHT)))
        first = np.append(True, (bend > _STRAIGHT) | (np.diff(section, axis=0) != 0).any(axis=1))
        if first.all():
            return self
        vertices = self.vertices[np.append(first, True)]
        sizes = self.widths[first], self.thicknesses[first], self.areas[first]
        return Conductor(vertices, *sizes, self.name, self.across[first])

    def pieces(self, counts: npt.ArrayLike) -> tuple[IntArray, FloatArray, FloatArray]:
        """Cut every segment into equal pieces.

        `counts` of shape (n,) are the numbers of pieces, at least 1. Returned are the number of the
        segment of every piece, shape (pieces,), and the starts and middles in m, shape (pieces, 3)
        each.
        """
        number = np.asarray(counts).astype(np.int64)
        rows = np.repeat(np.arange(len(number)), number)
        at = np.arange(len(rows)) - np.repeat(np.cumsum(number) - number, number)
        steps = np.diff(self.vertices, axis=0)[rows] / number[rows][:, None]
        starts = self.vertices[rows] + at[:, None] * steps
        return rows, starts, starts + steps / 2

    def posed(self, pose: Pose, name: str | None = None) -> Conductor:
        """Return the path where a `pose` takes it, under its own or another `name`."""
        sizes = self.widths, self.thicknesses, self.areas
        return Conductor(pose.apply(self.vertices), *sizes, name or self.name, self.across @ pose.rotation.T)

    @property
    def area(self) -> FloatArray:
        """Area of the turns in m² as a vector, shape (3,), its moment per ampere.

        The path is closed by a straight line. A flat coil has its turns times their mean area along
        its normal, positive for a counter-clockwise current.
        """
        closed = np.vstack((self.vertices, self.vertices[:1])) - self.vertices[0]
        return np.asarray(0.5 * np.cross(closed[:-1], closed[1:]).sum(axis=0))

    @property
    def centre(self) -> FloatArray:
        """Mean of the path along its length in m, shape (3,)."""
        middles = (self.vertices[1:] + self.vertices[:-1]) / 2
        return np.asarray(np.average(middles, axis=0, weights=self.lengths))

    @property
    def is_level(self) -> bool:
        """Whether the widths of all bars lie in the x-y plane."""
        return bool((np.abs(self.across[self.widths > 0, 2]) < _TILTED).all())

    @property
    def is_filament(self) -> bool:
        """Whether any segment has no cross-section."""
        return bool((self.widths == 0).any())


def _lateral(along: FloatArray, across: npt.ArrayLike | None, name: str) -> FloatArray:
    """Return unit vectors across segments of directions `along` (n, 3)."""
    if across is None:
        lateral = np.column_stack((-along[:, 1], along[:, 0], np.zeros(len(along))))
        lateral[np.linalg.norm(lateral, axis=1) < _VERTICAL] = (1.0, 0.0, 0.0)
    else:
        try:
            lateral = np.array(np.broadcast_to(np.asarray(across, dtype=np.float64), along.shape))
        except (TypeError, ValueError):
            message = f"across of {name} must be one direction of three numbers or {len(along)}, one a segment."
            raise GeometryError(message) from None
        with np.errstate(invalid="ignore"):
            size = np.linalg.norm(lateral, axis=1, keepdims=True)
            lateral = lateral / np.where(size > 0, size, 1.0)
            lateral -= (lateral * along).sum(axis=1, keepdims=True) * along
    size = np.linalg.norm(lateral, axis=1, keepdims=True)
    wrong = np.flatnonzero(~(size[:, 0] > _ALONG))
    if len(wrong):
        given = np.broadcast_to(np.array(across, dtype=np.float64), along.shape)[wrong[0]].tolist()
        raise GeometryError(
            f"across of {name} must be finite and not along its segment; segment {wrong[0]} has {tuple(given)}."
        )
    lateral /= size
    if across is not None:  # on one side along the whole path, as the corners between its bars expect
        normals = np.cross(along, lateral)
        turned = (normals[1:] * normals[:-1]).sum(axis=1) < 0
        lateral *= np.cumprod(np.append(1.0, np.where(turned, -1.0, 1.0)))[:, None]
    return lateral


class Form(Protocol):
    """Map of a flat board into space, as `coilarray.geometry.Bend`."""

    def bent(self, path: Conductor) -> Conductor:
        """Return a path of the flat board where the map takes it."""

    def surface(self, points: npt.ArrayLike) -> FloatArray:
        """Return points (..., 3) in m of the flat board where the map takes them."""

    def strips(self, bounds: tuple[float, float, float, float]) -> tuple[shapely.Polygon, ...]:
        """Return parts in m that cover the flat board, whose solids stay nearly flat."""

    def inner_radius(self, bounds: tuple[float, float, float, float], thickness: float) -> float:
        """Return the least radius in m of the inner face of a board, inf for one that is not bent."""

    def require_fits(self, bounds: tuple[float, float, float, float], thickness: float) -> None:
        """Refuse a board with edges x_min, y_min, x_max, y_max and a thickness in m."""


class CurrentPaths(ABC):
    """Shapes that carry currents."""

    @abstractmethod
    def as_array(self) -> Array:
        """Return the array of these coils on their board."""

    def conductors(self, chord: float = CHORD) -> tuple[Conductor, ...]:
        """Return the current paths in m, vias included, bent as the board.

        A path runs from the first to the second terminal. `chord` is as in `Coil.current_lines`.
        """
        form, paths = self.as_array().form, self.flat_conductors(chord)
        return paths if form is None else tuple(map(form.bent, paths))

    def flat_conductors(self, chord: float = CHORD) -> tuple[Conductor, ...]:
        """Return the current paths of the flat board, as in `conductors`."""
        array = self.as_array()
        return tuple(place.conductor(array.stackup, chord) for place in array.placements)

    def field(self, points: npt.ArrayLike, currents: npt.ArrayLike = 1.0) -> FloatArray:
        """Compute the magnetic flux density in T, in free space.

        `points` (..., 3) are in m, with the upper face of the board at z = 0. `currents` are in A,
        one per coil or one for all. Returns B with the shape (..., 3), see
        `coilarray.magnetic_field`.
        """
        from coilarray.electromagnetics.field import magnetic_field

        return magnetic_field(self.conductors(), points, currents)

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the board from above in mm, see `coilarray.viz.plot_board`."""
        from coilarray.viz.plots.board import plot_board

        return plot_board(self.as_array(), ax)

    def show(self) -> None:
        """Show the board in three dimensions, in a window or a notebook.

        It needs the extra ``3d``. A window needs a screen, and the function returns when the user
        closes it.
        """
        from coilarray.viz.scenes.board import board_scene
        from coilarray.viz.scenes.pictures import show

        show(board_scene(self.as_array()))


class SingleCoil(CurrentPaths):
    """Shape of one coil, which is alone on its board."""

    @abstractmethod
    def coil(self) -> Coil:
        """Return the centre lines of the coil."""

    def as_array(self) -> Array:
        """Return the array of this coil alone, at the origin."""
        from coilarray.geometry.array import Array

        return Array.row(self, 1)

    @cached_property
    def inductance(self) -> float:
        """Inductance in H of the coil in free space."""
        from coilarray.electromagnetics.inductance import self_inductance

        return float(self_inductance(self.conductors())[0])

    @cached_property
    def resistance(self) -> float:
        """Direct-current resistance in Ω, of copper at 20 °C."""
        from coilarray.electromagnetics.resistance import dc_resistance

        return float(dc_resistance(self)[0])


class SeveralCoils(CurrentPaths):
    """Coils with names."""

    @property
    @abstractmethod
    def names(self) -> tuple[str, ...]:
        """Names of the coils in order."""

    @cached_property
    def inductance(self) -> xr.DataArray:
        """Inductance matrix in H in free space (coil, other)."""
        from coilarray.electromagnetics.inductance import inductance_matrix

        return self._labelled(inductance_matrix(self), "inductance", "H")

    @cached_property
    def coupling(self) -> xr.DataArray:
        """Coupling coefficients in free space (coil, other)."""
        from coilarray.electromagnetics.inductance import coupling_matrix

        return self._labelled(coupling_matrix(self.inductance), "coupling", "")

    @cached_property
    def resistance(self) -> xr.DataArray:
        """Direct-current resistances in Ω, of copper at 20 °C (coil)."""
        from coilarray.electromagnetics.resistance import dc_resistance

        return self._labelled(dc_resistance(self), "resistance", "ohm")

    def _repr_html_(self) -> str:
        from coilarray.fabrication.drawings import array_html

        return array_html(self.as_array())

    def _labelled(self, values: FloatArray, name: str, unit: str) -> xr.DataArray:
        import xarray as xr

        coords = {dim: list(self.names) for dim in ("coil", "other")[: values.ndim]}
        return xr.DataArray(values, coords, tuple(coords), name, {"units": unit} if unit else None)
