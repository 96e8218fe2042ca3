"""Intermediate results of one design, each computed at most once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import xarray as xr

from coilarray.circuit.coupling import design_circuit, design_inductance
from coilarray.circuit.impedance import scan_design
from coilarray.compute.arrays import FloatArray
from coilarray.design.model import Design, Indentation
from coilarray.electromagnetics.inductance import Accuracy, coupling_matrix
from coilarray.errors import GoalError, MetalError
from coilarray.geometry import Margin, Target, check_rules
from coilarray.response.interpolation import coil_extent
from coilarray.response.map import Imperfections, response_map
from coilarray.response.setup import no_indentation, target_of
from coilarray.response.target import target_map

Rectangle = tuple[float, float, float, float]
_CONTACT_ENDS = 4.0  # depths above the tip of an indenter, beyond which it never touches (coilarray.elastomer.contact)


@dataclass(frozen=True, eq=False)
class Evaluation:
    """Intermediate results of a design at an `Accuracy`."""

    design: Design
    accuracy: Accuracy = "full"
    _maps: dict[tuple[tuple[float | str, ...], ...], xr.Dataset] = field(default_factory=dict, init=False, repr=False)
    _unread: list[int] = field(default_factory=list, init=False, repr=False)

    @property
    def unread(self) -> int:
        """Number of used values that the converter cannot read."""
        return sum(self._unread)

    @property
    def judged(self) -> bool:
        """Whether the converter has been checked, or there is none."""
        return bool(self._unread) or not self.design.readout.converter

    def taken(self, found: xr.Dataset) -> xr.Dataset:
        """Return a dataset, and note values that are not readable."""
        if "readable" in found:
            self._unread.append(int((~found.readable).sum()))
        return found

    @cached_property
    def margins(self) -> tuple[Margin, ...]:
        """Margins of the fabrication rules."""
        return check_rules(self.design.array, self.design.rules)

    @cached_property
    def inductance(self) -> FloatArray:
        """Inductances (coils, coils) in H under the flat sheets."""
        return design_inductance(self.design, accuracy=self.accuracy)[0]

    @cached_property
    def coupling(self) -> FloatArray:
        """Coupling coefficients, shape (coils, coils)."""
        return coupling_matrix(self.inductance)

    @cached_property
    def scan(self) -> xr.Dataset:
        """All states of the scan in which the converter oscillates."""
        return self.taken(scan_design(self.design, elastomer=False, accuracy=self.accuracy))

    @cached_property
    def own_states(self) -> dict[str, int]:
        """First state of each coil alone, by coil."""
        states: dict[str, int] = {}
        for k, state in enumerate(self.design.plan):
            if len(state.measured) == 1:
                states.setdefault(state.measured[0][0], k)
        return states

    @property
    def indentation(self) -> Indentation:
        """Indentation of the design, or GoalError."""
        if self.design.indentation is None:
            raise GoalError(no_indentation(self.design))
        return self.design.indentation

    def depth(self, given_mm: float | None) -> float:
        """Return the depth in m, by default the design's first."""
        return self.indentation.depths[0] if given_mm is None else given_mm * 1e-3

    def response(self, depths: FloatArray, x: FloatArray, y: FloatArray) -> xr.Dataset:
        """Response at depths and places from the map's origin."""
        key: tuple[tuple[float | str, ...], ...] = tuple(tuple(np.atleast_1d(axis).tolist()) for axis in (depths, x, y))
        if key not in self._maps:
            circuit = Imperfections(network=design_circuit(self.design, accuracy=self.accuracy))
            found = response_map(self.design, depths=depths, x=x, y=y, imperfections=circuit, accuracy="auto")
            self._maps[key] = self.taken(found)
        return self._maps[key]

    @property
    def target(self) -> Target:
        """Target of the design, or GoalError."""
        try:
            return target_of(self.design)
        except MetalError as error:
            raise GoalError(str(error)) from None

    def distance(self, given_mm: float | None) -> float:
        """Return the target's distance in m, by default the least."""
        return self.target.distances[0] if given_mm is None else given_mm / 1e3

    def target_map(self, distances: Sequence[float], x: float, y: float) -> xr.Dataset:
        """Effect of the target at distances and a place."""
        key = (tuple(distances), (x,), (y,), ("target",))
        if key not in self._maps:
            network = design_circuit(self.design, accuracy=self.accuracy)
            self._maps[key] = target_map(
                self.design, distances=list(distances), x=[x], y=[y], network=network, accuracy=self.accuracy
            )
        return self._maps[key]

    def coil(self, name: str) -> int:
        """Index of a coil, or GoalError."""
        names = self.design.array.names
        if name not in names:
            raise GoalError(f"the design {self.design.name} has no coil {name!r}; there are {', '.join(names)}.")
        return names.index(name)

    def state_of(self, coil: str) -> int:
        """Index of a coil's first state alone, or GoalError."""
        self.coil(coil)
        if coil not in self.own_states:
            raise GoalError(f"the scan of {self.design.name} has no state that measures {coil} alone.")
        return self.own_states[coil]

    def centre(self, coil: str) -> tuple[float, float]:
        """Return a coil's centre in m from the map's origin."""
        x, y = self.design.array.centres[self.coil(coil)] - self.indentation.origin_point
        return float(x), float(y)

    def window(self, depth: float, beyond: float = 0.0) -> Rectangle:
        """Range of the indenter: x_min, x_max, y_min, y_max in m.

        They are from the map's origin, up to `beyond` the coils' outlines with the contact inside
        the sample. Raises GoalError if the sample is too small for the contact.
        """
        least, greatest = self.indentation.reachable(_CONTACT_ENDS * depth)
        low, high = coil_extent(self.design)
        low, high = np.maximum(low - beyond, least), np.minimum(high + beyond, greatest)
        if not (low < high).all():
            raise GoalError(f"the sample of {self.design.name} leaves no room for the indenter over the coils.")
        return float(low[0]), float(high[0]), float(low[1]), float(high[1])
