"""Metal: plates against finite elements at 2 kHz and 2 MHz, and the time of a target's map."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from accuracy import Accuracy
from speed import Speed

sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))
from support.axial_plates import AxialPlate, axial_change
from support.coil_paths import loop

from coilarray import load_design
from coilarray.geometry import MATERIALS, Disc, FinitePlate, Plate
from coilarray.metal.finite_plates import moving_plate
from coilarray.metal.flat_plates import plate_inductance

COPPER = MATERIALS["copper"]
RADIUS, GAP, FREQUENCY = 5e-3, 1e-3, 2e6  # of the loop, its distance in m, and Hz: a skin depth of 46 µm
WIDE = [(2e3, 1e-3), (FREQUENCY, 35e-6), (FREQUENCY, 70e-6), (FREQUENCY, 1e-3)]  # Hz, thickness in m
DISCS = [(7e-3, 35e-6), (6e-3, 0.5e-3), (7e-3, 1e-3), (4e-3, 1e-3)]  # radius, thickness in m
MAP_GOAL = 40.0  # s of processor time: 20 s on two cores


def _elements(radius: float, thickness: float, frequency: float) -> complex:
    """ΔL − jΔR/ω in H of the loop by a copper disc, by finite elements."""
    disc = AxialPlate(0.0, radius, -thickness / 2, thickness / 2, COPPER.conductivity)
    return complex(axial_change([(RADIUS, -GAP - thickness / 2)], disc, frequency, 2.0))


def _infinite() -> Iterator[tuple[complex, complex]]:
    for frequency, thickness in WIDE:
        plate = Plate("plate", GAP, thickness, COPPER)
        found = plate_inductance([loop(RADIUS, sides=180)], [plate], [frequency])[0, 0, 0]
        yield found, _elements(20 * RADIUS, thickness, frequency)


def _outlined() -> Iterator[tuple[complex, complex]]:
    for radius, thickness in DISCS:
        plate = FinitePlate("disc", Disc(radius), (0.0, 0.0, GAP + thickness / 2), thickness, COPPER)
        found = moving_plate([loop(RADIUS, sides=180)], plate, [plate.centre], [FREQUENCY]).change[0, 0, 0, 0]
        yield found, _elements(radius, thickness, FREQUENCY)


def accuracies() -> list[Accuracy]:
    """Compare ΔL and ΔR of a loop with finite elements about the axis."""
    table, found = "tests/support/axial_plates.py", []
    for what, pairs, limits in (
        ("an infinite copper plate, 2 kHz and 2 MHz", list(_infinite()), (1e-3, 1e-3)),
        ("copper discs, 2 MHz", list(_outlined()), (5e-3, 2e-1)),
    ):
        for part, name, limit in zip(("real", "imag"), ("ΔL", "ΔR"), limits, strict=True):
            worst = max(abs(getattr(one, part) / getattr(other, part) - 1) for one, other in pairs)
            found.append(Accuracy(f"{name} of a loop by {what}", table, len(pairs), float(worst), limit))
    return found


def figures() -> list[Speed]:
    """Measure the map of a disc of 20 mm over the magnetic sheets of gast2020."""
    design = load_design("gast2020")
    height = sum(sheet.thickness for sheet in design.sheets) + 2.5e-3
    disc = FinitePlate("disc", Disc(10e-3), (0.0, 0.0, height), 1e-3, MATERIALS["aluminium"])
    x, y = np.linspace(-26e-3, 26e-3, 27), np.linspace(-6e-3, 6e-3, 7)
    places = [[a, b, height] for b in y for a in x]
    paths, frequencies = design.array.conductors(), [1.4e6, 1.5e6, 1.6e6]
    moving_plate(paths, disc, places[:2], frequencies[:1], design.sheets, fineness=0.3)  # compiles
    start = time.process_time()
    moving_plate(paths, disc, places, frequencies, design.sheets)
    seconds = time.process_time() - start
    what = "map of a disc of 20 mm over magnetic sheets, 27 × 7 positions, six coils"
    note, goal = "three frequencies, processor time", f"≤ {MAP_GOAL:g} s"
    return [Speed(what, seconds, "s", note, goal, seconds <= MAP_GOAL)]
