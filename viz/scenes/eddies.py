"""Eddy currents of a design for pictures.

They are computed at the frequency and with the currents of a measured coil.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
import xarray as xr

from coilarray.circuit.operating_field import operating_currents
from coilarray.compute.arrays import ComplexArray
from coilarray.design.model import Design
from coilarray.errors import MetalError
from coilarray.geometry import FinitePlate, Plate
from coilarray.metal.finite_plates import eddy_currents
from coilarray.metal.plate_field import plate_currents
from coilarray.response.target import target_of
from coilarray.viz.datasets.metal import Eddies
from coilarray.viz.scenes.board import Box

Phasors = tuple[npt.NDArray[np.float64], npt.NDArray[np.float64], ComplexArray]
"""Points (n, 3) in m, normals (n, 3) and complex current densities (n, 3) in A/m of one body."""

_ALONG = 20  # number of arrows along the longest side of an infinite plate
_FLAT = 0.9  # least cosine of the angle between face and triangle; other triangles are the rim
_BLURRED = 0.4  # width over which the current of an arrow is averaged, over their distance


@dataclass(frozen=True, eq=False)
class WorkingPoint:
    """Currents of all coils in A at a frequency.

    They have shape (n,). One coil carries `current`. The frequency is in Hz.
    """

    currents: ComplexArray
    current: float
    frequency: float


def working_point(design: Design, coupling: xr.Dataset, coil: str, current: float, *, terminated: bool) -> WorkingPoint:
    """Operation in which a coil is measured."""
    currents = current * operating_currents(design, coupling, coil, terminated=terminated)
    return WorkingPoint(currents, current, float(coupling.frequency.sel(coil=coil)))


def eddies_of_plates(
    design: Design, plates: Sequence[Plate | FinitePlate], operation: WorkingPoint, within: Box
) -> list[Phasors]:
    """Eddy currents of the plates of a design.

    Infinite plates have them over the rectangle `within` in m.
    """
    endless = [plate for plate in plates if isinstance(plate, Plate)]
    _require_alike(plates)
    return [*_endless(design, endless, endless, operation, within), *_outlined(design, plates, operation)]


def eddies_of_target(
    design: Design, place: tuple[float, float], distances: Sequence[float], operation: WorkingPoint, within: Box
) -> list[Phasors | None]:
    """Eddy currents of the target at several distances.

    All lengths are in m. The result is None for a ball.
    """
    found: list[Phasors | None] = []
    for distance in distances:
        target = target_of(design)
        height = target.height(design.top, distance)
        if isinstance(target.body, Plate):
            _require_alike([target.body, *design.plates])
            moved = replace(target.body, z=height)
            beside = [plate for plate in design.plates if isinstance(plate, Plate)]
            found += _endless(design, [moved], [moved, *beside], operation, within)
        elif isinstance(target.body, FinitePlate):
            moved_there = replace(target.body, centre=(*place, height))
            found.append(_outlined(design, [*design.plates, moved_there], operation)[-1])
        else:
            found.append(None)
    return found


def _require_alike(plates: Sequence[Plate | FinitePlate]) -> None:
    """Refuse infinite plates beside plates with an outline.

    Both together raise a MetalError.
    """
    kinds = {isinstance(plate, FinitePlate) for plate in plates}
    if len(kinds) > 1:
        raise MetalError(
            "eddy currents of infinite plates are not computed beside plates with an outline; got "
            f"{', '.join(plate.name for plate in plates)}."
        )


def _outlined(design: Design, plates: Sequence[Plate | FinitePlate], operation: WorkingPoint) -> list[Phasors]:
    """Eddy currents of plates with an outline."""
    outlined = [plate for plate in plates if isinstance(plate, FinitePlate)]
    if not outlined:
        return []
    found: list[Phasors] = []
    for plate, one in zip(
        outlined, eddy_currents(design.array, plates, operation.frequency, design.sheets), strict=True
    ):
        density = np.tensordot(operation.currents, one.density, axes=1)
        half = len(density) // 2  # the upper half, then its mirror image in the same order
        upper, through = one.corners[:half], density[:half] + density[half:]
        first, second, third = np.moveaxis(upper, 1, 0)
        normals = np.cross(second - first, third - first)
        normals /= np.linalg.norm(normals, axis=1)[:, None]
        face = normals @ plate.axes[2] > _FLAT
        found.append((upper.mean(axis=1)[face], normals[face], through[face]))
    return found


def _endless(
    design: Design, shown: Sequence[Plate], plates: Sequence[Plate], operation: WorkingPoint, within: Box
) -> list[Phasors]:
    """Eddy currents of infinite plates.

    They are computed for `shown`, the first of `plates`, on a grid over their upper faces.
    """
    if not shown:
        return []
    x_min, y_min, x_max, y_max = within
    step = max(x_max - x_min, y_max - y_min) / _ALONG
    x, y = (np.linspace(low, high, round((high - low) / step) + 1) for low, high in ((x_min, x_max), (y_min, y_max)))
    array, sheets = design.array, design.sheets
    density = plate_currents(array, operation.currents, plates, operation.frequency, x, y, sheets, blur=_BLURRED * step)
    found = []
    for plate, K in zip(shown, density, strict=False):
        flat = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
        points = np.column_stack((flat, np.full(len(flat), plate.heights[1])))
        normals = np.broadcast_to([0.0, 0.0, 1.0], points.shape)
        found.append((points, normals, np.column_stack((K.reshape(-1, 2), np.zeros(len(flat))))))
    return found


def at_their_largest(all_phasors: Sequence[Phasors]) -> tuple[list[Eddies], str]:
    """Eddy currents at the instant of their largest strength.

    It is either the instant of the coil's largest current, or a quarter of a period before.
    """
    in_phase, before = (
        sum(float((part(density) ** 2).sum()) for *_, density in all_phasors) for part in (np.real, np.imag)
    )
    now = in_phase >= before
    eddies = [
        Eddies(points, normals, density.real if now else density.imag) for points, normals, density in all_phasors
    ]
    return eddies, "while the coil's current is largest" if now else "a quarter of a period before the coil's peak"
