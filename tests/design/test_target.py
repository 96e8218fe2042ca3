"""A target in design files: read, written, varied and counted in the digest; one clear line for what cannot be."""

from dataclasses import replace

import numpy as np
import pytest
from support.refusals import refused

import coilarray as ca
from coilarray.design.bundled import read
from coilarray.design.model import build_design
from coilarray.errors import DesignError, GeometryError

MOVED = "distances_mm = [0.5, 1, 2.5]\n"
DISC = f'[target]\nshape = "disc"\ndiameter_mm = 20\nthickness_mm = 1\nmaterial = "aluminium"\n{MOVED}'
SPHERE = (
    f'[target]\nshape = "sphere"\ndiameter_mm = 5\nconductivity_MS_per_m = 3.3\nrelative_permeability = 20\n{MOVED}'
)
PLATE = f'[target]\nshape = "plate"\nthickness_mm = 1\nmaterial = "brass"\n{MOVED}'
POLYGON = (
    '[target]\nshape = "polygon"\ncorners_mm = [[0, 0], [10, 0], [0, 5]]\nholes_mm = [[[1, 1], [3, 1], [1, 2]]]\n'
    f'thickness_mm = 0.5\nmaterial = "copper"\nx_mm = [-5, 5]\ny_mm = [0, 0]\nstep_mm = 1\norigin = "coil1"\n{MOVED}'
)


def design_with(table, more=""):
    return ca.parse_design(read("gast_fem").replace("[field]", f"{table}\n{more}\n[field]"))


def test_heights_are_those_of_the_nearest_point_above_the_sheets():
    top = 8e-3
    for table, height in (
        (PLATE, top + 1e-3),  # its lower face
        (DISC, top + 1.5e-3),
        (SPHERE, top + 3.5e-3),
        (DISC + "tilt_deg = 30\ntilt_direction_deg = 90\n", top + 1e-3 + 5e-3 + 0.5e-3 * np.cos(np.pi / 6)),
    ):
        design = design_with(table)
        # a disc is a polygon of the same area, whose corners lie a little farther out
        assert design.target.height(design.top, 1e-3) == pytest.approx(height, abs=5e-6)


def test_places_follow_from_the_array_where_none_are_given():
    assert design_with(DISC).target.x == design_with(SPHERE).target.x
    assert (design_with(PLATE).target.x, design_with(PLATE).target.y) == ((0.0,), (0.0,))
    on_coil = design_with(POLYGON).target
    assert (len(on_coil.x), len(on_coil.y), on_coil.origin_point) == (11, 1, (0.0, 0.0))
    wider = ca.vary(design_with(DISC), {"array.placements.0.x_mm": 10})
    assert np.mean(wider.target.x) == pytest.approx(10e-3, abs=1e-3)


@pytest.mark.parametrize("table", [DISC, SPHERE, PLATE, POLYGON])
def test_a_design_with_a_target_is_that_of_its_document(table):
    design = design_with(table)
    assert build_design(ca.design_document(design)).digest == design.digest
    others = [ca.vary(design, {"target.distances_mm": [1, 2]}), replace(design, target=None)]
    others.append(replace(design, target=replace(design.target, distances=(0.5e-3, 1e-3, 2.6e-3))))
    assert len({design.digest, *(other.digest for other in others)}) == 4


def test_what_cannot_be_is_refused_in_one_line():
    for table, line in (
        (DISC.replace('"disc"', '"cube"'), "target.shape must be 'plate', 'disc', 'rectangle', 'ring', 'polygon' or"),
        (PLATE + "origin_mm = [1, 1]\n", 'target has no origin_mm for shape = "plate", which is an infinite plate'),
        (DISC.replace("diameter_mm = 20\n", ""), 'target needs diameter_mm for shape = "disc"'),
        (DISC + "x_mm = [0, 5]\n", "target needs x_mm, y_mm and step_mm, or x_pos"),
        (DISC.replace("[0.5, 1, 2.5]", "[1, 0.5]"), "target needs distances_mm that rise from each to the next"),
        (DISC + 'origin = "coil9"\n', "target.origin names no coil; there are coil1; got 'coil9'"),
        (DISC + "step_mm = 0.01\n", "target.step_mm of 0.01 gives more than 100000 positions over all coils"),
        (SPHERE.replace("conductivity_MS_per_m = 3.3\nrelative_permeability = 20\n", ""), "target needs a material"),
    ):
        refused(DesignError, line, design_with, table)
    lid = '[[plate]]\nname = "lid"\nmaterial = "aluminium"\nthickness_mm = 1\ndistance_mm = 3\nside = "above"\n'
    line = "target.distances_mm must keep the target below the plate 'lid', whose lower face is 3 mm above the sheets"
    refused(DesignError, line, design_with, DISC, lid)
    plate = ca.Plate("target", 0.0, 1e-3, ca.MATERIALS["aluminium"])
    for wrong, line in (
        ({"distances": ()}, "distances of a target must rise from above zero"),
        ({"distances": (0.0, 1e-3)}, "distances of a target must rise from above zero"),
        ({"x": (0.0,)}, "a target must have both x and y, or neither"),
        ({"x": (0.0, 1e-3), "y": (0.0,)}, "an infinite plate is the same everywhere"),
    ):
        refused(GeometryError, line, lambda wrong: ca.Target(**{"body": plate, "distances": (1e-3,)} | wrong), wrong)
