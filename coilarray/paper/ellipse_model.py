"""The paper's ellipse model, published and fitted: x from two coils.

x0, A and B of every coil are polynomials of the fourth degree of δ (Eq. 4). A reading puts the
indentation on the coil's ellipse. Two coils' ellipses intersect in (x, ±y), and x is the position
(Gast & Zimmermann 2020, Sect. 4 and 5).

Details that the paper leaves open, and their interpretation here:

- *The pair of coils*: the coil with the largest δ and the neighbour with the greater δ.
- *Case three*, "in the area close to the coil center, the points of intersection are found by
  evaluating the two adjacent inductances": if the largest δ is at least 1e-3 (Sect. 5) and both
  neighbours' readings are within the model, their two ellipses are intersected. If they do not
  intersect, or one neighbour is missing at the end of the row, the usual pair is taken. Otherwise
  row 4 of Table 2 would have no position: with Table A1, δ of coil 2 is 1.25e-3 there, and no
  ellipse of coil 1 reaches it. For a model of another map the 1e-3 is taken in proportion, 1e-3 of
  the 1.2e-3 beyond which the paper's polynomials vanish.
- *One solution for x*: two ellipses can intersect at two values of x. The value between their
  centres is taken, after a check that there is only one.
- *The added 0.2 mm* on every A_i is `EllipseModel.with_semiaxis_addition`. Nothing is added by
  default.
- *The steps*: a step whose points do not determine its ellipse (`coilarray.paper.ellipse`) is left
  out if the ellipse lies beyond the coil, twice its own semi-axis away from the centre of the
  highest determined step. An arc across the window's end may give such an ellipse, which would
  distort the polynomials at all δ.
- *The range of δ* is not given. A fitted model reaches from the threshold below its first step to
  the threshold above the largest δ of the map.
"""

from __future__ import annotations

import csv
import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from importlib import resources
from typing import Literal

import numpy as np
import numpy.typing as npt
import xarray as xr

from coilarray.compute.arrays import FloatArray
from coilarray.compute.files import checksum
from coilarray.design.model import Design
from coilarray.errors import LocalizeError, listed
from coilarray.paper.ellipse import PARAMETERS, Ellipse, closes

Coefficients = tuple[float, ...]  # p4, p3, p2, p1, p0 of a polynomial of δ, in m
Case = Literal["two points", "touching", "adjacent coils"]  # the paper's three cases (Fig. 6)
DEGREE = 4  # degree of the polynomials, Eq. 4
SEMIAXIS_ADDITION = 0.2e-3
"""Paper's addition to every A_i in m so that ellipses intersect in spite of errors (Sect. 5)."""

CENTRE_SHARE = 1e-3 / 1.2e-3
"""Share of the largest δ from which a reading counts as near the coil's centre (Sect. 5 and 6)."""

CENTRE_DELTA = 1e-3  # δ from which an indentation is near a coil's centre (Sect. 5)
SCHEMA = 1  # schema of the JSON file of a model
_KIND = "coilarray ellipse model"
_CHECKSUM = "checksum"  # key of the file
_RANGE = ("lowest", "highest", "centre")
_ASTRAY = 2.0  # semi-axes between the centres of the highest determined and of an undetermined level: another hill
_SHORTEST = 1e-9  # m, of a semi-axis
_LARGEST_DELTA = 100.0
_TOUCHING = 1e-9  # of B²: how far y² may lie from zero by rounding, y is then within 3e-5 B of the axis
_FLAT = 1e-6  # 1/x of a root beyond every ellipse, in units of their largest semi-axis, where the equation is linear
_DEPTH, _SPACING, _X, _Y = 1e-3, 2e-3, 26e-3, 6e-3  # in m, Table 1
_FLOOR = -2e-4  # of δ on `published_map`, well below the lowest level
_HALVINGS = 50  # of a range of 2e-3 in δ, down to 2e-18
_ANGLES = 721  # points on an ellipse, half a degree apart
_COILS = ("coil1", "coil2", "coil3")
_SAME = 1e-3  # m, within which a coil counts as the coil of Table A1 (the pitch is 13.3 mm)


@dataclass(frozen=True)
class CoilEllipses:
    """Ellipses of one coil as polynomials of δ.

    They are named after the state in which the coil is measured. `x0`, `A` and `B` are coefficients
    p4 … p0 in m, for δ from `lowest` to `highest`. From `centre` on the indentation counts as near
    the coil's centre.
    """

    name: str
    x0: Coefficients
    A: Coefficients
    B: Coefficients
    lowest: float
    highest: float
    centre: float

    def __post_init__(self) -> None:
        for key in PARAMETERS:
            p = getattr(self, key)
            if len(p) != DEGREE + 1 or not np.isfinite(p).all():
                raise LocalizeError(
                    f"{key} of {self.name} must be {DEGREE + 1} finite coefficients; got {str(p)[:80]}."
                )
        if not -_LARGEST_DELTA <= self.lowest < self.highest <= _LARGEST_DELTA:
            raise LocalizeError(
                f"the range of δ of {self.name} must rise, from {-_LARGEST_DELTA:g} to {_LARGEST_DELTA:g} at most; "
                f"got {self.lowest:g} to {self.highest:g}."
            )
        if not 0 < self.centre < np.inf:
            raise LocalizeError(f"centre of {self.name} must be positive and finite; got {self.centre:g}.")

    def curves(self, delta: npt.ArrayLike) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return x0, A and B in m at any δ, unchecked."""
        at = np.asarray(delta, dtype=np.float64)
        x0, A, B = (np.asarray(np.polyval(p, at)) for p in (self.x0, self.A, self.B))
        return x0, A, B

    def covers(self, delta: float) -> bool:
        """Test whether a reading is within the range (NaN: no)."""
        return self.lowest <= delta <= self.highest

    def check(self, delta: float) -> None:
        """Raise a LocalizeError beyond the range of δ."""
        if not self.covers(delta):
            raise LocalizeError(
                f"δ of {self.name} must be within the model, {self.lowest:.4g} to {self.highest:.4g}; got {delta:.4g}."
            )

    def ellipse(self, delta: float) -> Ellipse:
        """Return the ellipse of a reading, or raise LocalizeError."""
        self.check(delta)
        x0, A, B = (float(value) for value in self.curves(delta))
        if min(A, B) < _SHORTEST:
            raise LocalizeError(
                f"the model of {self.name} has no ellipse at δ = {delta:.4g}: A = {A * 1e3:.4g}, B = {B * 1e3:.4g} mm."
            )
        return Ellipse(x0, A, B)


@dataclass(frozen=True)
class EllipseModel:
    """Ellipses of the `coils`, in the order of their row."""

    coils: tuple[CoilEllipses, ...]

    def __post_init__(self) -> None:
        if not self.coils or len(set(self.names)) != len(self.coils):
            raise LocalizeError(
                f"a model must have at least one coil, and each coil a different name; got {self.names}."
            )

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the coils, in the order of the row."""
        return tuple(coil.name for coil in self.coils)

    def __getitem__(self, name: str) -> CoilEllipses:
        for coil in self.coils:
            if coil.name == name:
                return coil
        raise LocalizeError(f"the model has no coil {name!r}; it has {', '.join(self.names)}.")

    def with_semiaxis_addition(self, addition: float = SEMIAXIS_ADDITION) -> EllipseModel:
        """Return the model with an `addition` in m to every A."""
        return EllipseModel(tuple(replace(coil, A=(*coil.A[:-1], coil.A[-1] + addition)) for coil in self.coils))


@dataclass(frozen=True)
class EllipsePosition:
    """Intersection of two coils' ellipses, by the paper's case.

    x in m is along the row. The indentation is at y or at −y.
    """

    x: float
    y: float
    case: Case
    coils: tuple[str, str]


def ellipse_model(fits: xr.Dataset) -> EllipseModel:
    """Fit the polynomials of an ellipse model.

    The fits come from `coilarray.paper.ellipse.fit_ellipses`. The coils are in the order of their
    centres. Every step has the same weight, as in the paper. A, B and x0 of every coil are
    polynomials of δ in m. Raises LocalizeError for fewer steps with an ellipse than a polynomial
    has coefficients.
    """
    kept = [_kept(fits.sel(state=state)) for state in fits.state.values.tolist()]
    # the smallest ellipse determines the centre best
    kept.sort(key=lambda fit: float(fit.x0[np.argmax(fit.delta.values)]))
    coils, threshold = [], float(fits.attrs["threshold"])
    for fit in kept:
        peak, delta = float(fit.peak), fit.delta.values
        powers = peak ** np.arange(DEGREE, -1, -1)  # δ over its peak, or the equations are ill-conditioned
        x0, A, B = (tuple((np.polyfit(delta / peak, fit[key].values, DEGREE) / powers).tolist()) for key in PARAMETERS)
        ends = float(delta.min()) - threshold, peak + threshold
        coils.append(CoilEllipses(str(fit.state.item()), x0, A, B, *ends, CENTRE_SHARE * peak))
    return EllipseModel(tuple(coils))


def model_to_json(model: EllipseModel, source: str = "") -> str:
    """Write a model as JSON in SI units with checksum."""
    coils = [
        {
            "name": coil.name,
            **{f"{key}_m": list(getattr(coil, key)) for key in PARAMETERS},
            **{key: getattr(coil, key) for key in _RANGE},
        }
        for coil in model.coils
    ]
    document = {"schema": SCHEMA, "kind": _KIND, "source": source, "coils": coils}
    return json.dumps({**document, _CHECKSUM: checksum(document)}, indent=1) + "\n"


def model_from_json(text: str) -> EllipseModel:
    """Read a model of `model_to_json`, whose checksum may be missing."""
    try:
        data = json.loads(text)
    except (ValueError, RecursionError):
        raise LocalizeError("an ellipse model must be a JSON file; this is not one.") from None
    if not isinstance(data, dict) or data.get("kind") != _KIND:
        raise LocalizeError(f'an ellipse model must have "kind": "{_KIND}".')
    if data.get("schema") != SCHEMA:
        raise LocalizeError(f"the schema of an ellipse model must be {SCHEMA}; got {data.get('schema')}.")
    if data.pop(_CHECKSUM, None) not in (None, checksum(data)):
        raise LocalizeError(
            "an ellipse model is damaged: its checksum is wrong; delete that key to use the model anyway."
        )
    coils = data.get("coils")
    if not isinstance(coils, list):
        raise LocalizeError("an ellipse model must have a list of coils.")
    return EllipseModel(tuple(_coil_from(coil) for coil in coils))


def crossing(first: Ellipse, second: Ellipse) -> tuple[float, float]:
    """Return x and |y| in m where two ellipses intersect.

    With y² = B²(1 − (x − x0)²/A²) of both, (k1 − k2) x² − 2 (k1 x1 − k2 x2) x + k1 x1² − k2 x2² −
    B1² + B2² = 0 where k = B²/A². It is solved about the middle of the centres. Exactly one
    solution may lie between them. y is 0 if the ellipses touch on the axis.
    """
    middle = (first.x0 + second.x0) / 2
    length = max(first.A, second.A, first.B, second.B)
    pair = [Ellipse((e.x0 - middle) / length, e.A / length, e.B / length) for e in (first, second)]
    one, other = pair
    (k1, k2), rounding = ((e.B / e.A) ** 2 for e in pair), _TOUCHING * max(one.B, other.B) ** 2
    a, half = k1 - k2, k2 * other.x0 - k1 * one.x0
    c = k1 * one.x0**2 - k2 * other.x0**2 - one.B**2 + other.B**2
    under = half**2 - a * c
    q = -(half + np.copysign(np.sqrt(max(under, 0.0)), half))  # of equal signs, nothing cancels (Numerical Recipes 5.6)
    roots = {float(u / v) for u, v in ((q, a), (c, q)) if under >= 0 and abs(v) > abs(u) * _FLAT}
    met = []
    for x in sorted(roots):
        squares = [e.B**2 * (1 - ((x - e.x0) / e.A) ** 2) for e in pair]  # y², below zero beyond an ellipse
        if min(squares) >= -rounding:
            met.append((x, 0.0 if min(squares) <= rounding else sum(squares) / 2))
    if len(met) > 1:
        met = [(x, square) for x, square in met if abs(x) <= abs(one.x0)] or met
    if not met:
        gap = abs(first.x0 - second.x0) - first.A - second.A
        why = f"{gap * 1e3:.4g} mm lie between them" if gap > 0 else "one lies within the other"
        raise LocalizeError(f"the ellipses do not meet: {why}.")
    if len(met) > 1:
        places = " and ".join(f"{(middle + x * length) * 1e3:.4g}" for x, _ in met)
        raise LocalizeError(f"the ellipses meet at more than one x: {places} mm.")
    ((x, square),) = met
    return middle + x * length, float(np.sqrt(square)) * length


def intersect(model: EllipseModel, deltas: Mapping[str, float], first: str, second: str) -> EllipsePosition:
    """Intersect two given coils' ellipses for their readings δ.

    The case is "adjacent coils" if a coil lies between the two, else "two points" or "touching".
    """
    if first == second:
        raise LocalizeError(f"two coils must be given; got {first} twice.")
    ellipses = [model[name].ellipse(_reading(deltas, name)) for name in (first, second)]
    try:
        x, y = crossing(*ellipses)
    except LocalizeError as error:
        raise LocalizeError(f"{first} and {second} give no position, {error}") from None
    apart = abs(model.names.index(first) - model.names.index(second)) > 1
    case: Case = "adjacent coils" if apart else "two points" if y > 0 else "touching"
    return EllipsePosition(x, y, case, (first, second))


def locate_x(model: EllipseModel, deltas: Mapping[str, float]) -> EllipsePosition:
    """Locate an indentation by all coils' readings δ.

    Readings of other coils are not used.

    >>> from coilarray.paper.ellipse_model import published_model
    >>> place = locate_x(published_model(), {"coil1": 2.1125e-4, "coil2": 1.7582e-3, "coil3": 1.6317e-4})
    >>> round(place.x * 1e3, 2), place.case, place.coils
    (-0.25, 'adjacent coils', ('coil1', 'coil3'))
    """
    if len(model.coils) < 2:
        raise LocalizeError(f"two coils are needed for a position; the model has {', '.join(model.names)}.")
    readings = {name: _reading(deltas, name) for name in model.names}
    top = max(range(len(model.coils)), key=lambda k: readings[model.names[k]])
    coil = model.coils[top]
    coil.check(readings[coil.name])
    beside = model.coils[max(top - 1, 0) : top] + model.coils[top + 1 : top + 2]
    if readings[coil.name] >= coil.centre and len(beside) == 2 and all(c.covers(readings[c.name]) for c in beside):
        try:
            return intersect(model, readings, beside[0].name, beside[1].name)
        except LocalizeError:
            pass  # the two do not intersect, take the usual pair
    greater = max(beside, key=lambda c: readings[c.name])
    pair = sorted((coil.name, greater.name), key=model.names.index)
    return intersect(model, readings, pair[0], pair[1])


def _reading(deltas: Mapping[str, float], name: str) -> float:
    if name not in deltas:
        raise LocalizeError(f"the reading of {name} is missing.")
    value = float(deltas[name])
    if not np.isfinite(value):
        raise LocalizeError(f"the reading of {name} must be finite; got {value}.")
    return value


def _coil_from(data: object) -> CoilEllipses:
    if not isinstance(data, dict) or not isinstance(name := data.get("name"), str):
        raise LocalizeError("a coil of an ellipse model must have a name.")
    keys = (*(f"{key}_m" for key in PARAMETERS), *_RANGE)
    if missing := [key for key in keys if key not in data]:
        raise LocalizeError(f"{name} of an ellipse model must have {', '.join(keys)}; {missing[0]} is missing.")
    try:
        x0, A, B = np.array([data[key] for key in keys[:3]], dtype=np.float64).reshape(3, DEGREE + 1).tolist()
        lowest, highest, centre = (float(data[key]) for key in _RANGE)
    except (TypeError, ValueError, OverflowError):
        raise LocalizeError(
            f"{name} of an ellipse model must have {DEGREE + 1} numbers in x0_m, A_m and B_m and one in each of "
            f"{', '.join(_RANGE)}."
        ) from None
    return CoilEllipses(name, tuple(x0), tuple(A), tuple(B), lowest, highest, centre)


def _kept(fit: xr.Dataset) -> xr.Dataset:
    """Return a state's steps about the coil's centre, or refuse."""
    kept = fit.isel(step=np.flatnonzero(fit.refused.values == ""))
    known = kept.x0.values[~kept.undetermined.values]
    if len(known):
        astray = kept.undetermined.values & (np.abs(kept.x0.values - known[-1]) > _ASTRAY * kept.A.values)
        kept = kept.isel(step=np.flatnonzero(~astray))
    if kept.sizes["step"] <= DEGREE:
        raise LocalizeError(
            f"{fit.state.item()} has {kept.sizes['step']} levels with an ellipse; a polynomial of degree {DEGREE} "
            f"needs {DEGREE + 1}."
        )
    return kept


def published_rows(name: str) -> list[dict[str, str]]:
    """Read a table of the paper by its `name`.

    It is ``table_1`` (parameters), ``table_2`` (positions in mm), ``table_a1`` (ellipses) or
    ``text`` (numbers in sentences). Each row is a dictionary with the text of its cells by the
    names of the columns.
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
    at_x, at_y = np.meshgrid(along, across)
    delta = np.empty((*at_x.shape, len(coils)))
    for number, coil in enumerate(coils):
        low, high = np.full_like(at_x, _FLOOR), np.full_like(at_x, coil.highest)
        for _ in range(_HALVINGS):
            middle = (low + high) / 2
            x0, A, B = coil.curves(middle)
            outside = ((at_x - x0) / A) ** 2 + (at_y / B) ** 2 > 1
            low, high = np.where(outside, low, middle), np.where(outside, middle, high)
        delta[..., number] = (low + high) / 2
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


def _vanishes(p: tuple[float, ...]) -> float:
    """Smallest positive δ at which a polynomial is zero."""
    roots = np.roots(p)
    return float(min(root.real for root in roots if root.imag == 0 and root.real > 0))
