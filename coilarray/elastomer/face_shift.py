"""Change of inductance by small shifts of magnetic faces.

To first order (Hadamard's formula), if a face with μ1 below and μ2 above moves up by f(x, y),

    ΔL_ij = μ0 ∫ f [(μ1 − μ2) H_t,i·H_t,j + (1/μ2 − 1/μ1) B_n,i B_n,j] dS

with the fields of the flat sheets, permeabilities relative to μ0 and B in units of μ0. It is used
for the smooth shifts by the sides and the seat of a sample, which are small compared with its
thickness. Dents are solved by `coilarray.elastomer.scattering`.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.polynomial.legendre import leggauss

from coilarray.compute.arrays import BoolArray, ComplexArray, FloatArray
from coilarray.constants import MU_0
from coilarray.elastomer.box import Axis
from coilarray.elastomer.finite_sample import SampleCorrection
from coilarray.elastomer.scattering import LayerMesh, wavenumber_rule
from coilarray.electromagnetics.field import Source, as_conductors
from coilarray.electromagnetics.flat_stack import (
    Backing,
    coil_segments,
    flat_profile,
    gradients_on_grid,
    segment_centres,
    segment_spectra,
)
from coilarray.geometry import Sheet

_STEP = 1e-6  # of a difference in heights, over the shortest wavelength
_SPACING = 0.5  # of the points of the integral, in heights of the lowest magnetic face
_FADED = 2.5  # thicknesses of the stack beyond the sample where the wide sample's displacement is still subtracted
_FAINT = 1e-4  # of its largest displacement, below which the wide sample counts as at rest
_PLACES = 64  # at a time, which bounds the memory


def shift_inductance(
    source: Source,
    sheets: Sequence[Sheet],
    correction: SampleCorrection,
    places: FloatArray,
    origin: tuple[float, float],
    mesh: LayerMesh,
    backing: Backing | None = None,
) -> ComplexArray:
    """Change ΔL − jΔR/ω by a sample's shifts in H, (depths, places, coils, coils)."""
    count = len(as_conductors(source))
    pairs = np.triu_indices(count)
    own, other = (np.eye(count)[numbers] for numbers in pairs)
    change = shift_energy(source, sheets, correction, places, origin, mesh, own, other, backing)
    full = np.zeros((*change.shape[:2], count, count), dtype=np.complex128)
    full[..., pairs[0], pairs[1]] = full[..., pairs[1], pairs[0]] = change
    return full


def shift_energy(
    source: Source,
    sheets: Sequence[Sheet],
    correction: SampleCorrection,
    places: FloatArray,
    origin: tuple[float, float],
    mesh: LayerMesh,
    own: FloatArray | ComplexArray,
    other: FloatArray | ComplexArray,
    backing: Backing | None = None,
) -> ComplexArray:
    """Change iᵀ ΔL j by a sample's shifts, (depths, places, n).

    It is in H per A² of i and j (n, coils). The `places` in m count from the map's `origin` on the
    board. Outside the sample the shift removes the wide sample's displacement.
    """
    depths, count, levels = correction.moved.shape[:3]
    mu = (1.0, *(sheet.relative_permeability for sheet in sheets), 1.0)
    faces = [face for face in range(levels) if mu[face] != mu[face + 1]]
    coils = coil_segments(source)
    seen = [coils] if backing is None else backing.seen(coils)
    if backing is not None:
        own, other = (each @ backing.currents(len(coils)).T for each in (own, other))
    change = np.zeros((depths, count, len(own)), dtype=np.complex128)
    if not faces:
        return change
    thicknesses = [sheet.thickness for sheet in sheets]
    heights = np.concatenate(([0.0], np.cumsum(thicknesses)))[faces]
    beyond = _FADED * sum(thicknesses)
    (x, wx, inside_x), (y, wy, inside_y) = (
        _points(axis, beyond, _SPACING * float(heights[0])) for axis in (correction.x, correction.y)
    )
    centres, radius = segment_centres(seen[0])
    centres = centres - origin
    extent = float(np.hypot(*(np.array([x[[0, -1]], y[[0, -1]]])[:, None] - centres.T[..., None])).max()) + radius
    wavenumbers, weights = wavenumber_rule(float(heights[0]), extent, mesh.coarser())
    step = _STEP / wavenumbers[-1]
    at, above = (flat_profile(wavenumbers, heights + up, thicknesses, mu[1:-1]) for up in (0.0, step))
    on_grid = x + origin[0], y + origin[1], weights
    fields: FloatArray | ComplexArray
    if backing is None:
        fields = gradients_on_grid(segment_spectra(coils, wavenumbers), *on_grid, at, (above - at) / step)
    else:
        fields = np.zeros((len(centres), 3, len(faces), len(x), len(y)), dtype=np.complex128)
        for images, arriving in zip(seen, backing.arriving(wavenumbers, thicknesses, mu[1:-1]), strict=True):
            profiles, slopes = (
                np.concatenate((values * arriving.real, values * arriving.imag)) for values in (at, (above - at) / step)
            )
            both = gradients_on_grid(segment_spectra(images, wavenumbers), *on_grid, profiles, slopes)
            fields += both[:, :, : len(faces)] + 1j * both[:, :, len(faces) :]

    shapes_x, shapes_y = correction.x.basis(x[inside_x]), correction.y.basis(y[inside_y])
    outside = ~(inside_x[:, None] & inside_y)
    at_x, at_y = (grid[outside] for grid in np.meshgrid(x, y, indexing="ij"))
    for number, face in enumerate(faces):
        H = fields[:, :, number]
        along, across = MU_0 * (mu[face] - mu[face + 1]), MU_0 * (1 / mu[face + 1] - 1 / mu[face]) * mu[face + 1] ** 2
        one, two = (np.tensordot(currents, H, axes=1) for currents in (own, other))
        density = along * (one[:, :2] * two[:, :2]).sum(axis=1) + across * one[:, 2] * two[:, 2]
        density *= wx[:, None] * wy
        within = np.ascontiguousarray(density[:, inside_x][:, :, inside_y])
        nodal = shapes_x.T @ within @ shapes_y
        change += correction.moved[:, :, face].reshape(depths, count, -1) @ nodal.reshape(len(own), -1).T
        lost, end = density[:, outside].T, _moved_radius(correction, face)
        for start in range(0, count, _PLACES):
            block = slice(start, start + _PLACES)
            r = np.hypot(at_x - places[block, 0, None], at_y - places[block, 1, None])
            wide, near = np.zeros((depths, *r.shape)), r < end
            wide[:, near] = correction.beyond(r[near], face).T
            change[:, block] -= wide @ lost
    return change


def _moved_radius(correction: SampleCorrection, face: int) -> float:
    """Radius in m beyond which the sample is still."""
    r = correction.wide.x * correction.length
    size = np.abs(correction.beyond(r, face)).max(axis=1)
    return float(r[np.flatnonzero(size >= _FAINT * size.max())[-1]])


def _points(axis: Axis, beyond: float, spacing: float) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Points and weights to `beyond` both ends, and a mask inside."""
    inner, inner_weights = axis.rule(spacing)
    node, rule = leggauss(int(np.ceil(beyond / spacing)) + 2)
    step, rule = beyond * (node + 1) / 2, beyond * rule / 2
    low, high = axis.edges[0], axis.edges[-1]
    points = np.concatenate((low - step[::-1], inner, high + step))
    weights = np.concatenate((rule[::-1], inner_weights, rule))
    return points, weights, (points > low) & (points < high)
