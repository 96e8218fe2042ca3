"""Capacitance per length of flat strips in a layered dielectric.

The strips lie on the planes of the layers (2-D electrostatics). A charge density σ cos kx on one
plane makes potentials φ cos kx on all of them. With Y the tridiagonal matrix of the slabs between
the planes,

    σ = Y φ,   Y_ii += ε0 ε k coth kd,   Y_i,i±1 = −ε0 ε k / sinh kd,   half space: Y_ii += ε0 ε k,

so that Green's function of wavenumber k is G = Y⁻¹ (Itoh, IEEE Trans. MTT 28, 733 (1980), static
limit), here in closed form by recursion over the slabs. The charge on a strip of half width a is
expanded in T_m(u)/(π a √(1 − u²)), which has the edge singularity of a thin strip and the Fourier
transform i^m J_m(ka). Galerkin's method makes the matrix symmetric. A trace of finite thickness is
two strips of one potential, its upper and its lower face. The side walls are left out, which makes
C some 1 % too small at usual thickness.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import scipy.linalg
from scipy.special import jv

from coilarray.compute.arrays import FloatArray, IntArray
from coilarray.compute.memory import require_memory
from coilarray.compute.threads import serial_algebra
from coilarray.constants import EPSILON_0
from coilarray.errors import GeometryError

_MOST_PRODUCTS = 1e11  # wavenumbers times functions times functions: some ten seconds, and 1 GB of memory
_OF_A_TRANSFORM = 1000  # products that take as long as the transform of a function
# Wavenumbers reach this number over the smallest half width a. The tail beyond is added in its
# asymptotic form, which leaves (ka)⁻². It holds for ka far above m²/2, so more than three basis
# functions need more, as their square.
_CUTOFF_WIDTH = 25.0
# They also reach this number over the smallest distance d of two charged planes. The remainder is
# exp(−kd) of the tail.
_CUTOFF_DISTANCE = 5.0


@dataclass(frozen=True)
class LayeredMedium:
    """Dielectrics from top to bottom: thicknesses in m between planes, two permittivities more."""

    thicknesses: tuple[float, ...]
    epsilon_r: tuple[float, ...]

    def green(self, k: FloatArray) -> FloatArray:
        """Potential per charge density (n, planes, planes) in V m²/C.

        Admittances up and down from each plane are carried through a slab as along a line of length
        d: Y → y (y + Y coth kd)/(y coth kd + Y) with y = ε0 ε k, and the potential by y/sinh kd/(y
        coth kd + Y).
        """
        n = len(self.thicknesses) + 1
        y = EPSILON_0 * np.outer(self.epsilon_r, k)
        slabs = k * np.array(self.thicknesses)[:, None]
        coth, csch = 1 / np.tanh(slabs), 2 * np.exp(-slabs) / -np.expm1(-2 * slabs)
        up, down, passed = np.empty((n, len(k))), np.empty((n, len(k))), np.empty((n - 1, len(k)))
        up[0], down[-1] = y[0], y[-1]
        for i in range(n - 1):
            slab = y[i + 1]
            up[i + 1] = slab * (slab + up[i] * coth[i]) / (slab * coth[i] + up[i])
        for i in reversed(range(n - 1)):
            slab = y[i + 1]
            down[i] = slab * (slab + down[i + 1] * coth[i]) / (slab * coth[i] + down[i + 1])
            passed[i] = slab * csch[i] / (slab * coth[i] + down[i + 1])
        G = np.empty((len(k), n, n))
        for i in range(n):
            potential = 1 / (up[i] + down[i])
            G[:, i, i] = potential
            for j in range(i + 1, n):
                potential = potential * passed[j - 1]
                G[:, i, j] = G[:, j, i] = potential
        return G

    def mean_green(self) -> FloatArray:
        """`green` at k = 0 without net charge, (planes, planes), relative to the bottom plane."""
        slabs = np.array(self.thicknesses) / (EPSILON_0 * np.array(self.epsilon_r[1:-1]))
        below = np.append(np.cumsum(slabs[::-1])[::-1], 0.0)
        return np.asarray(np.minimum.outer(below, below))


@serial_algebra()
def strip_capacitance(
    medium: LayeredMedium,
    planes: Sequence[int],
    centres: npt.ArrayLike,
    widths: npt.ArrayLike,
    conductors: Sequence[int] | None = None,
    *,
    period: float,
    mirror: bool = False,
    basis: int = 3,
    cutoff: float | None = None,
) -> FloatArray:
    """Compute the Maxwell capacitance matrix of parallel strips in F/m.

    The strips lie on the `planes` (n,) of the medium, 0 on top, with `centres` and `widths` (n,) in
    m, repeated with the `period`. Isolated strips without net charge need a period of many times
    their extent, as the error falls as its square. With `mirror`, strips lie in 0 < x < period and
    are mirrored at both ends, with their potentials. Three functions per strip (`basis`) suffice
    for strips not much wider than their distances. `cutoff` is the largest wavenumber in 1/m.

    The matrix, charge of each of the `conductors` per potential of each, is symmetric. Rows sum to
    zero (no net charge).

    A q = V with A_pq = (1/P) Σ_n (2 − δ_n0) G(k_n) f_p(k_n) f_q(k_n), k_n = 2πn/P (mirrored: πn/P),
    and f the transforms in the module's heading. Beyond the cutoff K, a strip's J_m J_m' averages
    to ±1/(πka) and G to 1/(ε0 (ε_above + ε_below) k). The tail is then 1/(π² a K ε0 (ε_above +
    ε_below)).
    """
    plane = np.asarray(planes, dtype=np.int64)
    x, w = np.asarray(centres, dtype=np.float64), np.asarray(widths, dtype=np.float64)
    label = np.arange(len(plane)) if conductors is None else np.asarray(conductors, dtype=np.int64)
    for p in np.unique(plane):
        on = np.flatnonzero(plane == p)
        on = on[np.argsort(x[on])]
        left, right = x[on] - w[on] / 2, x[on] + w[on] / 2
        following = np.append(left[1:], period if mirror else left[0] + period)
        if (following <= right).any() or (mirror and left[0] <= 0):
            where = int(np.argmin(following - right))
            raise GeometryError(
                f"copper overlaps on plane {p}: the strip at {x[on[where]] * 1e3:.4g} mm, {w[on[where]] * 1e3:.4g} mm "
                f"wide, reaches its neighbour, or the strips do not fit into the period of {period * 1e3:.4g} mm."
            )
    if cutoff is None:
        cutoff = _default_cutoff(medium, plane, w, basis)
    step = (1 if mirror else 2) * math.pi / period
    terms = max(1, math.ceil(cutoff / step))
    products = terms * len(plane) * basis * (len(plane) * basis + _OF_A_TRANSFORM)
    if products > _MOST_PRODUCTS:
        apart = plane_gap(medium, plane) * 1e3
        raise GeometryError(
            f"its {len(plane)} strips, {w.min() * 1e3:.3g} mm wide on planes {apart:.3g} mm apart, would take "
            f"{products / _MOST_PRODUCTS:.2g} times the work that is allowed; make traces or dielectrics thicker."
        )
    k = _wavenumbers(step, terms, medium)
    order = np.argsort(plane, kind="stable")
    plane, x, w, label = plane[order], x[order], w[order], label[order]
    used, first = np.unique(plane, return_index=True)
    G = medium.green(k)
    A = np.zeros((len(plane) * basis,) * 2)
    bounds = np.append(first, len(plane)) * basis
    places, place = np.unique(np.column_stack((x, w)), axis=0, return_inverse=True)  # both faces of a trace lie in one
    for transforms in _transforms(k, places[:, 0], places[:, 1] / 2, basis, mirror):
        f = transforms[:, place.ravel()].reshape(len(k), -1)
        for i, p in enumerate(used):
            rows = slice(bounds[i], bounds[i + 1])
            weighted = f[:, rows].T * (2 / period)
            for j in range(i, len(used)):
                A[rows, bounds[j] : bounds[j + 1]] += (weighted * G[:, p, used[j]]) @ f[:, bounds[j] : bounds[j + 1]]
    A = np.triu(A) + np.triu(A, 1).T
    _add_tail(A, medium, plane, w, basis, float(k[-1] + step / 2))
    A[::basis, ::basis] += medium.mean_green()[np.ix_(plane, plane)] / period
    return _maxwell(A, label, basis)


@serial_algebra()
def crossed_grid_capacitance(
    medium: LayeredMedium,
    planes: Sequence[int],
    widths: npt.ArrayLike,
    pitches: npt.ArrayLike,
    grids: Sequence[int],
    conductors: Sequence[int],
    *,
    basis: int = 3,
) -> FloatArray:
    """Compute the Maxwell matrix of crossed grids in F/m².

    Each of n faces has its plane in the medium, the width and pitch of its traces in m, the number
    of its grid and its conductor. Grids of different direction, pitch or phase act on each other by
    the mean charge alone (k = 0). Their other harmonics have no wavevector in common, and their
    induced charge comes back damped by exp(−4πh/pitch). Within a grid all harmonics count, so the
    fill factor enters with its fringing.
    """
    plane, grid = np.asarray(planes, dtype=np.int64), np.asarray(grids, dtype=np.int64)
    w, p = np.asarray(widths, dtype=np.float64), np.asarray(pitches, dtype=np.float64)
    A = np.zeros((len(plane) * basis,) * 2)
    for g in np.unique(grid):
        faces = np.flatnonzero(grid == g)
        pitch = float(p[faces[0]])
        step = 2 * math.pi / pitch
        cutoff = _default_cutoff(medium, plane[faces], w[faces], basis)
        k = _wavenumbers(step, math.ceil(cutoff / step), medium)
        G = medium.green(k)
        block = np.zeros((len(faces) * basis,) * 2)
        for parts in _transforms(k, np.zeros(len(faces)), w[faces] / 2, basis, mirror=False):
            among = G[:, plane[faces][:, None], plane[faces]]
            block += np.einsum("kfm,kfg,kgn->fmgn", parts, among, parts, optimize=True).reshape(block.shape)
        block *= 2 / pitch
        _add_tail(block, medium, plane[faces], w[faces], basis, float(k[-1] + step / 2))
        rows = (faces[:, None] * basis + np.arange(basis)).ravel()
        A[np.ix_(rows, rows)] += block * pitch  # unknowns are charges per area
    A[::basis, ::basis] += medium.mean_green()[np.ix_(plane, plane)]
    return _maxwell(A, np.asarray(conductors, dtype=np.int64), basis)


def _default_cutoff(medium: LayeredMedium, plane: IntArray, widths: FloatArray, basis: int) -> float:
    widest = _CUTOFF_WIDTH * max(1.0, basis / 3) ** 2 / (float(widths.min()) / 2)
    return max(widest, _CUTOFF_DISTANCE / plane_gap(medium, plane))


def plane_gap(medium: LayeredMedium, plane: IntArray) -> float:
    """Smallest distance in m of planes with strips, inf for one plane."""
    apart = np.diff(np.cumsum((0.0, *medium.thicknesses))[np.unique(plane)])
    return float(apart.min()) if len(apart) else math.inf


def _transforms(k: FloatArray, x: FloatArray, a: FloatArray, basis: int, mirror: bool) -> list[FloatArray]:
    """Cosine and, unless mirrored, sine transforms of the basis, (k, strips, basis)."""
    halves, which = np.unique(a, return_inverse=True)
    m = np.arange(basis)
    J = np.where(m // 2 % 2 == 0, 1.0, -1.0) * jv(m, np.multiply.outer(k, halves)[:, :, None])
    cos, sin = np.cos(k[:, None] * x), np.sin(k[:, None] * x)

    def transform(of_even: FloatArray, of_odd: FloatArray) -> FloatArray:
        f = J[:, which]
        f[:, :, 0::2] *= of_even[:, :, None]
        f[:, :, 1::2] *= of_odd[:, :, None]
        return f

    return [transform(cos, -sin)] if mirror else [transform(cos, -sin), transform(sin, cos)]


def _add_tail(
    A: FloatArray, medium: LayeredMedium, plane: IntArray, widths: FloatArray, basis: int, cutoff: float
) -> None:
    """Add the tail above the cutoff to the strips' own blocks."""
    m = np.arange(basis)
    alike = ((m[:, None] - m) % 2 == 0).astype(np.float64)
    for strip, (p, w) in enumerate(zip(plane, widths, strict=True)):
        epsilon = EPSILON_0 * (medium.epsilon_r[p] + medium.epsilon_r[p + 1])
        block = slice(strip * basis, (strip + 1) * basis)
        A[block, block] += alike / (math.pi**2 * (w / 2) * cutoff * epsilon)


def _maxwell(A: FloatArray, label: IntArray, basis: int) -> FloatArray:
    """Capacitance of conductors without net charge from the strips' potentials A q."""
    n = int(label.max()) + 1
    B = np.zeros((len(A), n))
    B[np.arange(len(label)) * basis, label] = 1.0
    C = B.T @ scipy.linalg.cho_solve(scipy.linalg.cho_factor(A), B)
    total = C.sum(axis=1)  # a common potential, added so that the charges sum to zero
    C -= np.outer(total, total) / total.sum()
    return np.asarray(0.5 * (C + C.T))


def _wavenumbers(step: float, count: int, medium: LayeredMedium) -> FloatArray:
    """Multiples of a step in 1/m, (count,), if `LayeredMedium.green` has memory for them."""
    planes = len(medium.thicknesses) + 1
    size = 8.0 * count * (planes**2 + 8 * planes)
    require_memory(size, "the capacitance within [stackup] and [elastomer], of so different lengths,")
    return step * np.arange(1.0, count + 1)
