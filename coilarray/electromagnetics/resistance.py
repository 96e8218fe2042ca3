"""Resistance of current paths."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from coilarray.constants import RESISTIVITY_COPPER
from coilarray.electromagnetics.source import Source, as_conductors
from coilarray.errors import GeometryError, require_positive


def dc_resistance(source: Source, resistivity: float = RESISTIVITY_COPPER) -> npt.NDArray[np.float64]:
    """Compute the direct-current resistance of every path in Ω.

    Parameters
    ----------
    source : CoilArray, Conductor, polyline or sequence of them
        Current paths. Every segment needs a conducting cross-section.
    resistivity : float
        Resistivity in Ω·m. By default copper at 20 °C.

    Returns
    -------
    ndarray, shape (paths,)
        Resistances in Ω: ρ Σ length/area over the segments from vertex to vertex. Corners count by the centre line.

    Raises
    ------
    GeometryError
        A segment without a cross-section, or a resistivity that is not positive and finite.

    Examples
    --------
    >>> from coilarray.geometry import Conductor
    >>> dc_resistance(Conductor([[0, 0, 0], [1, 0, 0]], 1e-3, 17.24e-6))
    array([1.])
    """
    require_positive("resistivity", resistivity, " Ω·m")
    conductors = as_conductors(source)
    for conductor in conductors:
        if not (conductor.areas > 0).all():
            raise GeometryError(f"{conductor.name} has segments without a cross-section; give widths and thicknesses.")
    return np.array([resistivity * float((c.lengths / c.areas).sum()) for c in conductors])
