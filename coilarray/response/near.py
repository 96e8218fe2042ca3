"""Response of large arrays from near coils and states only.

ΔL_aa falls as the sixth power of the distance from the dent, so that the response of far states is
negligible. In a state a with a response, the current of a far coil b meets the dent too, in 2 i_b
ΔL_ab, which falls as the third power. So the coils whose field counts reach further than the states
that respond. The cost of a position depends on the number of near coils. The cutoff distances are
measured on the design itself, from the fall of ΔL_aa and ΔL_ab and the currents in all other coils.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy.spatial import KDTree

from coilarray.circuit.state_sensitivity import StateSensitivity
from coilarray.compute.arrays import FloatArray, IntArray
from coilarray.compute.memory import require_memory
from coilarray.compute.threads import Progress, part_of, ranges, run_blocks
from coilarray.elastomer.dent import STILL, Dent, Motion
from coilarray.elastomer.dented_layer import amplitude_table, dent_amplitudes, offset_grid
from coilarray.elastomer.scattering import LayerMesh, Scattering, scatter, wavenumber_rule
from coilarray.electromagnetics import flat_stack
from coilarray.geometry import Conductor
from coilarray.response.setup import Experiment

_TOLERANCE = 0.3  # of the amplitudes, relative to the error. δ errs by about a tenth of it
_FIRST_EXTENT, _WIDER = 6.0, 1.5  # of the profile in coil radii, and its growth if it ends too early
_POSITIONS = 32  # at a time, which limits the memory
_DIRECTIONS, _STEPS_PER_RADIUS = 8, 8  # of a profile
_PROFILE_TOLERANCE = 1e-4  # of its amplitudes
_LEFT = 0.9  # of the largest ΔL_aa that remains in the largest δ beside the currents of the neighbours
_DIPOLE = 3  # power of the distance with which a coil's field falls
_Profile = tuple[FloatArray, FloatArray, FloatArray]
"""Distances in m of a coil from the axis, rising from 0, and the largest |ΔL_aa| of it and |ΔL_ab| with any coil."""


@dataclass(frozen=True)
class Cutoff:
    """Cutoff distances from the indenter's axis in m.

    States whose coil centre lies beyond `states` have no response. Currents beyond `coils` are left
    out.
    """

    states: float
    coils: float


def near_response(
    pressed: Experiment,
    conductors: Sequence[Conductor],
    states: StateSensitivity,
    error: float,
    mesh: LayerMesh,
    *,
    progress: Progress | None = None,
) -> tuple[FloatArray, Cutoff]:
    """Compute δ (depths, positions, states) of near states.

    δ_a = Re(w_a i_aᵀ ΔL i_a) with the currents of the flat board, to first order in ΔL, which
    leaves out 4.5e-5 of the peak for 1 mm in gast2020. The cutoff follows from the relative `error`
    of δ.
    """
    points = pressed.points
    delta = np.zeros((len(pressed.axes.depth), len(points), len(states.measured)))
    blocks = [slice(*block) for block in ranges(len(points), _POSITIONS)]
    # with a coil without current, and a state without response
    padded = replace(states, currents=np.pad(states.currents, ((0, 1), (0, 1))), weights=np.append(states.weights, 0))
    for coarse in (True, False):
        levels = [level for level in pressed.levels if level.coarse == coarse]
        dents = [(k, level.shares[k], dent) for level in levels for k, dent in enumerate(level.dents)]
        moving = [one for one in dents if np.isfinite(one[2].clearance)]
        cutoff = Cutoff(0.0, 0.0)
        if not moving:
            continue
        accuracy = mesh.coarser() if coarse else mesh
        solved = _solve([dent for *_, dent in moving], conductors, states, points, error, accuracy)
        cutoff, centres = solved.cutoff, solved.spectra[STILL.slope].centres
        near = _within(centres[states.measured], points, cutoff.states)
        coils = _within(centres, points, cutoff.coils)
        for turn, ((k, shares, dent), scattering) in enumerate(zip(moving, solved.scatterings, strict=True)):
            strengths, fields = _fields(solved, scattering, dent.motion, points, coils)
            respond = partial(_add_delta, delta[k], shares, padded, near, coils, strengths, fields)
            run_blocks(respond, blocks, progress=part_of(progress, turn, len(moving)))
    return delta, cutoff


@dataclass(frozen=True, eq=False)
class _Solved:
    """Solved dents, coil spectra of a motion, and cutoff distances."""

    scatterings: tuple[Scattering, ...]
    spectra: Mapping[tuple[float, float], flat_stack.CoilSpectra]
    clearance: float
    cutoff: Cutoff
    error: float


def _solve(
    dents: Sequence[Dent],
    conductors: Sequence[Conductor],
    states: StateSensitivity,
    points: FloatArray,
    error: float,
    mesh: LayerMesh,
) -> _Solved:
    """Solve the dents for all coils within the cutoff."""
    coils = flat_stack.coil_segments(conductors)
    centres, radius = flat_stack.segment_centres(coils)
    corners = np.array([points.min(axis=0), points.max(axis=0)])
    # the factor includes the farthest coil
    farthest = float(np.hypot(*np.abs(corners[:, None] - centres).max(axis=0).T).max()) * (1 + 1e-9)
    clearance = min(dent.clearance for dent in dents)
    width = max(dent.width for dent in dents)
    deepest = [float(np.abs(dent.displacement).max()) for dent in dents]
    worst = int(np.argmax(deepest))
    extent = min(_FIRST_EXTENT * radius, farthest)
    while True:
        wavenumbers, weights = wavenumber_rule(clearance, extent + radius + width, mesh)
        solved = scatter(dents[worst], wavenumbers, weights, mesh, deepest[worst])
        spectra = flat_stack.segment_spectra(coils, wavenumbers)
        cutoff = _cutoff(_profile(solved, spectra, extent), states, centres, error)
        if cutoff.coils <= extent or extent == farthest:
            break
        extent = min(max(_WIDER * extent, cutoff.coils if np.isfinite(cutoff.coils) else 0.0), farthest)
    shapes = {dents[worst].shape: solved}
    for dent in dents:
        if dent.shape not in shapes:
            shapes[dent.shape] = scatter(dent, wavenumbers, weights, mesh, deepest[worst])
    slopes = {dent.motion.slope for dent in dents} - {STILL.slope}
    turned = {slope: flat_stack.turned_spectra(spectra, slope) for slope in slopes}
    cutoff = Cutoff(min(cutoff.states, extent), min(cutoff.coils, extent))
    scatterings = tuple(shapes[dent.shape] for dent in dents)
    return _Solved(scatterings, {STILL.slope: spectra, **turned}, clearance, cutoff, error)


def _profile(scattering: Scattering, spectra: flat_stack.CoilSpectra, farthest: float) -> _Profile:
    """Measure the relative fall of a dent's changes over distance.

    The wavenumbers must resolve the distance in m. The largest values of all shapes of coils are
    taken.
    """
    steps = max(int(np.ceil(_STEPS_PER_RADIUS * farthest / spectra.radius)), 1)
    radius = np.linspace(0, farthest, steps + 1)
    angle = 2 * np.pi * (np.arange(_DIRECTIONS) + 0.5) / _DIRECTIONS
    offsets = (radius[:, None, None] * np.column_stack((np.cos(angle), np.sin(angle)))).reshape(-1, 2)
    own, mutual = np.zeros((2, len(radius)))
    for shape in range(len(spectra.series)):
        places = [offsets if other == shape else offsets[:0] for other in range(len(spectra.series))]
        dent = dent_amplitudes(scattering, spectra, places, _PROFILE_TOLERANCE)
        amplitudes = dent.amplitudes[shape]
        change = np.abs((amplitudes * dent.strengths) @ amplitudes.T)
        own = np.maximum(own, np.diag(change).reshape(len(radius), -1).max(axis=1))
        mutual = np.maximum(mutual, change.max(axis=0).reshape(len(radius), -1).max(axis=1))
    return radius, own / own.max(), mutual / own.max()


def _cutoff(profile: _Profile, states: StateSensitivity, centres: FloatArray, error: float) -> Cutoff:
    """Choose the cutoff from a relative error of δ.

    A state that is left out would have responded by ΔL_aa + 2 i_b ΔL_ab or less, with the dent
    under a coil b. The coils beyond a distance add Σ_b 2 |i_b ΔL_ab| or less to a state with the
    dent under its own coil. They may be nearer to a dent beside it, so half of the error is
    reserved for them.
    """
    distance = np.hypot(*(centres[:, None] - centres[states.measured]).transpose(2, 0, 1))
    radius, own_profile, mutual_profile = profile
    end = radius[-1]
    # Beyond its end the profile falls as for a dipole.
    mutual = np.interp(distance, radius, mutual_profile) * (end / np.maximum(distance, end)) ** _DIPOLE
    shared = 2 * np.abs(states.currents) * mutual
    shared[states.measured, np.arange(len(states.measured))] = 0
    error *= _LEFT
    order = np.argsort(distance, axis=None)
    beyond = np.maximum.accumulate(shared.ravel()[order][::-1])[::-1]
    most_shared = np.append(beyond, 0.0)[np.searchsorted(distance.ravel()[order], radius)]
    own = np.maximum.accumulate(own_profile[::-1])[::-1]
    found = np.flatnonzero(own + most_shared <= error)
    of_states = float(radius[found[0]]) if len(found) else np.inf
    # Beyond this distance all coils together add less than half of the error to any state.
    order = np.argsort(distance, axis=0)
    together = np.cumsum(np.take_along_axis(shared, order, axis=0)[::-1], axis=0)[::-1]
    needed = np.where(together > error / 2, np.take_along_axis(distance, order, axis=0), 0.0)
    return Cutoff(of_states, max(of_states, float(needed.max()) * (1 + 1e-9)))  # includes the coil there


def _within(places: FloatArray, points: FloatArray, distance: float) -> IntArray:
    """Numbers (points, most) of near places, padded with their count."""
    tree = KDTree(places)
    most = max(int(tree.query_ball_point(points, distance, return_length=True).max()), 1)
    require_memory(16.0 * len(points) * most, f"the response at {len(points)} positions", "compute it in pieces")
    _, numbers = tree.query(points, k=list(range(1, most + 1)), distance_upper_bound=np.nextafter(distance, np.inf))
    return np.asarray(numbers, dtype=np.int64)


def _fields(
    solved: _Solved, scattering: Scattering, motion: Motion, points: FloatArray, coils: IntArray
) -> tuple[FloatArray, Callable[[slice], FloatArray]]:
    """Dent strengths (n,), and near amplitudes (points, coils, n)."""
    spectra = solved.spectra[motion.slope]
    shapes = range(len(spectra.series))
    shape_of = np.append(spectra.shape_of, -1)[coils]
    centres = np.vstack((spectra.centres, np.zeros(2)))
    tolerance = _TOLERANCE * solved.error
    axis, grid = offset_grid(solved.cutoff.coils, solved.clearance)

    def spread(shapes_there: IntArray, amplitudes: Sequence[FloatArray]) -> FloatArray:
        whole = np.zeros((*shapes_there.shape, amplitudes[0].shape[1]))
        for shape, values in enumerate(amplitudes):
            whole[shapes_there == shape] = values
        return whole

    if np.count_nonzero(shape_of >= 0) <= len(shapes) * len(grid):
        offsets = points[:, None] - centres[coils]
        dent = dent_amplitudes(scattering, spectra, [offsets[shape_of == s] for s in shapes], tolerance, motion)
        known = spread(shape_of, dent.amplitudes)
        return dent.strengths, lambda rows: known[rows]
    dent = dent_amplitudes(scattering, spectra, [grid for _ in shapes], tolerance, motion)
    tables = [amplitude_table(axis, amplitudes) for amplitudes in dent.amplitudes]

    def from_table(rows: slice) -> FloatArray:
        offsets = points[rows, None] - centres[coils[rows]]
        return spread(shape_of[rows], [table(offsets[shape_of[rows] == s]) for s, table in enumerate(tables)])

    return dent.strengths, from_table


def _add_delta(
    delta: FloatArray,
    shares: FloatArray,
    states: StateSensitivity,
    near: IntArray,
    coils: IntArray,
    strengths: FloatArray,
    fields: Callable[[slice], FloatArray],
    rows: slice,
) -> None:
    """Add δ (points, states) from squared fields of near coils."""
    currents = states.currents[coils[rows, :, None], near[rows, None, :]]
    total = fields(rows).transpose(0, 2, 1) @ np.concatenate((currents.real, currents.imag), axis=2)
    real, imaginary = np.split(total, 2, axis=2)
    values = (states.weights[near[rows]] * (strengths @ (real + 1j * imaginary) ** 2)).real * shares[rows, None]
    point, which = np.nonzero(near[rows] < delta.shape[1])
    delta[rows][point, near[rows][point, which]] += values[point, which]
