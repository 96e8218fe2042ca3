"""Response maps on coarse meshes, the same on both sides of a comparison; and the first coils of gast2020 alone."""

from contextlib import contextmanager
from dataclasses import replace

import pytest

import coilarray.elastomer.dented_layer as dented_layer
import coilarray.response.map as response_map
import coilarray.response.setup as setup
from coilarray.design.bundled import read
from coilarray.design.model import load_design_file, parse_design
from coilarray.elastomer.contact_grid import ContactMesh
from coilarray.elastomer.scattering import LayerMesh

COARSE = ContactMesh(8, 1.8)
"""Good to 1 %."""
MESH = LayerMesh(harmonics=6, width=0.5, rows=3)
"""Good to 1 % of δ."""
QUICK = response_map.MapAccuracy(mesh=MESH)
"""The same for a map."""
IDEAL = setup.Imperfections(network="ideal")
"""A circuit that takes no seconds to make."""


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


def few_turns(name):
    """Text of a bundled design of ten turns a layer, as wide as its own: what is computed goes with their square."""
    turns, trace, gap = (
        load_design_file(name).values[f"coils.hexagon.{key}"] for key in ("turns_per_layer", "trace_width_mm", "gap_mm")
    )
    text = read(name).replace(f"turns_per_layer = {turns:g}", "turns_per_layer = 10")
    return text.replace(f"\ngap_mm = {gap:g}", f"\ngap_mm = {turns / 10 * (trace + gap) - trace:g}")


def first_coils(count):
    """Text of gast2020 with so many coils of few turns, pressed with small strain; a single one is the origin."""
    text = (
        few_turns("gast2020").replace("columns = 6", f"columns = {count}").replace('"coil2"', f'"coil{min(count, 2)}"')
    )
    return text.replace("[indentation]", '[indentation]\nstrain = "linear"')


def first_coils_design(count):
    return parse_design(first_coils(count))
