"""Two-dimensional model: infinite wires under a sheet in plane strain.

Gast and Zimmermann's FEM paper simplifies its sensor in this way. All values of the wires are per
metre of length along y.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
import xarray as xr

from coilarray.compute.arrays import ComplexArray, FloatArray
from coilarray.constants import MU_0
from coilarray.design.model import Design, DesignFile, design_of, one_board
from coilarray.elastomer.dent import Dent
from coilarray.elastomer.scattering import LayerMesh, scatter, wavenumber_rule
from coilarray.electromagnetics.flat_stack import reflection
from coilarray.electromagnetics.kernels.sections import pair_logs
from coilarray.errors import ElastomerError, MetalError
from coilarray.geometry import Conductor, CylinderEdge, Hemisphere, Paraboloid, Sheet
from coilarray.response.map import response_dataset
from coilarray.response.setup import contact_at, dents_of, indentation_of, map_axes

_FLAT_DECAYS = 20.0  # wavenumbers up to 20/(2 × distance of wires and sheet), the rest is below 1e-8


@dataclass(frozen=True, eq=False)
class Wires:
    """Infinite wires along y that carry a current both ways, in m.

    `senses` are +1 along y, −1 against it, and add up to zero.
    """

    x: FloatArray
    z: FloatArray
    widths: FloatArray
    thicknesses: FloatArray
    senses: FloatArray


def cross_section(conductor: Conductor, y: float) -> Wires:
    """Cut a path with a plane at `y` in m.

    There is a wire for every crossing, as wide as the trace, not as its oblique cut. A path must
    cross the plane equally often in both directions.
    """
    start, stop = conductor.vertices[:-1], conductor.vertices[1:]
    crosses = (start[:, 1] <= y) != (stop[:, 1] <= y)
    senses = np.sign(stop[crosses, 1] - start[crosses, 1])
    if not len(senses) or senses.sum() != 0:
        raise ElastomerError(
            f"{conductor.name} must cross y = {y:.4g} m as often to as fro; it does so {int((senses > 0).sum())} and "
            f"{int((senses < 0).sum())} times."
        )
    share = (y - start[crosses, 1]) / (stop[crosses, 1] - start[crosses, 1])
    at = start[crosses] + share[:, None] * (stop[crosses] - start[crosses])
    return Wires(at[:, 0], at[:, 2], conductor.widths[crosses], conductor.thicknesses[crosses], senses)


def line_inductance(wires: Wires, sheets: Sequence[Sheet]) -> float:
    """Self-inductance per length of wires at z ≤ 0 under flat sheets, in H/m.

    L' = −μ0/2π Σ s_i s_j mean(ln r_ij), the means over both cross-sections, and from the sheets
    −2μ0/π ∫ k R(k) |S(k)|² dk with their reflection R.
    """
    if not (wires.widths > 0).all():
        raise ElastomerError("the inductance of wires needs their cross-sections; one has none.")
    cells = np.stack((wires.x, wires.z, wires.widths, wires.thicknesses))
    logs = np.empty((cells.shape[1],) * 2)
    pair_logs(np.ascontiguousarray(cells.T), cells, 0.0, 0.0, logs)
    alone = -MU_0 / (2 * np.pi) * float(wires.senses @ logs @ wires.senses)
    magnetic = next((k for k, sheet in enumerate(sheets) if sheet.magnetic), None)
    if magnetic is None:
        return alone
    clearance = sum(sheet.thickness for sheet in sheets[:magnetic]) - float(wires.z.max())
    k, weights = wavenumber_rule(clearance, 2 * float(np.ptp(wires.x)), LayerMesh(decays=_FLAT_DECAYS / 2))
    R = reflection(k, [sheet.thickness for sheet in sheets], [sheet.relative_permeability for sheet in sheets])
    return alone - 2 * MU_0 / np.pi * float(weights @ (k * R * np.abs(_spectrum(wires, k)) ** 2))


def line_dent_inductance(
    wires: Wires, dents: Sequence[Dent], positions: npt.ArrayLike, accuracy: LayerMesh | None = None
) -> FloatArray:
    """Change of inductance per length, (dents, positions) in H/m.

    The dents are in plane strain in the same sheets, the change relative to flat sheets.
    """
    x = np.asarray(positions, dtype=np.float64)
    if x.ndim != 1 or not np.isfinite(x).all():
        raise ElastomerError(f"positions must be finite and of shape (n,); got shape {x.shape}.")
    if any(dent.symmetry != "plane" for dent in dents):
        raise ElastomerError("wires need dents in plane strain; for coils in space there is dent_inductance.")
    mesh = accuracy or LayerMesh()
    change = np.zeros((len(dents), len(x)))
    moving = [index for index, dent in enumerate(dents) if np.isfinite(dent.clearance)]
    if not moving or not len(x):
        return change
    extent = float(np.abs(x[:, None] - wires.x).max()) + max(dents[index].width for index in moving)
    k, weights = wavenumber_rule(min(dents[index].clearance for index in moving), extent, mesh)
    amplitude = _spectrum(wires, k)[:, None] * np.exp(1j * np.outer(k, x)) / np.pi
    # Ψ = ∫ (Re c cos kx − Im c sin kx) g dk/π about the indenter: an even and an odd part
    incident = np.stack((amplitude.real, -amplitude.imag))[:, None]
    deepest = max(float(np.abs(dent.displacement).max()) for dent in dents)
    for index in moving:
        scattering = scatter(dents[index], k, weights, mesh, deepest)
        energy = scattering.energy(scattering.amplitudes(incident), np.arange(len(x))[:, None], np.array([2.0, 2.0]))
        change[index] = MU_0 * energy[:, 0, 0].real
    return change


def _spectrum(wires: Wires, wavenumbers: FloatArray) -> ComplexArray:
    """Spectrum S(k) = i/(2k) Σ s e^{−ikx} e^{kz} of the wires for k > 0, in m per A.

    Ψ = ∫ S e^{ikx} e^{−kz} dk/2π over both signs of k.
    """
    if (wires.z > 0).any():
        raise ElastomerError(f"wires must lie at z <= 0, below the sheets; one is at {wires.z.max():.4g} m.")
    waves = np.exp(np.outer(wavenumbers, wires.z) - 1j * np.outer(wavenumbers, wires.x)) @ wires.senses
    return np.asarray(0.5j / wavenumbers * waves)


def line_response(
    design: Design | DesignFile,
    coil: str | None = None,
    *,
    depths: npt.ArrayLike | None = None,
    x: npt.ArrayLike | None = None,
    accuracy: LayerMesh | None = None,
) -> xr.Dataset:
    """Compute δ of one coil in a two-dimensional model.

    The cross-section of the coil consists of infinite wires, and the indenter, round in the
    `design`, is an infinite cylinder of its radius. The model leaves out the ends of the coil and
    of the dent along y. In the full model the dent is a small part of the coil. Here it is as long
    as the coil.

    The `coil`, by default the first, is cut at its centre along x, and its neighbours are left out.
    `depths` and positions `x` (n,) of the indenter are in m, positions from the map's origin, by
    default as in the design. `accuracy` is the mesh of the magnetic problem. Raises ElastomerError
    for a design without indentation, an unknown coil, an indenter that is not round, or a
    rectangular sample, and MetalError for a design with plates.

    The result is a response as of `coilarray.response.map.response_map` for one state, named after
    the coil, and at one position along y, the coil's centre. ``delta`` is the change of the
    inductance per length divided by that inductance. ``base_inductance`` and ``inductance`` are in
    H/m, ``force`` is in N/m, and ``contact_radius`` is half the width of the contact in m.
    """
    design = one_board(design_of(design), "the two-dimensional model")
    setup = indentation_of(design)
    if not isinstance(setup.indenter, Hemisphere | Paraboloid | CylinderEdge):
        raise ElastomerError(f"the two-dimensional model needs a round indenter; got a {setup.indenter.name}.")
    if setup.sample_bounds is not None:
        raise ElastomerError(
            f"the two-dimensional model does not include the sides of a sample; {design.name} has sample_x_mm."
        )
    if design.plates:
        raise MetalError(
            f"the two-dimensional model does not include plates; {design.name} has {design.plates[0].name!r}."
        )
    names = design.array.names
    name = names[0] if coil is None else coil
    if name not in names:
        raise ElastomerError(f"there is no coil {name!r}; there are {', '.join(names)}.")
    place = design.array.placements[names.index(name)]
    axes = map_axes(design, depths, x, [place.y - setup.origin_point[1]])
    wires = cross_section(design.array.conductors()[names.index(name)], place.y)
    cylinder = replace(setup, indenter=CylinderEdge(setup.indenter.radius))
    contact = contact_at(cylinder, design.sheets, axes.depth)
    dents = dents_of(contact, design.sheets)
    change = line_dent_inductance(wires, dents, axes.x + setup.origin_point[0], accuracy)
    flat = line_inductance(wires, design.sheets)
    return response_dataset(
        design,
        axes,
        contact,
        change / flat,
        np.array([flat]),
        np.array([[flat]]),
        coils=[name],
        states=[name],
        per_length=True,
        attributes={"coil": name, "indenter": "cylinder_edge", "error_of_peak": 0.0},
    )
