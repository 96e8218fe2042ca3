"""The response of one coil in the two-dimensional model of Gast and Zimmermann's FEM paper, beside the full one."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import xarray as xr

from coilarray.circuit.coupling import provenance
from coilarray.design.model import Design
from coilarray.elastomer.contact import indent
from coilarray.elastomer.dent import dent_of
from coilarray.elastomer.line_model import cross_section, line_dent_inductance, line_inductance
from coilarray.elastomer.scattering import LayerMesh
from coilarray.errors import ElastomerError
from coilarray.geometry import CylinderEdge, Hemisphere, Paraboloid


def line_response(
    design: Design,
    coil: str | None = None,
    *,
    depths: npt.ArrayLike | None = None,
    x: npt.ArrayLike | None = None,
    mesh: LayerMesh | None = None,
) -> xr.Dataset:
    """Compute δ of one coil with its cross-section as infinite wires and the indenter as an infinite cylinder.

    Parameters
    ----------
    design : Design
        With the tables ``[indenter]`` and ``[indentation]``; a round indenter becomes a cylinder of its radius.
    coil : str, optional
        Name of the coil, cut at its centre along x; the first one by default. Its neighbours are left out.
    depths, x : array_like, shape (n,), optional
        In m; those of the design by default. x counts from the map's origin.
    mesh : LayerMesh, optional
        Accuracy of the magnetic problem.

    Returns
    -------
    xarray.Dataset
        ``delta`` (depth, x) is the change of the inductance per length over it; ``line_inductance`` in H/m under flat
        sheets; ``force`` (depth) in N/m and ``contact_radius`` (depth), half the contact's width, in m.

    Raises
    ------
    ElastomerError
        A design that says nothing of an indentation, a coil that is not there, or an indenter that is not round.

    Notes
    -----
    What the model leaves out: the ends of the coil and of the dent along y. In the full model the dent is a small part
    of the coil, here it is as long as the coil.

    Examples
    --------
    >>> from coilarray import load_design
    >>> line = line_response(load_design("gast_fem"), depths=[1e-3], x=[0.0])
    >>> line.delta.dims
    ('depth', 'x')
    """
    setup = design.indentation
    if setup is None:
        raise ElastomerError(f"the design {design.name} has no [indenter] and [indentation].")
    if not isinstance(setup.indenter, Hemisphere | Paraboloid | CylinderEdge):
        raise ElastomerError(f"the two-dimensional model needs a round indenter; got a {setup.indenter.name}.")
    names = design.array.names
    name = names[0] if coil is None else coil
    if name not in names:
        raise ElastomerError(f"there is no coil {name!r}; there are {', '.join(names)}.")
    depth = np.atleast_1d(np.asarray(setup.depths if depths is None else depths, dtype=np.float64))
    along = np.atleast_1d(np.asarray(setup.x if x is None else x, dtype=np.float64))
    place = design.array.placements[names.index(name)]
    wires = cross_section(design.array.conductors()[names.index(name)], place.y)
    contact = indent(
        design.sheets, CylinderEdge(setup.indenter.radius), depth, base=setup.base, radius=setup.sample_radius
    )
    dents = [dent_of(contact.isel(depth=k), design.sheets) for k in range(len(depth))]
    change = line_dent_inductance(wires, dents, along + setup.origin_point[0], mesh)
    flat = line_inductance(wires, design.sheets)
    return xr.Dataset(
        {
            "delta": (("depth", "x"), change / flat, {"units": "1", "long_name": "relative change of inductance, 2-D"}),
            "line_inductance": ((), flat, {"units": "H/m"}),
            "force": ("depth", contact.force.values, {"units": "N/m"}),
            "contact_radius": ("depth", contact.contact_radius.values, {"units": "m"}),
        },
        coords={"depth": ("depth", depth, {"units": "m"}), "x": ("x", along, {"units": "m"})},
        attrs={**provenance(design), "coil": name, "indenter": "cylinder_edge", "base": setup.base},
    )
