"""Two-dimensional response of a coil (Gast and Zimmermann's FEM paper)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt
import xarray as xr

from coilarray.design.model import Design, DesignFile, design_of
from coilarray.elastomer.line_model import cross_section, line_dent_inductance, line_inductance
from coilarray.elastomer.scattering import LayerMesh
from coilarray.errors import ElastomerError, MetalError
from coilarray.geometry import CylinderEdge, Hemisphere, Paraboloid
from coilarray.response.map import response_dataset
from coilarray.response.setup import contact_at, dents_of, indentation_of, map_axes


def line_response(
    design: Design | DesignFile,
    coil: str | None = None,
    *,
    depths: npt.ArrayLike | None = None,
    x: npt.ArrayLike | None = None,
    accuracy: LayerMesh | None = None,
) -> xr.Dataset:
    """Compute δ of one coil in a two-dimensional model.

    The cross-section of the coil consists of infinite wires, and the indenter is an infinite
    cylinder. Raises ElastomerError for a design without indentation, an unknown coil, an indenter
    that is not round, or a rectangular sample. Raises MetalError for a design with plates.

    Parameters
    ----------
    design : Design or DesignFile
        Design with an indentation. Its round indenter becomes a cylinder of the same radius.
    coil : str, optional
        Name of the coil, cut at its centre along x. The first coil by default. Its neighbours are
        left out.
    depths, x : array_like, shape (n,), optional
        Depths and positions along x of the indenter in m, positions from the map's origin. By
        default as in the design.
    accuracy : LayerMesh, optional
        Accuracy of the magnetic problem.

    Returns
    -------
    xarray.Dataset
        Response as of `coilarray.response.map.response_map` for one state, named after the coil,
        and at one position along y, the coil's centre. ``delta`` is the change of the inductance
        per length divided by that inductance. ``base_inductance`` and ``inductance`` are in H/m,
        ``force`` is in N/m, and ``contact_radius`` is half the width of the contact in m.

    Notes
    -----
    The model leaves out the ends of the coil and of the dent along y. In the full model the dent is
    a small part of the coil. Here it is as long as the coil.
    """
    design = design_of(design)
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
        design, axes, contact, change / flat, np.array([flat]), np.array([[flat]]),
        coils=[name], states=[name], per_length=True,
        attributes={"coil": name, "indenter": "cylinder_edge", "error_of_peak": 0.0},
    )  # fmt: skip
