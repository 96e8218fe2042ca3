"""Quantities of a design against the functions they stand on, against closed forms, and against synthetic responses."""

# ruff: noqa: E501 - each case is one line of input and one of output
import math
from dataclasses import replace

import numpy as np
import pytest
import xarray as xr
from support.contacts import coarse_maps, linear
from support.localize_boards import bells

from coilarray import load_design, mutual_inductance, parse_design, self_inductance
from coilarray.circuit.coupling import design_circuit, scan_design
from coilarray.design.vary import vary
from coilarray.errors import CoilarrayError, GoalError
from coilarray.geometry import MATERIALS, Ball, Target, check_rules
from coilarray.geometry.rules import _HORIZON
from coilarray.localize.forward import forward_model, table_grid
from coilarray.localize.identifiability import identifiability
from coilarray.response.map import Imperfections, response_map
from coilarray.response.setup import DEFAULT_MESH
from coilarray.response.target import ranges_of, target_map
from coilarray.studies.quantities import QUANTITIES, Evaluation, canonical, evaluate, evaluation, request
from coilarray.studies.quantities.catalogue import FARTHEST, LENGTH_RULES

GAST, STARTER = load_design("gast2020"), linear(load_design("starter"))

LOOPS = """
schema = 1
name = "loops"
stackup = { layers = ["top", "bottom"], copper_thickness_um = [35, 35], dielectric_thickness_mm = [1.5], dielectric_epsilon_r = [4.4] }
coils.square = { shape = "path", trace_width_mm = 0.2, gap_mm = 0.2, terminals = false, lines_mm = [
  [[-5, -5], [5, -5], [5, 5], [-5, 5], [-5, -4.5]],
] }
[array]
lattice = "free"
placements = [
  { name = "a", coil = "square", layers = ["top"], x_mm = 0, y_mm = 0 },
  { name = "b", coil = "square", layers = ["bottom"], x_mm = 4, y_mm = 0 },
  { name = "c", coil = "square", layers = ["top"], x_mm = 15, y_mm = 2 },
]
"""


def value(design, asked):
    return evaluate(design, [asked])[canonical(asked)]


def test_the_catalogue_says_what_everything_is():
    costs = ["geometry", "coupling", "circuit", "target", "response", "table"]
    assert [q.cost for q in QUANTITIES.values()] == sorted((q.cost for q in QUANTITIES.values()), key=costs.index)
    units = {"mm": "mm", "mm2": "mm²", "uH": "µH", "MHz": "MHz", "ohm": "Ω", "kohm": "kΩ", "um": "µm"}
    for name, quantity in QUANTITIES.items():
        # the unit stands in the name
        assert (quantity.name, quantity.unit) == (name, units.get(name.rpartition("_")[2], "1"))
        assert len(quantity.says) > 10
        assert "\n" not in quantity.says
        assert all(option.says and option.must_be for option in quantity.options)


@pytest.mark.parametrize(("asked", "key"), [
    ("rms_k", "rms_k"), (" rms_k ", "rms_k"), ({"quantity": "rms_k"}, "rms_k"),
    ({"quantity": "k", "coils": ["coil1", "coil2"]}, "k[coil1,coil2]"),
    ({"quantity": "k", "coils": ("coil2", "coil1")}, "k[coil2,coil1]"), ("k[ coil1 , coil2 ]", "k[coil1,coil2]"),
    ("q[coil=coil1]", "q[coil1]"), ("fab_margin_mm[ hole spacing ]", "fab_margin_mm[hole spacing]"),
    ("peak_delta[depth_mm=0.50,coil2]", "peak_delta[coil2,depth_mm=0.5]"),
    ({"quantity": "peak_delta", "depth_mm": 1, "coil": "coil2"}, "peak_delta[coil2,depth_mm=1]"),
    ("position_error_mm[noise=0.00001,depth_mm=1.0]", "position_error_mm[depth_mm=1,noise=1e-05]"),
    ({"quantity": "depth_error_mm", "region_mm": [-20, 20.5, -5, 5]}, "depth_error_mm[region_mm=-20:20.5:-5:5]"),
    ("depth_error_mm[region_mm=-20:20.5:-5:5]", "depth_error_mm[region_mm=-20:20.5:-5:5]"),
])  # fmt: skip
def test_canonical_text_and_back(asked, key):
    assert canonical(asked) == canonical(key) == key
    assert dict(request(key).options) == dict(request(asked).options)


BAD_REQUESTS = {
    "unknown": ("rms_q", "there is no quantity 'rms_q'; did you mean rms_k? coilarray optimize --list-quantities shows all"),
    "a letter": ("L", "there is no quantity 'L'; did you mean inductance_uH? coilarray"),
    "without its unit": (
        "inductance",
        "there is no quantity 'inductance'; did you mean inductance_uH, effective_inductance_uH, target_inductance_uH?",
    ),
    "nothing like it": ("zzzz", "there is no quantity 'zzzz'. coilarray optimize --list-quantities"),
    "no name": ("", "the name of a quantity is missing; there are board_area_mm2"),
    "open bracket": ("k[coil1", "a quantity must be a name, with options in brackets, such as k[coil1,coil2]; got 'k[coil1'."),
    "missing option": ("k", "k needs the option coils, the names of two coils: write k[coil1,coil2]."),
    "one coil twice": ("k[a,a]", "k: coils must be the names of two coils; got ['a', 'a']."),
    "unknown option": ("q[coill=coil1]", "q has no option 'coill'; did you mean coil?"),
    "a number": (3, "a quantity must be a name, with options in brackets"),
    "missing coil": ("inductance_uH", "inductance_uH needs the option coil"),
    "not finite": ("peak_delta[depth_mm=nan]", "peak_delta: depth_mm must be a number of mm above 0; got 'nan'."),
    "named twice": ("depth_error_mm[noise=1,noise=2]", "depth_error_mm: noise must be given once; got 'noise=1,noise=2'."),
    "no number": ("depth_error_mm[noise=x]", "depth_error_mm: noise must be a number above 0; got 'x'."),
    "falling region": ("depth_error_mm[region_mm=1:0:0:1]", "depth_error_mm: region_mm must be [x_min, x_max, y_min, y_max] in mm, rising; got '1:0:0:1'."),
    "unknown rule": ("fab_margin_mm[trace]", "fab_margin_mm: rule must be one of trace width, spacing within net, clearance"),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD_REQUESTS)
def test_wrong_requests_are_one_clear_line_before_anything_is_computed(case, monkeypatch):
    asked, message = BAD_REQUESTS[case]
    monkeypatch.setattr(evaluation, "design_inductance", lambda *_: pytest.fail("computed"))
    with pytest.raises(GoalError) as error:
        evaluate(GAST, ["rms_k", asked])
    assert str(error.value).startswith(message)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("pitch", [13.28, 19.0, 25.0])
def test_span_and_cover_of_a_row_of_hexagons(pitch):
    """Hexagons with flats towards their neighbours: where two overlap, half-widths add up to more than the pitch."""
    corner, flat = 11.5 / math.cos(math.pi / 6), 11.5
    deep = max(2 * flat - pitch, 0.0)  # overlap along x on the axis, the same up to half the corner's height
    top = corner * (1 - pitch / (4 * flat))  # where it ends
    overlap = 2 * deep * (corner / 2 + (top - corner / 2) / 2) if deep else 0.0
    found = evaluate(vary(GAST, {"array.pitch_mm": pitch}), ["span_mm", "covered_mm2"])
    assert found["span_mm"] == pytest.approx(5 * pitch + 2 * flat, rel=1e-12)
    area = 6 * 1.5 * math.sqrt(3) * corner**2
    assert found["covered_mm2"] == pytest.approx(area - 5 * overlap, rel=1e-9)  # shapely's union


def test_size_of_loops():
    found = evaluate(parse_design(LOOPS), ["span_mm", "board_area_mm2"])
    # the outline is half a trace wider than the centre line; the board is 2 mm wider than that on every side
    assert found["span_mm"] == pytest.approx(25 + 0.2, rel=1e-12)
    assert found["board_area_mm2"] == pytest.approx((25.2 + 4) * (12.2 + 4), rel=1e-12)


LIMITED = {  # all coils on the same layers, 0.5 mm apart, so that there is a clearance too
    "array.layers": [["L1", "L2"]], "array.pitch_mm": 16.5,
    "fab.max_layers": 4, "fab.max_outer_copper_um": 70, "fab.max_inner_copper_um": 35.5, "fab.max_aspect_ratio": 8,
    "fab.max_board_mm": [100, 60], "fab.blind_holes": False,
}  # fmt: skip


@pytest.fixture(scope="module")
def limited():
    return Evaluation(vary(STARTER, LIMITED))


@pytest.mark.parametrize("rule", LENGTH_RULES)
def test_margin_of_every_rule(limited, rule):
    listed = [m for m in check_rules(limited.design.array, limited.design.rules) if m.rule == rule]
    assert listed
    found = request(f"fab_margin_mm[{rule}]").value(limited)
    assert found == pytest.approx(min(m.margin for m in listed) * 1e3, rel=1e-12)


def test_margins_of_lengths_and_of_all_rules(limited):
    margins = limited.margins
    assert {m.rule for m in margins if m.unit == "m"} == set(LENGTH_RULES)
    assert request("fab_margin_mm").value(limited) == min(m.margin for m in margins if m.unit == "m") * 1e3
    assert request("fab_broken").value(limited) == 0
    broken = evaluate(vary(STARTER, {"fab.min_trace_mm": 0.17, "fab.max_layers": 2}), ["fab_broken", "fab_margin_mm"])
    # every coil's trace, 0.15 mm, on its two layers, and the board's four layers
    assert broken["fab_broken"] == 3 * 2 + 1
    assert broken["fab_margin_mm"] == pytest.approx(-0.02, abs=1e-12)


def test_a_distance_that_is_too_far_to_be_measured_counts_as_nine_limits():
    assert FARTHEST == _HORIZON - 1
    far = vary(STARTER, {"array.pitch_mm": 40.0})
    assert not [m for m in check_rules(far.array, far.rules) if m.rule == "clearance"]
    assert value(far, "fab_margin_mm[clearance]") == pytest.approx(9 * 0.1)
    near = vary(STARTER, {"array.pitch_mm": 40.0, "fab.min_gap_mm": 0.01})
    assert value(near, "fab_margin_mm[clearance]") == pytest.approx(9 * 0.01)


def test_coupling_of_loops():
    loops = parse_design(LOOPS)
    a, b, c = loops.array.conductors()
    L = self_inductance([a, b, c])
    k_ab, k_ac, k_bc = (
        mutual_inductance([p], [q])[0, 0] / math.sqrt(L[i] * L[j])
        for p, q, i, j in ((a, b, 0, 1), (a, c, 0, 2), (b, c, 1, 2))
    )
    found = evaluate(loops, ["k[a,b]", "k[b,a]", "k[c,a]", "rms_k", "worst_k", "inductance_uH[b]"])
    assert k_ab > 0 > k_ac  # overlapping, and side by side
    # the same kernels on the same paths: what differs is the order of sums
    assert found["k[a,b]"] == found["k[b,a]"] == pytest.approx(k_ab, rel=1e-9)
    assert found["k[c,a]"] == pytest.approx(k_ac, rel=1e-9)
    assert found["rms_k"] == pytest.approx(math.sqrt((k_ab**2 + k_ac**2 + k_bc**2) / 3), rel=1e-9)
    assert found["worst_k"] == pytest.approx(max(map(abs, (k_ab, k_ac, k_bc))), rel=1e-9)
    assert found["inductance_uH[b]"] == pytest.approx(L[1] * 1e6, rel=1e-9)


@pytest.mark.slow
def test_sheets_count_and_screening_is_as_good_as_it_says():
    asked = ["inductance_uH[coil1]", "k[coil1,coil2]", "k[coil1,coil3]", "worst_k"]
    full, screened = evaluate(STARTER, asked), evaluate(STARTER, asked, accuracy="screen")
    bare = evaluate(vary(STARTER, {"elastomer.1.relative_permeability": 1.0}), asked)
    assert full["inductance_uH[coil1]"] > 1.01 * bare["inductance_uH[coil1]"]
    for key in asked[1:]:
        assert abs(screened[key] - full[key]) < 5e-5  # as `coilarray.electromagnetics.inductance.Accuracy` says
    assert screened[asked[0]] == pytest.approx(full[asked[0]], rel=1e-4)
    assert screened != full


ALONE = {"array.columns": 1, "indentation.origin": "coil1"}
NO_RESONANCE = {"circuit.short_resistance_ohm": 1e9, "circuit.capacitance_pF": 1e12}
SAMPLE = {"indentation.sample_x_mm": [-15, 15], "indentation.sample_y_mm": [-20, 20]}


@pytest.mark.parametrize(("changes", "asked", "message"), [
    ({}, "fab_margin_mm[board size]", "the rules of starter do not limit its board size"),
    (ALONE, "rms_k", "the design starter has only one coil"),
    (ALONE, "worst_k", "the design starter has only one coil"),
    pytest.param(NO_RESONANCE, "q", "resonance", marks=pytest.mark.slow),
    ({**SAMPLE, "indentation.sample_x_mm": [-9, 9]}, "peak_delta[coil3]",
     "the indenter at x = 11 mm is outside the sample of starter"),
    ({**SAMPLE, "indentation.sample_x_mm": [-1, 1]}, "peak_delta", "the sample of starter leaves no room"),
])  # fmt: skip
def test_what_a_design_does_not_have_is_one_line(changes, asked, message):
    with pytest.raises(CoilarrayError, match=f"^.*{message}.*$"):
        value(vary(STARTER, changes), asked)


@pytest.fixture(scope="module")
def true():
    """What the tests of the starter's true circuit and response share."""
    return Evaluation(STARTER)


@pytest.mark.slow
def test_circuit_is_that_of_the_scan(true):
    scan = scan_design(STARTER)
    inductance = ("effective_inductance_uH", "effective_inductance", 1e6)
    for name, variable, unit in (inductance, ("frequency_MHz", "frequency", 1e-6), ("q", "quality_factor", 1)):
        for coil in STARTER.array.names:
            expected = float(scan[variable].sel(state=coil)) * unit
            assert request(f"{name}[{coil}]").value(true) == pytest.approx(expected, rel=1e-9), (name, coil)
    assert request("q").value(true) == pytest.approx(float(scan.quality_factor.min()), rel=1e-9)
    ratio = scan.state_self_resonance / scan.frequency
    assert request("srf_margin").value(true) == pytest.approx(float(ratio.min()), rel=1e-9)
    assert request("srf_margin").value(true) > 1
    R_p = true.scan.parallel_resistance.values
    assert request("drive_margin").value(true) == pytest.approx(min((R_p / 1e3 - 1).min(), (1 - R_p / 100e3).min()))


@pytest.mark.parametrize("R_p", [300.0, 999.0, 1001.0, 33e3, 99e3, 101e3])
def test_drive_margin_is_positive_where_the_converter_may_drive(R_p):
    """Electrical characteristics of the data sheet; the other states are in the middle of the window."""
    of = Evaluation(STARTER)
    same = {"frequency": 2e6, "loaded_quality_factor": 30.0, "state_self_resonance": 9e6, "readable": True}
    states = {name: ("state", [number] * 3) for name, number in same.items()}
    vars(of)["scan"] = xr.Dataset({**states, "parallel_resistance": ("state", [10e3, R_p, 20e3])})
    margin = request("drive_margin").value(of)
    # the state of 20 kΩ is 1 − 20/100 from the upper end
    assert margin == pytest.approx(min(R_p / 1e3 - 1, 1 - R_p / 100e3, 1 - 20 / 100), rel=1e-12)


@pytest.fixture
def synthetic(monkeypatch):
    """Return a function that puts δ(points, states) in the place of the response; it lists the maps that were asked."""

    def replace(delta):
        calls = []

        def response_map_of(design, *, depths, x, y, **_):
            calls.append((depths, x, y))
            points = np.stack(np.meshgrid(depths, y, x, indexing="ij")[::-1], axis=-1)
            states = [state.name for state in design.plan]
            coords = {"depth": depths, "y": y, "x": x, "state": states}
            return xr.Dataset({"delta": (("depth", "y", "x", "state"), delta(points))}, coords)

        monkeypatch.setattr(evaluation, "response_map", response_map_of)
        return calls

    return replace


def hills(*coils):
    """Gaussians over ellipses (x, y, a, b, peak), growing with the depth."""

    def hill(points, x, y, a, b, peak):
        u, v = (points[..., 0] - x) / a, (points[..., 1] - y) / b
        return peak * points[..., 2] / 1e-3 * np.exp(-(u**2 + v**2) / 2)

    return lambda points: np.stack([hill(points, *coil) for coil in coils], axis=-1)


def test_peak_and_width_of_bells(synthetic):
    sigma = [4e-3, 5e-3, 6e-3]
    calls = synthetic(hills(*(((k - 1) * 11e-3, 0.0, sigma[k], 4e-3, (k + 1) * 1e-3) for k in range(3))))
    asked = [f"response_width_mm[coil{k}]" for k in (1, 2, 3)] + ["peak_delta[coil1]", "peak_delta[coil3,depth_mm=0.6]"]
    found = evaluate(STARTER, [*asked, "peak_delta"])
    fwhm = 2 * math.sqrt(2 * math.log(2))
    for k in range(3):  # the spline's error at eight steps in a thickness, far below the width
        assert found[asked[k]] == pytest.approx(fwhm * sigma[k] * 1e3, rel=1e-5)
    assert found["peak_delta[coil1]"] == pytest.approx(0.3e-3, rel=1e-5)  # the first depth of the design is 0.3 mm
    assert found["peak_delta[coil3,depth_mm=0.6]"] == pytest.approx(1.8e-3, rel=1e-5)
    # the middle of the array is the centre of coil 2
    assert found["peak_delta"] == pytest.approx(0.6e-3, rel=1e-5)
    assert len(calls) == 2  # one line of each depth serves all coils of the row


def even(points):
    return np.ones((*points.shape[:-1], 3))


WEAK = [((k - 1) * 11e-3, 0.0, 3e-3, 2e-3, 3e-4) for k in range(3)]


@pytest.mark.parametrize(("delta", "changes", "asked", "message"), [
    (lambda p: even(p) + 1e-3 * (p[..., :1] / 1e-2 - (p[..., :1] / 1e-2) ** 2), {}, "response_width_mm[coil2]",
     "δ of coil2 does not fall to half its peak on both sides"),
    (lambda p: 0 * even(p), {}, "response_width_mm[coil2]", "coil2 of starter has no response with a peak"),
    (hills(*WEAK), {}, "x0_distortion_mm[coil2]", "the map of starter has no ellipses between δ = 1e-4 and 1e-3"),
    (hills(*((y, x, *rest) for x, y, *rest in (WEAK[0], WEAK[2], WEAK[2]))),
     {"array.direction_deg": 90.0, "indentation.x_mm": [-14, 14], "indentation.y_mm": [-6, 6],
      "indentation.step_mm": 2.0, "indentation.origin": "coil2"}, "x0_distortion_mm",
     "no coil of starter is on the x axis of its map"),
    (lambda p: even(p) * p[..., 2:], {}, "position_error_mm", "the readings of starter do not determine the position"),
], ids=["even", "nothing", "weak", "beside the axis", "no position"])  # fmt: skip
def test_a_response_that_does_not_tell_the_quantity(synthetic, delta, changes, asked, message):
    synthetic(delta)
    with pytest.raises(GoalError, match=message):
        value(vary(STARTER, changes), asked)


@pytest.mark.slow
def test_x0_of_ellipses_that_are_beside_their_coils(synthetic):
    window = {"indentation.step_mm": 1.0, "indentation.x_mm": [-20, 20], "indentation.y_mm": [-6, 6]}
    shifts, fine = [-0.4e-3, 0.2e-3, 0.7e-3], vary(STARTER, window)
    calls = synthetic(hills(*(((k - 1) * 11e-3 + shifts[k], 0.0, 2.4e-3, 1.8e-3, 4.5e-3) for k in range(3))))
    found = evaluate(fine, ["x0_distortion_mm", *(f"x0_distortion_mm[coil{k}]" for k in (1, 2, 3))])
    # levels are bands of the refined map, whose points lie a little unevenly about the centre
    for k in range(3):
        assert found[f"x0_distortion_mm[coil{k + 1}]"] == pytest.approx(abs(shifts[k]) * 1e3, abs=0.01)
    assert found["x0_distortion_mm"] == found["x0_distortion_mm[coil3]"]
    assert len(calls) == 1
    # a smaller map leaves the outer coils out
    small = vary(fine, {"indentation.x_mm": [-8, 8]})
    assert value(small, "x0_distortion_mm") == pytest.approx(0.2, abs=0.01)
    with pytest.raises(CoilarrayError, match="the curves of coil1 do not close"):
        value(small, "x0_distortion_mm[coil1]")


ROW = [(-11e-3, 0.0), (0.0, 0.0), (11e-3, 0.0)]


def bound_by_differences(depth, region, noise):
    """Medians of σ_x and σ_h in mm from central differences of the bells themselves."""
    x_min, x_max, y_min, y_max = (edge * 1e-3 for edge in region)
    x, y = (low + (high - low) * (np.arange(n) + 0.5) / n for low, high, n in ((x_min, x_max, 40), (y_min, y_max, 20)))
    X, Y = np.meshgrid(x, y)
    at = np.stack([X, Y, np.full_like(X, depth * 1e-3)], axis=-1)
    J = np.stack([(bells(at + step, ROW) - bells(at - step, ROW)) / 2e-6 for step in 1e-6 * np.eye(3)], axis=-1)
    covariance = np.linalg.inv(J.swapaxes(-1, -2) @ J) * noise**2
    return [float(np.median(np.sqrt(covariance[..., k, k]))) * 1e3 for k in (0, 2)]


@pytest.mark.parametrize(("depth", "region", "noise"), [(0.6, [-12, 12, -6, 6], 1e-5), (0.9, [-4, 9, 1, 6], 3e-5)])
def test_position_error_of_bells(synthetic, depth, region, noise):
    calls = synthetic(lambda p: bells(p, ROW))
    options = {"region_mm": region, "depth_mm": depth, "noise": noise}
    found = evaluate(STARTER, [{"quantity": f"{what}_error_mm", **options} for what in ("position", "depth")])
    sigma = bound_by_differences(depth, region, noise)
    # the bells grow as h^1.6, which three depths and 0 tell to some 1e-3; widths of 7 mm are smooth against the table
    assert list(found.values()) == pytest.approx(sigma, rel=5e-3)
    assert len(calls) == 1
    beside = replace(STARTER, indentation=replace(STARTER.indentation, origin=None, origin_point=(5e-3, -1e-3)))
    moved = {**options, "region_mm": np.add(region, [5, 5, -1, -1]).tolist()}  # on the board
    again = value(beside, request({"quantity": "position_error_mm", **moved}).key)
    assert again == pytest.approx(next(iter(found.values())), rel=1e-9)
    double = evaluate(STARTER, [{"quantity": "position_error_mm", **options, "noise": 2 * noise}])
    assert next(iter(double.values())) == pytest.approx(2 * next(iter(found.values())), rel=1e-9)


def test_position_error_by_default_is_over_all_coils_at_the_first_depth(synthetic):
    synthetic(lambda p: bells(p, ROW))
    outline = 11 + 8  # mm: centre of the outer coil, and its apothem
    corner = 8 / math.cos(math.pi / 6)
    region = f"region_mm={-outline}:{outline}:{-corner!r}:{corner!r}"
    explicit = value(STARTER, f"position_error_mm[{region},depth_mm=0.3,noise=1e-5]")
    assert value(STARTER, "position_error_mm") == pytest.approx(explicit, rel=1e-6)


def test_the_window_stays_inside_the_sample():
    """A hemisphere of 2 mm touches within its radius; the sample ends short of the outer coils."""
    x_min, x_max, y_min, y_max = np.multiply(Evaluation(vary(STARTER, SAMPLE)).window(0.3e-3, beyond=4e-3), 1e3)
    reach = math.sqrt(2**2 - (2 - 4 * 0.3) ** 2)
    assert (x_min, x_max) == pytest.approx((-15 + reach, 15 - reach), rel=1e-9)
    corner = 8 / math.cos(math.pi / 6)
    assert (y_min, y_max) == pytest.approx((-corner - 4, corner + 4), rel=1e-9)


@pytest.mark.slow
def test_peak_is_the_response_at_the_place(true):
    x = [-11e-3, 0.0, 11e-3]
    screened = Imperfections(network=design_circuit(STARTER, accuracy=true.accuracy))
    at = response_map(STARTER, depths=[0.3e-3], x=x, y=[0.0], imperfections=screened)
    for k, name in enumerate(("coil1", "coil2", "coil3")):  # the spline along x at eight steps in a thickness
        found = request(f"peak_delta[{name}]").value(true)
        assert found == pytest.approx(float(at.delta[0, 0, k, k]), rel=1e-4)
    assert request("peak_delta").value(true) == pytest.approx(float(at.delta[0, 0, 1].max()), rel=1e-4)
    # within the coil of 16 mm, and about as wide as its mean turn
    assert 6 < request("response_width_mm[coil2]").value(true) < 16


@pytest.mark.slow
def test_position_error_against_a_finer_table():
    """About half the spacing and the six depths of `table_grid`; the mesh of the magnetic layer is coarse in both."""
    true, region = Evaluation(STARTER), (-3e-3, 3e-3, -2e-3, 2e-3)
    depths, _, _ = table_grid(STARTER, deepest=0.75e-3)
    x, y = np.linspace(-3e-3, 3e-3, 13), np.linspace(-2e-3, 2e-3, 9)
    asked = ("position_error_mm", "depth_error_mm")
    screened = Imperfections(network=design_circuit(STARTER, accuracy=true.accuracy))
    with coarse_maps(DEFAULT_MESH):
        table = response_map(STARTER, depths=depths, x=x, y=y, imperfections=screened)
        found = [request(f"{name}[region_mm=-3:3:-2:2,depth_mm=0.3]").value(true) for name in asked]
    places = [low + (high - low) * (np.arange(n) + 0.5) / n for low, high, n in ((*region[:2], 40), (*region[2:], 20))]
    two = identifiability(forward_model(table), 0.3e-3, x=places[0], y=places[1])
    # the accuracy that the module states: the contact's mesh follows the depths
    for value, sigma, rel in zip(found, (two.sigma_x, two.sigma_h), (1e-2, 3e-2), strict=True):
        assert value == pytest.approx(float(np.median(sigma)) * 1e3, rel=rel)


@pytest.mark.slow
def test_a_target_is_that_of_its_map_over_the_coil_or_where_it_is_asked():
    ball = Target(Ball(5e-3, MATERIALS["aluminium"]), (1e-3, 3e-3, 8e-3), (0.0,), (0.0,), origin_point=(2e-3, 0.0))
    design = replace(STARTER, target=ball)
    x, y = design.array.centres[1] - [2e-3, 0.0]
    over = target_map(design, distances=[1e-3, 3e-3, 8e-3], x=[x], y=[y]).isel(x=0, y=0).sel(state="coil2")
    asked = {
        "delta": (over.delta, 1.0), "inductance_uH": (over.effective_inductance, 1e6), "q": (over.quality_factor, 1.0),
        "resistance_ohm": (over.effective_resistance, 1.0), "frequency_MHz": (over.frequency, 1e-6),
        "parallel_resistance_kohm": (over.parallel_resistance, 1e-3),
    }  # fmt: skip
    near = evaluate(design, [f"target_{name}[coil2]" for name in asked])
    far = evaluate(design, [f"target_{name}[coil2,distance_mm=3]" for name in asked])
    for name, (values, scale) in asked.items():
        assert near[f"target_{name}[coil2]"] == pytest.approx(scale * float(values[0]), rel=1e-9)
        assert far[f"target_{name}[coil2,distance_mm=3]"] == pytest.approx(scale * float(values[1]), rel=1e-9)
    assert near["target_delta[coil2]"] < far["target_delta[coil2,distance_mm=3]"] < 0
    beside = value(design, "target_delta[coil2,x_mm=8,y_mm=-2]")  # on the board
    assert beside == pytest.approx(
        float(target_map(design, distances=[1e-3], x=[6e-3], y=[-2e-3]).delta[0, 0, 0, 1]), rel=1e-9
    )
    told = ranges_of(target_map(design, x=[x], y=[y]), 1e-4).isel(state=1)
    assert value(design, "target_range_mm[coil2,noise=0.0001]") == pytest.approx(float(told.range) * 1e3, rel=1e-9)
    deviation = value(design, "target_deviation_um[coil2,noise=0.0001,distance_mm=3]")
    assert deviation == pytest.approx(float(told.distance_deviation[1]) * 1e6, rel=1e-9)
    assert value(design, "parallel_resistance_kohm[coil2]") == pytest.approx(
        float(over.base_parallel_resistance) * 1e-3, rel=1e-9
    )
    for lacking, message in (
        (STARTER, r"the design starter has no \[target\]"),
        (
            replace(design, target=replace(ball, distances=(1e-3,))),
            "at least two distances of the target; starter has one",
        ),
    ):
        with pytest.raises(GoalError, match=message):
            value(lacking, "target_range_mm[coil2]")
