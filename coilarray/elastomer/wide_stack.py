"""Displacement and stress in a wide stack under an axisymmetric pressure, by Hankel transform.

Each wavenumber k of the pressure, p = p̂(k) J_0(kr), makes u_z = W(z) J_0(kr) and u_r = U(z) J_1(kr). In the elements
of `coilarray.elastomer.box` over the height, the profiles are the stationary point of

    ½ ∫ 2μ (k²U² + W'²) + μ (U' − kW)² − ⅔ μ (W' + kU)² + K (Π(W' + kU))² dz + ½ (n W² + s U²)(bottom) + p̂ W(top)

with the seat's stiffness n and shear s. This is a small system for each k. I. N. Sneddon, Fourier Transforms,
McGraw-Hill 1951, section 54. Lengths and stresses are in units of the stack.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from numpy.polynomial import legendre
from scipy.interpolate import CubicSpline
from scipy.special import j0, j1

from coilarray.compute.arrays import FloatArray
from coilarray.elastomer.box import SOFTEST, Axis, element_matrices
from coilarray.elastomer.contact_grid import Stack
from coilarray.elastomer.contact_mesh import graded
from coilarray.geometry import Seat
from coilarray.geometry.sheet import Base

_DEGREE = 8  # of the profiles in an element
_SMOOTH = 1 / 3  # of the contact radius, over which a pressure is smoothed, which determines the highest wavenumber
_CUT = 5.0  # highest wavenumber times that radius, where 5e-5 of the pressure is left
_SPARE = 40  # wavenumbers above two a period
_RATIO = 0.1  # distance of wavenumbers relative to themselves in tables of the profiles, accurate to 1e-5
_FINEST, _GROWTH = 0.03, 0.03  # distance of the radii of the tables, and its growth with the radius


@dataclass(frozen=True, eq=False)
class WideField:
    """Displacement and stress about the axis at some heights.

    They are splines over radii (…). `moved` gives u_r and u_z, (…, 2, cases, heights). `stress` gives σ_rr, the hoop
    stress and σ_rz, (…, 3, cases, heights).
    """

    moved: CubicSpline
    stress: CubicSpline


def transform(r: FloatArray, pressure: FloatArray, wavenumbers: FloatArray) -> FloatArray:
    """∫ p J_0(kr) r dr of pressures (cases, n) linear between radii (n,)."""
    x, w = legendre.leggauss(4)
    width = np.diff(r)[:, None]
    at = r[:-1, None] + width * (x + 1) / 2
    rise = (x + 1) / 2
    values = pressure[:, :-1, None] * (1 - rise) + pressure[:, 1:, None] * rise
    loads = (values * at * width * w / 2).reshape(len(pressure), -1)
    used = (loads != 0).any(axis=0)
    return np.asarray(loads[:, used] @ j0(np.outer(at.ravel()[used], wavenumbers)))


def wide_field(
    stack: Stack, base: Base, r: FloatArray, pressure: FloatArray, heights: FloatArray, extent: float
) -> WideField:
    """Field of a wide stack under pressures (cases, n) linear between radii (n,).

    The heights are from −1, the board, to 0, the top, the radii up to `extent`.
    """
    loaded = np.flatnonzero((pressure > 0).any(axis=0))
    contact = float(r[min(loaded[-1] + 1, len(r) - 1)]) if len(loaded) else 1.0
    highest = _CUT / (_SMOOTH * contact)
    count = int(np.ceil(highest * extent / np.pi)) + _SPARE
    x, w = legendre.leggauss(count)
    k, rule = (x + 1) / 2 * highest, w / 2 * highest
    spread = (k * _SMOOTH * contact) ** 2 / 2
    smooth = (1 + spread) * np.exp(-spread)  # keeps the force and its second moments unchanged
    strength = transform(r, pressure, k) * smooth * rule * k
    few = graded(float(k[0]), float(k[-1]), lambda k: _RATIO * k)
    profiles = (CubicSpline(few, profile)(k) for profile in _profiles(stack, base, few, heights))
    radii = graded(0.0, extent, lambda r: _FINEST + _GROWTH * r)
    kr = np.outer(k, radii)
    even, odd = j0(kr), j1(kr)
    ratio = np.where(radii > 0, odd / np.where(radii > 0, radii, 1.0), k[:, None] / 2)  # J_1(kr)/r

    def summed(profile: FloatArray, waves: FloatArray) -> FloatArray:
        """Sum over k, shape (radii, cases, heights)."""
        return np.stack([waves.T @ (load[:, None] * profile) for load in strength], axis=1)

    W, U, isotropic, widening, shearing = profiles
    hoop = summed(2 * widening, ratio)  # 2μ u_r/r
    mean = summed(isotropic, even)
    stress = [mean + summed(2 * k[:, None] * widening, even) - hoop, mean + hoop, summed(shearing, odd)]
    moved = [summed(U, odd), summed(W, even)]
    return WideField(CubicSpline(radii, np.stack(moved, axis=1)), CubicSpline(radii, np.stack(stress, axis=1)))


def _profiles(stack: Stack, base: Base, k: FloatArray, heights: FloatArray) -> tuple[FloatArray, ...]:
    """Profiles W, U, −p − ⅔ μ div u, μU, μ(U' − kW) under unit pressures, (k, heights)."""
    edges, sheet = _elements(stack)
    axis = Axis(edges, _DEGREE)
    n = len(axis.nodes)
    constant, linear, square = (np.zeros((2 * n, 2 * n)) for _ in range(3))  # coefficients of the powers of k
    bulk = []
    for element, width in enumerate(np.diff(edges)):
        part, own = element_matrices(axis, float(width)), axis.of(element)
        mu, soft = stack.shear[sheet[element]], max(float(stack.squash[sheet[element]]), SOFTEST)
        w, u = own, slice(n + own.start, n + own.stop)
        constant[w, w] += mu * 4 / 3 * part.stiffness + part.slope.T @ part.slope / soft
        constant[u, u] += mu * part.stiffness
        square[w, w] += mu * part.mass
        square[u, u] += mu * 4 / 3 * part.mass + part.mean.T @ part.mean / soft
        cross = -mu * (part.mixed.T + 2 / 3 * part.mixed) + part.slope.T @ part.mean / soft  # test W, trial U
        linear[w, u] += cross
        linear[u, w] += cross.T
        bulk.append((part, soft))
    free = np.ones(2 * n, dtype=bool)
    if isinstance(base, Seat):
        unit = stack.length / stack.stress
        constant[0, 0] += base.stiffness * unit
        constant[n, n] += base.shear * unit
    else:
        free[[0, n] if base == "bonded" else [0]] = False
    where = np.ix_(free, free)
    system = constant[where] + k[:, None, None] * linear[where] + (k**2)[:, None, None] * square[where]
    load = np.zeros((len(k), 2 * n))
    load[:, n - 1] = -1.0
    solution = np.zeros_like(load)
    solution[:, free] = np.linalg.solve(system, load[:, free][..., None])[..., 0]
    W, U = solution[:, :n], solution[:, n:]

    value, slope = axis.basis(heights), axis.basis(heights, 1)
    holding = np.clip(np.searchsorted(edges, heights, side="right") - 1, 0, len(edges) - 2)
    mu = stack.shear[sheet[holding]]
    isotropic = np.empty((len(k), len(heights)))
    for e in np.unique(holding).tolist():
        here, own, (part, soft) = holding == e, axis.of(e), bulk[e]
        local = 2 * (heights[here] - edges[e]) / (edges[e + 1] - edges[e]) - 1
        norms = np.sqrt((2 * np.arange(_DEGREE) + 1) / (edges[e + 1] - edges[e]))
        modes = legendre.legvander(local, _DEGREE - 1) * norms
        amount = W[:, own] @ part.slope.T + k[:, None] * (U[:, own] @ part.mean.T)
        isotropic[:, here] = amount @ modes.T / soft
    isotropic -= 2 / 3 * mu * (W @ slope.T + k[:, None] * (U @ value.T))
    shearing = mu * (U @ slope.T - k[:, None] * (W @ value.T))
    return W @ value.T, U @ value.T, isotropic, mu * (U @ value.T), shearing


def _elements(stack: Stack) -> tuple[FloatArray, npt.NDArray[np.intp]]:
    """Edges of elements over the height, finer towards the top, and their sheets."""
    edges, sheets = [stack.levels[0]], []
    for sheet, (lower, upper) in enumerate(zip(stack.levels[:-1], stack.levels[1:], strict=True)):
        cuts = [lower]
        while (gap := upper - cuts[-1]) > 0:
            step = max(0.35 * (0.05 - cuts[-1]), 0.05)  # shorter waves matter closer to the top
            cuts.append(upper if gap < 1.5 * step else cuts[-1] + step)
        edges += cuts[1:]
        sheets += [sheet] * (len(cuts) - 1)
    return np.array(edges), np.array(sheets)
