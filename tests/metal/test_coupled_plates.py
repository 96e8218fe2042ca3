"""Several plates with an outline, and between plates and infinite sheets.

Who checks whom: images of layers against the layers' own waves; plates with an outline before a perfect conductor
against their mirror image; wide ones against `flat_plates`, on either side of a foil; discs on each other against one
of both thicknesses; a disc before a wide plate against finite elements.
"""

import math
from dataclasses import replace

import numpy as np
import pytest
from support.axial_field import loop_inductance
from support.coil_paths import loop
from support.refusals import refused

from coilarray.electromagnetics.flat_stack import Layer, layer_waves
from coilarray.errors import GeometryError, MetalError
from coilarray.geometry import Ball, Sheet, Target
from coilarray.geometry.bodies import MATERIALS, Disc, FinitePlate, Material, Plate, Rectangle, Ring
from coilarray.metal.ball import target_inductance
from coilarray.metal.coupled_plates import LayeredAir, _fitted
from coilarray.metal.finite_plates import moving_plate, outlined_inductance
from coilarray.metal.flat_plates import plate_inductance

ALUMINIUM = MATERIALS["aluminium"]
PERFECT = Material("perfect", math.inf)
SHEETS = (Sheet("base", 1e-3), Sheet("magnetic", 1e-3, 2.7))
FREQUENCIES = [2e4, 1e6]


def disc(radius=4e-3, centre=(1e-3, 0.0, 2e-3), thickness=0.5e-3, name="disc"):
    return FinitePlate(name, Disc(radius), centre, thickness, ALUMINIUM)


def waves_of(images, k, source, place):
    """Waves k from a source that a sum of images sends to a place, (f, k)."""
    return sum(image.shares[:, None] * np.exp(-k * abs(image.sign * source + image.offset - place)) for image in images)


def test_images_are_the_waves_of_the_layers():
    """Between plates, and through a sheet; to 2e-4 of the largest wave, with which they are fitted."""
    f, s, z = np.array(FREQUENCIES), -0.5e-3, 2.5e-3
    back, front = Plate("back", -4e-3, 1e-3, ALUMINIUM), Plate("front", 5e-3, 0.1e-3, MATERIALS["steel"])
    k = np.geomspace(100, 3000, 40)
    air = LayeredAir.between([back, front], (), f)
    images = air.images((1, s, s), (1, z, z), 20e-3)
    up, down = (
        layer_waves([Layer(p.thickness, p.material.relative_permeability, p.material.conductivity)], k,
                    2 * np.pi * f[:, None]).reflection for p in (front, back)
    )  # fmt: skip
    D = 8e-3
    again = 1 / (1 - up * down * np.exp(-2 * k * D))
    exact = again * (
        up * np.exp(-k * (10e-3 - s - z)) + down * np.exp(-k * (s + z + 6e-3))
        + up * down * (np.exp(-k * (2 * D + z - s)) + np.exp(-k * (2 * D + s - z)))
    )  # fmt: skip
    np.testing.assert_allclose(waves_of(images, k, s, z), exact, atol=4e-4 * np.abs(exact).max())
    through = LayeredAir.between((), SHEETS, f)
    for one, other in (((0, s, s), (1, z, z)), ((1, z, z), (0, s, s))):
        images = through.images(one, other, 20e-3)
        mu, t = 2.7, 1e-3  # of the slab
        passed = 4 * mu / ((mu + 1) ** 2 - (mu - 1) ** 2 * np.exp(-2 * k * t)) * np.exp(-k * (z - s))
        found = waves_of(images, k, one[1], other[1])
        np.testing.assert_allclose(found, np.tile(passed, (2, 1)), atol=4e-4 * passed.max())


def test_fields_before_in_and_behind_a_perfect_conductor():
    """In the gap before it the normal field is sinh k(d − h)/sinh kd; in it and behind it there is none."""
    k, d = np.array([10.0, 300.0]), 2e-3
    waves = layer_waves([Layer(d), Layer(1e-3, 1.0, math.inf), Layer(1e-3, 3.0)], k, 1e6)
    for h in (0.0, 0.5e-3, 1.9e-3):
        b, slope = waves.at(h)
        np.testing.assert_allclose(b, np.sinh(k * (d - h)) / np.sinh(k * d), rtol=1e-12)
        np.testing.assert_allclose(slope, -k * np.cosh(k * (d - h)) / np.sinh(k * d), rtol=1e-12)
    for h in (2.5e-3, 3.5e-3, 5e-3):
        assert not np.any(waves.at(h))
    np.testing.assert_allclose(waves.integral(0), np.tanh(k * d / 2) / k, rtol=1e-12)
    assert not np.any([waves.integral(1), waves.integral(2)])


def test_reflections_that_no_images_stand_for_are_refused():
    """A wave as short as the distance to the face: images send back sums of falling exponentials, not waves."""
    k = np.geomspace(10, 1e4, 120)
    refused(
        MetalError, "must be a sum of images to 0.0002; .* err by", _fitted, k, np.sin(k / 50)[None] + 0j, 1e-3, 1e-2
    )


def test_what_a_thick_plate_lets_pass_is_nothing():
    """1 mm of aluminium has 12 skin depths at 1 MHz; of the rounding of what passes no images could be made."""
    back = Plate("back", -4e-3, 1e-3, ALUMINIUM)
    hidden = disc(centre=(0.0, 0.0, -6e-3))
    assert not LayeredAir.between([back], (), np.array([1e6])).images((0, -6.3e-3, -5.8e-3), (1, -1e-3, 0.0), 20e-3)
    assert not outlined_inductance([loop(5e-3)], [hidden, back], [1e6], fineness=0.2).any()


@pytest.mark.slow
def test_a_perfect_conductor_is_a_mirror():
    """Coil and disc before it carry half of what they and their mirror images carry together."""
    coil, face = loop(5e-3), -2e-3
    mirrored = (coil * [1, 1, -1] + [0, 0, 2 * face])[::-1]
    image = disc(centre=(1e-3, 0.0, 2 * face - 2e-3), name="image")
    both = outlined_inductance([coil, mirrored], [disc(), image], FREQUENCIES, fineness=0.3)
    back = Plate("back", face - 1e-3, 1e-3, PERFECT)
    found = outlined_inductance([coil], [disc(), back], FREQUENCIES, fineness=0.3)
    np.testing.assert_allclose(found[:, 0, 0], both.sum(axis=(1, 2)) / 2, rtol=3e-5)  # each sums near pairs its own way
    moved = moving_plate([coil], disc(), [disc().centre], FREQUENCIES, (), [back], fineness=0.3).change
    np.testing.assert_allclose(moved[0], found, rtol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("plates", "sheets"),
    [
        ([Plate("steel", -3e-3, 0.2e-3, MATERIALS["steel"])], SHEETS),
        ([Plate("foil", 2.2e-3, 0.01e-3, ALUMINIUM)], ()),
    ],
)
def test_a_wide_plate_beside_others_is_one_without_end(plates, sheets):
    """The field beyond its rim, the mesh and one κ for all waves are 2 % of ΔL; also behind a foil."""
    loops = [loop(5e-3), loop(4e-3, -0.5e-3, centre=(2e-3, 0.0))]
    wide, endless = disc(16e-3, (0.0, 0.0, 3.5e-3), 1e-3), Plate("wide", 3e-3, 1e-3, ALUMINIUM)
    found = outlined_inductance(loops, [wide, *plates], [2e5], sheets, fineness=0.35)
    exact = plate_inductance(loops, [endless, *plates], [2e5], sheets) - plate_inductance(loops, plates, [2e5], sheets)
    np.testing.assert_allclose(np.abs(found - exact), 0, atol=2.5e-2 * np.abs(exact).max())


@pytest.mark.slow
def test_plates_far_from_each_other_add_and_a_stack_is_one_plate():
    """Two pairs of coil and disc 0.2 m apart; a disc of two halves of its thickness, close to each other."""
    coils = [loop(5e-3), loop(5e-3, centre=(0.2, 0.0))]
    far = disc(centre=(0.2, 0.0, 2e-3), name="far")
    one, other = (outlined_inductance(coils, [plate], [1e5], fineness=0.25) for plate in (disc(), far))
    both = outlined_inductance(coils, [disc(), far], [1e5], fineness=0.25)
    np.testing.assert_allclose(both, one + other, atol=1e-5 * np.abs(both).max())  # (a/d)³ of a dipole
    whole = disc(4e-3, (0.0, 0.0, 2e-3), 0.2e-3)
    halves = [disc(4e-3, (0.0, 0.0, z), 0.1e-3, name) for z, name in ((1.945e-3, "lower"), (2.055e-3, "upper"))]
    (found,), (exact,) = (
        outlined_inductance(coils[:1], plates, [1e5], fineness=0.5).ravel() for plates in (halves, [whole])
    )
    assert abs(found - exact) < 1.5e-2 * abs(exact)  # the gap of 0.01 mm, and near triangles of two plates


@pytest.mark.slow
def test_a_target_beside_a_shield_with_a_hole():
    """What the target adds is what both do less the shield; ΔM symmetric, and −Im of both positive semidefinite."""
    loops = [loop(5e-3), loop(4e-3, -0.5e-3, 6, (2e-3, 0.0))]
    shield = FinitePlate("shield", Ring(12e-3, 7e-3), (0.0, 0.0, 0.6e-3), 0.2e-3, ALUMINIUM)
    target = disc(6e-3, (3e-3, 1e-3, 4e-3))
    (added,) = moving_plate(loops, target, [target.centre], [1e6], (), [shield], fineness=0.12).change
    both, alone = (outlined_inductance(loops, p, [1e6], fineness=0.12) for p in ([target, shield], [shield]))
    # the solver's rounding, and the images of bodies together and one by one
    np.testing.assert_allclose(added, both - alone, atol=1e-4 * np.abs(added).max())
    assert (np.linalg.eigvalsh(-both.imag) > -1e-6 * np.abs(both.imag).max()).all()
    wide = Plate("wide", 4e-3, 1e-3, ALUMINIUM)
    moving = Target(replace(wide, z=0.0), (4e-3,))
    (changed,), *_ = target_inductance(
        loops, moving, np.zeros((1, 2)), [4e-3], np.array([1e6]), (), [shield], fineness=0.12
    )
    with_target = outlined_inductance(loops, [shield, wide], [1e6], fineness=0.12)
    np.testing.assert_allclose(changed[0], with_target + plate_inductance(loops, [wide], [1e6]) - alone, rtol=1e-9)


@pytest.mark.slow
def test_axisymmetric_finite_elements_of_a_disc_before_a_wide_plate():
    """A disc above and an aluminium plate below two loops, at 3.4 skin depths; the mesh of the elements is 0.2 %."""
    loops, f = [(8e-3, 0.0), (4e-3, 0.0)], 2e4

    def inside(r, z):
        return ((r < 10e-3) & (z > 2e-3) & (z < 4e-3)) | ((z > -6e-3) & (z < -4e-3))

    def edges(r, z):
        above = np.hypot(np.maximum(r - 10e-3, 0), np.maximum(np.abs(z - 3e-3) - 1e-3, 0))
        within = np.minimum(10e-3 - r, 1e-3 - np.abs(z - 3e-3))
        below = np.abs(np.abs(z + 5e-3) - 1e-3) + np.maximum(r - 40e-3, 0)
        return np.minimum(np.where(within > 0, within, above), below)

    reference = loop_inductance(
        loops,
        lambda r, z: (np.ones_like(r), np.where(inside(r, z), ALUMINIUM.conductivity, 0.0)),
        f,
        lambda r, z: inside(r, z) & (r < 40e-3),
        edges,
        0.25e-3,
    )
    paths = [loop(*each, sides=180) for each in loops]
    back = Plate("back", -6e-3, 2e-3, ALUMINIUM)
    plate = FinitePlate("disc", Disc(10e-3), (0.0, 0.0, 3e-3), 2e-3, ALUMINIUM)
    found = (plate_inductance(paths, [back], [f]) + outlined_inductance(paths, [plate, back], [f], fineness=0.6))[
        0
    ].diagonal()
    np.testing.assert_allclose(found.real, reference.real, rtol=1e-2)
    np.testing.assert_allclose(found.imag, reference.imag, rtol=4e-2)


def test_refusals():
    coil, back = [loop(5e-3)], Plate("back", -4e-3, 1e-3, ALUMINIUM)
    block = FinitePlate("block", Rectangle(4e-3, 4e-3), (9e-3, 0.0, 2e-3), 1e-3, ALUMINIUM)
    refused(
        GeometryError, r"'disc' at \(6, 0, 2\) mm reaches into 'block'",
        moving_plate, coil, disc(), [[6e-3, 0.0, 2e-3]], [1e6], (), [back, block],
    )  # fmt: skip
    refused(
        GeometryError, "must not reach into another one; 'low' at .* reaches into 'back'",
        outlined_inductance, coil, [disc(centre=(0.0, 0.0, -3.1e-3), name="low"), back], [1e6],
    )  # fmt: skip
    refused(
        MetalError, "the coils must lie between infinite plates and magnetic sheets",
        outlined_inductance, coil, [disc(), replace(back, z=-0.5e-3)], [1e6],
    )  # fmt: skip
    ball = Target(Ball(5e-3, ALUMINIUM), (1e-3,))
    refused(
        MetalError, "a sphere is computed only beside plates below the coils; plate.1 'disc' lies above them",
        target_inductance, coil, ball, np.zeros((1, 2)), [1e-3], np.array([1e6]), (), [back, disc()],
    )  # fmt: skip
