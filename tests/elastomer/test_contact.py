"""Contact of an indenter with elastomer sheets, linear. Large strains are in `test_finite_strain`.

Who checks whom: force, contact radius and displacement against closed forms, identities (F = dU/dδ, scaling, no volume
lost at ν = 0.5), measured orders and other models, and against every row of the exact solutions in
tests/reference/ref_indentation_*.csv, to 1 %.
"""

import math
from functools import partial
from itertools import groupby

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import simpson
from scipy.interpolate import CubicSpline
from support.references import rows

import coilarray.elastomer.contact as module
from coilarray.elastomer.contact import contact_radius
from coilarray.elastomer.contact_grid import ContactMesh
from coilarray.errors import ElastomerError
from coilarray.geometry import Cone, CylinderEdge, FlatPunch, Hemisphere, Paraboloid, Seat, Sheet

pytestmark = pytest.mark.slow

indent = partial(module.indent, strain="linear")
COARSE = ContactMesh(elements=12, growth=1.5)
BALL = Hemisphere(2.5e-3)


def sheet(thickness=8e-3, modulus=1e5, nu=0.5, name="layer"):
    return Sheet(name, thickness, 1.0, modulus, nu)


PAPER = [sheet(6e-3, 1e5, 0.4999, "base"), sheet(2e-3, 3e5, 0.4999, "magnetic")]


def force_of(sheets, indenter, depth, mesh=COARSE, **how):
    return float(indent(sheets, indenter, depth, accuracy=mesh, **how).force[0])


def over_area(field, symmetry="axial"):
    """∫ field w dr over the nodes of a biquadratic mesh, times 2π or 2: Simpson's rule on each element is exact."""
    r = field.r.values
    weight = 2 * np.pi * r if symmetry == "axial" else np.full_like(r, 2.0)
    value, step = field.values * weight, np.diff(r[::2])
    return float((step * (value[:-2:2] + 4 * value[1::2] + value[2::2]) / 6).sum())


# closed forms


@pytest.mark.parametrize("nu", [0.0, 0.3, 0.5])
@pytest.mark.parametrize("cuts", [1, 3])
def test_uniform_compression_of_a_disc_is_exact(nu, cuts):
    h, R, E, depth = 4e-3, 5e-3, 2e5, 1e-4
    sheets = [sheet(h / cuts, E, nu, str(k)) for k in range(cuts)]
    found = indent(sheets, FlatPunch(R), depth, base="frictionless", radius=R, accuracy=COARSE).isel(depth=0)
    # the elements hold linear displacements exactly: roundings of the factorisation are left
    assert float(found.force) == pytest.approx(E * math.pi * R**2 * depth / h, rel=1e-9)
    assert found.pressure.values == pytest.approx(np.full(found.r.size, E * depth / h), rel=1e-7)
    for height, u_r, u_z in zip(found.height, found.displacement_r, found.displacement_z, strict=True):
        assert u_z.values == pytest.approx(np.full(found.r.size, -depth * float(height) / h), abs=1e-9 * depth)
        assert u_r.values == pytest.approx(nu * depth / h * found.r.values, abs=1e-9 * depth)


@pytest.mark.parametrize("nu", [0.3, 0.5])
def test_cone_on_a_thick_layer(nu):
    """Sneddon, Int. J. Engng Sci. 3 (1965) 47: a = (2/π) δ tan α and F = (2/π) E* tan α δ²."""
    E, depth, angle = 1e5, 1e-5, 1.2
    found = indent([sheet(0.05, E, nu)], Cone(angle), depth, accuracy=ContactMesh(24, 1.6)).isel(depth=0)
    a = 2 / math.pi * depth * math.tan(angle)
    # the layer of 3000 a stiffens by about a/h = 3e-4; the mesh leaves 1e-3 of the force and 3e-3 of the radius
    assert float(found.force) == pytest.approx(2 / math.pi * E / (1 - nu**2) * math.tan(angle) * depth**2, rel=2e-3)
    assert float(found.contact_radius) == pytest.approx(a, rel=5e-3)


@pytest.mark.parametrize("base", ["bonded", "frictionless"])
@pytest.mark.parametrize("nu", [0.3, 0.5])
def test_cylinder_on_a_thick_layer(base, nu):
    """Line contact of Hertz, a² = 4 F R (1 − ν²)/(π E), F per length: K. L. Johnson, Contact Mechanics, eq. 4.43."""
    R, E = 0.1, 1e5
    found = indent([sheet(0.2, E, nu)], CylinderEdge(R), [2e-5, 4e-5], base=base, accuracy=ContactMesh(24, 1.6))
    a = np.sqrt(4 * found.force * R * (1 - nu**2) / (math.pi * E))
    assert float(a[0]) < 0.02 * 0.2  # corrections of order (a/h)² = 4e-4, and (a/R)²/4 = 1e-4 for the round profile
    assert found.contact_radius.values == pytest.approx(a.values, rel=4e-3)
    # semi-ellipse of pressure, largest at 2 F/(π a)
    assert found.pressure[:, 0].values == pytest.approx((2 * found.force / (math.pi * a)).values, rel=4e-3)


def test_contact_radius_of_a_known_pressure():
    r = np.linspace(0, 1, 33)
    for a in (0.6, 0.613, 0.625, 0.64):
        # a root between vertices, taken as linear there: up to 0.27 of a step
        assert contact_radius(r, np.sqrt(np.maximum(0, a**2 - r**2)), 5) == pytest.approx(a, abs=0.3 / 32)


# convergence


def paraboloid_errors(mesh):
    """Root mean square errors of force and contact radius over some rows, for edges anywhere in an element."""
    group = [row for row in rows("indentation_layer_sphere") if (row["base"], row["nu"]) == ("bonded", "0.5")]
    errors = []
    for row in [row for row in group if 0.4 <= float(row["a_over_h"]) <= 1.5][::2]:
        a = float(row["a_over_h"])
        found = indent([sheet(1.0, 1.0)], Paraboloid(100.0), float(row["deltaR_over_h2"]) / 100, accuracy=mesh)
        force = float(row["P_dimless"]) / 0.75 * a**3 / 100
        errors.append((float(found.force[0]) / force - 1, float(found.contact_radius[0]) / a - 1))
    return np.sqrt(np.mean(np.square(errors), axis=0))


def test_force_and_contact_radius_converge_with_order_2():
    coarse = ContactMesh(elements=8, growth=1.8)
    fine = coarse.refined().refined()
    order = np.log2(paraboloid_errors(coarse) / paraboloid_errors(fine)) / 2
    # the pressure's edge, √(a − r), falls inside an element of size h: its force is uncertain by h^1.5 to h^2.5
    assert order == pytest.approx([2, 2], abs=0.3)


def test_default_mesh_holds_what_it_says():
    force, radius = paraboloid_errors(module.DEFAULT_MESH)
    assert force < 1e-3
    assert radius < 3e-3


def test_force_of_a_flat_punch_converges_with_order_2():
    row = next(row for row in rows("indentation_hayes_flat_punch") if row["a_over_h"] == "1.0")
    exact = float(row["nu0.50"]) * 4 / 3 * 1e-3 / 0.5
    coarse = ContactMesh(elements=4, growth=2.0)
    meshes = (coarse, coarse.refined(), coarse.refined().refined())
    errors = [abs(force_of([sheet(1.0, 1.0)], FlatPunch(1.0), 1e-3, mesh) / exact - 1) for mesh in meshes]
    orders = np.log2(errors[:-1]) - np.log2(errors[1:])
    # p ~ (a − r)^(−1/2): the element at the edge, a/n² long, holds an energy of its length
    assert orders == pytest.approx([2, 2], abs=0.3)


def test_wide_sample_does_not_depend_on_its_extent():
    bonded, sliding = (force_of(PAPER, BALL, 1e-3, base=base) for base in ("bonded", "frictionless"))
    twice = ContactMesh(12, 1.5, 50.0)
    # exp(−0.74 · 25) = 1e-8 is left of the bonded layer's field, and the sliding one's goes on beyond the edge
    assert force_of(PAPER, BALL, 1e-3, twice) == pytest.approx(bonded, rel=1e-5)
    assert force_of(PAPER, BALL, 1e-3, twice, base="frictionless") == pytest.approx(sliding, rel=1e-5)
    assert force_of(PAPER, BALL, 1e-3, radius=0.15) == pytest.approx(bonded, rel=1e-5)  # a disc: exp(−0.74 · 19) = 1e-6


# identities


ROUND = [(BALL, 1e-3), (Paraboloid(2.5e-3), 1e-3), (Cone(1.2), 5e-4), (CylinderEdge(2.5e-3), 5e-4)]


@pytest.mark.parametrize(("indenter", "depth"), [*ROUND, (FlatPunch(1e-3), 2e-4)])
def test_pressure_and_gap_exclude_each_other(indenter, depth):
    one = indent(PAPER, indenter, depth, accuracy=ContactMesh(24, 1.6)).isel(depth=0)
    a, top = float(one.contact_radius), one.isel(interface=-1)
    r, pressure = top.r.values, one.pressure.values
    with np.errstate(invalid="ignore"):
        gap = indenter.profile(r) - depth - top.displacement_z.values
    step = a / 24  # an element
    assert (pressure >= 0).all()
    assert not pressure[r > a + step].any()
    assert (pressure[r < a - step] > 0).all()
    inside = r <= a - 2 * step
    assert inside.sum() > 20
    assert np.abs(gap[inside]).max() < 1e-3 * depth  # zero on average over each hat
    assert (gap[r > a + 2 * step] > 0).all()
    # the pressure is linear between vertices, r or 1 is the weight: Simpson's rule is exact, up to a punch's edge
    under = one.pressure.sel(r=slice(0, a)) if indenter.name == "flat punch" else one.pressure
    assert float(one.force) == pytest.approx(over_area(under, indenter.symmetry), rel=1e-12)


def test_force_is_the_slope_of_the_energy():
    depths = np.linspace(0.4e-3, 0.8e-3, 21)
    found = indent(PAPER, BALL, depths, accuracy=COARSE)
    sinking = np.maximum(0.0, depths[:, None] - BALL.profile(np.minimum(found.r.values, BALL.radius)))
    work = (found.pressure * sinking).transpose("depth", "r")
    energy = np.array([over_area(work.isel(depth=k)) / 2 for k in range(len(depths))])
    # exact for the discrete problem but for the jumps of its contact from vertex to vertex, of second order
    assert simpson(found.force.values, x=depths) == pytest.approx(energy[-1] - energy[0], rel=1e-3)


@pytest.mark.parametrize("indenter", [BALL, CylinderEdge(2.5e-3)])
def test_incompressible_bonded_layer_loses_no_volume(indenter):
    sheets = [sheet(6e-3, 1e5, 0.5, "base"), sheet(2e-3, 3e5, 0.5, "top")]
    one = indent(sheets, indenter, 1e-3, accuracy=COARSE).isel(depth=0)
    for name in ("base", "top"):
        u = one.displacement_z.sel(interface=name)
        assert float(u.max()) > 0.01 * 1e-3  # the raised ring takes it up
        dent = over_area(u.clip(max=0), indenter.symmetry)
        assert abs(over_area(u, indenter.symmetry)) < 1e-4 * abs(dent)  # flow through the far, coarse elements


def test_frictionless_base_gives_way():
    bonded, sliding = (
        indent(PAPER, BALL, 1e-3, base=base, accuracy=COARSE).isel(depth=0) for base in ("bonded", "frictionless")
    )
    assert float(sliding.force) < 0.9 * float(bonded.force)
    dents = [abs(over_area(one.displacement_z.sel(interface="base").clip(max=0))) for one in (bonded, sliding)]
    assert dents[1] > 1.5 * dents[0]  # "twice the response", of the magnetic layer's lower face
    assert float(sliding.displacement_r.sel(interface="board").max()) > 0
    assert not bonded.displacement_r.sel(interface="board").values.any()
    assert not sliding.displacement_z.sel(interface="board").values.any()


@settings(max_examples=5)
@given(length=st.floats(1e-3, 1e3), stress=st.floats(1e-3, 1e6))
def test_scaling_of_lengths_and_moduli(length, stress):
    def pressed(by, times):
        sheets = [Sheet(one.name, one.thickness * by, 1.0, one.youngs_modulus * times, 0.5) for one in PAPER]
        return indent(sheets, Hemisphere(2.5e-3 * by), 1e-3 * by, accuracy=ContactMesh(6, 1.8))

    one, other = pressed(1.0, 1.0), pressed(length, stress)
    # the same numbers in the stack's own units; roundings of the factorisation, times its condition
    assert float(other.force[0]) == pytest.approx(float(one.force[0]) * length**2 * stress, rel=1e-8)
    assert float(other.contact_radius[0]) == pytest.approx(float(one.contact_radius[0]) * length, rel=1e-8)
    np.testing.assert_allclose(other.displacement_z, one.displacement_z * length, atol=1e-10 * length)


@pytest.mark.parametrize("base", ["bonded", "frictionless"])
def test_sheets_of_one_material_are_one_sheet(base):
    whole = indent([sheet(8e-3)], BALL, 1e-3, base=base, accuracy=ContactMesh(20))
    cut = indent([sheet(t, name=str(t)) for t in (1e-3, 5e-3, 2e-3)], BALL, 1e-3, base=base, accuracy=ContactMesh(20))
    assert float(cut.force[0]) == pytest.approx(float(whole.force[0]), rel=2e-4)  # meshes differ in depth
    top = [one.displacement_z.isel(depth=0, interface=-1) for one in (whole, cut)]
    assert float(top[1].max()) == pytest.approx(float(top[0].max()), rel=2e-3)


def test_thin_sheets_of_a_ratio_of_100():
    one = force_of([sheet(8.08e-3)], BALL, 1e-3)
    for sheets in ([sheet(8e-3), sheet(80e-6, name="skin")], [sheet(80e-6, name="glue"), sheet(8e-3)]):
        assert force_of(sheets, BALL, 1e-3) == pytest.approx(one, rel=4e-3)
    stiff, soft = (force_of([sheet(8e-3), sheet(80e-6, modulus, name="skin")], BALL, 2e-4) for modulus in (1e7, 1e4))
    assert soft < stiff


# Poisson's ratio


def test_no_locking_up_to_an_incompressible_layer():
    nus = np.array([0.3, 0.4, 0.45, 0.49, 0.499, 0.4999, 0.49999, 0.5])
    # a punch keeps one contact and one mesh, so that even the change from 0.49999 is smooth; a/h = 2 is sensitive
    force = np.array([force_of([sheet(1e-3, nu=nu)], FlatPunch(2e-3), 1e-5) for nu in nus])
    assert (np.diff(force) > 0).all()
    missing = (force[-1] - force[3:-1]) / (0.5 - nus[3:-1])
    # linear in 0.5 − ν: the slope from 0.49 is 20 % off the limit by its curvature, then 2 %, 0.2 %
    assert missing[0] < missing[1] < missing[2]
    assert missing[1] == pytest.approx(missing[2], rel=0.05)
    assert missing[2] == pytest.approx(missing[3], rel=0.005)


def test_frictionless_base_sees_the_plane_modulus_alone():
    nus = (0.0, 0.25, 0.4, 0.5)
    force = [force_of([sheet(nu=nu)], BALL, 1e-3, base="frictionless") * (1 - nu**2) for nu in nus]
    # exact for a layer: its kernel holds no ν; the meshes differ a little in where they expect the edge
    assert force == pytest.approx([force[-1]] * 4, rel=1e-3)


# indenters


def test_ball_is_a_paraboloid_at_small_depths():
    h, R, fine = 8e-3, 2.5e-3, ContactMesh(24, 1.6)
    for depth in (0.1e-3, 0.2e-3):
        ball, paraboloid = (force_of([sheet(h)], one(R), depth, fine) for one in (Hemisphere, Paraboloid))
        # Hertz with the next term of the profile, a²/(4R²) of it: the force falls by about δ/(10 R)
        assert (1 - ball / paraboloid) / (depth / R) == pytest.approx(0.1, abs=0.03)


def test_cone_that_ends_becomes_a_punch():
    a, angle, mesh = 1e-3, 1.2, ContactMesh(16, 1.6)
    found = indent([sheet()], Cone(angle, a), [1e-4, 1.2e-3, 1.3e-3], accuracy=mesh)
    assert float(found.force[0]) == pytest.approx(force_of([sheet()], Cone(angle), 1e-4, mesh), rel=2e-3)
    assert float(found.contact_radius[0]) < a
    assert found.contact_radius[1:].values.tolist() == [a, a]
    # once its whole face touches, each further depth adds the punch's force
    more = float(found.force[2] - found.force[1])
    assert more == pytest.approx(force_of([sheet()], FlatPunch(a), 1e-4, mesh), rel=1e-3)


def test_plane_indenter_works_on_finite_and_sliding_samples():
    hows = ({"radius": 10e-3}, {}, {"base": "frictionless"})
    narrow, wide, sliding = (force_of([sheet()], CylinderEdge(2.5e-3), 5e-4, **how) for how in hows)
    assert narrow < wide
    assert sliding < wide


# the dataset


def test_dataset():
    found = indent(PAPER, BALL, [0.0, 5e-4, 1e-3], accuracy=COARSE)
    assert found.displacement_z.dims == ("depth", "interface", "r")
    assert list(found.interface.values) == ["board", "base", "magnetic"]
    assert found.height.values == pytest.approx([0.0, 6e-3, 8e-3], rel=1e-15)
    pressed = {"symmetry": "axial", "base": "bonded", "strain": "linear", "indenter": "Hemisphere(radius=0.0025)"}
    assert found.attrs == pressed
    assert all({"units", "long_name"} <= set(found[name].attrs) for name in found.variables)
    assert all(np.isfinite(found[name].values).all() for name in found.data_vars)
    assert not any(found.isel(depth=0)[name].values.any() for name in found.data_vars)  # a touch moves nothing
    units = (found.force.units, indent(PAPER, CylinderEdge(2.5e-3), 5e-4, accuracy=COARSE).force.units)
    assert units == ("N", "N/m")
    touch = indent(PAPER, BALL, 0.0, accuracy=COARSE)  # alone
    assert not any(touch[name].values.any() for name in touch.data_vars)


def test_depths_keep_their_order_and_accuracy():
    depths, mesh = [1e-3, 1e-5, 3e-4], ContactMesh(24, 1.8)
    together = indent(PAPER, BALL, depths, accuracy=mesh)
    for k, depth in enumerate(depths):
        alone = indent(PAPER, BALL, depth, accuracy=mesh)
        assert float(together.force[k]) == pytest.approx(float(alone.force[0]), rel=3e-3)  # two meshes, 1e-3 each
        assert float(together.contact_radius[k]) == pytest.approx(float(alone.contact_radius[0]), rel=8e-3)


# bad input


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"sheets": []}, "at least 1 sheet; got 0"),
        ({"sheets": [Sheet("plain", 1e-3)]}, "sheet 'plain' has none"),
        ({"sheets": [sheet(), sheet()]}, "names of the sheets must differ"),
        ({"sheets": [sheet(name="board")]}, "from 'board'"),
        ({"depths": -1e-4}, "from 0 to below the thickness of all sheets, 8 mm; got -0.1 mm"),
        ({"depths": [1e-4, math.nan]}, "got nan m"),
        ({"depths": math.inf}, "got inf m"),
        ({"depths": 8e-3}, "got 8 mm"),
        ({"depths": []}, "at least one"),
        ({"depths": [1e-3, 4e-3]}, "a hemisphere can be pressed in by at most its radius, 2.5 mm: .* depth of 4 mm"),
        ({"indenter": CylinderEdge(1e-3), "depths": 2e-3}, "a cylinder edge can be pressed in by at most its radius"),
        ({"depths": [[1e-4]]}, "one row of numbers"),
        ({"base": "glued"}, "'bonded', 'frictionless' or a Seat; got 'glued'"),
        # a millionth of a usual one: which step fails is a matter of rounding
        ({"base": Seat(1e-6)}, "does not converge: the seat or|converges up to a depth of 0"),
        ({"strain": "small"}, "strain must be 'finite' or 'linear'; got 'small'"),
        ({"radius": 0.0}, "radius of a sample must be positive and finite; got 0 mm"),
        ({"radius": math.inf}, "got inf m"),
        ({"indenter": FlatPunch(3e-3), "radius": 2e-3}, "inside the sample, within a radius of 2 mm"),
        ({"indenter": Paraboloid(0.1), "depths": 1e-3, "radius": 5e-3}, "within a radius of 5 mm"),
        ({"indenter": FlatPunch(1e-3), "depths": 4e-3}, "at 4 mm that of 'layer' folds"),
    ],
)
def test_bad_input(changes, message):
    given = {"sheets": [sheet()], "indenter": BALL, "depths": 5e-4, **changes}
    with pytest.raises(ElastomerError, match=message):
        indent(given.pop("sheets"), given.pop("indenter"), given.pop("depths"), accuracy=COARSE, **given)


def test_contact_that_does_not_converge_is_reported(monkeypatch):
    monkeypatch.setattr(module, "_RESIDUAL", -1.0)  # below any; it is 1e-14 and less
    with pytest.raises(ElastomerError, match="does not converge: its residual must be at most"):
        indent([sheet()], BALL, 5e-4, accuracy=COARSE)

    def failing(*_):
        raise RuntimeError("Maximum number of iterations reached")

    monkeypatch.setattr(module, "nnls", failing)
    with pytest.raises(ElastomerError, match="does not converge: Maximum number of iterations"):
        indent([sheet()], BALL, 5e-4, accuracy=COARSE)


REFERENCE_MESH = ContactMesh(elements=20, growth=1.5)
SPHERES = {key: list(group) for key, group in groupby(rows("indentation_layer_sphere"), lambda q: (q["base"], q["nu"]))}
PUNCHES = rows("indentation_hayes_flat_punch")
TWO = rows("indentation_two_layer_stack")
STACKS = {key: list(group) for key, group in groupby(TWO, lambda q: (float(q["E_top_MPa"]), float(q["R_mm"])))}


def numbers(group, column):
    return np.array([float(row[column]) for row in group])


@pytest.mark.parametrize("part", [slice(0, 2), slice(2, 7), slice(7, 13), slice(13, 18)])
@pytest.mark.parametrize("key", SPHERES)
def test_paraboloid_on_a_layer(key, part):
    base, nu = key
    group = SPHERES[key][part]
    nu = 0.45 if nu == "any" else float(nu)  # on a frictionless base only E* counts
    h, R, E = 3e-3, 0.3, 1e5  # flat enough that the deepest depth stays below the thickness
    a, delta = numbers(group, "a_over_h") * h, numbers(group, "deltaR_over_h2") * h**2 / R
    force = numbers(group, "P_dimless") * E / (1 - nu**2) * a**3 / R
    support = "bonded" if base == "bonded" else "frictionless"
    found = indent([Sheet("layer", h, 1.0, E, nu)], Paraboloid(R), delta, base=support, accuracy=REFERENCE_MESH)
    assert found.force.values == pytest.approx(force, rel=3e-3)  # required 1e-2; n⁻² = 2.5e-3
    assert found.contact_radius.values == pytest.approx(a, rel=1e-2)  # required; measured 6e-3


@pytest.mark.parametrize("row", PUNCHES, ids=lambda row: row["a_over_h"])
def test_flat_punch_on_a_bonded_layer(row):
    h, E = 2e-3, 1e5
    a = float(row["a_over_h"]) * h
    depth = 1e-3 * a
    for nu in (0.30, 0.40, 0.49) if PUNCHES.index(row) % 2 else (0.35, 0.45, 0.50):  # every row, every column
        sheet = Sheet("layer", h, 1.0, E, nu)
        found = indent([sheet], FlatPunch(a), depth, accuracy=ContactMesh(elements=10, growth=1.5))
        kappa = float(found.force[0]) * (1 - nu) / (4 * E / (2 * (1 + nu)) * a * depth)
        assert kappa == pytest.approx(float(row[f"nu{nu:.2f}"]), rel=3e-3)  # required 1e-2; measured 1.5e-3
        assert found.contact_radius.values == pytest.approx([a], rel=1e-15)


@pytest.mark.parametrize("key", STACKS)
def test_paraboloid_on_two_layers(key):
    E_top, R = key
    depths = sorted({float(row["delta_mm"]) for row in STACKS[key]})
    sheets = [Sheet("bottom", 6e-3, 1.0, 0.1e6, 0.5), Sheet("top", 2e-3, 1.0, E_top * 1e6, 0.5)]
    found = indent(sheets, Paraboloid(R * 1e-3), np.array(depths) * 1e-3)
    for k, depth in enumerate(depths):
        group = [row for row in STACKS[key] if float(row["delta_mm"]) == depth]
        one = found.isel(depth=k)
        assert float(one.force) == pytest.approx(float(group[0]["F_N"]), rel=2e-3)  # required 1e-2; measured 9e-4
        assert float(one.contact_radius) == pytest.approx(float(group[0]["a_mm"]) * 1e-3, rel=1e-2)  # measured 4e-3
        r = numbers(group, "r_mm") * 1e-3
        for interface, column in (("top", "u_surface_mm"), ("bottom", "u_interface_mm")):
            field = one.displacement_z.sel(interface=interface)
            u = -CubicSpline(field.r, field)(r) * 1e3  # the nodes are better than the parabolas between them
            # required 1 %, measured 0.6 %, even near r = 6 mm where dent turns into ring and u is 1e-3 of the depth
            np.testing.assert_allclose(u, numbers(group, column), rtol=1e-2)
