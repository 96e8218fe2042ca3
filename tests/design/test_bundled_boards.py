"""Bundled designs in space against closed forms.

Who checks whom: the reader and the card against sums of Grover's parallel filaments; the bent strip against dipoles on
its cylinder.
"""

import math
from dataclasses import replace

import numpy as np
import pytest

import coilarray as ca
from coilarray.constants import MU_0
from coilarray.electromagnetics.inductance import mutual_inductance, self_inductance


def parallel(length, other, distance):
    """M in H of parallel filaments whose middles are beside each other (Grover, Inductance Calculations, chapter 6)."""

    def part(z):
        return z * np.arcsinh(z / distance) - np.hypot(z, distance)

    return MU_0 / (2 * np.pi) * (part((length + other) / 2) - part((length - other) / 2))


def rectangles(first, second, height):
    """M in H of two rectangles over each other."""
    total = 0.0
    for (a, b), (c, d) in ((first, second), (first[::-1], second[::-1])):
        near, far = np.hypot((b - d) / 2, height), np.hypot((b + d) / 2, height)
        total += 2 * (parallel(a, c, near) - parallel(a, c, far))
    return total


def turns(width, height):
    """Middle lines in m of the four turns of 0.5 mm, 0.5 mm apart."""
    return [(width - 0.5e-3 - 2e-3 * k, height - 0.5e-3 - 2e-3 * k) for k in range(4)]


READER, CARD = turns(50e-3, 40e-3), turns(72e-3, 42e-3)
DISTANCE = 0.2235 * (0.5e-3 + 35e-6)  # geometric mean distance of a trace from itself


def test_reader_and_card_have_the_inductances_of_their_rectangles():
    design = ca.load_design("nfc_reader")
    L = ca.inductance_matrix(design.conductors())

    def own(lines):
        return sum(rectangles(one, other, DISTANCE if one == other else 0.0) for one in lines for other in lines)

    across = sum(rectangles(one, other, 20e-3) for one in READER for other in CARD)
    # closed sharp rectangles: round corners, the steps between turns and the leads are left out
    np.testing.assert_allclose(np.diag(L), [own(READER), own(CARD)], rtol=0.01)
    assert -L[0, 1] == pytest.approx(across, rel=0.01)  # the card lies upside down


def test_neighbours_of_the_charger_are_decoupled():
    k = ca.coupling_matrix(ca.inductance_matrix(ca.load_design("charger").array))
    assert abs(k[0, 1]) < 0.005  # the pitch is right to 0.2 mm, and k changes by 0.028 per mm
    assert abs(k[1, 2]) < 0.005
    assert -0.03 < k[0, 2] < -0.02  # beside each other, as no pitch decouples both


@pytest.mark.slow
def test_a_bend_couples_the_coils_of_the_strip_as_dipoles_on_a_cylinder():
    bent = ca.load_design("finger_strip").array
    flat = replace(bent, form=None)
    of_bent, of_flat = bent.conductors()[:3], flat.conductors()[:3]
    L = self_inductance(of_bent)[0] / self_inductance(of_flat)[0]
    assert 0.98 < L < 1.0  # both halves of a coil turn away from each other
    k = [mutual_inductance(paths[0], paths[k]) for paths in (of_bent, of_flat) for k in (1, 2)]
    near, far = k[0] / k[2], k[1] / k[3]
    # dipoles with angles ±a to their chord: (1 + sin²a)(a/sin a)³ of flat ones, nearly so two pitches apart
    a = bent.lattice.pitch / bent.form.least_radius
    assert far == pytest.approx((1 + math.sin(a) ** 2) * (a / math.sin(a)) ** 3, rel=0.1)
    assert 1.1 < near < 1.3  # coils that touch are more than dipoles


def test_card_and_strip_have_their_sizes():
    x_min, y_min, x_max, y_max = ca.load_design("nfc_card").array.bounds
    # ISO/IEC 7810, ID-1
    assert 85e-3 < x_max - x_min < 85.72e-3
    assert 53e-3 < y_max - y_min < 54.03e-3
    x_min, _, x_max, _ = ca.load_design("finger_strip").array.bounds
    assert x_max - x_min < 2 * math.pi * 8e-3
