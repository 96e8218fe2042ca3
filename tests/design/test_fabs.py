"""Fab profiles and the table [fab]: bundled limits stand on their pages, those of the board as a whole hold.

Who checks whom: the profiles against numbers copied from the sources a second time, in the sources' own units; the
limits of boards against closed forms of their stack-up. Traces, gaps and holes are those of test_geometry_rules.py.
"""

import csv
import io
import re
from dataclasses import replace
from datetime import date
from types import SimpleNamespace

import pytest
from support.boards import VIA, many_layers, one_coil, reference_board
from support.refusals import refused

from coilarray import parse_design
from coilarray.design import fabs
from coilarray.design.bundled import read
from coilarray.design.fabs import FabTable, load_profile
from coilarray.design.model import parse_design_file
from coilarray.errors import DesignError, RuleViolationError
from coilarray.geometry import FabRules, Spiral, check_rules, require_rules
from coilarray.report.sections import SECTIONS
from coilarray.report.tables import design_table, rules_table

MIL = 0.0254  # mm
ROUNDING = 1e-12  # of numbers near 1: products of a few floats
BASIC = (
    "min_trace_mm", "min_gap_mm", "min_drill_mm", "min_annular_ring_mm", "min_edge_clearance_mm", "min_hole_spacing_mm",
)  # fmt: skip
STARTER = read("starter")
WITHOUT_FAB = STARTER[: STARTER.index("[fab]")]


def with_fab(table):
    """The starter design with this table [fab] instead of its own."""
    return parse_design_file(f"{WITHOUT_FAB}\n[fab]\n{table}\n")


def found(array, rules, rule):
    return [margin for margin in check_rules(array, rules) if margin.rule == rule]


@pytest.mark.parametrize("name", fabs.names())
def test_every_profile_has_a_source_a_date_and_sensible_limits(name):
    profile = load_profile(name)
    assert (profile.name, type(profile.read)) == (name, date)
    assert profile.title
    assert profile.sources
    assert all(title and url.startswith(("http://", "https://")) for title, url in profile.sources)
    # whatever a page does not say must be said to be assumed, not left to a default
    assert set(BASIC) | set(profile.assumed) <= set(profile.limits)
    assert all(profile.assumed.values())
    rules = profile.rules
    sensible = dict.fromkeys(("min_trace", "min_gap", "min_annular_ring"), (0.05e-3, 0.3e-3))
    sensible |= {"min_drill": (0.1e-3, 0.5e-3), "max_outer_copper": (17e-6, 105e-6)}
    sensible |= dict.fromkeys(("min_edge_clearance", "min_hole_spacing"), (0.1e-3, 0.6e-3))
    for key, (least, most) in sensible.items():
        assert least <= getattr(rules, key) <= most, key
    if "-layer" in name:
        assert rules.max_layers == int(name.split("-")[1])
        assert (rules.max_inner_copper is None) == (rules.max_layers == 2)


STATED = {
    # docs.oshpark.com, "2 Layer Medium Run Service": Quick Specs and Detailed Specs
    "oshpark-2-layer": {
        "min_trace_mm": 6 * MIL, "min_gap_mm": 6 * MIL, "min_drill_mm": 10 * MIL, "min_annular_ring_mm": 5 * MIL,
        "min_edge_clearance_mm": 15 * MIL, "max_outer_copper_um": 1.4 * MIL * 1e3,
        "min_hole_spacing_mm": 6 * MIL,  # mdDrill of the EAGLE rules
    },
    # docs.oshpark.com, "Flex PCBs": Copper, Drill and Board Specifications
    "oshpark-flex": {
        "min_trace_mm": 6 * MIL, "min_gap_mm": 6 * MIL, "min_annular_ring_mm": 5 * MIL,
        "min_edge_clearance_mm": 15 * MIL, "max_outer_copper_um": 1.4 * MIL * 1e3, "max_layers": 2,
    },
    # mdWireWire, msWidth, msDrill, rlMinViaOuter, mdCopperDimension, mdDrill, mtCopper of oshpark-4layer-tented.dru
    "oshpark-4-layer": {
        "min_gap_mm": 5 * MIL, "min_trace_mm": 5 * MIL, "min_drill_mm": 10 * MIL, "min_annular_ring_mm": 4 * MIL,
        "min_edge_clearance_mm": 15 * MIL, "min_hole_spacing_mm": 6 * MIL, "max_outer_copper_um": 1.4 * MIL * 1e3,
        "max_inner_copper_um": 0.7 * MIL * 1e3,
    },
    # "rules" of aisler-4-layer-hd-drc.kicad_pro; the ring is half of via less hole too
    "aisler-4-layer": {
        "min_trace_mm": 0.125, "min_gap_mm": 0.125, "min_drill_mm": 0.25, "min_annular_ring_mm": (0.45 - 0.25) / 2,
        "min_edge_clearance_mm": 0.3, "min_hole_spacing_mm": 0.3,
    },
    # column "class 6" of the classification; "Copper and the board edge"
    "eurocircuits-class-6": {
        "min_trace_mm": 0.150, "min_gap_mm": 0.150, "min_annular_ring_mm": 0.125, "min_edge_clearance_mm": 0.40,
        "min_hole_spacing_mm": 0.25,
    },
    # coil boards; via of 0.45 mm around 0.2 mm (multi layer) and of 0.6 mm around 0.3 mm (double layer)
    "jlcpcb-2-layer": {
        "min_trace_mm": 0.15, "min_gap_mm": 0.15, "min_drill_mm": 0.3, "min_annular_ring_mm": (0.6 - 0.3) / 2,
        "min_edge_clearance_mm": 0.3,
    },
    "jlcpcb-4-layer": {
        "min_trace_mm": 0.15, "min_gap_mm": 0.15, "min_drill_mm": 0.2, "min_annular_ring_mm": (0.45 - 0.2) / 2,
        "max_inner_copper_um": 17.5,
    },
    # the row of 35 um in both tables; "Max. aspect ratio 1:10"; "copper / milling contour 200 um"
    "multi-cb-35um": {
        "min_trace_mm": 0.1, "min_gap_mm": 0.1, "min_drill_mm": 0.1, "min_annular_ring_mm": 0.1,
        "min_edge_clearance_mm": 0.2, "max_aspect_ratio": 10,
    },
}  # fmt: skip


@pytest.mark.parametrize(("name", "key"), [(name, key) for name, limits in STATED.items() for key in limits])
def test_limits_are_those_of_the_sources(name, key):
    profile = load_profile(name)
    assert key not in profile.assumed
    assert profile.limits[key] == pytest.approx(STATED[name][key], rel=ROUNDING)


def test_an_unknown_profile_names_the_known_ones():
    refused(DesignError, f"there is no fab profile 'x'; there are {', '.join(fabs.names())}", load_profile, "x")
    with pytest.raises(KeyError):
        fabs.read("x")


def test_without_a_profile_or_keys_the_defaults_hold():
    assert FabRules(**FabTable().in_si(without=("profile",))) == FabRules()
    assert parse_design(WITHOUT_FAB).rules == FabRules()
    assert with_fab("").design.rules == FabRules()


@pytest.mark.parametrize("name", fabs.names())
def test_a_profile_gives_every_limit(name):
    profile, design = load_profile(name), with_fab(f'profile = "{name}"')
    assert design.design.rules == profile.rules
    for key, value in profile.limits.items():
        assert design.values[f"fab.{key}"] == value
    assert design.given & {key for key in design.values if key.startswith("fab.")} == {"fab.profile"}
    # what the profile assumes is assumed by the design that trusts it
    assert {key: why for key, why in design.assumed.items() if key.startswith("fab.")} == {
        f"fab.{key}": why for key, why in profile.assumed.items()
    }


def test_keys_beside_a_profile_go_first():
    design = with_fab('profile = "jlcpcb-4-layer"\nmin_gap_mm = 0.2\nmin_hole_spacing_mm = 0.4\nblind_holes = true')
    stated = load_profile("jlcpcb-4-layer").rules
    assert design.design.rules == replace(stated, min_gap=0.2 * 1e-3, min_hole_spacing=0.4 * 1e-3, blind_holes=True)
    assert design.values["fab.min_gap_mm"] == 0.2
    assert "fab.min_gap_mm" in design.given
    # no longer the profile's assumption
    assert "fab.min_hole_spacing_mm" not in design.assumed
    assert "fab.max_outer_copper_um" in design.assumed
    # a design may say why it takes a limit
    text = f'{WITHOUT_FAB}\n[fab]\nprofile = "multi-cb-35um"\n[assumed]\n"fab.min_hole_spacing_mm" = "asked them"\n'
    assert parse_design_file(text).assumed["fab.min_hole_spacing_mm"] == "asked them"


def test_the_digest_follows_the_limits():
    base = with_fab("").design.digest
    assert with_fab("min_trace_mm = 0.1").design.digest == base  # the default
    assert with_fab("max_layers = 4").design.digest != base
    assert with_fab('profile = "multi-cb-35um"').design.digest != base


@pytest.mark.parametrize(("table", "name", "expected"), [
    ("min_trace_mm = 0.2", "min_trace", 0.2e-3), ("min_gap_mm = 0.2", "min_gap", 0.2e-3),
    ("min_drill_mm = 0.3", "min_drill", 0.3e-3),
    ("min_annular_ring_mm = 0.15", "min_annular_ring", 0.15e-3),
    ("min_edge_clearance_mm = 0.5", "min_edge_clearance", 0.5e-3),
    ("min_hole_spacing_mm = 0.5", "min_hole_spacing", 0.5e-3), ("max_layers = 6", "max_layers", 6),
    ("max_outer_copper_um = 70", "max_outer_copper", 70e-6), ("max_inner_copper_um = 35", "max_inner_copper", 35e-6),
    ("max_aspect_ratio = 8", "max_aspect_ratio", 8),
    ("max_board_mm = [400, 500.5]", "max_board", (0.4, 0.5005)),
    ("blind_holes = false", "blind_holes", False),
])  # fmt: skip
def test_each_key_sets_its_limit_in_si(table, name, expected):
    rules = with_fab(table).design.rules
    assert getattr(rules, name) == pytest.approx(expected, rel=ROUNDING)
    assert rules == replace(FabRules(), **{name: getattr(rules, name)})  # and nothing else


@pytest.mark.parametrize(("table", "message"), [
    ('profile = "osh"', f"fab has no profile 'osh'; there are {', '.join(fabs.names())}."),
    ("profile = 4", "fab.profile must be a text; got 4"), ('profile = ""', "fab has no profile ''"),
    ('profile = "multi-cb-35um"\nmin_trace = 1', "fab has no key 'min_trace'; did you mean min_trace_mm?"),
    ("max_board_mm = [400]", "fab.max_board_mm must have at least 2 entries; got [400]"),
    ("min_trace_mm = -1", "fab.min_trace_mm must be at least 0; got -1"),
    ('blind_holes = "no"', "fab.blind_holes must"),
    ("max_aspect_ratio = inf", "fab.max_aspect_ratio must be a finite number; got inf"),
])  # fmt: skip
def test_a_wrong_table_is_one_clear_line(table, message):
    refused(DesignError, re.escape(message), with_fab, table)


def test_an_assumed_rule_of_another_table_is_refused_with_its_own():
    text = f'{WITHOUT_FAB}\n[assumed]\n"rules.min_trace_mm" = "not given"\n'
    refused(DesignError, r"names no value of the design; did you mean fab\.min_trace_mm\?", parse_design, text)


@pytest.mark.parametrize(("layers", "most", "kept"), [(1, 2, True), (2, 2, True), (3, 2, False), (4, 2, False)])
def test_layer_count(layers, most, kept):
    coil = Spiral(6, 20e-3, 3, 0.2e-3, 0.2e-3, layers=1, leads=None).coil()
    array = replace(one_coil(coil), stackup=many_layers(layers))
    (margin,) = found(array, FabRules(max_layers=most), "layer count")
    assert (margin.value, margin.limit, margin.margin, margin.unit) == (layers, most, most - layers, "")
    assert margin.kept is kept
    assert (margin.x, margin.y, margin.layer, margin.feature) == (None, None, "", "board")


@pytest.mark.slow
def test_copper_of_outer_and_inner_layers_has_limits_of_its_own():
    stackup = replace(many_layers(4), copper_thickness=(35e-6, 17e-6, 40e-6, 80e-6))
    array = replace(reference_board(), stackup=stackup)
    margins = found(array, FabRules(max_outer_copper=70e-6, max_inner_copper=35e-6), "copper thickness")
    spare = {margin.layer: margin.margin for margin in margins}
    expected = {"L1": 35e-6, "L2": 18e-6, "L3": -5e-6, "L4": -10e-6}
    assert spare == pytest.approx(expected, abs=1e-15)  # differences of numbers of 1e-5
    assert {margin.layer for margin in margins if not margin.kept} == {"L3", "L4"}
    only_outer = found(array, FabRules(max_outer_copper=70e-6), "copper thickness")
    assert [margin.layer for margin in only_outer] == ["L4", "L1"]


@pytest.mark.slow
def test_aspect_ratio_is_the_board_thickness_over_the_smallest_hole():
    array = reference_board()
    thickness = 4 * 35e-6 + 3 * 0.215e-3
    (margin,) = found(array, FabRules(max_aspect_ratio=3.0), "aspect ratio")
    assert margin.value == pytest.approx(thickness / VIA.drill, rel=ROUNDING)  # the vias, not the wider terminals
    assert margin.margin == pytest.approx(3.0 - margin.value, rel=ROUNDING)
    assert not margin.kept
    assert margin.feature in array.names
    drilled = [(hole[0], hole[1]) for place in array.placements for hole in place.to_board(place.coil.via_points)]
    assert (margin.x, margin.y) in drilled
    assert found(array, FabRules(max_aspect_ratio=margin.value), "aspect ratio")[0].kept
    # a blind hole is as deep as the layers it joins
    (margin,) = found(reference_board(through_holes=False), FabRules(max_aspect_ratio=10.0), "aspect ratio")
    assert margin.value == pytest.approx((2 * 35e-6 + 0.215e-3) / VIA.drill, rel=ROUNDING)


@pytest.mark.slow
def test_blind_holes_are_counted():
    rules = FabRules(blind_holes=False)
    (through,) = found(reference_board(), rules, "blind holes")
    assert (through.value, through.margin, through.kept) == (0, 0, True)
    (blind,) = found(reference_board(through_holes=False), rules, "blind holes")
    # six coils, each with one via; a terminal that reaches one layer of several is a pad without a hole
    assert (blind.value, blind.margin, blind.kept) == (6, -6, False)
    assert found(reference_board(through_holes=False), FabRules(), "blind holes") == []
    # a two-layer coil on a two-layer board joins all layers there are; its terminals are pads
    coil = Spiral(6, 20e-3, 3, 0.2e-3, 0.2e-3).coil()
    assert found(one_coil(coil, through_holes=False), rules, "blind holes")[0].value == 0


@pytest.mark.slow
def test_a_board_may_be_turned_to_fit():
    array = reference_board()
    x_min, y_min, x_max, y_max = array.bounds
    long, short = x_max - x_min, y_max - y_min
    assert long > short
    for limits in ((long + 1e-3, short + 2e-3), (short + 2e-3, long + 1e-3)):
        spare = [margin.margin for margin in found(array, FabRules(max_board=limits), "board size")]
        assert spare == pytest.approx([1e-3, 2e-3], abs=1e-15)
    too_small = FabRules(max_board=(long - 1e-3, long - 1e-3))
    assert [margin.kept for margin in found(array, too_small, "board size")] == [False, True]


def test_no_limit_no_margin_and_broken_ones_come_first():
    """Broken counts before broken lengths; of what is kept the copper before the bare board, which has no margin."""
    named = {margin.rule for margin in check_rules(reference_board(), FabRules())}
    assert named.isdisjoint({"layer count", "copper thickness", "aspect ratio", "blind holes", "board size"})
    rules = FabRules(max_layers=2, max_aspect_ratio=100.0, max_inner_copper=20e-6, max_outer_copper=35e-6)
    margins = check_rules(reference_board(), rules)
    kept = [margin.kept for margin in margins]
    assert kept == sorted(kept)
    assert [margin.rule for margin in margins[:3]] == ["layer count", "copper thickness", "copper thickness"]
    of_board = [margin.feature == "board" for margin in margins if margin.kept]
    assert of_board == sorted(of_board)
    assert [margin.margin for margin in margins[-2:]] == pytest.approx([0, 0], abs=1e-15)  # both outer layers
    for group in (margins[:3], [one for one in margins if one.kept and one.feature != "board"]):
        lengths = [round(margin.margin, 12) for margin in group if margin.unit == "m"]
        assert lengths == sorted(lengths)
        units = [margin.unit for margin in group]
        assert units == sorted(units, reverse=group[0].kept)  # "" before "m", and after it where nothing is broken


@pytest.mark.slow
@pytest.mark.parametrize(("rules", "message"), [
    (FabRules(max_layers=2), r"^layer count of board is 4, margin -2 to the limit of 2\.$"),
    (FabRules(max_inner_copper=20e-6),
     r"^copper thickness of board on layer L2 is 0\.035 mm, margin -0\.015 mm to the limit of 0\.02 mm; 1 more"),
    (FabRules(max_aspect_ratio=2.0),
     r"^aspect ratio of C\d on layer L1 is 3\.925 at \(.*\) mm, margin -1\.925 to the limit of 2\.$"),
    (FabRules(max_board=(0.05, 0.05)), r"^board size of board is 90\.\d* mm, margin -40\.\d* mm to the limit of 50 mm"),
])  # fmt: skip
def test_the_error_names_what_the_board_breaks(rules, message):
    refused(RuleViolationError, message, require_rules, reference_board(), rules)


@pytest.mark.slow
def test_the_table_shows_millimetres_and_numbers_and_files_keep_si():
    margins = check_rules(reference_board(), FabRules(max_layers=2, max_aspect_ratio=2.0))
    table = rules_table(margins)
    rows = list(csv.DictReader(io.StringIO(table.csv())))
    assert len(rows) == len(margins)
    for row, margin in zip(rows, margins, strict=True):
        assert all(float(row[key]) == getattr(margin, key) for key in ("value", "limit", "margin"))
        assert row["unit"] == (margin.unit or "1")
        assert row["x_m"] == ("" if margin.x is None else str(margin.x))
    cells = {row[0]: row for row in reversed(table.cells())}
    assert cells["layer count"] == ["layer count", "", "board", "4", "2", "−2", "", "", "", "no"]
    assert cells["aspect ratio"][3:7] == ["3.925", "2", "−1.925", ""]
    assert cells["annular ring"][3:7] == ["0.125", "0.100", "0.025", "mm"]


def test_a_report_names_the_profile_and_its_sources():
    stated, file = load_profile("multi-cb-35um"), with_fab('profile = "multi-cb-35um"')
    margins = check_rules(file.design.array, file.design.rules)
    words = SECTIONS["Fabrication rules"](SimpleNamespace(file=file, margins=margins)).blocks[0]
    assert words.startswith(f"Limits of {stated.title}")
    assert stated.read.isoformat() in words
    assert all(f"[{title}]({url})" in words for title, url in stated.sources)
    assert next(iter(stated.assumed.values())) in design_table(file).csv()
