"""Answers of shapes about themselves: inductance, resistance, field and pictures.

Physics and pictures lie above the shapes and are imported only when a value is asked for.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from functools import cached_property
from typing import TYPE_CHECKING

import numpy.typing as npt

from coilarray.compute.arrays import FloatArray

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes

    from coilarray.geometry.array import Array
    from coilarray.geometry.coil import Coil
    from coilarray.geometry.conductor import Conductor

CHORD = 1e-3
"""Deviation of straight pieces from a coil's largest arc, over half its size, by default."""


class CurrentPaths(ABC):
    """Shapes that carry currents."""

    @abstractmethod
    def as_array(self) -> Array:
        """Return the array of these coils on their board."""

    def conductors(self, chord: float = CHORD) -> tuple[Conductor, ...]:
        """Return the current paths in m, vias included.

        A path runs from the first to the second terminal. `chord` is as in `Coil.current_lines`.
        """
        from coilarray.geometry.array import current_path

        array = self.as_array()
        return tuple(current_path(place, array.stackup, chord) for place in array.placements)

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
        """Open a window with the board in three dimensions.

        It needs the extra ``3d`` and a screen, and returns when the user closes the window.
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

        return float(dc_resistance(self.conductors())[0])


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

        return self._labelled(inductance_matrix(self.conductors()), "inductance", "H")

    @cached_property
    def coupling(self) -> xr.DataArray:
        """Coupling coefficients in free space (coil, other)."""
        from coilarray.electromagnetics.inductance import coupling_matrix

        return self._labelled(coupling_matrix(self.inductance), "coupling", "")

    @cached_property
    def resistance(self) -> xr.DataArray:
        """Direct-current resistances in Ω, of copper at 20 °C (coil)."""
        from coilarray.electromagnetics.resistance import dc_resistance

        return self._labelled(dc_resistance(self.conductors()), "resistance", "ohm")

    def _repr_html_(self) -> str:
        from coilarray.fabrication.drawings import array_html

        return array_html(self.as_array())

    def _labelled(self, values: FloatArray, name: str, unit: str) -> xr.DataArray:
        """Label values by the names of the coils."""
        import xarray as xr

        dims = ("coil", "other")[: values.ndim]
        return xr.DataArray(
            values, {dim: list(self.names) for dim in dims}, dims, name, {"units": unit} if unit else None
        )
