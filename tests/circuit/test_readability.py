"""What a converter can read: limits by their formulas, the drive of a path, and that what it cannot read helps nobody.

Who checks whom: the marks of maps against the numbers of SNOSCY9A written out here; amplitudes against V = 4 I R_p/π;
ranges and positions of a map against those of the same map without what no converter reads.
"""

import math
from concurrent.futures import Future
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr
from hypothesis import given, settings
from hypothesis import strategies as st
from support.command_line import successes
from support.refusals import refused

import coilarray as ca
from coilarray.circuit.converter_limits import (
    BROKEN,
    DRIVE_CURRENTS,
    broken_limit,
    check_channel,
    path_drives,
    reading_lines,
    shared_drive,
)  # fmt: skip
from coilarray.circuit.coupling import scan_design, sweep_design
from coilarray.circuit.network import Network, resonate, self_resonance_of
from coilarray.circuit.noise_budget import noise_budget
from coilarray.compute.workers import open_executor
from coilarray.design.model import parse_design
from coilarray.design.scan_states import ScanState, Switches
from coilarray.design.write import as_file
from coilarray.errors import DesignError, GoalError
from coilarray.geometry import Plate
from coilarray.localize.forward import forward_model
from coilarray.localize.identifiability import identifiability
from coilarray.localize.inverse import locate
from coilarray.report.response_tables import path_drive_table, range_table, target_table
from coilarray.report.sections import SECTIONS
from coilarray.report.summary import unread_words, verdicts
from coilarray.report.tables import converter_line, drive_table, limit_table, sigma_table
from coilarray.response.target import ranges_of, target_map
from coilarray.studies.create import broken_limits
from coilarray.studies.optimize.derive import derive_goal, keeping_rules
from coilarray.studies.optimize.goal import best_points
from coilarray.studies.quantities import evaluate
from coilarray.studies.sweep import parse_axis, plan_sweep, run_sweep
from coilarray.studies.tolerance import Spread, Tolerances, analyse
from coilarray.studies.tolerance.tolerances import Limit

STEEL = ca.MATERIALS["steel"]
PROBE = """
schema = 1
name = "probe"
[stackup]
layers = ["L1", "L2", "L3", "L4"]
copper_thickness_um = [35, 35, 35, 35]
dielectric_thickness_mm = [0.2, 1.1, 0.2]
dielectric_epsilon_r = [4.5, 4.5, 4.5]
[coils.c]
shape = "circle"
outer_diameter_mm = 20
turns_per_layer = 6
winding_layers = 2
trace_width_mm = 0.2
gap_mm = 0.2
[coils.c.via]
drill_mm = 0.3
pad_mm = 0.6
plating_um = 25
[array]
lattice = "single"
coil = "c"
layers = [["L1", "L2"]]
[board]
margin_mm = 2.0
[target]
shape = "plate"
thickness_mm = 2
material = "steel"
distances_mm = [0.5, 1, 2, 4]
"""
FREE_CURRENT = 110e-6  # A, code 13 of table 42 for 8.57 to 13.0 kΩ


def within(current, R_p):
    """Whether 4 I R_p/π is within 1.2 to 1.8 V, and as far beyond as the rows of table 42 go by their rounding."""
    return 0.99 * 1.2 <= 4 / math.pi * current * R_p <= 1.02 * 1.8


@pytest.fixture(scope="module")
def probe():
    return parse_design(PROBE)


@pytest.fixture(scope="module")
def mapped(probe):
    return target_map(probe, accuracy="screen")


@given(
    f=st.floats(1e2, 1e8), R_p=st.floats(10.0, 1e6), Q=st.floats(0.1, 500.0),
    code=st.one_of(st.none(), st.integers(0, 31)),
)  # fmt: skip
def test_the_decision_is_that_of_all_limits_of_a_channel(f, R_p, Q, code):
    kept = {limit.name.partition(" ")[0]: limit.kept for limit in check_channel(f, R_p, Q, code=code)}
    decides = ("R_p", "amplitude", "quality")
    readable = all(kept.get(name, True) for name in decides) and 1e3 <= f <= 10e6
    assert (broken_limit(f, R_p, Q, code) == 0) == readable
    if code is not None and readable:
        assert within(DRIVE_CURRENTS[code], R_p)


def test_the_first_broken_limit_is_named():
    f, R_p = [2e6, 11.3e6, 500.0, 2e6, 2e6, 2e6], [8e3, 8e3, 8e3, 512.0, 95e3, 8e3]
    found = broken_limit(f, R_p, [30.0, 30.0, 30.0, 30.0, 30.0, 0.5])
    assert [BROKEN[k] for k in found] == ["none", "frequency", "frequency", "R_p", "amplitude", "Q"]


@given(st.lists(st.floats(500.0, 100e3), min_size=1, max_size=8))
def test_the_drive_of_a_path_reads_the_most(R_p):
    values = np.array(R_p)
    f, Q = np.full(len(values), 2e6), np.full(len(values), 30.0)
    counts = [sum(R >= 1e3 and within(current, R) for R in R_p) for current in DRIVE_CURRENTS]
    code = shared_drive(f, values, Q)
    assert (code == -1) == (max(counts) == 0)
    if code >= 0:
        assert counts[code] == max(counts)


@pytest.mark.slow
def test_the_rows_of_a_steel_plate_above_a_coil(probe, mapped):
    """Case of a probe: R_p falls from 12.7 kΩ to 0.5 kΩ, the frequency rises from 6.8 to 9.3 MHz."""
    at = mapped.isel(x=0, y=0, state=0)
    R_p, f = at.parallel_resistance.values, at.frequency.values
    assert R_p[[0, 2]] == pytest.approx([512, 1890], rel=0.02)  # as known of this plate to a percent
    assert at.readable.values.tolist() == [False, False, True, True] == ((R_p >= 1e3) & (f <= 10e6)).tolist()
    assert [BROKEN[k] for k in at.broken_limit.values] == ["R_p", "R_p", "none", "none"]
    assert int(at.drive_code) == 13
    np.testing.assert_allclose(at.amplitude, 4 / math.pi * FREE_CURRENT * R_p, rtol=1e-12)
    assert at.amplitude.values[[0, 2]] == pytest.approx([0.072, 0.265], rel=0.02)
    # resolutions begin where the converter reads, and no code reads both distances and the coil alone
    assert np.isnan(at.distance_deviation.values).tolist() == [True, True, False, False]
    assert float(at.nearest_readable) == 2e-3
    (path,) = path_drives(mapped)
    assert (path.code, path.kept, path.read + path.alone, path.positions) == (13, False, 1, 4)
    path_of = (*R_p[2:].tolist(), float(at.base_parallel_resistance))
    served = [sum(within(current, R) for R in path_of) for current in DRIVE_CURRENTS]
    assert max(served) == served[path.path_code] == 1
    said = " ".join(reading_lines(mapped))
    assert "cannot read 2 of 4 values" in said
    assert "IDRIVE 13" in said
    table = {row["distance_m"]: row for row in target_table(mapped).records()}
    assert [table[d]["readable"] for d in probe.target.distances] == [False, False, True, True]
    assert [table[d]["path_readable"] for d in probe.target.distances] == at.path_readable.values.tolist()
    assert [table[d]["distance_deviation_m"] == "" for d in probe.target.distances] == [True, True, False, False]
    (row,) = range_table(mapped).records()
    assert (row["nearest_readable_m"], row["range_m"]) == (2e-3, 4e-3)
    (drive,) = path_drive_table(mapped).records()
    assert (drive["drive_code"], drive["read"], drive["positions"]) == ("13", str(path.read), "4")
    assert drive["alone"] is path.alone
    assert any("R_p is 0.51" in line for line in verdicts(None, (), mapped))


@pytest.mark.slow
def test_a_plate_that_stays_breaks_the_same_limit_as_a_target(probe, mapped):
    beside = replace(probe, target=None, plates=(Plate("bed", 0.5e-3, 2e-3, STEEL),))
    scan = scan_design(beside, elastomer=False, accuracy="screen")
    there = mapped.isel(distance=0, x=0, y=0)
    # the mean band of each circuit differs, in which the losses of the copper are interpolated
    assert float(scan.parallel_resistance[0]) == pytest.approx(float(there.parallel_resistance[0]), rel=1e-3)
    assert int(scan.broken_limit[0]) == int(there.broken_limit[0]) == BROKEN.index("R_p")
    assert [limit.name for _, limit in broken_limits(scan)] == ["R_p (Ω)"]


@pytest.mark.slow
def test_a_row_of_coils_under_a_disc_is_not_read_above_10_megahertz():
    """Square coils of 12 mm, 100 pF, under a steel disc: at 0.2 mm a coil oscillates above 10 MHz."""
    text = (
        PROBE.partition("[coils.c]")[0]
        .replace("35, 35, 35, 35", "35, 35")
        .replace('"L1", "L2", "L3", "L4"', '"L1", "L2"')
        .replace("0.2, 1.1, 0.2", "1.53")
        .replace("4.5, 4.5, 4.5", "4.5")
    )
    design = parse_design(
        text
        + """
[coils.square]
shape = "polygon"
sides = 4
outer_across_flats_mm = 12
turns_per_layer = 10
winding_layers = 2
trace_width_mm = 0.1524
gap_mm = 0.17
first_corner_deg = 45
[coils.square.via]
drill_mm = 0.254
pad_mm = 0.55
plating_um = 25
[array]
lattice = "linear"
columns = 2
coil = "square"
pitch_mm = 15
layers = [["L1", "L2"]]
[board]
margin_mm = 2
[target]
shape = "disc"
diameter_mm = 11
thickness_mm = 0.3
material = "stainless_steel"
distances_mm = [0.2, 0.5, 1, 2]
[circuit]
capacitance_pF = 100
"""
    )
    found = target_map(design, x=[-7.5e-3], y=[0.0], accuracy=0.5)
    at = found.isel(x=0, y=0)
    assert float(at.frequency[0, 0]) > 10e6
    over = (at.frequency > 10e6) | (at.parallel_resistance < 1e3)
    np.testing.assert_array_equal(at.readable, ~over)
    assert int(at.broken_limit[0, 0]) == BROKEN.index("frequency")
    assert at.readable[:, 1].all()  # the other coil is far away
    assert any("sensor frequency" in line for line in verdicts(None, (), found))
    assert not bool(np.isfinite(found.distance_deviation[0, 0]))


def test_without_a_converter_nothing_is_marked(probe):
    design = replace(probe, readout=replace(probe.readout, converter="none"), target=None)
    scan = scan_design(design, elastomer=False, accuracy="screen")
    assert "readable" not in scan
    assert broken_limits(scan) == verdicts(scan, ()) == []
    assert limit_table(scan).rows == ()


@pytest.mark.slow
def test_quantities_of_what_no_converter_reads_are_marked_or_refused(probe):
    near = evaluate(probe, ["target_frequency_MHz[coil1]", "converter_unread"], accuracy="screen")
    assert near["converter_unread"] == 1.0  # 0.5 mm by default
    with pytest.raises(GoalError, match="does not read coil1"):
        evaluate(probe, ["target_deviation_um[coil1]"], accuracy="screen")


def with_tank(capacitance):
    """The coil alone: with 51.2 pF it oscillates at 10 MHz, with less above, and from 2.5 nF on R_p is below 1 kΩ."""
    return parse_design(f"{PROBE.partition('[target]')[0]}[circuit]\ncapacitance_pF = {capacitance}\n")


@pytest.mark.slow
@pytest.mark.parametrize("capacitance", [20, 60, 3300])
def test_the_words_about_a_board_say_what_its_scan_says(capacitance):
    design = with_tank(capacitance)
    whole = scan_design(design, elastomer=False, accuracy="screen")
    words, read = unread_words(design), bool(whole.readable.all())
    assert words == "" if read else words.startswith("The converter cannot read coil1: ")
    assert noise_budget(design).unread == (() if read else ("coil1",))
    marked = [row[-1] for row in sigma_table(noise_budget(design)).rows]
    assert marked == ([float(noise_budget(design).sigma[0])] if read else [False])
    (drive,) = drive_table(whole).rows
    assert (drive[1] == "none fits") == (not 1e3 <= float(whole.parallel_resistance[0]) <= 100e3)


def test_a_self_resonance_counts_where_it_is_near():
    """A coil of 10 µH, 100 pF across it and 1 nF as tank: its self-resonance is √11 times its resonance, without R."""
    none, L = np.zeros((1, 1)), np.array([[10e-6]])
    coil = Network(
        ("a",), L, lambda f: np.array([[0.1]]), np.array([100e-12]), none, Switches(0.0, tank_capacitance=1e-9)
    )
    at = resonate(coil, ScanState("a", (("a", 1),)))
    ratio = math.sqrt(11)
    assert self_resonance_of(coil, at) / at.frequency == pytest.approx(ratio, rel=1e-5)  # by R, 1e-6


def test_goals_of_what_is_read_ask_for_a_converter_that_reads_it():
    design = with_tank(60)
    free = replace(design, readout=replace(design.readout, converter="none"))

    def bounds(wish, of):
        axes = [parse_axis("circuit.capacitance_pF=20:80:4")]
        return [one.wish for one in keeping_rules(derive_goal([wish], of, axes).goal, of).constraints]

    assert "converter_unread ≤ 0" in bounds("maximize frequency_MHz[coil1]", design)
    assert "converter_unread ≤ 0" not in bounds("maximize frequency_MHz[coil1]", free)
    assert "converter_unread ≤ 0" not in bounds("maximize inductance_uH[coil1]", design)
    assert bounds("minimize converter_unread", design) == bounds("minimize converter_unread", free)


@pytest.mark.slow
def test_what_no_converter_reads_is_never_the_best_point_of_a_sweep():
    axis, wish = parse_axis("circuit.capacitance_pF=20,60,100"), "maximize frequency_MHz[coil1]"
    file = as_file(with_tank(60))
    goal = derive_goal([wish], file, [axis]).goal
    plan = plan_sweep(file, [axis], goal.quantities, accuracy="screen")
    with open_executor() as pool:
        (best,) = best_points(plan, run_sweep(plan, pool), goal)
    assert best.changes == {"circuit.capacitance_pF": 60}  # 20 pF make 14.7 MHz


@pytest.mark.slow
def test_drawn_boards_that_no_converter_reads_are_bad():
    errors = Tolerances(
        {"etch": Spread(board=10e-6)},
        limits=(Limit("frequency_MHz[coil1]", at_least=1.0), Limit("inductance_uH[coil1]", 1.0)),
    )
    found = analyse(with_tank(51.2), errors, samples=8)
    share = float((found.value.sel(output="frequency_MHz[coil1]") <= 10.0).mean())  # of the boards
    assert 0.0 < share < 1.0
    np.testing.assert_array_equal(found.sample_yield, [share, 1.0, share])


SIZES = st.floats(1e-6, 0.5)


@settings(max_examples=40)
@given(data=st.data())
def test_what_no_converter_reads_never_improves_a_range(data):
    """Distances and places in which nothing is read, of any δ, leave every range and resolution as it is."""
    n, places = data.draw(st.integers(2, 5)), data.draw(st.integers(1, 3))
    d = 1e-3 * np.cumsum(data.draw(st.lists(st.floats(0.2, 2.0), min_size=n, max_size=n)))
    delta = -np.array(data.draw(st.lists(SIZES, min_size=n * places, max_size=n * places))).reshape(n, 1, places, 1)
    noise = data.draw(st.floats(1e-6, 1e-4))

    def made(distances, values, readable):
        over = ("distance", "y", "x", "state")
        coords = {"distance": distances, "y": [0.0], "x": 1e-3 * np.arange(values.shape[2]), "state": ["a"]}
        return ranges_of(xr.Dataset({"delta": (over, values), "readable": (over, readable)}, coords), noise)

    alone = made(d, delta, np.ones_like(delta, dtype=bool))
    nearer, beside = (-data.draw(SIZES) for _ in range(2))
    wide = np.concatenate((delta, np.full((n, 1, 1, 1), beside)), axis=2)
    wide = np.concatenate((np.full((1, 1, places + 1, 1), nearer), wide))
    readable = np.zeros(wide.shape, dtype=bool)
    readable[1:, :, :places] = True
    more = made(np.append(d[0] / 2, d), wide, readable)
    np.testing.assert_array_equal(more.distance_deviation[1:], alone.distance_deviation)
    for name in ("range", "resolved_distance", "best_x", "range_is_least", "resolved_is_least"):
        np.testing.assert_array_equal(more[name], alone[name])
    assert bool(np.isnan(more.distance_deviation[0]).all())


def bells(unread):
    """Response of four coils to a target at 1 mm, of which `unread` (y, x, state) cannot be read."""
    axis, d = np.linspace(-10e-3, 10e-3, 9), np.array([0.5e-3, 1e-3, 2e-3, 3e-3])
    far = [
        np.hypot(axis - x, axis[:, None] - y) / 8e-3 for x, y in ((-6e-3, -3e-3), (6e-3, -3e-3), (0, 5e-3), (0, -6e-3))
    ]
    delta = -0.1 * np.exp(-d / 2e-3)[:, None, None, None] * np.exp(-(np.stack(far, axis=-1) ** 2))
    over = ("distance", "y", "x", "state")
    values = {"delta": (over, delta), "readable": (over, np.broadcast_to(~unread, delta.shape))}
    return xr.Dataset(values, {"distance": d, "y": axis, "x": axis, "state": ["a", "b", "c", "d"]}, {"noise": 1e-5})


@settings(max_examples=25)
@given(st.lists(st.tuples(st.integers(0, 8), st.integers(0, 8), st.integers(0, 3)), min_size=1, max_size=60))
def test_what_no_converter_reads_never_improves_a_position(places):
    unread = np.zeros((9, 9, 4), dtype=bool)
    for row, column, state in places:
        unread[row, column, state] = True
    all_read, some = (identifiability(forward_model(bells(mask)), 1e-3) for mask in (np.zeros_like(unread), unread))
    for name in ("sigma_x", "sigma_y", "sigma_h"):
        assert (some[name].values >= all_read[name].values * (1 - 1e-9)).all()  # rounding of the inverse
        np.testing.assert_array_equal(some[name].values[~unread.any(-1)], all_read[name].values[~unread.any(-1)])


def test_a_located_target_says_what_is_not_read_there():
    unread = np.zeros((9, 9, 4), dtype=bool)
    unread[:, 5:, 1] = True
    model = forward_model(bells(unread))
    point = np.array([6e-3, 1e-3, 1e-3])
    there, clear = (
        locate(forward_model(bells(mask)), model.delta(point)).best for mask in (unread, np.zeros_like(unread))
    )
    assert (there.unread, clear.unread) == (("b",), ())
    assert (there.deviations > clear.deviations).all()
    assert "cannot read b there" in repr(locate(model, model.delta(point)))
    left = locate(model, model.delta([-6e-3, 1e-3, 1e-3])).best
    assert left.unread == ()


@pytest.mark.parametrize("value", [True, "LDC1101"])
def test_another_converter_is_refused(value):
    design = ca.load_design_file("gast2020")
    refused(DesignError, r"readout\.converter .*none.* got", ca.vary, design, {"readout.converter": value})
    refused(DesignError, r"LDC1614, .*none; got", ca.Readout, converter=value)


@pytest.mark.slow
@pytest.mark.parametrize("command", [["check"], ["impedance", "--noise"], ["target", "--distance-mm", "4"]])
def test_commands_say_that_no_converter_is_set(capsys, tmp_path, monkeypatch, command):
    monkeypatch.chdir(tmp_path)
    free = ca.vary(ca.load_design_file("proximity"), {"readout.converter": "none"})
    ca.save_design(free, "free.toml")
    good, _ = successes(command[0], "free.toml")
    words = " ".join(good(capsys, *command[1:]).split())
    assert converter_line(free) in words
    assert "cannot read" not in words


@pytest.mark.slow
def test_without_a_converter_every_place_says_so():
    """No limit, drive or verdict of a converter, and one line that tells why."""
    design = ca.load_design("gast2020")
    free = ca.vary(design, {"readout.converter": "none"})
    assert free.digest != design.digest
    words = converter_line(free)
    assert 'readout.converter = "none"' in words
    assert converter_line(design) == ""
    scan = scan_design(free, elastomer=False)
    assert verdicts(scan, ()) == []
    assert not limit_table(scan).rows
    assert not drive_table(scan).rows
    circuit = SECTIONS["Circuit"](_results(free, scan))
    assert any(words in block for block in circuit.blocks if isinstance(block, str))
    assert not any("LDC" in block or "oscillates" in block for block in circuit.blocks if isinstance(block, str))
    refused(GoalError, 'readout.converter = "none"', evaluate, free, ["drive_margin"])


def _results(design, scan):
    """What the section of the circuit takes of a report."""
    sweep = sweep_design(design, [1e6, 2e6])
    circuit: Future = Future()
    circuit.set_result((scan, sweep))
    coupling: Future = Future()
    coupling.set_result(ca.couple_design(design))
    plot = lambda *arguments, **options: ""  # noqa: E731 - a picture that is not drawn
    words = {"active": "coil3", "strays": "strays", "beside_q": "", "close_states": [], "several": True, "plot": plot}
    return SimpleNamespace(design=design, scan=scan, circuit=circuit, coupling=coupling, **words)
