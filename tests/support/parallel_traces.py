"""Losses and capacitance of parallel traces, by the product's kernels, for comparison with the references."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from coilarray.compute.threads import serial_algebra
from coilarray.constants import RESISTIVITY_COPPER
from coilarray.electromagnetics import resistance
from coilarray.electromagnetics.layered_strips import LayeredMedium, strip_capacitance
from coilarray.electromagnetics.resistance import skin_depth


@dataclass(frozen=True, eq=False)
class TraceLosses:
    """Heat of each trace over that at DC, and Re(U/I)/R_dc of each with what its neighbours induce in it."""

    loss_ratio: np.ndarray
    resistance_ratio: np.ndarray


@serial_algebra()
def parallel_traces(widths, thicknesses, x, z, currents, frequency, resistivity=RESISTIVITY_COPPER):
    """Losses of parallel, infinitely long rectangular traces that carry given currents in phase or in antiphase."""
    given = (widths, thicknesses, x, z, currents)
    w, t, across, up, current = np.broadcast_arrays(*(np.atleast_1d(np.asarray(v, dtype=np.float64)) for v in given))
    delta = skin_depth(frequency, resistivity)
    side = float(max(w.max(), t.max()))
    octaves = max(2, math.ceil(math.log2(side / delta)))
    bundle = resistance._section(tuple(zip(*(v.tolist() for v in (across, up, w, t)), strict=True)), octaves)
    beta = np.atleast_1d((bundle.unit / delta) ** 2 / np.pi)
    density = current / np.sqrt(bundle.areas)
    source = (bundle.own @ density)[:, None]
    induced = (1j * beta[0] * (bundle.own.T @ bundle.answer(source, beta)[0, :, 0])).real
    return TraceLosses(1.0 + bundle.losses(source, beta)[0, :, 0] / density**2, 1.0 + induced / density)


def interlayer_capacitance(width, gap, height, epsilon_r, thickness=0.0, *, offset=0.0, basis=3):
    """Capacitance in F/m between a trace and those of the other layer, two equal periodic arrays facing each other."""
    if thickness == 0:
        medium = LayeredMedium((height,), (1.0, epsilon_r, 1.0))
        conductors = [0, 1]
    else:
        medium = LayeredMedium((thickness, height, thickness), (1.0, 1.0, epsilon_r, 1.0, 1.0))
        conductors = [0, 0, 1, 1]
    n = len(conductors)
    C = strip_capacitance(
        medium, range(n), offset * np.array(conductors), np.full(n, width), conductors, period=width + gap, basis=basis
    )
    return float(-C[0, 1])
