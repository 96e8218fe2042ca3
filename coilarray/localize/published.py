"""What Gast & Zimmermann (2020) published: their tables, their model, and how far Table 2 follows from Table A1.

Table 2 gives four real positions and the x that the sensor determined; the measured readings are not printed. Here each
position's readings are generated instead: the δ of every coil whose ellipse of Table A1 goes through the position. From
them the model returns the real position again, whatever its polynomials are; only the 0.2 mm that are then added to
every A move it. What Table 2 has beyond that is the difference of the measured readings from the model's own. It cannot
be reproduced without the raw data; `Table2Row.needed` says how large it must have been.
"""

from __future__ import annotations

import csv
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import resources

import numpy as np
import numpy.typing as npt
import xarray as xr

from coilarray.errors import LocalizeError
from coilarray.localize.ellipse_model import (
    SEMIAXIS_ADDITION,
    CoilEllipses,
    EllipseModel,
    EllipsePosition,
    intersect,
    locate_x,
    readings_at,
)

CENTRE_DELTA = 1e-3
"""δ from which an indentation is near a coil's centre (Sect. 5)."""

_DEPTH, _SPACING, _X, _Y = 1e-3, 2e-3, 26e-3, 6e-3  # in m, Table 1
_FLOOR = -2e-4  # of δ on `published_map`: well below the lowest level
_HALVINGS = 50  # of a range of 2e-3 in δ: to 2e-18
_COILS = ("coil1", "coil2", "coil3")
_STEP = 1e-9  # in δ, of a slope of x
_CLOSE = 1e-9  # m, far below the 0.01 mm of Table 2
_ITERATIONS = 20


@dataclass(frozen=True)
class Table2Row:
    """One row of Table 2 beside what Table A1 gives for it.

    Parameters
    ----------
    real : tuple of float
        Real x and y in m, as printed.
    determined_x, error : float
        As printed, in m. `error` is not the difference of the two in the third row.
    readings : mapping of str to float
        δ of every coil whose printed ellipse can go through the real position, found by inverting Table A1.
    model : EllipsePosition
        What the model with the added 0.2 mm makes of these readings.
    needed : mapping of str to float
        Smallest change of the two readings used, in the root of the sum of squares, that gives `determined_x`.
    needed_by_error : mapping of str to float
        The same for the x that `error` stands for, real x and error.
    """

    real: tuple[float, float]
    determined_x: float
    error: float
    readings: Mapping[str, float]
    model: EllipsePosition
    needed: Mapping[str, float]
    needed_by_error: Mapping[str, float]

    @property
    def determined_error(self) -> float:
        """Determined less real x in m."""
        return self.determined_x - self.real[0]

    @property
    def model_error(self) -> float:
        """The model's less the real x in m: what the added 0.2 mm alone do."""
        return self.model.x - self.real[0]

    @property
    def consistent(self) -> bool:
        """Whether the printed error is the determined less the real x, to the printed 0.01 mm."""
        return abs(self.determined_error - self.error) < 0.5e-5


def table_1() -> dict[str, str]:
    """Return the experimental parameters of Table 1 as printed.

    Examples
    --------
    >>> table_1()["Coil diameter d"]
    '23 mm'
    """
    return {row["parameter"]: row["value"] for row in _rows("table_1")}


def table_2() -> list[dict[str, float]]:
    """Return the rows of Table 2 as printed, in mm.

    Examples
    --------
    >>> table_2()[0]
    {'real_x_mm': -8.75, 'real_y_mm': -3.6, 'determined_x_mm': -8.83, 'error_mm': -0.08}
    """
    return [{key: float(value) for key, value in row.items()} for row in _rows("table_2")]


def table_a1(*, as_printed: bool = False) -> dict[tuple[str, str], tuple[float, ...]]:
    """Return the coefficients of Table A1 in mm.

    Parameters
    ----------
    as_printed : bool
        With the misprint of A3's p3.

    Returns
    -------
    dict
        From "A", "B" or "x0" and the coil's name to p4 … p0.

    Examples
    --------
    >>> table_a1()["A", "coil3"][1], table_a1(as_printed=True)["A", "coil3"][1]
    (-8811000000.0, -8811000000000.0)
    """
    table: dict[tuple[str, str], list[float]] = {}
    for row in _rows("table_a1"):
        key = (row["semiaxis_or_centre"], row["coil"])
        table.setdefault(key, []).append(float(row["printed" if as_printed else "value"]))
    return {key: tuple(values) for key, values in table.items()}


def published_model() -> EllipseModel:
    """Return the model of Table A1, without the misprint and without the added 0.2 mm.

    Returns
    -------
    EllipseModel
        Of coils 1 to 3. The range of δ is not printed: it is taken from 0 to where A or B vanishes, 1.23e-3, 1.87e-3
        and 1.24e-3.

    Examples
    --------
    >>> [round(coil.highest * 1e3, 2) for coil in published_model().coils]
    [1.23, 1.87, 1.24]
    """
    table = {key: tuple(p * 1e-3 for p in values) for key, values in table_a1().items()}
    coils = []
    for name in _COILS:
        x0, A, B = (_five(table[key, name]) for key in ("x0", "A", "B"))
        coils.append(CoilEllipses(name, x0, A, B, 0.0, min(_vanishes(A), _vanishes(B)), CENTRE_DELTA))
    return EllipseModel(tuple(coils))


def published_map(x: npt.ArrayLike | None = None, y: npt.ArrayLike | None = None) -> xr.Dataset:
    """Return the response whose curves of equal δ are the ellipses of Table A1.

    Parameters
    ----------
    x, y : array_like, shape (n,), optional
        Positions in m; by default the paper's grid, 2 mm apart over x ±26 and y ±6 mm.

    Returns
    -------
    xarray.Dataset
        ``delta`` (depth, y, x, state) of coils 1 to 3, as a measured or simulated response has it. Not what was
        measured: what the paper's model says of it.

    Notes
    -----
    Each δ is found by bisection. Beyond the ellipse of δ = 0 the polynomials are continued down to δ = -2e-4, so that
    the map runs smoothly through zero; further out it is flat.

    Examples
    --------
    >>> delta = published_map(x=[-8.75e-3], y=[-3.6e-3]).delta
    >>> delta.dims, round(float(delta.sel(state="coil1").item()) * 1e3, 3)
    (('depth', 'y', 'x', 'state'), 0.809)
    """
    along, across = (
        np.arange(-reach, reach + _SPACING / 2, _SPACING) if given is None else np.asarray(given, dtype=np.float64)
        for given, reach in ((x, _X), (y, _Y))
    )
    coils = published_model().coils
    delta = np.stack([_delta_at(coil, *np.meshgrid(along, across)) for coil in coils], axis=-1)
    return xr.Dataset(
        {"delta": (("depth", "y", "x", "state"), delta[None], {"units": "1"})},
        coords={
            "depth": ("depth", [_DEPTH], {"units": "m"}),
            "y": ("y", across, {"units": "m"}),
            "x": ("x", along, {"units": "m"}),
            "state": [coil.name for coil in coils],
        },
        attrs={"source": "Table A1 of Gast and Zimmermann (2020)"},
    )


def reproduce_table_2(addition: float = SEMIAXIS_ADDITION) -> tuple[Table2Row, ...]:
    """Set the rows of Table 2 beside what follows from Table A1.

    Parameters
    ----------
    addition : float
        Added to every A in m after the readings have been found.

    Returns
    -------
    tuple of Table2Row

    Notes
    -----
    A coil takes part in a row where its ellipses can reach the position at all: coil 3 is left out of the first row,
    coil 1 of the last two.

    Examples
    --------
    >>> for row in reproduce_table_2():
    ...     errors = row.determined_error, row.model_error
    ...     print(f"{row.real[0] * 1e3:.2f}", *(f"{error * 1e3:+.2f}" for error in errors), *row.model.coils)
    -8.75 -0.08 -0.05 coil1 coil2
    -0.25 -0.26 -0.02 coil1 coil3
    11.45 +0.71 +0.14 coil2 coil3
    4.80 -0.11 -0.06 coil2 coil3
    """
    return tuple(_reproduced(row, addition) for row in table_2())


def _reproduced(row: Mapping[str, float], addition: float) -> Table2Row:
    x, y, determined, error = (row[k] * 1e-3 for k in ("real_x_mm", "real_y_mm", "determined_x_mm", "error_mm"))
    reaching = {coil: readings_at(coil, x, y) for coil in published_model().coils}
    model = EllipseModel(tuple(coil for coil, found in reaching.items() if found)).with_semiaxis_addition(addition)
    readings = {coil.name: max(found) for coil, found in reaching.items() if found}
    position = locate_x(model, readings)
    needed, by_error = (_needed(model, readings, position.coils, target) for target in (determined, x + error))
    return Table2Row((x, y), determined, error, readings, position, needed, by_error)


def _delta_at(coil: CoilEllipses, x: npt.NDArray[np.float64], y: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    low, high = np.full_like(x, _FLOOR), np.full_like(x, coil.highest)
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        x0, A, B = coil.curves(middle)
        outside = ((x - x0) / A) ** 2 + (y / B) ** 2 > 1
        low, high = np.where(outside, low, middle), np.where(outside, middle, high)
    return (low + high) / 2


def _needed(
    model: EllipseModel, readings: Mapping[str, float], coils: tuple[str, str], target: float
) -> dict[str, float]:
    """Small change of two readings that moves x to a target in m: steps along the slope of x, as short as possible."""

    def x_of(delta: list[float]) -> float:
        return intersect(model, dict(zip(coils, delta, strict=True)), *coils).x

    start = np.array([readings[name] for name in coils])
    delta = start
    for _ in range(_ITERATIONS):
        missing = target - x_of(delta.tolist())
        if abs(missing) < _CLOSE:
            return dict(zip(coils, (delta - start).tolist(), strict=True))
        slope = [
            (x_of((delta + step).tolist()) - x_of((delta - step).tolist())) / (2 * _STEP) for step in _STEP * np.eye(2)
        ]
        delta = delta + missing * np.array(slope) / np.dot(slope, slope)
    raise LocalizeError(f"no readings of {' and '.join(coils)} give x = {target * 1e3:.4g} mm.")


def _five(p: tuple[float, ...]) -> tuple[float, float, float, float, float]:
    p4, p3, p2, p1, p0 = p
    return p4, p3, p2, p1, p0


def _vanishes(p: tuple[float, ...]) -> float:
    """Smallest positive δ at which a polynomial is zero."""
    roots = np.roots(p)
    return float(min(root.real for root in roots if root.imag == 0 and root.real > 0))


def _rows(name: str) -> list[dict[str, str]]:
    text = resources.files("coilarray.localize").joinpath("published", f"{name}.csv").read_text(encoding="utf-8")
    return list(csv.DictReader(line for line in text.splitlines() if not line.startswith("#")))
