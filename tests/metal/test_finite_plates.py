"""Eddy currents in finite plates, against closed forms, the infinite plate, finite elements and a turn of wire.

A plate's moment in a uniform field, and ΔL of loops nearby. Tolerances are the stated errors, unless a test measures
the error itself or an identity that holds on every mesh. Several plates, and those
between infinite ones, are in `test_coupled_plates`.
"""

import math
from dataclasses import replace

import numpy as np
import pytest
import shapely
from support.axial_plates import AxialPlate, axial_change, sphere_body
from support.coil_paths import loop
from support.refusals import refused

from coilarray import inductance_matrix
from coilarray.constants import MU_0
from coilarray.electromagnetics.field import vector_potential
from coilarray.electromagnetics.flat_layer import magnetic_slab
from coilarray.errors import GeometryError, MetalError
from coilarray.geometry import Conductor, Sheet
from coilarray.geometry.bodies import MATERIALS, Disc, FinitePlate, Material, Plate, Polygon, Rectangle, Ring
from coilarray.metal import coupled_plates
from coilarray.metal.finite_plates import eddy_currents, moving_plate
from coilarray.metal.flat_plates import plate_inductance
from coilarray.metal.half_body import EddyBody, SurfaceImpedance, surface_impedance
from coilarray.metal.plate_mesh import plate_meshes

ALUMINIUM = MATERIALS["aluminium"]
PERFECT = SurfaceImpedance(0, 0, 0, 0)
SHEETS = (Sheet("base", 1e-3), Sheet("magnetic", 1e-3, 2.7))


def disc(radius=10e-3, thickness=1e-3, material=ALUMINIUM, **more):
    return FinitePlate("disc", Disc(radius), (0.0, 0.0, 3e-3), thickness, material, **more)


def moment(body, impedance, field=(0.0, 0.0, 1.0)):
    """Magnetic moment along a uniform field of 1 T in A·m²."""
    B = np.broadcast_to(np.array(field), (1, len(body.points), 3))
    fluxes = body.linked(B)
    return sum(
        complex(-(b.T @ np.linalg.solve(parity.matrix(impedance), b))[0, 0])
        for parity, b in zip(body.parities, fluxes, strict=True)
    )


def mesh_share(error):
    """The error with the part of the mesh alone."""
    return replace(error, absolute=error.mesh)


@pytest.mark.slow
def test_disc_in_a_uniform_field():
    """Perfect: −8a³H/3, for a thickness of a/1000 up to some t/a ln(a/t); resistive: −jωBσt πa⁴/8."""
    a, t, f = 10e-3, 1e-5, 1.0
    body = EddyBody(plate_meshes(Disc(a), t)[1])
    assert moment(body, PERFECT) == pytest.approx(-8 / 3 * a**3 / MU_0, rel=5e-3)
    weak = moment(body, surface_impedance(ALUMINIUM, t, f, 2 / a))
    assert weak.imag == pytest.approx(-2 * np.pi * f * ALUMINIUM.conductivity * t * np.pi * a**4 / 8, rel=5e-3)
    assert abs(weak.real) < 1e-4 * abs(weak.imag)


@pytest.mark.slow
def test_order_of_convergence():
    """Linear elements: the second order, here of the resistive disc whose moment is known."""
    a, t, f = 10e-3, 1e-4, 1.0
    exact = -2 * np.pi * f * ALUMINIUM.conductivity * t * np.pi * a**4 / 8
    coarse, fine = (
        moment(EddyBody(mesh), surface_impedance(ALUMINIUM, t, f, 1.0)).imag / exact - 1
        for mesh in plate_meshes(Disc(a), t)
    )
    assert 1.9 < math.log2(coarse / fine) < 2.1
    assert abs(fine + (fine - coarse) / 3) < 2e-4  # what the next order leaves


@pytest.mark.slow
def test_sphere_in_a_uniform_field():
    """A shell with E = Z K: K = −½jωaB/(Z + ⅓jωµ0 a) sin θ, of the moment 4πa³K/3; both parities carry it."""
    a = 5e-3
    sphere = sphere_body(a, 1.2)
    skin = MU_0 * 0.3e-3 * (0.5 - 0.5j)
    for impedance, share in ((PERFECT, 0.0), (SurfaceImpedance(skin, skin, skin, skin), skin)):
        exact = -2 * np.pi * a**3 / (3 * (share / a + MU_0 / 3))
        assert moment(sphere, impedance) == pytest.approx(exact, rel=1e-2)
        assert moment(sphere, impedance, (1.0, 0.0, 0.0)) == pytest.approx(exact, rel=1e-2)


@pytest.mark.slow
@pytest.mark.parametrize("sheets", [(), SHEETS])
def test_a_wide_plate_is_one_without_end(sheets):
    loops, f = [loop(5e-3), loop(4e-3, -0.5e-3, centre=(2e-3, 0.0))], [2e3, 2e5]
    plate = FinitePlate("wide", Disc(20e-3), (0.0, 0.0, 3.5e-3), 1e-3, ALUMINIUM)
    error = moving_plate(loops, plate, [plate.centre], f, sheets, fineness=0.6)
    without_end = plate_inductance(loops, [Plate("wide", 3e-3, 1e-3, ALUMINIUM)], f, sheets)
    off, said = error.change[0] - without_end, error.absolute[0]
    assert (np.abs(off.real) < said.real + 1e-2 * np.abs(without_end.real)).all()  # 1 %: the rim, 15 mm away
    assert (np.abs(off.imag) < said.imag + 1e-2 * np.abs(without_end.imag)).all()
    assert mesh_share(error).inductance < 0.02


@pytest.mark.slow
def test_axisymmetric_finite_elements():
    """A disc of 2 mm that is 0.8 skin depths thick. λ is taken at one κ: 4.3 %."""
    frequency = 1e3
    radii, metal = (8e-3, 4e-3), AxialPlate(0.0, 10e-3, -1e-3, 1e-3, ALUMINIUM.conductivity)
    reference = np.array([axial_change([(a, -3e-3)], metal, frequency) for a in radii])
    plate = disc(thickness=2e-3)
    error = moving_plate([loop(a, sides=180) for a in radii], plate, [plate.centre], [frequency])
    change, said = error.change[0, 0], error.absolute[0, 0].diagonal()
    assert (np.abs(change.diagonal().real - reference.real) < said.real).all()
    assert (np.abs(change.diagonal().imag - reference.imag) < said.imag).all()
    assert error.inductance < 0.25
    assert mesh_share(error).inductance < 0.01


@pytest.mark.slow
@pytest.mark.parametrize(
    ("radius", "thickness", "errors"),
    [(7e-3, 35e-6, (1e-3, 0.01)), (6e-3, 0.5e-3, (2e-3, 0.03)), (4e-3, 1e-3, (4e-3, 0.12))],
    ids=["copper pour", "11 skin depths", "22 skin depths, within the loop"],
)
def test_axisymmetric_finite_elements_at_two_megahertz(radius, thickness, errors):
    """The losses of a thick plate crowd into its sharp rim; the model errs by 11 % where the rim has most of them."""
    a, gap, f, copper = 5e-3, 1e-3 if radius > 5e-3 else 1.5e-3, 2e6, MATERIALS["copper"]
    metal = AxialPlate(0.0, radius, -thickness / 2, thickness / 2, copper.conductivity)
    reference = axial_change([(a, -gap - thickness / 2)], metal, f)
    plate = FinitePlate("disc", Disc(radius), (0.0, 0.0, gap + thickness / 2), thickness, copper)
    said = moving_plate([loop(a, sides=180)], plate, [plate.centre], [f])
    change = said.change[0, 0, 0, 0]
    assert change.real == pytest.approx(reference.real, rel=errors[0])
    assert change.imag == pytest.approx(reference.imag, rel=errors[1])
    assert abs(change.real / reference.real - 1) < said.inductance
    assert abs(change.imag / reference.imag - 1) < said.resistance
    assert said.depths == pytest.approx(thickness / copper.skin_depth(f))


def polyline(radius, start, stop):
    angle = np.linspace(start, stop, 97)
    return list(zip((radius * np.cos(angle)).tolist(), (radius * np.sin(angle)).tolist(), strict=True))


def slotted(radius, inner, degrees=4.0):
    """A ring that is cut along a slot."""
    half = math.radians(degrees) / 2
    return Polygon((*polyline(radius, half, 2 * np.pi - half), *polyline(inner, 2 * np.pi - half, half)))


NARROW = {
    # ΔR in nΩ at 1 kHz by Poisson's equation and Faraday's law in the plane, ΔL and ΔR/ω in nH by axisymmetric finite
    # elements
    "slotted ring 10/8 mm": (slotted(10e-3, 8e-3), (0.0, 0.0, 2e-3), 1e3, None, 0.2858 / (2e3 * np.pi)),
    "slotted ring 10/3 mm": (slotted(10e-3, 3e-3), (0.0, 0.0, 2e-3), 1e3, None, 306.58 / (2e3 * np.pi)),
    "strip 30 x 4 mm": (Rectangle(30e-3, 4e-3), (0.0, 8e-3, 2e-3), 1e3, -4.13e-6, 3.8878 / (2e3 * np.pi)),
    "ring 10/8 mm, 100 kHz": (Ring(10e-3, 8e-3), (0.0, 0.0, 2e-3), 1e5, -4.7688, 1.9397e6 / (2e5 * np.pi)),
    "ring 10/8 mm, 2 MHz": (Ring(10e-3, 8e-3), (0.0, 0.0, 2e-3), 2e6, -6.9444, 3.7783e6 / (4e6 * np.pi)),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", NARROW)
def test_narrow_plates_against_other_methods_within_the_stated_errors(name):
    """Copper of 35 µm, 2 mm over a loop of 8 mm, by its local width; what is stated stays below 6 %."""
    outline, place, f, L, R = NARROW[name]
    plate = FinitePlate("narrow", outline, (0.0, 0.0, 0.0), 35e-6, MATERIALS["copper"])
    error = moving_plate([loop(8e-3, sides=360)], plate, [place], [f], fineness=0.6)
    change = error.change
    assert abs(-1e9 * change.imag.item() - R) < 1e9 * error.absolute.imag.item()
    assert error.resistance < 0.06
    if L is not None:
        assert abs(1e9 * change.real.item() - L) < 1e9 * error.absolute.real.item()
        assert mesh_share(error).inductance < 0.1


@pytest.mark.slow
def test_what_the_rim_errs_is_said_where_currents_reach_it():
    """13 % of ΔR within the coil or across it, through a hole too; nothing far beyond it, or in a perfect conductor.

    Beside what the mesh errs, a coarse one here.
    """
    coil, f = [loop(5e-3, sides=60)], [2e6]

    def said(outline, x=0.0, **changes):
        plate = FinitePlate("plate", outline, (x, 0.0, 2e-3), 1e-3, MATERIALS["copper"])
        error = moving_plate(coil, replace(plate, **changes), [(x, 0.0, 2e-3)], f, fineness=0.25)
        return error.inductance - mesh_share(error).inductance, error.resistance - mesh_share(error).resistance

    for one in (said(Disc(4e-3)), said(Disc(20e-3), 17e-3), said(Ring(20e-3, 1e-3))):
        assert one[1] == pytest.approx(0.13, abs=0.02)
        assert one[0] < 0.03
    assert said(Disc(20e-3))[1] < 0.01
    # 1 mm beyond the coil, 1.5 mm from it
    assert said(Disc(6e-3))[1] == pytest.approx(0.13 / (1 + 1 / 1.5**2) ** 2, abs=1e-2)
    assert said(Disc(4e-3), thickness=5e-6)[1] < 0.005
    assert said(Disc(4e-3), material=Material("perfect", math.inf))[1] == 0.0


@pytest.mark.slow
def test_a_slender_ring_is_a_turn_of_wire():
    """ΔL = −M²/(L + R/jω) of a turn with a uniform current; a ring that is cut open carries none around."""
    ring, f = FinitePlate("ring", Ring(8.5e-3, 7.5e-3), (0.0, 0.0, 3e-3), 0.1e-3, MATERIALS["stainless_steel"]), 5e3
    coil = loop(6e-3)
    turn = Conductor(loop(8e-3, 3e-3), 1e-3, 0.1e-3, name="turn")
    L = inductance_matrix([turn, Conductor(coil, 1e-5, 1e-5, name="coil")])
    R = 2 * np.pi * 8e-3 / (ring.material.conductivity * 1e-3 * 0.1e-3)
    expected = -(L[0, 1] ** 2) / (L[0, 0] + R / (2j * np.pi * f))
    (change,) = moving_plate([coil], ring, [ring.centre], [f], fineness=0.35).change.ravel()
    assert change == pytest.approx(expected, rel=1e-2)
    angle = np.linspace(0.02, 2 * np.pi - 0.02, 60)
    arc = np.column_stack((np.cos(angle), np.sin(angle)))
    corners = tuple(map(tuple, np.concatenate((8.5e-3 * arc, 7.5e-3 * arc[::-1])).tolist()))
    (cut,) = moving_plate(
        [coil], replace(ring, outline=Polygon(corners)), [ring.centre], [f], fineness=0.3
    ).change.ravel()
    assert abs(cut) < 0.05 * abs(change)


@pytest.fixture(scope="module")
def three_loops():
    return [loop(10e-3), loop(11e-3, -1e-3, 6, (4e-3, 0.0)), loop(12e-3, 0.0, 4, (0.0, -5e-3))]


@pytest.mark.slow
def test_losses_reciprocity_and_distance(three_loops):
    """ΔR is positive semidefinite and ΔM symmetric; far away ΔL falls as the coil's dipole field squared, z⁻⁶."""
    positions = [[1e-3, 2e-3, 3e-3], [5e-3, 0.0, 4e-3], [0.0, 0.0, 0.3], [0.0, 0.0, 0.6]]
    change = moving_plate(three_loops, disc(5e-3), positions, [1e4, 1e6], fineness=0.5).change
    assert (np.linalg.eigvalsh(-change.imag) > -1e-9 * np.abs(change.imag).max(axis=(2, 3))[..., None]).all()
    np.testing.assert_array_equal(change, change.transpose(0, 1, 3, 2))
    assert (np.linalg.eigvalsh(change.real) < 1e-9 * np.abs(change.real).max(axis=(2, 3))[..., None]).all()
    np.testing.assert_allclose(change[2, :, 0, 0] / change[3, :, 0, 0], 64, rtol=1e-2)


@pytest.mark.slow
def test_tilting_the_plate_is_tilting_the_coils(three_loops):
    angle, towards = 0.2, 0.7
    tilted = disc(5e-3, tilt=angle, tilt_direction=towards)
    flat = replace(tilted, tilt=0.0)
    change = moving_plate(three_loops, tilted, [[1e-3, 0.0, 8e-3]], [1e5], fineness=0.5).change
    turned = [path @ tilted.axes.T for path in three_loops]
    centre = tilted.axes @ [1e-3, 0.0, 8e-3]
    np.testing.assert_allclose(moving_plate(turned, flat, [centre], [1e5], fineness=0.5).change, change, rtol=1e-6)


@pytest.mark.slow
def test_fields_from_a_grid_are_those_of_the_segments(three_loops, monkeypatch):
    x, y = np.meshgrid(np.linspace(-8e-3, 8e-3, 5), np.linspace(-5e-3, 5e-3, 3))
    positions = np.column_stack((x.ravel(), y.ravel(), np.full(x.size, 4e-3)))
    change = moving_plate(three_loops, disc(5e-3), positions, [1e6], SHEETS, fineness=0.3).change
    monkeypatch.setattr(coupled_plates, "_STEP", 1e-6)
    direct = moving_plate(three_loops, disc(5e-3), positions, [1e6], SHEETS, fineness=0.3).change
    np.testing.assert_allclose(change, direct, atol=1e-5 * np.abs(direct).max(), rtol=0)


@pytest.mark.slow
@pytest.mark.parametrize("sheets", [(), SHEETS])
def test_currents_make_the_change_of_inductance(three_loops, sheets):
    """ΔL = ∫ K·A with the coil's potential, where ΔL itself is from B: each its own rule on a triangle."""
    plate, slab = disc(6e-3, tilt=0.05, tilt_direction=1.0), magnetic_slab(sheets)
    ((found,),) = eddy_currents(three_loops, [plate], [1e5], sheets, fineness=0.25)
    change = moving_plate(three_loops, plate, [plate.centre], [1e5], sheets, fineness=0.25).change[0, 0]
    edges = found.corners[:, 1:] - found.corners[:, :1]
    area = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1) / 2
    middles, A = found.corners.mean(axis=1), np.zeros((3, len(area), 3))
    copies = [(1.0, 0.0)]
    if slab is not None:  # 4µ/((µ + 1)² − (µ − 1)² e^{−2kt}), in its own series, of powers of 0.46²
        copies = [(slab.transmission * slab.reflection ** (2 * n), 2 * n * slab.thickness) for n in range(5)]
    for weight, lift in copies:
        A += [weight * vector_potential(path, middles + np.array([0.0, 0.0, lift])) for path in three_loops]
    linked = np.einsum("itc,jtc,t->ij", A, found.density, area)
    np.testing.assert_allclose(linked, change, rtol=2e-2)


@pytest.mark.parametrize(
    ("plate", "position", "frequency", "message"),
    [
        (disc(), [0, 0, 0.4e-3], 1e6, "must lie above z = 0 mm, the highest copper"),
        (disc(thickness=8e-3), [0, 0, 6e-3], 50.0, "has a skin depth of 12 mm at 50 Hz, so that its ΔL would have"),
        (disc(), [0, 0], 1e6, r"positions of a plate must be finite, of shape \(n, 3\)"),
    ],
)
def test_refusals(plate, position, frequency, message):
    with pytest.raises(GeometryError, match=message):
        moving_plate([loop(8e-3)], plate, [position], [frequency])


def test_refusals_of_nothing_and_of_no_mesh():
    def solved(places=((0.0, 0.0, 3e-3),), frequencies=(1e6,), **options):
        return moving_plate([loop(8e-3)], disc(), places, frequencies, **options).change

    refused(GeometryError, r"in m, at least one; got shape \(0, 3\)", solved, np.zeros((0, 3)))
    for frequencies in ([], [0.0], [np.nan], 1e6):
        message = "frequencies must be one row of positive and finite numbers; got"
        refused(MetalError, message, solved, frequencies=frequencies)
    for fineness in (0.0, -1.0, math.nan, math.inf):
        refused(GeometryError, f"fineness of a mesh must be positive .*; got {fineness}", solved, fineness=fineness)


@pytest.mark.parametrize("thickness", [0.1e-3, 1e-3, 5e-3])
@pytest.mark.parametrize(
    "outline",
    [
        Disc(5e-3), Ring(5e-3, 2e-3), Rectangle(20e-3, 10e-3), Rectangle(60e-3, 5e-3),
        Polygon(((0, 0), (10e-3, 0), (0, 10e-3))),
    ],
)  # fmt: skip
def test_no_triangle_is_degenerate(outline, thickness):
    """The faces have the outline's area and the rim its length, at half of the least fineness of a target map too."""
    for fineness in (0.1, 0.25, 0.5):
        _, mesh = plate_meshes(outline, thickness, fineness)
        a, b, c = np.moveaxis(mesh.corners, 1, 0)
        area = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
        longest = np.max([np.linalg.norm(side, axis=1) for side in (b - a, c - b, a - c)], axis=0)
        # height over longest side; strips along the rim of a thin plate are the flattest, of 0.5 % here
        assert (2 * area / longest**2).min() > 2e-3
        plane = shapely.Polygon(outline.exterior, outline.holes)
        # a circle of as few sides as the coarsest rim has lies within 10 %
        assert area[~mesh.rim].sum() == pytest.approx(plane.area, rel=0.1)
        assert area[mesh.rim].sum() == pytest.approx(plane.length * thickness / 2, rel=0.1)


def test_coils_without_an_extent_across():
    """A loop on its edge, and a straight filament beside it, of which the mesh needs no finest triangle."""
    upright = loop(8e-3) @ [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]] - [0.0, 0.0, 9e-3]
    straight = [[-5e-3, 2e-3, 0.0], [5e-3, 2e-3, 0.0]]
    change = moving_plate([upright, straight], disc(3e-3), [[0.0, 0.0, 3e-3]], [1e6], fineness=0.5).change[0, 0]
    assert (change.diagonal().real < 0).all()
    assert (change.diagonal().imag < 0).all()
