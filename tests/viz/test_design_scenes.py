"""Scenes of a design: that they show what the library computes, where the design says, and refuse what cannot be."""

import math
from dataclasses import replace

import numpy as np
import pytest
import xarray as xr

from coilarray import load_design
from coilarray.circuit.coupling import couple_design, design_circuit, operating_field
from coilarray.circuit.network import resonate
from coilarray.design.vary import vary
from coilarray.errors import CoilarrayError, ElastomerError, GeometryError, LocalizeError
from coilarray.localize.forward import forward_model
from coilarray.localize.inverse import locate
from coilarray.response.dataset import on_board, origin_attributes
from coilarray.viz.datasets.meshes import RISE
from coilarray.viz.datasets.results import AMOUNT, COUPLING, field_grid
from coilarray.viz.scenes.design import ITEMS, View, scene_of_coils, scene_of_design
from coilarray.viz.scenes.results import (
    CURRENT,
    Span,
    count_of,
    field_box,
    field_planes,
    line_seeds,
    points_of_box,
    scene_of_location,
)
from coilarray.viz.scenes.scene import rounded_up


@pytest.fixture(scope="module")
def design():
    quick = vary(load_design("starter"), {"indentation.strain": "linear"})  # its dent looks the same
    beside = replace(quick.indentation, origin=None, origin_point=(1e-3, 0.5e-3))  # its map's origin is off the board's
    return replace(quick, indentation=beside)


@pytest.fixture(scope="module")
def coupling(design):
    return couple_design(design)


@pytest.fixture(scope="module")
def table(design):
    """Response of a bell over every coil: quick, and enough for a position."""
    depth, y, x = np.array([0.3e-3, 0.6e-3]), np.linspace(-5e-3, 5e-3, 5), np.linspace(-14e-3, 14e-3, 11)
    H, Y, X = np.meshgrid(depth, y, x, indexing="ij")
    centres = (design.array.centres - design.indentation.origin_point).tolist()
    width = 6e-3 * (1 + 100 * H)  # with a depth of its own, else y and depth are one unknown
    bells = [4e-3 * (H / 1e-3) ** 1.6 * np.exp(-((X - cx) ** 2 + (Y - cy) ** 2) / width**2) for cx, cy in centres]
    return xr.Dataset(
        {"delta": (("depth", "y", "x", "state"), np.stack(bells, axis=-1))},
        {"depth": depth, "y": y, "x": x, "state": [state.name for state in design.plan]},
        {"noise": 1e-6, **origin_attributes(design.indentation)},
    )


def parts_of(scene):
    return {part.name: part for part in scene.parts}


def test_sheets_are_lifted_off_the_board_unless_other_things_are_shown(design):
    parts = parts_of(scene_of_design(design, View(show=("board", "elastomer"))))
    assert {"board", "barrels", "sheet base", "sheet magnetic"} <= set(parts)
    assert parts["sheet base"].mesh.bounds[4] > 5.0
    assert set(parts_of(scene_of_design(design))) == set(parts) - {
        "sheet base", "sheet magnetic", "edges of sheet base", "edges of sheet magnetic",
    }  # fmt: skip
    parts = parts_of(scene_of_design(design, View(show=("board", "elastomer"), layers=("L1",))))
    assert parts["sheet base"].mesh.bounds[4:] == pytest.approx((0.0, 3.0))
    assert "copper L1" in parts
    assert "copper L3" not in parts


@pytest.mark.slow
def test_a_dent_takes_the_place_of_the_sheets(design):
    scene = scene_of_design(design, View(show=("board", "elastomer", "dent"), at=(1e-3, 2e-3), depth=0.5e-3))
    parts = parts_of(scene)
    body = parts["indenter"].mesh
    at = np.array([1e-3, 2e-3])
    tip = body.points[body.points[:, 2].argmin()]
    thickness = sum(sheet.thickness for sheet in design.sheets)
    np.testing.assert_allclose(tip, [*(at * 1e3), (thickness - 1.5e-3) * 1e3], atol=1e-5)  # single precision
    assert parts["indenter"].group.endswith("0.5 mm deep, drawn 3 ×")
    sheet = parts["sheet magnetic"]
    assert sheet.opacity == 1.0
    # the colours are the real displacement, and the shape is three times as deep
    rise = sheet.mesh.point_data[RISE]
    assert rise.min() == pytest.approx(-0.5e-3, rel=1e-3)
    deepest = sheet.mesh.points[:, 2].max() - 3 * 0.5
    top = np.abs(np.linalg.norm(sheet.mesh.points[:, :2] - at * 1e3, axis=1)) < 1e-6
    assert sheet.mesh.points[top, 2].max() == pytest.approx(deepest, abs=0.05)
    assert sheet.scale.unit == "m"
    # coils under the sheets have no names
    named = {text.text for text in scene.texts if text.text in design.array.names}
    seen = (design.array.centres < at).all(axis=1)
    assert named == {name for name, free in zip(design.array.names, seen, strict=True) if free}


@pytest.mark.slow
def test_arcs_are_the_coupling_of_the_design(design, coupling):
    scene = scene_of_design(design, View(show=("coupling",)))
    k = coupling.coupling.values
    shown = set(np.round(np.unique(scene.parts[0].mesh.point_data[COUPLING]), 9))
    assert shown == set(np.round(k[np.triu_indices(3, 1)], 9))
    rounded_down = -rounded_up(-min(shown))
    assert (scene.scales[0].low, scene.scales[0].high) == pytest.approx((rounded_down, 0.0))  # all of one sign
    # every number stands over the middle of its coils
    for text in scene.texts:
        value = float(text.text.replace("−", "-"))
        i, j = min(((0, 1), (1, 2), (0, 2)), key=lambda pair: abs(k[pair] - value) + 1e-6 * abs(pair[0] - pair[1]))
        x = np.array([text.position[0] for text in scene.texts])
        assert np.abs(x - design.array.centres[[i, j], 0].mean() * 1e3).min() < 1e-6


@pytest.mark.slow
def test_copper_is_coloured_by_the_currents_of_the_circuit(design, coupling):
    scene = scene_of_design(design, View(show=("board", "currents"), coil="coil1"))
    solved = resonate(design_circuit(design), design.plan[0])
    seen = set()
    for name, part in parts_of(scene).items():
        if name.startswith("copper"):
            coil, value = part.mesh.cell_data["coil"], part.mesh.cell_data[CURRENT]
            assert np.isnan(value[coil == 0]).all()
            # the same network solved again
            np.testing.assert_allclose(value[coil > 0], solved.currents.real[coil[coil > 0]], rtol=1e-9)
            seen |= set(coil.tolist())
    assert seen == {0, 1, 2}
    (scale,) = scene.scales
    largest = np.abs(solved.currents.real[1:]).max()
    assert max(-scale.low, scale.high) == pytest.approx(rounded_up(largest), rel=1e-9)
    # (R + Z + jωL) i = −jωM i_1: without strays the currents of that network solve the passive loops
    ideal = resonate(design_circuit(design, ideal=True), design.plan[0])
    L, R, omega = coupling.inductance.values, coupling.resistance.values, 2j * np.pi * ideal.frequency
    Z = np.diag(R[1:] + design.circuit.short_resistance) + omega * L[1:, 1:]
    np.testing.assert_allclose(ideal.currents[1:], np.linalg.solve(Z, -omega * L[1:, 0]), rtol=1e-9)
    np.testing.assert_allclose(solved.currents[1:], ideal.currents[1:], atol=0.02 * abs(ideal.currents[1]))
    scene = scene_of_design(design, View(show=("currents",), coil="coil2", others_open=True))
    values = np.concatenate([part.mesh.cell_data[CURRENT] for part in scene.parts if part.name.startswith("copper")])
    assert set(values[np.isfinite(values)]) == {0.0}
    assert any("the others open" in note for note in scene.notes)


def test_planes_show_the_field_of_the_library(design, coupling):
    view = View(show=("field", "map"), coil="coil2", spacing=1e-3)
    scene = scene_of_design(design, view)
    parts = parts_of(scene)
    assert set(parts) == {"plane 0", "contours 0", "plane 1", "contours 1", "arrows 1"}
    assert 100 <= parts["arrows 1"].mesh.split_bodies().n_blocks / 4 <= 200  # an arrow has four surfaces
    level, upright = (np.asarray(parts[f"plane {k}"].mesh.points) for k in range(2))
    np.testing.assert_allclose(level[:, 2], design.field_height * 1e3)
    np.testing.assert_allclose(upright[:, 1], design.array.centres[1, 1] * 1e3, atol=2.0)  # middle of the outline
    x, y, z = (span.points for span in field_planes(design, "coil2", 1e-3)[0])
    field = operating_field(design, coupling, "coil2", x, y, z, current=1e-3)
    largest = float(np.sqrt((field.B**2).sum("component")).max())
    assert parts["plane 0"].mesh.point_data[AMOUNT].max() == pytest.approx(largest)
    # the whole plane is there, and its contours are at 1, 2 and 5 times powers of ten
    np.testing.assert_allclose(parts["plane 0"].mesh.bounds[:2], np.array([x[0], x[-1]]) * 1e3, rtol=1e-6)
    levels = np.unique(np.round(np.log10(parts["contours 1"].mesh.point_data[AMOUNT]) % 1, 3))
    assert set(levels) <= {0.0, 0.301, 0.699, 1.0}
    assert len(levels) >= 3
    assert scene.scales[0].unit == "T"
    assert any("coil2 carries 1 mA" in note for note in scene.notes)


@pytest.mark.slow
def test_lines_are_seeded_by_flux_in_a_box_off_the_copper(design):
    scene = scene_of_design(design, View(show=("lines",), spacing=2e-3))
    assert set(parts_of(scene)) == {"field lines"}
    assert parts_of(scene)["field lines"].mesh.point_data[AMOUNT].min() > 0
    box = field_box(design, "coil2", 1e-3)
    x, y, z = points_of_box(design, box)
    assert len(x) * len(y) * (len(z) + 5) >= count_of([box]) >= len(x) * len(y) * (len(z) - 5)
    thickness = design.array.stackup.thickness
    assert not ((z < 0.49e-3) & (z > -thickness - 0.49e-3)).any()
    assert (np.diff(z) > 0).all()
    steps = np.diff(x)
    assert steps.min() == pytest.approx(1e-3)
    assert steps[0] == pytest.approx(steps[-1])
    assert (steps[len(steps) // 2 :][1:] <= 1.21 * steps[len(steps) // 2 :][:-1]).all()
    grid = field_grid(x, y, z, np.broadcast_to([0.0, 0.0, 1e-6], (len(x), len(y), len(z), 3)))
    seeds = line_seeds(design, "coil2", grid)
    # in an even field equal flux is equal area of the rings between them
    radii = np.linalg.norm(seeds[1:6, :2] - seeds[0, :2], axis=1)
    np.testing.assert_allclose(radii**2, radii[-1] ** 2 * (np.arange(5) + 0.5) / 4.5, rtol=0.03)
    assert ((seeds[:, :2] > [x[0], y[0]]) & (seeds[:, :2] < [x[-1], y[-1]])).all()
    assert Span(0.0, 1e-3, 1e-3).count == 2
    assert Span(2e-3, 2e-3, 1e-3).points.tolist() == [2e-3]


def test_a_slider_chooses_the_measured_coil(design):
    view = View(show=("board", "currents", "map"), spacing=3e-3)
    scene = scene_of_coils(design, view)
    assert scene.slider.labels == ("coil1", "coil2", "coil3")
    assert scene.slider.first == 1
    assert len(scene.scales) == 2  # of currents and of B, for all coils
    steps = {step: {part.name for part in scene.parts if part.step == step} for step in (None, 0, 1, 2)}
    assert "board" in steps[None]
    assert not any("copper" in name for name in steps[None])
    assert {"copper L1, coil2", "plane 0, coil2"} <= steps[1]
    alone = parts_of(scene_of_design(design, replace(view, coil="coil3")))["plane 0"].mesh.point_data[AMOUNT]
    np.testing.assert_array_equal(parts_of(scene)["plane 0, coil3"].mesh.point_data[AMOUNT], alone)
    assert "coil3 carries 1 mA" in " ".join(scene.slider.notes[2])
    with pytest.raises(GeometryError, match="one slider"):
        scene_of_coils(design, View(show=("target",)))


@pytest.mark.parametrize("show", [("field",), ("lines",), ("board", "map")])
def test_a_field_that_is_too_large_is_refused_before_anything_is_computed(design, show, monkeypatch):
    monkeypatch.setattr("coilarray.viz.scenes.design.couple_design", lambda *_: pytest.fail("computed"))
    with pytest.raises(GeometryError, match=r"^a spacing of 0.002 mm gives .* GB of memory; at most 1 GB is allowed"):
        scene_of_design(design, View(show=show, spacing=2e-6))


def test_the_pin_stands_where_the_reading_is_located(design, table):
    model = forward_model(on_board(table))
    found = locate(model, model.delta([3e-3, 2.5e-3, 0.6e-3]), noise=1e-6)
    scene = scene_of_location(found, design.array.bounds, design.top)
    parts = parts_of(scene)
    pin = np.asarray(parts["pin 0"].mesh.points)
    np.testing.assert_allclose(pin[0, :2], [found.best.x * 1e3, found.best.y * 1e3], atol=1e-5)
    assert pin[1, 2] == pytest.approx(1e3 * design.top)
    assert len([name for name in parts if name.startswith("pin")]) == len(found.modes)
    assert f"x = {found.best.x * 1e3:.2f} ±" in scene.notes[0].replace("−", "-")
    # the ellipse by the factor that the legend says larger than the covariance
    (label,) = {part.group for name, part in parts.items() if name.startswith("ellipse 0")}
    factor = float(label.split("drawn ")[1].split(" ")[0]) if "drawn" in label else 1.0
    ring = (np.asarray(parts["ellipse 0"].mesh.points)[:, :2] - pin[0, :2]) * 1e-3 / factor
    distance = np.einsum("ni,ij,nj->n", ring, np.linalg.inv(found.best.covariance[:2, :2]), ring)
    np.testing.assert_allclose(distance, 5.9915, rtol=2e-2)  # χ² of two degrees of freedom at 95 %; single precision


def test_the_indenter_is_a_cross_beside_the_places_that_fit(design, table):
    parts = parts_of(scene_of_design(design, View(show=("location",), table=table, at=(-2e-3, 4e-3), depth=0.5e-3)))
    cross = np.asarray(parts["truth"].mesh.points)[:, :2].mean(axis=0)
    np.testing.assert_allclose(cross, [-2, 4], atol=1e-5)  # where the ruler of the board says
    pins = [np.asarray(part.mesh.points)[0, :2] for name, part in parts.items() if name.startswith("pin")]
    # the legend tells the position from others that fit
    colours = {part.group: part.colour for name, part in parts.items() if name.startswith("pin")}
    assert set(colours) == {"located", "may also be"}
    assert colours["located"] != colours["may also be"]
    # a reading without errors: the solver stops within a fraction of the noise of the table, in mm
    assert min(np.linalg.norm(pin - cross) for pin in pins) < 0.01


def test_ellipses_longer_than_the_board_are_not_drawn(table):
    model = forward_model(table)
    found = locate(model, model.delta([3e-3, 2.5e-3, 0.6e-3]), noise=3e-6)
    longest = math.sqrt(5.9915 * max(np.linalg.eigvalsh(mode.covariance[:2, :2])[-1] for mode in found.modes))
    told = "95 % ellipses longer than the board are not drawn."
    for length, drawn in ((1.01 * longest, True), (1e-3 * longest, False)):
        scene = scene_of_location(found, (2e-3, 1.5e-3, 2e-3 + length, 3.5e-3), 0.0)
        assert "pin 0" in parts_of(scene)
        assert any(part.name.startswith("ellipse") for part in scene.parts) == drawn
        assert (told in scene.notes) != drawn


@pytest.mark.slow
@pytest.mark.parametrize(
    ("view", "error", "message"),
    [
        (View(show=("nothing",)), GeometryError, "must be of board, elastomer, dent"),
        (View(show=()), GeometryError, "nothing to show"),
        (View(show=("board",), layers=("L9",)), GeometryError, "no copper layer 'L9'"),
        (View(show=("field",), coil="x"), GeometryError, "there is no coil 'x'; there are coil1, coil2, coil3"),
        (View(show=("board",), coil="x"), GeometryError, "there is no coil 'x'; there are coil1, coil2, coil3"),
        (View(show=("dent",), at=(1.0, 0.0)), GeometryError, "the indenter must be over the board, from"),
        (View(show=("dent",), at=(np.nan, 0.0)), GeometryError, "the indenter must be over the board, from"),
        (View(show=("dent",), depth=1.0), ElastomerError, "below the thickness of all sheets"),
        (View(show=("location",)), LocalizeError, "needs the response table"),
    ],
)
def test_mistakes_are_one_line(design, view, error, message):
    with pytest.raises(error, match=message) as caught:
        scene_of_design(design, view)
    assert "\n" not in str(caught.value)


@pytest.mark.slow
def test_designs_that_do_not_fit_are_refused():
    bare = replace(load_design("starter"), indentation=None)
    with pytest.raises(CoilarrayError, match=r"has no \[indenter\] and \[indentation\]"):
        scene_of_design(bare, View(show=("dent",)))
    with pytest.raises(
        GeometryError, match=r"nothing to show for coupling\. There is only one coil, and so no coupling"
    ):
        scene_of_design(load_design("gast_fem"), View(show=("coupling",)))


@pytest.mark.slow
def test_everything_together(design, table):
    show = tuple(item for item in ITEMS if item not in ("plates", "target", "eddies"))  # tests/viz/test_metal_scenes.py
    scene = scene_of_design(design, View(show=show, at=(3e-3, 2e-3), table=table, spacing=2e-3))
    names = [part.name for part in scene.parts]
    assert len(names) == len(set(names))
    assert len(scene.scales) == 3  # currents, coupling, field
    assert np.isfinite(scene.bounds).all()
