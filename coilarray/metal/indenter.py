"""What an indenter of metal or ferrite does to the coils besides its dent: a ball over the sheets, or in the dent."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from coilarray.compute.threads import Progress
from coilarray.elastomer.dent import Dent
from coilarray.electromagnetics.source import Source, as_conductors
from coilarray.geometry import Ball, Sheet
from coilarray.metal.ball import ball_inductance

FloatArray = npt.NDArray[np.float64]
ComplexArray = npt.NDArray[np.complex128]


def indenter_inductance(
    source: Source,
    ball: Ball,
    dent: Dent,
    places: FloatArray,
    frequency: float,
    distance: float = 0.0,
    *,
    progress: Progress | None = None,
) -> ComplexArray:
    """Change of the impedance matrix by a ball in its dent, or over sheets that it does not touch, as an inductance.

    Parameters
    ----------
    source : CoilArray, Conductor, polyline or sequence of them
        Coils at z ≤ 0.
    ball : Ball
        The indenter.
    dent : Dent
        Sheets as the ball dents them.
    places : ndarray, shape (places, 2)
        Positions of its axis in m.
    frequency : float
        Frequency in Hz.
    distance : float
        Height in m of its lowest point over sheets that are not dented; inf for none of it.
    progress : callable, optional
        Called with (done, total) as the work goes on.

    Returns
    -------
    ndarray, shape (places, coils, coils)
        ΔL − jΔR/ω in H against the dented sheets without the ball.
    """
    if math.isinf(distance):
        return np.zeros((len(places), *(len(as_conductors(source)),) * 2), dtype=np.complex128)
    faces = dent.heights + dent.displacement[0]
    faces[0] = 0.0  # a seat that gives leaves the coils where they are
    sheets = [
        Sheet(f"sheet {k + 1}", float(thickness), mu)
        for k, (thickness, mu) in enumerate(zip(np.diff(faces), dent.permeabilities, strict=True))
    ]
    height = float(faces[-1]) + distance + ball.radius
    centres = np.column_stack((places, np.full(len(places), height)))
    return ball_inductance(source, ball, centres, [frequency], sheets, progress=progress)[:, 0]
