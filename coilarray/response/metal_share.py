"""Share of an indenter's material in a response.

It comes from eddy currents and magnetisation of a ball over or in the dent.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from coilarray.compute.arrays import ComplexArray, FloatArray
from coilarray.elastomer.scattering import LayerMesh
from coilarray.electromagnetics.source import Source
from coilarray.errors import ElastomerError, MetalError
from coilarray.geometry import Ball
from coilarray.metal.backing import backings_of, outlined_below
from coilarray.metal.indenter import indenter_inductance
from coilarray.response.setup import Experiment, MapAxes

Variable = tuple[tuple[str, ...], FloatArray, Mapping[str, str]]
"""Variable of a dataset: dimensions, values and attributes."""


def check_metal(axes: MapAxes, ball: Ball | None, rest: float) -> None:
    """Refuse invalid rests and depths of a metal indenter.

    A rest must not lie below the sheets. Only an indenter of metal may have depths below 0.
    """
    if not rest >= 0:
        raise MetalError(f"rest must be at least 0; got {rest} m.")
    if ball is None and axes.depth[0] < 0:
        raise ElastomerError(
            "depth of an indentation must be at least 0 unless the indenter has a material; got "
            f"{axes.depth[0] * 1e3:.4g} mm."
        )


def metal_share(
    pressed: Experiment, source: Source, ball: Ball, frequency: float, rest: float, mesh: LayerMesh
) -> ComplexArray:
    """Share of the indenter's material in the changes in H.

    It has shape (depths, places, coils, coils) and is relative to the indenter at rest. The dents are for wide sheets.
    The contribution of a finite sample to them is left out, and its effect on the share is not known.
    """
    total: ComplexArray | float = 0.0
    plates, sheets = pressed.design.plates, pressed.design.sheets
    outlined = outlined_below(source, plates, [frequency], sheets)
    backing = next(iter(backings_of(source, plates, [frequency], sheets, outlined=outlined)), None)
    for level in (level for level in pressed.levels if not level.coarse):
        first = level.dents[0]
        flat = replace(first, displacement=np.zeros_like(first.displacement))
        found = indenter_inductance(
            source, ball, [*level.dents, flat], pressed.points, frequency, [*pressed.above.tolist(), rest], backing,
            outlined, mesh=mesh,
        )  # fmt: skip
        parts = found[:-1] - found[-1]
        total = total + np.einsum("dp,dpij->dpij", level.shares, parts)
    return np.asarray(total)


def metal_variables(axes: MapAxes, delta: FloatArray, share: ComplexArray, frequency: float) -> dict[str, Variable]:
    """Return the variables of the material's share."""
    matrix = ("depth", "y", "x", "coil", "other")
    values = share.reshape(*axes.shape, *share.shape[2:])
    loss = -2 * np.pi * frequency * values.imag
    return {
        "metal_delta": (
            ("depth", "y", "x", "state"), delta.reshape(*axes.shape, -1),
            {"units": "1", "long_name": "share of the indenter's material in delta"},
        ),
        "metal_inductance_change": (
            matrix, values.real, {"units": "H", "long_name": "share of the indenter's material"}
        ),
        "metal_resistance_change": (matrix, loss, {"units": "ohm", "long_name": "eddy-current loss in the indenter"}),
    }  # fmt: skip


def metal_attributes(ball: Ball, frequency: float, rest: float) -> dict[str, object]:
    """Return the attributes of a share.

    They are its frequency, the indenter's material, and `rest` in m.
    """
    return {"metal_frequency_Hz": frequency, "rest_m": rest, "indenter_material": ball.material.name}
