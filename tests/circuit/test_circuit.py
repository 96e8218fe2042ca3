"""Terminations: closed forms for two coils, identities for any number."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.active_coil import active_coil
from support.coil_paths import random_matrix

from coilarray.circuit.coupling import couple
from coilarray.circuit.network import checked_network

pytestmark = pytest.mark.nojit

F = 2e6
OMEGA = 2 * np.pi * F


def test_two_coils():
    L = np.array([[50e-6, -3e-6], [-3e-6, 40e-6]])
    assert active_coil(L, 0.0, 0, F).currents[1] == pytest.approx(3 / 40, rel=1e-14)  # −M/L2
    state = active_coil(L, [10.0, 12.0], 0, F, short_resistance=5.0)
    # reflected impedance ω² M²/(R2 + jωL2), Terman 1943
    Z = 10 + 1j * OMEGA * 50e-6 + (OMEGA * 3e-6) ** 2 / (17 + 1j * OMEGA * 40e-6)
    assert state.impedance == pytest.approx(Z, rel=1e-14)


@settings(max_examples=40)
@given(st.integers(2, 7), st.integers(0, 10**6), st.floats(0, 50), st.floats(0, 50))
def test_identities(n, seed, resistance, short):
    L = random_matrix(n, seed)
    state = active_coil(L, resistance, 0, F, short_resistance=short)
    # grounded neighbours take inductance and add loss
    assert state.apparent_inductance <= L[0, 0] * (1 + 1e-14)
    assert state.effective_resistance >= resistance * (1 - 1e-12)
    # the parts add up
    assert L[0, 0] + state.contributions.sum() == pytest.approx(state.apparent_inductance, rel=1e-12)
    # power: what the source gives is what the resistances take
    power = resistance * abs(state.currents[0]) ** 2 + ((resistance + short) * np.abs(state.currents[1:]) ** 2).sum()
    assert state.effective_resistance == pytest.approx(power, rel=1e-10, abs=1e-9)
    # Kirchhoff in every passive loop
    voltages = 1j * OMEGA * L @ state.currents + (resistance + short) * state.currents
    assert np.abs(voltages[1:]).max() <= 1e-12 * np.abs(voltages[0])


def test_ideal_shorts_of_many_coils():
    L = random_matrix(6, 3)
    # by Schur's complement, the inverse of the whole matrix
    assert active_coil(L, 0.0, 2, F).apparent_inductance == pytest.approx(1 / np.linalg.inv(L)[2, 2], rel=1e-12)


def test_open_coils_do_nothing():
    L = random_matrix(4, 1)
    state = active_coil(L, 3.0, 1, F, ["open"] * 4)
    assert state.apparent_inductance == pytest.approx(L[1, 1], rel=1e-15)
    assert state.currents.tolist() == [0, 1, 0, 0]
    # a short behind a huge resistance is as good as open
    assert active_coil(L, 3.0, 1, F, short_resistance=1e12).apparent_inductance == pytest.approx(L[1, 1], rel=1e-9)
    one = active_coil(L, 3.0, 1, F, ["short", "short", "open", "open"])
    assert one.apparent_inductance == pytest.approx(L[1, 1] - L[0, 1] ** 2 * (OMEGA**2 * L[0, 0]) / (
        9 + (OMEGA * L[0, 0]) ** 2), rel=1e-13)  # fmt: skip


def test_couple_is_where_the_converter_oscillates():
    L = random_matrix(4, 5)
    state = couple(list("abcd"), L, 15.0, 120e-12, short_resistance=5.0).sel(coil="a")
    # the closed form has the passive coils' switches, the converter looks through those of the active one as well
    frequency = float(state.frequency)
    again = active_coil(L, 15.0, 0, frequency, short_resistance=5.0)
    assert (1 / (again.impedance + 5.0) + 2j * np.pi * frequency * 120e-12).imag == pytest.approx(0, abs=1e-12)
    assert float(state.effective_resistance) == pytest.approx(again.effective_resistance + 5.0, rel=1e-10)
    assert float(state.effective_inductance) == pytest.approx(1 / ((2 * np.pi * frequency) ** 2 * 120e-12), rel=1e-14)
    np.testing.assert_allclose(state.current_real + 1j * state.current_imag, again.currents, atol=1e-12)
    np.testing.assert_allclose(state.contribution, again.contributions, atol=1e-12 * L[0, 0])


def test_couple_gives_one_dataset():
    result = couple(["a", "b", "c"], random_matrix(3, 2), 10.0, 120e-12, ["short", "open", "short"])
    assert result.coil.values.tolist() == ["a", "b", "c"]
    for name, variable in result.data_vars.items():
        assert "units" in variable.attrs or name == "termination"
    # b is open while passive: it carries nothing unless it is active
    assert result.current_real.values[0, 1] == 0
    assert result.current_real.values[1, 1] == 1
    # the parts add up to Im Z/ω, which is less than 1/(ω²C) by 1/Q²
    total = result.open_inductance + result.contribution.sum("other")
    np.testing.assert_allclose(total * (1 + 1 / result.quality_factor**2), result.effective_inductance, rtol=1e-12)
    opened = result.open_effective_inductance
    np.testing.assert_allclose(opened, 1 / ((2 * np.pi * result.open_frequency) ** 2 * 120e-12), rtol=1e-14)
    np.testing.assert_allclose(result.inductance_change, result.effective_inductance / opened - 1, rtol=1e-12)
    assert (result.frequency >= result.open_frequency).all()


@pytest.mark.parametrize("k", [0.9, 0.99, 0.9999])
def test_resonance_of_strongly_coupled_coils(k):
    L = 1e-5 * np.array([[1, k], [k, 1]])
    for R in (0.0, 0.2, 2.0):
        state = couple(["a", "b"], L, R, 100e-12).sel(coil="a")
        # Im Y = 0 of the closed form, relative to the susceptance of the coil
        Z = active_coil(L, R, 0, float(state.frequency)).impedance
        assert (1 / Z).imag == pytest.approx(-2 * np.pi * float(state.frequency) * 100e-12, rel=1e-11)


@pytest.mark.parametrize(("call", "message"), [
    (lambda: checked_network([[1e-6, 0]], 0), "must be square"),
    (lambda: checked_network([[np.nan]], 0), "finite with a positive diagonal"),
    (lambda: checked_network([[-1e-6]], 0), "finite with a positive diagonal"),
    (lambda: checked_network([[1e-6]], -1), "resistances must be finite and not negative"),
    (lambda: checked_network([[1e-6]], [1, 2]), "resistance must be one number or 1"),
    (lambda: checked_network([[1, 1], [1, 1]], 0), "must be positive definite; .* two coils are in the same place"),
    (lambda: checked_network([[2, 1], [0, 2]], 0), "must be symmetric; between coils 1 and 2 it has"),
    (lambda: couple(["a", "b"], [[1, 2], [2, 1]], 0, 1e-12), "must be positive definite"),
    (lambda: couple(["a"], [[1e-6]], 0, -1e-12), "capacitance must be positive and finite"),
    (lambda: couple(["a"], [[1e-6]], 0, 1e-12, ["loose"]), "must be 1 of 'short' or 'open'"),
    (lambda: couple(["a", "b"], [[1e-6]], 0, 1e-12), "2 names need an inductance matrix"),
    (lambda: couple(["a"], [[1e-5]], 1e4, 100e-12), "state a has no resonance between"),
])  # fmt: skip
def test_bad_input(call, message):
    with pytest.raises(ValueError, match=message):
        call()
