"""Plates in design files: read, written, varied and counted in the digest; one clear line for what cannot be."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.refusals import refused

import coilarray as ca
from coilarray import geometry
from coilarray.design.bundled import read
from coilarray.design.model import build_design
from coilarray.errors import DesignError
from coilarray.geometry import Material

STARTER = read("starter")
SHIELD = '[[plate]]\nname = "shield"\nmaterial = "aluminium"\nthickness_mm = 0.5\n'
DISC = SHIELD.replace("shield", "disc").replace('material = "aluminium"', "conductivity_MS_per_m = 10.0")
DISC = DISC.replace("0.5", "1.0") + 'shape = "disc"\ndiameter_mm = 20.0\n'


def with_plates(*tables: str) -> str:
    return "\n".join((STARTER.partition("# What presses")[0], *tables, "[circuit]\n[field]\nheight_mm = 3.0\n"))


def plates_of(*tables: str) -> tuple[ca.Plate | ca.FinitePlate, ...]:
    return ca.parse_design(with_plates(*tables)).plates


def test_heights_from_z_and_from_distances() -> None:
    """The starter's board is 1.25 mm thick and its sheets 4 mm; a tilted disc keeps its gap at its nearest point."""
    (at,) = plates_of(SHIELD + "z_mm = -8.0")
    assert at == ca.Plate("shield", -8e-3, 0.5e-3, ca.MATERIALS["aluminium"])
    (below,) = plates_of(SHIELD + 'distance_mm = 2.0\nside = "below"')
    assert below.heights == pytest.approx((-3.75e-3, -3.25e-3))
    (above,) = plates_of(SHIELD + 'distance_mm = 2.0\nside = "above"')
    assert above.heights == pytest.approx((6e-3, 6.5e-3))
    (disc,) = plates_of(DISC + 'distance_mm = 2.0\nside = "above"\nx_mm = 3\ntilt_deg = 30')
    assert isinstance(disc, ca.FinitePlate)
    assert disc.heights[0] == pytest.approx(6e-3)
    assert disc.centre[:2] == (3e-3, 0.0)
    assert disc.material.conductivity == 1e7


def test_a_design_with_plates_is_that_of_its_document_and_of_its_file(tmp_path: Path) -> None:
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


def test_plates_are_varied_like_other_entries() -> None:
    file = ca.parse_design(with_plates(SHIELD + "z_mm = -8.0"))
    varied = ca.vary(file, {"plate.0.z_mm": -9, "plate.0.material": "copper"})
    assert [plate.material.name for plate in varied.plates] == ["copper"]
    assert varied.plates[0].heights == pytest.approx((-9e-3, -8.5e-3))


def test_a_pour_may_lie_in_the_board_below_the_coils() -> None:
    """The copper of one coil on the upper two of four layers ends at −0.27 mm; its ground plane is the next layer."""
    design = ca.load_design("starter")
    upper = replace(design.array, placements=design.array.placements[:1])
    pour = ca.Plate("pour", -1.015e-3, 35e-6, ca.MATERIALS["copper"])
    assert ca.Design(upper, plates=(pour,)).plates == (pour,)
    with pytest.raises(DesignError, match=r"plate.0 must lie above .* below the coils' copper \(z below -0.27 mm\)"):
        ca.Design(upper, plates=(replace(pour, z=-0.28e-3),))


BAD = {
    "no height": (SHIELD, "plate.0 needs exactly one of z_mm and distance_mm"),
    "no side": (SHIELD + "distance_mm = 1.0", 'plate.0 needs side = "above" or "below" with distance_mm'),
    "no material": (SHIELD.replace('material = "aluminium"\n', "z_mm = 9.0\n"), "plate.0 needs a material, or conduct"),
    "unknown material": (SHIELD.replace("aluminium", "tin") + "z_mm = 9.0", "plate.0 needs a material of copper"),
    "misspelt material": (SHIELD.replace("aluminium", "aluminum") + "z_mm = 9.0", "did you mean aluminium\\?$"),
    "inner above outer": (
        DISC.replace('"disc"\nd', '"ring"\ninner_diameter_mm = 30.0\nd') + "z_mm = 9.0",
        r"plate.0 needs inner_diameter_mm below its diameter_mm of \d+; got 30",
    ),
    "two materials": (SHIELD + "z_mm = 9.0\nconductivity_MS_per_m = 1.0", "got both"),
    "air": (DISC.replace("10.0", "0.0") + "z_mm = 9.0", r"plate.0: 'disc' must have a conductivity above 0 .*neither"),
    "no size": (DISC.replace("diameter", "width") + "z_mm = 9.0", "plate.0 (needs diameter_mm|has no width_mm)"),
    "place without end": (SHIELD + "z_mm = 9.0\nx_mm = 1.0", 'has no x_mm and y_mm for shape = "plate"'),
    "in the sheets": (SHIELD + "z_mm = 3.0", r"plate.0 must lie above the sheets and the board \(z above 4 mm\)"),
    "in the copper": (SHIELD + "z_mm = -0.6", r"plate.0 must lie .*'shield' lies from -0.6 to -0.1 mm"),
    "one name": (SHIELD + "z_mm = 9.0\n" + SHIELD + "z_mm = 19.0", "plates must have different names; got shield"),
    "in each other": (SHIELD + "z_mm = 9.0\n" + DISC + "z_mm = 9.4", "plate.1 must not overlap another plate; 'disc'"),
    "crossing": (
        DISC.partition('"disc"\nd')[0] + '"polygon"\ncorners_mm = [[0, 0], [1, 1], [1, 0], [0, 1]]\nz_mm = 9.0',
        r"plate.0: an outline must not cross or touch itself, .*0.5 0.5\] \(mm\)",
    ),
    "unknown key": (SHIELD + "z = 9.0", "plate.0 has no key 'z'"),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD)
def test_bad_plates_are_one_clear_line(case: str) -> None:
    table, message = BAD[case]
    refused(DesignError, rf"^file\.toml: .*{message}", ca.parse_design, with_plates(table), origin="file.toml")


def test_a_file_has_no_perfect_conductor() -> None:
    perfect = ca.Plate("mirror", 9e-3, 1e-3, Material("perfect", math.inf))
    design = replace(ca.load_design("starter"), plates=(perfect,))
    refused(DesignError, "a design file has no perfect conductor; got 'perfect'", ca.design_document, design)
