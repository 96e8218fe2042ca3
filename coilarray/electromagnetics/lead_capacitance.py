"""Capacitance of a winding's leads by the method of moments.

Leads, and a few ribbons per layer of the winding from ray to ray, are straight wires in the layered
dielectric. A flat strip of width w acts as a round wire of radius w/4. Green's function of the
layers is taken as a sum of images, Σ a/(2π √(ρ² + b²)), fitted in the spectral domain (Σ a
exp(−kb)/k; Chow et al., IEEE Trans. MTT 39, 588 (1991), with fixed real depths b). The potential of
a uniformly charged straight wire is then a logarithm. The result is good to 15 % (tests).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.linalg

from coilarray.compute.arrays import FloatArray, IntArray
from coilarray.compute.threads import serial_algebra
from coilarray.electromagnetics.layered_strips import LayeredMedium
from coilarray.geometry.winding import Cut, Turns

# The leads' part is a difference, which depends little on the fineness of the winding. Twice as
# many rays and ribbons change it by 4 % at most (tests).
_RAYS = 16  # from each pole
_RIBBONS = 4, 16  # at most, per layer and on all layers
_GROWTH = 1.15  # of the pieces of a lead, beginning with a pitch at the winding
_MOST_BESIDE = 8  # wires of a wide lead
_GRAIN = 1e-9  # of a length; smaller differences are rounding
_GUIDING = 50.0  # relative permittivity above which layers hold the field beyond the farthest image
_IMAGES = 16  # errors are 1e-4, and 2 % between planes with other copper layers between them
_GAUSS, _WEIGHTS = np.polynomial.legendre.leggauss(5)


@dataclass(frozen=True, eq=False)
class _Wire:
    """Straight parts of a uniformly charged wire, ends (n, 2) and radius in m."""

    start: FloatArray
    stop: FloatArray
    radius: float
    plane: int
    potential: float


@serial_algebra()
def lead_capacitance(medium: LayeredMedium, planes: IntArray, thicknesses: FloatArray, turns: Turns) -> float:
    """Compute the capacitance in F of leads at a winding.

    Every lead has the potential of its end of the winding, whose potential rises evenly along the
    path. All wires together float without net charge. The result is the capacitance of leads and
    ribbons less the capacitance of the ribbons alone, without vias and pads. Charges that are free
    in more places store more energy, so it grows with the leads.
    """
    used = np.unique(planes)
    near = float(np.diff(np.cumsum((0.0, *medium.thicknesses))[used]).min()) if len(used) > 1 else math.inf
    leads = list(_leads(turns, planes, thicknesses, near))
    if not leads:
        return 0.0
    winding = list(_ribbons(turns, planes, near))
    A = _potentials(medium, [*winding, *leads])
    V = np.array([wire.potential for wire in (*winding, *leads)])
    n = len(winding)
    return _floating(A, V) - (_floating(A[:n, :n], V[:n]) if n else 0.0)


def _leads(turns: Turns, planes: IntArray, thicknesses: FloatArray, near: float) -> Iterator[_Wire]:
    """Pieces of both leads from the winding on, more for longer leads.

    A lead wider than the distance `near` of planes in m is several wires side by side.
    """
    path = turns.path
    along, grain = path.along, _GRAIN * turns.pitch
    for origin, end, potential in ((turns.begin, 0.0, 0.0), (turns.end, float(along[-1]), 1.0)):
        sense, length = math.copysign(1.0, end - origin), abs(end - origin)
        done, step = 0.0, turns.pitch
        while done < length - grain:
            low, high = sorted((origin + sense * done, origin + sense * min(done + step, length)))
            done, step = done + step, step * _GROWTH
            inside = (along > low + grain) & (along < high - grain)
            ends = np.unique(np.concatenate(([low], along[inside], [high])))
            piece = np.searchsorted(along, 0.5 * (ends[1:] + ends[:-1]), side="right") - 1
            for line in np.unique(path.line[piece]):
                on = np.flatnonzero(path.line[piece] == line)
                width = float(np.average(path.widths[piece[on]], weights=np.diff(ends)[on]))
                points = path.at(ends[on[0] : on[-1] + 2])
                steps = np.diff(points, axis=0)
                sideways = np.column_stack((-steps[:, 1], steps[:, 0])) / np.hypot(*steps.T)[:, None]
                thickness = float(thicknesses[line])
                # A width equal to the planes' distance up to rounding is one wire.
                count = min(max(math.ceil(width / near - _GRAIN), 1), _MOST_BESIDE) if math.isfinite(near) else 1
                for k in range(count):
                    shift = ((k + 0.5) / count - 0.5) * width * sideways
                    # The radius of one wire is for a strip. Many wires make up a sheet and have its
                    # mean field near it.
                    radius = (width + thickness) / 4 if count == 1 else (width + thickness) / count / (2 * math.pi)
                    yield _Wire(points[:-1] + shift, points[1:] + shift, radius, int(planes[line]), potential)


def _ribbons(turns: Turns, planes: IntArray, near: float) -> Iterator[_Wire]:
    """Group turns between rays into ribbons thinner than the distance of planes."""
    path = turns.path
    most, total = _RIBBONS
    for pole in turns.poles:
        cuts = turns.about(pole, _RAYS)
        on = [planes[path.line[cut.piece]] for cut in cuts]
        used = np.unique(np.concatenate(on))
        for plane in used:
            counts = [int((layer == plane).sum()) for layer in on]
            groups = min(int(np.median(counts)), most, max(1, total // len(used)))
            nodes = [
                [_middle(turns, cut, group) for group in np.array_split(np.flatnonzero(layer == plane), groups)]
                if count >= groups > 0
                else []
                for cut, layer, count in zip(cuts, on, counts, strict=True)
            ]
            for one, other in zip(nodes, nodes[1:] + nodes[:1], strict=True):
                for (a, width_a, V_a), (b, width_b, V_b) in zip(one, other, strict=False):  # a ray may cross nothing
                    radius = min((width_a + width_b) / 8, near / 2)
                    yield _Wire(a[None], b[None], radius, int(plane), (V_a + V_b) / 2)


def _middle(turns: Turns, cut: Cut, group: IntArray) -> tuple[FloatArray, float, float]:
    """Middle (2,) and total width in m, and mean potential, of turns."""
    path, piece, along = turns.path, cut.piece[group], cut.along[group]
    width = float(np.ptp(cut.across[group]) + path.widths[piece].mean())
    V = (along - turns.begin) / (turns.end - turns.begin)
    return path.at(along).mean(axis=0), width, float(V.mean())


def _images(medium: LayeredMedium, p: int, q: int, smallest: float) -> tuple[FloatArray, FloatArray]:
    """Image strengths in V m/C and depths in m of plane p seen on plane q."""
    height = np.cumsum((0.0, *medium.thicknesses))
    apart = abs(float(height[p] - height[q]))
    near, far = apart or min((*medium.thicknesses, smallest)), max(float(height[-1]), smallest)
    far *= max(1.0, max(medium.epsilon_r) / _GUIDING)  # distance that a field runs along a layer
    k = np.geomspace(1e-3 / far, 10 / near, 300)
    green = medium.green(k)[:, p, q] * k
    depth = apart + np.append(0.0, np.geomspace(near / 2, 100 * far, _IMAGES - 1))
    strength = np.linalg.lstsq(np.exp(-np.outer(k, depth)) / green[:, None], np.ones(len(k)), rcond=1e-9)[0]
    return np.asarray(strength, dtype=np.float64), depth


def _potentials(medium: LayeredMedium, wires: Sequence[_Wire]) -> FloatArray:
    """Mean potential per charge of wires in V/C, (n, n)."""
    owner = np.repeat(np.arange(len(wires)), [len(wire.start) for wire in wires])
    start = np.vstack([wire.start for wire in wires])
    step = np.vstack([wire.stop for wire in wires]) - start
    plane = np.array([wire.plane for wire in wires])[owner]
    # Radii add as squares, so that every wire has its own and the matrix stays positive definite.
    spread = np.array([wire.radius for wire in wires])[owner] ** 2 / 2
    length = np.hypot(*step.T)
    places = (start + step / 2)[:, None] + _GAUSS[:, None] / 2 * step[:, None]
    M = np.zeros((len(start),) * 2)
    for p in np.unique(plane):
        one = np.flatnonzero(plane == p)
        for q in np.unique(plane[plane >= p]):
            other = np.flatnonzero(plane == q)
            away = places[other] - start[one][:, None, None]
            span = length[one][:, None, None]
            u = np.einsum("ijgx,ix->ijg", away, step[one] / length[one][:, None])
            v = (away**2).sum(axis=-1) - u**2 + (spread[one][:, None] + spread[other])[..., None]
            potential = np.zeros_like(u)
            for strength, depth in zip(*_images(medium, int(p), int(q), 2 * float(np.sqrt(spread.min()))), strict=True):
                both = np.sqrt(u**2 + v + depth**2) + np.sqrt((span - u) ** 2 + v + depth**2)
                potential += strength * np.log((both + span) / (both - span))
            block = potential @ (_WEIGHTS / 2) / (2 * math.pi) * length[other]
            M[np.ix_(one, other)] = block
            if p != q:
                M[np.ix_(other, one)] = block.T
    M = 0.5 * (M + M.T)
    share = np.zeros((len(start), len(wires)))
    share[np.arange(len(start)), owner] = 1 / np.bincount(owner, length)[owner]
    return np.asarray(share.T @ M @ share)


def _floating(A: FloatArray, V: FloatArray) -> float:
    """Twice the energy in J of wires without net charge at potentials V."""
    charge, raised = scipy.linalg.cho_solve(scipy.linalg.cho_factor(A), np.column_stack((V, np.ones_like(V)))).T
    return float(V @ charge - charge.sum() ** 2 / raised.sum())
