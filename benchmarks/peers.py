"""Field of straight segments against installed peers, and arrays of many coils: ratios in one run."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from speed import Speed, not_installed

from coilarray import inductance_matrix, load_design, magnetic_field
from coilarray.circuit.network_files import fasthenry_input
from coilarray.compute.arrays import FloatArray
from coilarray.electromagnetics.field import vector_potential
from coilarray.geometry import Conductor

_REPEATS = 7


def _paired(ours: Callable[[], object], theirs: Callable[[], object], repeats: int = _REPEATS) -> tuple[float, float]:
    """Median time of each in s, run in turn so that both meet the same machine."""
    times: tuple[list[float], list[float]] = ([], [])
    for call in (ours, theirs):
        call()
    for _ in range(repeats):
        for call, kept in zip((ours, theirs), times, strict=True):
            start = time.perf_counter()
            call()
            kept.append(time.perf_counter() - start)
    first, second = (float(np.median(kept)) for kept in times)
    return first, second


def _peer(what: str, pairs: int, times: tuple[float, float], difference: float, name: str, least: float) -> Speed:
    ours, theirs = times
    note = f"{name} {pairs / theirs / 1e6:.0f} M pairs/s; the results differ by {difference:.0e}"
    return Speed(f"{what} against {name}", theirs / ours, "×", note, f"≥ {least:g} ×", theirs / ours >= least)


def kernels() -> Iterator[Speed | None]:
    """B and A of the six coils at random points above them.

    There are so many that it does not count how the threads of one library still spin when the turn is the other's.
    """
    points = np.random.default_rng(0).uniform([-0.04, -0.012, 0.002], [0.04, 0.012, 0.01], (100_000, 3))
    conductors = load_design("gast2020").array.conductors()
    yield _against_cfsem("B, exact", magnetic_field, "flux_density_linear_filament", conductors, points)
    yield _against_cfsem("A, exact", vector_potential, "vector_potential_linear_filament", conductors, points)
    yield _against_simsopt(conductors, points)


def _segments(conductors: tuple[Conductor, ...]) -> tuple[FloatArray, FloatArray]:
    starts = np.concatenate([conductor.vertices[:-1] for conductor in conductors])
    return starts, np.concatenate([np.diff(conductor.vertices, axis=0) for conductor in conductors])


def _against_cfsem(
    what: str, ours: Callable[..., FloatArray], name: str, conductors: tuple[Conductor, ...], points: FloatArray
) -> Speed | None:
    try:
        import cfsem
    except ImportError:
        return not_installed("cfsem")
    starts, steps = _segments(conductors)
    at, begin, along = (tuple(np.ascontiguousarray(axis) for axis in array.T) for array in (points, starts, steps))

    def theirs() -> FloatArray:
        return np.array(getattr(cfsem, name)(at, begin, along, np.ones(len(starts)), par=True)).T

    exact = ours(conductors, points)
    difference = float(np.abs(theirs() - exact).max() / np.abs(exact).max())
    times = _paired(lambda: ours(conductors, points), theirs)
    return _peer(what, len(starts) * len(points), times, difference, "cfsem", 3.0)


def _against_simsopt(conductors: tuple[Conductor, ...], points: FloatArray) -> Speed | None:
    """Its sum over the middles of the segments, which is far off where a point is near one."""
    try:
        import simsoptpp
    except ImportError:
        return not_installed("simsopt")
    starts, steps = _segments(conductors)
    middles, lines = [starts + 0.5 * steps], [steps * len(steps)]  # it takes the mean over the nodes

    def theirs() -> FloatArray:
        return np.asarray(simsoptpp.biot_savart_B(points, middles, lines, [1.0]))

    exact = magnetic_field(conductors, points)
    difference = float(np.abs(theirs() - exact).max() / np.abs(exact).max())
    times = _paired(lambda: magnetic_field(conductors, points), theirs)
    return _peer("B, exact,", len(starts) * len(points), times, difference, "simsopt's midpoints", 1.3)


def fasthenry() -> Iterator[Speed | None]:
    """L matrix of the six coils against a program on the PATH, which is on no package index.

    Its time is that of the process, which reads a file and writes one. It sums all pairs of segments: with multipoles
    it would be 5e-4 off for such coils.
    """
    conductors = load_design("gast2020").array.conductors()
    program = shutil.which("fasthenry")
    if program is None:
        yield not_installed("FastHenry")
        return
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "coils.inp").write_text(fasthenry_input(conductors, 1.0), encoding="utf-8")  # at 1 Hz

        def theirs() -> None:
            command = [program, "-s", "ludecomp", "-m", "direct", "coils.inp"]
            subprocess.run(command, cwd=folder, check=True, capture_output=True)

        ours_taken, taken = _paired(lambda: inductance_matrix(conductors), theirs)
        _, _, matrix = (Path(folder) / "Zc.mat").read_text(encoding="utf-8").partition("Impedance matrix")
    exact = inductance_matrix(conductors)
    reactance = np.reshape([float(value) for value in re.findall(r"([-+][\d.e+-]+)j", matrix)], exact.shape)
    difference = float(np.abs(reactance / (2 * np.pi) - exact).max() / np.abs(exact).max())
    note = f"FastHenry {taken:.2g} s on one core; the results differ by {difference:.0e}"
    yield Speed("L matrix of six coils, against FastHenry", taken / ours_taken, "×", note)


_LATTICE = """
import sys, time
import numpy as np
sys.path.insert(0, {folder!r})
from coilarray import inductance_matrix
from peers import lattice
from speed import peak_memory
coils = lattice(32)
inductance_matrix(coils[:2])
start = time.perf_counter()
L = inductance_matrix(coils)
taken = time.perf_counter() - start
start = time.perf_counter()
np.linalg.inv(25.0 * np.eye(len(L)) + 4e6j * np.pi * L)  # admittances of the ports
print(taken, time.perf_counter() - start, peak_memory())
"""


def lattice(rows: int, spread: float = 0.0) -> list[Conductor]:
    """Coils of the gast2020 board on a triangular lattice, each moved at random by up to `spread` m."""
    winding = load_design("gast2020").array.conductors()[0]
    moves = np.random.default_rng(1).uniform(-spread, spread, (rows, rows, 2))
    pitch = 13.28e-3
    coils = []
    for r in range(rows):
        for c in range(rows):
            x, y = (c + 0.5 * (r % 2)) * pitch + moves[r, c, 0], r * pitch * np.sqrt(0.75) + moves[r, c, 1]
            z = -0.5e-3 * ((c - r // 2) % 2 + 2 * (r % 2))  # four pairs of layers: coils on one are two pitches apart
            vertices = winding.vertices + np.array([x, y, z])
            coils.append(Conductor(vertices, winding.widths, winding.thicknesses, winding.areas))
    return coils


def large_arrays() -> Iterator[Speed]:
    """Matrix and grounded neighbours of 1024 coils, and how the time of irregular placements grows."""
    code = _LATTICE.format(folder=str(Path(__file__).parent))
    done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    matrix, grounded, memory = map(float, done.stdout.split())
    yield Speed("L matrix of 1024 coils on a lattice", matrix, "s", "", "≤ 20 s", matrix <= 20)
    yield Speed("peak memory of it", memory, "MB", "", "≤ 1500 MB", memory <= 1500)
    yield Speed("effective inductance of every one of 1024 coils, all others grounded", grounded, "s")
    counts, times = (49, 100, 196, 400), []
    for count in counts:
        coils = lattice(round(count**0.5), spread=0.5e-3)
        start = time.perf_counter()
        inductance_matrix(coils)
        times.append(time.perf_counter() - start)
    growth = float(np.polyfit(np.log(counts), np.log(times), 1)[0])
    note = ", ".join(f"{count} coils {taken:.1f} s" for count, taken in zip(counts, times, strict=True))
    yield Speed("irregular placements: time grows as n to the power", growth, "", note, "≤ 1.3", growth <= 1.3)
