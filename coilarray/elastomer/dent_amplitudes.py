"""Amplitudes of a dent in a coil's field, which depend only on the coil's offset.

The energies of `coilarray.elastomer.scattering` are one matrix per harmonic between the incident patterns. In their
principal axes they are

    ΔL_ij = Σ_r s_r a_r(i) a_r(j)

with strengths s_r of the dent and amplitudes a_r(i) that are smooth functions of the offset of coil i from the
indenter, the same for all coils of one shape. So an array of any number of coils needs them once per shape, at the
offsets that occur or on a grid of offsets with splines between.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import NdBSpline, make_interp_spline

from coilarray.compute.arrays import FloatArray
from coilarray.compute.memory import require_memory
from coilarray.compute.threads import ranges, run_blocks
from coilarray.constants import MU_0
from coilarray.elastomer.dent import STILL, Motion
from coilarray.elastomer.scattering import Scattering
from coilarray.electromagnetics.coil_spectrum import CoilSpectra, coil_harmonics

_STEPS_PER_CLEARANCE = 3  # of a table, for which the splines err by 1e-5 of the peak
_DEGREE = 5  # of the splines
_OFFSETS = 512  # at a time


@dataclass(frozen=True, eq=False)
class DentAmplitudes:
    """Strengths of a dent in H, (n,) of either sign, and amplitudes of each shape.

    The amplitudes a (offsets, n) are for every shape of coil.
    """

    strengths: FloatArray
    amplitudes: tuple[FloatArray, ...]


def dent_amplitudes(
    scattering: Scattering,
    spectra: CoilSpectra,
    offsets: Sequence[FloatArray],
    tolerance: float,
    motion: Motion = STILL,
) -> DentAmplitudes:
    """Compute the amplitudes of coils at given offsets.

    The spectra are at the wavenumbers of the dent, for coils turned by the slope of its `motion`. Offsets (offsets, 2)
    for each shape of coil are the position of the indenter minus the centre of the coil in m, within the extent that
    the wavenumbers resolve. Amplitudes below the `tolerance`, a part of the largest, are left out. The energies err by
    about a tenth of it. Raises MemoryLimitError for more offsets than fit into memory.
    """
    orders = len(scattering.energies)
    count = sum(len(points) for points in offsets)
    require_memory(24.0 * count * len(spectra.wavenumbers) * orders, f"the field of coils at {count} offsets")
    incident = [np.empty((orders, 2, len(spectra.wavenumbers), len(points))) for points in offsets]

    def fill(block: tuple[int, slice]) -> None:
        shape, some = block
        incident[shape][..., some] = incident_waves(spectra, shape, offsets[shape][some], orders, motion)

    blocks = [(k, slice(*part)) for k, points in enumerate(offsets) for part in ranges(len(points), _OFFSETS)]
    run_blocks(fill, blocks)
    weighted = [patterns * scattering.weights for patterns in scattering.patterns]
    axes, strengths = [], []
    largest = 0.0
    for m in range(orders):
        gram = sum((part @ part.T for waves in incident for part in weighted[m] @ waves[m]), start=np.zeros(()))
        sizes, vectors = np.linalg.eigh(gram)
        largest = max(largest, float(sizes[-1]))
        kept = vectors[:, sizes > tolerance**2 * largest]
        energy = kept.T @ (scattering.energies[m] + scattering.energies[m].T) @ kept / 2
        strength, turned = np.linalg.eigh(energy)
        axes.append((kept @ turned).T @ weighted[m])
        # the integral over the angle, of the harmonics −m and m, once for the real and once for the imaginary part
        strengths.append(np.tile((2 if m else 1) * 2 * np.pi * MU_0 * strength, 2))
    amplitudes = [np.concatenate([part for m in range(orders) for part in axes[m] @ waves[m]]) for waves in incident]
    return DentAmplitudes(np.concatenate(strengths), tuple(np.ascontiguousarray(values.T) for values in amplitudes))


def offset_grid(extent: float, clearance: float) -> tuple[FloatArray, FloatArray]:
    """Grid of offsets in m up to `extent`, fine enough for a dent's `clearance`.

    Returns the offsets along one axis (n,) and all pairs of them (n², 2), x first.
    """
    half = max(int(np.ceil(_STEPS_PER_CLEARANCE * extent / clearance)), _DEGREE)
    axis = np.linspace(-extent, extent, 2 * half + 1)
    return axis, np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1).reshape(-1, 2)


def amplitude_table(axis: FloatArray, amplitudes: FloatArray) -> NdBSpline:
    """Splines through amplitudes on `offset_grid`, of offsets (…, 2) in m."""
    along = make_interp_spline(axis, amplitudes.reshape(len(axis), len(axis), -1), k=_DEGREE, axis=0)
    across = make_interp_spline(axis, along.c, k=_DEGREE, axis=1)
    return NdBSpline((along.t, across.t), np.ascontiguousarray(np.moveaxis(across.c, 0, 1)), _DEGREE)


def incident_waves(
    spectra: CoilSpectra, shape: int, offsets: FloatArray, orders: int, motion: Motion = STILL
) -> FloatArray:
    """Harmonics c_m k/2π of one shape of coil about offsets (n, 2) in m.

    The offsets are of the indenter's axis from the coil's centre, as in
    `coilarray.electromagnetics.coil_spectrum.coil_harmonics`, at the dent's position after its `motion`.
    """
    up = motion.lift - offsets @ motion.slope
    waves = coil_harmonics(spectra, shape, offsets + np.array(motion.slope) * motion.pivot, orders - 1)
    waves *= (spectra.wavenumbers / (2 * np.pi))[:, None] * np.exp(-np.outer(spectra.wavenumbers, up))
    return waves
