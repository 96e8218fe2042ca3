"""New designs from a few choices: what was asked is reached by the package's own numbers, and every limit is kept."""

import math
import sys
from dataclasses import replace

import numpy as np
import pytest
from support.refusals import refused

from coilarray import load_design, new_design, save_design
from coilarray.circuit.coupling import design_inductance, scan_design
from coilarray.design.vary import vary
from coilarray.electromagnetics.inductance import inductance_matrix
from coilarray.electromagnetics.resistance import resistance_matrix
from coilarray.errors import DesignError
from coilarray.geometry import check_rules
from coilarray.geometry.connector import NoWayError
from coilarray.studies.create.layout import neighbour_coupling
from coilarray.studies.create.new_design import broken_limits, is_standard
from coilarray.studies.create.plan import Arrangement, Plan, Room, Winding, read_arrangement, wind

MU_0 = 4e-7 * math.pi
ROOM = Room(radius=10e-3, hole=3e-3, trace_width=0.15e-3, gap=0.15e-3)


def sheet_formula(winding):
    """Current-sheet inductance of a circular spiral (Mohan 1999), whose closed form needs no solver."""
    outer = 2 * ROOM.radius
    inner = outer - 2 * (winding.trace_width + winding.turns * (winding.trace_width + winding.gap))
    fill, mean = (outer - inner) / (outer + inner), (outer + inner) / 2
    return MU_0 * winding.turns**2 * mean / 2 * (math.log(2.46 / fill) + 0.2 * fill**2)


def direct_current(winding):
    """What the resistance at direct current is proportional to: turns by mean radius over width."""
    mean = ROOM.radius - 0.5 * (winding.trace_width + winding.turns * (winding.trace_width + winding.gap))
    return winding.turns * mean / winding.trace_width


@pytest.mark.parametrize("inductance", [0.3e-6, 2e-6, 5e-6])
def test_a_winding_of_a_closed_form_has_the_inductance_and_the_least_resistance(inductance):
    found = wind(inductance, ROOM, sheet_formula, direct_current)
    assert sheet_formula(found) == pytest.approx(inductance, rel=3e-3)  # the trace is rounded to 1 µm
    assert ROOM.trace_width <= found.trace_width <= ROOM.widest(found.turns) + 1e-12
    # a turn more or less has another width for that inductance, and then more resistance
    resistance = found.turns / found.trace_width
    for turns in (found.turns - 1, found.turns + 1):
        widths = np.linspace(ROOM.trace_width, max(ROOM.widest(turns), ROOM.trace_width), 400)
        values = np.array([sheet_formula(Winding(turns, width, ROOM.gap)) for width in widths.tolist()])
        if values.min() < inductance < values.max():
            width = float(np.interp(-inductance, -values, widths))
            mean = 2 * ROOM.radius - turns * (width + ROOM.gap)
            own = 2 * ROOM.radius - found.turns * (found.trace_width + ROOM.gap)
            assert turns / width * mean > 0.97 * resistance * own


def test_an_inductance_out_of_reach_is_refused_with_the_range():
    most = sheet_formula(Winding(22, 0.15e-3, 0.15e-3)) * 1e6
    words = f"an inductance of 900 µH cannot be reached: at most {most:.4g} µH can, with 22 turns a layer, traces of"
    refused(DesignError, words, wind, 900e-6, ROOM, sheet_formula, direct_current)
    least = sheet_formula(Winding(1, ROOM.widest(1), ROOM.gap)) * 1e6
    words = f"an inductance of 0.0001 µH cannot be reached: at least {least:.3g} µH can, with 1 turn a layer, traces of"
    refused(DesignError, words, wind, 1e-10, ROOM, sheet_formula, direct_current)
    narrow = Room(1e-3, 0.9e-3, 0.15e-3, 0.15e-3)
    refused(
        DesignError, "there is no room for a turn of 0.15 mm trace between 0.9 and 1 mm", wind, 1e-6, narrow, id, id
    )


@pytest.mark.parametrize(
    ("coils", "shape", "expected"),
    [
        ("1x1", "square", Arrangement("single")),
        ("6", "square", Arrangement("linear", 6)),
        ("4x4", "square", Arrangement("square", 4, 4)),
        ("3×2", "hexagon", Arrangement("hexagonal", 3, 2)),
        ("3-hex", "circle", Arrangement("triangle", 2)),
        ("7-hex", "hexagon", Arrangement("rings", 1)),
        ("19-HEX", "circle", Arrangement("rings", 2)),
    ],
)
def test_arrangements_are_read(coils, shape, expected):
    assert read_arrangement(coils, shape) == expected


@pytest.mark.parametrize("coils", ["", "0", "4x", "x4", "8-hex", "4x0", "-3", "4 by 4"])
def test_other_arrangements_are_refused(coils):
    refused(DesignError, f"coils must be as 1, 6 .*; got '{coils}'", read_arrangement, coils)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("coils", "choices"),
    [
        ("3", {"size": 14e-3, "inductance": 6e-6}),
        ("2x2", {"shape": "square", "size": 12e-3, "inductance": 4e-6, "fab": "jlcpcb-2-layer"}),
        ("1", {"shape": "circle", "size": 12e-3, "inductance": 1e-6, "frequency": 6.78e6, "elastomer": False}),
        ("2", {"shape": "racetrack", "size": (14e-3, 8e-3), "inductance": 1e-6}),
    ],
)
def test_a_design_has_what_was_asked_and_keeps_every_limit(tmp_path, coils, choices):
    file = new_design("asked", coils, **choices)
    design = file.design
    save_design(file, tmp_path / "asked.toml")
    assert load_design(tmp_path / "asked.toml").digest == design.digest
    found = np.diag(design_inductance(design)[0])
    assert found == pytest.approx(choices["inductance"], rel=2e-3)  # the trace is rounded to 1 µm
    assert all(margin.kept for margin in check_rules(design.array, design.rules))
    scan = scan_design(design, elastomer=False)
    assert broken_limits(scan) == []
    assert choices.get("fab", "oshpark-2-layer") == file.values["fab.profile"]
    if "frequency" in choices:
        assert float(scan.frequency[0]) == pytest.approx(
            choices["frequency"], rel=1e-2 if is_standard(file.design.circuit.capacitance) else 3e-3
        )  # what a standard capacitance may miss, else three digits of it
    # the capacitance of a winding under rubber is not that in air
    assert file.values["circuit.elastomer_permittivity"] == (1.0 if choices.get("elastomer") is False else 3.0)
    assert ("circuit.elastomer_permittivity" in file.assumed) == (choices.get("elastomer") is not False)
    assert (design.indentation is None) == (choices.get("elastomer") is False)


@pytest.mark.parametrize("frequency", [1e6, 2e6])
def test_a_wanted_frequency_is_that_of_the_whole_circuit(frequency):
    """With the switches of several coils, whose losses lower the frequency at a small quality factor."""
    design = new_design("tuned", "3", frequency=frequency).design
    found = float(scan_design(design, elastomer=False, accuracy="screen").frequency.mean())
    # a standard capacitance is taken where it misses no more than 1 %, else three digits: 0.5 % of C, half of that of f
    assert found == pytest.approx(frequency, rel=1e-2 if is_standard(design.circuit.capacitance) else 2.6e-3)


@pytest.mark.slow
@pytest.mark.parametrize(("coils", "layers"), [("3", 4), ("7-hex", 6)])
def test_neighbours_that_overlap_do_not_couple(coils, layers):
    """On layers of their own, and with terminals that no other coil meets."""
    design = new_design("apart", coils, size=20e-3, overlap="decoupled", elastomer=False).design
    k = neighbour_coupling(design)
    assert abs(float(k.mean())) < 2e-3  # that of a few coils, whose pairs of layers count otherwise, is taken to zero
    assert np.abs(k).max() < 1e-2  # pairs of layers differ in their distance
    assert len(design.array.stackup.names) == layers
    assert design.array.placements[0].layers != design.array.placements[1].layers
    assert all(margin.kept for margin in check_rules(design.array, design.rules))


@pytest.mark.slow
@pytest.mark.parametrize("coils", ["3", "2x2"])
def test_leads_run_to_a_connector(coils):
    """At the side asked for, on a board that keeps every rule; coils of several rows get ways between them."""
    choices = {"shape": "square", "size": 8e-3, "elastomer": False}
    file = new_design("led", coils, connector="right", **choices)
    array = file.design.array
    assert file.document["connector"]["side"] == "right"
    ends = np.vstack([place.to_board(place.coil.terminal_points) for place in array.placements])
    assert np.ptp(ends[:, 0]) < 1e-12  # one row of pads
    assert ends[0, 0] > max(place.x for place in array.placements) + choices["size"] / 2
    assert all(margin.kept for margin in check_rules(array, file.design.rules))


@pytest.mark.parametrize(("led", "movable", "boards"), [(1, False, 1), (2, False, 3), (1, True, 3)])
def test_a_connector_without_room_is_refused_early(monkeypatch, led, movable, boards):
    """Where coils that stay are too near for the leads between them, a connector farther away does not help."""
    tried = []

    def no_way(array, connector):
        tried.append(connector.distance)
        error = NoWayError(0, "")
        error.routed = led
        raise error

    module = sys.modules["coilarray.studies.create.layout"]
    monkeypatch.setattr(module, "route_leads", no_way)
    arrangement = Arrangement("square", 2, 2)
    plan = Plan("pad", "", arrangement, "square", (8e-3, 8e-3), False, "oshpark-2-layer", pitch=10e-3)
    # 8 mm of coil, leads of 2.5 mm, two traces of 0.15 mm, three gaps of 0.15 mm: 11.25 mm; in steps of 0.5 mm
    tail = "" if movable or led > 1 else "; try a pitch of about 11.5 mm, smaller coils, another side"
    words = rf"at most {led} of 4 coils can be routed to the top edge at a pitch of {13 if movable else 10} mm{tail}"
    refused(DesignError, words, module.with_connector, plan, "top", movable=movable)
    assert len(tried) == boards


@pytest.mark.slow
def test_a_wide_trace_has_the_least_resistance_where_the_coil_is_used():
    file = new_design("power", "1", size=30e-3, inductance=5e-6, elastomer=False)
    design = file.design
    f = float(scan_design(design, elastomer=False, accuracy="screen").frequency[0])
    chosen, ac, dc = int(file.values["coils.hexagon.turns_per_layer"]), {}, {}
    for turns in range(chosen - 1, chosen + 3):
        widths = np.geomspace(0.15, 2.0, 6)
        made = [vary(file, {"coils.hexagon.turns_per_layer": turns, "coils.hexagon.trace_width_mm": w}) for w in widths
                if turns * (w + 0.15) + w < 11]  # fmt: skip
        L = np.array([inductance_matrix(one.array, accuracy="screen")[0, 0] for one in made])
        if L.min() < 5e-6 < L.max():
            width = float(np.interp(-5e-6, -L, widths[: len(L)]))
            same = vary(file, {"coils.hexagon.turns_per_layer": turns, "coils.hexagon.trace_width_mm": width})
            R = resistance_matrix(same.array, [f])
            ac[turns], dc[turns] = float(R.resistance[0, 0, 0]), float(R.dc_resistance[0])
    assert len(ac) > 2
    assert ac[chosen] < 1.05 * min(ac.values())  # the search takes a likely frequency
    assert min(dc, key=dc.get) != chosen  # at direct current more turns of wider traces would do


@pytest.mark.slow
def test_wide_traces_of_squares_keep_apart_at_their_corners_and_pads_beside_wide_leads():
    wide = new_design("wide", "1", shape="square", size=30e-3, inductance=0.5e-6, layers=2, elastomer=False)
    assert wide.values["coils.square.trace_width_mm"] > 2
    assert wide.values["coils.square.gap_mm"] > 0.15  # a gap as drawn would be too narrow there
    assert all(margin.kept for margin in check_rules(wide.design.array, wide.design.rules))
    words = "an inductance of 0.5 µH cannot be reached: at least 0.9.* µH can, with 1 turn a layer"
    refused(DesignError, words, new_design, "x", "1", shape="square", size=30e-3, inductance=0.5e-6, layers=4)
    four = replace(Plan("x", "", Arrangement("single"), "square", (40e-3, 40e-3), False, fab="oshpark-4-layer"),
                   winding_layers=4, winding=Winding(2, 3e-3, 0.5e-3))  # fmt: skip
    assert all(margin.kept for margin in check_rules(four.design.array, four.rules))


@pytest.mark.parametrize(("sets", "winding_layers"), [(1, 2), (2, 2), (4, 2), (3, 4), (4, 4)])
def test_every_board_is_as_thick_as_its_reason_says(sets, winding_layers):
    plan = Plan("b", "", Arrangement("linear", 2), "square", (8e-3, 8e-3), False, "multi-cb-35um", sets, pitch=1e-2)
    document = replace(plan, winding_layers=winding_layers).document
    stack = document["stackup"]
    thickness = sum(stack["copper_thickness_um"]) * 1e-3 + sum(stack["dielectric_thickness_mm"])
    assert thickness == pytest.approx(1.6, abs=8e-3)  # each dielectric is rounded to three digits
    assert min(stack["dielectric_thickness_mm"]) > 0.06  # thinner ones are not usual
    assert document["assumed"]["stackup.dielectric_thickness_mm"].startswith("usual of a board of 1.6 mm")


@pytest.mark.parametrize(("part", "resistance"), [(None, 0.0), ("ADG739", 5.0)])
def test_coils_have_the_switches_that_are_asked_for(part, resistance):
    """Nothing but copper is in R and Q of a new design, unless a part of switches is named."""
    arrangement = Arrangement("linear", 2)
    plan = Plan("b", "", arrangement, "circle", (8e-3, 8e-3), False, "oshpark-4-layer", pitch=1e-2, switches=part)
    assert plan.design.circuit.short_resistance == resistance
    assert ("switches" in plan.document["circuit"]) == (part is not None)
    assert not any(key.startswith("circuit.short") for key in plan.document["assumed"])


REFUSED = {
    "shape": ({"shape": "star"}, "shape must be one of hexagon, square, circle, rectangle, racetrack; got 'star'"),
    "switches": ({"switches": "ADG1"}, "switches must be one of ADG714, ADG738, ADG739; got 'ADG1'"),
    "sides": ({"size": (20e-3, 12e-3)}, "size must be one number for a hexagon; got 20 × 12 mm"),
    "size in m for mm": ({"size": 0.02e-3}, "size must be 0.5 to 1000 mm; got 0.02 mm"),
    "size in mm": ({"size": 12}, "size must be 0.5 to 1000 mm; got 12000 mm"),
    "pitch in mm": ({"pitch": 15}, "pitch must be 0.5 to 1000 mm; got 15000 mm"),
    "connector": ({"connector": "up"}, "connector must be one of right, top, left, bottom; got 'up'"),
    "frequency in MHz": ({"frequency": 1}, "frequency must be 0.001 to 1000 MHz; got 1e-06 MHz"),
    "inductance": ({"inductance": math.nan}, "inductance must be positive and finite; got nan µH"),
    "overlap": ({"overlap": "some"}, "overlap must be one of none, decoupled; got 'some'"),
    "both": ({"overlap": "decoupled", "pitch": 1e-2}, "pitch and overlap cannot both be given"),
    "layers": ({"layers": 3}, "layers must be 1 or a multiple of 2; got 3"),
    "fab": ({"fab": "nobody"}, "there is no fab profile 'nobody'"),
    "layers of the fab": ({"layers": 2, "fab": "oshpark-4-layer"}, "layers must be 4, as oshpark-4-layer makes"),
    "too few of the fab": ({"overlap": "decoupled", "fab": "jlcpcb-2-layer"}, "a multiple of 4 .*; got 2 of jlcpcb-2"),
    "capacitance": ({"capacitance": 0.0}, "capacitance must be positive and finite; got 0 pF"),
    "frequency twice": ({"capacitance": 1e-10, "frequency": 2e6}, "frequency and capacitance cannot both be given"),
    "too small": ({"size": 1e-3}, "size must be at least 3.28 mm, for a turn of 0.1524 mm trace about .*; got 1 mm"),
    "too many layers": ({"layers": 30}, "layers must be at most 20 for a coil of 16 mm; got 30: there is no room for"),
    "too near": ({"pitch": 1e-3}, "pitch must leave room .*, as 19 mm and more do; got 1 mm: there is no place"),
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("name", REFUSED)
def test_choices_that_cannot_be_are_one_line(name):
    choices, words = REFUSED[name]
    refused(DesignError, words, new_design, "x", "3", **choices)


@pytest.mark.slow
def test_a_large_coil_of_little_inductance_has_a_trace_for_which_the_losses_hold():
    file = new_design("x", "1", size=0.2, inductance=10e-6, elastomer=False)
    assert file.values["coils.hexagon.trace_width_mm"] <= 5


@pytest.mark.slow
def test_the_vias_of_many_layers_have_room_between_the_leads():
    made = new_design("many", "1", size=10e-3, inductance=6e-6, layers=8, elastomer=False)
    assert not [margin for margin in check_rules(made.design.array, made.design.rules) if not margin.kept]
