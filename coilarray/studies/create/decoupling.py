"""Pitch at which overlapping neighbours do not couple."""

from __future__ import annotations

import functools
from collections.abc import Callable
from itertools import pairwise

import numpy as np
from scipy.optimize import brentq

from coilarray.circuit.coupling import design_inductance
from coilarray.compute.arrays import FloatArray, IntArray
from coilarray.design.model import Design
from coilarray.electromagnetics.inductance import coupling_matrix, pair_inductance
from coilarray.errors import DesignError
from coilarray.geometry import CoilArray

# fractions of the width of a coil between which the sign of its neighbours' coupling is searched
_SAMPLES = (1.0, 0.8, 0.65, 0.5, 0.4)
_PITCH_STEP = 1e-5  # m, to which a pitch is given
_ROUGHLY = 2e-3  # of the width: accuracy of the search in the rough model, which the corrections improve
_SLOPE, _CORRECTIONS = 0.01, 2


def decoupled_pitch(width: float, design_at: Callable[[float], Design], rough_at: Callable[[float], Design]) -> float:
    """Find the pitch of zero neighbour coupling.

    The coupling is the mean of all neighbours. The fields inside and around a coil have opposite signs. Neighbours that
    overlap more than at this pitch couple positively, and others negatively. Neighbours on different pairs of layers
    differ slightly, so their mean is brought to zero.

    Parameters
    ----------
    width : float
        Width of a coil in m.
    design_at : callable
        Function that returns the design of some neighbouring coils for a pitch in m.
    rough_at : callable
        Function that returns a quicker model of it, in which the pitch is searched first.

    Returns
    -------
    float
        Pitch in m, rounded to 10 µm. Of several pitches it is the largest.

    Raises
    ------
    DesignError
        If there is no such pitch between 0.4 and 1 widths.
    """

    @functools.cache
    def rough(pitch: float) -> float:
        array = rough_at(pitch).array
        return float(pair_inductance(array, *_neighbours(array), accuracy="screen").mean())

    for outer, inner in pairwise(part * width for part in _SAMPLES):
        if rough(inner) >= 0:  # side by side they couple negatively
            if rough(outer) > 0:
                continue
            found = float(brentq(rough, inner, outer, xtol=_ROUGHLY * width))
            slope = (rough(found + _SLOPE * width) - rough(found)) / (_SLOPE * width)
            for _ in range(_CORRECTIONS):  # for effects that the rough model leaves out
                design = design_at(found)
                L = design_inductance(design, accuracy="screen")[0]
                found -= float(neighbour_coupling(design).mean() * L.diagonal().mean()) / slope
            if inner - _SLOPE * width <= found <= outer + _SLOPE * width:
                return round(found / _PITCH_STEP) * _PITCH_STEP
    raise DesignError(
        f"neighbours of {width * 1e3:g} mm couple at every pitch from {_SAMPLES[-1] * width * 1e3:.4g} to "
        f"{_SAMPLES[0] * width * 1e3:.4g} mm: their overlap cannot decouple them."
    )


def neighbour_coupling(design: Design) -> FloatArray:
    """Coupling coefficients of all nearest coils.

    The coils lie under the flat sheets.
    """
    k: FloatArray = coupling_matrix(design_inductance(design, accuracy="screen")[0])[_neighbours(design.array)]
    return k


def _neighbours(array: CoilArray) -> tuple[IntArray, IntArray]:
    """Numbers of both coils of every nearest pair."""
    i, j = np.array(array.neighbours, dtype=np.intp).reshape(-1, 2).T
    return i, j
