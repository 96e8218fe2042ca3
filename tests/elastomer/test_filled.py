"""Filled elastomers: limits, bounds, and the equations that the closed forms solve.

Who checks whom: Hashin and Shtrikman's bounds hold for both mixing rules, a root finder solves Bruggeman's equation
as it is written, and the limits (dilute, full, infinite) are known in closed form.
"""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import brentq

from coilarray.elastomer.filled import (
    bruggeman_permeability,
    guth_gold_modulus,
    maxwell_garnett_permeability,
)
from coilarray.errors import ElastomerError

RULES = pytest.mark.parametrize("rule", [maxwell_garnett_permeability, bruggeman_permeability])
fractions = st.floats(0, 1)
permeabilities = st.floats(1, 1e6)


def test_guth_gold_starts_with_einsteins_term():
    # 30 % of carbonyl iron powder in silicone rubber (Gast and Zimmermann 2020): about three times as stiff
    assert guth_gold_modulus(55e3, 0.30) == pytest.approx(55e3 * 3.019, rel=1e-12)
    assert guth_gold_modulus(55e3, 0) == 55e3
    f = 1e-6
    # the next term is 14.1 f² = 1.4e-11
    assert guth_gold_modulus(1.0, f) - 1 == pytest.approx(2.5 * f, rel=1e-4)


def test_guth_gold_refuses_a_modulus_or_a_fraction():
    for modulus in (0.0, -1.0, math.inf, math.nan):
        with pytest.raises(ElastomerError, match="modulus must be positive and finite"):
            guth_gold_modulus(modulus, 0.1)
    for fraction in (-0.01, 0.36, 30.0, math.nan):
        with pytest.raises(ElastomerError, match=r"volume fraction must be 0 to 0\.35.*got"):
            guth_gold_modulus(1.0, fraction)


@RULES
@given(mu=permeabilities)
def test_dilute_mixtures_are_single_spheres(rule, mu):
    f = 1e-6
    # the terms in f² are at most 9 f² = 1e-11, rounding of the 1 is 1e-16
    assert rule(f, mu) - 1 == pytest.approx(3 * f * (mu - 1) / (mu + 2), rel=2e-5, abs=1e-15)
    assert rule(f) - 1 == pytest.approx(3 * f, rel=2e-5)


@RULES
@given(mu=permeabilities)
def test_pure_phases(rule, mu):
    # rounding; in 1 − f β = 3/(mu + 2) at f = 1 it grows by mu
    assert rule(0, mu) == pytest.approx(1, rel=1e-12)
    assert rule(1, mu) == pytest.approx(mu, rel=1e-9)
    assert rule(0) == 1
    assert rule(1) == math.inf


@given(fractions, st.floats(1.001, 1e5))
def test_hashin_shtrikman_bounds(f, mu):
    """Of the permeability of isotropic mixtures, J. Appl. Phys. 33, 3125 (1962), as the paper writes them."""
    lower = 1 + f / (1 / (mu - 1) + (1 - f) / 3)
    upper = mu + (1 - f) / (1 / (1 - mu) + f / (3 * mu))
    # rounding of the bounds: 1e-16 times up to mu
    assert maxwell_garnett_permeability(f, mu) == pytest.approx(lower, rel=1e-9)
    assert lower * (1 - 1e-9) <= bruggeman_permeability(f, mu) <= upper * (1 + 1e-9)


@given(fractions, st.floats(1.001, 1e5))
def test_bruggeman_solves_its_equation(f, mu):
    def balance(m):
        return f * (mu - m) / (mu + 2 * m) + (1 - f) * (1 - m) / (1 + 2 * m)

    root = brentq(balance, 1 - 1e-9, mu * (1 + 1e-9), xtol=1e-13, rtol=1e-13)
    # the root finder's tolerance, larger where the balance is flat, near 1/3 and large mu
    assert bruggeman_permeability(f, mu) == pytest.approx(root, rel=1e-8)


@given(st.floats(0, 0.333))
def test_bruggeman_of_infinite_particles(f):
    assert bruggeman_permeability(f) == pytest.approx(1 / (1 - 3 * f), rel=1e-12)
    # approached like 1/mu, with a factor that grows to (1 − 3f)⁻²·4 near the threshold
    assert bruggeman_permeability(f, 1e14) == pytest.approx(bruggeman_permeability(f), rel=1e-6)


@given(st.floats(1 / 3, 1))
def test_bruggeman_percolates_at_a_third(f):
    assert bruggeman_permeability(f) == math.inf
    # at the threshold itself like √(μp/2), above it like μp
    assert bruggeman_permeability(f, 1e14) > 5e6


def test_numbers_of_the_sensors_layer():
    f = 0.30
    assert maxwell_garnett_permeability(f) == pytest.approx((1 + 2 * f) / (1 - f), rel=1e-14)
    # the 2.7 that the authors' second paper uses lies between the two rules for iron
    assert maxwell_garnett_permeability(f) < 2.3 < 2.7 < bruggeman_permeability(f, 100.0)
    # said in the docstrings
    assert maxwell_garnett_permeability(f, 30.0) / maxwell_garnett_permeability(f) == pytest.approx(0.93, abs=0.005)
    assert bruggeman_permeability(f) == pytest.approx(10, rel=1e-12)


@RULES
def test_refuses_a_fraction_or_a_permeability(rule):
    for fraction in (-1e-9, 1.001, 30.0, math.nan, math.inf):
        with pytest.raises(ElastomerError, match="volume fraction must be 0 to 1; got"):
            rule(fraction, 10.0)
    for mu in (0.999, 0.0, -5.0, math.nan, -math.inf):
        with pytest.raises(ElastomerError, match=r"permeability must be at least 1 .*got"):
            rule(0.1, mu)
