"""Field and currents beside infinite plates against images, against power, and against the inductance they make."""

import numpy as np
import pytest

from coilarray.constants import MU_0
from coilarray.electromagnetics.field import grid_points, magnetic_field
from coilarray.errors import MetalError
from coilarray.geometry import MATERIALS, Material, Plate, Sheet
from coilarray.metal.flat_plates import plate_currents, plate_field, plate_inductance

RADIUS = 8e-3
ANGLE = np.linspace(0, 2 * np.pi, 121)
LOOP = np.column_stack((RADIUS * np.cos(ANGLE), RADIUS * np.sin(ANGLE), 0 * ANGLE - 1e-4))
PERFECT = Material("perfect", np.inf)
X, Y = np.linspace(-15e-3, 15e-3, 7), np.linspace(-10e-3, 10e-3, 5)
CUT = 1e-4  # of the field: waves beyond the highest one, which falls by e⁻¹² on its way


@pytest.mark.parametrize(("plate", "face"), [
    (Plate("above", 5e-3, 1e-3, PERFECT), 5e-3), (Plate("below", -4e-3, 1e-3, PERFECT), -3e-3),
])  # fmt: skip
def test_a_perfect_conductor_is_an_image(plate, face):
    z = np.array([1e-3, 4.9e-3])
    image = LOOP * [1, 1, -1] + [0, 0, 2 * face]
    expected = magnetic_field([LOOP], grid_points(X, Y, z)) - magnetic_field([image], grid_points(X, Y, z))
    found = plate_field([LOOP], [2.0], [plate], 1e6, X, Y, z)
    np.testing.assert_allclose(found / 2, expected, atol=CUT * np.abs(expected).max())


def test_no_field_passes_a_perfect_conductor_and_a_transparent_one_changes_none():
    z = np.array([7e-3, 9e-3])
    free = magnetic_field([LOOP], grid_points(X, Y, z))
    found = plate_field([LOOP], [1.0], [Plate("above", 5e-3, 1e-3, PERFECT)], 1e6, X, Y, z)
    assert np.abs(found).max() == 0
    thin = plate_field([LOOP], [1.0], [Plate("above", 5e-3, 1e-3, Material("thin", 1e-3))], 1e3, X, Y, z)
    np.testing.assert_allclose(thin, free, atol=CUT * np.abs(free).max())


@pytest.mark.parametrize(("plate", "near", "far"), [
    (Plate("above", 4e-3, 2e-3, MATERIALS["aluminium"]), 4e-3, 6e-3),
    (Plate("below", -6e-3, 2e-3, MATERIALS["aluminium"]), -4e-3, -6e-3),
])  # fmt: skip
def test_at_a_good_conductor_b_goes_along_its_face_and_does_not_pass(plate, near, far):
    f, sign = 3e6, np.sign(near)
    skin = plate.material.skin_depth(f)  # 49 µm
    z = np.sort([near - sign * 1e-8, near + sign * 1e-8, near + sign * 5 * skin, far + sign * 1e-3])
    B = plate_field([LOOP], [1.0], [plate], f, X, Y, z)
    before, after, deep, behind = np.moveaxis(B, 2, 0) if sign > 0 else np.moveaxis(B, 2, 0)[::-1]
    largest = np.abs(before).max()
    # B_z = (1 − j)/2 δ div B_t there, and B_t changes over the height of 4 mm
    assert np.abs(before[..., 2]).max() < 1.5 * skin / 4e-3 * largest
    # B is continuous at the face, to a path of 20 nm of a field that falls over 49 µm
    np.testing.assert_allclose(before, after, atol=1e-3 * largest)
    assert np.abs(deep).max() == pytest.approx(np.exp(-5) * largest, rel=0.05)  # δ/4 mm, twice
    assert np.abs(behind).max() < np.exp(-2e-3 / skin) * largest
    # far to its side, where the image is another loop in the opposite sense, and against a plate far away
    distant = Plate("distant", sign * 2.0, 1e-3, plate.material)
    free = magnetic_field([LOOP], grid_points(X, Y, z[:1]))
    alone = plate_field([LOOP], [1.0], [distant], f, X, Y, z[:1])
    np.testing.assert_allclose(alone, free, atol=1e-5 * np.abs(free).max())


def test_sheets_are_mirrors_of_their_own_strength():
    permeability = 3.0
    thick = [Sheet("base", 4e-3), Sheet("magnetic", 1.0, permeability)]  # without end upwards
    z = np.array([1e-3, 3e-3])
    image = LOOP * [1, 1, -1] + [0, 0, 8e-3]
    expected = (permeability - 1) / (permeability + 1) * magnetic_field([image], grid_points(X, Y, z))
    expected += magnetic_field([LOOP], grid_points(X, Y, z))
    far = Plate("far", -50.0, 1e-3, PERFECT)
    found = plate_field([LOOP], [1.0], [far], 1e6, X, Y, z, thick)
    np.testing.assert_allclose(found, expected, atol=CUT * np.abs(expected).max())


def test_divergence_and_phase_of_the_field_inside_a_plate():
    copper, f = MATERIALS["copper"], 2e3  # its skin depth of 1.5 mm is about the thickness
    plate, h = Plate("above", 3e-3, 2e-3, copper), 0.05e-3
    axis = np.array([-h, 0.0, h])
    B = plate_field([LOOP], [1.0], [plate], f, 5e-3 + axis, 1e-3 + axis, 4e-3 + axis)
    slopes = np.array([B[2, 1, 1, 0] - B[0, 1, 1, 0], B[1, 2, 1, 1] - B[1, 0, 1, 1], B[1, 1, 2, 2] - B[1, 1, 0, 2]])
    assert abs(slopes.sum()) < 1e-3 * np.abs(slopes).max()  # second differences of a field that changes over 1 mm
    # ∇²B = jωµσ B
    second = sum(np.roll(B, 1, k)[1, 1, 1] + np.roll(B, -1, k)[1, 1, 1] - 2 * B[1, 1, 1] for k in range(3)) / h**2
    wanted = 2j * np.pi * f * MU_0 * copper.conductivity * B[1, 1, 1]
    np.testing.assert_allclose(second, wanted, rtol=2e-3, atol=2e-3 * np.abs(wanted).max())


@pytest.mark.slow
def test_currents_of_thin_plates_make_the_flux_and_take_the_power_that_they_say():
    f, t, conductivity = 1e5, 1e-5, 5e6  # much thinner than the skin depth of 0.7 mm
    plates = [Plate("above", 4e-3, t, Material("foil", conductivity)), Plate("below", -6e-3, t, Material("b", 3e6))]
    x = np.linspace(-110e-3, 110e-3, 111)  # no wave of this step is left at the plates
    step = x[1] - x[0]
    K = plate_currents([LOOP], [1.0], plates, f, x, x, blur=0.1e-3)
    middle, along = (LOOP[1:] + LOOP[:-1]) / 2, np.diff(LOOP, axis=0)[:, :2]
    flux = 0j
    for plate, density in zip(plates, K, strict=True):
        cells = grid_points(x, x, plate.z).reshape(-1, 3)
        away = 1 / np.linalg.norm(middle[:, None] - cells, axis=-1)
        A = MU_0 / (4 * np.pi) * step**2 * away @ density.reshape(-1, 2)
        flux += (A * along).sum()
    power = sum((np.abs(K[n]) ** 2).sum() * step**2 / (p.material.conductivity * t) for n, p in enumerate(plates))
    # ΔZ = jω flux per ampere, its resistance what heats the plates; cut at 110 mm, where (8/110)² is left
    assert flux == pytest.approx(plate_inductance([LOOP], plates, [f])[0, 0, 0], rel=5e-3)
    assert -2 * np.pi * f * flux.imag == pytest.approx(power, rel=5e-3)
    # and B of the currents is the change of B
    at = np.array([3e-3, 2e-3, 1e-3])
    change = plate_field([LOOP], [1.0], plates, f, at[:1], at[1:2], at[2:])[0, 0, 0] - magnetic_field([LOOP], at)
    B = np.zeros(3, dtype=complex)
    for plate, density in zip(plates, K, strict=True):
        away = at - grid_points(x, x, plate.z).reshape(-1, 3)
        flat = np.column_stack((density.reshape(-1, 2), np.zeros(density[..., 0].size)))
        B += 1e-7 * step**2 * (np.cross(flat, away) / np.linalg.norm(away, axis=1)[:, None] ** 3).sum(axis=0)
    np.testing.assert_allclose(B, change, atol=5e-3 * np.abs(change).max())


def test_heights_beside_the_copper_are_refused():
    plate = Plate("above", 5e-3, 1e-3, PERFECT)
    with pytest.raises(MetalError, match=r"below its copper at -0\.1 mm; got a height of -0\.05 mm"):
        plate_field([LOOP], [1.0], [plate], 1e6, X, Y, np.array([-0.05e-3]))
    with pytest.raises(MetalError, match="wavenumbers; 1500 are allowed"):
        plate_currents([LOOP], [1.0], [Plate("on it", 0.0, 1e-3, PERFECT)], 1e6, X, Y, blur=1e-6)
