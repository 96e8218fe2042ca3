"""Plates and targets in design files, and positions of a map: read, written, varied and counted in the digest."""

import math
from dataclasses import replace

import numpy as np
import pytest
from support.boards import many_layers, round_spiral
from support.refusals import refused

import coilarray as ca
from coilarray import geometry
from coilarray.design.body_tables import MOST_POSITIONS, array_window
from coilarray.design.bundled import read
from coilarray.design.model import build_design
from coilarray.errors import DesignError, GeometryError
from coilarray.geometry import Lattice, Material, lattice_array

STARTER = read("starter")
SHIELD = '[[plate]]\nname = "shield"\nmaterial = "aluminium"\nthickness_mm = 0.5\n'
ROUND = SHIELD.replace("shield", "disc").replace('material = "aluminium"', "conductivity_MS_per_m = 10.0")
ROUND = ROUND.replace("0.5", "1.0") + 'shape = "disc"\ndiameter_mm = 20.0\n'


def with_plates(*tables):
    return "\n".join((STARTER.partition("# What presses")[0], *tables, "[circuit]\n[field]\nheight_mm = 3.0\n"))


def plates_of(*tables):
    return ca.parse_design(with_plates(*tables)).plates


def test_heights_from_z_and_from_distances():
    """The starter's board is 1.25 mm thick and its sheets 4 mm; a tilted disc keeps its gap at its nearest point."""
    (at,) = plates_of(SHIELD + "z_mm = -8.0")
    assert at == ca.Plate("shield", -8e-3, 0.5e-3, ca.MATERIALS["aluminium"])
    (below,) = plates_of(SHIELD + 'distance_mm = 2.0\nside = "below"')
    assert below.heights == pytest.approx((-3.75e-3, -3.25e-3))
    (above,) = plates_of(SHIELD + 'distance_mm = 2.0\nside = "above"')
    assert above.heights == pytest.approx((6e-3, 6.5e-3))
    (disc,) = plates_of(ROUND + 'distance_mm = 2.0\nside = "above"\nx_mm = 3\ntilt_deg = 30')
    assert isinstance(disc, ca.FinitePlate)
    assert disc.heights[0] == pytest.approx(6e-3)
    assert disc.centre[:2] == (3e-3, 0.0)
    assert disc.material.conductivity == 1e7


def test_a_design_with_plates_is_that_of_its_document_and_of_its_file(tmp_path):
    metal, hole = Material("mine", 7e6 / 3), ((1e-3, 1e-3), (2e-3, 1e-3), (1e-3, 2e-3))
    corners = ((0.0, 0.0), (10e-3, 1e-3 / 3), (0.0, 10e-3))
    plates = (
        ca.Plate("copper pour", -1e-2 / 3, 35e-6, Material("magnetic", 0.0, 9.0)),
        ca.FinitePlate("disc", ca.Disc(1e-2 / 3), (1e-3, -2e-3, 9e-3), 1e-3, metal, 0.1, 2.0),
        ca.FinitePlate("ring", geometry.Ring(4e-3, 2e-3), (0, 0, 20e-3), 1e-3, metal),
        ca.FinitePlate("box", ca.Rectangle(4e-3, 2e-3), (0, 0, 30e-3), 1e-3, metal),
        ca.FinitePlate("piece", geometry.Polygon(corners, (hole,)), (0, 0, 40e-3), 1e-3, ca.MATERIALS["copper"]),
    )
    design = replace(ca.load_design("starter"), plates=plates, indentation=None)
    again = build_design(ca.design_document(design))
    assert [plate.name for plate in again.plates] == ["copper_pour", "disc", "ring", "box", "piece"]
    named = replace(design, plates=(replace(plates[0], name="copper_pour"), *plates[1:]))
    assert again.digest == named.digest
    assert len({design.digest, named.digest, replace(design, plates=()).digest}) == 3
    ca.save_design(design, tmp_path / "d.toml")
    saved = (tmp_path / "d.toml").read_text(encoding="utf-8")
    assert saved.count("# Height of its lower face") == 5
    for plate, read_back in zip(named.plates, ca.load_design(tmp_path / "d.toml").plates, strict=True):
        np.testing.assert_allclose(read_back.heights, plate.heights, atol=1e-9)


def test_plates_are_varied_like_other_entries():
    file = ca.parse_design(with_plates(SHIELD + "z_mm = -8.0"))
    varied = ca.vary(file, {"plate.0.z_mm": -9, "plate.0.material": "copper"})
    assert [plate.material.name for plate in varied.plates] == ["copper"]
    assert varied.plates[0].heights == pytest.approx((-9e-3, -8.5e-3))


def test_a_pour_may_lie_in_the_board_below_the_coils():
    """The copper of one coil on the upper two of four layers ends at −0.27 mm; its ground plane is the next layer."""
    design = ca.load_design("starter")
    upper = replace(design.array, placements=design.array.placements[:1])
    pour = ca.Plate("pour", -1.015e-3, 35e-6, ca.MATERIALS["copper"])
    assert ca.Design(upper, plates=(pour,)).plates == (pour,)
    with pytest.raises(DesignError, match=r"plate.0 must lie above .* below the coils' copper \(z below -0.27 mm\)"):
        ca.Design(upper, plates=(replace(pour, z=-0.28e-3),))


BAD_PLATES = {
    "no height": (SHIELD, "plate.0 needs exactly one of z_mm and distance_mm"),
    "no side": (SHIELD + "distance_mm = 1.0", 'plate.0 needs side = "above" or "below" with distance_mm'),
    "no material": (SHIELD.replace('material = "aluminium"\n', "z_mm = 9.0\n"), "plate.0 needs a material, or conduct"),
    "unknown material": (SHIELD.replace("aluminium", "tin") + "z_mm = 9.0", "plate.0 needs a material of copper"),
    "misspelt material": (SHIELD.replace("aluminium", "aluminum") + "z_mm = 9.0", "did you mean aluminium\\?$"),
    "inner above outer": (
        ROUND.replace('"disc"\nd', '"ring"\ninner_diameter_mm = 30.0\nd') + "z_mm = 9.0",
        r"plate.0 needs inner_diameter_mm below its diameter_mm of \d+; got 30",
    ),
    "two materials": (SHIELD + "z_mm = 9.0\nconductivity_MS_per_m = 1.0", "got both"),
    "air": (ROUND.replace("10.0", "0.0") + "z_mm = 9.0", r"plate.0: 'disc' must have a conductivity above 0 .*neither"),
    "no size": (ROUND.replace("diameter", "width") + "z_mm = 9.0", "plate.0 (needs diameter_mm|has no width_mm)"),
    "place without end": (SHIELD + "z_mm = 9.0\nx_mm = 1.0", 'has no x_mm and y_mm for shape = "plate"'),
    "in the sheets": (SHIELD + "z_mm = 3.0", r"plate.0 must lie above the sheets and the board \(z above 4 mm\)"),
    "in the copper": (SHIELD + "z_mm = -0.6", r"plate.0 must lie .*'shield' lies from -0.6 to -0.1 mm"),
    "one name": (SHIELD + "z_mm = 9.0\n" + SHIELD + "z_mm = 19.0", "plates must have different names; got shield"),
    "in each other": (SHIELD + "z_mm = 9.0\n" + ROUND + "z_mm = 9.4", "plate.1 must not overlap another plate; 'disc'"),
    "crossing": (
        ROUND.partition('"disc"\nd')[0] + '"polygon"\ncorners_mm = [[0, 0], [1, 1], [1, 0], [0, 1]]\nz_mm = 9.0',
        r"plate.0: an outline must not cross or touch itself, .*0.5 0.5\] \(mm\)",
    ),
    "unknown key": (SHIELD + "z = 9.0", "plate.0 has no key 'z'"),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD_PLATES)
def test_bad_plates_are_one_clear_line(case):
    table, message = BAD_PLATES[case]
    refused(DesignError, rf"^file\.toml: .*{message}", ca.parse_design, with_plates(table), origin="file.toml")


def test_a_file_has_no_perfect_conductor():
    perfect = ca.Plate("mirror", 9e-3, 1e-3, Material("perfect", math.inf))
    design = replace(ca.load_design("starter"), plates=(perfect,))
    refused(DesignError, "a design file has no perfect conductor; got 'perfect'", ca.design_document, design)


# ---- targets


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


# ---- positions that are not given


LARGE = round_spiral(20e-3, 6, 0.15e-3, 0.15e-3).coil()


@pytest.mark.parametrize(("count", "step"), [(1, 1.0e-3), (3, 3.5e-3)])
def test_a_coil_has_a_dozen_steps_and_one_alone_more(count, step):
    """40 mm / 32 = 1.25 mm and 40 mm / 12 = 3.33 mm, to half a millimetre."""
    array = lattice_array(many_layers(2), LARGE, Lattice("linear", 60e-3, count))
    bounds = np.reshape(array.outline_bounds, (2, 2)).T
    for places, (low, high) in zip(array_window(array, (0.0, 0.0)), bounds, strict=True):
        np.testing.assert_allclose(np.diff(places), step, rtol=1e-9)
        assert low - step < places[0] <= low + 1e-9
        assert high - 1e-9 <= places[-1] < high + step


def test_a_wide_board_has_wider_steps_rather_than_too_many_positions():
    array = lattice_array(many_layers(2), LARGE, Lattice("linear", 100.0, 2))  # m
    x, y = array_window(array, (0.0, 0.0))
    assert 0.5 * MOST_POSITIONS < len(x) * len(y) <= MOST_POSITIONS


def test_a_map_of_a_target_over_a_pad_has_some_hundred_positions():
    coil = round_spiral(5e-3, 6, 0.15e-3, 0.15e-3).coil()
    array = lattice_array(many_layers(2), coil, Lattice("square", 13e-3, 4, 4))
    counts = {table: len(x) * len(y) for table in ("indentation", "target")
              for x, y in [array_window(array, (0.0, 0.0), table=table)]}  # fmt: skip
    assert counts["indentation"] > 1500 > 800 > counts["target"] > 300
