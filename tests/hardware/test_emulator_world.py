"""The physics behind the emulated switches against the package's own: scan, response map, drift.

Who checks whom: an untouched board against `scan_design`; a pressed one against `response_map`, which solves every
position that the emulator interpolates; temperature against the formula of a tank with losses.
"""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from support.contacts import linear
from support.emulated_reader import reader_of, settings_of

from coilarray import load_design
from coilarray.circuit.coupling import scan_design
from coilarray.circuit.network import Network
from coilarray.compute.store import Store
from coilarray.design.bundled import read
from coilarray.design.model import parse_design
from coilarray.design.scan_states import ScanState, Switches, paper_plan
from coilarray.errors import HardwareError
from coilarray.hardware.emulator.board import (
    LIFTED,
    Conditions,
    EmulatedBoard,
    Place,
    VirtualClock,
    emulated_board,
)
from coilarray.hardware.emulator.sensor_world import SensorWorld, response_table, table_axes
from coilarray.hardware.scan.readings import read_scan
from coilarray.hardware.scan.settings import board_network
from coilarray.hardware.scan.wiring import load_wiring
from coilarray.response.map import Imperfections, response_map

pytestmark = pytest.mark.slow

PAPER = linear(load_design("gast2020"))
WIRING = load_wiring()
FIRST = ScanState("coil1", (("coil1", 1),))
SETTINGS = settings_of(WIRING, drives=7, clock=43.4e6)  # 46 µA: 1.6 V at 27 kΩ
# within a coil, at the spacing of the whole table
DEPTH = table_axes(PAPER)[0]
X, Y = 1.2e-3 * np.arange(-3, 4), 1.2e-3 * np.arange(-2, 3)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("kept")


@pytest.fixture(scope="module")
def network(folder):
    return board_network(PAPER)


@pytest.fixture(scope="module")
def table(folder):
    return response_table(PAPER, Store(folder), (DEPTH, Y, X))


@pytest.fixture(scope="module")
def make(network, table):
    """A board of the paper's design, with a small table."""

    def board(*, start=25.0, noise=0.0, seed=0, **world):
        options = {"conditions": Conditions(start=start, noise=noise), "seed": seed}
        world = SensorWorld(network, lambda: table, PAPER.indentation.origin_point, **world)
        return EmulatedBoard(WIRING, world, clock=VirtualClock(), strict=True, **options)

    return board


def frequencies(board):
    """Frequencies in Hz of six coils in turn at full resolution, all of them good."""
    reader = reader_of(board)
    reader.configure(SETTINGS)
    readings = read_scan(reader.scan(), SETTINGS, 120e-12)
    reader.rest()
    assert readings.verdict == "good"
    return np.array([state.frequency for state in readings.states])


STEP = 21.7e6 / 2**28  # of the code in Hz


@pytest.fixture(scope="module")
def scanned():
    return scan_design(PAPER, elastomer=False)


def test_the_tank_and_the_readings_of_an_untouched_board_are_those_of_the_scan(network, table, make, scanned):
    world = SensorWorld(network, lambda: table)
    for state in PAPER.plan:
        tank, expected = world.resonator(state, LIFTED, 25.0), scanned.sel(state=state.name)
        # the same functions on the same numbers, kept as float64
        assert tank.frequency == pytest.approx(float(expected.frequency), rel=1e-12)
        assert tank.parallel_resistance == pytest.approx(float(expected.parallel_resistance), rel=1e-9)
        assert tank.quality_factor == pytest.approx(float(expected.loaded_quality_factor), rel=1e-6)
    read = frequencies(make())
    assert np.abs(read - scanned.frequency.values).max() <= 0.5001 * STEP  # rounding to a code


@pytest.fixture(scope="module")
def mapped(network):
    """The response map at positions between those of the table, in depths of 0.3 and 1 mm."""
    random = np.random.default_rng(2)
    x, y = (np.sort(random.uniform(axis[1], axis[-2], n)) for axis, n in ((X, 5), (Y, 3)))
    return response_map(PAPER, depths=[0.3e-3, 1.0e-3], x=x, y=y, imperfections=Imperfections(network=network))


def test_a_pressed_board_reads_what_the_response_map_says(make, network, mapped):
    # where both have the same changes of inductance what is left is half a code in each of two frequencies, of which L
    # has twice the relative error
    h, y, x = mapped.depth.values, mapped.y.values, mapped.x.values
    places = ((2, 1, 0), (0, 2, 1))
    pressed = {Place(x[i], y[j], h[k]): mapped.isel(x=i, y=j, depth=k) for i, j, k in places}
    exact = SimpleNamespace(outside=lambda at: None, values_at=lambda at: pressed[Place(*at)].inductance_change.values)
    board = make()
    untouched = frequencies(board)
    board.world = SensorWorld(network, lambda: exact)
    for place, expected in pressed.items():
        board.indenter.press(*place)
        delta = (untouched / frequencies(board)) ** 2 - 1
        assert np.abs(delta - expected.delta.values).max() < 2.01 * STEP / untouched.min()
    board.indenter.lift()
    assert np.array_equal(frequencies(board), untouched)


def test_between_the_positions_of_the_table_it_is_as_wrong_as_stated(table, mapped):
    L = mapped.inductance.values.max()
    x, y, depths = mapped.x.values, mapped.y.values, mapped.depth.values
    got = np.array([[[table.values_at(np.array([a, b, h])) for a in x] for b in y] for h in depths])
    error = np.abs(got - mapped.inductance_change.values) / L
    # Most comes from the solver itself, whose rule for the wavenumbers depends on the positions: 1e-3 of the change of
    # upper coils. Stated for 1 mm where L changes by 8e-4, and in proportion: 4e-7 (root of the mean square of the
    # diagonal) and 4e-6
    larger = np.abs(mapped.inductance_change.values[1]).max() / L / 8e-4
    assert np.sqrt(np.mean(np.diagonal(error[1], axis1=-2, axis2=-1) ** 2)) < 4e-7 * larger
    assert error[1].max() < 4e-6 * larger
    assert error[0].max() < 1.5e-6 * larger
    assert larger > 1


def test_the_whole_table_reaches_over_all_coils_and_the_design_s_own_map():
    depth, y, x = table_axes(PAPER)
    assert max(np.diff(x).max(), np.diff(y).max()) <= 1.2e-3
    assert (x[0], x[-1], y[0], y[-1], depth[-1]) == pytest.approx((-26e-3, 66e-3, -14e-3, 14e-3, 1.7e-3))
    # the coils reach further than a map of the paper's window
    window = read("gast2020").replace("x_mm = [-26, 66]", "x_mm = [-26, 26]")
    window = window.replace("y_mm = [-14, 14]", "y_mm = [-6, 6]")
    depth, y, x = table_axes(parse_design(window))
    right, high = 53.12e-3 + 11.5e-3, 11.5e-3 / math.cos(math.pi / 6)
    assert (x[0], x[-1], y[0], y[-1], depth[-1]) == pytest.approx((-26e-3, right, -high, high, 1.7e-3))
    # a sample with edges is not left
    edges = 'sample_x_mm = [-30, 30]\nsample_y_mm = [-10, 10]\norigin = "coil2" '
    depth, y, x = table_axes(parse_design(window.replace('origin = "coil2" ', edges)))
    assert (x[0], x[-1], y[0], y[-1], depth[-1]) == pytest.approx((-26e-3, 26e-3, -6e-3, 6e-3, 1e-3))


@pytest.mark.parametrize(("place", "said"), [
    ((0.1, 0.0, 1e-3), "x of the emulated indenter must be -23.52 to -16.32 mm on the board; got 80.08 mm"),
    ((0.0, 0.1, 1e-3), "y of the emulated indenter"), ((0.0, 0.0, 2e-3), "depth .* must be 0 to 1.7 mm; got 2 mm"),
])  # fmt: skip
def test_places_that_the_table_does_not_reach(make, place, said):
    board = make()
    with pytest.raises(HardwareError, match=said):
        board.indenter.press(*place)
    board.indenter.press(place[0], place[1], 0.0)  # above, it may go anywhere
    assert board.place().depth == 0


def test_the_clock_s_temperature_appears_in_the_inductance(make):
    cold, warm = (frequencies(make(start=T, copper=0.0)) for T in (25.0, 45.0))
    slope = ((cold / warm) ** 2 - 1) / 20  # of the inductance
    assert slope == pytest.approx(-26e-6, rel=2e-3)  # two codes of 4e-8 in 20 K are 1e-8, less than a thousandth


def test_warm_copper_lowers_the_frequency():
    # one coil without strays: ω² = 1/LC − (R/L)², R_p = L/RC
    L, C, R, warmer = np.array([[50e-6]]), np.zeros((1, 1)), 20.0, 12.0
    alone = Network(("coil1",), L, lambda frequency: np.array([[R]]), C[0], C, Switches(tank_capacitance=120e-12))
    world = SensorWorld(alone, lambda: None)
    for temperature, r in ((25.0, R), (25.0 + warmer, R * (1 + 3.93e-3 * warmer))):
        tank = world.resonator(FIRST, LIFTED, temperature)
        omega = math.sqrt(1 / (50e-6 * 120e-12) - (r / 50e-6) ** 2)
        assert tank.frequency == pytest.approx(omega / (2 * math.pi), rel=1e-11)
        assert tank.parallel_resistance == pytest.approx(50e-6 / (r * 120e-12), rel=1e-6)
    damped = replace(alone, resistance=lambda frequency: np.array([[1e5]]))
    assert SensorWorld(damped, lambda: None).resonator(FIRST, LIFTED, 25.0) is None  # it cannot oscillate


def test_an_open_short_or_grounded_converter_has_no_tank_and_only_the_first_channel_is_wired(make, scanned):
    board = make()
    assert board.true_tank() is None
    for words in (b"\x11\x11\x11\x11\x11\x66", b"\x11\x11\x11\x11\x11\x23"):
        board.chain.shift(words)
        assert board.true_tank() is None
    board.chain.shift(WIRING.words(FIRST))
    assert board.sensor(0, 0.0).frequency == pytest.approx(float(scanned.frequency[0]), rel=1e-3)
    assert board.sensor(1, 0.0) is None


def test_circuit_and_table_are_computed_once(folder, table, network, monkeypatch):
    def never(*arguments, **options):
        raise AssertionError

    monkeypatch.setattr("coilarray.hardware.emulator.sensor_world.inductance_changes", never)
    again = board_network(PAPER)
    assert np.array_equal(again.inductance, network.inductance)
    assert np.array_equal(again.resistance(1.77e6), network.resistance(1.77e6))
    assert np.array_equal(response_table(PAPER, Store(folder), (DEPTH, Y, X)).spline.c, table.spline.c)
    softer = replace(PAPER, circuit=replace(PAPER.circuit, elastomer_permittivity=2.0))
    for other, axes in ((softer, (DEPTH, Y, X)), (PAPER, (DEPTH, Y, X + 1e-4))):
        with pytest.raises(AssertionError):
            response_table(other, Store(folder), axes)


def test_a_board_needs_the_coils_of_its_wiring_and_something_to_press_with(folder):
    with pytest.raises(HardwareError, match="the wiring has the coil 'coil4', the design starter only coil1"):
        emulated_board(load_design("starter"), WIRING, folder=folder)
    with pytest.raises(HardwareError, match=r"has no \[indenter\] and \[indentation\]"):
        table_axes(replace(PAPER, indentation=None))
    with pytest.raises(HardwareError, match="4 positions along x and y"):
        response_table(PAPER, Store(folder), (DEPTH, Y[:3], X))


def test_a_whole_board_from_a_design(folder, monkeypatch):
    made = []

    def small(design, where, progress, frequency):
        made.append(design)
        assert frequency is None  # without a material of the indenter
        return response_table(design, where, (DEPTH, Y, X))

    monkeypatch.setattr("coilarray.hardware.emulator.sensor_world.response_table", small)
    board = emulated_board(PAPER, WIRING, folder=folder, conditions=Conditions(noise=0.0), strict=True)
    board.chain.shift(WIRING.words(paper_plan(WIRING.coils)[1]))
    untouched = board.true_tank().frequency
    assert made == []  # only when something is pressed
    board.indenter.press(0.0, 0.0, 1e-3)
    assert (untouched / board.true_tank().frequency) ** 2 - 1 > 5e-4
    assert made == [PAPER]
