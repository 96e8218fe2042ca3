"""Fit named physical unknowns of a board to the published ellipses; x0 is never fitted, only predicted afterwards."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import get_args

import numpy as np
import numpy.typing as npt
import xarray as xr
from scipy.optimize import least_squares
from scipy.stats import t as student

from coilarray.circuit.coupling import provenance
from coilarray.compute.threads import Progress
from coilarray.design.model import Design
from coilarray.elastomer.scattering import LayerMesh
from coilarray.errors import LocalizeError
from coilarray.geometry.sheet import RigidBase as Base
from coilarray.localize.distortion import ellipse_curves
from coilarray.localize.ellipse_model import CoilEllipses
from coilarray.localize.published import published_model
from coilarray.response.map import Imperfections, response_map
from coilarray.response.setup import indentation_of

FloatArray = npt.NDArray[np.float64]

LEVELS = np.arange(1e-4, 1.0e-3 + 1e-6, 1e-4)
"""δ at which A and B are compared."""
SEMIAXIS_ERROR = 0.5e-3
"""What a published semi-axis is trusted to, in m: a quarter of the paper's grid."""
PEAK_ERROR = 5e-5
"""What a published peak of δ is trusted to."""

_MESH = LayerMesh(harmonics=6, decays=6.0, width=0.4, rows=4)  # 1e-3 of δ, far below what is compared
_STEP = 0.02  # of an unknown's range, for slopes: far above the noise of the meshes
_CONFIDENCE = 0.95
_AT_BOUND = 5e-3  # of an unknown's range: the solver stays inside its bounds and stops a little short of them
_PEAKS = (1.0e-3, 1.5e-3)


@dataclass(frozen=True)
class Unknown:
    """A physical quantity that the paper does not give: name and unit for results, first guess `start` and bounds."""

    name: str
    unit: str
    start: float
    low: float
    high: float


UNKNOWNS = (
    Unknown("depth_error", "m", 0.0, -0.3e-3, 0.6e-3),
    Unknown("poissons_ratio", "1", 0.49, 0.3, 0.4999),
    Unknown("modulus_ratio", "1", 3.0, 1.0, 12.0),
    Unknown("relative_permeability", "1", 2.7, 1.5, 6.0),
    Unknown("tilt", "1", 0.0, -0.01, 0.01),
)
"""Contact found too late, ν of all sheets, modulus of the magnetic sheet over the lowest one's, μr, tilt along x."""


@dataclass(frozen=True, eq=False)
class Calibration:
    """What `calibrate` found for one kind of base: the design with the fitted sheets, its imperfections, the result.

    The result has ``start``, ``value``, ``low`` and ``high`` (95 % confidence interval), ``at_bound`` (unknown),
    ``correlation`` (unknown, other), ``misfit_before`` and ``misfit_after``: rms of the residuals in units of their
    trust.
    """

    design: Design
    imperfections: Imperfections
    result: xr.Dataset


def calibrate(
    design: Design,
    states: Sequence[str] = ("coil1", "coil2", "coil3"),
    unknowns: Sequence[Unknown] = UNKNOWNS,
    *,
    base: Base | None = None,
    progress: Progress | None = None,
) -> Calibration:
    """Fit unknowns to the published A_i(δ), B_i(δ) and peaks.

    Parameters
    ----------
    design : Design
        Design with an indentation, one magnetic sheet, and the published names of the coils.
    states : sequence of str
        Published coils to fit to.
    unknowns : sequence of Unknown
        Unknowns to fit, those of `UNKNOWNS` or the same with other bounds and starts.
    base : {"bonded", "frictionless"}, optional
        Support of the lowest sheet on the board; the design's by default.
    progress : callable, optional
        Called with (done, total); the total is a guess.

    Raises
    ------
    LocalizeError
        An unknown that is none of `UNKNOWNS`, a state that is not published, or a design without indentation or without
        exactly one magnetic sheet.

    Notes
    -----
    Least squares of (A − A_published)/0.5 mm, (B − B_published)/0.5 mm and (peak − peak_published)/5e-5, each semi-axis
    zero above the peak of its coil. The capacitance is no unknown: δ does not depend on it. Confidence intervals take
    the residuals as independent, which curves over δ are not: they are too narrow rather than too wide.
    """
    _check(design, states, unknowns, base)
    names = [unknown.name for unknown in unknowns]
    target = _published(states)
    calls = 0

    start, low, high = np.array([(unknown.start, unknown.low, unknown.high) for unknown in unknowns]).T
    scale = high - low

    def changed_by(parts: FloatArray) -> tuple[Design, Imperfections]:
        return apply(design, dict(zip(names, (low + parts * scale).tolist(), strict=True)), base)

    def residuals(parts: FloatArray) -> FloatArray:
        nonlocal calls
        calls += 1
        if progress is not None:
            progress(calls, max(calls + 1, 12 * (len(names) + 1)))
        return _features(*changed_by(parts), states) - target

    first = (start - low) / scale
    fitted = least_squares(
        residuals, np.clip(first, 1e-3, 1 - 1e-3), bounds=(0, 1), diff_step=np.full(len(names), _STEP),
        xtol=1e-4, ftol=1e-4, max_nfev=25,
    )  # fmt: skip
    changed, imperfections = changed_by(fitted.x)
    value = low + fitted.x * scale
    result = _result(unknowns, value, np.asarray(fitted.jac), fitted.fun, scale, residuals(first))
    return Calibration(
        changed, imperfections, result.assign_attrs({**provenance(design), "base": str(indentation_of(changed).base)})
    )


def apply(design: Design, values: Mapping[str, float], base: Base | None = None) -> tuple[Design, Imperfections]:
    """Put values of unknowns, by the names of `UNKNOWNS` in SI units, into a design as for `calibrate`."""
    sheets = list(design.sheets)
    magnetic = _magnetic(design)
    if "poissons_ratio" in values:
        sheets = [replace(sheet, poissons_ratio=values["poissons_ratio"]) for sheet in sheets]
    if "modulus_ratio" in values and sheets[0].youngs_modulus is not None:
        stiff = values["modulus_ratio"] * sheets[0].youngs_modulus
        sheets[magnetic] = replace(sheets[magnetic], youngs_modulus=stiff)
    if "relative_permeability" in values:
        sheets[magnetic] = replace(sheets[magnetic], relative_permeability=values["relative_permeability"])
    setup = indentation_of(design)
    if base is not None:
        setup = replace(setup, base=base)
    imperfections = Imperfections(tilt=(values.get("tilt", 0.0), 0.0), depth_error=values.get("depth_error", 0.0))
    return replace(design, sheets=tuple(sheets), indentation=setup), imperfections


def _magnetic(design: Design) -> int:
    found = [k for k, sheet in enumerate(design.sheets) if sheet.relative_permeability > 1]
    if len(found) != 1:
        raise LocalizeError(f"calibration needs exactly one magnetic sheet; the design {design.name} has {len(found)}.")
    return found[0]


def _check(design: Design, states: Sequence[str], unknowns: Sequence[Unknown], base: Base | None) -> None:
    if base not in (None, *get_args(Base)):
        raise LocalizeError(f"base must be bonded or frictionless; got {base!r}.")
    known = [unknown.name for unknown in UNKNOWNS]
    for unknown in unknowns:
        if unknown.name not in known:
            raise LocalizeError(f"an unknown must be one of {', '.join(known)}; got {unknown.name!r}.")
        if not unknown.low <= unknown.start <= unknown.high or unknown.low == unknown.high:
            raise LocalizeError(f"the guess of {unknown.name} must lie between its bounds; got {unknown}.")
    if not unknowns:
        raise LocalizeError("calibration needs at least one unknown; got none.")
    published = published_model().names
    for state in states:
        if state not in published:
            raise LocalizeError(f"a state must be one of the published {', '.join(published)}; got {state!r}.")
    indentation_of(design)
    _magnetic(design)


def _published(states: Sequence[str]) -> FloatArray:
    """Return A and B at the levels and the peak of every coil, in units of their trust."""
    parts = []
    for coil in map(published_model().__getitem__, states):
        _, A, B = coil.curves(LEVELS)
        parts += [A / SEMIAXIS_ERROR, B / SEMIAXIS_ERROR, _published_peak(coil) / PEAK_ERROR]
    return np.concatenate(parts)


def _published_peak(coil: CoilEllipses) -> FloatArray:
    """δ where the published A falls to zero, which the paper puts above 1.2e-3; none where it does so far beyond."""
    roots = np.roots(coil.A)
    real = roots.real[np.abs(roots.imag) < 1e-9]
    return np.asarray(real[(real > _PEAKS[0]) & (real < _PEAKS[1])])


def _features(design: Design, imperfections: Imperfections, states: Sequence[str]) -> FloatArray:
    """Return the same of a computed map; semi-axes are zero above the peak."""
    depths = indentation_of(design).depths[:1]
    # the same circuit for every sheet that is tried: losses and strays change δ by less than 1 %
    response = response_map(design, depths=depths, imperfections=imperfections, mesh=_MESH, ideal=True)
    curves = ellipse_curves(response, states, LEVELS)
    published, parts = published_model(), []
    for state, A, B in zip(states, curves.A, curves.B, strict=True):
        peak = float(response.delta.sel(state=state).max())
        parts += [np.nan_to_num(axis) / SEMIAXIS_ERROR for axis in (A, B)]
        parts.append(np.full(len(_published_peak(published[state])), peak / PEAK_ERROR))
    return np.concatenate(parts)


def _result(
    unknowns: Sequence[Unknown],
    value: FloatArray,
    jacobian: FloatArray,
    residual: FloatArray,
    scale: FloatArray,
    before: FloatArray,
) -> xr.Dataset:
    freedom = len(residual) - len(value)
    covariance = np.linalg.pinv(jacobian.T @ jacobian) * (residual @ residual) / freedom
    sigma = np.sqrt(np.diag(covariance))
    half = float(student.ppf((1 + _CONFIDENCE) / 2, freedom)) * sigma * scale
    correlation = covariance / np.outer(sigma, sigma)
    at_bound = [
        min(v - u.low, u.high - v) < _AT_BOUND * (u.high - u.low) for u, v in zip(unknowns, value.tolist(), strict=True)
    ]
    names = [unknown.name for unknown in unknowns]
    return xr.Dataset(
        {
            "start": ("unknown", [unknown.start for unknown in unknowns], {"long_name": "first guess"}),
            "value": ("unknown", value),
            "low": ("unknown", value - half, {"long_name": "95 % interval, from"}),
            "high": ("unknown", value + half, {"long_name": "95 % interval, to"}),
            "at_bound": ("unknown", at_bound, {"long_name": "at a bound of its range"}),
            "correlation": (("unknown", "other"), correlation, {"units": "1"}),
            "misfit_before": ((), float(np.sqrt(np.mean(before**2)))),
            "misfit_after": ((), float(np.sqrt(np.mean(residual**2)))),
        },
        coords={"unknown": names, "other": names, "unit": ("unknown", [unknown.unit for unknown in unknowns])},
    )
