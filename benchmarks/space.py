"""Coils in space: a thousand poses of six coils against another, and 32 tilted loops against each other."""

from __future__ import annotations

import math
import time
import tracemalloc
from collections.abc import Callable
from functools import cache

import numpy as np
from accuracy import Accuracy
from speed import Speed

from coilarray import Array, Conductor, inductance_matrix, load_design, mutual_inductance, self_inductance
from coilarray.compute.arrays import FloatArray
from coilarray.compute.threads import cores
from coilarray.electromagnetics.motion import moved_inductance
from coilarray.geometry import Pose

POSES, LOOPS, SIDES, EXACT = 1000, 32, 48, 10
HEAD, RADIUS = 0.1, 25e-3  # m, of the helmet and of its loops


def _helmet() -> list[Conductor]:
    """Return loops that lie evenly over most of a sphere."""
    turn = 2 * math.pi * np.arange(SIDES + 1) / SIDES
    circle = RADIUS * np.column_stack((np.cos(turn), np.sin(turn), 0 * turn))
    circle[-1] = circle[0]
    loop, loops = Conductor(circle, 1e-3, 35e-6), []
    for k in range(LOOPS):
        down, around = math.acos(1 - 1.2 * (k + 0.5) / LOOPS), k * math.pi * (3 - math.sqrt(5))
        tilt = Pose(turn=(0.0, down, around))
        loops.append(loop.posed(Pose(*(HEAD * tilt.rotation[:, 2]).tolist(), tilt.turn)))
    return loops


def _processor_time(call: Callable[[], object]) -> float:
    """Return the time in s that a call needs on as many cores as there are, without other programs."""
    start = time.process_time()
    call()
    return (time.process_time() - start) / cores()


def _memory(call: Callable[[], object]) -> float:
    """Return the largest memory in MB of the arrays that a call makes."""
    tracemalloc.start()
    call()
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return peak / 1e6


@cache
def _scene() -> tuple[Array, Conductor, list[Pose], FloatArray, float]:
    """Return six coils, another coil, its poses, M in H at some of them by all bars, and the time of these in s."""
    array = load_design("gast2020").array
    coil = array.conductors()[0]
    coil = coil.posed(Pose(*(-coil.centre).tolist()))
    places = np.random.default_rng(0).uniform(
        (-30e-3, -10e-3, 1e-3, -0.2, -0.2, -3), (30e-3, 10e-3, 20e-3, 0.2, 0.2, 3), (POSES, 6)
    )
    poses = [Pose(x, y, z + 14e-3 * (abs(a) + abs(b)), (a, b, c)) for x, y, z, a, b, c in places.tolist()]
    mutual_inductance(array, coil.posed(poses[0]))
    found: list[FloatArray] = []
    few = poses[:: POSES // EXACT]
    took = _processor_time(lambda: found.extend(mutual_inductance(array, coil.posed(pose))[:, 0] for pose in few))
    return array, coil, poses, np.array(found), took / len(few)


def accuracies() -> list[Accuracy]:
    """Compare M at some poses with the sum over all bars; half a minute."""
    array, coil, poses, exact, _ = _scene()
    moved = moved_inductance(array, coil, poses[:: POSES // EXACT])[:, :, 0]
    worst = float(np.abs(moved - exact).max() / float(self_inductance(coil)[0]))
    return [Accuracy("M of coils in any pose, of the larger L", "mutual_inductance", exact.size, worst, 1e-4)]


def figures() -> list[Speed]:
    """Take the figures; half a minute."""
    array, coil, poses, _, exact = _scene()
    moved_inductance(array, coil, poses[:2])
    moving = _processor_time(lambda: moved_inductance(array, coil, poses))
    few, all_of_them = (
        _memory(lambda poses=poses: moved_inductance(array, coil, poses)) for poses in (poses[: POSES // 4], poses)
    )
    loops = _helmet()
    inductance_matrix(loops[:2], allow_overlaps=True)
    matrix = _processor_time(lambda: inductance_matrix(loops, allow_overlaps=True))
    what = f"M of six coils with another at {POSES} poses, 1 to 20 mm apart, per core"
    faster = f"{exact * POSES / moving:.0f} × faster than mutual_inductance"
    quarter = f"{few:.3g} MB at {POSES // 4} poses"
    return [
        Speed(what, moving, "s", faster, "≤ 5 s", moving <= 5),
        Speed(f"memory for M at these {POSES} poses", all_of_them, "MB", quarter, "≤ 50 MB", all_of_them <= 50),
        Speed(f"L matrix of {LOOPS} tilted loops of {SIDES} sides, per core", matrix, "s", "", "≤ 1 s", matrix <= 1),
    ]
