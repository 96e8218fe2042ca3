"""What an indenter of metal or ferrite does to the coils besides its dent: a ball over the sheets, or in the dent."""

from __future__ import annotations

import math

import numpy as np

from coilarray.compute.arrays import ComplexArray, FloatArray
from coilarray.compute.threads import Progress
from coilarray.elastomer.dent import Dent
from coilarray.elastomer.dent_sphere import sphere_in_dent
from coilarray.elastomer.scattering import LayerMesh
from coilarray.electromagnetics.source import Source, as_conductors
from coilarray.geometry import Ball, Sheet
from coilarray.metal.ball import Multipoles, answer_of, ball_inductance, multipole_inductance


def indenter_inductance(
    source: Source,
    ball: Ball,
    dent: Dent,
    places: FloatArray,
    frequency: float,
    distance: float = 0.0,
    *,
    mesh: LayerMesh | None = None,
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
    mesh : LayerMesh, optional
        Accuracy of the dented sheets.
    progress : callable, optional
        Called with (done, total) as the work goes on.

    Returns
    -------
    ndarray, shape (places, coils, coils)
        ΔL − jΔR/ω in H against the dented sheets without the ball.

    Raises
    ------
    MetalError, MemoryLimitError
        As `coilarray.metal.ball.ball_inductance`.

    Notes
    -----
    In its dent the ball is solved together with the dented sheets (`coilarray.elastomer.dent_sphere`), within 0.5 % of
    finite elements at 1 mm in the sheets of gast2020 (tests/metal/test_indenter.py). Measured: flat sheets as thick as
    they are under the tip would make the effect of aluminium 9 % too large and that of ferrite 0.5 to 2 % too small at
    0.5 mm; those of a tip that just touches would be 8 to 25 % too small.
    """
    if math.isinf(distance):
        return np.zeros((len(places), *(len(as_conductors(source)),) * 2), dtype=np.complex128)
    height = float(dent.heights[-1] + dent.displacement[0, -1]) + distance + ball.radius
    centres = np.column_stack((places, np.full(len(places), height)))
    if not np.isfinite(dent.clearance):  # the magnetic faces are flat
        sheets = [
            Sheet(f"sheet {k + 1}", thickness, mu)
            for k, (thickness, mu) in enumerate(zip(dent.thicknesses, dent.permeabilities, strict=True))
        ]
        return ball_inductance(source, ball, centres, [frequency], sheets, progress=progress)[:, 0]

    def answer(height: float, wavenumbers: FloatArray, alpha: ComplexArray) -> Multipoles:
        orders = alpha.shape[1]
        seen = sphere_in_dent(dent, ball.radius, height, wavenumbers, orders, mesh or LayerMesh())
        fields, answers = [], []
        for field, returned in zip(seen.fields, seen.returned, strict=True):
            order = np.arange(orders - len(field) + 1, orders + 1)
            scale = np.sqrt(order + 0.5)
            fields.append(scale[:, None] * field)
            answers.append(answer_of(alpha[:, order[0] - 1 :], 2 * ball.radius * np.outer(scale, scale) * returned))
        return Multipoles(fields, answers)

    return multipole_inductance(source, ball, centres, [frequency], answer, progress=progress)[:, 0]
