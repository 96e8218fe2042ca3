"""Plates with an outline below coils and dented sheets.

Who checks whom: finite elements about the axis solve coil, dented sheets and disc at once; a wide disc is an infinite
plate, whose waves come back to the dent without an approximation; limits and refusals.
"""

import numpy as np
import pytest
from support.axial_field import loop_inductance
from support.references import polygon
from support.refusals import refused

from coilarray.elastomer.dent import Dent
from coilarray.elastomer.dented_layer import dent_inductance, dent_inductance_over
from coilarray.elastomer.scattering import LayerMesh
from coilarray.errors import MetalError
from coilarray.geometry import MATERIALS, Disc, FinitePlate, Material, Plate, Sheet
from coilarray.metal.backing import backing_of, require_below

ALUMINIUM = MATERIALS["aluminium"]
FACE, METAL = -2e-3, 2e-3  # upper face and thickness of the metal in m
SHEETS = (Sheet("base", 4e-3, 1.0), Sheet("top", 2e-3, 3.0))
LOOPS = [(3e-3, -0.5e-3), (7e-3, -0.5e-3)]  # radius and height in m
PLACES = np.array([[0.0, 0.0], [4e-3, -2e-3]])
MESH = LayerMesh().coarser()


def pit():
    """The sheets, pressed in by 1.5 mm at the top."""
    r = np.linspace(0, 20e-3, 201)
    shape = -1.5e-3 * np.exp(-((r / 3e-3) ** 2))
    return Dent((4e-3, 2e-3), (1.0, 3.0), r, np.column_stack((0 * r, 0.8 * shape, shape)))


def metal(outline, material=ALUMINIUM, face=FACE, thickness=METAL, **more):
    return FinitePlate("metal", outline, (0.0, 0.0, face - thickness / 2), thickness, material, **more)


def over(coils, plates, frequency):
    backing = backing_of(coils, plates, frequency, SHEETS, fineness=0.5)  # errs by 0.3 %
    return dent_inductance_over(backing, coils, [pit()], PLACES, MESH)[0]


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


def test_a_plate_of_nothing_does_nothing(coils):
    alone = dent_inductance(coils, [pit()], PLACES, MESH)[0]
    found = over(coils, [metal(Disc(9e-3), Material("nothing", 1.0), thickness=0.2e-3)], 1e3)
    np.testing.assert_allclose(found.real, alone, rtol=1e-6)
    assert np.abs(found.imag).max() < 1e-5 * np.abs(alone).max()


@pytest.mark.slow
def test_coil_dent_and_disc_are_those_of_finite_elements():
    """What a dent does over a disc, over what it does without: elements of 0.12 mm err alike in both."""
    base, top, dent, radius, frequency = 4e-3, 6e-3, pit(), 9e-3, 2e4

    def solved(conductivity):
        def materials(dented):
            def at(r, z):
                faces = dented * dent.faces(r)
                sheet = (z > base + faces[..., 1]) & (z < top + faces[..., 2])
                disc = (z < FACE) & (z > FACE - METAL) & (r < radius)
                return np.where(sheet, 3.0, 1.0), np.where(disc, conductivity, 0.0)

            return at

        def surfaces(r, z):
            faces = dent.faces(r)
            moved = np.minimum(np.abs(z - base - faces[..., 1]), np.abs(z - top - faces[..., 2]))
            within = np.minimum(radius - r, METAL / 2 - np.abs(z - FACE + METAL / 2))
            beyond = np.hypot(np.maximum(r - radius, 0), np.maximum(np.abs(z - FACE + METAL / 2) - METAL / 2, 0))
            return np.minimum(np.where(r < 9e-3, moved, 1.0), np.where(within > 0, within, beyond))

        dented, flat = (
            loop_inductance(
                LOOPS, materials(part), frequency, lambda r, z: (r < 9e-3) & (np.abs(z) < 7e-3), surfaces, 1.25e-4
            )
            for part in (1.0, 0.0)
        )
        return dented - flat

    paths = [polygon(120, *one) for one in LOOPS]
    alone = dent_inductance(paths, [dent], [[0.0, 0.0]])[0, 0].diagonal()
    backing = backing_of(paths, [metal(Disc(radius))], frequency, SHEETS)
    found = dent_inductance_over(backing, paths, [dent], [[0.0, 0.0]])[0, 0].diagonal() / alone
    expected = solved(ALUMINIUM.conductivity) / solved(0.0).real
    # 1 % by the rim and 0.3 % by the dent's own field, which the disc sends back in the elements alone
    np.testing.assert_allclose(found.real, expected.real, rtol=1.5e-2)
    np.testing.assert_allclose(found.imag, expected.imag, rtol=5e-2, atol=2e-3)


def test_refusals():
    lid, back = Plate("lid", 20e-3, 1e-3, ALUMINIUM), Plate("back", -3e-3, 1e-3, ALUMINIUM)
    refused(MetalError, "plate.0 'lid' lies above the sheets, in the way of the indenter: leave it out", require_below,
            [lid])  # fmt: skip
    refused(MetalError, r"plate.0 'metal' has a relative permeability of .*: give it shape = .plate.", require_below,
            [metal(Disc(9e-3), MATERIALS["steel"])])  # fmt: skip
    refused(MetalError, "reaches down to -6 mm, an infinite one up to -2 mm: raise its z_mm", require_below,
            [metal(Disc(9e-3), face=-4e-3), back])  # fmt: skip
    assert backing_of([], [], 1e6, SHEETS) is None
