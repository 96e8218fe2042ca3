"""Inductance of wound coils against public measurements, and of squares against their path and a current sheet.

Who checks whom: LCR meter readings of van Liempd's boards (tests/reference), vertices written out by hand, and the
current-sheet formula of Mohan et al. (IEEE J. Solid-State Circuits 34, 1999) against coils of a design's shapes.
"""

import math
from dataclasses import replace

import numpy as np
import pytest
from support.references import rows_of

from coilarray.electromagnetics.inductance import inductance_matrix
from coilarray.geometry import Array, Conductor, Placement, PlatedHole, RoundedSpiral, Spiral, Stackup

TWO_LAYERS = Stackup(("top", "bot"), (35e-6, 35e-6), (0.53e-3,), (4.5,))  # of 0.6 mm, from the file's header


def measured():
    """Rows of the two-layer boards."""
    return [row for row in rows_of("van_liempd_2023_pcb_coils.csv") if row["board"] == "2L"]


def inductance(spiral, layers, stackup=TWO_LAYERS):
    """Inductance in µH of one coil with its vias and without leads."""
    coil = replace(spiral, layers=len(layers), via=PlatedHole(0.3e-3, 0.6e-3), leads=None).coil()
    return float(inductance_matrix(Array(stackup, (Placement("A", coil, layers, 0, 0),)))[0, 0]) * 1e6


@pytest.mark.slow
@pytest.mark.parametrize(
    "row", measured(), ids=lambda row: f"{row['shape']} {row['turns_per_layer']} {row['layers']} {row['outer_mm']}"
)
def test_measured_coils(row):
    turns = float(row["turns_per_layer"])
    w, gap, size = (float(row[f"{key}_mm"]) * 1e-3 for key in ("trace_width", "gap", "outer"))
    if row["shape"] == "circular":
        if turns > 10:
            pytest.skip("takes seconds and says the same")
        spiral = RoundedSpiral(size, size, turns, w, gap, size / 2)
    else:
        spiral = Spiral(4, size, turns, w, gap, math.pi / 4)
    # the meter is good to 2.5 % + 5 nH. The circles measured are spirals of Archimedes, of which four arcs a turn have
    # up to 0.6 % more, where the pitch is a thirtieth of the diameter
    tolerance = 0.01 if row["shape"] == "square" else 0.012
    found = inductance(spiral, tuple(row["layers"].split("+")))
    assert found == pytest.approx(float(row["measured_inductance_uH"]), rel=tolerance)


def test_a_square_is_its_path_and_near_the_current_sheet():
    size, w, gap, turns = 40e-3, 0.9e-3, 0.15e-3, 9
    pitch, a = w + gap, (size - w) / 2
    line = [(a, -a)]
    for k in range(turns):
        b = a - k * pitch
        line += [(b, b), (-b, b), (-b, -b), (b - pitch, -b)]
    path = Conductor(np.column_stack((line, np.zeros(len(line)))), w, 30e-6)
    expected = float(inductance_matrix([path])[0, 0]) * 1e6
    assert expected == pytest.approx(3.924, abs=5e-4)  # digits of another program
    one = Stackup(("L1",), (30e-6,), (), ())
    for spiral in (
        RoundedSpiral(size, size, turns, w, gap),
        Spiral(4, size, turns, w, gap, 0.7),
        Spiral(4, size, turns, w, gap, winding="cw"),
    ):
        assert inductance(spiral, ("L1",), one) == pytest.approx(expected, rel=1e-9)  # rounding of near bars
    inner = size - 2 * (turns * w + (turns - 1) * gap)
    fill, mean = (size - inner) / (size + inner), (size + inner) / 2
    sheet = 4e-7 * math.pi * turns**2 * mean * 1.27 / 2 * (math.log(2.07 / fill) + 0.18 * fill + 0.13 * fill**2)
    assert expected == pytest.approx(sheet * 1e6, rel=0.01)  # 3.945 µH; the formula is good to some per cent
