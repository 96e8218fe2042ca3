"""Fabrication rules: known distances come back as margins, shorts are negative, sound coils pass.

Overlapping paths have the same verdict, on known and on random boards.

Who checks whom: closed formulas for parallel traces, pads and overlaps; for whole spirals the distance of their turns,
taken turn by turn with shapely.
"""

import math
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from support.boards import FOUR_LAYERS, LEADS, VIA, many_layers, one_coil, reference_board, round_spiral
from support.refusals import refused

from coilarray import Conductor, Lattice, inductance_matrix, lattice_array, mutual_inductance
from coilarray.errors import GeometryError, RuleViolationError
from coilarray.geometry import Array, Bend, Placement, PlatedHole, RoundedSpiral, Spiral, Zone, path_coil
from coilarray.geometry.coil import Coil
from coilarray.geometry.rules import KEPT_WITHIN, FabRules, check_rules, require_apart, require_rules

W, GAP = 0.2e-3, 0.2e-3
RULES = FabRules()
ROUNDING = 1e-12  # m: coordinates of at most 0.1 m in float64, a few operations


def margins(array, rule, rules=RULES):
    return {(m.layer, m.feature): m for m in check_rules(array, rules) if m.rule == rule}


def spacing(array, layer="L1"):
    """What the rules say of the distances within the net A on a layer."""
    return margins(array, "spacing within net")[(layer, "A")]


def broken(array, rules=RULES):
    return [m for m in check_rules(array, rules) if not m.kept]


def board(*lines, width=W, terminal=None, via=VIA, **options):
    """Board with one coil A of these lines, or several coils A, B, … where each entry is a list of lines."""
    stackup = many_layers(4)
    coils = [path_coil(each, width, GAP, via, terminal) for each in lines]
    placements = [Placement(chr(65 + k), c, stackup.names[: len(c.lines)], 0, 0) for k, c in enumerate(coils)]
    return Array(stackup, tuple(placements), **options)


def straight(y, x0=0.0, x1=5e-3):
    return [[(x0, y), (x1, y)]]


def test_the_reference_board_keeps_the_default_rules():
    array = reference_board(count=2)
    require_rules(array, FabRules(min_gap=0.1e-3))
    worst = margins(array, "spacing within net")[("L1", "C1")]
    assert worst.value == pytest.approx(turn_to_turn(array.placements[0].coil.lines[0][2:-1], 6), abs=ROUNDING)
    assert -KEPT_WITHIN < worst.margin < 0
    require_rules(reference_board(through_holes=False), RULES)


def test_a_pad_without_a_hole_has_no_rule_of_holes():
    bare = path_coil([[(0, 0), (5e-3, 0)]], 1e-3, 1e-3, VIA, LEADS.terminal)
    array = Array(FOUR_LAYERS, (Placement("A", bare, ("L2",), 0, 0),), through_holes=False)
    rules = {margin.rule for margin in check_rules(array, FabRules(max_aspect_ratio=10))}
    assert not rules & {"drill", "annular ring", "hole spacing", "aspect ratio"}
    drilled = check_rules(replace(array, through_holes=True), FabRules(max_aspect_ratio=10))
    assert {"drill", "annular ring", "aspect ratio"} <= {margin.rule for margin in drilled}


SHAPES = {
    **{f"{sides} sides": partial(Spiral, sides, 12e-3 if sides == 3 else 16e-3) for sides in (3, 4, 5, 6, 8)},
    "circle": partial(RoundedSpiral, 16e-3, 16e-3, corner_radius=8e-3),
    "rectangle": partial(RoundedSpiral, 13e-3, 20e-3),
    "racetrack": partial(RoundedSpiral, 20e-3, 14e-3, corner_radius=7e-3, direction=math.pi / 2),
    "rounded triangle": partial(RoundedSpiral, 14e-3, 14e-3, corner_radius=3e-3, sides=3, direction=0.3),
    "rounded hexagon": partial(RoundedSpiral, 14e-3, 14e-3, corner_radius=7e-3, sides=6),
}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("shape", "winding", "layers"),
    [
        *((f"{n} sides", *kind) for n in (3, 4, 5, 6, 8) for kind in [("cw", 2), ("cw", 3), ("ccw", 6)]),
        *(("circle", "ccw", 6), ("rectangle", "cw", 3), ("racetrack", "cw", 2), ("rounded triangle", "ccw", 3)),
        ("rounded hexagon", "cw", 1),
    ],
)
def test_wound_coils_of_every_kind_are_free_of_violations(shape, winding, layers):
    # nominal gap 10 µm above the limit: the turns of a triangle come up to 5 µm closer than nominal; with six layers
    # three vias lie at one corner
    rules = FabRules(min_gap=0.13e-3)
    sides = SHAPES[shape](turns=1, width=0.12e-3, gap=0.14e-3).sides
    for turns in (6, 5 + 1 / sides):
        spiral = SHAPES[shape](turns=turns, width=0.12e-3, gap=0.14e-3, winding=winding)
        for return_lead in (False, True)[: 1 + layers % 2]:
            coil = replace(spiral, layers=layers, return_lead=return_lead).coil()
            assert broken(one_coil(coil, rotation=1.234), rules) == []
        assert broken(one_coil(replace(spiral, layers=layers, leads=None).coil()), rules) == []


@pytest.mark.slow
@given(rotation=st.floats(-7, 7), shape=st.sampled_from(list(SHAPES)))
@settings(max_examples=15)
def test_margins_do_not_depend_on_rotation(rotation, shape):
    coil = SHAPES[shape](turns=3, width=0.15e-3, gap=0.2e-3).coil()
    for rule in ("spacing within net", "annular ring", "hole spacing"):
        here = {key: m.margin for key, m in margins(one_coil(coil), rule).items()}
        turned = {key: m.margin for key, m in margins(one_coil(coil, rotation=rotation), rule).items()}
        assert turned == pytest.approx(here, abs=ROUNDING)


def turn_to_turn(line, sides):
    """Least distance of the turns of a spiral of traces of 0.1 mm."""
    segments = shapely.linestrings(np.stack((line[:-1], line[1:]), axis=1))
    return min(shapely.distance(segments[:-n], segments[n:]).min() for n in range(sides - 1, sides + 2)) - 0.1e-3


def test_turn_spacing_is_the_distance_of_consecutive_turns():
    for sides in (3, 4, 6):
        spiral = Spiral(sides, 16e-3, 10, 0.1e-3, 0.2e-3)
        value = spacing(one_coil(replace(spiral, layers=1, leads=None).coil())).value
        assert value == pytest.approx(turn_to_turn(spiral.centre_line(), sides), abs=ROUNDING)
    # turns too close are found
    worst = spacing(one_coil(round_spiral(6e-3, 10, 0.1e-3, 0.08e-3, layers=1, leads=None).coil()))
    # arcs about one centre keep their distance, parallel pieces of 2° but for 1.5e-4 of the pitch of 0.18 mm
    assert worst.margin == pytest.approx(-0.02e-3, abs=1.5e-4 * 0.18e-3)
    assert 3.5e-3 < math.hypot(worst.x, worst.y) < 6e-3


def test_hairpins():
    for gap in (0.05e-3, 0.1e-3, 0.3e-3):
        array = board([[(0, 0), (5e-3, 0), (5e-3, W + gap), (0, W + gap)]])
        assert spacing(array).margin == pytest.approx(gap - 0.1e-3, abs=ROUNDING)
    # with legs that diverge
    array = board([[(0, 0.6e-3), (5e-3, 0.25e-3), (5e-3, 0), (0, 0)]])
    # counted from 0.9 mm along the copper, where the legs are a little over 0.25 mm apart from centre to centre
    assert -0.05e-3 < spacing(array).margin < -0.02e-3
    notch = board([[(0, 5e-3), (5e-3, 0.25e-3), (5e-3, 0), (0, 0)]])
    assert broken(notch) == []


def test_corners_and_finely_divided_arcs_are_no_gap():
    for phi in np.radians([40, 60, 90, 120, 179]).tolist():
        array = board([[(0, 0), (5e-3, 0), (5e-3 - 5e-3 * math.cos(phi), 5e-3 * math.sin(phi))]])
        assert margins(array, "spacing within net") == {}
    t = np.linspace(0, math.pi, 200)
    for radius in (0.4e-3, 1e-3, 4e-3):
        assert broken(board([radius * np.column_stack((np.cos(t), np.sin(t)))])) == []


def test_a_lead_across_its_own_winding_is_a_short():
    spiral = Spiral(6, 16e-3, 5, 0.15e-3, 0.15e-3)
    coil = replace(spiral, layers=1, leads=None).coil()
    line = np.vstack((coil.lines[0], [10e-3, 0.0]))  # from the inner end straight out
    refused(GeometryError, "crosses itself", path_coil, [line], 0.15e-3, 0.15e-3, VIA)
    crossing = one_coil(Coil((line,), (np.full(len(line) - 1, 0.15e-3),), 0.15e-3, VIA, None, coil.outline))
    # centre lines meet: minus the trace width
    assert spacing(crossing).value == pytest.approx(-0.15e-3, abs=ROUNDING)
    refused(RuleViolationError, "spacing within net of A on layer L1", require_rules, crossing, RULES)


def test_an_inner_pad_against_the_next_turn():
    for overlap in (-0.05e-3, 0.02e-3, 0.2e-3):
        y = VIA.pad / 2 + W / 2 - overlap
        array = board([[(-3e-3, y), (3e-3, y), (3e-3, -2e-3), (0, -2e-3), (0, 0)], [(0, 0), (0, -1e-3)]])
        assert spacing(array).margin == pytest.approx(-overlap - 0.1e-3, abs=ROUNDING)


def test_separate_pads_and_barrels_of_one_net():
    lines = [
        [(0, 0), (3e-3, 0)],
        [(3e-3, 0), (3e-3, 3e-3), (0, 3e-3)],
        [(0, 3e-3), (0, 6e-3), (6e-3, 6e-3), (6e-3, -1e-3), (3e-3, -1e-3), (3e-3, 5e-3)],
    ]
    worst = spacing(board(lines), "L3")
    assert worst.value == pytest.approx(-(VIA.pad + W) / 2, abs=ROUNDING)
    assert (worst.x, worst.y) == pytest.approx((3e-3, 0), abs=ROUNDING)
    assert broken(board(lines, through_holes=False)) == []
    # pads
    far, near = 0.6e-3, 0.5e-3
    array = board([[(0, 0), (3e-3, 0)], [(3e-3, 0), (0, far)], [(0, far), (0, 3e-3)]], via=PlatedHole(0.2e-3, 0.4e-3))
    assert broken(array) == []
    lines = [[(-3e-3, 0), (0, 0)], [(0, 0), (2e-3, 2e-3), (0, 4e-3), (0, near)], [(0, near), (-3e-3, near)]]
    close = board(lines, via=PlatedHole(0.2e-3, 0.45e-3))
    # no trace there, only the two pads
    assert spacing(close, "L4").value == pytest.approx(near - 0.45e-3, abs=ROUNDING)


@given(gap=st.floats(-0.15e-3, 0.9e-3))
@settings(max_examples=20)
def test_clearance_is_continuous_through_contact(gap):
    array = board(straight(0), straight(W + gap))
    margin = margins(array, "clearance")[("L1", "A – B")].margin
    # penetration of two strips is the width of their overlap; the inscribed circle is found to 0.1 µm
    assert margin == pytest.approx(gap - 0.1e-3, abs=ROUNDING if gap > 0 else 2.1e-7)


def test_overlaps_of_two_nets():
    array = board(straight(0), [[(2e-3, -2e-3), (2e-3, 2e-3)]])
    worst = margins(array, "clearance")[("L1", "A – B")]
    assert worst.value == pytest.approx(-W, abs=2.1e-7)  # tolerance of the inscribed circle
    assert (worst.x, worst.y) == pytest.approx((2e-3, 0), abs=1e-6)
    # whole windings
    coil = Spiral(6, 16e-3, 20, 0.1e-3, 0.1e-3, layers=1, leads=None).coil()
    array = Array(many_layers(1), (Placement("A", coil, ("L1",), 0, 0), Placement("B", coil, ("L1",), 3e-3, 1e-3)))
    assert margins(array, "clearance")[("L1", "A – B")].margin < -0.1e-3  # hundreds of crossings, each with its circle
    # a through hole meets foreign copper on a layer that it does not use
    other = Placement("B", path_coil(straight(0, 2e-3, 6e-3), W, GAP, VIA), ("L4",), 0, 0)
    mine = Placement("A", path_coil([[(0, 0), (4e-3, 0)], [(4e-3, 0), (4e-3, 4e-3)]], W, GAP, VIA), ("L1", "L2"), 0, 0)
    worst = margins(Array(FOUR_LAYERS, (mine, other)), "clearance")[("L4", "A – B")]
    assert worst.value < -0.9 * W
    assert margins(Array(FOUR_LAYERS, (mine, other), through_holes=False), "clearance") == {}


def test_what_is_listed_and_in_which_order():
    assert margins(board(straight(0), straight(5e-3)), "clearance") == {}
    assert margins(board(straight(0), straight(W + 0.95e-3)), "clearance") != {}
    # the worst comes first
    values = [round(m.margin, 12) for m in check_rules(reference_board(count=2, turns=5), RULES)]
    assert values == sorted(values)
    # at its limits a design passes, a micrometre more does not
    assert broken(board(straight(0), straight(W + 0.1e-3), width=W)) == []
    assert broken(board(straight(0), straight(W + 0.0989e-3), width=W)) != []
    assert broken(board(straight(0), width=0.1e-3)) == []


def test_holes_widths_and_edge():
    hole = PlatedHole(0.25e-3, 0.55e-3)
    array = board([[(0, 0), (0.3e-3 + 0.25e-3, 0)]], width=0.12e-3, terminal=hole, board_margin=0.25e-3)
    expected = {"trace width": 0.02e-3, "drill": 0.05e-3, "annular ring": 0.05e-3, "hole spacing": 0.05e-3}
    for rule, margin in (*expected.items(), ("edge clearance", -0.05e-3)):
        assert margins(array, rule)[("L1", "A")].margin == pytest.approx(margin, abs=ROUNDING)
    assert margins(array, "edge clearance")[("L4", "A")].margin == pytest.approx(-0.05e-3, abs=ROUNDING)
    # of two nets
    hole = PlatedHole(0.3e-3, 0.4e-3)
    array = board(straight(0), straight(0.35e-3), terminal=hole)
    worst = margins(array, "hole spacing")[("L1", "A – B")]
    assert worst.margin == pytest.approx(0.05e-3 - 0.25e-3, abs=ROUNDING)


def test_the_place_of_a_narrow_trace_lies_on_its_copper_and_not_in_the_hole_at_its_end():
    array = board(straight(0), terminal=PlatedHole(0.3e-3, 0.6e-3))
    narrow = margins(array, "trace width")[("L1", "A")]
    line = array.placements[0].coil.lines[0]
    assert (narrow.x, narrow.y) == pytest.approx(line[:2].mean(axis=0))
    assert all(math.hypot(narrow.x - x, narrow.y - y) > 0.3e-3 for x, y in line)


def test_limits_must_be_finite_and_not_negative():
    for name in ("min_trace", "min_gap", "min_drill", "min_annular_ring", "min_edge_clearance"):
        for value in (-1e-4, math.nan, math.inf):
            refused(GeometryError, f"{name} must be finite and not negative", FabRules, **{name: value})


def test_the_error_names_layer_feature_margin_and_the_rest():
    array = board(straight(0), straight(W + 0.04e-3))
    message = r"^clearance of A – B on layer L1 is 0\.04 mm at \(.*\) mm, margin -0\.06 mm to the limit of 0\.1 mm\.$"
    refused(RuleViolationError, message, require_rules, array, RULES)
    refused(RuleViolationError, r"; 2 more are broken\.$", require_rules, array, FabRules(min_trace=0.21e-3))


def test_progress_counts_every_coil_on_every_layer():
    board, seen = reference_board(), []
    check_rules(board, FabRules(), progress=lambda *step: seen.append(step))
    total = len(board.stackup.names) * len(board.placements)
    assert seen == [(k + 1, total) for k in range(total)]


WIDTH = 1e-3
BAR = path_coil([[(0, 0), (10e-3, 0)]], WIDTH, WIDTH, VIA)
HAIRPIN = [(0, 0), (10e-3, 0), (10e-3, 2e-3), (0, 2e-3)]


def apart(array):
    require_apart(array.conductors(), array.stackup)


def placed(*placements):
    return Array(FOUR_LAYERS, placements)


def bars(y, *, x=0.0, turn=0.0, layer="L1"):
    return placed(Placement("A", BAR, ("L1",), 0, 0), Placement("B", BAR, (layer,), x, y, turn))


def loop(gap):
    """One coil whose second run comes back beside the first one, a gap away."""
    return placed(
        Placement(
            "A", path_coil([[(x, np.sign(y) * (WIDTH + gap)) for x, y in HAIRPIN]], WIDTH, WIDTH, VIA), ("L1",), 0, 0
        )
    )


@pytest.mark.parametrize(
    ("array", "text"),
    [
        (bars(0.9e-3), r"copper of A – B overlaps on layer L1 at \(.*\) mm, by 0.1 mm"),
        (bars(0.998e-3), "by 0.002 mm"),
        (bars(0.0), "by 1 mm"),
        (bars(-5e-3, x=5e-3, turn=np.pi / 2), "by 1 mm"),  # across
        (loop(-0.4e-3), r"copper of A overlaps on layer L1 at \(.*\) mm, by 0.4 mm"),
    ],
)
def test_overlapping_traces_are_refused_as_by_the_rules(array, text):
    refused(GeometryError, text, apart, array)
    refused(GeometryError, text, inductance_matrix, array)
    assert min(one.value for one in check_rules(array, FabRules())) < 0


@pytest.mark.parametrize(
    "array",
    [
        bars(1e-3),  # they touch
        bars(0.9995e-3),  # less deep than the rules forgive
        bars(0.0, layer="L2"),
        bars(0.0, x=10e-3),  # end to end
        bars(1e-3, x=10e-3, turn=np.pi / 4),  # the bounds overlap
        loop(0.05e-3),  # nearer than the rules allow, but apart
    ],
)
def test_traces_that_are_apart_are_computed(array):
    apart(array)
    assert (np.linalg.eigvalsh(inductance_matrix(array)) > 0).all()


def test_random_boards_have_the_verdict_of_the_rules():
    """Two paths of two straight runs each, on 10 mm; half of the boards have an overlap of some kind."""
    random, refusals = np.random.default_rng(23), 0
    for _ in range(40):
        width = 10.0 ** random.uniform(-4.5, -3)
        coils = [path_coil([random.uniform(-5e-3, 5e-3, (3, 2))], width, width, VIA) for _ in "AB"]
        array = placed(*(Placement(name, coil, ("L1",), 0, 0) for name, coil in zip("AB", coils, strict=True)))
        worst = min(one.value for one in check_rules(array, FabRules()) if one.rule != "edge clearance")
        try:
            apart(array)
        except GeometryError:
            refusals += 1
            assert worst <= -KEPT_WITHIN
        else:
            assert worst > -KEPT_WITHIN
    assert 10 < refusals < 30


def bare(*lines, width=WIDTH, thickness=35e-6, z=0.0):
    """Bare paths in one plane, by x and y in mm."""
    return [
        Conductor([(1e-3 * x, 1e-3 * y, z) for x, y in line], width, thickness, name=name)
        for name, line in zip("AB", lines, strict=False)
    ]


SQUARE = [(0, 0), (10, 0), (10, 10), (0, 10)]
SPIRAL = Spiral(6, 16e-3, 12, 0.15e-3, 0.15e-3, leads=None).coil()


@pytest.mark.parametrize(
    ("paths", "text"),
    [
        (bare([(0, 0), (10, 0)], [(5, -5), (5, 5)]), r"copper of A – B overlaps on z 0 mm at \(5, .*\) mm, by 1 mm"),
        (bare([(0, 0), (10, 0)], [(0, 0), (10, 0)]), "copper of A – B .* by 1 mm"),
        (bare([(0, 0), (10, 0), (10, 0.6), (0, 0.6)]), "copper of A .* by 0.4 mm"),  # its ends meet
        (bare([(0, 0), (10, 10), (10, 0), (0, 10), (0, 0)]), "copper of A .* by 1 mm"),  # closed, and crosses itself
        (bare([(0, 0), (10, 0)]) + bare([(5, -5), (5, 5)], z=30e-6), "copper of A – A .* by 1 mm"),  # of 35 µm
    ],
)
def test_bare_paths_in_each_other_are_refused(paths, text):
    refused(GeometryError, text, inductance_matrix, paths)
    L = inductance_matrix(paths, allow_overlaps=True)
    assert L.shape == (len(paths), len(paths))
    if len(paths) == 2:
        assert L[0, 1] == mutual_inductance(paths[0], paths[1])[0, 0]


@pytest.mark.parametrize(
    "paths",
    [
        bare([*SQUARE, (0, 0)]),
        bare([*SQUARE, (0, 0.3)]),  # the end of a turn beside its beginning
        bare([(0, 5), *SQUARE, (0, 5)]),
        bare(5 * np.array([(np.cos(t), np.sin(t)) for t in np.linspace(0, 2 * np.pi, 97)])),
        bare([(0, 0), (10, 0)]) + bare([(5, -5), (5, 5)], z=35e-6),  # they lie on each other
        [Conductor([(0, 0, 0), (0, 0, 1e-2)], 1e-3, 1e-3), Conductor([(0, 0, 0), (1e-2, 0, 0)], 1e-3, 1e-3)],
    ],
)
def test_bare_paths_that_are_apart_or_closed_are_computed(paths):
    assert (np.linalg.eigvalsh(inductance_matrix(paths)) > 0).all()


def test_spirals_in_each_other_are_refused_by_name():
    """Half a pitch aside, turns that are parallel to the shift lie in the gaps, and the others in each other."""
    places = [Placement(name, SPIRAL, ("L1", "L2"), x, 0) for name, x in (("A", 0.0), ("B", 0.15e-3))]
    refused(GeometryError, "copper of A – B overlaps on layer L1", inductance_matrix, placed(*places))
    refused(GeometryError, "copper of A – B overlaps on z -0.0175 mm", inductance_matrix, placed(*places).conductors())
    turned = [Placement(name, SPIRAL, ("L1", "L2"), x, 0, x) for name, x in (("A", 0.0), ("B", 0.15e-3))]
    refused(GeometryError, "copper of A – B overlaps", inductance_matrix, placed(*turned).conductors())


@pytest.mark.parametrize("kind", ["linear", "square", "hexagonal"])
def test_lattices_that_overlap_on_other_layers_are_apart(kind):
    layers = (("L1", "L2"), ("L3", "L4")) if kind != "hexagonal" else (("L1",), ("L2",), ("L3",))
    coil = SPIRAL if kind != "hexagonal" else Spiral(6, 16e-3, 12, 0.15e-3, 0.15e-3, layers=1, leads=None).coil()
    lattice = Lattice(kind, 12e-3, 3, 1 if kind == "linear" else 3, layers)
    array = lattice_array(FOUR_LAYERS, coil, lattice)
    apart(array)
    flat = replace(array, placements=tuple(replace(one, layers=layers[0]) for one in array.placements))
    refused(GeometryError, "copper of .* overlaps on layer L1", apart, flat)


@pytest.mark.parametrize(("layers", "usual"), [(1, 10.0), (2, 10.0), (3, 20.0)])
def test_the_ratio_of_a_bend_has_a_margin(layers, usual):
    """The inner radius over the thickness, against the usual limit (IPC-2223) or the board house's."""
    strip = Array.row(Spiral(6, 10e-3, 4, 0.3e-3, 0.3e-3, layers=layers), 1)
    thickness = strip.stackup.thickness
    bent = strip.bent(Bend((Zone(12 * thickness, at=0.0, width=1e-3),), neutral=-thickness / 2))
    (margin,) = [one for one in check_rules(bent, FabRules()) if one.rule == "bend ratio"]
    assert (margin.value, margin.limit) == (pytest.approx(11.5), usual)
    assert margin.kept is (usual == 10.0)
    (margin,) = [one for one in check_rules(bent, FabRules(min_bend_ratio=11.6)) if one.rule == "bend ratio"]
    assert margin.margin == pytest.approx(-0.1)
    assert not [one for one in check_rules(strip, FabRules()) if one.rule == "bend ratio"]


def test_bars_on_edge_overlap_in_no_plan():
    """Two layers of an upright board, 0.1 mm apart, whose widths of 1 mm are vertical."""
    bars = [Conductor([[0, y, 0], [1e-2, y, 0]], 1e-3, 35e-6, across=(0, 0, 1)) for y in (0.0, 0.1e-3)]
    require_apart(bars)
