"""The mixed finite elements under the contact.

Who checks whom:

    quantity                    closed form               finer mesh   other
    displacement in a body      manufactured solution     order 3
    sinking under a wave        layer kernel, bonded and               axial and plane, ν from 0 to 0.5
                                frictionless
    sliding layer's far field   outflow u_r = B/r                      twice the extent
    compliance                                                         symmetry, positive definiteness
"""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.sparse import csr_array
from scipy.special import j0, jn_zeros
from skfem import Functional, LinearForm

from coilarray.elastomer.contact import compliance, elastic_response
from coilarray.elastomer.contact_grid import (
    ContactMesh,
    ContactZone,
    contact_grid,
    contact_mesh,
    displacement_basis,
    far_field,
    graded,
    hoop_strain,
    stack_of,
    weight,
)
from coilarray.errors import ElastomerError
from coilarray.geometry import Paraboloid, Sheet

MODULUS = 1.0


def constants(nu):
    """Shear modulus and compressibility for E = 1."""
    return MODULUS / (2 * (1 + nu)), 3 * (1 - 2 * nu) / MODULUS


def held_by(bottom, sides=("axis",)):
    """What is held: u_r on the sides and the given components on the board."""

    def held(basis):
        return np.union1d(basis.get_dofs(set(sides)).all("u^1"), basis.get_dofs("bottom").all(bottom))

    return held


BONDED, SLIDING = ["u^1", "u^2"], ["u^2"]


def body_of(mesh, symmetry, nu, held, wide=False):
    mu, squash = (np.full(mesh.nelements, value) for value in constants(nu))
    basis = displacement_basis(mesh)
    springs = far_field(basis, symmetry, mu) if wide else csr_array((basis.N, basis.N))
    solve = elastic_response(basis, symmetry, mu, squash, springs, held(basis))
    return SimpleNamespace(basis=basis, displacements=solve)


def pressed(body, symmetry, pressure):
    """Load and displacement of a pressure on the top, and the top."""
    top = body.basis.boundary("top")
    load = LinearForm(lambda v, w: -pressure(w.x[0]) * v[1] * weight(symmetry, w.x[0])).assemble(top)
    return load, body.displacements(load[:, None])[:, 0], top


# a manufactured solution


def exact(symmetry, dilation, x):
    """Displacement (2, …), its gradient (2, 2, …) and the dilation: of a stream function, plus a dilation · z² in z."""
    r, z = x
    k = 2 if symmetry == "axial" else 1
    a, da, dda = np.cos(r), -np.sin(r), -np.cos(r)
    b, db, ddb = (f * np.exp(z) for f in (z**2, 2 * z + z**2, 2 + 4 * z + z**2))
    u = np.stack((-r * a * db, (k * a + r * da) * b + dilation * z**2))
    of_r = np.stack((-(a + r * da) * db, -r * a * ddb))
    of_z = np.stack((((k + 1) * da + r * dda) * b, (k * a + r * da) * db + 2 * dilation * z))
    return u, np.stack((of_r, of_z)), 2 * dilation * z


def manufactured_error(symmetry, nu, dilation, n):
    """Error in L2 of the displacement on n × n elements of the unit square, loaded by the exact stress."""
    mesh = contact_mesh(np.linspace(0, 1, n + 1) ** 1.2, np.linspace(0, 1, n + 1))  # not uniform, no superconvergence
    mu, squash = constants(nu)
    body = body_of(mesh, symmetry, nu, held_by(BONDED))

    def stress_power(v, w):
        u, grad, div = exact(symmetry, dilation, w.x)
        r = w.x[0]
        pressure = -div / squash if squash else np.cos(3 * r) * np.exp(w.x[1])  # any, where nothing dilates
        hoop, hoop_v = hoop_strain(symmetry, u, r), hoop_strain(symmetry, v, r)
        strain, strain_v = (grad + grad.swapaxes(0, 1)) / 2, (v.grad + v.grad.swapaxes(0, 1)) / 2
        div_v = v.grad[0, 0] + v.grad[1, 1] + hoop_v
        power = (strain * strain_v).sum(axis=(0, 1)) + hoop * hoop_v - div * div_v / 3
        return (2 * mu * power - pressure * div_v) * weight(symmetry, r)

    def square(w):
        difference = w.u - exact(symmetry, dilation, w.x)[0]
        return (difference**2).sum(axis=0) * weight(symmetry, w.x[0])

    fine = body.basis.with_element(body.basis.elem)
    load = LinearForm(stress_power).assemble(fine)
    u = body.displacements(load[:, None])[:, 0]
    return np.sqrt(Functional(square).assemble(fine, u=fine.interpolate(u)))


@pytest.mark.slow
@pytest.mark.parametrize("symmetry", ["axial", "plane"])
@pytest.mark.parametrize(("nu", "dilation"), [(0.0, 0.7), (0.3, 0.7), (0.4999, 1e-4), (0.5, 0.0)])
def test_displacement_converges_with_order_3(symmetry, nu, dilation):
    errors = [manufactured_error(symmetry, nu, dilation, n) for n in (6, 12, 24)]
    orders = np.log2(errors[:-1]) - np.log2(errors[1:])
    assert errors[0] < 3e-3  # of a displacement near 1
    assert orders[0] == pytest.approx(3, abs=0.2)  # not yet asymptotic on 6 elements
    assert orders[1] == pytest.approx(3, abs=0.1)


# a pressure wave on a layer: exact within a period whose edges are planes of symmetry


def layer_kernel(base, nu, x):
    """u_z k E*/(2 p) of a layer under a pressure wave, x = k h: the kernel in ref_indentation_layer_sphere.csv."""
    if base == "frictionless":
        return (np.cosh(2 * x) - 1) / (np.sinh(2 * x) + 2 * x)
    k = 3 - 4 * nu
    return (2 * k * np.sinh(2 * x) - 4 * x) / (2 * k * np.cosh(2 * x) + 1 + k**2 + 4 * x**2)


def wave_error(symmetry, base, nu, n):
    """Relative errors on a layer of thickness 1 under p = J0(k r) or cos(k x): of the sinking, and of the work."""
    k = float(jn_zeros(1, 1)[0]) / 2 if symmetry == "axial" else np.pi / 2  # u_r and τ vanish at r = 2
    wave = j0 if symmetry == "axial" else np.cos
    mesh = contact_mesh(np.linspace(0, 2, 2 * n + 1), np.linspace(0, 1, n + 1))
    held = held_by(SLIDING if base == "frictionless" else BONDED, ("axis", "outer"))
    body = body_of(mesh, symmetry, nu, held)
    load, u, top = pressed(body, symmetry, lambda r: wave(k * r))
    dofs = body.basis.get_dofs("top").all("u^2")
    modulus = MODULUS / (1 - nu**2)
    sinking = -2 * layer_kernel(base, nu, k) / (modulus * k)
    largest = np.abs(u[dofs] - sinking * wave(k * body.basis.doflocs[0, dofs])).max() / abs(sinking)
    square = Functional(lambda w: wave(k * w.x[0]) ** 2 * weight(symmetry, w.x[0])).assemble(top)
    return largest, abs(load @ u / (-sinking * square) - 1)


@pytest.mark.slow
@pytest.mark.parametrize("symmetry", ["axial", "plane"])
@pytest.mark.parametrize("base", ["bonded", "frictionless"])
@pytest.mark.parametrize("nu", [0.0, 0.3, 0.4999, 0.5])
def test_sinking_under_a_pressure_wave(symmetry, base, nu):
    largest, work = wave_error(symmetry, base, nu, 16)
    assert largest < 5e-5  # (k h/16)³ = 1e-3 times a small constant
    assert work < 5e-7  # order 4: twice that of the strain


@pytest.mark.parametrize("symmetry", ["axial", "plane"])
@pytest.mark.parametrize("base", ["bonded", "frictionless"])
def test_work_of_a_pressure_wave_converges_with_order_4(symmetry, base):
    # ν = 0.3 and above come closer, with errors of two signs that hide the order
    coarse, fine = (wave_error(symmetry, base, 0.0, n)[1] for n in (8, 16))
    assert np.log2(coarse / fine) == pytest.approx(4, abs=0.3)
    assert layer_kernel(base, 0.3, 20.0) == pytest.approx(1, abs=1e-12)  # a half space, but for e^(−40)


# the far field


@pytest.mark.parametrize("symmetry", ["axial", "plane"])
def test_sliding_layer_goes_on_beyond_a_wide_mesh(symmetry):
    """What an incompressible sliding layer loses at the centre, V = h ∫p w/E*, leaves as u_r = V/(2π r h), or V/h."""
    extent = 12.0
    mesh = contact_mesh(graded(0.0, extent, lambda x: 0.1 + 0.2 * x), np.linspace(-1, 0, 5))
    body = body_of(mesh, symmetry, 0.5, held_by(SLIDING), wide=True)
    _, u, top = pressed(body, symmetry, lambda r: np.exp(-(r**2)))
    volume = -Functional(lambda w: w.u[1] * weight(symmetry, w.x[0])).assemble(top, u=top.interpolate(u))
    pressure = 0.5 if symmetry == "axial" else np.sqrt(np.pi) / 2  # ∫ exp(−r²) w dr
    flow = u[body.basis.get_dofs("outer").all("u^1")] * (extent if symmetry == "axial" else 1)
    # small x of the kernel: L/x = 1/2. Elements 2 h long at the edge bend 1/r by 2e-4
    assert volume == pytest.approx(pressure * 0.75, rel=1e-3)
    assert flow == pytest.approx(np.full(len(flow), volume), rel=5e-4)


# compliance of the top


def small_system(base="bonded", nu=0.5, radius=None):
    sheets = [Sheet("soft", 3.0, 1.0, 1e5, nu), Sheet("stiff", 1.0, 1.0, 3e5, nu)]
    zone = ContactZone(0.2, 0.2, 0.5)
    stack = stack_of(sheets)
    return compliance(stack, Paraboloid(1.0), contact_grid(stack, "axial", zone, base, radius, ContactMesh(8, 1.5)))


@pytest.mark.parametrize("base", ["bonded", "frictionless"])
@pytest.mark.parametrize("radius", [None, 1.5])
def test_compliance_is_symmetric_and_positive(base, radius):
    matrix = small_system(base, radius=radius).matrix
    assert np.abs(matrix - matrix.T).max() < 1e-10 * np.abs(matrix).max()  # roundings of the factorisation
    assert np.linalg.eigvalsh(matrix)[0] > 0
    assert (matrix.diagonal() > 0).all()


def test_surfaces_of_the_compliance_are_in_units_of_the_stack():
    system = small_system()
    grid = system.grid
    assert system.surfaces.shape == (2, 3, len(grid.r), len(grid.radii))
    assert not system.surfaces[:, 0].any()  # bonded to the board
    assert not system.surfaces[0, :, 0].any()  # on the axis
    assert (np.diff(grid.r) > 0).all()
    assert grid.radii[-1] == 0.5
    stack = stack_of([Sheet("a", 3e-3, 1.0, 1e5, 0.5), Sheet("b", 1e-3, 1.0, 4e5, 0.25)])
    assert (stack.length, stack.stress) == (4e-3, 4e5)
    assert stack.thicknesses == pytest.approx([0.75, 0.25], rel=1e-15)
    assert stack.levels == pytest.approx([-1.0, -0.25, 0.0], rel=1e-15)
    assert stack.shear == pytest.approx([0.25 / 3, 1 / 2.5], rel=1e-15)
    assert stack.squash == pytest.approx([0.0, 1.5], abs=1e-15)


# meshes


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"elements": 3}, "at least 4; got 3"),
        ({"growth": 1.0}, "above 1 and at most 2; got 1.0"),
        ({"growth": 2.5}, "above 1 and at most 2; got 2.5"),
        ({"extent": 0.5}, "at least 1 thickness; got 0.5"),
        ({"extent": np.inf}, "finite"),
    ],
)
def test_bad_mesh(arguments, message):
    with pytest.raises(ElastomerError, match=message):
        ContactMesh(**arguments)
