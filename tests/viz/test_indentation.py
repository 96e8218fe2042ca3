"""Pictures of indentations: that curves and bodies are those of the numbers given.

Dents here are made up, so that areas, volumes and heights are known in closed form.
"""

import math

import numpy as np
import pytest
from support.boards import SHEETS, reference_board
from support.plot_results import DENT, curves, dents, flat

from coilarray import viz
from coilarray.geometry import Cone, CylinderEdge, FlatPunch, Hemisphere, Paraboloid
from coilarray.viz.datasets.meshes import dented_sheet_meshes, indenter_mesh, indenter_outline

HEIGHTS = np.array([0.0, 6e-3, 8e-3])
EXTENT = (-20e-3, -12e-3, 25e-3, 14e-3)
CENTRE = (2e-3, -1e-3)


def volume(mesh):
    """Volume in m³ from the outward triangles, by the divergence theorem; negative where they face inwards."""
    a, b, c = (mesh.points[mesh.faces.reshape(-1, 4)[:, k]] for k in (1, 2, 3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6) * 1e-9


def kept_area():
    """Area in m² of the extent less its lower left quarter."""
    (x, y), (x_min, y_min, x_max, y_max) = CENTRE, EXTENT
    return (x_max - x_min) * (y_max - y_min) - (x - x_min) * (y - y_min)


@pytest.mark.parametrize(("symmetry", "unit", "radius"), [("axial", "mN", "contact"), ("plane", "mN/m", "half width")])
def test_force_and_contact_over_depth(symmetry, unit, radius):
    data = dents(symmetry=symmetry)
    ax = viz.plot_force_depth(data)
    (force,) = curves(ax).values()
    np.testing.assert_allclose(force.get_xdata(), [0.5, 1.0])
    np.testing.assert_allclose(force.get_ydata(), data.force * 1e3)
    assert ax.get_ylabel() == f"force ({unit})"
    (right,) = [other for other in ax.figure.axes if other is not ax]
    (contact,) = curves(right).values()
    np.testing.assert_allclose(contact.get_ydata(), data.contact_radius * 1e3)
    assert right.get_ylabel().startswith(radius)


def test_a_dent_is_the_deformed_interfaces_on_both_sides():
    data = dents(stretch=lambda r: 0.2 * (r / DENT) * np.exp(-((r / DENT) ** 2)))
    ax = viz.plot_dent(data, Hemisphere(2.5e-3))
    at = data.isel(depth=-1)
    for line, k in zip(ax.lines, (1, 2), strict=True):
        x, z = line.get_data()
        np.testing.assert_allclose(x, -x[::-1])
        np.testing.assert_allclose(z, z[::-1])
        half = x.size // 2
        one = at.isel(interface=k)
        np.testing.assert_allclose(x[half:], (one.r + one.displacement_r) * 1e3)
        np.testing.assert_allclose(z[half:], (one.height + one.displacement_z) * 1e3)
    assert ax.get_aspect() == 1.0
    assert ax.get_title(loc="left") == "1 mm deep: 158 mN, contact radius 1.41 mm"
    assert viz.plot_dent(data, Hemisphere(2.5e-3), 0).get_title(loc="left").startswith("0.5 mm deep")


@pytest.mark.parametrize(
    "indenter", [Hemisphere(2e-3), Paraboloid(2e-3), FlatPunch(2e-3), Cone(1.0), Cone(1.0, 1e-3), CylinderEdge(2e-3)]
)
def test_the_indenter_touches_the_bottom_of_the_dent(indenter):
    symmetry = indenter.symmetry
    ax = viz.plot_dent(dents(symmetry=symmetry), indenter)
    (body,) = [patch for patch in ax.patches if patch.get_label() == indenter.name]
    x, z = body.get_xy().T
    assert z.min() == pytest.approx(7.0)  # 8 mm less the depth
    np.testing.assert_allclose(z.max(), ax.get_ylim()[1])
    inside = np.abs(x) * 1e-3 < indenter.largest_radius * (1 - 1e-9)
    np.testing.assert_allclose(z[inside] - 7.0, indenter.profile(np.abs(x[inside]) * 1e-3) * 1e3, atol=1e-9)
    assert np.abs(x).max() * 1e-3 <= indenter.largest_radius
    assert ax.get_xlabel() == ("r (mm)" if symmetry == "axial" else "x (mm)")


def test_the_indenter_goes_on_as_a_rod_and_the_force_needs_depths():
    r, z = indenter_outline(Hemisphere(1e-3), 3e-3)
    assert (r[0], z[0]) == (0.0, 0.0)
    assert z[-1] == pytest.approx(3e-3)
    np.testing.assert_allclose(r[z > 1e-3], 1e-3)
    assert len(viz.indentation_figure(dents(), Hemisphere(2.5e-3)).axes) == 3  # dent, force, contact radius
    assert len(viz.indentation_figure(dents(depths=[1e-3]), Hemisphere(2.5e-3)).axes) == 1
    with pytest.raises(ValueError, match="depth must be the position of one of 2 depths; got 5"):
        viz.plot_dent(dents(), Hemisphere(2.5e-3), 5)


def bodies(data, depth=-1):
    return dented_sheet_meshes(data.isel(depth=depth), SHEETS, CENTRE, EXTENT)


@pytest.mark.parametrize("symmetry", ["axial", "plane"])
def test_flat_sheets_are_boxes_less_a_quarter(symmetry):
    meshes = bodies(dents(rise=flat, symmetry=symmetry))
    assert list(meshes) == ["base", "magnetic"]
    for sheet, bottom in zip(SHEETS, HEIGHTS, strict=False):
        mesh = meshes[sheet.name]
        assert mesh.is_manifold
        assert mesh.n_open_edges == 0
        # corners are points of the mesh, so nothing is cut off
        assert volume(mesh) == pytest.approx(kept_area() * sheet.thickness, rel=1e-9)
        x_min, y_min, x_max, y_max = np.multiply(EXTENT, 1e3)
        assert mesh.bounds == pytest.approx(
            (x_min, x_max, y_min, y_max, bottom * 1e3, (bottom + sheet.thickness) * 1e3)
        )
        x, y, _ = (mesh.points - [*np.multiply(CENTRE, 1e3), 0.0]).T
        assert not ((x < -1e-9) & (y < -1e-9)).any()  # the quarter that is cut out


@pytest.mark.slow
def test_dents_and_grooves_take_their_volume_from_sheets_that_share_their_interface():
    meshes = bodies(dents())
    depth = 1e-3
    for sheet, below, above in zip(SHEETS, HEIGHTS, HEIGHTS[1:], strict=False):
        taken = 0.75 * math.pi * DENT**2 * depth * (above - below) / HEIGHTS[-1]
        # the bell is 1e-6 of its depth at the nearest edge; chords between circles miss about 1e-3 of it
        assert kept_area() * sheet.thickness - volume(meshes[sheet.name]) == pytest.approx(taken, rel=2e-3)
        assert meshes[sheet.name].is_manifold
    assert meshes["magnetic"].points[:, 2].max() <= 8.0
    axis = np.hypot(*(meshes["magnetic"].points[:, :2] - np.multiply(CENTRE, 1e3)).T) < 1e-9
    assert sorted(meshes["magnetic"].points[axis, 2].tolist()) == pytest.approx([6 - 0.75, 7.0])
    upper = {tuple(point) for point in np.round(meshes["base"].points, 9).tolist() if point[2] > 4.5}
    lower = {tuple(point) for point in np.round(meshes["magnetic"].points, 9).tolist() if point[2] <= 6.0}
    assert upper <= lower
    meshes = bodies(dents(symmetry="plane"))
    length = EXTENT[3] - CENTRE[1] + (CENTRE[1] - EXTENT[1]) / 2  # half of the groove is cut out below the centre
    taken = math.sqrt(math.pi) * DENT * length * 1e-3 * 2e-3 / HEIGHTS[-1]
    # rays are 0.3 mm apart at the ends of the groove: chords of a bell 3 mm wide miss about (0.3/3)²/12 of it
    assert kept_area() * 2e-3 - volume(meshes["magnetic"]) == pytest.approx(taken, rel=1e-3)


def test_a_stretched_or_finite_sheet_ends_where_it_ends():
    # u_r = e r of the upper face alone: a frustum, thickness/3 (A + A' + sqrt(A A')) of similar faces
    data = dents(depths=[1.0], rise=flat, stretch=lambda r: 0.1 * r)
    data["displacement_r"] = data.displacement_r.where(data.interface == "magnetic", 0.0)
    mesh = bodies(data)["magnetic"]
    area, wide = kept_area(), kept_area() * 1.1**2
    assert volume(mesh) == pytest.approx(2e-3 / 3 * (area + wide + math.sqrt(area * wide)), rel=1e-9)
    mesh = bodies(dents(rise=flat, end=8e-3))["base"]
    x_min, x_max, y_min, y_max, *_ = mesh.bounds
    assert (x_min, x_max, y_min, y_max) == pytest.approx((-6, 10, -9, 7))
    # polygons of 360 sides miss 5e-5 of a circle
    assert volume(mesh) == pytest.approx(0.75 * math.pi * 8e-3**2 * 6e-3, rel=1e-4)


@pytest.mark.parametrize(
    ("indenter", "whole"),
    [
        (Hemisphere(2e-3), (2 / 3 * 2 + 1) * math.pi * 2**2),
        (FlatPunch(2e-3), math.pi * 2**2 * 3),
        (Cone(math.pi / 4), math.pi * 3**3 / 3),
        (Paraboloid(2e-3), math.pi * 2 * 3**2),
    ],
)
def test_an_indenter_has_its_volume(indenter, whole):
    mesh = indenter_mesh(indenter, 7e-3, CENTRE, EXTENT, 3e-3)
    assert mesh.is_manifold
    # polygons of 360 sides miss 5e-5 of a circle, chords of 95 circles about as much of a ball
    assert volume(mesh) == pytest.approx(0.75 * whole * 1e-9, rel=2e-4)
    assert mesh.bounds[4:] == pytest.approx((7, 10))


def test_a_cylinder_lies_along_y_and_bodies_that_do_not_fit_are_refused():
    mesh = indenter_mesh(CylinderEdge(2e-3), 7e-3, CENTRE, EXTENT, 3e-3)
    assert mesh.bounds == pytest.approx((0, 4, -12, 14, 7, 10))
    length = EXTENT[3] - CENTRE[1] + (CENTRE[1] - EXTENT[1]) / 2
    section = (math.pi / 2 * 2**2 + 4 * 1) * 1e-6
    # its round bottom has sides of about 0.25 mm where the rays of 1° end: they miss (0.25/2)²/12 of a circle of 2 mm
    assert volume(mesh) == pytest.approx(section * length, rel=1.5e-3)
    at = dents().isel(depth=0)
    with pytest.raises(ValueError, match=r"centre must be inside the extent .*; got \(0.03, 0\)"):
        dented_sheet_meshes(at, SHEETS, (0.03, 0), EXTENT)
    with pytest.raises(ValueError, match="centre must be inside"):
        indenter_mesh(Hemisphere(1e-3), 0.0, (0, 0.014), EXTENT, 1e-3)


@pytest.fixture(scope="module")
def board():
    return reference_board()


@pytest.mark.lowest
@pytest.mark.slow
def test_a_scene_holds_board_sheets_and_indenter(board, plotter):
    scene = viz.dent_scene(board, SHEETS, dents(), Hemisphere(2.5e-3), centre=(-19.92e-3, 0.0))
    assert {"indenter", "sheet base", "sheet magnetic", "copper L1", "copper L3", "board"} <= {
        part.name for part in scene.parts
    }
    assert {"hemisphere, 1 mm deep, drawn 3 ×", "magnetic 2 mm", "base 6 mm"} <= set(scene.groups)
    # two and a half thicknesses of the stack on each side, cut to the board
    x_min, x_max, *_, z_max = scene.bounds
    assert (x_min, x_max) == pytest.approx((-39.92, 0.08), abs=1e-5)  # single precision
    assert z_max == pytest.approx(8 - 3 * 1 + 0.7 * 8)  # the dent is drawn three times as deep
    with pytest.raises(ValueError, match="centre must be on the board"):
        viz.dent_scene(board, SHEETS, dents(), Hemisphere(2.5e-3), centre=(1.0, 0.0))
    with pytest.raises(ValueError, match="depth must be the position of one of 2 depths; got 2"):
        viz.dent_scene(board, SHEETS, dents(), Hemisphere(2.5e-3), 2)
    viz.draw(scene, plotter, side="cut")
    picture = plotter.screenshot(return_img=True) / 255
    red, green, blue = np.moveaxis(picture, -1, 0)
    assert ((red > blue + 0.05) & (green > blue + 0.05)).mean() > 0.05  # the sheets where they are flat
    assert ((blue > red + 0.2) & (blue > green + 0.1)).mean() > 0.001  # and where they are deepest
    assert ((red > blue + 0.2) & (red > green + 0.1)).sum() > 20  # copper in the quarter that is cut out
