"""Plates with an outline below coils and dented sheets.

Who checks whom: finite elements about the axis solve coil, dented sheets and disc at once; a wide disc is an infinite
plate, whose waves come back to the dent without an approximation; limits and refusals.
"""

import numpy as np
import pytest
from support.axial_field import dent_over_metal, disc_region, pit
from support.references import polygon
from support.refusals import refused

from coilarray.compute.store import content_key
from coilarray.elastomer.dented_layer import dent_inductance
from coilarray.elastomer.scattering import LayerMesh
from coilarray.errors import MetalError
from coilarray.geometry import MATERIALS, Disc, FinitePlate, Material, Plate, Sheet
from coilarray.metal.backing import backings_of, require_below

pytestmark = pytest.mark.slow

ALUMINIUM, STEEL = MATERIALS["aluminium"], Material("steel", 7e6, 50.0)
FACE, METAL = -2e-3, 2e-3  # upper face and thickness of the metal in m
SHEETS = (Sheet("base", 4e-3, 1.0), Sheet("top", 2e-3, 3.0))
LOOPS = [(3e-3, -0.5e-3), (7e-3, -0.5e-3)]  # radius and height in m
PLACES = np.array([[0.0, 0.0], [4e-3, -2e-3]])
MESH = LayerMesh().coarser()


def metal(outline, material=ALUMINIUM, face=FACE, thickness=METAL, **more):
    return FinitePlate("metal", outline, (0.0, 0.0, face - thickness / 2), thickness, material, **more)


def over(coils, plates, frequency, fineness=0.3):  # which errs by 0.5 %
    (backing,), _ = backings_of(coils, plates, [frequency], SHEETS, fineness=fineness)
    assert content_key(backing)  # under which maps keep their parts
    return dent_inductance(coils, [pit()], PLACES, MESH, backing=backing)[0]


@pytest.fixture(scope="module")
def coils():
    return [polygon(24, 6e-3, -0.5e-3, centre=(1e-3, 0.0)), polygon(24, 5e-3, -0.8e-3, centre=(-3e-3, 2e-3))]


@pytest.fixture(scope="module")
def wide(coils):
    return over(coils, [metal(Disc(18e-3))], 1e6)


def test_a_wide_disc_is_an_infinite_plate(coils, wide):
    """The dent's own field, which comes back from the infinite plate alone, and the rim: 0.6 % together."""
    infinite = over(coils, [Plate("metal", FACE - METAL, METAL, ALUMINIUM)], 1e6)
    alone = dent_inductance(coils, [pit()], PLACES, MESH)[0]
    assert np.abs(wide - infinite).max() < 1e-2 * np.abs(infinite).max()
    assert np.abs(infinite - alone).max() > 0.3 * np.abs(alone).max()
    np.testing.assert_allclose(wide, wide.swapaxes(1, 2), rtol=1e-9, atol=1e-9 * np.abs(wide).max())


def test_a_plate_below_an_outlined_one_sees_nothing_behind_it(coils, wide):
    """An infinite plate behind a disc many skin depths thick counts by what passes its rim."""
    both = over(coils, [metal(Disc(18e-3)), Plate("back", -8e-3, 1e-3, ALUMINIUM)], 1e6)
    assert np.abs(both - wide).max() < 1e-2 * np.abs(wide).max()


FOIL = Plate("foil", -2.5e-3, 0.02e-3, ALUMINIUM)


def test_a_wide_disc_behind_a_foil_is_an_infinite_plate(coils):
    """The foil lets most of the waves pass at 20 kHz; rim, dent's own field and a coarse mesh are 0.4 %.

    Without what the plate behind the thin disc sends back up of its currents it would be 3 %.
    """
    thickness, beside = 0.02e-3, (Plate("back", -5e-3, 1e-3, ALUMINIUM),)
    alike = metal(Disc(13e-3), face=-3e-3, thickness=thickness), Plate("metal", -3e-3 - thickness, thickness, ALUMINIUM)
    behind, infinite = (over(coils, [FOIL, one, *beside], 2e4, 0.2) for one in alike)
    without = over(coils, [FOIL, *beside], 2e4)
    assert np.abs(infinite - without).max() > 0.025 * np.abs(without).max()
    np.testing.assert_allclose(behind, infinite, atol=5e-3 * np.abs(infinite).max())


def test_a_foil_of_air_before_a_disc_is_none(coils):
    disc = metal(Disc(9e-3), face=-3e-3)
    clear = Plate("clear", -2.5e-3, 0.2e-3, Material("clear", 1e-3))
    one, other = (over(coils, [disc, *more], 1e6, 0.12) for more in ([], [clear]))
    np.testing.assert_allclose(other, one, rtol=2e-3)  # the images hold to 2e-4 of the largest wave


@pytest.mark.parametrize(
    ("material", "errors"), [(ALUMINIUM, (1.5e-2, 5e-2)), (STEEL, (2.5e-2, 5e-2))], ids=["aluminium", "steel"]
)
def test_coil_dent_and_disc_are_those_of_finite_elements(material, errors):
    """What a dent does over a disc, over what it does without: elements of 0.12 mm err alike in both."""
    dent, radius, frequency = pit(), 9e-3, 2e4
    region = disc_region(radius, FACE - METAL, FACE)
    paths = [polygon(60, *one) for one in LOOPS]
    alone = dent_inductance(paths, [dent], [[0.0, 0.0]])[0, 0].diagonal()
    (backing,), _ = backings_of(paths, [metal(Disc(radius), material)], [frequency], SHEETS, fineness=0.25)
    found = dent_inductance(paths, [dent], [[0.0, 0.0]], backing=backing)[0, 0].diagonal() / alone
    solved, without = (
        dent_over_metal(LOOPS, dent, region, *one, frequency)
        for one in ((material.relative_permeability, material.conductivity), (1.0, 0))
    )
    expected = solved / without.real
    # 1 % by the rim and 0.3 % by the dent's own field, which the disc sends back in the elements alone; 1 % more by the
    # edges of steel, whose skin is a fortieth of its radius. Found on this mesh: 0.2 and 0.6 %, and 3 % of the losses
    np.testing.assert_allclose(found.real, expected.real, rtol=errors[0])
    np.testing.assert_allclose(found.imag, expected.imag, rtol=errors[1], atol=2e-3)


def test_refusals():
    lid = Plate("lid", 20e-3, 1e-3, ALUMINIUM)
    refused(MetalError, "an indentation is .* plate.0 'lid' lies above them: leave it out", require_below,
            [lid])  # fmt: skip
    assert backings_of([], [], [1e6], SHEETS) == ([], None)
