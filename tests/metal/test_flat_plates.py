"""Infinite plates: inductance, field and currents against closed forms, limits and another method.

Who checks whom: circular loops and the integrals of Dodd & Deeds; a perfect conductor and mirror images; an iron plate
at rest and a magnetic sheet; images for short waves and waves alone; the currents, their power and their inductance.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
import pytest
import scipy.special
from scipy.integrate import quad_vec
from support.coil_paths import loop

from coilarray import load_design
from coilarray.compute.arrays import FloatArray
from coilarray.constants import MU_0
from coilarray.electromagnetics.field import grid_points, magnetic_field
from coilarray.electromagnetics.flat_layer import layer_inductance
from coilarray.electromagnetics.inductance import mutual_inductance
from coilarray.errors import ElastomerError, GeometryError, MetalError
from coilarray.geometry import MATERIALS, Conductor, Material, Plate, Sheet
from coilarray.metal import flat_plates
from coilarray.metal.flat_plates import plate_currents, plate_field, plate_inductance, plate_inductances

ALUMINIUM, COPPER, STEEL = (MATERIALS[name] for name in ("aluminium", "copper", "steel"))
PERFECT = Material("perfect conductor", math.inf)
F = np.array([1e3, 1e5, 1e7])
SHEETS = [Sheet("base", 3e-3), Sheet("magnetic", 1e-3, 2.5)]


LOOPS = [loop(10e-3, -0.5e-3, 6), loop(8e-3, -1e-3, 5, (7e-3, 3e-3)), loop(6e-3, -0.2e-3, 4, (-20e-3, 0.0))]


def dodd_deeds(radius: float, height: float, plate: Plate) -> npt.NDArray[np.complex128]:
    """ΔZ/jω (f,) of a circular filament above a plate: Dodd & Deeds (1968), with the reflection of one layer."""
    mu, d = plate.material.relative_permeability, plate.thickness

    def at(k: float) -> npt.NDArray[np.complex128]:
        gamma = np.sqrt(k**2 + 2j * np.pi * F * MU_0 * mu * plate.material.conductivity)
        back = np.exp(-2 * gamma * d)
        r = ((mu * k) ** 2 - gamma**2) * (1 - back) / ((mu * k + gamma) ** 2 - (mu * k - gamma) ** 2 * back)
        return np.asarray(r * np.exp(-2 * k * height) * scipy.special.j1(k * radius) ** 2)

    return np.asarray(np.pi * MU_0 * radius**2 * quad_vec(at, 0, 40 / height, epsrel=1e-7, limit=200)[0])


@pytest.mark.parametrize("material", [ALUMINIUM, STEEL, Material("lossless iron", 0.0, 50.0)], ids=lambda one: one.name)
@pytest.mark.parametrize("thickness", [0.1e-3, 50e-3], ids=["thin", "half-space"])
def test_circular_loop(material: Material, thickness: float) -> None:
    """The same on both sides; 120 sides stand for a circle to 1e-4."""
    for z in (2e-3, -2e-3 - thickness):
        plate = Plate("plate", z, thickness, material)
        change = plate_inductance([loop(10e-3, 0.0, 120)], [plate], F)[:, 0, 0]
        np.testing.assert_allclose(change, dodd_deeds(10e-3, 2e-3, plate), rtol=2e-4)


@pytest.mark.slow
def test_a_perfect_conductor_is_a_mirror() -> None:
    """Images with the current reversed, above, below, and again and again between two plates."""
    below, above = Plate("below", -3e-3, 1e-3, PERFECT), Plate("above", 4e-3, 1e-3, PERFECT)

    def image(height: float) -> FloatArray:
        return -mutual_inductance(LOOPS, [path * [1, 1, -1] + [0, 0, 2 * height] for path in LOOPS])

    np.testing.assert_allclose(plate_inductance(LOOPS, [above], [1.0])[0], image(4e-3), atol=1e-6 * 3e-8)
    np.testing.assert_allclose(plate_inductance(LOOPS, [below], [1.0])[0], image(-2e-3), atol=1e-6 * 3e-8)
    both, between = plate_inductance(LOOPS, [below, above], [1.0])[0], 6e-3
    series = np.zeros_like(both.real)
    for n in range(-25, 26):  # the rest falls as 1/n²
        series += image(4e-3 + n * between)
        if n:
            series += mutual_inductance(LOOPS, [path + np.array([0, 0, 2 * n * between]) for path in LOOPS])
    np.testing.assert_allclose(both, series, atol=1e-4 * np.abs(series).max())


def test_an_iron_plate_at_rest_is_a_magnetic_sheet() -> None:
    sheets, mu = [Sheet("air", 3e-3), Sheet("iron", 1e-3, 20.0)], Material("iron", 0.0, 20.0)
    change = plate_inductance(LOOPS, [Plate("iron", 3e-3, 1e-3, mu)], F)
    np.testing.assert_allclose(change, np.tile(layer_inductance(LOOPS, sheets), (3, 1, 1)), rtol=0, atol=1e-14)
    rusty = Material("conducting iron", 1e6, 20.0)
    slow = plate_inductance(LOOPS, [Plate("iron", 3e-3, 1e-3, rusty)], [1e-3])
    np.testing.assert_allclose(slow[0], layer_inductance(LOOPS, sheets), rtol=1e-4)


@pytest.mark.slow
def test_plates_with_sheets() -> None:
    """A magnetic sheet given as a plate without losses changes what another plate does as the sheet itself."""
    plates = [Plate("target", 6e-3, 0.5e-3, STEEL), Plate("ground", -2e-3, 35e-6, ALUMINIUM)]
    iron = Plate("sheet", 3e-3, 1e-3, Material("magnetic", 0.0, 2.5))
    change = plate_inductance(LOOPS, plates, F, SHEETS)
    whole = plate_inductance(LOOPS, [*plates, iron], F) - layer_inductance(LOOPS, SHEETS)
    np.testing.assert_allclose(change, whole, rtol=0, atol=1e-6 * np.abs(change).max())
    assert np.abs(change - plate_inductance(LOOPS, plates, F)).max() > 1e-3 * np.abs(change).max()


def test_reciprocity_losses_and_screening() -> None:
    """Symmetric; losses that no currents make negative; at high frequency a plate screens as a perfect one, at low one
    it does nothing, and in between, where the skin depth squared is its thickness times the distance of the image, the
    losses peak: ωμσd/2 = 1/2h there."""
    f = np.geomspace(1.0, 1e9, 37)
    change = plate_inductance(LOOPS, [Plate("target", 3e-3, 1e-3, ALUMINIUM)], f)
    np.testing.assert_array_equal(change, change.swapaxes(1, 2))
    losses, inductance = -change.imag, change.real
    assert (np.linalg.eigvalsh(losses) > -1e-7 * losses.max(axis=(1, 2))[:, None]).all()
    assert (np.diff(inductance[:, 0, 0]) < 0).all()
    perfect = plate_inductance(LOOPS, [Plate("target", 3e-3, 1e-3, PERFECT)], [1.0])[0].real
    np.testing.assert_allclose(inductance[-1], perfect, rtol=2e-3)  # at a depth of 2.7 µm
    assert (np.diag(inductance[0] / perfect) < 1e-5).all()
    depth = ALUMINIUM.skin_depth(f[losses[:, 0, 0].argmax()])
    assert depth == pytest.approx(math.sqrt(1e-3 * 7e-3), rel=0.1)


def test_far_and_transparent_plates_do_nothing() -> None:
    """Seen from afar a perfect plate has the field of the loop's dipole, −µ0 m²/(2π (2h)³)."""
    far = plate_inductance(LOOPS[:1], [Plate("target", 0.4995, 1e-3, PERFECT)], [1e6])[0, 0, 0]
    assert far.real == pytest.approx(-MU_0 * (math.pi * 1e-4) ** 2 / (2 * math.pi), rel=2e-3)
    assert not plate_inductance(LOOPS, [], F).any()
    weak = plate_inductance(LOOPS, [Plate("sea", 3e-3, 1e-3, Material("sea water", 5.0))], [1e3])
    assert np.abs(weak).max() < 1e-4 * 8e-9  # of what a perfect one does


@pytest.mark.slow
@pytest.mark.parametrize("gap", [0.1e-3, 0.4e-3])
def test_images_take_the_short_waves(gap: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """A copper pour under a coil: images for its short waves, or all of them in the spectrum, differ by 3e-6."""
    coil = Conductor(np.vstack([loop(r, -0.5e-3, 6)[:-1] for r in (5e-3, 4.5e-3, 4e-3)]), 0.2e-3, 35e-6)
    pour = Plate("pour", -0.5e-3 - 17.5e-6 - gap - 35e-6, 35e-6, MATERIALS["copper"])
    quick = plate_inductance([coil], [pour], F, SHEETS)
    monkeypatch.setattr(flat_plates, "_AROUND", math.inf)
    waves = plate_inductance([coil], [pour], F, SHEETS)
    np.testing.assert_allclose(quick, waves, rtol=0, atol=5e-6 * np.abs(waves).max())


def test_cases_are_those_of_one_by_one() -> None:
    cases = [[Plate("target", z, 1e-3, ALUMINIUM)] for z in (4e-3, 9e-3)] + [[], [Plate("under", -9e-3, 1e-3, STEEL)]]
    together = plate_inductances(LOOPS, cases, F, SHEETS)
    for case, change in zip(cases, together, strict=True):
        alone = plate_inductance(LOOPS, case, F, SHEETS)
        np.testing.assert_allclose(change, alone, rtol=0, atol=1e-6 * np.abs(together).max())


def test_coils_of_a_board_keep_their_sum_over_pieces() -> None:
    """The coils of a board share spectra by shape; whole coils have what their halves add up to."""
    coils = load_design("starter").array.conductors()
    plate = [Plate("shield", -4e-3, 0.5e-3, ALUMINIUM)]
    whole = plate_inductance(coils, plate, F)
    first = coils[0]
    halves = [
        Conductor(first.vertices[part], first.widths[edge], first.thicknesses[edge])
        for part, edge in ((slice(0, 60), slice(0, 59)), (slice(59, None), slice(59, None)))
    ]
    pieces = plate_inductance([*halves, *coils[1:]], plate, F)
    np.testing.assert_allclose(pieces[:, :2, :2].sum(axis=(1, 2)), whole[:, 0, 0], rtol=1e-6)


@pytest.mark.parametrize(
    ("heights", "message"),
    [
        ([-0.6e-3], "plate '0' must lie above all paths, from z = -0.0002 m"),
        ([6e-3, 6.2e-3], r"must not overlap; plate '0' lies from z = 0.006 to 0.0063 m and plate '1' begins at 0.0062"),
        ([-9e-3, -9.2e-3], "must not overlap; plate '1' lies"),
        ([3.9e-3], "must not overlap; sheet 'magnetic' lies from z = 0.003 to 0.004 m and plate '0' begins at 0.0039"),
    ],
)
def test_plates_in_the_copper_the_sheets_or_each_other_are_refused(heights: list[float], message: str) -> None:
    plates = [Plate(f"{k}", z, 0.3e-3, ALUMINIUM) for k, z in enumerate(heights)]
    with pytest.raises(GeometryError, match=message):
        plate_inductance(LOOPS, plates, F, SHEETS)


def test_frequencies_and_coils_above_a_magnetic_sheet_are_refused() -> None:
    for wrong in ([math.nan], [-1e6], [[1e6]], []):
        with pytest.raises(MetalError, match="frequencies must be one row of finite numbers of at least 0; got"):
            plate_inductance(LOOPS, [Plate("x", 6e-3, 1e-3, ALUMINIUM)], wrong)
    with pytest.raises(
        ElastomerError, match=r"paths must lie below the magnetic sheet, whose lower face is at z = 0.0"
    ):
        plate_inductance([loop(10e-3, 5e-3, 6)], [Plate("x", 6e-3, 1e-3, ALUMINIUM)], F, SHEETS)


RADIUS = 8e-3
ANGLE = np.linspace(0, 2 * np.pi, 121)
LOOP = np.column_stack((RADIUS * np.cos(ANGLE), RADIUS * np.sin(ANGLE), 0 * ANGLE - 1e-4))
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
