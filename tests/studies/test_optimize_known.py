"""Known answers, through the whole of it: design file, variables, quantities, sampler, local solver.

What                                       checked against
centre distances where two loops decouple  tests/reference/ref_geometric_decoupling_loops.csv, to 1e-3 of the size
a better layout of gast2020                the published one, and the quantities of the design that is found

A thin loop is a path of one turn, open by 1 µm so that it has two ends, of a trace 0.02 mm wide and 1 µm thick at a
radius of 10 mm. The reference is the limit of no width. With a trace, M is the mean over the cross-sections, which
differs from that of the middle lines in the square of the width over the distance of the wires, 4e-4 at the nearest for
h = R/10: far less than the tolerance, as half and twice the width show.
"""

import math

import pytest
from support.contacts import few_turns
from support.references import rows

from coilarray.compute.workers import open_executor
from coilarray.design.model import parse_design
from coilarray.design.vary import vary
from coilarray.studies.optimize import load_goal, optimize_design, parse_goal
from coilarray.studies.quantities import evaluate

pytestmark = pytest.mark.slow

LOOPS = """
schema = 1
name = "loops"
array = {{ lattice = "linear", coil = "loop", columns = 2, pitch_mm = 15.0, layers = [["L1"], ["L2"]] }}
coils.loop = {{ shape = "path", lines_mm = [{corners}], trace_width_mm = {width}, gap_mm = 0.01, terminals = false }}
[stackup]
layers = ["L1", "L2"]
copper_thickness_um = [1, 1]
dielectric_thickness_mm = [{gap}]
dielectric_epsilon_r = [4.5]
"""

GOAL = """
schema = 1
variable = [{{ entry = "array.pitch_mm", low = {low}, high = {high} }}]
objective = [{{ quantity = "k[coil1,coil2]", target = 0.0 }}]
search = {{ trials = 6, polish = 14 }}
"""

PAIR = "k[coil1,coil2]"
RADIUS = 10.0  # mm
# corners, angle of the first one, size that the distance is measured in
SHAPES = {
    "circle": (144, 0.0, 2 * RADIUS),
    "hexagon_across_flats": (6, math.pi / 6, math.sqrt(3) * RADIUS),
    "hexagon_across_corners": (6, 0.0, 2 * RADIUS),
}
TABLE = rows("geometric_decoupling_loops")
KNOWN = {(row["shape_direction"], float(row["h_over_R"])): float(row["d_crit_normalised"]) for row in TABLE}


def loops(shape, h, width):
    sides, first, _ = SHAPES[shape]
    # a polygon of the circle's area has its far field; the corners lie 2e-4 of the radius outside of it
    step = 2 * math.pi / sides
    radius = RADIUS * (math.sqrt(step / math.sin(step)) if shape == "circle" else 1.0)
    corners = [[radius * math.cos(first + k * step), radius * math.sin(first + k * step)] for k in range(sides)]
    (x0, y0), (x1, y1) = corners[0], corners[-1]
    part = 1e-3 / math.hypot(x1 - x0, y1 - y0)
    corners.append([x0 + part * (x1 - x0), y0 + part * (y1 - y0)])
    # layers are 1 µm thick: their middles are a dielectric and 1 µm apart
    return parse_design(LOOPS.format(gap=h * RADIUS - 1e-3, corners=corners, width=width))


@pytest.mark.parametrize(("shape", "h"), [
    ("circle", 0.1), ("circle", 0.5), ("hexagon_across_flats", 0.1), ("hexagon_across_flats", 0.3),
    ("hexagon_across_corners", 0.1), ("hexagon_across_corners", 0.3),
])  # fmt: skip
def test_decoupling_distance(tmp_path, shape, h):
    size = SHAPES[shape][2]
    goal = parse_goal(GOAL.format(low=0.55 * size, high=0.95 * size))
    with open_executor() as pool:
        result = optimize_design(loops(shape, h, 0.02), goal, tmp_path, pool)
    found = result.best.changes["array.pitch_mm"] / size
    assert found == pytest.approx(KNOWN[shape, h], abs=1e-3)
    assert result.best.scores[0] < 1e-5  # |k|, that of the start is above 1e-3
    assert result.start.scores[0] > 1e-3


def test_width_of_thin_loops_does_not_matter():
    """The root moves by less than a tenth of the tolerance from half the width to twice."""
    shape, h = "hexagon_across_flats", 0.1
    size = SHAPES[shape][2]
    below, above = 0.84 * size, 0.845 * size  # k is straight enough between them
    roots = []
    for width in (0.01, 0.04):
        pair = (vary(loops(shape, h, width), {"array.pitch_mm": pitch}) for pitch in (below, above))
        ks = [evaluate(design, [PAIR])[PAIR] for design in pair]
        roots.append(below - ks[0] * (above - below) / (ks[1] - ks[0]))
    assert abs(roots[1] - roots[0]) < 1e-4 * size


def test_a_layout_of_the_real_board_with_less_coupling(tmp_path):
    """The goal with a few points, of coils of few turns; the whole of it finds 0.0159 at 15.4 mm."""
    design = parse_design(few_turns("gast2020"))
    goal = load_goal("worst_k", design)
    few = goal.model_copy(update={"search": goal.search.model_copy(update={"trials": 8, "polish": 4})})
    with open_executor() as pool:
        result = optimize_design(design, few, tmp_path, pool)
    start, best = result.start.quantities, result.best.quantities
    assert start["worst_k"] == pytest.approx(evaluate(design, ["worst_k"])["worst_k"], rel=1e-12)
    assert best["worst_k"] < 0.8 * start["worst_k"]
    size = evaluate(design, ["covered_mm2", "board_area_mm2"])
    assert best["covered_mm2"] >= 0.95 * size["covered_mm2"] * (1 - 5e-3)  # bounds have three digits
    assert best["board_area_mm2"] <= 1.25 * size["board_area_mm2"] * (1 + 5e-3)
    assert best["fab_margin_mm"] >= -0.001
    (found,) = result.designs()
    assert found.array.placements[0].coil.outline == pytest.approx(design.array.placements[0].coil.outline)
    assert evaluate(found, ["worst_k"])["worst_k"] == pytest.approx(best["worst_k"], rel=1e-12)
