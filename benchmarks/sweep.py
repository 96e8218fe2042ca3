"""Sweeps: candidates per second of one core, and what a second worker adds, on the bundled gast2020 board."""

from __future__ import annotations

import time
from collections.abc import Sequence
from concurrent.futures import Executor
from contextlib import ExitStack

import numpy as np
from speed import Speed

from coilarray import load_design
from coilarray.compute.threads import cores
from coilarray.compute.workers import open_executor
from coilarray.electromagnetics.inductance import Accuracy
from coilarray.studies.sweep import evaluate_points

COUPLING = ("worst_k", "rms_k")
RESPONSE = ("worst_k", "peak_delta", "response_width_mm[coil3]")
PITCHES = (11.0, 16.0)  # mm, in which random candidates lie
WARM, ROUNDS = 6, 5  # candidates before a clock runs; runs, of which the middle one counts


def _candidates(count: int, seed: int) -> list[dict[str, float]]:
    pitches = np.random.default_rng(seed).uniform(*PITCHES, size=count)
    return [{"array.pitch_mm": round(pitch, 6)} for pitch in pitches.tolist()]


def _times(
    executor: Executor, quantities: Sequence[str], count: int, seed: int, accuracy: Accuracy
) -> tuple[float, float]:
    """Return the time and this process's processor time in s of candidates, nothing cached; none may fail."""
    design = load_design("gast2020")
    start = time.perf_counter(), time.process_time()
    points = evaluate_points(design, _candidates(count, seed), quantities, executor, accuracy=accuracy)
    failed = [outcome for _, outcome in points if isinstance(outcome, str)]
    if failed:
        raise RuntimeError(failed[0])
    return time.perf_counter() - start[0], time.process_time() - start[1]


def _rate(executor: Executor, quantities: Sequence[str], count: int, accuracy: Accuracy) -> tuple[float, str]:
    """Return candidates per second of processor time, the median of some runs, and what the clock says of it."""
    _times(executor, quantities, 2, 0, accuracy)
    runs = sorted(
        (_times(executor, quantities, count, seed, accuracy) for seed in range(1, ROUNDS + 1)), key=lambda run: run[1]
    )
    by_clock, by_processor = runs[ROUNDS // 2]
    return count / by_processor, f"{count / by_clock:.2g}/s by the clock"


def _speedup(count: int) -> tuple[float, str]:
    """Return how much faster two workers are than one, in turns within one run, and the rates of that run."""
    runs = []
    with ExitStack() as stack:
        executors = [stack.enter_context(open_executor(number)) for number in (1, 2)]
        for executor in executors:
            _times(executor, COUPLING, WARM, 0, "screen")
        for seed in range(1, ROUNDS + 1):
            one, two = (count / _times(executor, COUPLING, count, seed, "screen")[0] for executor in executors)
            runs.append((two / one, f"{one:.3g}/s and {two:.3g}/s by the clock"))
    return sorted(runs)[ROUNDS // 2]


def figures() -> list[Speed]:
    """Take all figures; about a minute."""
    with open_executor() as executor:
        coupling, clock = _rate(executor, COUPLING, 40, "screen")
        full, _ = _rate(executor, COUPLING, 4, "full")
        response, response_clock = _rate(executor, RESPONSE, 2, "screen")
    ratio, rates = _speedup(60)
    alone = cores() < 2
    return [
        Speed(
            "candidates with coupling, one core", coupling, "1/s",
            f"processor time; {clock}; to full accuracy {full:.2g}/s", "≥ 20/s", coupling >= 20,
        ),
        Speed(
            "candidates with response, one core", response, "1/s", f"processor time; {response_clock}",
            "≥ 0.3/s", response >= 0.3,
        ),
        Speed("two workers over one, coupling", ratio, "×", rates, "≥ 1.7", alone or ratio >= 1.7),
    ]  # fmt: skip


if __name__ == "__main__":
    for figure in figures():
        print(f"{figure.what}: {figure.value:.3g} {figure.unit} ({figure.note}) {figure.goal} {figure.kept}")
