"""What the studio computes, without any page: values in, numbers out, held against the library's own functions."""

import math
import re
import tomllib
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr
from hypothesis import given, settings
from hypothesis import strategies as st
from support.browser import bells

from coilarray import Board, Design, Spiral, couple_design
from coilarray.circuit.coupling import design_circuit
from coilarray.circuit.network import resonate
from coilarray.compute.netcdf import save_dataset
from coilarray.compute.table import Column, Table
from coilarray.design import bundled
from coilarray.design.fabs import load_profile
from coilarray.design.model import build_design, build_design_file, load_design_file, parse_design_file
from coilarray.design.vary import vary_chosen
from coilarray.design.write import file_text
from coilarray.electromagnetics.field import grid_points, magnetic_field
from coilarray.errors import DesignError, GeometryError, NetworkError, OutputError
from coilarray.geometry import MATERIALS, Ball, Plate, Pose, Target, check_rules
from coilarray.localize.forward import forward_model
from coilarray.localize.inverse import Location, Mode, location_lines
from coilarray.response.dataset import on_board
from coilarray.response.target import target_map
from coilarray.studies.link import link
from coilarray.studies.quantities import evaluate
from coilarray.studies.sweep import Axis, parse_axis, plan_sweep, sweep
from coilarray.viz.scenes.design import bare_scene, off_middle
from coilarray.viz.scenes.results import scene_of_location
from coilarray.viz.scenes.scene import Part, Scale, Scene
from coilarray.viz.studio import metal, numbers, structure, studies
from coilarray.viz.studio.design import choices_of
from coilarray.viz.studio.live import TouchPanel, delta_bars, drawing, location_marks, top_view, touched
from coilarray.viz.studio.motion import motion_of
from coilarray.viz.studio.numbers import circuit_of, kept_settings, numbers_of, state_of, unit_fields
from coilarray.viz.studio.runs import read_runs, run_folders, run_lines, run_of
from coilarray.viz.studio.view import _legend, packed, plan_of
from coilarray.viz.studio.words import preview, with_changes, words
from coilarray.viz.studio.work import MOST_COILS, Shelf, entries_of, feasible_range, number_of, text_of, work_on

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
def circuit(starter):
    return circuit_of(starter)


def model_of(document):
    return forward_model(on_board(bells(document, "starter")))


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
        *(("array.pitch_mm", text, f"array.pitch_mm must be a number; got '{text}'.") for text in ("", "1,5", "1_0")),
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


@given(st.floats(allow_nan=False, allow_infinity=False, width=32))
def test_numbers_are_read_as_they_are_shown(value):
    # twelve digits are shown
    assert number_of("key", text_of(value)) == pytest.approx(value, rel=1e-11, abs=1e-300)
    assert number_of("key", text_of(value).replace("-", "−")) == number_of("key", text_of(value))


def test_one_measured_coil_sees_what_the_coupling_says(starter, circuit):
    for name in starter.array.names:
        settings = {other: "measure" if other == name else "ground" for other in starter.array.names}
        result, reference = resonate(circuit.network, state_of(settings)), circuit.coupling.sel(coil=name)
        assert result.effective_inductance == float(reference.effective_inductance)
        assert result.frequency == float(reference.frequency)
        alone = resonate(circuit.network, state_of({**dict.fromkeys(starter.array.names, "open"), name: "measure"}))
        assert alone.effective_inductance == pytest.approx(float(reference.open_effective_inductance), rel=1e-11)


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


def test_entries_that_a_lattice_has_not_have_no_slider():
    array = {"lattice": "single", "coil": "hexagon", "layers": [["L1", "L2"]]}
    alone = build_design_file({**OPENED.document, "array": array}, "alone")
    of_array = [entry.key for entry in entries_of(alone) if entry.group == "Array"]
    assert of_array == ["array.rotation_deg"]
    rings = build_design_file(
        {**OPENED.document, "array": {**array, "lattice": "rings", "rings": 1, "pitch_mm": 20.0}}, "r"
    )
    assert "array.rows" not in [entry.key for entry in entries_of(rings)]


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


@pytest.mark.parametrize("name", ["../b.toml", "/tmp/b.toml", "", ".toml", "-x.toml", "a\0.toml", 300 * "a" + ".toml"])
def test_only_plain_names_are_written_and_read(starter, tmp_path, name):
    shelf = Shelf(tmp_path)
    with pytest.raises(OutputError, match=r"plain, short name that ends in \.toml"):
        shelf.save(work_on(OPENED, "starter"), name)
    with pytest.raises((OutputError, DesignError)):
        shelf.open(name)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("key", "values", "target", "name", "found"),
    [
        ("k[a,b]", (-0.03, 0.04), 0.0, "|k[a,b]|", "None is better than the start, with 0.03."),
        ("q", (30.1, 30.4), 30.6, "|q − 30.6|", "Best quality factor less 30.6: 0.2; at the start 0.5."),
    ],
)
def test_a_run_names_its_score_and_says_whether_it_has_found_a_better_board(key, values, target, name, found):
    goal = {"objectives": [{"quantity": key, "direction": None, "target": target}]}
    point = {**goal, "kind": "search", "changes": {}, "violations": {}, "reason": "", "accuracy": "full"}
    points = [
        {**point, "place": k, "quantities": {key: value}, "scores": [abs(value - target)], "start": k == 0}
        for k, value in enumerate(values)
    ]
    run = run_of("mine", [*points, {**point, "kind": "polish", "place": 0, "reason": "no board"}])
    assert run.objectives == (name,)
    assert run.values(name) == [abs(value - target) for value in values]
    lines = run_lines(run)
    assert lines[:2] == ["3 points computed, 1 of them to refine the best; 2 keep all limits", found]
    assert lines[-1].startswith(f"{words(key)}: ")


@pytest.mark.slow
def test_runs_are_read_as_they_were_written(searched):
    folder, result = searched
    before = sorted(path.name for path in folder.iterdir())
    (run,) = read_runs(folder)
    assert run.objectives == ("board_area_mm2", "span_mm")
    assert run.maximized == (False, True)
    assert run.tried == len(result.trials)
    assert {run.points[k].name for k in run.front} == {trial.name for trial in result.front}
    best = run.points[run.front[0]]
    (trial,) = (one for one in result.front if one.name == best.name)
    assert best.quantities == dict(trial.quantities)
    assert best.changes == dict(trial.changes)
    np.testing.assert_array_equal(run.values("span_mm"), [point.quantities["span_mm"] for point in run.points])
    assert set(run.numbers) == {"array.pitch_mm", "array.columns"}
    assert run.values("array.pitch_mm") == [point.changes["array.pitch_mm"] for point in run.points]
    assert sorted(path.name for path in folder.iterdir()) == before  # reading leaves nothing behind
    assert folder.name in run_folders(folder.parent)
    assert run_folders(folder) == ["."]
    work = with_entries(work_on(OPENED, "starter"), best.changes)
    assert work.opened.values["array.columns"] == trial.changes["array.columns"]


@pytest.mark.slow
def test_a_sweep_is_watched_and_its_points_are_those_of_the_library(tmp_path, monkeypatch):
    monkeypatch.setenv("COILARRAY_CACHE", str(tmp_path))
    monkeypatch.setattr(studies, "_SENT_EVERY", 0.0)
    told = []

    def link(*progress):
        told.append(progress)

    link.send = told.append
    axes = ["array.pitch_mm=12,-1,6", "array.columns=2,3"]
    found = studies.sweep_entries(OPENED.document, "starter", axes, ["span_mm"], link)
    assert [one for one in told if isinstance(one, tuple)][-1] == (6, 6)
    head, rows = studies.sweep_rows(found)
    assert head == ["pitch (mm)", "columns", "extent of the coils along x (mm)", "broken limits of the board house"]
    assert [row["point"] for row in rows] == [0, 1, None, None, 4, 5]  # no pitch is negative
    assert all(row["reason"] and row["cells"][2] == "–" for row in rows[2:4])
    assert [row["broken"] for row in rows] == [False, False, False, False, True, True]  # at 6 mm copper overlaps
    assert rows[4]["reason"] == "it breaks fabrication rules"
    partial = [studies.sweep_rows(one)[1] for one in told if isinstance(one, studies.SweepResult)]
    assert [len(some) for some in partial] == [1, 2, 3, 4, 5, 6]
    work = work_on(OPENED, "starter")
    for row in (rows[0], rows[5]):
        taken = with_entries(work, found.points[row["point"]])
        span = evaluate(taken.design, ["span_mm"])["span_mm"]
        assert float(row["cells"][2]) == pytest.approx(span, rel=1e-5)  # shown with six digits
    for entry in entries_of(OPENED):
        axis = parse_axis(studies._swept({"key": entry.key, **studies.axis_of(entry)}))  # what is offered can be read
        assert min(axis.values) <= entry.value <= max(axis.values)


def test_a_sweep_that_was_kept_is_found_again(tmp_path):
    entries = {"array.pitch_mm": [12, 13], "array.columns": [2, 3]}
    values = sweep(OPENED, entries, ["span_mm"])
    save_dataset(values, tmp_path / "kept.nc")
    again = studies.read_study(tmp_path / "kept.nc")
    plan = plan_sweep(OPENED, [Axis(key, tuple(some)) for key, some in entries.items()], ["span_mm"])
    assert list(studies.points_of(again)) == list(plan.points)
    first, second = (studies.SweepResult(studies.points_of(one), one) for one in (values, again))
    assert studies.sweep_rows(first) == studies.sweep_rows(second)
    (tmp_path / "text.nc").write_text("no study", encoding="utf-8")
    with pytest.raises(DesignError, match=r"text\.nc is no kept sweep or tolerance study"):
        studies.read_study(tmp_path / "text.nc")


def test_a_design_is_compared_with_its_limits_before_it_is_taken_over():
    work = work_on(OPENED, "starter")
    before, after = {"worst_k": 0.0257, "board_area_mm2": 1035.0}, {"worst_k": 0.0149, "board_area_mm2": 1310.0}
    limits = {"board_area_mm2 <= 1300": 10.0}
    shown = preview(work, {"array.pitch_mm": 13.5}, before, after, limits)
    rows = {row["words"]: row for row in shown["rows"]}
    assert (rows["board"]["before"], rows["board"]["after"]) == ("41.90 × 24.70 mm", "46.90 × 24.70 mm")
    assert (rows["pitch"]["before"], rows["pitch"]["after"]) == ("11 mm", "13.5 mm")
    assert rows["board area"]["limit"] == "board area at most 1300 mm²"
    assert rows["board area"]["broken"]
    assert rows["largest |k| of two coils"]["after"] == "0.0149 (−42.0 %)"
    assert len(shown["plan"]["coils"]) == 3


def test_a_search_says_which_limit_holds_it():
    point = {
        "objectives": [{"quantity": "k[coil1,coil2]", "direction": None, "target": 0.0}], "kind": "search",
        "reason": "", "accuracy": "full", "start": False, "quantities": {},
    }  # fmt: skip
    points = [
        {**point, "place": 1, "changes": {"array.pitch_mm": 12.0}, "scores": [0.02],
         "violations": {"fab_margin_mm >= -0.001": -1.0}},
        {**point, "place": 2, "changes": {"array.pitch_mm": 9.0}, "scores": [0.001],
         "violations": {"fab_margin_mm >= -0.001": 2.0}},
        {**point, "place": 3, "changes": {"array.pitch_mm": 4.0}, "scores": [], "violations": {},
         "reason": "coils lie on each other"},
    ]  # fmt: skip
    text = " ".join(run_lines(run_of("mine", points)))
    assert "tightest margin of the board house at least −0.001 mm holds it" in text
    assert "reaches 0.001 with pitch 9 mm" in text
    assert "copper layers of their own" in text
    assert "1 point gave no board, most often: coils lie on each other" in text


def test_a_tolerance_study_says_what_contributes_most_and_the_yield():
    two = {
        "nominal": ("output", [-0.08, 5.0]),
        "linear_deviation": ("output", [7.11e-5, 0.0]),
        "share": (("contributor", "output"), [[0.25, np.nan], [0.75, np.nan]]),
        "sample_deviation": ("output", [0.0123, 0.0]),
        "sample_yield": ("limit", [0.875]),
    }
    coords = {"output": ["worst_k", "span_mm"], "contributor": ["etch.L1", "etch.L2"], "limit": ["worst_k ≤ 0.1"]}
    assert [row["cells"] for row in studies.tolerance_rows(xr.Dataset(two, coords))[1]] == [
        ["largest |k| of two coils", "−0.08", "7.11·10⁻⁵", "0.0123", "etch.L2 (75 %)"],
        ["extent of the coils along x (mm)", "5", "0", "0", "no error"],
        ["worst_k ≤ 0.1", "", "", "", "yield 87.5 %"],
    ]


def test_a_design_that_no_page_can_follow_is_refused():
    many = build_design_file({**OPENED.document, "array": {**OPENED.document["array"], "columns": 70}})
    with pytest.raises(DesignError, match="at most 64 coils; the design has 70"):
        work_on(many, "many")


def test_what_is_no_study_is_one_line(tmp_path):
    (tmp_path / "points.jsonl").write_text("no points", encoding="utf-8")
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


def built(work, *steps):
    """A work after steps of its structure, each a name and arguments."""
    for name, *arguments in steps:
        work = work.with_document(structure.STEPS[name](work.opened.document, work.design, *arguments))
    return work


def made_up(work):
    return {key for key, why in work.opened.assumed.items() if why == "set by the studio"}


def test_coils_are_added_placed_and_removed():
    more = built(work_on(OPENED, "starter"), ("add_coil",))
    array = more.design.array
    assert [place.name for place in array.placements] == ["coil1", "coil2", "coil3", "coil4"]
    np.testing.assert_allclose(array.centres[3], array.centres[2] + (array.centres[2] - array.centres[1]), atol=1e-9)
    assert array.placements[3].layers == array.placements[1].layers != array.placements[2].layers
    assert made_up(more) == {"array.placements.3.layers", "array.placements.3.x_mm"}
    places = (("x_mm", "5"), ("y_mm", "-7.5"), ("rotation_deg", "30"), ("layers", "L1, L2"))
    moved = built(more, *(("place_coil", "coil4", key, text) for key, text in places)).design.array.placements[3]
    assert (moved.x, moved.y, moved.rotation) == pytest.approx((5e-3, -7.5e-3, math.pi / 6))
    assert moved.layers == ("L1", "L2")
    assert list(built(more, ("remove_coil", "coil1")).design.array.names) == ["coil2", "coil3", "coil4"]


@pytest.mark.parametrize(
    ("kind", "count"),
    [("square", 4), ("hexagonal", 4), ("linear", 4), ("triangle", 6), ("rings", 7), ("single", 1), ("free", 4)],
)
def test_coils_are_laid_on_a_lattice_of_about_as_many(kind, count):
    assert structure.lattice_sizes(kind, 4)[1] == count  # which is said before
    laid = built(work_on(OPENED, "starter"), ("add_coil",), ("set_lattice", kind))
    assert len(laid.design.array.names) == count
    assert laid.opened.document["array"]["lattice"] == kind


def test_layers_sheets_leads_and_connector_are_set():
    work = work_on(OPENED, "starter")
    six = built(work, ("set_layers", "6"))
    thick = sum(work.design.array.stackup.dielectric_thickness)
    # each of five is rounded to 0.1 µm
    assert sum(six.design.array.stackup.dielectric_thickness) == pytest.approx(thick, abs=5 * 0.05e-6)
    keys = ("layers", "copper_thickness_um", "dielectric_thickness_mm", "dielectric_epsilon_r")
    assert made_up(six) == {f"stackup.{key}" for key in keys}
    assert built(work, ("set_leads", False)).design.array.placements[0].coil.terminal is None
    assert built(work, ("set_leads", False), ("set_leads", True)).design.digest == work.design.digest
    assert built(work, ("set_base", "seat")).design.indentation.base.stiffness > 0
    assert built(work, ("set_base", "seat"), ("set_base", "bonded")).design.indentation.base == "bonded"
    more = built(work, ("add_sheet",))
    assert [sheet.name for sheet in more.design.sheets] == ["base", "magnetic", "sheet1"]
    kept = {key for key in more.opened.assumed if key.startswith("elastomer.1.")}
    fewer = built(more, ("remove_sheet", 0))
    assert {
        key.replace("elastomer.0.", "elastomer.1.") for key in fewer.opened.assumed if "elastomer.0." in key
    } == kept
    bare = built(fewer, ("remove_sheet", 0), ("remove_sheet", 0))
    assert bare.design.indentation is None
    assert "indenter.radius_mm" in made_up(built(bare, ("add_sheet",)))
    led = built(bare, ("set_connector", "top"))
    assert led.design.array.routing.connector.side == "top"
    shown = {entry.key: entry.value for entry in entries_of(led.opened) if entry.group == "Connector"}
    assert (shown["connector.pitch_mm"], shown["connector.distance_mm"]) == (2.54, 5.0)
    assert built(led, ("set_connector", "none")).design.array.routing is None


@pytest.mark.parametrize(
    ("step", "line"),
    [
        (("set_layers", "0"), "copper layers must be a whole number from 1 to 64; got 0"),
        (("set_layers", "2.5"), "from 1 to 64; got 2.5"),
        (("set_layers", "1"), r"coils\.hexagon\.winding_layers is 2; the board has 1 copper layer only"),
        (("place_coil", "coil1", "layers", ""), "layers of coil1 must be some of L1 L2 .*; got none"),
        (("place_coil", "coil1", "x_mm", "far"), "x_mm of coil1 must be a number; got 'far'"),
        (("set_lattice", "spiral"), "array.lattice must be one of single, linear"),
        (("remove_sheet", 2), "must have an entry of number 2; there are 2"),
        (("set_base", "glue"), "indentation.base must be one of bonded"),
    ],
)
def test_what_cannot_be_built_is_one_line(step, line):
    with pytest.raises(DesignError, match=line):
        built(work_on(OPENED, "starter"), step)


def test_what_names_a_coil_stays_possible_without_it():
    """An origin stays where it is; names, other shapes and the reasons of what does not change are kept."""
    opened = load_design_file("gast2020")
    names = ["a", "coil2", "c", "d", "e", "f"]
    document = {**opened.document, "array": {**opened.document["array"], "names": names}}
    document["coils"] = {**document["coils"], "spare": document["coils"]["hexagon"]}
    document["circuit"] = {**document["circuit"], "terminations": {"coil2": "open", "a": "open"}}
    work = work_on(build_design_file(document), "gast2020")
    origin = work.design.indentation.origin_point
    for step, left in ((("remove_coil", "coil2"), ["a", "c", "d", "e", "f"]), (("set_lattice", "single"), ["a"])):
        found = built(work, step)
        assert list(found.design.array.names) == left
        assert found.design.indentation.origin_point == pytest.approx(origin, abs=1e-9)
        assert list(found.opened.document["coils"]) == ["hexagon", "spare"]
        assert found.opened.document["circuit"]["terminations"] == {"a": "open"}
    rings = built(work, ("set_lattice", "rings"))
    assert list(rings.design.array.names) == [*names, "coil1"]
    assert rings.opened.assumed["array.pitch_mm"] == opened.assumed["array.pitch_mm"]
    free = work_on(load_design_file("gast_fem"), "gast_fem")
    key = "array.placements.0.layers"
    more = built(free, ("add_coil",))
    assert more.opened.assumed[key] == free.opened.assumed[key]
    first = more.design.array.names[0]
    assert made_up(built(more, ("remove_coil", first))) >= {"array.placements.0.layers", "array.placements.0.x_mm"}


@pytest.mark.parametrize(
    ("winding", "layers"),
    [(4, [("L1", "L2", "L3", "L4")] * 3), (1, [("L1",), ("L2",), ("L1",)])],  # of one layer neighbours are apart
)
def test_coils_lie_on_as_many_layers_as_they_are_wound_on(winding, layers):
    changed = vary_chosen(OPENED.document, {"coils.hexagon.winding_layers": winding})
    found = build_design_file(structure.on_its_layers(changed))
    assert [place.layers for place in found.design.array.placements] == layers
    two = built(work_on(OPENED, "starter"), ("set_layers", "2"))
    assert {place.layers for place in two.design.array.placements} == {("L1", "L2")}


def test_a_board_house_brings_its_own_limits_alone():
    own = {**OPENED.document, "fab": {"min_trace_mm": 0.3}, "assumed": {"fab.min_trace_mm": "a guess"}}
    made = built(work_on(build_design_file(own), "starter"), ("set_house", "oshpark-2-layer"))
    assert made.design.rules == load_profile("oshpark-2-layer").rules
    assert "fab.min_trace_mm" not in made.opened.assumed


def test_a_copy_is_called_by_its_own_file_before_and_after_a_step_back(tmp_path):
    first = work_on(OPENED, "starter")
    assert first.called("starter", first.design.title) is first  # the bundled one saved is no other design
    second = with_entry(first, "board.margin_mm", "3")
    copy = Shelf(tmp_path).save(second.called("copy", ""), "copy.toml")
    read = parse_design_file(copy.kept_text, "copy.toml")
    assert (read.document, read.values, read.given) == (copy.kept, copy.opened.values, copy.opened.given)
    assert (read.design.name, read.design.title, read.design.digest) == ("copy", "copy", second.design.digest)
    again = copy.called("copy", "A copy")
    assert parse_design_file(file_text(again.opened, Path()), "copy.toml").values == again.opened.values
    back = first.of_file(again)
    assert (back.file, back.changed) == ("copy.toml", True)
    assert (back.design.name, back.design.title, back.opened.values["board.margin_mm"]) == ("copy", "A copy", 2)


def test_what_would_be_lost_is_known(tmp_path):
    shelf, begun = Shelf(tmp_path), work_on(OPENED, "starter")
    assert not shelf.would_lose(begun, "mine.toml")  # there is none
    mine = shelf.save(begun, "mine.toml")
    assert shelf.would_lose(begun, "mine.toml")  # it was begun with another one
    assert not shelf.would_lose(with_entry(mine, "array.pitch_mm", "13"), "mine.toml")
    (tmp_path / "mine.toml").write_text(f"{mine.kept_text}# meanwhile, in an editor\n", encoding="utf-8")
    assert shelf.would_lose(mine, "mine.toml")
    with pytest.raises(OutputError, match="plain, short name"):
        shelf.would_lose(mine, "../mine.toml")
    with pytest.raises(DesignError, match=r"there is no file other\.toml"):
        shelf.open("other.toml")


def test_choices_of_a_new_design_are_read_from_their_texts():
    texts = {"coils": "3", "shape": "circle", "size": "16", "layers": "4", "pitch": "20.5", "elastomer": False}
    choices = choices_of(texts)
    assert (choices["layers"], choices["pitch"], choices["size"]) == (4, pytest.approx(20.5e-3), pytest.approx(16e-3))
    assert (choices["elastomer"], "connector" in choices) == (False, False)
    for key, text, line in (
        ("layers", "2.5", "must be a whole number; got 2.5"), ("layers", "two", "must be a number; got"),
        ("coils", "20x20", "must be at most 64"), ("size", "wide", "must be a width"),
    ):  # fmt: skip
        with pytest.raises(DesignError, match=f"{key} {line}"):
            choices_of({**texts, key: text})


@pytest.mark.slow
def test_numbers_are_those_of_the_library(starter, circuit):
    found, reference = numbers_of(starter), couple_design(starter)
    np.testing.assert_array_equal(found.inductance, reference.inductance.values)
    xr.testing.assert_identical(circuit.coupling, reference)
    rough = numbers_of(starter, "screen")
    # what screening promises: inductances to 3e-4, see tests/electromagnetics/test_inductance_screen.py
    np.testing.assert_allclose(rough.inductance, found.inductance, rtol=0, atol=3e-4 * found.inductance.max())
    cells, _ = numbers.matrix_cells(found, "k")
    assert [
        [float(cell["full"].partition(" = ")[2]) for cell in row] for row in cells
    ] == reference.coupling.values.tolist()
    assert cells[0][1]["text"] == f"{float(reference.coupling[0, 1]):+.4f}".replace("-", "−")
    assert cells[0][0]["colour"] == "#FFFFFF"
    cells, _ = numbers.matrix_cells(found, "L")
    assert cells[1][1]["full"] == f"L(coil2, coil2) = {found.inductance[1, 1].item()!r} H"
    assert cells[0][1]["full"].startswith("M(coil1, coil2) = ")
    for row in cells:
        for cell in row:  # is read on its colour
            light = np.dot([int(cell["colour"][k : k + 2], 16) / 255 for k in (1, 3, 5)], (0.2126, 0.7152, 0.0722))
            assert abs(light - (1.0 if cell["ink"] == "#FFFFFF" else 0.125)) > 0.25
    table = numbers.coil_table(reference)
    assert [row[0] for row in table.rows] == list(starter.array.names)
    assert [row[2] for row in table.rows] == reference.effective_inductance.values.tolist()


def test_margins_are_the_worst_of_each_rule(starter):
    every = check_rules(starter.array, starter.rules)
    margins = numbers.worst_margins(every)
    assert margins[0] == every[0]
    assert {(m.rule, m.layer) for m in margins} == {(m.rule, m.layer) for m in every}
    for margin in margins:
        assert margin.margin == min(m.margin for m in every if (m.rule, m.layer) == (margin.rule, margin.layer))
    table = numbers.margin_table(margins)
    assert [row[-1] for row in table.rows] == [margin.kept for margin in margins]
    assert table.cells()[0][3:7] == ["0.125", "0.100", "0.025", "mm"]


@pytest.mark.slow
def test_a_board_moves_along_an_axis_and_its_couplings_with_it():
    coil = Spiral(4, 10e-3, 3, 0.3e-3, 0.3e-3).as_array()
    design = Design(coil, boards=(Board(coil, Pose(z=5e-3), "tag"),))
    found = motion_of(design, "tag", "z", 5.0, 25.0)
    assert (found["board"], found["axis"], found["own"], found["at"][::40]) == ("tag", 2, 5.0, [5.0, 25.0])
    (row,) = found["rows"]
    away = link(design, {"tag": [Pose(z=25e-3)]}).coupling.item()
    assert (row["change"][0], row["k"][-1]) == ("+0.0000", f"{away:+.4f}")
    with pytest.raises(DesignError, match="no board of the design can move by the name 'other'"):
        motion_of(design, "other", "z", 5.0, 25.0)


def test_every_number_has_its_change_and_equal_numbers_have_none():
    columns = (Column("coil"), Column("inductance", "L", "H"), Column("unit"))
    before = Table("", "", columns, (("coil1", 3.879e-6, "a"), ("coil2", 2e-6, "a")))
    now = Table("", "", columns, (("coil1", 4.771e-6, "b"), ("coil2", 2e-6, "a"), ("coil3", 1e-6, "a")))
    rows = with_changes(now, before)["rows"]
    assert [cell["change"] for cell in rows[0]["cells"]] == ["", "+0.8920 (+23.0 %)", ""]
    assert not any(cell["change"] for row in rows[1:] for cell in row["cells"])
    assert [cell["text"] for cell in rows[0]["cells"]] == ["coil1", "4.771", "b"]


def test_broken_places_are_marked_where_they_are(starter):
    design = with_entry(work_on(OPENED, "starter"), "coils.hexagon.gap_mm", "0.05").design
    margins = check_rules(design.array, design.rules)
    marks = numbers.marks_of(design, margins)
    broken = [margin for margin in margins if not margin.kept and margin.x is not None]
    assert [(mark["x"], mark["y"]) for mark in marks] == [
        pytest.approx((1e3 * margin.x, 1e3 * margin.y)) for margin in broken
    ]
    assert "spacing within net" in marks[0]["text"]
    assert numbers.marks_of(starter, check_rules(starter.array, starter.rules)) == []


def test_a_scene_is_packed_with_every_triangle_line_and_coil(starter):
    scene = bare_scene(starter, sheets=True)
    one = packed(scene)
    meshes = [part.mesh for part in scene.parts]
    parts = one.words["parts"]
    triangles = sum(part["count"] // 3 for part in parts if not part["lines"])
    assert triangles == sum(mesh.n_cells for mesh in meshes if not mesh.n_lines)
    named = {array["key"] for part in parts for array in part["arrays"].values()}
    assert named == set(one.arrays)
    for part in parts:
        for array in part["arrays"].values():
            assert array["length"] == len(one.arrays[array["key"]])
    copper = next(part for part in parts if part["group"] == "copper L1")
    coils = np.frombuffer(one.arrays[copper["arrays"]["coils"]["key"]], dtype=np.uint8)
    points = np.frombuffer(one.arrays[copper["arrays"]["points"]["key"]], dtype=np.float32).reshape(-1, 3)
    assert set(coils) <= {1, 2, 3}
    for number in set(coils):  # the points are of the coil whose number they have
        place = starter.array.placements[number - 1]
        assert np.abs(points[coils == number, 0].mean() - 1e3 * place.x) < 2.0
    assert one.words["bounds"] == list(scene.bounds)


def test_a_plan_has_outlines_where_the_coils_are(starter):
    plan = plan_of(starter)
    assert plan["movable"]
    for coil, place in zip(plan["coils"], starter.array.placements, strict=True):
        np.testing.assert_allclose(
            np.array(coil["outline"])[:, :2], place.to_board(place.coil.outline) * 1e3, atol=1e-3
        )
        assert coil["name"] == place.name
    charger = plan_of(load_design_file("charger").design)
    assert any(coil["name"].startswith("receiver/") for coil in charger["coils"])


def test_a_slider_knows_where_the_board_becomes_impossible():
    work = work_on(OPENED, "starter")
    entry = next(one for one in entries_of(OPENED) if one.key == "coils.hexagon.turns_per_layer")
    low, high = feasible_range(work, replace(entry, high=60.0))
    assert low == entry.low
    assert entry.value < high < 60.0
    with_entry(work, entry.key, text_of(high))
    with pytest.raises(DesignError):
        with_entry(work, entry.key, text_of(high + entry.step))


def test_settings_name_a_state_and_coils_in_series_add_with_their_coupling(starter):
    ideal = design_circuit(starter, ideal=True)
    state = state_of({"coil1": "measure", "coil2": "measure", "coil3": "open"})
    result = resonate(ideal, state)
    assert result.apparent_inductance == pytest.approx(ideal.inductance[:2, :2].sum(), rel=1e-9)
    np.testing.assert_allclose(np.abs(result.currents), [1.0, 1.0, 0.0], atol=1e-9)
    assert (state.name, state.exceptions) == ("coil1 + coil2", {"coil3": "open"})
    assert kept_settings(starter, {}) == {"coil1": "ground", "coil2": "measure", "coil3": "ground"}
    kept = kept_settings(starter, {"coil1": "open", "coil3": "measure", "coil9": "open"})
    assert kept == {"coil1": "open", "coil2": "ground", "coil3": "measure"}
    with pytest.raises(NetworkError, match="at least one coil must be measured"):
        state_of({"coil1": "ground"})


def test_a_touch_is_located_where_it_is():
    model, setup = model_of(OPENED.document), OPENED.design.indentation
    x, y = off_middle(setup)
    touch = touched(model, x, y, max(setup.depths))
    np.testing.assert_array_equal(list(touch.delta.values()), model.delta([x, y, max(setup.depths)]))
    best = max(touch.location.modes, key=lambda mode: mode.y)  # a row of coils does not tell y from −y
    assert touch.location.verdict == "found"
    # the search ends where χ² no longer falls, well within what noise does
    found = np.array([best.x, best.y, best.depth])
    assert (np.abs(found - touch.place) < 0.05 * best.deviations).all()
    beyond = touched(model, 1.0, -1.0, 1.0)
    np.testing.assert_array_equal(beyond.place, [model.upper[0], model.lower[1], model.upper[2]])


class _State(dict):
    __getattr__, __setattr__ = dict.__getitem__, dict.__setitem__


def test_a_coarse_map_shows_delta_and_no_position():
    session = SimpleNamespace(state=_State(), work=SimpleNamespace(design=OPENED.design), trigger=lambda *_: None)
    panel = TouchPanel(session, lambda: None)
    for coarse in (True, False):
        panel._take_table(bells(OPENED.document, "starter"), coarse=coarse)
        state = session.state
        assert len(state.bars) == 3
        assert 'id="indenter"' in state.touch["svg"]
        assert ('class="pin"' in state.touch["svg"]) is not coarse
        assert ("Pressed at" in state.located[0]) is not coarse


def test_a_coordinate_that_the_board_does_not_fix_is_not_determined():
    information = np.diag(np.array([1e-3, 50e-3, 1e-4]) ** -2.0)
    mode = Mode(1e-3, 7e-3, 5e-4, information, 0.0, span=(80e-3, 33e-3, 2e-3))
    location = Location("found", "", (mode,))
    assert location_lines(location) == ["Pressed at x = 1.00 ± 1 mm, y not determined, depth = 0.50 ± 0.1 mm."]
    assert "ellipse" not in location_marks(top_view(OPENED.design), location)
    scene = scene_of_location(location, (-40e-3, -16e-3, 40e-3, 16e-3), 3e-3)
    assert "y not determined" in scene.notes[0]


def test_a_coil_alone_answers_a_touch_and_says_why_it_locates_none():
    array = {"lattice": "single", "coil": "hexagon", "layers": [["L1", "L2"]]}
    touch = touched(model_of({**OPENED.document, "array": array}), 3e-3, 2e-3, 0.6e-3)
    assert touch.delta["coil1"] > 1e-4
    assert location_lines(touch.location) == ["3 unknowns need at least as many states; the model has coil1."]


def corners(svg, kind):
    """Corners of all polygons of a kind, in m on the board."""
    found = re.findall(rf'<polygon points="([^"]+)" [^>]*{kind}', svg)
    return [
        np.array([[float(one) for one in pair.split(",")] for pair in text.split()]) * (1e-3, -1e-3) for text in found
    ]


def test_marks_stand_where_things_are_and_colours_tell_delta(starter):
    """Drawn to 1 µm."""
    drawn = drawing(starter, {"coil1": 1e-4, "coil2": -1e-4, "coil3": None})
    outlines = corners(drawn["svg"], 'fill-opacity="0.75"')
    for place, outline in zip(starter.array.placements, outlines, strict=True):
        np.testing.assert_allclose(outline, place.to_board(place.coil.outline), atol=0.6e-6)
    assert len(set(re.findall(r'fill="(rgb[^"]+)"', drawn["svg"]))) == 3
    view = top_view(starter)
    assert [float(part) for part in drawn["box"].split()] == pytest.approx(
        [view.left, view.top, view.width, view.height], abs=1e-3
    )


@settings(max_examples=25)
@given(st.floats(0.5, 3.0), st.floats(1.0, 3.0), st.floats(-3.0, 3.0))
def test_an_ellipse_holds_95_percent(narrow, ratio, turn):
    axes = np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]])
    deviations = 1e-3 * np.array([narrow * ratio, narrow])
    information = np.zeros((3, 3))
    information[:2, :2] = axes @ np.diag(1 / deviations**2) @ axes.T
    information[2, 2] = 1e8
    location = Location("found", "", (Mode(1e-3, 2e-3, 1e-3, information, 0.0),))
    (ellipse,) = corners(location_marks(top_view(OPENED.design), location), "")
    away = (ellipse - (1e-3, 2e-3)) @ axes / deviations
    # 5.991 is the quantile of χ² for two; drawn to 1 µm
    np.testing.assert_allclose((away**2).sum(axis=1), 5.991, rtol=1e-2)


def test_bars_and_legend_tell_units_and_ends():
    bars = delta_bars([("a", 2e-4), ("b", -1e-4), ("c", None)])
    assert [(bar["text"], bar["part"]) for bar in bars] == [("+200.0", 50.0), ("−100.0", -25.0), ("–", 0.0)]
    assert delta_bars([("a", 1e-6)], 1e-4)[0]["part"] == 0.5  # small readings stay small,
    assert delta_bars([("a", 1e-6), ("b", 0.0)])[0]["part"] == 50.0  # and computed ones need not
    scale = Scale("|B| (T)", "B", "T", 1e-8, 1e-6, logarithmic=True)
    parts = (Part("plane", None, "B", scale=scale), Part("edge", None, "board", "#123456"))
    legend = _legend(Scene(parts, notes=("a note",)))
    sign = f"linear-gradient(to right, {', '.join(scale.steps(3))})"  # where colours are values, so is the sign
    assert legend["groups"] == [{"name": "B", "colour": sign}, {"name": "board", "colour": "#123456"}]
    assert legend["notes"] == ["a note"]
    (bar,) = legend["bars"]
    assert (bar["title"], bar["ticks"]) == ("B (µT), log", ["0.01", "0.1", "1"])


def test_a_target_says_for_every_state_what_the_library_computes(starter):
    ball = Target(Ball(5e-3, MATERIALS["brass"]), (1e-3, 3e-3), (0.0,), (0.0,))
    found = metal.moved(replace(starter, target=ball), (2e-3, 1e-3))
    assert (found.distances[0], found.distances[-1]) == (1e-3, 3e-3)
    alone = target_map(found.design, distances=[3e-3], x=[2e-3], y=[1e-3]).isel(distance=0, x=0, y=0)
    rows = metal.target_table(found, len(found.distances) - 1).rows
    assert [row[0] for row in rows] == ["coil1", "coil2", "coil3"]
    # the same computation, of fewer distances
    np.testing.assert_allclose([row[2] for row in rows], alone.effective_inductance.values, rtol=1e-9)
    np.testing.assert_allclose([row[6] for row in rows], alone.frequency.values, rtol=1e-9)


def test_boards_are_moved_by_sliders_and_every_coil_has_numbers(tmp_path):
    """Poses are entries, the state, the matrix and B take all coils, and a saved file finds its boards."""
    (tmp_path / "lid.toml").write_text(bundled.read("proximity"))
    placed = '\n[[boards]]\nname = "lid"\ndesign = "lid.toml"\nx_mm = 3\nz_mm = 15\nturn_deg = [180, 0, 0]\n'
    (tmp_path / "pair.toml").write_text(bundled.read("proximity") + placed)
    shelf = Shelf(tmp_path)
    work = shelf.open("pair.toml")
    entries = {entry.key: entry for entry in entries_of(work.opened) if entry.group == "Board lid"}
    assert set(entries) == {
        *(f"boards.lid.{axis}_mm" for axis in "xyz"),
        *(f"boards.lid.turn_deg.{k}" for k in range(3)),
    }
    assert all(entry.low < entry.value < entry.high or entry.value == 180 for entry in entries.values())
    moved = work.with_document(work.document_with({"boards.lid.z_mm": 20.0, "boards.lid.turn_deg.1": 10.0}))
    np.testing.assert_allclose(moved.design.placed[1].pose.shift, [3e-3, 0, 20e-3])
    assert shelf.save(moved, "moved.toml").design.digest == shelf.open("moved.toml").design.digest
    assert '"lid.toml"' in (tmp_path / "moved.toml").read_text()
    names = moved.design.coil_names
    assert numbers_of(moved.design, "screen").names == names
    assert set(kept_settings(moved.design, {})) == set(names)
    fields = unit_fields(moved.design, 5e-3)
    points = grid_points(fields.x, fields.y, fields.height)
    expected = magnetic_field([moved.design.conductors()[1]], points)
    np.testing.assert_allclose(fields.fields[1], expected)
