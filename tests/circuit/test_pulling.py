"""Two converters that run at once, against ngspice, normal modes, and the second order of a weak coupling."""

import math
from dataclasses import replace

import numpy as np
import pytest
from support.refusals import refused
from support.spice import needs_ngspice, run_bench

from coilarray import load_design
from coilarray.circuit.pulling import converter_pair, pulling
from coilarray.errors import NetworkError

C = 120e-12


def tanks(k, second=53e-6, first=50e-6):
    M = k * math.sqrt(first * second)
    return [[first, M], [M, second]]


def test_modes_of_equal_tanks_are_split_by_k():
    f0 = 1 / (2 * math.pi * math.sqrt(50e-6 * C))
    found = pulling(tanks(0.05, 50e-6), [10.0, 10.0], C)
    np.testing.assert_allclose(found.alone, f0, rtol=1e-12)
    np.testing.assert_allclose(found.modes, [f0 / math.sqrt(1.05), f0 / math.sqrt(0.95)], rtol=1e-12)
    # they lock into one of the two modes, whose amplitudes are those of the tanks alone
    assert found.beat == 0
    assert found.together[0] == found.together[1]
    assert np.abs(found.together[0] / found.modes - 1).min() < 1e-6  # of the rest that decays by e^−12 twice


@pytest.mark.parametrize("ratio", [1.0, 2.0])
def test_a_weak_coupling_shifts_by_its_square(ratio):
    """−κ²/2 (D₂ + ρ²D₁ + (1 − ρ²)/Δ) with D = Δ/(γ² + Δ²), from the averaged equations to second order in κ."""
    L, R = np.array(tanks(1e-3, 53e-6)), np.array([10.0, 25.0])
    found = pulling(L, R, C, (1.0, ratio))
    squares, vectors = np.linalg.eigh(np.linalg.inv(L) / C)
    omega = vectors * np.sqrt(squares) @ vectors.T
    gamma, kappa, delta = R / (2 * np.diag(L)), omega[0, 1], omega[1, 1] - omega[0, 0]
    D = delta / (gamma**2 + delta**2)
    for own, rho, sign in ((0, ratio, -1), (1, 1 / ratio, 1)):
        shift = sign * kappa**2 / 2 * (D[1 - own] + rho**2 * D[own] + (1 - rho**2) / delta)
        # the next order is (κ/Δ)² of it, 3e-4, and the mean over 24 beats leaves a few times that
        assert 2 * math.pi * found.together[own] - omega[own, own] == pytest.approx(shift, rel=5e-3)
    assert found.beat == pytest.approx(abs(found.together[1] - found.together[0]), rel=1e-12)


def test_exchanged_and_scaled_tanks_are_pulled_alike():
    found = pulling(tanks(0.02), [10.0, 12.0], [C, 1.1 * C], (1.0, 1.5))
    L = np.array(tanks(0.02))
    other = pulling(L[::-1, ::-1], [12.0, 10.0], [1.1 * C, C], (1.5, 1.0))
    np.testing.assert_allclose(other.together, found.together[::-1], rtol=1e-6)  # beats that begin elsewhere
    scaled = pulling(L / 7, np.array([10.0, 12.0]) / 7, np.array([C, 1.1 * C]) * 7 / 9, (2.0, 3.0))
    # impedances by 1/7 and times by 1/3: L/7, C 7/9 and R/7 have LC/9 and R/L as it was, so only the frequencies rise
    np.testing.assert_allclose(scaled.alone, 3 * found.alone, rtol=1e-12)
    np.testing.assert_allclose(scaled.modes, 3 * found.modes, rtol=1e-12)


@needs_ngspice
@pytest.mark.slow
@pytest.mark.parametrize(("k", "second"), [(0.02, 53e-6), (0.05, 56e-6), (0.02, 50.2e-6)])
def test_ngspice_beats_and_locks(tmp_path, k, second):
    """Two tanks with limited currents, step by step in time.

    A coil with a resistance in series, and the harmonics of nearly square currents, lower each frequency by less
    than 1/Q², 2.4e-4, and the beat by as much of itself. A step h of the trapezoidal rule is corrected by
    ω = (2/h) tan(ωh/2).
    """
    step, end = 2e-9, 600e-6
    lines = [
        f"L1 a ma 50u\nRa ma 0 10\nCa a 0 {C!r} ic=1.6\nBa 0 a I=30u*tanh(V(a)/0.05)",
        f"L2 b mb {second!r}\nRb mb 0 10\nCb b 0 {C!r} ic=0.8\nBb 0 b I=30u*tanh(V(b)/0.05)\nK12 L1 L2 {k!r}",
    ]
    run_bench(tmp_path, lines, [f"tran {step} {end} 200u {step} uic", "wrdata v.txt v(a) v(b)"])
    times, a, _, b = np.loadtxt(tmp_path / "v.txt").T
    whole = [crossings(times, one) for one in (a, b)]
    grid = np.linspace(max(one[0] for one in whole), min(one[-1] for one in whole), 20_000)
    phases = np.array([np.interp(grid, one, np.arange(len(one))) for one in whole])
    apart = np.abs(phases[1] - phases[0] - (phases[1] - phases[0])[0])
    found = pulling(tanks(k, second), [10.0, 10.0], C)
    assert (apart[-1] < 0.5) == (found.beat == 0)
    last = -1 if found.beat == 0 else np.searchsorted(np.maximum.accumulate(apart), math.floor(apart[-1]))
    f = (phases[:, last] - phases[:, 0]) / (grid[last] - grid[0])
    f = np.tan(math.pi * f * step) / (math.pi * step)
    if found.beat == 0:  # either mode: the start decides
        assert np.abs(f[0] / found.modes - 1).min() < 3e-4
        assert f[0] == pytest.approx(f[1], rel=1e-5)
    else:
        np.testing.assert_allclose(f, found.together, rtol=1 / 64**2)
        # what the coupling adds to the distance of the frequencies, at 1 % of it
        own = abs(found.alone[1] - found.alone[0])
        assert abs(f[1] - f[0]) - own == pytest.approx(found.beat - own, rel=0.01)


def crossings(times, values):
    """Times at which values rise through zero."""
    k = np.flatnonzero((values[:-1] < 0) & (values[1:] >= 0))
    return times[k] - values[k] * (times[k + 1] - times[k]) / (values[k + 1] - values[k])


@pytest.mark.slow
def test_two_coils_of_a_design():
    design = load_design("starter")
    alike = converter_pair(design, "coil1", "coil3")  # mirror images
    assert alike.beat == 0
    apart = replace(design.circuit, terminations={"coil2": "open"}, switches=replace(design.circuit.switches))
    found = converter_pair(replace(design, circuit=apart), "coil1", "coil2")
    assert (np.diff(found.modes) > np.abs(np.diff(found.alone))).all()  # coupled modes repel each other
    for coils, words in ((("coil1", "coil9"), "'coil9'"), (("coil1", "coil1"), "'coil1' twice")):
        refused(NetworkError, words, converter_pair, design, *coils)


@pytest.mark.parametrize(
    ("words", "arguments"),
    [
        (r"resistance of a tank .* got 0", (tanks(0.1), [0.0, 1.0], C)),
        (r"capacitance of a tank .* got -1", (tanks(0.1), [1.0, 1.0], -1.0)),
        (r"amplitude of a tank .* got 0", (tanks(0.1), [1.0, 1.0], C, (1.0, 0.0))),
        (r"\(2, 2\); got \(1, 1\)", ([[1e-6]], [1.0], C)),
    ],
)
def test_impossible_tanks_are_refused(words, arguments):
    refused(NetworkError, words, pulling, *arguments)
