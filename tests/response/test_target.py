"""What a target does to the states of a scan: L, R, Q and f against closed forms, range and resolution, places.

Who checks whom: the map of one coil against the tank of R and L in series, with the solver's ΔL − jΔR/ω at its own
resonance; range and resolution against an exponential; a place against the map at that place.
"""

import math
from dataclasses import replace

import numpy as np
import pytest
import xarray as xr
from support.contacts import few_turns
from support.quick_coils import series_tank
from support.refusals import refused

import coilarray as ca
import coilarray.response.target as module
from coilarray.circuit.board_circuit import bare_network, board_circuit
from coilarray.circuit.coupling import design_circuit
from coilarray.circuit.network import changed_resonances, resonate, solve_state
from coilarray.compute.store import Store
from coilarray.design.model import parse_design
from coilarray.errors import GeometryError, LocalizeError, MetalError
from coilarray.localize.forward import forward_model
from coilarray.localize.inverse import locate
from coilarray.metal.ball import ball_inductance
from coilarray.metal.finite_plates import PlateError
from coilarray.metal.flat_plates import plate_inductance
from coilarray.response.dataset import over_depth
from coilarray.response.target import STEPS, ranges_of, target_map

ALUMINIUM = ca.MATERIALS["aluminium"]
ONE = replace(
    parse_design(few_turns("gast_fem")), sheets=(), indentation=None,
    target=ca.Target(ca.Ball(5e-3, ALUMINIUM), (1e-3, 2e-3, 4e-3, 8e-3), (0.0, 5e-3), (0.0,)),
)  # fmt: skip


@pytest.fixture(scope="module")
def mapped():
    return target_map(ONE, network="ideal")


@pytest.mark.slow
def test_one_coil_is_the_tank_of_its_inductance_and_losses(mapped):
    """At every place the circuit is R and L in series across C, at the frequency at which it then oscillates."""
    network = design_circuit(ONE, ideal=True)
    L, R = network.inductance[0, 0], network.resistance(1.0)[0, 0] + ONE.circuit.short_resistance
    for k, distance in enumerate(ONE.target.distances):
        at = mapped.isel(distance=k, x=1, y=0, state=0)
        f = float(at.frequency)
        centre = [[5e-3, 0.0, ONE.target.height(0.0, distance)]]
        change = complex(ball_inductance(ONE.array, ONE.target.body, centre, [f])[0, 0, 0, 0])
        with_target, loss = L + change.real, R - 2 * math.pi * f * change.imag
        tank = series_tank(with_target, ONE.circuit.capacitance, loss)
        # between the frequencies of the map its change is interpolated to 1e-5
        assert f == pytest.approx(tank.frequency, rel=1e-5 * abs(change.real) / L + 1e-11)
        assert float(at.quality_factor) == pytest.approx(2 * math.pi * f * with_target / loss, rel=1e-6)
        assert float(at.effective_resistance) == pytest.approx(loss, rel=1e-6)
        assert float(at.parallel_resistance) == pytest.approx(with_target / (loss * ONE.circuit.capacitance), rel=1e-6)
        L_eff = 1 / ((2 * math.pi * f) ** 2 * ONE.circuit.capacitance)
        assert float(at.effective_inductance) == pytest.approx(L_eff, rel=1e-12)
        assert float(at.delta) == pytest.approx(L_eff / float(mapped.base_inductance[0]) - 1, rel=1e-9)
        assert float(at.matrix_frequency) == f
        assert float(at.inductance_change[0, 0]) == pytest.approx(change.real, rel=1e-5)
        assert float(at.resistance_change[0, 0]) == pytest.approx(loss - R, rel=1e-4)


@pytest.mark.slow
def test_a_near_target_has_the_resistance_at_its_own_frequency():
    """The resonance lies far from that without the target: the copper against `swept_circuit` around it."""
    design = replace(ONE, target=ca.Target(ca.Plate("target", 0.0, 1e-3, ALUMINIUM), (1e-3,)))
    found = target_map(design).isel(distance=0, x=0, y=0, state=0)
    f, base = float(found.frequency), resonate(design_circuit(design), design.plan[0])
    assert f > 1.2 * base.frequency
    assert float(found.base_quality_factor) == base.quality_factor
    network = board_circuit(design).swept(f * np.array([0.999, 1.001]))
    loss = network.resistance(f) + found.resistance_change.values
    beside = replace(
        network, inductance=network.inductance + found.inductance_change.values, resistance=lambda frequency: loss
    )
    there = solve_state(beside, design.plan[0], f)
    assert float(found.quality_factor) == pytest.approx(there.quality_factor, rel=1e-4)


@pytest.mark.slow
def test_a_target_far_away_does_nothing_and_a_nearer_one_more(mapped):
    delta = mapped.delta.isel(x=0, y=0, state=0).values
    assert (delta < 0).all()
    assert (np.diff(np.abs(delta)) < 0).all()
    far = target_map(ONE, distances=[0.5], x=[0.0], y=[0.0], network="ideal")
    assert abs(float(far.delta.squeeze())) < 1e-9
    assert float(far.quality_factor.squeeze()) == pytest.approx(float(far.base_quality_factor[0]), rel=1e-6)


@pytest.mark.parametrize("factor", [0.15, 0.6, 2.5])
def test_a_resonance_is_followed_through_any_change(factor):
    """A coil alone of any inductance and of losses that grow with frequency, against its closed form."""
    L, R, C = 10e-6, 2.0, 330e-12
    network = bare_network(("a",), np.array([[L]]), np.array([R]), ca.Switches(tank_capacitance=C))
    alone = resonate(network, ca.ScanState("a", (("a", 1),)))

    def changed(frequencies):
        loss = 1e-6 * frequencies  # Ω
        return (factor * L - 1j * loss / (2 * np.pi * frequencies))[:, None, None]

    f, impedance, admittance = changed_resonances(network, alone, changed, 1)
    tank = series_tank(factor * L, C, R + 1e-6 * float(f[0]))
    assert f[0] == pytest.approx(tank.frequency, rel=1e-10)
    assert impedance[0].imag == pytest.approx(2 * math.pi * f[0] * factor * L, rel=1e-9)
    assert 1 / admittance[0].real == pytest.approx(factor * L / ((R + 1e-6 * f[0]) * C), rel=1e-9)


def exponential(size, length, distances):
    """Made-up map of two states, δ = −size e^{−d/length}, the second of which is nearer at x = 1 mm."""
    d = np.asarray(distances)[:, None, None, None]
    delta = -size * np.exp(-d / length) * np.array([[1.0, 0.5], [0.5, 1.0]])[None, None]
    coords = {"distance": ("distance", distances), "y": [0.0], "x": [0.0, 1e-3], "state": ["a", "b"]}
    return xr.Dataset({"delta": (("distance", "y", "x", "state"), delta)}, coords)


def test_range_and_resolution_are_those_of_an_exponential():
    size, length, noise = 0.1, 2e-3, 1e-5
    distances = np.array([0.5, 1, 2, 4, 8, 16, 24]) * 1e-3
    found = ranges_of(exponential(size, length, distances), noise)
    assert found.best_x.values.tolist() == [0.0, 1e-3]
    # the crossings lie between 4001 distances of equal ratio, each by 1e-3: linear between them errs by 1e-6
    assert found.range.values == pytest.approx(length * math.log(size / (3 * noise)), rel=1e-6)
    expected = [length * math.log(size * step / (length * noise)) for step in STEPS]
    assert found.resolved_distance.values[:, 0] == pytest.approx(expected, rel=1e-6)
    deviation = noise * length / (size * np.exp(-distances / length))
    np.testing.assert_allclose(found.distance_deviation[:, 0], deviation, rtol=1e-9)
    assert not found.range_is_least.any()
    assert not found.resolved_is_least.any()
    near = ranges_of(exponential(size, length, np.array([0.5e-3, 1e-3])), noise)
    assert near.range_is_least.all()
    assert near.range.values == pytest.approx(1e-3)
    faint = ranges_of(exponential(1e-6, length, np.array([0.5e-3, 1e-3])), noise)
    assert np.isnan(faint.range).all()
    assert np.isnan(faint.resolved_distance).all()
    one = ranges_of(exponential(size, length, np.array([1e-3])), noise)
    assert np.isnan(one.distance_deviation).all()
    assert one.range_is_least.all()


def test_an_interrupted_map_goes_on(tmp_path, monkeypatch):
    """A disc over a magnetic sheet is solved at every distance by itself; a formula stands in for the solver here."""
    disc = ca.FinitePlate("disc", ca.Disc(5e-3), (0, 0, 0), 1e-3, ALUMINIUM)
    sheets = (ca.Sheet("magnetic", 1e-3, 2.0),)
    design = replace(ONE, sheets=sheets, target=replace(ONE.target, body=disc))
    asked = []

    def solver(source, target, places, distances, frequencies, *rest, **options):
        if options["fineness"] == 1:  # the band is of a coarser one
            asked.append(distances)
        if len(asked) == 3:
            raise KeyboardInterrupt
        size = -1e-6 * np.exp(-np.array(distances) / 1e-3)
        change = size[:, None, None, None, None] * np.ones((1, len(places), len(frequencies), 1, 1)) * (1 + 0.1j)
        errors = (np.abs(change.real) * 0.01 + 0.05j * np.abs(change.imag)).reshape(-1, len(frequencies), 1, 1)
        return change, PlateError(change.reshape(errors.shape), errors, errors, 2.0)

    monkeypatch.setattr(module, "target_inductance", solver)
    network = design_circuit(ONE, ideal=True)
    with pytest.raises(KeyboardInterrupt):
        target_map(design, network=network, keep=Store(tmp_path).dataset)
    assert asked == [[1e-3], [2e-3], [4e-3]]
    again = target_map(design, network=network, keep=Store(tmp_path).dataset)
    assert asked[3:] == [[4e-3], [8e-3]]
    assert again.attrs["plate_error_inductance"] == pytest.approx(0.01)
    assert again.attrs["plate_error_resistance"] == pytest.approx(0.05)
    # δ changes by what ΔL is of L, so that its error is 1 % too, and a little by the losses
    np.testing.assert_allclose(again.delta_error, 0.01 * np.abs(again.delta), rtol=0.1)
    assert again.attrs["plate_skin_depths"] > 1


def test_a_coin_that_stays_says_what_its_model_errs(monkeypatch):
    """Below the coil, within it; a formula stands in for the solver."""

    def solver(source, target, places, distances, frequencies, *rest, **options):
        return np.full((len(distances), len(places), len(frequencies), 1, 1), -1e-7 + 0j), None

    monkeypatch.setattr(module, "target_inductance", solver)
    coin = ca.FinitePlate("coin", ca.Disc(3e-3), (0, 0, -4e-3), 1e-3, ALUMINIUM)
    network = design_circuit(ONE, ideal=True)
    alone, beside = (target_map(replace(ONE, plates=plates), network=network).attrs for plates in ((), (coin,)))
    assert "plate_error_resistance" not in alone
    assert 0.13 < beside["plate_error_resistance"] < 0.2


def test_a_distance_within_a_plate_of_the_design_is_refused():
    above = ca.Plate("above", 6e-3, 0.5e-3, ALUMINIUM)
    design = replace(ONE, target=ca.Target(ca.Plate("target", 0.0, 1e-3, ALUMINIUM), (4e-3,)), plates=(above,))
    network = design_circuit(ONE, ideal=True)
    refused(
        GeometryError, "plate 'target' lies from z = 0.0055 to 0.0065 m and plate 'above' begins at 0.006 m",
        target_map, design, distances=[5.5e-3], network=network,
    )  # fmt: skip


@pytest.mark.slow
def test_a_plate_without_end_is_the_same_in_the_target_and_in_the_design():
    """A target alone, and a target in a design with a plate below: the change is what the plate above adds."""
    wide = ca.Target(ca.Plate("target", 0.0, 1e-3, ALUMINIUM), (4e-3,))
    below = ca.Plate("below", -4e-3, 0.5e-3, ca.MATERIALS["copper"])
    design = replace(ONE, target=wide, plates=(below,))
    found = target_map(design, network="ideal")
    above = replace(below, name="above", z=4e-3, thickness=1e-3, material=ALUMINIUM)
    f = np.array([float(found.matrix_frequency.squeeze())])
    both, one = (plate_inductance(ONE.array, plates, f) for plates in ([below, above], [below]))
    change = complex((both - one).squeeze())
    assert float(found.inductance_change.squeeze()) == pytest.approx(change.real, rel=1e-5)
    assert float(found.resistance_change.squeeze()) == pytest.approx(-2 * math.pi * f[0] * change.imag, rel=1e-4)


@pytest.mark.slow
def test_a_staggered_target_is_located_along_the_coils():
    """Readings with noise at places between those of the table: found within four standard deviations.

    The mesh of the target takes seconds. The cubic between 3 mm errs by less than the noise.
    """
    design = ca.load_design("linear_position")
    table, places = np.arange(-12, 13, 3) * 1e-3, np.array([-10.3, -2.2, 6.9]) * 1e-3
    both = target_map(design, distances=[2e-3], x=np.sort(np.r_[table, places]), y=[0.0], accuracy=0.5)
    model = forward_model(both.sel(x=table))
    assert (model.free, model.parameters) == ([0], ("x", "y", "distance"))
    random, noise = np.random.default_rng(1), 1e-4
    for x in places:
        reading = both.delta.sel(x=x).values.ravel() + noise * random.standard_normal(2)
        found = locate(model, reading, noise=noise)
        assert found.verdict == "found"
        assert abs(found.best.x - x) < 4 * found.best.deviations[0]
        assert found.best.deviations[0] < 0.15e-3  # mostly the stated error of the target's thickness and rim
        assert (found.best.y, found.best.depth) == (0.0, 2e-3)
    lower, upper = both.delta.sel(x=table).squeeze().transpose("state", "x").values
    # turned by half a turn the board is the same but for the leads, 2 of 40 mm; the mesh errs by 1 %
    np.testing.assert_allclose(lower, upper[::-1], rtol=2e-2)
    assert (np.diff(lower) < 0).all()


def test_a_distance_is_located_where_the_place_is_known():
    """One coil over a plate: δ alone tells the distance."""
    found = exponential(0.1, 2e-3, np.linspace(1e-3, 6e-3, 11)).isel(x=[0], state=[0])
    model = forward_model(found)
    at = locate(model, [-0.1 * math.exp(-2.3 / 2)], noise=1e-6)
    assert (at.verdict, model.free) == ("found", [2])
    assert at.best.depth == pytest.approx(2.3e-3, abs=5e-6)
    assert at.best.known_deviations[:2] == (None, None)
    # what the table itself errs adds to the noise
    errs = forward_model(found.assign(delta_error=1e-3 * abs(found.delta)))
    size = 0.1 * math.exp(-2.3 / 2)
    (deviation,) = locate(errs, [-size], noise=1e-5).best.deviations
    assert deviation == pytest.approx(math.hypot(1e-5, 1e-3 * size) / (size / 2e-3), rel=1e-2)  # slope of the cubic
    assert errs.select(["a"]).errors == errs.errors
    assert "no target is noticed" in locate(model, [1e-7], noise=1e-6).reason
    refused(LocalizeError, "distance of a point must be in the table", model.delta, [0.0, 0.0, 0.5])
    refused(LocalizeError, "more than one position or depth", forward_model, found.isel(distance=[0]))
    assert over_depth(over_depth(found)).sizes["depth"] == 11


def test_what_cannot_be_computed_is_refused(monkeypatch):
    refused(MetalError, "has no .target.", target_map, ca.load_design("gast2020"))
    for wrong, line in (
        ({"distances": [0.0, 1e-3]}, "distances of a target must be above zero; got 0 mm"),
        ({"x": [1e-3, 0.0]}, "x must be finite and rising"),
    ):
        refused(MetalError, line, lambda wrong: target_map(ONE, **wrong), wrong)
    refused(MetalError, "noise must be positive and finite", ranges_of, exponential(1.0, 1.0, np.array([1.0])), 0.0)
    above = ca.Plate("above", 40e-3, 0.5e-3, ca.MATERIALS["copper"])
    line = "beside plates below the coils; plate.0 'above' lies above them: leave it out"
    refused(MetalError, line, lambda: target_map(replace(ONE, plates=(above,))))
    monkeypatch.setattr(
        module, "target_inductance", lambda *args, **options: (np.full((1, 2, 1, 1, 1), -1.0 + 0j), None)
    )
    refused(MetalError, "a target at 1 mm is too near for the model", lambda: target_map(ONE, network="ideal"))

    def not_a_number(*args, **options):
        return np.full((1, 2, 1, 1, 1), np.nan + 0j), None

    monkeypatch.setattr(module, "target_inductance", not_a_number)
    refused(MetalError, "a target at 1 mm is too near for the model", lambda: target_map(ONE, network="ideal"))
    # the first call is the guess from which the band follows
    L = design_circuit(ONE, ideal=True).inductance
    for later, line in (((-1.0,), "a target at 1 mm is too near"), ((-0.5, -0.9), "at 1 mm moves a resonance to")):
        factors = iter((0.0, *later))

        def solver(source, target, places, distances, frequencies, *rest, factors=factors, **options):
            return np.full((len(distances), len(places), len(frequencies), 1, 1), next(factors) * L + 0j), None

        monkeypatch.setattr(module, "target_inductance", solver)
        refused(MetalError, line, lambda: target_map(ONE, network="ideal"))
