"""What the studio computes, without any page: values in, numbers out, held against the library's own functions."""

import math
import tomllib
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr
from hypothesis import given, settings
from hypothesis import strategies as st
from support.browser import bells, quick_run

from coilarray import couple_design, load_design
from coilarray.circuit.coupling import design_circuit
from coilarray.circuit.network import resonate
from coilarray.compute.display_units import value_text
from coilarray.design import bundled
from coilarray.design.fab_limits import load_profile
from coilarray.design.model import build_design, build_design_file, load_design_file, parse_design, parse_design_file
from coilarray.design.vary import vary, vary_chosen
from coilarray.electromagnetics.field import magnetic_field
from coilarray.errors import DesignError, ElastomerError, GeometryError, LocalizeError, NetworkError, OutputError
from coilarray.geometry import MATERIALS, Ball, Plate, Target, check_rules
from coilarray.localize.inverse import Location, Mode, location_lines
from coilarray.response.target import target_map
from coilarray.studies.quantities import evaluate
from coilarray.studies.sweep import parse_axis
from coilarray.viz.scenes.results import scene_of_location
from coilarray.viz.scenes.scene import Part, Scale, Scene
from coilarray.viz.studio import metal, numbers, structure, studies
from coilarray.viz.studio.design import DesignPanel, NewPanel, choices_of
from coilarray.viz.studio.drawing import board_drawing, delta_bars, delta_fills, pins, top_view
from coilarray.viz.studio.entries import entries_of, number_of, text_of
from coilarray.viz.studio.numbers import circuit_of, numbers_of
from coilarray.viz.studio.runs import front_rows, read_runs, run_folders, run_lines, run_of
from coilarray.viz.studio.session import Trail
from coilarray.viz.studio.switches import kept_settings, state_of, unit_fields
from coilarray.viz.studio.touch import crossing_line, first_place, sensor_of, touch_drawing, touched
from coilarray.viz.studio.view import _legend
from coilarray.viz.studio.work import MOST_COILS, Shelf, require_small, work_on

WOUND = "coils.hexagon.winding_layers"
OPENED = load_design_file("starter")


def with_entries(work, changes):
    """A design with other values, as of a point of a sweep."""
    return work.with_document(work.document_with(changes))


def with_entry(work, key, text):
    """A design as after a number is typed."""
    return with_entries(work, {key: number_of(key, text)})


@pytest.fixture(scope="module")
def starter():
    return OPENED.design


@pytest.fixture(scope="module")
def sensor(starter):
    return sensor_of(starter, bells(OPENED.document, starter.name))


@pytest.mark.parametrize("name", ["gast2020", "gast_fem", "starter"])
def test_every_slider_reaches_its_value_and_every_value_can_be_entered(name):
    file = load_design_file(name)
    entries = entries_of(file)
    assert len({entry.key for entry in entries}) == len(entries) > 15
    work = work_on(file, name)
    for entry in entries:
        assert entry.low <= entry.value <= entry.high
        assert entry.step > 0
        again = with_entry(work, entry.key, text_of(entry.value))
        assert again.design.digest == file.design.digest  # its own value changes nothing
        assert entry.value == pytest.approx(file.values.get(entry.key, entry.value))


def test_a_change_is_what_the_library_makes_of_it_and_is_no_longer_assumed(starter):
    work = work_on(OPENED, "starter")
    wider = with_entry(work, "array.pitch_mm", " 12.5 ")
    document = {**OPENED.document, "array": {**OPENED.document["array"], "pitch_mm": 12.5}}
    assert wider.design.digest == build_design(document).digest
    assert (work.changed, wider.changed) == (False, True)
    assert work.design is starter  # values, not states
    assert with_entry(wider, "array.pitch_mm", text_of(OPENED.values["array.pitch_mm"])).design.digest == starter.digest
    design = load_design_file("gast2020")
    assert "array.pitch_mm" in design.assumed
    work = with_entry(work_on(design, "gast2020"), "array.pitch_mm", "13.28")
    assert set(design.assumed) - set(work.opened.assumed) == {"array.pitch_mm"}
    layer = with_entry(work_on(design, "gast2020"), "stackup.dielectric_thickness_mm.1", "0.3")
    assert layer.opened.values["stackup.dielectric_thickness_mm"] == [0.215, 0.3, 0.215]
    assert "stackup.dielectric_thickness_mm" not in layer.opened.assumed


@pytest.mark.parametrize(
    ("key", "text", "line"),
    [
        ("array.pitch_mm", "wide", "array.pitch_mm must be a number; got 'wide'."),
        ("array.pitch_mm", "nan", "array.pitch_mm must be a finite number; got 'nan'."),
        ("array.pitch_mm", "0", "array.pitch_mm must be greater than 0; got 0."),
        ("array.columns", "2.5", "array.columns must be a whole number; got 2.5."),
        ("array.columns", "1000", f"array.columns must leave at most {MOST_COILS} coils for the studio to follow; got 1000."),  # noqa: E501
        ("coils.hexagon.turns_per_layer", "12.1", "coils.hexagon: turns must be a multiple of 1/6"),
        ("elastomer.0.relative_permeability", "0.5", "elastomer.0.relative_permeability must be at least 1; got 0.5."),
        ("array.spacing", "3", "array has no key 'spacing'"),
    ],
)  # fmt: skip
def test_a_wrong_value_is_one_line_without_the_name_of_the_design(starter, key, text, line):
    work = work_on(OPENED, "starter")
    with pytest.raises(DesignError) as refused:
        with_entry(work, key, text)
    assert str(refused.value).startswith(line)
    assert "\n" not in str(refused.value)
    assert not work.changed


def test_a_design_is_built_piece_by_piece(starter):
    """Each step gives a document that is read, and says nothing of what it has not changed."""

    def then(function, *arguments, **named):
        nonlocal work
        before = work.design
        work = work.with_document(function(work.opened.document, before, *arguments, **named))
        return work.design

    work = work_on(load_design_file("starter"), "starter")
    more = then(structure.add_coil).array
    assert [place.name for place in more.placements] == ["coil1", "coil2", "coil3", "coil4"]
    np.testing.assert_allclose(more.centres[3], more.centres[2] + (more.centres[2] - more.centres[1]), atol=1e-9)
    assert more.placements[3].layers == more.placements[1].layers != more.placements[2].layers
    for key, value in (("x_mm", 5.0), ("y_mm", -7.5), ("rotation_deg", 30.0)):
        moved = then(structure.place_coil, "coil4", key, value).array.placements[3]
    assert (moved.x, moved.y, moved.rotation) == pytest.approx((5e-3, -7.5e-3, math.pi / 6))
    assert list(then(structure.remove_coil, "coil1").array.names) == ["coil2", "coil3", "coil4"]
    counts = {"square": 4, "hexagonal": 4, "linear": 4, "triangle": 6, "rings": 7, "single": 1, "free": 1}
    for kind, count in counts.items():
        assert structure.lattice_sizes(kind, len(work.design.array.names))[1] == count  # which is said before
        assert len(then(structure.set_lattice, kind).array.names) == count
        assert work.opened.document["array"]["lattice"] == kind
    thick = sum(work.design.array.stackup.dielectric_thickness)
    six = then(structure.set_layers, 6).array.stackup
    assert len(six.names) == 6
    assert sum(six.dielectric_thickness) == pytest.approx(thick, abs=5 * 0.05e-6)  # each is rounded to 0.1 µm
    made_up = {"layers", "copper_thickness_um", "dielectric_thickness_mm", "dielectric_epsilon_r"}
    assert {key for key, why in work.opened.assumed.items() if why == "set by the studio"} == {
        f"stackup.{key}" for key in made_up
    }
    assert then(structure.set_leads, there=False).array.placements[0].coil.terminal is None
    assert then(structure.set_leads, there=True).array.placements[0].coil.terminal is not None
    assert then(structure.set_base, "seat").indentation.base.stiffness > 0
    assert work.opened.assumed["indentation.seat_stiffness_kPa_per_mm"] == "set by the studio"
    assert then(structure.set_base, "bonded").indentation.base == "bonded"
    assert [sheet.name for sheet in then(structure.add_sheet).sheets] == ["base", "magnetic", "sheet1"]
    assert work.opened.assumed["elastomer.2.youngs_modulus_kPa"] == "set by the studio"
    kept = {key for key in work.opened.assumed if key.startswith("elastomer.1.")}
    assert [sheet.name for sheet in then(structure.remove_sheet, 0).sheets] == ["magnetic", "sheet1"]
    assert {key.replace("elastomer.0.", "elastomer.1.") for key in work.opened.assumed if "elastomer.0." in key} == kept
    then(structure.remove_sheet, 0)
    assert then(structure.remove_sheet, 0).indentation is None
    then(structure.add_sheet)
    assert work.opened.assumed["indenter.radius_mm"] == "set by the studio"
    then(structure.remove_sheet, 0)
    assert then(structure.set_connector, "top").array.routing.connector.side == "top"
    assert then(structure.set_connector, "none").array.routing is None
    for wrong, arguments, line in (
        (structure.remove_coil, work.design.array.names, "an array must have a coil"),
        (structure.set_layers, (0,), "copper layers must be a whole number from 1 to 64; got 0"),
        (structure.set_layers, (2.5,), "from 1 to 64; got 2.5"),
        (structure.place_on, (work.design.array.names[0], ()), "layers of coil. must be some of L1 L2 .*; got none"),
        (structure.set_lattice, ("spiral",), "array.lattice must be one of single, linear"),
        (structure.remove_sheet, (0,), "must have an entry of number 0; there are 0"),
        (structure.set_base, ("seat",), "indentation is missing"),
    ):
        with pytest.raises(DesignError, match=line):
            then(wrong, *arguments)


def test_what_is_turned_off_and_on_again_has_its_values_and_reasons_back(starter):
    """Leads, connector and seat, each from the newest document that had it."""
    leads = {"coils.hexagon.leads.length_mm": "a guess"}
    seat = {"indentation.seat_stiffness_kPa_per_mm": "from a paper"}
    had = {
        **OPENED.document, "assumed": {**OPENED.document.get("assumed", {}), **leads, **seat},
        "coils": {"hexagon": {**OPENED.document["coils"]["hexagon"], "leads": {"length_mm": 3.5, "pad_mm": 1.2}}},
        "connector": {"side": "left", "pitch_mm": 2.0},
        "indentation": {**OPENED.document["indentation"], "base": "seat", "seat_stiffness_kPa_per_mm": 70.0},
    }  # fmt: skip
    off = structure.set_leads(had, starter, there=False)
    off = structure.set_base(structure.set_connector(off, starter, "none"), starter, "bonded")
    assert not (set(leads) | set(seat)) & set(off["assumed"])
    assert "leads" not in off["coils"]["hexagon"]
    before = [off, had, OPENED.document]
    on = structure.set_leads(off, starter, there=True, before=before)
    on = structure.set_connector(on, starter, "top", before=before)
    on = structure.set_base(on, starter, "seat", before=before)
    assert on["coils"] == had["coils"]
    assert on["connector"] == {"side": "top", "pitch_mm": 2.0}
    assert on["indentation"] == had["indentation"]
    assert on["assumed"].items() >= (leads | seat).items()
    again = structure.set_leads(on, starter, there=True, before=[OPENED.document])  # they are there already
    assert again["coils"] == had["coils"]
    work = work_on(OPENED, "starter")
    assert structure.set_leads(off, starter, there=True)["coils"]["hexagon"]["leads"] == {}  # never seen: as usual
    assert work.with_document(on).design.array.routing.connector.side == "top"


def test_what_names_a_coil_stays_possible_without_it():
    """An origin stays where it is; names, other shapes and the reasons of what does not change are kept."""
    opened = load_design_file("gast2020")
    names = ["a", "coil2", "c", "d", "e", "f"]
    document = {**opened.document, "array": {**opened.document["array"], "names": names}}
    document["coils"] = {**document["coils"], "spare": document["coils"]["hexagon"]}
    document["circuit"] = {**document["circuit"], "terminations": {"coil2": "open", "a": "open"}}
    work = work_on(build_design_file(document), "gast2020")
    origin = work.design.indentation.origin_point
    for function, chosen, left in (
        (structure.remove_coil, "coil2", ["a", "c", "d", "e", "f"]), (structure.set_lattice, "single", ["a"]),
    ):  # fmt: skip
        found = work.with_document(function(document, work.design, chosen))
        assert list(found.design.array.names) == left
        assert found.design.indentation.origin_point == pytest.approx(origin, abs=1e-9)
        assert found.opened.assumed["indentation.origin_mm"] == opened.assumed["indentation.origin"]
        assert list(found.opened.document["coils"]) == ["hexagon", "spare"]
        assert found.opened.document["circuit"]["terminations"] == {"a": "open"}
    rings = work.with_document(structure.set_lattice(document, work.design, "rings"))
    assert list(rings.design.array.names) == [*names, "coil1"]
    assert rings.opened.assumed["array.pitch_mm"] == opened.assumed["array.pitch_mm"]
    free = load_design_file("gast_fem")
    more = build_design_file(structure.add_coil(free.document, free.design)).assumed
    assert more["array.placements.0.layers"] == free.assumed["array.placements.0.layers"]
    assert more["array.placements.1.x_mm"] == "set by the studio"


def test_coils_lie_on_as_many_layers_as_they_are_wound_on():
    opened = load_design_file("starter")
    fewer = build_design_file(structure.set_layers(opened.document, opened.design, 2))
    assert {place.layers for place in fewer.design.array.placements} == {("L1", "L2")}
    assert fewer.assumed["array.layers"] == "set by the studio"
    every = build_design_file(structure.on_its_layers(vary_chosen(opened.document, {WOUND: 4})))
    assert {place.layers for place in every.design.array.placements} == {("L1", "L2", "L3", "L4")}
    one = build_design_file(structure.on_its_layers(vary_chosen(opened.document, {WOUND: 1})))
    assert [place.layers for place in one.design.array.placements] == [("L1",), ("L2",), ("L1",)]  # neighbours apart
    free = structure.add_coil(opened.document, opened.design)
    assert structure.on_its_layers(free) == free  # where it fits, nothing is moved
    moved = build_design_file(structure.set_layers(free, opened.design, 3))
    assert {place.layers for place in moved.design.array.placements} == {("L1", "L2")}
    with pytest.raises(DesignError, match=r"coils\.hexagon\.winding_layers is 2; the board has 1 copper layer only"):
        structure.set_layers(opened.document, opened.design, 1)


def test_a_board_house_brings_its_own_limits_alone():
    opened = load_design_file("starter")
    own = {**opened.document, "fab": {"min_trace_mm": 0.3}, "assumed": {"fab.min_trace_mm": "a guess"}}
    made = build_design_file(structure.set_house(own, opened.design, "oshpark-2-layer"))
    assert made.design.rules == load_profile("oshpark-2-layer").rules
    assert "fab.min_trace_mm" not in made.assumed
    four = build_design_file(structure.set_house(opened.document, opened.design, "oshpark-4-layer"))
    inner = load_profile("oshpark-4-layer").limits["max_inner_copper_um"]
    assert four.values["stackup.copper_thickness_um"] == [35, inner, inner, 35]
    assert all(margin.kept for margin in check_rules(four.design.array, four.design.rules) if "copper" in margin.rule)


def test_steps_are_undone_and_done_again(starter):
    first = work_on(load_design_file("starter"), "starter")
    second = with_entry(first, "board.margin_mm", "3")
    third = with_entry(second, "board.margin_mm", "4")
    trail = Trail().left(first).left(second)
    trail, work = trail.undo(third.saved_as("new.toml"))
    assert (work.opened, work.file, work.changed) == (second.opened, "new.toml", True)  # of the file as it is now
    trail, work = trail.undo(work)
    assert (work.opened, trail.before) == (first.opened, ())
    trail, work = trail.redo(work)
    assert work.opened is second.opened
    assert trail.left(work).after == ()  # a new change ends what was undone


def test_a_copy_is_called_by_its_own_file_before_and_after_a_step_back(starter):
    first = work_on(load_design_file("starter"), "starter")
    title = first.design.title
    assert first.for_file("starter.toml", title) is first  # the bundled one saved is no other design
    second = with_entry(first, "board.margin_mm", "3")
    copy = second.for_file("copy.toml", "").saved_as("copy.toml")
    read = parse_design_file(copy.kept_text, "copy.toml")
    assert (read.document, read.values, read.given) == (copy.kept, copy.opened.values, copy.opened.given)
    assert (read.design.name, read.design.title, read.design.digest) == ("copy", "copy", second.design.digest)
    again = copy.for_file("copy.toml", "A copy")
    assert parse_design_file(again.text(), "copy.toml").values == again.opened.values
    trail, work = Trail().left(first).undo(again)
    assert (work.design.name, work.design.title, work.opened.values["board.margin_mm"]) == ("copy", "A copy", 2)
    assert trail.redo(work)[1].opened.document == again.opened.document


def test_a_design_that_no_page_can_follow_is_refused(starter):
    many = build_design_file({**OPENED.document, "array": {**OPENED.document["array"], "columns": 70}})
    with pytest.raises(DesignError, match="at most 64 coils; the array has 70"):
        work_on(many, "many")
    require_small(starter)


@given(st.floats(allow_nan=False, allow_infinity=False, width=32))
def test_numbers_are_read_as_they_are_shown(value):
    # twelve digits are shown
    assert number_of("key", text_of(value)) == pytest.approx(value, rel=1e-11, abs=1e-300)
    assert number_of("key", text_of(value).replace("-", "−")) == number_of("key", text_of(value))


@pytest.mark.parametrize("text", ["", "wide", "1,5", "1_0", "0x10"])
def test_what_is_no_number_is_one_line(text):
    with pytest.raises(DesignError, match=rf"^key must be a number; got '{text}'\.$"):
        number_of("key", text)


@pytest.mark.slow
def test_numbers_are_those_of_the_library_and_the_matrix_needs_no_circuit(starter, monkeypatch):
    found, reference = numbers_of(starter), couple_design(starter)
    np.testing.assert_array_equal(found.inductance, reference.inductance.values)
    np.testing.assert_array_equal(found.k, reference.coupling.values)
    xr.testing.assert_identical(circuit_of(starter).coupling, reference)
    rough = numbers_of(starter, "screen")
    # what screening promises: inductances to 3e-4, see tests/electromagnetics/test_inductance_screen.py
    np.testing.assert_allclose(rough.inductance, found.inductance, rtol=0, atol=3e-4 * found.inductance.max())
    cells = numbers.coupling_cells(found)
    assert [[float(cell.full.partition(" = ")[2]) for cell in row] for row in cells] == found.k.tolist()
    assert cells[0][1].text == f"{found.k[0, 1]:+.4f}".replace("-", "−")
    assert cells[0][0].colour == "#FFFFFF"
    assert numbers.inductance_cells(found)[1][1].full == f"L(coil2, coil2) = {found.inductance[1, 1].item()!r} H"
    assert numbers.inductance_cells(found)[0][1].full.startswith("M(coil1, coil2) = ")
    assert [row[0] for row in numbers.coil_rows(found)] == list(starter.array.names)
    assert numbers.coil_rows(found)[0][2:] == ("…",) * 6  # until the circuit is solved
    rows = numbers.coil_rows(found, circuit_of(starter))
    assert [row[2] for row in rows] == [f"{one * 1e6:.3f}" for one in reference.effective_inductance.values]
    assert [row[6] for row in rows] == [f"{one * 1e-6:.4f}" for one in reference.frequency.values]
    for name in ("resistance_matrix", "coil_capacitance"):
        monkeypatch.setattr(f"coilarray.circuit.board_circuit.{name}", None)
    wider = vary(starter, {"array.pitch_mm": 13.1})
    assert numbers_of(wider, "screen").k.shape == (3, 3)
    with pytest.raises(TypeError):
        circuit_of(wider)


def test_margins_are_the_worst_of_each_rule_and_cells_are_read_on_their_colour(starter):
    found = numbers_of(starter, "screen")
    for row in (*numbers.coupling_cells(found), *numbers.inductance_cells(found)):
        for cell in row:
            red, green, blue = (int(cell.colour[k : k + 2], 16) / 255 for k in (1, 3, 5))
            light = 0.2126 * red + 0.7152 * green + 0.0722 * blue
            assert abs(light - (1.0 if cell.ink == "#FFFFFF" else 0.125)) > 0.25
    margins, every = numbers.margins_of(starter), check_rules(starter.array, starter.rules)
    assert margins[0] == every[0]
    assert {(m.rule, m.layer) for m in margins} == {(m.rule, m.layer) for m in every}
    for margin in margins:
        assert margin.margin == min(m.margin for m in every if (m.rule, m.layer) == (margin.rule, margin.layer))
    rows = numbers.margin_rows(margins)
    assert [row[6] for row in rows] == [margin.kept for margin in margins]
    assert rows[0][3].endswith(" mm")


def test_one_measured_coil_sees_what_the_coupling_says(starter):
    circuit = circuit_of(starter)
    for name in starter.array.names:
        settings = {other: "measure" if other == name else "ground" for other in starter.array.names}
        result, reference = resonate(circuit.network, state_of(settings)), circuit.coupling.sel(coil=name)
        assert result.effective_inductance == float(reference.effective_inductance)
        assert result.frequency == float(reference.frequency)
        alone = resonate(circuit.network, state_of({**dict.fromkeys(starter.array.names, "open"), name: "measure"}))
        assert alone.effective_inductance == pytest.approx(float(reference.open_effective_inductance), rel=1e-11)


def test_settings_name_a_state_and_coils_in_series_add_with_their_coupling(starter):
    ideal = design_circuit(starter, ideal=True)
    result = resonate(ideal, state_of({"coil1": "measure", "coil2": "measure", "coil3": "open"}))
    assert result.apparent_inductance == pytest.approx(ideal.inductance[:2, :2].sum(), rel=1e-9)
    np.testing.assert_allclose(np.abs(result.currents), [1.0, 1.0, 0.0], atol=1e-9)
    assert kept_settings(starter.array, {}) == {"coil1": "ground", "coil2": "measure", "coil3": "ground"}
    kept = kept_settings(starter.array, {"coil1": "open", "coil3": "measure", "coil9": "open"})
    assert kept == {"coil1": "open", "coil2": "ground", "coil3": "measure"}
    assert kept_settings(starter.array, {"coil1": "open", "coil9": "measure"})["coil2"] == "measure"
    state = state_of({"coil1": "measure", "coil2": "measure", "coil3": "open"})
    assert (state.name, state.exceptions) == ("coil1 + coil2", {"coil3": "open"})
    with pytest.raises(NetworkError, match="at least one coil must be measured"):
        state_of({"coil1": "ground"})


def none_made(*_):
    """Make no scene."""


def test_the_plane_is_the_field_of_all_currents(starter):
    fields = unit_fields(starter, 3e-3)
    currents = np.array([1e-3, -2e-3, 0.5e-3])
    grid = fields.plane(currents)
    where = np.asarray(grid.points) * 1e-3
    B = magnetic_field(starter.array.conductors(), where, currents)
    # single precision of VTK's points
    np.testing.assert_allclose(grid.point_data["B (T)"], B, rtol=1e-4, atol=1e-4 * np.abs(B).max())
    np.testing.assert_allclose(grid.point_data["|B| (T)"], np.linalg.norm(B, axis=1), rtol=1e-4)
    assert fields.height == starter.field_height
    with pytest.raises(GeometryError, match="widen the spacing"):
        unit_fields(starter, 1e-6)


def test_a_touch_is_located_where_it_is_and_ellipses_meet_there(sensor):
    x, y, depth = first_place(sensor)
    touch = touched(sensor, x, y, depth)
    np.testing.assert_array_equal(list(touch.delta.values()), sensor.model.delta([x, y, depth]))
    best = max(touch.location.modes, key=lambda mode: mode.y)  # a row of coils does not tell y from −y
    assert touch.location.verdict == "found"
    # the search ends where χ² no longer falls, well within what noise does
    assert (np.abs([best.x - x, best.y - y, best.depth - depth]) < 0.05 * best.deviations).all()
    beyond = touched(sensor, 1.0, -1.0, 1.0)
    low, high = sensor.model.lower, sensor.model.upper
    assert (*beyond.at, beyond.depth) == (high[0], low[1], high[2])
    touch = touched(sensor, 5e-3, 2e-3, 0.6e-3)
    assert touch.problem == ""
    # circles that are no ellipses of Eq. 4 exactly: the polynomials err by some hundredths of a millimetre
    assert (touch.crossing.x, touch.crossing.y) == pytest.approx((5e-3, 2e-3), abs=0.2e-3)
    for state, ellipse in touch.ellipses.items():
        assert float(ellipse.distance(5e-3, 2e-3)) == pytest.approx(0.0, abs=0.2e-3), state
    assert "meet at x = 5.0" in crossing_line(touch)
    assert location_lines(touch.location)[0] == "found"
    assert location_lines(touch.location)[1].startswith("located: x = 5.00 ± ")


def test_all_places_of_a_touch_are_on_the_board_wherever_its_map_begins():
    document = {**OPENED.document, "indentation": {**OPENED.document["indentation"], "origin": "coil1"}}
    design = build_design(document)
    other = sensor_of(design, bells(document, "starter"))
    assert other.model.lower[0] == pytest.approx(design.array.centres[0, 0] - 8.5e-3, abs=1e-3)
    touch = touched(other, 5e-3, 2e-3, 0.6e-3)
    best = max(touch.location.modes, key=lambda mode: mode.y)
    assert (np.abs([best.x - 5e-3, best.y - 2e-3]) < 0.1 * best.deviations[:2]).all()
    assert "meet at x = 5.0" in crossing_line(touch)
    marks = touch_drawing(design, top_view(design), touch)
    assert (marks["indenter"]["x"], marks["indenter"]["y"]) == (5.0, -2.0)
    assert marks["crossing"][0] == pytest.approx((5.0, -2.0), abs=0.2)
    ellipse = next(one for one in marks["ellipses"] if one["colour"] == "#D55E00")  # of coil2
    assert ellipse["x"] == pytest.approx(0.0, abs=0.2)


def test_a_pad_has_no_ellipses_which_are_those_of_a_row():
    array = {"lattice": "square", "rows": 2, "columns": 2, "pitch_mm": 17.0}
    document = {**OPENED.document, "array": {**OPENED.document["array"], **array}}
    touch = touched(sensor_of(build_design(document), bells(document, "pad")), 3e-3, 2e-3, 0.6e-3)
    assert touch.location.verdict == "found"
    line = "ellipses: none: the paper's model is for coils in one row along x"
    assert (touch.ellipses, crossing_line(touch)) == ({}, line)


def test_a_coil_alone_answers_a_touch_and_says_why_it_locates_none():
    array = {"lattice": "single", "coil": "hexagon", "layers": [["L1", "L2"]]}
    document = {**OPENED.document, "array": array}
    sensor = sensor_of(build_design(document), bells(document, "alone"))
    touch = touched(sensor, 3e-3, 2e-3, 0.6e-3)
    assert touch.delta["coil1"] > 1e-4
    assert location_lines(touch.location) == ["refused: 3 unknowns need at least as many states; the model has coil1."]
    assert crossing_line(touch).startswith("ellipses: ")
    drawing = touch_drawing(sensor.design, top_view(sensor.design), touch)
    assert (drawing["pins"], drawing["indenter"]["x"]) == ([], 3.0)
    top = scene_of_location(touch.location, bounds=sensor.design.array.bounds, top=5e-3, truth=touch.at)
    assert any("3 unknowns" in note for note in top.notes)


def test_entries_that_a_lattice_has_not_have_no_slider():
    array = {"lattice": "single", "coil": "hexagon", "layers": [["L1", "L2"]]}
    alone = build_design_file({**OPENED.document, "array": array}, "alone")
    of_array = [entry.key for entry in entries_of(alone) if entry.group == "Array"]
    assert of_array == ["array.rotation_deg"]
    rings = build_design_file(
        {**OPENED.document, "array": {**array, "lattice": "rings", "rings": 1, "pitch_mm": 20.0}}, "r"
    )
    assert "array.rows" not in [entry.key for entry in entries_of(rings)]


def test_what_a_connector_refuses_by_its_key_has_a_slider():
    led = build_design_file({**OPENED.document, "connector": {"side": "top", "gap_mm": 0.2}})
    of = {entry.key: entry.value for entry in entries_of(led) if entry.group == "Connector"}
    assert of == {"connector.pitch_mm": 2.54, "connector.distance_mm": 5.0, "connector.gap_mm": 0.2}
    assert not any(entry.group == "Connector" for entry in entries_of(OPENED))


def test_a_table_of_another_design_and_a_design_without_indenter_are_refused(starter, sensor):
    other = with_entry(work_on(OPENED, "starter"), "array.pitch_mm", "12").design
    with pytest.raises(LocalizeError, match="another design"):
        sensor_of(other, bells(OPENED.document, "starter"))
    bare = {key: table for key, table in OPENED.document.items() if key not in ("indenter", "indentation", "assumed")}
    with pytest.raises(ElastomerError, match=r"no \[indenter\] and \[indentation\]"):
        sensor_of(build_design(bare, "bare"), bells(OPENED.document, "starter"))


@settings(max_examples=25)
@given(st.floats(0, 1), st.floats(0, 1))
def test_a_point_of_the_drawing_is_the_place_that_is_drawn_there(across, down):
    view = top_view(load_design("starter"))
    x, y = view.point(*view.place(across, down))
    # drawn to 1 µm
    assert (x, y) == pytest.approx((view.left + across * view.width, view.top + down * view.height), abs=1.1e-3)


def test_marks_stand_where_things_are(starter, sensor):
    view = top_view(starter)
    drawing = board_drawing(starter, view)
    assert [coil["name"] for coil in drawing["coils"]] == list(starter.array.names)
    for coil, (x, y) in zip(drawing["coils"], (starter.array.centres * 1e3).tolist(), strict=True):
        corners = np.array([[float(part) for part in point.split(",")] for point in coil["points"].split()])
        assert (coil["x"], coil["y"]) == pytest.approx((x, -y))
        assert (corners.min(axis=0) < [x, -y]).all()
        assert (corners.max(axis=0) > [x, -y]).all()
    touch = touched(sensor, 5.5e-3, 4e-3, 0.6e-3)
    marks = touch_drawing(starter, view, touch)
    assert (marks["indenter"]["x"], marks["indenter"]["y"]) == view.point(5.5e-3, 4e-3)
    (best, *_) = marks["pins"]
    assert (best["x"], best["y"]) == view.point(touch.location.best.x, touch.location.best.y)


@settings(max_examples=25)
@given(st.floats(0.5, 3.0), st.floats(1.0, 3.0), st.floats(-3.0, 3.0))
def test_an_ellipse_holds_95_percent(narrow, ratio, turn):
    axes = np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]])
    deviations = 1e-3 * np.array([narrow * ratio, narrow])
    information = np.zeros((3, 3))
    information[:2, :2] = axes @ np.diag(1 / deviations**2) @ axes.T
    information[2, 2] = 1e8
    (pin,) = pins(top_view(load_design("starter")), Location("found", "", (Mode(1e-3, 2e-3, 1e-3, information, 0.0),)))
    # 5.991 is the quantile of χ² for two
    assert (pin["rx"], pin["ry"]) == pytest.approx(tuple(deviations * 1e3 * math.sqrt(5.991)), rel=1e-4)
    if ratio > 1.01:  # a circle has no direction
        drawn = math.radians(-pin["turn"])
        assert abs(math.sin(drawn - turn)) < 1e-3


def test_colours_bars_and_legend_tell_units_and_ends(starter):
    names = starter.array.names
    fills = delta_fills(starter, {"coil1": 1e-4, "coil2": -1e-4, "coil3": None})
    assert set(fills) == set(names)
    assert len(set(fills.values())) == 3
    bars = delta_bars([("a", 2e-4), ("b", -1e-4), ("c", None)])
    assert [(bar["text"], bar["part"]) for bar in bars] == [("+200.0", 50.0), ("−100.0", -25.0), ("–", 0.0)]
    assert delta_bars([("a", 1e-6)], 1e-4)[0]["part"] == 0.5  # small readings stay small,
    assert [bar["part"] for bar in delta_bars([("a", 1e-6), ("b", 0.0)])] == [50.0, 0.0]  # and computed ones need not
    assert delta_bars([("a", 0.0), ("b", -1e-9)])[0]["part"] == 0.0
    assert delta_bars([("a", -1e-9)])[0]["text"] == "+0.0"  # and not −0.0
    scale = Scale("|B| (T)", "B", "T", 1e-8, 1e-6, logarithmic=True)
    parts = (Part("plane", None, "B", scale=scale), Part("edge", None, "board", "#123456"))
    legend = _legend(Scene(parts, notes=("a note",)))
    sign = f"linear-gradient(to right, {', '.join(scale.steps(3))})"  # where colours are values, so is the sign
    assert legend["groups"] == [{"name": "B", "colour": sign}, {"name": "board", "colour": "#123456"}]
    assert legend["notes"] == ["a note"]
    (bar,) = legend["bars"]
    assert (bar["title"], bar["ticks"][0], bar["ticks"][2], bar["ticks"][-1]) == ("B (µT)", "0.01", "0.1", "1")


def test_a_saved_design_is_read_back_and_nothing_else_is_touched(starter, tmp_path):
    shelf = Shelf(tmp_path)
    changed = with_entry(work_on(OPENED, "starter"), "array.pitch_mm", "12.5")
    saved = shelf.save(changed, "better.toml")
    assert [path.name for path in tmp_path.iterdir()] == ["better.toml"]
    assert (saved.file, saved.changed) == ("better.toml", False)
    again = shelf.open("better.toml")
    assert again.design.digest == changed.design.digest
    assert tomllib.loads((tmp_path / "better.toml").read_text(encoding="utf-8")) == changed.opened.document
    assert shelf.names() == ["better.toml", *bundled.names()]
    assert parse_design(again.text()).digest == changed.design.digest


@pytest.mark.parametrize(
    "name", ["../b.toml", "/tmp/b.toml", "better", "", ".toml", "a/b.toml", "-x.toml", "a\0.toml", 300 * "a" + ".toml"]
)
def test_only_plain_names_are_written_and_read(starter, tmp_path, name):
    shelf = Shelf(tmp_path)
    with pytest.raises(OutputError, match=r"plain, short name that ends in \.toml"):
        shelf.save(work_on(OPENED, "starter"), name)
    with pytest.raises((OutputError, DesignError)):
        shelf.open(name)
    assert list(tmp_path.iterdir()) == []


def test_files_that_are_no_design_and_what_would_be_lost_are_known(starter, tmp_path):
    shelf, begun = Shelf(tmp_path), work_on(OPENED, "starter")
    changed = with_entry(begun, "array.pitch_mm", "12")
    assert not shelf.would_lose(begun, "mine.toml")  # there is none
    mine = shelf.save(begun, "mine.toml")
    assert shelf.would_lose(begun, "mine.toml")  # it was begun with another one
    assert not shelf.would_lose(with_entry(mine, "array.pitch_mm", "13"), "mine.toml")
    again = shelf.save(with_entry(mine, "array.pitch_mm", "13"), "mine.toml")
    assert not shelf.would_lose(Trail().left(mine).undo(again)[1], "mine.toml")
    (tmp_path / "mine.toml").write_text(f"{again.text()}# meanwhile, in an editor\n", encoding="utf-8")
    assert shelf.would_lose(again, "mine.toml")
    shelf.save(changed, "mine.toml")  # meanwhile, from another page
    assert shelf.would_lose(mine, "mine.toml")
    (tmp_path / "mine.toml").write_text("schema = ", encoding="utf-8")
    assert shelf.would_lose(mine, "mine.toml")
    with pytest.raises(OutputError, match="plain, short name"):
        shelf.would_lose(mine, "../mine.toml")
    (tmp_path / "broken.toml").write_text("schema = ", encoding="utf-8")
    with pytest.raises(DesignError, match="not valid TOML"):
        Shelf(tmp_path).open("broken.toml")
    with pytest.raises(DesignError, match=r"there is no file other\.toml"):
        Shelf(tmp_path).open("other.toml")


class State(SimpleNamespace):
    """Values of a page without one."""

    def update(self, values):
        vars(self).update(values)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        pass


@pytest.mark.parametrize(
    ("meanwhile", "problem"),
    [
        (lambda work: work, ""),
        (lambda work: with_entry(work, "array.pitch_mm", "12"), "The changes of starter are not saved"),
        (lambda work: with_entry(work, "array.pitch_mm", "12").saved_as("saved.toml"), ""),
    ],
)
def test_a_new_design_replaces_no_changes_made_meanwhile(tmp_path, meanwhile, problem):
    called, ends, taken = {}, [], []
    page = SimpleNamespace(
        state=State(), trigger=called.__setitem__, work=work_on(OPENED, "starter"), take=taken.append,
        setup=SimpleNamespace(shelf=Shelf(tmp_path)), start_bar=lambda *given: ends.append(given[4]) or True,
    )  # fmt: skip
    NewPanel(page)
    called["make_design"]({"name": "mine", "coils": "2", "shape": "circle", "size": "16"})
    page.work = meanwhile(page.work)
    ends[0](OPENED)
    assert page.state.new_problem.startswith(problem)
    assert page.state.new_dialog == bool(problem)
    assert len(taken) == (not problem)


def test_a_field_that_is_left_as_it_was_changes_nothing(tmp_path):
    """It shows twelve digits of a value that may have more."""
    called, taken = {}, []
    page = SimpleNamespace(
        state=State(client_only=lambda *_: None, errors={}), trigger=called.__setitem__,
        change=lambda *_, **__: taken.append(1),
        setup=SimpleNamespace(shelf=Shelf(tmp_path), services=SimpleNamespace(write_report=None)),
        work=with_entries(work_on(OPENED, "starter"), {"array.pitch_mm": 11 + 1 / 3}),
    )  # fmt: skip
    DesignPanel(page, none_made)
    called["enter"]("array.pitch_mm", "11.3333333333")
    assert taken == []
    called["enter"]("array.pitch_mm", "11.3")
    assert taken == [1]


@pytest.mark.parametrize("wanted", [True, False])
def test_a_new_design_has_an_elastomer_where_it_is_wanted(wanted):
    texts = {"name": "coil", "coils": "1", "shape": "circle", "size": "40", "elastomer": wanted}
    choices = choices_of(texts)
    assert (choices.get("elastomer", True), choices["size"]) == (wanted, pytest.approx(40e-3))


def test_layers_and_pitch_of_a_new_design_are_chosen_where_they_matter():
    texts = {"name": "x", "coils": "3", "shape": "circle", "size": "16", "layers": "4", "pitch": "20.5"}
    choices = choices_of(texts)
    assert (choices["layers"], choices["pitch"]) == (4, pytest.approx(20.5e-3))
    for layers, words in (
        ("2.5", r"layers must be a whole number; got 2\.5\."),
        ("two", "layers must be a number; got"),
    ):
        with pytest.raises(DesignError, match=words):
            choices_of({**texts, "layers": layers})


@pytest.mark.parametrize(
    ("key", "values", "target", "name", "found"),
    [
        ("k[a,b]", (-0.03, 0.04), 0.0, "|k[a,b]|", "None is better than the start, which has |k[a,b]| 0.03."),
        ("q", (30.1, 30.4), 30.6, "|q − 30.6|", "The best has |q − 30.6| 0.2, the start 0.5."),
    ],
)
def test_a_run_names_its_score_and_says_whether_it_has_found_a_better_board(key, values, target, name, found):
    goal = {"objectives": [{"quantity": key, "direction": None, "target": target}]}
    point = {**goal, "kind": "search", "changes": {}, "violations": {}, "reason": ""}
    points = [
        {**point, "place": k, "quantities": {key: value}, "scores": [abs(value - target)], "start": k == 0}
        for k, value in enumerate(values)
    ]
    run = run_of("mine", [*points, {**point, "kind": "polish", "place": 0, "reason": "no board"}])
    assert run.objectives == (name,)
    assert run.values(name) == [abs(value - target) for value in values]
    lines = run_lines(run)
    assert lines[:2] == ["3 points computed, 1 of them to refine the best; 2 keep all bounds", found]
    assert lines[2].startswith(f"{key}: ")


@pytest.mark.slow
def test_runs_are_read_as_they_were_written(tmp_path):
    pytest.importorskip("optuna")
    result = quick_run(tmp_path / "found")
    before = sorted(path.name for path in (tmp_path / "found").iterdir())
    (run,) = read_runs(tmp_path / "found")
    assert run.objectives == ("board_area_mm2", "span_mm")
    assert run.maximized == (False, True)
    assert run.tried == len(result.trials)
    assert {run.points[k].name for k in run.front} == {trial.name for trial in result.front}
    best = run.points[run.front[0]]
    (trial,) = (one for one in result.front if one.name == best.name)
    assert best.quantities == dict(trial.quantities)
    assert best.entries == dict(trial.changes)
    np.testing.assert_array_equal(run.values("span_mm"), [point.quantities["span_mm"] for point in run.points])
    assert set(run.numbers) == {"array.pitch_mm", "array.columns"}
    assert run.values("array.pitch_mm") == [point.entries["array.pitch_mm"] for point in run.points]
    first = front_rows(run)[0]
    assert (first["name"], first["scores"]) == (best.name, [value_text(score) for score in best.scores])
    assert sorted(path.name for path in (tmp_path / "found").iterdir()) == before  # reading leaves nothing behind
    assert run_folders(tmp_path) == ["found"]
    assert run_folders(tmp_path / "found") == ["."]
    work = with_entries(work_on(OPENED, "starter"), best.entries)
    assert work.opened.values["array.columns"] == trial.changes["array.columns"]


@pytest.mark.slow
def test_a_sweep_is_watched_and_its_points_are_those_of_the_library(tmp_path, monkeypatch):
    monkeypatch.setenv("COILARRAY_CACHE", str(tmp_path))
    monkeypatch.setattr(studies, "_EVERY", 0.0)
    told = []
    asked = studies.SweepRequest(
        OPENED.document, "starter", ("array.pitch_mm=12,-1,6", "array.columns=2,3"), ("span_mm",)
    )
    found = studies.sweep_entries(asked, told.append, lambda: False)
    assert [one for one in told if isinstance(one, tuple)][-1] == (6, 6)
    head, rows = studies.sweep_rows(found)
    assert head == ("array.pitch_mm", "array.columns", "span_mm", "fab_broken")
    assert [row.point for row in rows] == [0, 1, None, None, 4, 5]  # no pitch is negative
    assert all(row.reason and row.cells[2] == "–" for row in rows[2:4])
    assert [row.broken for row in rows] == [False, False, False, False, True, True]  # at 6 mm copper overlaps
    assert rows[4].reason == "it breaks fabrication rules"
    partial = [studies.sweep_rows(one)[1] for one in told if isinstance(one, studies.SweepResult)]
    assert [len(some) for some in partial] == [1, 2, 3, 4, 5, 6]
    work = work_on(OPENED, "starter")
    for row in (rows[0], rows[5]):
        taken = with_entries(work, found.points[row.point])
        span = evaluate(taken.design, ["span_mm"])["span_mm"]
        assert float(row.cells[2]) == pytest.approx(span, rel=1e-5)  # shown with six digits
    for entry in entries_of(OPENED):
        axis = parse_axis(f"{entry.key}={studies.axis_text(entry)}")  # what is offered can be read
        assert min(axis.values) <= entry.value <= max(axis.values)


def test_a_tolerance_study_says_what_contributes_most_and_the_yield():
    two = {
        "nominal": ("output", [-0.08, 5.0]),
        "linear_deviation": ("output", [7.11e-5, 0.0]),
        "share": (("contributor", "output"), [[0.25, np.nan], [0.75, np.nan]]),
        "sample_deviation": ("output", [0.0123, 0.0]),
        "sample_yield": ("limit", [0.875]),
    }
    coords = {"output": ["worst_k", "span_mm"], "contributor": ["etch.L1", "etch.L2"], "limit": ["worst_k ≤ 0.1"]}
    assert [row.cells for row in studies.tolerance_rows(xr.Dataset(two, coords))[1]] == [
        ("worst_k", "−0.08", "7.11·10⁻⁵", "0.0123", "etch.L2 (75 %)"),
        ("span_mm", "5", "0", "0", "no error"),
        ("worst_k ≤ 0.1", "", "", "", "yield 87.5 %"),
    ]


def test_what_is_no_study_is_one_line(tmp_path):
    with pytest.raises(OutputError, match=r"there is no points\.jsonl"):
        read_runs(tmp_path)
    (tmp_path / "points.jsonl").write_text("no points")
    with pytest.raises(OutputError, match="it has no points of an optimisation"):
        read_runs(tmp_path)
    assert run_folders(Path("/nowhere")) == []


def test_bodies_are_added_and_removed_as_the_file_says_them():
    work = work_on(OPENED, "starter")
    texts = {**metal.FIRST, "kind": "plate above", "shape": "ring", "size": "30", "second": "12", "distance": "4"}
    plated = work.with_document(metal.with_body(work.opened.document, texts))
    texts_of_wide = {**texts, "shape": "infinite plate", "distance": "9"}
    plated = plated.with_document(metal.with_body(plated.opened.document, texts_of_wide))
    ring, wide = plated.design.plates
    assert (ring.name, wide.name) == ("plate1", "plate2")
    assert ring.heights[0] == pytest.approx(plated.design.top + 4e-3, rel=1e-12)
    assert isinstance(wide, Plate)
    keys = {entry.key for entry in entries_of(plated.opened)}
    assert {"plate.0.distance_mm", "plate.0.inner_diameter_mm", "plate.1.thickness_mm"} <= keys
    moved = work.with_document(
        metal.with_body(OPENED.document, {**metal.FIRST, "shape": "sphere", "distance": "1; 2,5"})
    )
    assert moved.design.target.distances == (1e-3, 2e-3, 5e-3)
    assert [row["key"] for row in metal.body_rows(moved.design)] == ["target"]
    assert metal.body_rows(plated.design)[1]["text"].startswith("plate plate2: infinite plate of aluminium, 1 mm, z =")
    reasons = {"plate.0.thickness_mm": "a guess", "plate.1.distance_mm": "measured"}
    far = {**texts, "distance": "20"}
    plated = plated.with_document({**plated.opened.document, "assumed": reasons})
    assert plated.with_document(metal.with_body(plated.opened.document, far)).opened.assumed == reasons
    without = plated.with_document(metal.without_body(plated.opened.document, "0"))
    assert [plate.name for plate in without.design.plates] == ["plate2"]
    assert without.opened.assumed == {"plate.0.distance_mm": "measured"}
    for key, one in (("0", without), ("target", moved)):
        assert one.with_document(metal.without_body(one.opened.document, key)).design.digest == work.design.digest
    for field, text, message in (
        ("size", "wide", "diameter_mm must be a number; got 'wide'"), ("shape", "sphere", "a sphere must be a target"),
        ("material", "wood", "with a shape and a material that there are"),
        ("distance", "", "distance_mm must be a number"),
    ):  # fmt: skip
        with pytest.raises(DesignError, match=message):
            metal.with_body({}, {**texts, field: text})


def test_a_target_says_for_every_state_what_the_library_computes(starter):
    ball = Target(Ball(5e-3, MATERIALS["brass"]), (1e-3, 3e-3), (0.0,), (0.0,))
    found = metal.moved(replace(starter, target=ball), (2e-3, 1e-3))
    assert found.distances[0] == 1e-3
    assert found.distances[-1] == 3e-3
    alone = target_map(found.design, distances=[3e-3], x=[2e-3], y=[1e-3]).isel(distance=0, x=0, y=0)
    rows = metal.target_rows(found, len(found.distances) - 1)
    assert [row[0] for row in rows] == ["coil1", "coil2", "coil3"]
    for row, L, f in zip(rows, alone.effective_inductance.values, alone.frequency.values, strict=True):
        assert float(row[2]) == pytest.approx(L * 1e6, abs=1e-4)
        assert float(row[6]) == pytest.approx(f * 1e-6, abs=1e-5)
