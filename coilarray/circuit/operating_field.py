"""Magnetic field of one active coil and of the currents that it induces in the others."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import xarray as xr

from coilarray.circuit.coupling import provenance
from coilarray.compute.arrays import ComplexArray
from coilarray.compute.netcdf import variables
from coilarray.compute.threads import Progress
from coilarray.design.model import Design, DesignFile, design_of
from coilarray.electromagnetics.field import grid_points, magnetic_field
from coilarray.errors import GeometryError, MetalError, require_finite
from coilarray.geometry import FinitePlate, Plate
from coilarray.metal.plate_field import plate_field


def operating_currents(
    design: Design | DesignFile, coupling: xr.Dataset, active: str, *, terminated: bool = True
) -> ComplexArray:
    """Compute the currents of all coils while one is measured.

    They are per ampere of the active coil.

    Parameters
    ----------
    design : Design or DesignFile
        The array.
    coupling : xarray.Dataset
        Its coupling, from `coilarray.circuit.coupling.couple_design`.
    active : str
        Name of the measured coil.
    terminated : bool
        If False, all other coils are open.

    Returns
    -------
    ndarray of complex, shape (coils,)
        Currents in A per A: 1 for the active coil.

    Raises
    ------
    GeometryError
        No coil of that name.
    """
    design = design_of(design)
    names = design.array.names
    if active not in names:
        raise GeometryError(f"there is no coil {active!r}; there are {', '.join(names)}.")
    if not terminated:
        return np.asarray(np.eye(len(names), dtype=np.complex128)[names.index(active)])
    mine = coupling.sel(coil=active)
    parts = mine.current_real.values, mine.current_imag.values
    require_finite("the currents of the coupling", *np.concatenate(parts).tolist())
    return np.asarray(parts[0] + 1j * parts[1])


def require_endless(design: Design) -> tuple[Plate, ...]:
    """Return the plates of a design, all infinite. A plate with an outline raises a MetalError."""
    for plate in design.plates:
        if isinstance(plate, FinitePlate):
            raise MetalError(
                f"B beside a plate with an outline is not computed; {design.name} has {plate.name!r}: leave it out, or "
                'make it infinite with shape = "plate".'
            )
    return tuple(plate for plate in design.plates if isinstance(plate, Plate))


def _half(progress: Progress, k: int) -> Progress:
    """Count each of two equal passes as half."""
    return lambda done, total: progress(k * total + done, 2 * total)


def operating_field(
    design: Design | DesignFile,
    coupling: xr.Dataset,
    active: str,
    x: npt.ArrayLike,
    y: npt.ArrayLike,
    z: npt.ArrayLike,
    *,
    current: float = 1.0,
    terminated: bool = True,
    progress: Progress | None = None,
) -> xr.Dataset:
    """Compute the flux density of an active coil in T.

    It is computed on a line, plane or volume while the coil carries the measuring current.

    Parameters
    ----------
    design, coupling, active, terminated
        Design, coupling, measured coil and whether the others are terminated. See `operating_currents`.
    x, y, z : array_like, shape (nx,), (ny,), (nz,) or scalar
        Grid in m. z = 0 is the top of the board.
    current : float
        Current of the active coil in A.
    progress : callable, optional
        Called with (done, total) as the work goes on.

    Returns
    -------
    xarray.Dataset
        ``B`` and ``B_quadrature`` in T with the dimensions (x, y, z, component): in phase with the active coil's
        current and 90° ahead of it. The field is in free space, or beside the design's plates at the active coil's
        frequency. Magnetic sheets change the currents only, with and without plates.

    Raises
    ------
    GeometryError
        No coil of that name, or points or a current that are not finite.
    MetalError
        Plates with an outline, whose field is not computed, or a height beside the copper of a design with plates.
    """
    design = design_of(design)
    require_finite("current", current)
    endless = require_endless(design)
    currents = current * operating_currents(design, coupling, active, terminated=terminated)
    points = grid_points(x, y, z)
    conductors = design.array.conductors()
    if endless:
        frequency = float(coupling.frequency.sel(coil=active))
        along, across, up = (np.atleast_1d(np.asarray(axis, dtype=np.float64)) for axis in (x, y, z))
        beside = plate_field(conductors, currents, endless, frequency, along, across, up)
        in_phase, quadrature = beside.real, beside.imag
    else:
        in_phase, quadrature = (
            magnetic_field(conductors, points, part, progress=progress and _half(progress, k))
            for k, part in enumerate((currents.real, currents.imag))
        )
    dims = ("x", "y", "z", "component")
    axes = {
        name: (name, np.atleast_1d(np.asarray(axis, dtype=np.float64)), {"units": "m"})
        for name, axis in zip("xyz", (x, y, z), strict=True)
    }
    rows = (
        ("B", dims, in_phase, "T", "flux density in phase with the active current"),
        ("B_quadrature", dims, quadrature, "T", "flux density 90 degrees ahead"),
    )
    return xr.Dataset(
        variables(*rows),
        coords={**axes, "component": ["x", "y", "z"]},
        attrs={
            **provenance(design),
            "active_coil": active,
            "other_coils": "none" if len(design.array.names) == 1 else "as terminated" if terminated else "open",
            "active_current_A": current,
        },
    )
