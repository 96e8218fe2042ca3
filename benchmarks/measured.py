"""Inductance of 46 measured coils of printed boards: of their exact centre lines, without any value fitted."""

from __future__ import annotations

import functools
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from accuracy import Accuracy  # which makes the helpers of the tests known
from support.references import rows_of

from coilarray import inductance_matrix
from coilarray.compute.arrays import FloatArray
from coilarray.geometry import Conductor

TABLE = "van_liempd_2023_pcb_coils.csv"
_SEGMENTS = 64  # of a turn of a circle, as in the file's own column
# Copper and dielectric from the top in mm, from the head of the file
_STACKS = {
    "2L": ("top bot", (0.035, 0.53, 0.035)),
    "4L": ("top in1 in2 bot", (0.035, 0.203, 0.030, 0.2, 0.030, 0.203, 0.035)),
    "6L": (
        "top in1 in2 in3 in4 bot",
        (0.035, 0.0994, 0.0152, 0.35, 0.0152, 0.1088, 0.0152, 0.35, 0.0152, 0.0994, 0.035),
    ),
}


@dataclass(frozen=True)
class MeasuredCoil:
    """Inductance of one coil in µH, and the relative error of the meter."""

    board: str
    shape: str
    layers: int
    measured: float
    computed: float
    tolerance: float


def _centre_line(shape: str, turns: int, width: float, pitch: float, outer: float) -> FloatArray:
    """Return the centre line of one layer from its outer end, shape (n, 2), in mm."""
    if shape == "circular":
        angle = np.linspace(0, 2 * np.pi * turns, _SEGMENTS * turns + 1)
        radius = (outer - width) / 2 - pitch * angle / (2 * np.pi)
        return np.column_stack((radius * np.cos(angle), radius * np.sin(angle)))
    corner = np.arange(4 * turns + 1)
    half = (outer - width) / 2
    x = np.where(corner % 4 < 2, 1, -1) * (half - corner // 4 * pitch)
    y = np.where((corner - 1) % 4 < 2, 1, -1) * (half - (corner - 1) // 4 * pitch)
    return np.column_stack((x, y))


def _inductance(row: dict[str, str]) -> float:
    """Return the inductance in µH of the layers of one coil in series, without vias and leads."""
    names, thicknesses = _STACKS[row["board"]]
    tops = np.concatenate(([0.0], np.cumsum(thicknesses)))
    width, gap, outer = (float(row[f"{key}_mm"]) for key in ("trace_width", "gap", "outer"))
    line = _centre_line(row["shape"], int(row["turns_per_layer"]), width, width + gap, outer)
    layers = []
    for name in row["layers"].split("+"):
        k = 2 * names.split().index(name)
        z = np.full((len(line), 1), -(tops[k] + tops[k + 1]) / 2)
        drawn = line if len(layers) % 2 == 0 else (line * [1, -1])[::-1]  # every second layer runs outwards
        layers.append(Conductor(np.hstack((drawn, z)) * 1e-3, width * 1e-3, thicknesses[k] * 1e-3))
    return float(inductance_matrix(layers).sum()) * 1e6


@functools.cache
def coils() -> tuple[MeasuredCoil, ...]:
    """Compute the coils of two and more layers: the lead of a single one is not in the model."""
    found = []
    for row in rows_of(TABLE):
        layers = len(row["layers"].split("+"))
        if row["board"] in _STACKS and layers > 1:
            measured, tolerance = float(row["measured_inductance_uH"]), float(row["tolerance_percent"]) / 100
            found.append(MeasuredCoil(row["board"], row["shape"], layers, measured, _inductance(row), tolerance))
    return tuple(found)


def accuracies() -> Iterator[Accuracy]:
    """Compare with the meter: the mean and the largest deviation."""
    deviations = np.abs([coil.computed / coil.measured - 1 for coil in coils()])
    yield Accuracy("L of measured coils, mean deviation", TABLE, len(deviations), float(deviations.mean()), 0.01)
    yield Accuracy("L of measured coils, largest deviation", TABLE, len(deviations), float(deviations.max()), 0.02)
