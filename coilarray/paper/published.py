"""Published tables, model and map of Gast & Zimmermann (2020)."""

from __future__ import annotations

import csv
from importlib import resources

import numpy as np
import numpy.typing as npt
import xarray as xr

from coilarray.design.model import Design
from coilarray.errors import listed
from coilarray.paper.ellipse import PARAMETERS, closes
from coilarray.paper.ellipse_model import CoilEllipses, EllipseModel

CENTRE_DELTA = 1e-3
"""δ from which an indentation is near a coil's centre (Sect. 5)."""

_DEPTH, _SPACING, _X, _Y = 1e-3, 2e-3, 26e-3, 6e-3  # in m, Table 1
_FLOOR = -2e-4  # of δ on `published_map`, well below the lowest level
_HALVINGS = 50  # of a range of 2e-3 in δ, down to 2e-18
_ANGLES = 721  # points on an ellipse, half a degree apart
_COILS = ("coil1", "coil2", "coil3")
_SAME = 1e-3  # m, within which a coil counts as the coil of Table A1 (the pitch is 13.3 mm)


def published_rows(name: str) -> list[dict[str, str]]:
    """Read a table of the paper by its `name`.

    It is ``table_1`` (parameters), ``table_2`` (positions in mm) or ``table_a1`` (ellipses).

    Returns
    -------
    list of dict of str to str
        One dictionary for each row, with the text of its cells by the names of the columns.
    """
    text = resources.files("coilarray.paper").joinpath("published", f"{name}.csv").read_text(encoding="utf-8")
    return list(csv.DictReader(line for line in text.splitlines() if not line.startswith("#")))


def table_a1(*, as_printed: bool = False) -> dict[tuple[str, str], tuple[float, ...]]:
    """Return Table A1 in mm: p4 … p0 by "A", "B" or "x0" and coil."""
    table: dict[tuple[str, str], list[float]] = {}
    for row in published_rows("table_a1"):
        key = (row["semiaxis_or_centre"], row["coil"])
        table.setdefault(key, []).append(float(row["printed" if as_printed else "value"]))
    return {key: tuple(values) for key, values in table.items()}


def published_model() -> EllipseModel:
    """Return the model of Table A1, without misprint and added 0.2 mm.

    The unprinted range of δ is from 0 to the zero of A or B, 1.23e-3, 1.87e-3 and 1.24e-3.
    """
    table = {key: tuple(p * 1e-3 for p in values) for key, values in table_a1().items()}
    coils = []
    for name in _COILS:
        x0, A, B = (table[key, name] for key in PARAMETERS)
        coils.append(CoilEllipses(name, x0, A, B, 0.0, min(_vanishes(A), _vanishes(B)), CENTRE_DELTA))
    return EllipseModel(tuple(coils))


def difference_from_published(design: Design) -> str:
    """Say how a design's coils differ from Table A1, or empty.

    They are compared by name and, to 1 mm, by the published centre of their ellipses near the peak.
    """
    names, setup = design.array.names, design.indentation
    if missing := [name for name in _COILS if name not in names]:
        return f"it has no {listed(missing)}"
    if setup is None:
        return "it has no [indentation]"
    for coil in published_model().coils:
        x = float(coil.curves(CENTRE_DELTA)[0])
        at = design.array.centres[names.index(coil.name)][:2] - setup.origin_point
        if np.hypot(at[0] - x, at[1]) > _SAME:
            return (
                f"{coil.name} must be within {_SAME * 1e3:g} mm of x = {x * 1e3:.1f} mm, y = 0 from the origin of the "
                f"map; it is at {at[0] * 1e3:.4g} and {at[1] * 1e3:.4g} mm"
            )
    return ""


def undetermined_levels(
    coil: CoilEllipses, delta: npt.ArrayLike, x: tuple[float, float] = (-_X, _X), y: tuple[float, float] = (-_Y, _Y)
) -> npt.NDArray[np.bool_]:
    """Test which levels δ (n,) of a coil are undetermined.

    Too little of their ellipse is in the window over `x` and `y` in m, by default the paper's. The
    points within it are judged like the points of a computed level.
    """
    angle = np.linspace(0, 2 * np.pi, _ANGLES)
    marks = []
    for x0, A, B in np.stack(coil.curves(np.atleast_1d(delta)), axis=-1):
        at_x, at_y = x0 + A * np.cos(angle), B * np.sin(angle)
        seen = at_x[(x[0] <= at_x) & (at_x <= x[1]) & (y[0] <= at_y) & (at_y <= y[1])]
        marks.append(min(A, B) <= 0 or not closes(seen, x0, A))
    return np.array(marks)


def published_map(x: npt.ArrayLike | None = None, y: npt.ArrayLike | None = None) -> xr.Dataset:
    """Return the response whose level curves are Table A1's ellipses.

    It follows from the paper's model of coils 1 to 3 and was not measured. Positions in m are by
    default on the paper's grid, 2 mm apart. Each δ is found by bisection. Beyond the ellipse of δ =
    0 the polynomials are continued down to δ = -2e-4, so that the map passes smoothly through zero.
    Further out it is flat.
    """
    along, across = (
        np.arange(-end, end + _SPACING / 2, _SPACING) if given is None else np.asarray(given, dtype=np.float64)
        for given, end in ((x, _X), (y, _Y))
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


def _delta_at(coil: CoilEllipses, x: npt.NDArray[np.float64], y: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Find δ on the map of a coil by bisection."""
    low, high = np.full_like(x, _FLOOR), np.full_like(x, coil.highest)
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        x0, A, B = coil.curves(middle)
        outside = ((x - x0) / A) ** 2 + (y / B) ** 2 > 1
        low, high = np.where(outside, low, middle), np.where(outside, middle, high)
    return (low + high) / 2


def _vanishes(p: tuple[float, ...]) -> float:
    """Smallest positive δ at which a polynomial is zero."""
    roots = np.roots(p)
    return float(min(root.real for root in roots if root.imag == 0 and root.real > 0))
