"""Errors of positions found with an imperfect board and the response table of the nominal board.

The board reads δ + Δδ. Near the truth the likelihood of the table is the likelihood of a linear model with J = ∂δ/∂(x,
y, depth). With the covariance Σ of the noise its maximum is shifted by (JᵀΣ⁻¹J)⁻¹ JᵀΣ⁻¹ Δδ. Unknowns that the reading
hardly determines are left out of J, so they are taken as known. An example is y itself on the middle line of a board
that is symmetric in y.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from coilarray.compute.arrays import FloatArray, IndexArray
from coilarray.errors import LocalizeError
from coilarray.localize.forward import ForwardModel, whitening_of
from coilarray.localize.identifiability import covariance_of, fisher_information
from coilarray.localize.inverse import locate_all
from coilarray.response.interpolation import PARAMETERS
from coilarray.studies.tolerance.tolerances import Positions


@dataclass(frozen=True, eq=False)
class Shifts:
    """Shifts of located positions by errors of the board.

    `model` is the response of the board without errors, and `points` are the true x, y and depth in m, shape (places,
    3). `noise` is the standard deviation of δ. `determined` lists for each place the indices of x, y and depth that a
    reading determines.
    """

    model: ForwardModel
    points: FloatArray
    noise: float | None
    determined: tuple[tuple[int, ...], ...]

    def names(self, places: Sequence[str]) -> tuple[str, ...]:
        """Names of the outputs, place by place."""
        return tuple(
            f"shift_{PARAMETERS[axis]}_mm[{place}]"
            for place, axes in zip(places, self.determined, strict=True)
            for axis in axes
        )

    def undetermined(self, places: Sequence[str]) -> tuple[str, ...]:
        """Return the unknowns that no reading determines, like ``y at x_mm=0,y_mm=0,depth_mm=1``."""
        texts = []
        for place, axes in zip(places, self.determined, strict=True):
            missing = [PARAMETERS[axis] for axis in range(self.model.unknowns) if axis not in axes]
            if missing:
                texts.append(f"{', '.join(missing)} at {place}")
        return tuple(texts)

    def matrix(self) -> FloatArray:
        """Shifts in mm per change of δ, shape (shifts, places · states), zero between places."""
        states = len(self.model.states)
        rows = []
        for k, (point, axes) in enumerate(zip(self.points, self.determined, strict=True)):
            weights = whitening_of(self.model, self.noise, self.model.delta(point), point)
            inverse = np.linalg.pinv(weights.slopes(self.model.jacobian(point)[:, list(axes)]))
            for row in inverse @ weights.slopes(np.eye(states)) * 1e3:
                rows.append(np.zeros(len(self.points) * states))
                rows[-1][k * states : (k + 1) * states] = row
        return np.array(rows).reshape(-1, len(self.points) * states)

    def located(self, changes: FloatArray) -> tuple[FloatArray, IndexArray]:
        """Locate readings with the real solver.

        `changes` is Δδ of n boards relative to the board without errors, finite, shape (n, places · states). The first
        result is the located position minus the true position in mm, shape (n, shifts). It is computed for the mode
        next to the truth, and is NaN if a reading has no mode. The second result is, for each board, the number of
        places whose position is ``"found"``. Other positions are on the border of the table, or have residuals beyond
        noise.
        """
        states = len(self.model.states)
        shifts, found = [], np.zeros(len(changes), dtype=np.intp)
        for k, (point, axes) in enumerate(zip(self.points, self.determined, strict=True)):
            readings = self.model.delta(point) + changes[:, k * states : (k + 1) * states]
            locations = locate_all(self.model, readings, noise=self.noise)
            found += np.array([location.verdict == "found" for location in locations], dtype=bool)
            there = np.full((len(changes), len(axes)), np.nan)
            for row, location in zip(there, locations, strict=True):
                if location.modes:
                    away = np.array([[mode.x, mode.y, mode.depth] for mode in location.modes]) - point
                    nearest = away[np.argmin(np.hypot(away[:, 0], away[:, 1]))]
                    row[:] = nearest[list(axes)] * 1e3
            shifts.append(there)
        return np.hstack(shifts), found


def shifts_at(model: ForwardModel, positions: Positions, largest: float) -> Shifts:
    """Prepare to locate readings at positions within the table.

    Readings have their usual noise. An unknown counts as determined if its standard deviation by noise alone is up to
    `largest` in m. This is a length over which δ changes much and beyond which nothing is linear. Raises LocalizeError
    if a position lies outside the table, or there are fewer states than unknowns.
    """
    points = np.array([(x, y, positions.depth) for y, x in product(positions.y, positions.x)])
    require_states(model.states, model.unknowns)
    information = fisher_information(model, points, positions.noise)
    return Shifts(model, points, positions.noise, tuple(_determined(one, largest) for one in information))


def require_states(states: Sequence[str], unknowns: int) -> None:
    """Raise LocalizeError if there are fewer states than unknowns."""
    if len(states) < unknowns:
        raise LocalizeError(f"{unknowns} unknowns need at least as many states; the scan has {', '.join(states)}.")


def _determined(information: FloatArray, largest: float) -> tuple[int, ...]:
    """Leave out the least known unknowns until the others are known well enough."""
    axes = list(range(len(information)))
    while axes:
        among = information[np.ix_(axes, axes)]
        deviations = np.sqrt(np.diag(covariance_of(among)))
        if deviations.max() <= largest:
            break
        # if the information is singular, all deviations are infinite: then the worst unknown taken alone is left out
        known = np.isfinite(deviations).all()
        del axes[int(np.argmax(deviations) if known else np.argmin(np.diag(among)))]
    return tuple(axes)
