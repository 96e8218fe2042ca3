"""Coupling as arcs between coils, and the currents that one coil drives in the others as the colour of their copper."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from coilarray.viz.datasets.coupling import COUPLING, arc_tubes, coupling_arcs
from coilarray.viz.palette import ORANGE
from coilarray.viz.scenes.board import CoilColours
from coilarray.viz.scenes.scene import Part, Scene, Text, symmetric

if TYPE_CHECKING:
    import xarray as xr

CURRENT = "current in phase (A/A)"
"""Name of the cell array of currents, per ampere of the measured coil."""

_LEAST = 0.03  # of the largest |k|: thinner arcs are not seen
_LABELLED = 0.1  # of the largest |k|
_WIDEST = 0.03  # radius of the widest arc over the distance of the nearest coils


def scene_of_coupling(coupling: xr.Dataset) -> Scene:
    """Return arcs between all pairs of coils, as thick as |k| is large and coloured by k, the strong ones with numbers.

    Parameters
    ----------
    coupling : xarray.Dataset
        As `coilarray.circuit.coupling.couple_design` returns it: ``coupling`` (coil, other) and the centres ``x``,
        ``y`` in m.
    """
    centres = np.column_stack((coupling.x.values, coupling.y.values))
    k = coupling.coupling.values
    pairs = np.abs(k[~np.eye(len(k), dtype=bool)])
    if not pairs.size or pairs.max() == 0:
        return Scene(notes=("There is one coil, which couples with none.",) if not pairs.size else ())
    strongest = float(pairs.max())
    arcs = coupling_arcs(centres, k, least=_LEAST * strongest)
    distances = np.linalg.norm(centres[:, None] - centres, axis=-1)
    nearest = float(distances[~np.eye(len(k), dtype=bool)].min()) * 1e3
    tubes = arc_tubes(arcs, _WIDEST * nearest)
    scale = symmetric(COUPLING, "coupling k", "", pairs)
    texts = []
    for n, value in enumerate(arcs.cell_data[COUPLING].tolist()):
        if abs(value) >= _LABELLED * strongest:
            x, y, z = np.asarray(arcs.get_cell(n).points)[len(arcs.get_cell(n).points) // 2].tolist()
            texts.append(Text(f"{value:+.3f}".replace("-", "−"), (x, y, z + 0.2 * nearest), 16.0, group="coupling"))
    left_out = arcs.n_lines < len(k) * (len(k) - 1) // 2
    notes = (f"Arcs: coupling k; between ±{_LEAST * strongest:.1g} it is left out.",) if left_out else ()
    colour = scale.typical_colour(arcs.cell_data[COUPLING])
    part = Part("coupling", tubes, "coupling", colour, scale, ambient=0.35, diffuse=0.7)
    return Scene((part,), tuple(texts), notes)


def colours_of_currents(currents: npt.ArrayLike, active: int) -> CoilColours:
    """Colour the passive coils by the part of their current that is in phase with that of the measured coil.

    Parameters
    ----------
    currents : array_like of complex, shape (coils,)
        In A per A of the measured coil.
    active : int
        Index of the measured coil; its colour is orange.

    Returns
    -------
    CoilColours
    """
    values = np.asarray(currents, dtype=np.complex128).real.copy()
    values[active] = np.nan
    scale = symmetric(CURRENT, "current in phase", "A/A", values)
    return CoilColours(values, replace(scale, missing=ORANGE))
