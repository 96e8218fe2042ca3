"""Errors of a board on its geometry, and what they do to R, L and the tank by closed forms."""

import math
import pickle
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.tolerance_boards import WIDTH, loops

from coilarray import load_design
from coilarray.circuit.coupling import couple_design, design_inductance
from coilarray.electromagnetics.resistance import dc_resistance
from coilarray.errors import GoalError
from coilarray.geometry import MATERIALS, Disc, FinitePlate, Plate, Target
from coilarray.studies.tolerance import error_names, perturb

GAST = load_design("gast2020")
STARTER = load_design("starter")
ROUNDING = 1e-12  # relative, of a few operations in double precision


def resistances(design):
    return dc_resistance(design.array.conductors(), design.circuit.resistivity)


def heights(design):
    return np.array([design.array.stackup.centre(name) for name in design.array.stackup.names])


def test_every_error_makes_another_board_which_travels_to_another_process():
    boards = {perturb(GAST, {name: 1e-6}).digest for name in error_names(GAST)}
    assert len(boards | {GAST.digest}) == len(error_names(GAST)) + 1
    board, errors = perturb(GAST, {"etch.L1": 1e-6, "copper.L2": 0.1}), {"copper.L2": 0.1, "etch.L1": 1e-6}
    assert board.digest == perturb(GAST, errors).digest == pickle.loads(pickle.dumps(board)).digest


@settings(max_examples=20)
@given(st.floats(-0.9, 5.0))
def test_resistance_goes_with_one_over_width_and_thickness(part):
    design = loops()
    found = resistances(perturb(design, {"etch.L1": part * WIDTH, "copper.L2": 0.2}))
    np.testing.assert_allclose(found, resistances(design) / [1 + part, 1.2], rtol=ROUNDING)


def test_etch_leaves_the_middle_line_and_the_pitch():
    etched = perturb(GAST, {f"etch.L{k}": -12e-6 for k in range(1, 5)})
    for before, after in zip(GAST.array.placements, etched.array.placements, strict=True):
        for line, other in zip(before.coil.lines, after.coil.lines, strict=True):
            np.testing.assert_array_equal(line, other)
        # half a nanometre: pitch and widths are read as millimetres
        assert after.coil.gap == pytest.approx(before.coil.gap + 12e-6, abs=1e-15)
        assert after.coil.trace_width == pytest.approx(before.coil.trace_width - 12e-6, abs=1e-15)


def test_a_layer_has_its_etch_alone():
    etched = perturb(GAST, {"etch.L4": 5e-6}).array.placements  # of the first coil, not of the second
    widths = [[float(width[0]) for width in place.coil.widths] for place in etched[:2]]
    np.testing.assert_allclose(widths, [[1e-4, 1.05e-4], [1e-4, 1e-4]], rtol=ROUNDING)


def test_dielectrics_and_copper_move_the_layers_below():
    before = heights(GAST)
    thicker = heights(perturb(GAST, {"dielectric.L2-L3": 0.1}))
    sunk = -0.1 * GAST.array.stackup.dielectric_thickness[1]
    np.testing.assert_allclose(thicker - before, [0, 0, sunk, sunk], atol=1e-18)
    # the middle of thicker copper sinks by half of what it gains, for the upper face stays
    plated = heights(perturb(GAST, {"copper.L2": 0.2}))
    np.testing.assert_allclose(plated - before, [0, -3.5e-6, -7e-6, -7e-6], atol=1e-18)


def test_holes_stay_and_the_rest_of_the_layer_moves():
    shift = np.array([20e-6, -30e-6])
    moved = perturb(GAST, {"registration_x.L2": shift[0], "registration_y.L2": shift[1]}).array.placements
    for before, after in zip(GAST.array.placements, moved, strict=True):
        np.testing.assert_array_equal(after.coil.via_points, before.coil.via_points)
        np.testing.assert_array_equal(after.coil.terminal_points, before.coil.terminal_points)
        for layer, line, other in zip(before.layers, before.coil.lines, after.coil.lines, strict=True):
            expected = np.tile(shift if layer == "L2" else (0, 0), (len(line) - 2, 1))
            # coordinates of some cm, to rounding
            np.testing.assert_allclose((other - line)[1:-1], expected, atol=1e-16)


def test_registration_is_in_the_frame_of_the_board():
    first, *others = GAST.array.placements
    turned = replace(first, rotation=0.7)
    board = replace(GAST, array=GAST.array.with_placements([turned, *others]))
    after = perturb(board, {"registration_x.L3": 10e-6}).array.placements[0]
    away = after.to_board(after.coil.lines[0]) - turned.to_board(turned.coil.lines[0])
    np.testing.assert_allclose(away[1:-1], np.tile([10e-6, 0], (len(away) - 2, 1)), atol=1e-16)


def test_rotation_is_about_the_middle_of_the_board():
    angle = 2e-4
    after = perturb(GAST, {"rotation.L3": angle}).array
    x_min, y_min, x_max, y_max = GAST.array.bounds
    middle = np.array([x_min + x_max, y_min + y_max]) / 2
    turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    for place, moved in zip(GAST.array.placements[::2], after.placements[::2], strict=True):
        wanted = (place.to_board(place.coil.lines[0]) - middle) @ turn.T + middle
        np.testing.assert_allclose(moved.to_board(moved.coil.lines[0])[1:-1], wanted[1:-1], atol=1e-16)
    # coils without copper on L3 are left alone
    np.testing.assert_array_equal(after.placements[1].coil.lines[0], GAST.array.placements[1].coil.lines[0])


@pytest.mark.slow
def test_all_layers_shifted_alike_couple_as_before():
    """But for the ends at the holes, whose last segments turn a little."""
    shift = {f"registration_x.L{k}": 50e-6 for k in range(1, 5)}
    L, moved = (design_inductance(design)[0] for design in (STARTER, perturb(STARTER, shift)))
    one = design_inductance(perturb(STARTER, {"registration_x.L1": 50e-6, "registration_x.L2": 50e-6}))[0]
    # a shift of one coil against the next by as much changes M some hundred times more
    assert np.abs(moved - L).max() < 0.02 * np.abs(one - L).max()


def test_sheets_have_their_thickness_and_the_magnetic_ones_their_permeability():
    sheets = perturb(GAST, {"permeability": 0.1, "elastomer.magnetic": -0.1e-3}).sheets
    found = [(sheet.relative_permeability, sheet.thickness) for sheet in sheets]
    np.testing.assert_allclose(
        found, [(1.0, 6e-3), (1.1 * GAST.sheets[1].relative_permeability, 1.9e-3)], rtol=ROUNDING
    )


def test_permeability_of_a_half_space_is_its_mirror_image():
    """A thick sheet adds β F with β = (μr − 1)/(μr + 1), so that ΔL changes by 2 dμr/(μr + 1)²/β of itself."""
    sheets = """
[[elastomer]]
name = "gap"
thickness_mm = 2.0
[[elastomer]]
name = "magnetic"
thickness_mm = 200.0
relative_permeability = 3.0
"""
    design, error = loops(sheets=sheets), 1e-4
    before, after = (design_inductance(one)[1] for one in (design, perturb(design, {"permeability": error})))
    expected = 2 * 3 * error / 4**2 / (2 / 4)
    # second order in the error, which is 1e-4
    np.testing.assert_allclose(after / before - 1, expected, rtol=1e-3)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:.*resistivity_ohm_m of 1e-10")
def test_frequency_goes_with_one_over_the_root_of_the_tank():
    design = loops(extra="[circuit]\nresistivity_ohm_m = 1e-10")
    slow = perturb(design, {"capacitance": 0.21})
    f, lower = (couple_design(one, ideal=True).frequency.values for one in (design, slow))
    # f² LC = 1 − R² C/L: losses count by 1e-6
    np.testing.assert_allclose(f / lower, 1.1, rtol=1e-6)
    assert slow.circuit.switches.tank_capacitance == slow.circuit.capacitance


@pytest.mark.parametrize(("errors", "message"), [
    ({"etch.L9": 1e-6}, "no error 'etch.L9'"), ({"etch": 1e-6}, "no error 'etch'"),
    ({"placement_z": 1e-6}, "did you mean placement_"), ({"etch.L1": math.nan}, "etch.L1 must be finite"),
    ({"etch.L1": -0.1e-3}, "no board can be made with these errors: trace_width must be positive"),
    ({"etch.L1": 0.21e-3}, "no board can be made with these errors: gap must be positive"),
    ({"dielectric.L1-L2": -1.0}, "no board can be made with these errors: a layer thickness"),
    ({"copper.L1": -1.5}, "no board can be made with these errors: a layer thickness"),
    ({"elastomer.base": -6e-3}, "no board can be made with these errors: thickness of sheet 'base'"),
    ({"permeability": -0.9}, "no board can be made with these errors: relative permeability"),
    ({"permeability": -1.2}, "permeability must be above"), ({"capacitance": -1.0}, "capacitance must be above"),
])  # fmt: skip
def test_bad_errors_are_refused_in_one_line(errors, message):
    with pytest.raises(GoalError, match=r"^[^\n]+$") as caught:
        perturb(GAST, errors)
    assert message in str(caught.value)


def test_plates_keep_or_move_their_face_near_the_coils_and_a_target_adds_its_tilts():
    aluminium, brass = MATERIALS["aluminium"], MATERIALS["brass"]
    plates = (
        Plate("cover", 12e-3, 1e-3, aluminium),
        FinitePlate("back", Disc(8e-3), (0.0, 0.0, -5e-3), 2e-3, brass, tilt=0.1),
    )
    body = FinitePlate("target", Disc(8e-3), (0.0, 0.0, 0.0), 1e-3, aluminium, tilt=0.03, tilt_direction=math.pi / 2)
    design = replace(STARTER, plates=plates, target=Target(body, (1e-3,), (0.0,), (0.0,)))
    assert set(error_names(design)) - set(error_names(STARTER)) == {
        "plate_distance.cover", "plate_distance.back", "plate_thickness.cover", "plate_thickness.back", "conductivity",
        "target_tilt_x", "target_tilt_y",
    }  # fmt: skip
    errors = {"plate_distance.back": 0.2e-3, "plate_thickness.cover": 0.1, "plate_thickness.back": 0.1}
    found = perturb(design, {**errors, "conductivity": -0.2, "target_tilt_x": 0.04})
    cover, back = found.plates
    np.testing.assert_allclose(cover.heights, (12e-3, 13.1e-3), rtol=ROUNDING)
    assert back.heights[1] == pytest.approx(plates[1].heights[1] - 0.2e-3, rel=ROUNDING)
    assert back.thickness == pytest.approx(2.2e-3, rel=ROUNDING)
    conductivities = [one.material.conductivity for one in (cover, back, found.target.body)]
    before = [aluminium.conductivity, brass.conductivity, aluminium.conductivity]
    np.testing.assert_allclose(conductivities, np.multiply(0.8, before), rtol=ROUNDING)
    tilted = found.target.body
    assert (tilted.tilt, tilted.tilt_direction) == pytest.approx((0.05, math.atan2(3, 4)), rel=1e-12)
    sheet, (upper, lower) = STARTER.sheets[0].name, STARTER.array.stackup.names[:2]
    touching = replace(design, plates=(plates[0].lifted(STARTER.top - 12e-3),), target=None)
    thicker = {f"elastomer.{sheet}": 20e-6, f"dielectric.{upper}-{lower}": 0.1, "plate_distance.cover": -30e-6}
    found = perturb(touching, thicker)
    assert found.plates[0].heights[0] == pytest.approx(found.top, rel=ROUNDING)
    assert found.top == pytest.approx(STARTER.top + 20e-6, rel=ROUNDING)
    for error in ("plate_thickness.cover", "conductivity"):
        with pytest.raises(GoalError, match="must be above −1"):
            perturb(design, {error: -1.0})


def test_a_misplaced_elastomer_takes_its_sample_along():
    """The bounds of the sample are from the origin of the map, which moves with the elastomer."""
    before, after = GAST.indentation, perturb(GAST, {"placement_x": 0.1e-3, "placement_y": -0.2e-3}).indentation
    np.testing.assert_allclose(np.subtract(after.origin_point, before.origin_point), [0.1e-3, -0.2e-3], atol=1e-15)
    assert after.sample_bounds == before.sample_bounds
