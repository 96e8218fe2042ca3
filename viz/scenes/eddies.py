"""Eddy currents of a design for pictures: at the frequency and with the currents with which a coil is measured."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
import xarray as xr

from coilarray.circuit.operating_field import operating_currents
from coilarray.design.model import Design
from coilarray.geometry import Plate
from coilarray.metal.plate_field import plate_currents
from coilarray.viz.datasets.metal import Eddies
from coilarray.viz.scenes.board import Box

ComplexArray = npt.NDArray[np.complex128]
Phasors = tuple[npt.NDArray[np.float64], npt.NDArray[np.float64], ComplexArray]
"""Points (n, 3) in m, normals (n, 3) and complex current densities (n, 3) in A/m of one body."""

ALONG = 26
"""Number of arrows along the longest side of a plate without end."""


def working_currents(
    design: Design, coupling: xr.Dataset, coil: str, current: float, *, terminated: bool
) -> tuple[ComplexArray, float]:
    """Return the currents of all coils in A while one carries `current` A, and its frequency in Hz."""
    currents = current * operating_currents(design, coupling, coil, terminated=terminated)
    return currents, float(coupling.frequency.sel(coil=coil))


def endless_eddies(
    design: Design, plates: Sequence[Plate], currents: ComplexArray, frequency: float, within: Box
) -> list[Phasors]:
    """Return the eddy currents of plates without end on a grid over the rectangle `within` in m, on the near face."""
    if not plates:
        return []
    x_min, y_min, x_max, y_max = within
    step = max(x_max - x_min, y_max - y_min) / ALONG
    x, y = (np.linspace(low, high, round((high - low) / step) + 1) for low, high in ((x_min, x_max), (y_min, y_max)))
    density = plate_currents(design.array, currents, plates, frequency, x, y, design.sheets, blur=step / 2)
    found = []
    for plate, K in zip(plates, density, strict=True):
        above = plate.z >= 0
        face = plate.heights[0] if above else plate.heights[1]
        flat = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
        points = np.column_stack((flat, np.full(len(flat), face)))
        normals = np.broadcast_to([0.0, 0.0, -1.0 if above else 1.0], points.shape)
        found.append((points, normals, np.column_stack((K.reshape(-1, 2), np.zeros(len(flat))))))
    return found


def at_their_largest(all_phasors: Sequence[Phasors]) -> tuple[list[Eddies], str]:
    """Return eddy currents at the instant at which they are the stronger, and when that is.

    The instants are that at which the current of the coil is largest, and a quarter of a period before it.
    """
    in_phase, before = (
        sum(float((part(density) ** 2).sum()) for *_, density in all_phasors) for part in (np.real, np.imag)
    )
    now = in_phase >= before
    eddies = [
        Eddies(points, normals, density.real if now else density.imag) for points, normals, density in all_phasors
    ]
    return eddies, "while the coil's current is largest" if now else "a quarter of a period before the coil's peak"
