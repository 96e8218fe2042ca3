"""The share of an indenter of metal or ferrite in a response.

Who checks whom: the parts of a map against maps of one part alone; a ball above the sheets against the ball itself.
"""

from dataclasses import replace

import numpy as np
import pytest
from support.contacts import IDEAL, QUICK, first_coils_design
from support.refusals import refused

from coilarray.design.model import Indentation
from coilarray.errors import DesignError, ElastomerError, MetalError
from coilarray.geometry import MATERIALS, Ball, FlatPunch, Material, Plate
from coilarray.metal.ball import ball_inductance
from coilarray.response.map import Imperfections, response_map

pytestmark = pytest.mark.slow

PLAIN = first_coils_design(2)
X, DEPTHS = [-13.28e-3, 2e-3], [-3e-3, 0.0, 1e-3]


def of(material, design=PLAIN):
    return replace(design, indentation=replace(design.indentation, material=MATERIALS[material]))


def nominal(design, **changes):
    return response_map(
        design, **{"depths": DEPTHS, "x": X, "y": [0.0], "imperfections": IDEAL, "accuracy": QUICK, **changes}
    )


@pytest.fixture(scope="module")
def steel():
    return nominal(of("steel"))


def test_both_parts_make_the_response(steel):
    dent = nominal(PLAIN, depths=[0.0, 1e-3])
    pressed = steel.isel(depth=[1, 2])
    for whole, share, plain in (
        (pressed.delta, pressed.metal_delta, dent.delta),
        (pressed.inductance_change, pressed.metal_inductance_change, dent.inductance_change),
    ):
        assert (whole - share).values == pytest.approx(plain.values, rel=1e-9, abs=1e-12 * np.abs(plain.values).max())
    # above the sheets there is nothing else, but for the last step of a resonance
    assert steel.delta.isel(depth=0).values == pytest.approx(steel.metal_delta.isel(depth=0).values, abs=1e-12)
    assert not steel.metal_inductance_change.isel(depth=1).any()  # L_0 is read here
    assert "metal_delta" not in dent


def test_above_the_sheets_it_is_the_ball(steel):
    far = nominal(of("steel"), depths=[-3e-3, 0.0], imperfections=Imperfections(rest=np.inf, network="ideal"))
    ball, f = Ball(PLAIN.indentation.indenter.radius, MATERIALS["steel"]), far.attrs["metal_frequency_Hz"]
    origin, top = PLAIN.indentation.origin_point, sum(sheet.thickness for sheet in PLAIN.sheets)
    places = [[x + origin[0], origin[1], top + up + ball.radius] for up in (3e-3, 0.0) for x in X]
    alone = ball_inductance(PLAIN.array, ball, places, [f], PLAIN.sheets)[:, 0].reshape(2, 1, 2, 2, 2)
    assert far.metal_inductance_change.values == pytest.approx(alone.real, rel=1e-7)
    assert far.metal_resistance_change.values == pytest.approx(-2 * np.pi * f * alone.imag, rel=1e-7)  # places to 1 nm
    moved = (far.isel(depth=0) - far.isel(depth=1)).metal_inductance_change
    assert steel.metal_inductance_change.isel(depth=0).values == pytest.approx(moved.values, rel=1e-6)


def test_aluminium_lowers_and_ferrite_raises_the_response():
    for name, sign in (("aluminium", -1), ("ferrite", 1)):
        share = nominal(of(name), depths=[1e-3]).metal_delta
        assert (share.values[0, 0, 0] * sign > 0).all()  # both states, with the other coil shorted


def test_plates_weaken_what_an_indenter_of_ferrite_does(steel):
    back = Plate("back", -4e-3, 1e-3, MATERIALS["aluminium"])
    share, alone = (
        nominal(of("ferrite", design), depths=[1e-3]).metal_inductance_change
        for design in (replace(PLAIN, plates=(back,)), PLAIN)
    )
    assert 0 < share.values[0, 0, 0, 0, 0] < 0.7 * alone.values[0, 0, 0, 0, 0]
    nothing = replace(PLAIN, plates=(replace(back, material=Material("nothing", 1e-6)),))
    found = nominal(of("steel", nothing), depths=DEPTHS[1:])
    expected = steel.metal_inductance_change.isel(depth=[1, 2]).values
    assert found.metal_inductance_change.values == pytest.approx(expected, rel=1e-4, abs=1e-6 * np.abs(expected).max())


def test_refusals():
    refused(ElastomerError, "depth of an indentation must be at least 0 .* got -3 mm", nominal, PLAIN)
    refused(ElastomerError, "needs every coil: use accuracy=None", nominal, of("steel"), accuracy=1e-3)
    refused(MetalError, "rest must be at least 0; got -0.001 m", Imperfections, rest=-1e-3)
    refused(
        DesignError, "is computed as a sphere of its radius; got a flat punch of steel",
        Indentation, FlatPunch(1e-3), (1e-3,), material=MATERIALS["steel"],
    )  # fmt: skip
