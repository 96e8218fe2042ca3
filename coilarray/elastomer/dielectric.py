"""Change of the coils' capacitance by a dent, as air replaces a dielectric above them.

Above a measured coil the electric potential is determined by the turns of its uppermost layer. Its Fourier transform
takes the place of the coils' field, permittivities replace permeabilities, and electrodes at z = 0 replace the free
space below. The rest is the magnetic problem of `coilarray.elastomer.scattering`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt
import shapely
from shapely.geometry.polygon import orient

from coilarray.compute.arrays import FloatArray
from coilarray.constants import EPSILON_0
from coilarray.elastomer.dent import STILL, Dent
from coilarray.elastomer.dented_layer import dent_energies
from coilarray.elastomer.scattering import LayerMesh, scatter
from coilarray.electromagnetics.capacitance import closed_band
from coilarray.electromagnetics.coil_spectrum import Segments
from coilarray.errors import ElastomerError
from coilarray.geometry import Array, Coil, Placement, Stackup
from coilarray.geometry.copper import segment_rectangles


def dent_capacitance(
    array: Array,
    dents: Sequence[Dent],
    positions: npt.ArrayLike,
    permittivity: float,
    accuracy: LayerMesh | None = None,
    *,
    zero_at: float = 0.5,
) -> FloatArray:
    """Change of each coil's lumped capacitance by dents, in F.

    The result (dents, positions, coils) is dented minus flat, measured with all other coils at zero. `positions`
    (positions, 2) of the indenter's axis are in m. All sheets have one relative `permittivity`. `zero_at` is the place
    where the winding is at zero potential, as a part of its length from the first terminal: 0.5 for the symmetric drive
    that the network assumes, 0 or 1 for a grounded terminal. A converter that assumes a constant total capacitance C
    sees a relative change ΔC/C of L: less dielectric raises f, as a smaller L does. Raises ElastomerError for a
    permittivity below 1, a zero potential outside the winding, and arguments that `dent_inductance` refuses.

    ½ C V² is the energy with the voltage V from terminal to terminal and linear along the wire. Above the board ΔC = ε0
    Δa(U_f, U_d)/V² with the energies of `coilarray.elastomer.scattering`, all harmonics.

    The potential at z = 0 is assumed to equal `surface_potential` and not to change with the dent. A round coil of two
    layers, solved alone in the true surroundings of its copper, has 0.75 to 0.9 of this in symmetric drive, where the
    layers' potentials are opposite and cancel outside. With a terminal at ground it has 0.3 to 0.7, as then only the
    neighbours hold the outside at zero. The place of the zero matters more. A dent of 1 mm in the gast2020 design
    appears as 1e-7 of L at most in symmetric drive, 1.5e-6 with the upper layer's outer end at the full voltage, 6e-7
    with that end at ground. Either sign is possible: a raised ring in a strong field outweighs the pit.
    """
    if not (np.isfinite(permittivity) and permittivity >= 1):
        raise ElastomerError(f"permittivity must be at least 1; got {permittivity}.")
    mesh = accuracy or LayerMesh()
    electrodes = [surface_potential(placement, array.stackup, zero_at) for placement in array.placements]
    energies = dent_energies(
        [_filled(dent, permittivity) for dent in dents],
        positions,
        electrodes,
        lambda dent, k, weights, deepest: scatter(dent, k, weights, mesh, deepest, "grounded"),
        mesh,
    )
    return EPSILON_0 * np.diagonal(energies.real, axis1=2, axis2=3)


def surface_potential(placement: Placement, stackup: Stackup, zero_at: float = 0.5) -> Segments:
    """Potential of a coil's uppermost copper per terminal voltage.

    The returned outlines, in the plane of the uppermost copper, are weighted with twice the potential inside. Then S of
    `coilarray.electromagnetics.coil_spectrum` is the Fourier transform of the potential. `zero_at` is as in
    `dent_capacitance`, and must be from 0 to 1.

    The voltage falls linearly with the length of the path, over all layers in series. The first terminal has the higher
    potential. Every segment has the potential of its middle, over its length and the width of a pitch, since gaps as
    narrow as the traces take the potential between the potentials of their sides. A hole inside the winding has the
    mean potential of the turn around it. Outside the potential is zero, held by the grounded neighbours and the
    winding's other half. Lower layers are screened by the uppermost layer. A coil that begins deeper in the board
    counts at its own depth, as if no copper lay above it. If grounded coils cover it, the result is too large.
    """
    if not 0 <= zero_at <= 1:
        raise ElastomerError(f"zero_at must be a part of the winding's length from 0 to 1; got {zero_at}.")
    coil = placement.coil
    top = min(placement.layers, key=stackup.index)
    upper = placement.lines_on(top)
    potential, length = (np.concatenate([values[k] for k in upper]) for values in _along(coil, zero_at))
    lines = [placement.to_board(coil.lines[k]) for k in upper]
    ends = np.concatenate([np.stack((line[:-1], line[1:]), axis=1) for line in lines])
    pitch = np.concatenate([coil.widths[k] for k in upper]) + coil.gap
    outlines, potentials = list(segment_rectangles(ends, pitch)), potential.tolist()
    traces = shapely.linestrings(ends)
    for hole in _holes(coil, upper, lines):
        around = shapely.distance(traces, hole) < 0.75 * pitch
        outlines.append(shapely.get_coordinates(hole)[:-1])
        potentials.append(float(np.average(potential[around], weights=length[around])))
    return outlined(outlines, potentials, stackup.span(top)[1])


def outlined(outlines: Sequence[FloatArray], potentials: Sequence[float], z: float = 0.0) -> Segments:
    """Potential in V that is constant in areas of a plane at height `z` in m.

    It has the form of `surface_potential` and is zero outside. Outlines (n, 2) in m are anticlockwise, the first corner
    not repeated. Where areas overlap, potentials add up.
    """
    start = np.concatenate(outlines)
    stop = np.concatenate([np.roll(outline, -1, axis=0) for outline in outlines])
    height = np.full(len(start), z)
    weights = 2 * np.repeat(potentials, [len(outline) for outline in outlines])
    return Segments(np.column_stack((start, height)), np.column_stack((stop, height)), weights)


def _filled(dent: Dent, permittivity: float) -> Dent:
    """Sheets of one permittivity on electrodes, at rest, of which only the top counts."""
    faces = dent.displacement[:, [0, -1]]
    return replace(
        dent,
        thicknesses=(sum(dent.thicknesses),),
        permeabilities=(permittivity,),
        displacement=faces,
        below=permittivity,
        motion=STILL,
    )


def _along(coil: Coil, zero_at: float) -> tuple[list[FloatArray], list[FloatArray]]:
    """Potential per terminal voltage, and length in m, of each line's segments."""
    lengths = [np.hypot(*np.diff(line, axis=0).T) for line in coil.lines]
    starts = [np.sum(np.concatenate([np.zeros(1), *lengths[:k]])) for k in range(len(lengths))]
    whole = np.concatenate(lengths).sum()
    middles = [start + np.cumsum(length) - length / 2 for start, length in zip(starts, lengths, strict=True)]
    return [zero_at - middle / whole for middle in middles], lengths


def _holes(coil: Coil, upper: Sequence[int], lines: Sequence[FloatArray]) -> list[shapely.Polygon]:
    """Areas inside the coil that traces and gaps leave free.

    `lines` are the coil's `upper` lines, here in the frame of the board.
    """
    # joins as sharp as a corner of 23° are kept
    band = closed_band(coil, [(line, coil.widths[k]) for k, line in zip(upper, lines, strict=True)], mitre_limit=5.0)
    return [orient(shapely.Polygon(ring)) for part in shapely.get_parts(band) for ring in part.interiors]
