"""What an indentation anywhere does to the inductance matrix of a board: a table, kept and interpolated.

Across the board the table is interpolated by cubic splines, in depth by a cubic spline in the root of the depth with no
slope at 0: every blunt or sharp body presses with a power of the depth of one or more, so that the change begins with
the second power of the root or a higher one.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt
import xarray as xr
from scipy.interpolate import CubicSpline, NdBSpline, make_interp_spline

from coilarray.compute.store import Store
from coilarray.compute.threads import Progress
from coilarray.design.model import Design, Indentation
from coilarray.elastomer.contact import indent
from coilarray.elastomer.dent import dent_of
from coilarray.elastomer.dented_layer import dent_inductance
from coilarray.errors import HardwareError
from coilarray.hardware.emulator.indenter import Place

FloatArray = npt.NDArray[np.float64]

SPACING = 1.2e-3
"""Largest distance of positions in m. For gast2020 the table's inductances are then wrong by 2e-7 (root of the mean
square) and at most 4e-6 at 1 mm depth, where they change by up to 8e-4 (tests/hardware/test_emulator_world.py)."""
_PLANES = 6
_DEEPEST = 1.7  # of the deepest indentation of the design
_LEAST_POSITIONS = 4  # for a cubic


@dataclass(frozen=True, eq=False)
class ResponseTable:
    """Changes of the inductance matrix over position and depth.

    Parameters
    ----------
    x, y, depth : ndarray, shape (n,)
        Where they are known, in m from the map's origin.
    change : ndarray, shape (depth, y, x, coil, coil)
        In H, dented less flat.
    """

    x: FloatArray
    y: FloatArray
    depth: FloatArray
    change: FloatArray

    def check(self, place: Place) -> None:
        """Refuse a place that is not in the table.

        Raises
        ------
        HardwareError
            Which coordinate, and its range.
        """
        ranges = (("x", self.x[0], self.x[-1]), ("y", self.y[0], self.y[-1]), ("depth", 0.0, self.depth[-1]))
        for (name, low, high), value in zip(ranges, place, strict=True):
            if not low <= value <= high:
                raise HardwareError(
                    f"{name} of the emulated indenter must be {low * 1e3:.4g} to {high * 1e3:.4g} mm; "
                    f"got {value * 1e3:.4g} mm."
                )

    def at(self, place: Place) -> FloatArray:
        """Return the change of the inductance matrix in H at a place in the table, shape (coils, coils)."""
        planes = self._across((place.x, place.y)).reshape(len(self.depth), *self.change.shape[-2:])
        from_nothing = np.concatenate((np.zeros_like(planes[:1]), planes))
        roots = np.sqrt(np.concatenate(([0.0], self.depth)))
        return np.asarray(CubicSpline(roots, from_nothing, bc_type=("clamped", "not-a-knot"))(np.sqrt(place.depth)))

    @cached_property
    def _across(self) -> NdBSpline:
        """Splines across the board, of all planes and all pairs of coils."""
        values = np.moveaxis(self.change, 0, 2).reshape(len(self.y), len(self.x), -1)
        along_y = make_interp_spline(self.y, values)
        along_x = make_interp_spline(self.x, np.moveaxis(along_y.c, 1, 0))
        return NdBSpline((along_x.t, along_y.t), np.ascontiguousarray(along_x.c), (3, 3))


def table_axes(design: Design, spacing: float = SPACING) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Choose where the change is computed.

    Parameters
    ----------
    design : Design
        With the tables ``[indenter]`` and ``[indentation]``.
    spacing : float
        Largest distance of positions in m.

    Returns
    -------
    depth, y, x : ndarray, shape (n,)
        Over all coils and all positions of the design's own map in m, and down to 1.7 times its depth; for a sample
        with edges the map's positions and depth alone.

    Raises
    ------
    HardwareError
        A design that says nothing of an indentation.
    """
    setup = _setup(design)
    edges = np.array([[min(setup.x), min(setup.y)], [max(setup.x), max(setup.y)]])
    deepest = max(setup.depths)
    if setup.sample_bounds is None:
        deepest *= _DEEPEST
        outlines = np.concatenate([place.to_board(place.coil.outline) for place in design.array.placements])
        edges = np.concatenate((edges, outlines - setup.origin_point))
    (x_min, y_min), (x_max, y_max) = edges.min(axis=0), edges.max(axis=0)
    depth = deepest * (np.arange(1, _PLANES + 1) / _PLANES) ** 1.5
    return depth, _row(y_min, y_max, spacing), _row(x_min, x_max, spacing)


def response_table(
    design: Design,
    store: Store,
    axes: tuple[FloatArray, FloatArray, FloatArray] | None = None,
    progress: Progress | None = None,
) -> ResponseTable:
    """Return the table of a design, computed where it is not kept: 12 s for gast2020.

    Parameters
    ----------
    design : Design
        With the tables ``[indenter]`` and ``[indentation]``.
    store : Store
        Store of the table.
    axes : tuple of ndarray, optional
        depth, y and x in m, at least 4 positions of each of the last two; those of `table_axes` by default.
    progress : callable, optional
        Called with (done, total) while it is computed.

    Raises
    ------
    HardwareError
        A design that says nothing of an indentation, or axes that carry no cubic.
    ElastomerError
        What `indent` and `dent_inductance` refuse.
    """
    setup = _setup(design)
    depth, y, x = table_axes(design) if axes is None else axes
    if min(len(y), len(x)) < _LEAST_POSITIONS or len(depth) < _LEAST_POSITIONS - 1:
        raise HardwareError("a table of the response needs 4 positions along x and y and 3 depths.")
    parts = ("response table", design.digest, depth, y, x)
    table = store.dataset(parts, lambda: _computed(design, setup, depth, y, x, progress))
    return ResponseTable(x, y, depth, table.inductance_change.values)


def _setup(design: Design) -> Indentation:
    if design.indentation is None:
        raise HardwareError(f"the design {design.name} has no [indenter] and [indentation]; nothing can press on it.")
    return design.indentation


def _row(start: float, stop: float, spacing: float) -> FloatArray:
    return np.linspace(start, stop, max(_LEAST_POSITIONS, int(np.ceil((stop - start) / spacing)) + 1))


def _computed(
    design: Design,
    setup: Indentation,
    depth: FloatArray,
    y: FloatArray,
    x: FloatArray,
    progress: Progress | None,
) -> xr.Dataset:
    contact = indent(design.sheets, setup.indenter, depth, base=setup.base, radius=setup.sample_radius)
    dents = [dent_of(contact.isel(depth=k), design.sheets) for k in range(len(depth))]
    places = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2) + setup.origin_point
    change = dent_inductance(design.array, dents, places, progress=progress)
    shape = (len(depth), len(y), len(x), *change.shape[-2:])
    dims = ("depth", "y", "x", "coil", "other")
    return xr.Dataset({"inductance_change": (dims, change.reshape(shape), {"units": "H"})})
