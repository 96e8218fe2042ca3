"""Response maps on coarse meshes, the same on both sides of a comparison; and the first coils of gast2020 alone."""

from contextlib import contextmanager
from dataclasses import replace

import pytest

import coilarray.elastomer.dented_layer as dented_layer
import coilarray.response.map as response_map
import coilarray.response.setup as setup
from coilarray.design.bundled import read
from coilarray.design.model import parse_design
from coilarray.elastomer.contact_mesh import ContactMesh
from coilarray.elastomer.scattering import LayerMesh

COARSE = ContactMesh(8, 1.8)
"""Good to 1 %."""
MESH = LayerMesh(harmonics=6, width=0.5, rows=3)
"""Good to 1 % of δ."""


@contextmanager
def contacts_of(mesh):
    """Solve the contacts of response maps on another mesh."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(setup, "DEFAULT_MESH", mesh)
        yield


@contextmanager
def coarse_maps(contact=COARSE):
    """Compute response maps on coarse meshes where none is asked for."""
    with contacts_of(contact), pytest.MonkeyPatch.context() as patch:
        for module in (dented_layer, response_map):
            patch.setattr(module, "LayerMesh", lambda: MESH)
        yield


def linear(design):
    """Return a design that is pressed with small strain: its contacts are quick."""
    return replace(design, indentation=replace(design.indentation, strain="linear"))


def first_coils(count):
    """Text of gast2020 with so many coils, pressed with small strain."""
    text = read("gast2020").replace("columns = 6", f"columns = {count}")
    return text.replace("[indentation]", '[indentation]\nstrain = "linear"')


def first_coils_design(count):
    return parse_design(first_coils(count))
