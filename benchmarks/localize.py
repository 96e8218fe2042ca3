"""Position and depth of an indentation on gast2020: table, speed, coverage, and accuracy where the board allows it.

Truths are responses of the map itself at seeded positions and depths between those of the table. The goal is
|x error| ≤ 0.1 mm and a depth error ≤ 3 %, both at 95 %, at depths of 0.5 to 1.5 mm; it is allowed at a place where
1.96 standard deviations of the Cramér–Rao bound are within both.

    python benchmarks/localize.py
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from speed import Speed

from coilarray import load_design, response_map
from coilarray.compute.arrays import FloatArray
from coilarray.localize.forward import ForwardModel, forward_model, table_grid
from coilarray.localize.identifiability import covariance_of, fisher_information
from coilarray.localize.inverse import Location, deviance, locate_all

NOISE = 1e-5  # of the goal
QUIET = 3e-7  # at which the board allows it in many places
FARTHEST, DEEPER = 0.1e-3, 0.03
REGION = 7.814727903251179  # 95 % of χ² with 3 degrees of freedom
SEED = 2020
DEPTHS = (0.5e-3, 1.5e-3, 8)
ENDS = ((-20e-3, 60e-3, 40), (-9e-3, 9e-3, 8))  # x and y


@dataclass(frozen=True, eq=False)
class Trial:
    """Model of the board, and what the response map says between its positions: points (n, 3) in m, δ (n, 6)."""

    model: ForwardModel
    points: FloatArray
    delta: FloatArray

    def readings(self, noise: float) -> FloatArray:
        """Return noisy δ of all points, shape (n, 6)."""
        return self.delta + noise * np.random.default_rng(SEED).standard_normal(self.delta.shape)

    def bound(self, noise: float) -> FloatArray:
        """Return the least standard deviations of the unknowns in m, shape (n, unknowns)."""
        variance = covariance_of(fisher_information(self.model, self.points, noise))
        return np.sqrt(np.diagonal(variance, axis1=1, axis2=2))

    def bearable(self) -> FloatArray:
        """Return the largest noise at which the goal is allowed at every point, shape (n,)."""
        sigma = self.bound(1.0)
        return np.minimum(FARTHEST / (1.96 * sigma[:, 0]), DEEPER * self.points[:, 2] / (1.96 * sigma[:, 2]))


def _spread(low: float, high: float, count: int, random: np.random.Generator) -> FloatArray:
    """One random number in each of `count` equal parts of an interval."""
    return low + (high - low) * (np.arange(count) + random.uniform(size=count)) / count


def _trial(depths: FloatArray, table_depths: FloatArray | None = None) -> tuple[Trial, float]:
    """Truths at depths, the table of the board (its own depths by default), and the table's processor time in s."""
    design, random = load_design("gast2020"), np.random.default_rng(SEED)
    own, along, across = table_grid(design, deepest=1.7e-3)
    start = time.process_time()
    table = response_map(design, depths=own if table_depths is None else table_depths, x=along, y=across)
    seconds = time.process_time() - start
    x, y = (_spread(*ends, random) for ends in ENDS)
    truth = response_map(design, depths=depths, x=x, y=y)
    points = np.stack(np.meshgrid(depths, y, x, indexing="ij")[::-1], axis=-1).reshape(-1, 3)
    return Trial(forward_model(table), points, truth.delta.values.reshape(len(points), -1)), seconds


def _coverage(trial: Trial, noise: float, readings: FloatArray, found: list[Location]) -> float:
    """Share of the readings with a mode whose likelihood region holds the truth."""
    held = [
        deviance(trial.model, reading, location, point, noise=noise).item() <= REGION
        for reading, location, point in zip(readings, found, trial.points, strict=True)
        if location.modes
    ]
    return float(np.mean(held))


def _errors(trial: Trial, found: list[Location], kept: npt.NDArray[np.bool_]) -> tuple[float, float]:
    """95 % of the x errors in m and of the relative depth error, best modes, at the points that are kept."""
    pairs = [
        (location.best.x - point[0], location.best.depth / point[2] - 1)
        for location, point, use in zip(found, trial.points, kept, strict=True)
        if use and location.modes
    ]
    x, depth = np.quantile(np.abs(pairs), 0.95, axis=0)
    return float(x), float(depth)


def _at_the_goals_noise(board: Trial) -> list[Speed]:
    readings = board.readings(NOISE)
    locate_all(board.model, readings[:10])
    start, wall = time.process_time(), time.perf_counter()
    found = locate_all(board.model, readings, noise=NOISE)
    rate, by_clock = (len(found) / (clock() - begun) for clock, begun in (
        (time.process_time, start), (time.perf_counter, wall)
    ))  # fmt: skip
    covered = _coverage(board, NOISE, readings, found)
    verdicts = ", ".join(
        f"{sum(one.verdict == name for one in found)} {name}" for name in sorted({one.verdict for one in found})
    )
    every = np.ones(len(found), dtype=bool)
    x, depth = _errors(board, found, every)
    sigma = np.median(board.bound(NOISE), axis=0) * 1e3
    share = float(np.mean(board.bearable() >= NOISE))
    places = f"{len(found)} seeded places and depths between the points of the table, noise {NOISE:.0e}"
    heard = np.bincount((np.abs(board.delta) > 5 * NOISE).sum(axis=1)).tolist()
    coils = ", ".join(f"{k} at {count}" for k, count in enumerate(heard))
    medians = f"x {sigma[0]:.2f} mm, y {sigma[1]:.2f} mm, depth {sigma[2]:.2f} mm"
    why = f"coils that respond with more than 5 σ: {coils}; medians of the bound: {medians}"
    return [
        Speed(
            "positions and depths solved by one core", rate, "1/s", f"processor time; {by_clock:.0f}/s by the clock",
            "≥ 500/s", rate >= 500,
        ),
        Speed(
            "coverage of the joint 95 % regions", 100 * covered, "%", f"{places}; {verdicts}",
            "92–98 %", 0.92 <= covered <= 0.98,
        ),
        Speed("places where the bound allows 0.1 mm and 3 %", 100 * share, "%", f"{places}; {why}"),
        Speed("95 % of the x errors, all places", x * 1e3, "mm", f"{places}; depth {100 * depth:.0f} %"),
    ]  # fmt: skip


def _where_allowed(board: Trial) -> list[Speed]:
    bearable, depth = board.bearable(), board.points[:, 2]
    half = ", ".join(
        f"{np.median(bearable[depth == one]):.1e} at {one * 1e3:.2f} mm" for one in np.unique(depth)[[0, 4, -1]]
    )
    allowed = bearable >= QUIET
    count = int(allowed.sum())
    readings = board.readings(QUIET)
    found = locate_all(board.model, readings, noise=QUIET)
    x, relative = _errors(board, found, allowed)
    covered = f"coverage {100 * _coverage(board, QUIET, readings, found):.1f} % of all"
    return [
        Speed("largest noise at which any place allows 0.1 mm and 3 %", float(bearable.max()), "", f"half: {half}"),
        Speed(
            f"95 % of the x errors where allowed, noise {QUIET:.0e}", x * 1e3, "mm", f"{count} places; {covered}",
            "≤ 0.1 mm", count >= 200 and x <= FARTHEST,
        ),
        Speed(
            f"95 % of the depth error there, noise {QUIET:.0e}", 100 * relative, "%", f"{count} places",
            "≤ 3 %", count >= 200 and relative <= DEEPER,
        ),
    ]  # fmt: skip


def _known_depth() -> Speed:
    """Take the paper's task: x and y at one depth that is known."""
    known, _ = _trial(np.array([1e-3]), np.array([1e-3]))
    found = locate_all(known.model, known.readings(NOISE), noise=NOISE)
    x, _ = _errors(known, found, np.ones(len(found), dtype=bool))
    sigma = known.bound(NOISE)[:, 0]
    note = f"{len(found)} places, noise {NOISE:.0e}; median of the bound {np.median(sigma) * 1e3:.2f} mm"
    return Speed("95 % of the x errors at a known depth of 1 mm", x * 1e3, "mm", note)


def figures() -> list[Speed]:
    """Take all figures; a minute or two."""
    response_map(load_design("gast2020"), x=[0.0], y=[0.0])  # compiles
    board, seconds = _trial(_spread(*DEPTHS, np.random.default_rng(SEED + 1)))
    error = float(np.abs(board.model.delta(board.points) - board.delta).max())
    size = f"{len(board.model.x)} × {len(board.model.y)} positions, 6 depths, processor time"
    return [
        Speed("table of gast2020 for positions", seconds, "s", size),
        Speed(
            "its error in δ",
            error,
            "",
            f"{len(board.points)} places between the points of the table",
            "< 2e-6",
            error < 2e-6,
        ),
        *_at_the_goals_noise(board),
        *_where_allowed(board),
        _known_depth(),
    ]


if __name__ == "__main__":
    for figure in figures():
        print(f"{figure.what}: {figure.value:.3g} {figure.unit} ({figure.note}) {figure.goal} {figure.kept}")
