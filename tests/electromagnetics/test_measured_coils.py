"""Inductance of wound coils against public measurements, and of squares against their path and a current sheet.

Who checks whom: LCR meter readings of van Liempd's boards (tests/reference), vertices written out by hand, and the
current-sheet formula of Mohan et al. (IEEE J. Solid-State Circuits 34, 1999) against coils of a design's shapes.
"""

import csv
import math
from dataclasses import replace

import pytest
from support.references import FOLDER

from coilarray.electromagnetics.inductance import inductance_matrix
from coilarray.geometry import Array, Placement, PlatedHole, RoundedSpiral, Spiral, Stackup

TWO_LAYERS = Stackup(("top", "bot"), (35e-6, 35e-6), (0.53e-3,), (4.5,))  # of 0.6 mm, from the file's header


def measured():
    """Rows of the two-layer boards."""
    with (FOLDER / "van_liempd_2023_pcb_coils.csv").open(encoding="utf-8", newline="") as lines:
        rows = list(csv.DictReader(line for line in lines if not line.startswith("#")))
    return [row for row in rows if row["board"] == "2L"]


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
