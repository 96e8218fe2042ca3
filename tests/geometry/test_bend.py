"""Bent boards: lengths are kept, and a bent coil is the coil sampled densely on the bent surface."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from coilarray import (
    Array,
    Design,
    Spiral,
    couple_design,
    inductance_matrix,
    magnetic_field,
    mutual_inductance,
    self_inductance,
)
from coilarray.circuit.board_circuit import board_circuit
from coilarray.circuit.network_files import fasthenry_input
from coilarray.design.export import export
from coilarray.design.model import Indentation
from coilarray.electromagnetics.resistance import dc_resistance, resistance_matrix
from coilarray.errors import DesignError, GeometryError, OutputError
from coilarray.geometry import MATERIALS, Conductor, Hemisphere, Plate, Sheet, Target, solids
from coilarray.geometry.bend import Bend, Zone
from coilarray.geometry.space_coils import saddle
from coilarray.viz.datasets import results as meshes
from coilarray.viz.scenes.board import board_scene

BENDS = {
    "cylinder": Bend((Zone(8e-3),), axis=0.4),
    "upwards": Bend((Zone(-20e-3, at=3e-3),), neutral=-0.1e-3),
    "zones": Bend((Zone(5e-3, at=-6e-3, width=4e-3), Zone(-4e-3, at=5e-3, width=6e-3)), axis=1.2),
    "cone": Bend((Zone(15e-3),), axis=-0.7, apex=60e-3),
    "cone upwards": Bend((Zone(-15e-3),), apex=-60e-3),
}


@pytest.mark.parametrize("bend", BENDS.values(), ids=BENDS)
def test_the_neutral_plane_keeps_its_lengths(bend):
    rng = np.random.default_rng(1)
    points = np.column_stack((rng.uniform(-12e-3, 12e-3, (400, 2)), np.full(400, bend.neutral)))
    steps = np.column_stack((rng.normal(size=(400, 2)), np.zeros(400)))
    steps *= 1e-7 / np.linalg.norm(steps, axis=1, keepdims=True)
    moved = bend.surface(points + steps / 2) - bend.surface(points - steps / 2)
    # central differences: the cube of step over radius, and rounding of 1e-18 m
    np.testing.assert_allclose(np.linalg.norm(moved, axis=1), 1e-7, rtol=1e-8)
    np.testing.assert_allclose(bend.turned(points, steps), moved, atol=1e-13)


@pytest.mark.parametrize("bend", BENDS.values(), ids=BENDS)
def test_heights_are_along_the_normal(bend):
    points = np.random.default_rng(2).uniform(-10e-3, 10e-3, (50, 3)) * (1, 1, 0.01)
    up = bend.turned(points, np.tile((0.0, 0.0, 1.0), (50, 1)))
    np.testing.assert_allclose(
        bend.surface(points + np.array([0, 0, 1e-4])) - bend.surface(points), 1e-4 * up, atol=1e-15
    )
    on_plane = np.tile((1.0, 0.0, 0.0), (50, 1))
    assert np.abs((bend.turned(points, on_plane) * up).sum(axis=1)).max() < 1e-12


@pytest.mark.parametrize("bend", BENDS.values(), ids=BENDS)
def test_the_origin_stays(bend):
    zone = any(abs(zone.at) < zone.width / 2 for zone in bend.zones)
    place = bend.surface([[0.0, 0.0, bend.neutral]])[0]
    np.testing.assert_allclose(place, (0, 0, bend.neutral), atol=1e-15)
    assert zone or np.allclose(bend.surface([[1e-3, 0, 0.0]]), [[1e-3, 0, 0]])


def test_a_quarter_and_a_whole_turn():
    bend = Bend((Zone(2e-3),))
    quarter = bend.surface([[1e-3, math.pi * 1e-3, 0.0], [0, 2 * math.pi * 2e-3, 0], [0, 0, 0.5e-3]])
    np.testing.assert_allclose(quarter, [[1e-3, 2e-3, -2e-3], [0, 0, 0], [0, 0, 0.5e-3]], atol=1e-15)


@pytest.mark.slow
@settings(max_examples=10, deadline=None)
@given(st.floats(4e-3, 1.0), st.floats(0, 3), st.booleans())
def test_a_bent_coil_is_sampled_finely_enough(radius, axis, up):
    """Chords are right to 1e-4 of L, against chords a sixth as long."""
    coil = Array.row(Spiral(6, 12e-3, 4, 0.3e-3, 0.3e-3), 1).conductors()[0]
    bend = Bend((Zone(-radius if up else radius),), axis)
    path = bend.bent(coil)
    pieces = 6
    fine = np.concatenate([
        start + np.arange(pieces)[:, None] / pieces * (stop - start)
        for start, stop in zip(coil.vertices, coil.vertices[1:], strict=False)
    ] + [coil.vertices[-1:]])  # fmt: skip
    dense = type(coil)(fine, *(np.repeat(size, pieces) for size in (coil.widths, coil.thicknesses, coil.areas)))
    other = [[x, y, 6e-3] for x, y in ((-9e-3, -5e-3), (8e-3, -6e-3), (2e-3, 9e-3), (-9e-3, -5e-3))]
    found, expected = (mutual_inductance([bend.bent(one)], [other])[0, 0] for one in (coil, dense))
    size = math.sqrt(inductance_matrix(path, allow_overlaps=True)[0, 0] * 30e-9)
    assert abs(found - expected) < 1e-4 * size
    assert path.lengths.sum() == pytest.approx(coil.lengths.sum(), rel=0.1)


def test_a_slight_bend_changes_little():
    coils = Array.row(Spiral(6, 12e-3, 6, 0.3e-3, 0.3e-3), 2, 13e-3).conductors()
    flat = inductance_matrix(coils)
    middle = float(np.unique(coils[0].vertices[:, 2]).mean())  # lengths above and below it change by height over radius
    bend = Bend((Zone(10.0),), neutral=middle)
    bent = inductance_matrix([bend.bent(coil) for coil in coils], allow_overlaps=True)
    np.testing.assert_allclose(bent, flat, atol=1e-6 * flat[0, 0])  # (size/radius)² is 1e-6


@pytest.mark.parametrize(("make", "named"), [
    (lambda: Zone(0.0), "radius"), (lambda: Zone(1e-3, width=-1.0), "width"), (lambda: Zone(math.nan), "nan"),
    (lambda: Bend(()), "one zone"), (lambda: Bend((Zone(1e-3), Zone(2e-3, 1e-3, 1e-3))), "overlap"),
    (lambda: Bend((Zone(1e-3, width=1e-3),), apex=1e-2), "cone"),
])  # fmt: skip
def test_impossible_bends_are_refused(make, named):
    with pytest.raises(GeometryError, match=named):
        make()


def test_a_trace_along_the_axis_of_a_cone_follows_its_surface():
    path = Conductor([[-20e-3, 20e-3, 0], [20e-3, 20e-3, 0]], 1e-4, 35e-6)
    bent = Bend((Zone(10e-3),), apex=30e-3).bent(path)
    assert bent.lengths.sum() == pytest.approx(40e-3, rel=1e-4)  # chords: 1/24 of the square of 0.04 rad


@pytest.mark.parametrize(("bend", "named"), [
    (Bend((Zone(-1e-3),), neutral=-2e-3), "larger than the heights"), (Bend((Zone(0.999e-3),), neutral=1e-3), "larger"),
    (Bend((Zone(10e-3),), apex=5e-3), "apex"), (Bend((Zone(1e-12),)), "chords"),
])  # fmt: skip
def test_boards_that_cannot_be_bent_so_are_refused(bend, named):
    with pytest.raises(GeometryError, match=named):
        bend.bent(Conductor([[10e-3, -4e-3, 0], [10e-3, 4e-3, 0]], 1e-4, 35e-6))


def test_only_a_current_path_is_bent():
    with pytest.raises(GeometryError, match="path must be a Conductor"):
        Bend((Zone(8e-3),)).bent(Spiral(6, 12e-3, 4, 0.3e-3, 0.3e-3))


STRIP = Array.row(Spiral(6, 10e-3, 2, 0.3e-3, 0.3e-3), 3, pitch=11e-3)
"""A board of 34 × 15 mm and 0.27 mm with its upper face at z = 0."""
SLOW = pytest.mark.slow


def test_an_array_follows_its_form_and_stays_flat_where_it_is_made():
    bend = Bend((Zone(8e-3),), axis=math.pi / 2)
    bent = STRIP.bent(bend)
    for path, flat, found in zip(bent.conductors(), STRIP.conductors(), bent.flat_conductors(), strict=True):
        np.testing.assert_array_equal(path.vertices, bend.bent(flat).vertices)
        np.testing.assert_array_equal(found.vertices, flat.vertices)
    assert bent.bounds == STRIP.bounds
    assert [placement.x for placement in bent.flat.placements] == [placement.x for placement in bent.placements]
    np.testing.assert_array_equal(dc_resistance(bent), dc_resistance(STRIP))
    other = STRIP.bent(Bend((Zone(9e-3),), axis=math.pi / 2))
    assert len({Design(board).digest for board in (STRIP, bent, other)}) == 3


def test_the_resistance_of_a_bent_coil_is_that_of_the_flat_coil():
    flat = Array.row(Spiral(4, 10e-3, 2, 0.3e-3, 0.3e-3, layers=1), 1)
    bent = flat.bent(Bend((Zone(8e-3),)))
    ac, expected = (resistance_matrix(board, 1e5).resistance for board in (bent, flat))
    np.testing.assert_array_equal(ac, expected)


@pytest.mark.parametrize(("bend", "named"), [
    (Bend((Zone(0.4e-3),), neutral=-0.135e-3), "inner radius"), (Bend((Zone(-0.2e-3, width=1e-3),)), "inner radius"),
    (Bend((Zone(5e-3),), axis=math.pi / 2), "meet itself"),
    (Bend((Zone(1.5e-3, -5e-3, 4.7e-3), Zone(1.5e-3, 5e-3, 4.7e-3)), axis=math.pi / 2), "meet itself"),
    (Bend((Zone(3e-3, at=30e-3, width=1e-3),)), "on the board"), (Bend((Zone(3e-3),), apex=10e-3), "apex"),
    (Bend((Zone(3e-3),), apex=30e-3), "meet itself"),
])  # fmt: skip
def test_boards_that_cannot_have_a_form_are_refused(bend, named):
    with pytest.raises(GeometryError, match=named):
        STRIP.bent(bend)


def test_the_inner_radius_is_that_of_the_face_inside():
    bounds, thickness = (-10e-3, -5e-3, 10e-3, 5e-3), 0.4e-3
    assert Bend((Zone(5e-3),), neutral=-0.1e-3).inner_radius(bounds, thickness) == pytest.approx(4.7e-3)
    assert Bend((Zone(-5e-3),), neutral=-0.1e-3).inner_radius(bounds, thickness) == pytest.approx(4.9e-3)
    # the curvature of a cone grows towards its apex: there R·(40 − 10)/40
    assert Bend((Zone(8e-3),), apex=40e-3).inner_radius(bounds, 0.0) == pytest.approx(6e-3)


def test_resistance_refuses_tilted_paths_by_name():
    path = STRIP.bent(Bend((Zone(8e-3),))).conductors()[1]
    with pytest.raises(GeometryError, match="coil2"):
        resistance_matrix([path], 1e6)


@pytest.mark.parametrize(("more", "key"), [
    ({"sheets": (Sheet("base", 1e-3), Sheet("magnetic", 1e-3, 2.0))}, "elastomer.1.relative_permeability"),
    ({"plates": (Plate("plate", 5e-3, 1e-3, MATERIALS["copper"]),)}, "plate.0"),
    ({"target": Target(Plate("plate", 0.0, 1e-3, MATERIALS["copper"]), (1e-3,))}, "target"),
    ({"sheets": (Sheet("base", 1e-3, youngs_modulus=1e5, poissons_ratio=0.49),),
      "indentation": Indentation(Hemisphere(2e-3), (0.2e-3,))}, "indentation"),
    ({"sheets": (Sheet("thick", 30e-3),)}, "elastomer"),
])  # fmt: skip
def test_designs_refuse_what_needs_a_flat_board(more, key):
    Design(STRIP, **more)
    with pytest.raises(DesignError, match=key):
        Design(STRIP.bent(Bend((Zone(-20e-3),))), **more)


def test_the_circuit_of_a_bent_board_names_what_it_leaves_out():
    pair = Array.row(Spiral(4, 10e-3, 2, 0.3e-3, 0.3e-3, layers=1), 2, pitch=11e-3)
    flat, bent = (board_circuit(Design(board)) for board in (pair, pair.bent(Bend((Zone(50e-3),), math.pi / 2))))
    assert [part for part in bent.network.left_out if "bend" in part]
    assert not [part for part in flat.network.left_out if "bend" in part]
    np.testing.assert_array_equal(bent.network.winding_capacitance, flat.network.winding_capacitance)
    assert 0 < abs(bent.inductance[0, 1] / flat.inductance[0, 1] - 1) < 0.3
    assert (couple_design(bent.design).z < -1e-6).all()


def test_fasthenry_gets_the_direction_of_tilted_widths():
    bent = STRIP.bent(Bend((Zone(8e-3),)))
    bars = [line for line in fasthenry_input(bent, [1e6]).splitlines() if line.startswith("E2_")]
    path = bent.conductors()[1]
    for line, across in zip(bars, path.across, strict=True):
        given = [float(part) for part in re.findall(r" w[xyz]=(\S+)", line)]
        assert given == across.tolist() or (not given and abs(across[2]) < 1e-6)
    assert sum(" wz=" in line for line in bars) > len(bars) / 4


@pytest.mark.parametrize("bend", [
    Bend((Zone(8e-3),), axis=math.pi / 2, neutral=-0.135e-3), pytest.param(Bend((Zone(-9e-3),), axis=0.3), marks=SLOW),
    pytest.param(Bend((Zone(6e-3, -6e-3, 5e-3), Zone(-8e-3, 6e-3, 5e-3)), axis=1.7), marks=SLOW),
    pytest.param(Bend((Zone(12e-3),), apex=60e-3), marks=SLOW),
])  # fmt: skip
def test_solids_are_bent_and_stay_closed(bend):
    sheets = (Sheet("base", 1e-3),)
    flat, bent = solids(STRIP, sheets), solids(STRIP.bent(bend), sheets)
    assert set(bent) == set(flat)
    for name, solid in bent.items():
        assert solid.is_watertight, name
        assert solid.is_winding_consistent, name
        low, high = flat[name].bounds[:, 2] - bend.neutral
        if len(bend.zones) == 1 and bend.apex is None:
            # a shell grows by its mean height over the radius, and facets of 0.06 rad lose 1/6 of their square,
            # twisted walls at oblique edges as much again
            grown = 1 + (low + high) / 2 / bend.zones[0].radius
            assert solid.volume == pytest.approx(flat[name].volume * grown, rel=1.2e-3)


@pytest.mark.slow
def test_files_of_solids_are_bent(tmp_path):
    bent = Design(STRIP.bent(Bend((Zone(8e-3),), axis=math.pi / 2)))
    export(bent, tmp_path / "board.stl")
    (x_min, _, z_min), (x_max, _, z_max) = trimesh.load(tmp_path / "board.stl").bounds
    assert -8.0 <= x_min < -7.5
    assert 7.5 < x_max <= 8.0
    assert z_min < -10.0
    assert z_max == pytest.approx(0.0, abs=1e-6)
    export(bent, tmp_path / "board.glb")
    for design, name in ((bent, "bent"), (Design(STRIP), "flat")):
        export(design, tmp_path / f"{name}.svg")
    assert (tmp_path / "bent.svg").read_bytes() == (tmp_path / "flat.svg").read_bytes()
    with pytest.raises(OutputError, match="STEP"):
        export(bent, tmp_path / "board.step")
    assert not (tmp_path / "board.step").exists()


@pytest.mark.slow
def test_a_scene_shows_the_bent_board_and_names_its_coils_there():
    bend = Bend((Zone(8e-3),), axis=math.pi / 2)
    bent = STRIP.bent(bend)
    scene = board_scene(bent, (Sheet("base", 1e-3),))
    places = {text.text: text.position for text in scene.texts if text.text in bent.names}
    np.testing.assert_allclose([places[name] for name in bent.names], 1e3 * bent.places)
    np.testing.assert_allclose(bent.places, bend.surface(np.column_stack((STRIP.centres, np.zeros(3)))))
    edges = next(part.mesh for part in scene.parts if part.name == "edges of board")
    laminate = next(part.mesh for part in scene.parts if part.name == "board")
    np.testing.assert_allclose(edges.bounds, laminate.bounds, atol=5e-3)  # mm; facets of 0.06 rad of 8 mm
    assert meshes.coupling_arcs(bent.places, np.full((3, 3), 0.1)).bounds[4] < -5.0


@pytest.mark.parametrize(("radius", "change"), [(4e-3, 0.07), (8e-3, 0.02)])
@pytest.mark.parametrize("axis", [0.0, math.pi / 2])
def test_a_bend_changes_the_eddy_losses_of_a_coil_by_few_percent(radius, change, axis):
    """The bound that docs/guide/space.md states for the resistance, which is that of the flat pattern.

    Eddy losses of narrow traces are the squared field along their thickness, summed over the length.
    """

    def losses(path):
        middles = (path.vertices[1:] + path.vertices[:-1]) / 2
        normals = np.cross(np.diff(path.vertices, axis=0), path.across)
        along = (magnetic_field([path], middles) * normals).sum(axis=1) / path.lengths
        return float((along**2 * path.lengths)[path.areas == trace].sum())

    coil = Array.row(Spiral(6, 10e-3, 8, 0.15e-3, 0.15e-3), 1).conductors()[0]
    trace = coil.areas[0]
    count = np.ceil(coil.lengths / 0.1e-3).astype(int)  # shorter than the chords of the bends, which leave them whole
    starts, steps = (np.repeat(part, count, axis=0) for part in (coil.vertices[:-1], np.diff(coil.vertices, axis=0)))
    share = np.concatenate([np.arange(n) / n for n in count])[:, None]
    sizes = (np.repeat(size, count) for size in (coil.widths, coil.thicknesses, coil.areas))
    flat = Conductor(np.vstack((starts + share * steps, coil.vertices[-1:])), *sizes)
    bent = Bend((Zone(radius),), axis, neutral=-0.135e-3).bent(flat)
    assert len(bent.lengths) == len(flat.lengths)
    assert losses(bent) == pytest.approx(losses(flat), rel=change)


def test_a_rectangle_around_a_cylinder_is_a_saddle():
    """Another generator of the same loop, with chords a tenth as long: M with a loop of other shape."""
    radius, length, angle = 10e-3, 24e-3, 2.0
    width = radius * angle
    corners = [(-length / 2, -width / 2), (length / 2, -width / 2), (length / 2, width / 2), (-length / 2, width / 2)]
    flat = Conductor([(x, y, 0.0) for x, y in (*corners, corners[0])], 1e-6, 1e-6)
    bent = Bend((Zone(radius),)).bent(flat)
    # the saddle's axis is z and its middle on +x, the board's axis x and its middle at the origin
    arcs = saddle(radius, length, angle, 1e-6, segments=3000)
    expected = Conductor([(z, y, x - radius) for x, y, z in arcs.vertices], 1e-6, 1e-6)
    other = [[x, y, 3e-3] for x, y in ((-9e-3, -5e-3), (8e-3, -6e-3), (2e-3, 9e-3), (-9e-3, -5e-3))]
    found, M = (abs(mutual_inductance([path], [other])[0, 0]) for path in (bent, expected))
    assert found == pytest.approx(M, rel=1e-4)


@pytest.mark.slow
@pytest.mark.parametrize(("bend", "turns"), [
    (Bend((Zone(8e-3),), axis=math.pi / 2), 4), (Bend((Zone(-3e-3, 2e-3, 6e-3),), axis=0.3), 2),
    (Bend((Zone(6e-3),), apex=30e-3), 3),
])  # fmt: skip
def test_inductance_of_bent_coils_converges_below_its_bound(bend, turns):
    """Chords of a third change L by less than 1e-4, and by most of the error, which falls as their square."""
    coil = Array.row(Spiral(6, 10e-3, turns, 0.3e-3, 0.3e-3), 1).conductors()[0]
    found = self_inductance([bend.bent(coil)])[0]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("coilarray.geometry.bend._STEP", 0.04 / 3)
        patch.setattr("coilarray.geometry.bend._SAGITTA", 6e-5 / 9)
        finer = self_inductance([bend.bent(coil)])[0]
    assert abs(found - finer) < 8 / 9 * 1e-4 * finer
    assert abs(found / self_inductance([coil])[0] - 1) > 3e-3  # the bend counts


def test_copper_that_overlaps_on_a_bent_board_is_refused():
    """Overlaps are those of the flat pattern, also where the board is tilted."""
    near = Array.row(Spiral(6, 10e-3, 2, 0.3e-3, 0.3e-3, layers=1, leads=None), 2, pitch=11e-3)
    moved = near.with_placements([replace(place, x=place.x * 0.9) for place in near.placements])
    bent = moved.bent(Bend((Zone(4e-3),), axis=math.pi / 2))
    for source in (bent, moved):
        with pytest.raises(GeometryError, match="overlaps on layer"):
            inductance_matrix(source)
    with pytest.raises(GeometryError, match="overlaps"):
        assert bent.inductance is None
    assert inductance_matrix(near.bent(Bend((Zone(4e-3),), axis=math.pi / 2)))[0, 0] > 0
