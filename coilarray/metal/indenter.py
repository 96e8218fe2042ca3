"""Effect of a metal or ferrite ball on the coils, in a dent or over the sheets."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from coilarray.compute.arrays import ComplexArray, FloatArray, IntArray
from coilarray.compute.threads import Progress
from coilarray.elastomer.dent import Dent
from coilarray.elastomer.dent_sphere import sphere_in_dent
from coilarray.elastomer.scattering import LayerMesh
from coilarray.electromagnetics.flat_stack import Backing
from coilarray.electromagnetics.source import Source, as_conductors
from coilarray.geometry import Ball, Sheet
from coilarray.metal.ball import (
    Multipoles,
    answer_of,
    ball_over,
    multipole_inductance,
    returned_dipoles,
    with_mirrored,
)
from coilarray.metal.finite_plates import OutlinedPlates


def indenter_inductance(
    source: Source,
    ball: Ball,
    dents: Sequence[Dent],
    places: FloatArray,
    frequency: float,
    distances: Sequence[float] | None = None,
    backing: Backing | None = None,
    outlined: OutlinedPlates | None = None,
    *,
    mesh: LayerMesh | None = None,
    progress: Progress | None = None,
) -> ComplexArray:
    """Change of the impedance matrix by a ball in its dents, in H.

    The ball may also be over sheets that it does not touch. The result (dents, places, coils, coils) is ΔL − jΔR/ω
    relative to the dented sheets without the ball. The `dents` are of the same sheets, for example one for each depth.
    The `places` (places, 2) of the ball's axis are in m. `distances` are heights in m of its lowest point over the
    sheets of each dent, above zero if they are not dented, inf without the ball. `backing` has plates below the coils
    at this frequency in Hz, and `outlined` the finite plates there, which also reflect the field of the ball's dipole.
    Errors are those of `coilarray.metal.ball.ball_inductance`.

    In its dent the ball is solved together with the dented sheets (`coilarray.elastomer.dent_sphere`). This agrees
    within 0.5 % with finite elements at 1 mm in the sheets of gast2020. In that case flat sheets as thick as under the
    tip would make the effect of aluminium 9 % too large and the effect of ferrite 0.5 to 2 % too small at 0.5 mm.
    Sheets that the tip just touches would make them 8 to 25 % too small.

    Over a backing the reflected field of the coils is included completely. The reflected field of ball and dent is left
    out, except for a ball over flat sheets and layers. The reflection of the ball's dipole by finite plates is
    included, as if the sheets were flat.
    """
    coils = len(as_conductors(source))
    change = np.zeros((len(dents), len(places), coils, coils), dtype=np.complex128)
    lowest = np.array([dent.heights[-1] + dent.displacement[0, -1] for dent in dents])
    heights = lowest + (0.0 if distances is None else np.array(distances)) + ball.radius
    level = np.array([not np.isfinite(dent.clearance) for dent in dents])  # the magnetic faces are flat
    flat, pressed = (np.flatnonzero(np.isfinite(heights) & kind) for kind in (level, ~level))

    def centres(numbers: IntArray) -> FloatArray:
        return np.column_stack((np.tile(places, (len(numbers), 1)), np.repeat(heights[numbers], len(places))))

    def returned(at: FloatArray, dent: Dent) -> ComplexArray | None:
        return None if outlined is None else returned_dipoles(outlined, ball, at, _flat_sheets(dent))

    if len(flat):
        first = dents[flat[0]]
        sheets = _flat_sheets(first)
        at, f = centres(flat), np.array([frequency])
        found = ball_over(source, ball, at, f, sheets, backing, returned(at, first), progress=progress)
        change[flat] = found.reshape(len(flat), *change.shape[1:])

    def answer(height: float, wavenumbers: FloatArray, alpha: ComplexArray) -> Multipoles:
        """Multipoles of the ball in the nearest dent."""
        dent, orders = dents[pressed[np.abs(heights[pressed] - height).argmin()]], alpha.shape[1]
        seen = sphere_in_dent(dent, ball.radius, height, wavenumbers, orders, mesh or LayerMesh())
        fields, answers = [], []
        for field, returned in zip(seen.fields, seen.returned, strict=True):
            order = np.arange(orders - len(field) + 1, orders + 1)
            scale = np.sqrt(order + 0.5)
            scaled = scale[:, None] * field
            fields.append(with_mirrored(scaled, backing, wavenumbers, dent.thicknesses, dent.permeabilities))
            answers.append(answer_of(alpha[:, order[0] - 1 :], 2 * ball.radius * np.outer(scale, scale) * returned))
        return Multipoles(fields, answers)

    if len(pressed):
        at = centres(pressed)
        back = returned(at, dents[pressed[0]])
        found = multipole_inductance(source, ball, at, [frequency], answer, backing, back, progress=progress)
        change[pressed] = found.reshape(len(pressed), *change.shape[1:])
    return change


def _flat_sheets(dent: Dent) -> list[Sheet]:
    """Return the sheets of a dent in their flat state."""
    return [
        Sheet(f"sheet {k + 1}", thickness, mu)
        for k, (thickness, mu) in enumerate(zip(dent.thicknesses, dent.permeabilities, strict=True))
    ]
