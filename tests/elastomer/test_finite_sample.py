"""A finite sample on an uneven or lifting seat.

Who checks whom: `box` against a uniform stress, a beam on an elastic foundation, its own finer meshes and its volume;
the wide stack of `box` against the finite elements of `contact` and against the force on the seat; `finite_sample`
against the box loaded directly, against the mirror and against its limits; the change of inductance against the
three-dimensional magnetic solution that benchmarks/finite_sample_3d.json keeps.
"""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from support.contacts import coarse_maps, first_coils_design
from support.first_assumed import first_assumed

import coilarray.response.setup as pressing
from coilarray import load_design
from coilarray.circuit.coupling import design_circuit
from coilarray.elastomer.box import Axis, Box, factorised, wide_field
from coilarray.elastomer.contact import DEFAULT_MESH, indent
from coilarray.elastomer.contact_grid import Stack, stack_of
from coilarray.elastomer.finite_sample import DEFAULT_BOX_MESH, BoxMesh, Sample, SampleCorrection, sample_correction
from coilarray.errors import ElastomerError, GeometryError, MemoryLimitError
from coilarray.geometry import EVEN, Hemisphere, Seat, Sheet, Unevenness
from coilarray.response.map import Imperfections, inductance_changes, response_map
from coilarray.response.setup import map_axes

SHEETS = (
    Sheet("base", 6e-3, youngs_modulus=55e3),
    Sheet("magnetic", 2e-3, 2.7, youngs_modulus=166e3),
)
SEAT = Seat(stiffness=4.3e6)
BOUNDS = (-24e-3, -16e-3, 24e-3, 16e-3)
COARSE = BoxMesh(degree=3, edge=1.0, growth=1.0, widest=2.0)
KEPT = Path(__file__).parents[2] / "benchmarks" / "finite_sample_3d.json"


def one_sheet(poisson: float) -> Stack:
    """One sheet of unit thickness and modulus."""
    return stack_of([Sheet("one", 1.0, youngs_modulus=1.0, poissons_ratio=poisson)])


def box_on_springs(
    stack: Stack, x: Axis, y: Axis, normal: float, *, held: bool = False, along: float = 1e-9
) -> tuple[Box, np.ndarray]:
    """A box of one element a sheet on springs per area, and the area of each node of its faces."""
    z = Axis(stack.levels, x.degree)
    area = np.outer(x.weights, y.weights)
    springs = np.array([along, along, normal])[:, None, None] * area
    return factorised((x, y, z), stack.shear, stack.squash, springs, np.full(3, held)), area


def pressed(box: Box, top: np.ndarray) -> np.ndarray:
    """Displacement (nx, 3, ny, nz) under forces downwards on the nodes of the top."""
    loads = np.zeros((*box.shape, 1))
    loads[:, 2, :, -1, 0] = -top
    return box.displacements(loads)[..., 0]


def contact_pressure(radius: float) -> tuple[np.ndarray, np.ndarray]:
    """A smooth pressure in Pa, (1, n), over radii in m: (1 − r²/a²)² of 1 kPa."""
    r = np.linspace(0, radius, 200)
    return r, 1e3 * (1 - (r / radius) ** 2)[None] ** 2


def corrected(
    bounds: tuple[float, float, float, float] = BOUNDS,
    places: tuple[tuple[float, float], ...] = ((0.0, 0.0),),
    unevenness: Unevenness = EVEN,
    base: Seat = SEAT,
    mesh: BoxMesh = COARSE,
    slope: float = 0.0,
    radius: float = 6e-3,
    sheets: tuple[Sheet, ...] = SHEETS,
) -> SampleCorrection:
    r, pressure = contact_pressure(radius)
    sample = Sample(bounds, unevenness, mesh)
    return sample_correction(sheets, base, sample, np.array(places), r, pressure, np.array([slope]))


@pytest.mark.parametrize("poisson", [0.0, 0.3, 0.49])
def test_a_free_box_under_a_uniform_pressure_is_compressed_by_p_over_e(poisson: float) -> None:
    stack = one_sheet(poisson)
    x, y = Axis(np.array([-1.0, 0.2, 1.5]), 2), Axis(np.array([-0.7, 0.7]), 2)
    box, area = box_on_springs(stack, x, y, 0.5)
    u = pressed(box, 0.01 * area)
    # the elements hold linear displacements exactly; the springs along take 1e-9 of the stress
    np.testing.assert_allclose(u[:, 2, :, 0], -0.02, rtol=1e-7)
    np.testing.assert_allclose(u[:, 2, :, -1], -0.03, rtol=1e-7)
    np.testing.assert_allclose(np.ptp(u[:, 0], axis=0), 0.01 * poisson * 2.5, atol=1e-9)


def test_a_nearly_incompressible_box_keeps_its_volume() -> None:
    stack = one_sheet(0.499999)
    x = y = Axis(np.linspace(-2, 2, 5), 3)
    box, area = box_on_springs(stack, x, y, 0.0, held=True)
    u = pressed(box, area * np.exp(-(x.nodes[:, None] ** 2) - y.nodes**2))
    z = box.axes[2]
    top = float((u[:, 2, :, -1] * area).sum())
    sides = 4 * float(np.einsum("yz,y,z->", u[-1, 0], y.weights, z.weights))  # all four are alike
    sunk = float((np.minimum(u[:, 2, :, -1], 0) * area).sum())
    # 1/K = 6e-6/E takes 1e-5 of what is displaced; the rule over a face is exact for its cubics
    assert abs(top + sides) < 1e-3 * abs(sunk)


@pytest.mark.slow
def test_a_long_strip_on_springs_is_a_beam_on_an_elastic_foundation() -> None:
    stack, stiffness = one_sheet(0.3), 1 / 3e4
    beta = (3 * stiffness) ** 0.25  # (k/4EI)^¼ for E = h = 1: a wavelength of 63 thicknesses
    x, y = Axis(np.linspace(-60, 60, 41), 3), Axis(np.array([-0.5, 0.5]), 3)
    box, _ = box_on_springs(stack, x, y, stiffness)
    force = np.zeros((len(x.nodes), len(y.nodes)))
    force[len(x.nodes) // 2] = 1e-4 * y.weights
    sunk = pressed(box, force)[:, 2].mean(axis=(1, 2))
    at = np.abs(x.nodes)
    closed = -1e-4 * beta / (2 * stiffness) * np.exp(-beta * at) * (np.cos(beta * at) + np.sin(beta * at))
    # a beam does not shear: that leaves about (βh)² = 1 %
    assert np.abs(sunk - closed)[at > 2].max() < 0.02 * np.abs(closed).max()


@cache
def energy(elements: int, degree: int) -> float:
    """Twice the energy of a nearly incompressible box under a smooth pressure."""
    stack = one_sheet(0.45)
    x = y = Axis(np.linspace(-2, 2, elements + 1), degree)
    stacked = Stack(1.0, 1.0, np.full(2, 0.5), np.repeat(stack.shear, 2), np.repeat(stack.squash, 2))
    box, _ = box_on_springs(stacked, x, y, 0.3, along=0.1)
    points, rule = x.rule(0.05)
    shapes = x.basis(points) * rule[:, None]
    top = shapes.T @ np.cos(np.pi / 4 * points[:, None]) @ np.cos(np.pi / 4 * points[None]) @ shapes
    return float(-(pressed(box, top)[:, 2, :, -1] * top).sum())


@pytest.mark.slow
@pytest.mark.parametrize(("degree", "least"), [(2, 3.0), (3, 4.0)])
def test_the_energy_converges_with_twice_the_degree(degree: int, least: float) -> None:
    exact = energy(3, 5)
    errors = np.abs([energy(count, degree) / exact - 1 for count in (2, 4)])
    # twice the degree is 4 and 6; the height has the same elements on both meshes, and the edges are not smooth
    assert np.log2(errors[0] / errors[1]) > least


@pytest.mark.slow
@pytest.mark.parametrize("base", [SEAT, "bonded", "frictionless", Seat(4.3e6, 2e6)])
def test_the_wide_field_is_that_of_the_finite_elements_of_the_contact(base: Seat) -> None:
    found = indent(SHEETS, Hemisphere(2.5e-3), [1e-3], base=base, strain="linear")
    stack = stack_of(SHEETS)
    r = found.r.values / stack.length
    pressure = found.pressure.values / stack.stress
    field, _ = wide_field(stack, base, r, pressure, stack.levels, 8.0)
    some = (r > 0.4) & (r < 6)  # beyond the contact, whose pressure is smoothed
    moved = np.moveaxis(np.asarray(field(r[some]))[:, :, 0], 0, -1) * stack.length
    expected = np.array([found.displacement_r.values[0][:, some], found.displacement_z.values[0][:, some]])
    # the smoothing leaves 3e-4 of the depth at twice the contact's radius, less beyond
    np.testing.assert_allclose(moved, expected, atol=1e-3 * 1e-3)


def test_the_seat_carries_the_force_of_the_wide_field() -> None:
    stack = stack_of(SHEETS)
    r, pressure = contact_pressure(4e-3)
    field, _ = wide_field(stack, SEAT, r / stack.length, pressure / stack.stress, stack.levels[:1], 15.0)
    at = np.linspace(0, 15, 3001)
    seat = SEAT.stiffness * np.asarray(field(at))[:, 1, 0, 0] * stack.length
    carried = -np.trapezoid(seat * at, at) * stack.length**2
    # ∫ p r dr = p0 a²/6; beyond 15 thicknesses 1e-4 of it is left
    assert carried == pytest.approx(1e3 * (4e-3) ** 2 / 6, rel=1e-3)


@pytest.mark.slow
def test_wide_field_and_correction_are_the_box_that_is_loaded_directly() -> None:
    place, mesh = np.array([5e-3, 3e-3]), BoxMesh(degree=3, edge=0.6, growth=0.5, widest=1.2)
    uneven = Unevenness(stiffness_slope=(12.0, -8.0))
    found = corrected(places=(tuple(place),), unevenness=uneven, mesh=mesh)
    stack = stack_of(SHEETS)
    r, pressure = contact_pressure(6e-3)
    x, y = (Axis(axis.edges / stack.length, axis.degree) for axis in (found.x, found.y))
    area = np.outer(x.weights, y.weights)
    factor = 1 + 12.0 * found.x.nodes[:, None] - 8.0 * found.y.nodes
    springs = np.zeros((3, *area.shape)) + 1e-6 * area
    springs[2] = SEAT.stiffness * stack.length / stack.stress * factor * area
    axes = x, y, Axis(stack.levels, mesh.degree)
    box = factorised(axes, stack.shear, stack.squash, springs, np.zeros(3, dtype=bool))
    (px, wx), (py, wy) = x.rule(0.02), y.rule(0.02)
    at = np.hypot(px[:, None] * stack.length - place[0], py * stack.length - place[1])
    load = np.interp(at, r, pressure[0], right=0.0) / stack.stress * wx[:, None] * wy
    direct = pressed(box, x.basis(px).T @ load @ y.basis(py))[:, 2, :, [0, mesh.degree]] * stack.length
    field, _ = wide_field(stack, SEAT, r / stack.length, pressure / stack.stress, stack.levels[:2], 8.0)
    distance = np.hypot(found.x.nodes[:, None] - place[0], found.y.nodes - place[1]) / stack.length
    wide = np.asarray(field(distance))[..., 1, 0, :] * stack.length
    total = np.moveaxis(wide, -1, 0) + found.moved[0, 0, :2]
    assert np.abs(found.moved[0, 0, 0]).max() > 0.05 * np.abs(total).max()
    away = distance > 2.5  # two elements from the contact, which the box alone resolves less well than the wide field
    # on the same elements, where one solution has to carry the load of the contact: measured 0.6 % of the correction
    assert np.abs(total - direct)[:, away].max() < 0.01 * np.abs(found.moved[0, 0, :2]).max()


@pytest.mark.slow
def test_the_default_mesh_gives_the_faces_to_a_percent() -> None:
    bounds, places = (-14e-3, -11e-3, 14e-3, 11e-3), ((0.0, 0.0), (7e-3, 4e-3))
    uneven = Unevenness(stiffness_slope=(15.0, -10.0))
    usual, finer = (
        corrected(bounds, places, uneven, mesh=mesh) for mesh in (DEFAULT_BOX_MESH, replace(DEFAULT_BOX_MESH, degree=4))
    )
    shapes = finer.x.basis(usual.x.nodes), finer.y.basis(usual.y.nodes)
    expected = np.einsum("dplxy,ax,by->dplab", finer.moved, *shapes, optimize=True)
    errors = np.abs(usual.moved - expected).max(axis=(0, 1, 3, 4)) / np.abs(expected).max()
    # measured 0.4 and 0.7 %; at the corners of the bottom, where the seat ends, 2.9 %
    assert errors[1:].max() < 0.01
    assert errors[0] < 0.04
    np.testing.assert_allclose(usual.depth, finer.depth, atol=0.01 * np.abs(finer.depth).max())


@pytest.mark.slow
def test_the_default_mesh_gives_the_paper_s_map_to_two_percent_of_what_sides_change(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    design = load_design("gast2020")
    assert design.indentation is not None
    setup = replace(design.indentation, sample_bounds=(-30e-3, -20e-3, 30e-3, 20e-3), strain="linear")
    finite, finer = replace(design, indentation=setup), BoxMesh(degree=4, edge=0.5, growth=0.6, widest=1.0)
    axes = map_axes(finite, x=[-26e-3, 0.0, 13e-3], y=[-6e-3, 3e-3])

    wide = inductance_changes(replace(design, indentation=replace(setup, sample_bounds=None)), axes)[0]

    def changes(mesh: BoxMesh) -> np.ndarray:
        monkeypatch.setattr(pressing, "Sample", lambda bounds, unevenness: Sample(bounds, unevenness, mesh))
        return inductance_changes(finite, axes)[0]

    usual, expected = changes(DEFAULT_BOX_MESH), changes(finer)
    # measured 1.5 %, 0.6 % in a sample of 120 by 23 mm (a mesh that knows nothing of the places: 5.5 and 2.3 %)
    assert np.abs(usual - expected).max() < 0.02 * np.abs(expected - wide).max()


def test_a_sample_too_large_for_the_memory_is_refused_before_the_work(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COILARRAY_MEMORY_GB", "1")
    with pytest.raises(MemoryLimitError, match=r"a sample of 100 by 100 of its thicknesses needs .* sample_x_mm"):
        corrected((-0.4, -0.4, 0.4, 0.4))


@pytest.mark.slow
def test_the_correction_vanishes_far_from_the_sides_of_an_even_seat() -> None:
    near = corrected((-12e-3, -12e-3, 12e-3, 12e-3))
    far = corrected((-70e-3, -70e-3, 70e-3, 70e-3), mesh=replace(COARSE, edge=2.0, widest=4.0))
    # the plate on its seat dies out over 8 mm, and a slow tail slides along the seat
    assert np.abs(far.depth).max() < 0.02 * np.abs(near.depth).max()


@pytest.mark.slow
def test_mirrored_places_on_mirrored_seats_have_mirrored_corrections() -> None:
    one = corrected(places=((9e-3, 4e-3),), unevenness=Unevenness((15.0, 5.0)), slope=500.0)
    two = corrected(places=((-9e-3, 4e-3),), unevenness=Unevenness((-15.0, 5.0)), slope=500.0)
    np.testing.assert_allclose(one.depth, two.depth, rtol=1e-7)  # roundings alone
    np.testing.assert_allclose(one.moved, two.moved[..., ::-1, :], atol=1e-7 * np.abs(one.moved).max())


@pytest.mark.slow
def test_the_sample_gives_way_where_the_seat_is_softer() -> None:
    places = ((-8e-3, 0.0), (8e-3, 0.0))
    soft, stiff = corrected(places=places, unevenness=Unevenness(stiffness_slope=(20.0, 0.0)), slope=500.0).depth[0]
    even = corrected(places=places, slope=500.0).depth[0]
    assert soft < even[0]
    assert even[1] < stiff


def test_a_lifting_seat_only_pushes_and_carries_all_force() -> None:
    weight, slope, force_rise = 0.5, 300.0, 1e3 * 2 * np.pi * (6e-3) ** 2 / 6
    # of one modulus: sheets of several ones curl under their weight
    found = corrected(unevenness=Unevenness(lifts=True, weight=weight), slope=slope, sheets=(SHEETS[0],))
    load = 1 + found.depth[0, 0] * slope
    r = np.hypot(found.x.nodes[:, None], found.y.nodes)
    bottom = -weight / SEAT.stiffness + load * found.beyond(r, 0)[..., 0] + found.moved[0, 0, 0]
    scale = np.abs(bottom).max()
    # pressure k max(0, −u) and gap max(0, u): their product is zero at every node
    np.testing.assert_allclose(found.lifted[0, 0], np.maximum(bottom, 0), atol=1e-9 * scale)
    assert (found.lifted > 0).any()
    area = np.outer(found.x.weights, found.y.weights)
    carried = float((SEAT.stiffness * np.maximum(-bottom, 0) * area).sum())
    # the nodes' rule over the wide field, which is not a polynomial, leaves some 1e-3
    assert carried == pytest.approx(load * force_rise + weight * area.sum(), rel=5e-3)


@pytest.mark.slow
def test_a_heavy_sample_does_not_lift() -> None:
    held = corrected(places=((6e-3, 2e-3),), slope=300.0)
    heavy = corrected(places=((6e-3, 2e-3),), unevenness=Unevenness(lifts=True, weight=1e5), slope=300.0)
    light = corrected(places=((6e-3, 2e-3),), unevenness=Unevenness(lifts=True, weight=0.5), slope=300.0)
    np.testing.assert_allclose(heavy.depth, held.depth, rtol=1e-9)
    assert not heavy.lifted.any()
    assert light.depth[0, 0] < held.depth[0, 0]  # without the pull of the seat the sample is softer


@pytest.mark.slow
def test_a_light_sample_balances_on_the_line_where_the_seat_falls_away() -> None:
    level = corrected(unevenness=Unevenness(lifts=True, weight=5.0))
    falling = corrected(unevenness=Unevenness(gap_slope=(20e-3, 0.0), lifts=True, weight=5.0))
    # a gap max(s x, 0) is a ridge s|x|/2, and a turn s x/2 that a free sample follows: both of its ends lift alike
    np.testing.assert_allclose(falling.lifted[..., ::-1, :], falling.lifted, atol=1e-6 * falling.lifted.max())
    assert falling.lifted[0, 0, [0, -1]].min() > 10 * level.lifted.max()  # a heavier one would bend down to the seat


@pytest.mark.parametrize(
    ("unevenness", "base", "message"),
    [
        (Unevenness(stiffness_slope=(60.0, 0.0)), SEAT, "must be positive on the whole sample"),
        (Unevenness(lifts=True), "bonded", "must be a Seat"),
    ],
)
def test_what_is_refused(unevenness: Unevenness, base: Seat, message: str) -> None:
    with pytest.raises(ElastomerError, match=message):
        corrected(unevenness=unevenness, base=base)


@pytest.mark.parametrize("change", [{"weight": -1.0}, {"gap_slope": (np.nan, 0.0)}])
def test_an_unevenness_is_finite(change: dict[str, object]) -> None:
    with pytest.raises(GeometryError, match="must be finite"):
        replace(EVEN, **change)


@pytest.mark.slow
def test_far_sides_leave_the_response_and_near_ones_raise_it() -> None:
    design = first_coils_design(3)  # of which the last one is just as far away as coils count
    assert design.indentation is not None
    setup = replace(design.indentation, base=SEAT)

    ideal = design_circuit(design, ideal=True)

    def response(bounds: tuple[float, float, float, float] | None, reach: float | None = None) -> np.ndarray:
        sample = replace(design, indentation=replace(setup, sample_bounds=bounds))
        known = 50e-6 * (np.eye(3) - 0.05 * (np.eye(3, k=1) + np.eye(3, k=-1)))
        circuit = Imperfections(network=replace(ideal, inductance=known))
        found = response_map(sample, x=[0.0], y=[0.0], accuracy=reach, imperfections=circuit)
        return np.asarray(found.delta.values[0, 0, 0])

    close = (-40e-3, -9e-3, 40e-3, 9e-3)
    with coarse_maps(DEFAULT_MESH):
        wide, far, near = (response(b) for b in (None, (-42e-3, -42e-3, 42e-3, 42e-3), close))
        few = response(close, 1e-3)
    assert far[1] == pytest.approx(wide[1], rel=2e-3)  # and the mesh of the contact is another one
    assert abs(near[1] / wide[1] - 1) > 0.02
    # the near coils alone: 1e-3 of the peak, and to first order in the change of inductance
    np.testing.assert_allclose(few, near, atol=1.2e-3 * np.abs(near).max())


@pytest.mark.parametrize("case", ["a near side", "a seat that rises"])
def test_the_change_of_inductance_is_that_of_the_three_dimensional_solution(case: str) -> None:
    kept = json.loads(KEPT.read_text(encoding="utf-8"))["cases"][case]
    package, limit, meshes = (np.array(kept[key]) for key in ("package", "extrapolated", "three_dimensions"))
    # the step of the faces at a side costs the meshes their order: two extrapolations differ by 0.4 %, 2.3 % in M
    coarser = meshes[1] + (meshes[1] - meshes[0]) / (1.5**4 - 1)
    largest = np.abs(limit).max()
    np.testing.assert_allclose(coarser, limit, rtol=0.025, atol=2e-4 * largest)
    # The package is to first order in all but the depth and the rigid motion under the indenter. Measured: 0.2 to 3.2 %
    # of L and 2.1 % of M beside the near side. M on the rising seat passes through zero: 1/950 of the largest entry in
    # three dimensions, 1/370 here.
    np.testing.assert_allclose(package, limit, rtol=0.05, atol=2.5e-3 * largest)
    seen, expected = (kept["effective"][key] for key in ("package", "three_dimensions"))
    np.testing.assert_allclose(seen, expected, rtol=0.05)


@pytest.mark.slow
def test_the_kept_change_of_inductance_is_that_of_today() -> None:
    kept = json.loads(KEPT.read_text(encoding="utf-8"))["cases"]["a near side"]
    design = first_assumed()
    assert design.indentation is not None
    setup = replace(design.indentation, base=SEAT, strain="linear")
    x, y = kept["place"]
    pressed_at = [
        inductance_changes(replace(design, indentation=one), map_axes(replace(design, indentation=one), x=[x], y=[y]))
        for one in (setup, replace(setup, sample_bounds=tuple(kept["bounds"])))
    ]
    change = (pressed_at[1] - pressed_at[0])[0, 0, 0, 1:3, 1:3]
    # last digits differ between machines
    np.testing.assert_allclose(change, kept["package"], atol=1e-3 * np.abs(kept["package"]).max())
