"""Resonance and losses of an emulated board's coils."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from dataclasses import replace
from functools import cached_property

import numpy as np
import xarray as xr

from coilarray.circuit.network import Network, StateResult, changed_resonances, loaded_quality, resonate, solve_state
from coilarray.compute.arrays import FloatArray
from coilarray.compute.store import Store
from coilarray.compute.threads import Progress
from coilarray.constants import COPPER_PER_KELVIN
from coilarray.design.model import Design
from coilarray.design.scan_states import ScanState
from coilarray.errors import HardwareError, NetworkError
from coilarray.hardware.emulator.board import LIFTED, ROOM_TEMPERATURE, Place
from coilarray.hardware.emulator.ldc1614_chip import Resonator
from coilarray.response import interpolation
from coilarray.response.map import inductance_changes
from coilarray.response.setup import map_axes

SPACING = 1.2e-3
"""Largest distance of positions in m.

For gast2020 the table's inductances are then wrong by 7e-7 (root of the mean square) and at most
2e-6 at 1 mm depth, where they change by up to 1.5e-3 (tests/hardware/test_emulator_world.py).
"""
_PLANES = 6
_DEEPEST = 1.7  # relative to the deepest indentation of the design


def table_axes(design: Design) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Choose the table's depth, y and x in m.

    x and y are at most `SPACING` apart. The axes cover all coils and all positions of the design's
    own map, down to 1.7 times its depth. For a sample with edges they are only the map's positions
    and depth.
    """
    setup = design.indentation
    if setup is None:
        raise HardwareError(f"the design {design.name} has no [indenter] and [indentation]; nothing can press on it.")
    edges = np.array([[min(setup.x), min(setup.y)], [max(setup.x), max(setup.y)]])
    deepest = max(setup.depths)
    if setup.sample_bounds is None:
        deepest *= _DEEPEST
        edges = np.concatenate((edges, interpolation.coil_extent(design)))
    (x_min, y_min), (x_max, y_max) = edges.min(axis=0), edges.max(axis=0)
    depth = deepest * (np.arange(1, _PLANES + 1) / _PLANES) ** 1.5
    return depth, interpolation.even_row(y_min, y_max, SPACING), interpolation.even_row(x_min, x_max, SPACING)


def response_table(
    design: Design,
    store: Store,
    axes: tuple[FloatArray, FloatArray, FloatArray] | None = None,
    *,
    frequency: float | None = None,
    progress: Progress | None = None,
) -> interpolation.ResponseSpline:
    """Change of the inductance matrix in H over the axes.

    It is dented minus flat, and computing it takes 12 s for gast2020. `axes` are depth, y and x in
    m from the map's origin, at least 3 of the first and 4 of the others. The material of an
    indenter counts at a `frequency` in Hz. Its losses do not count.
    """
    depth, y, x = table_axes(design) if axes is None else axes
    if min(len(y), len(x)) < interpolation.LEAST_POSITIONS or len(depth) < interpolation.LEAST_POSITIONS - 1:
        raise HardwareError("a table of the response needs 4 positions along x and y and 3 depths.")

    def compute() -> xr.Dataset:
        change = inductance_changes(design, map_axes(design, depth, x, y), frequency=frequency, progress=progress)
        dims = ("depth", "y", "x", "coil", "other")
        return xr.Dataset({"inductance_change": (dims, change, {"units": "H"})})

    table = store.dataset(("response table", design.digest, depth, y, x, frequency), compute)
    change = table.inductance_change.values.transpose(2, 1, 0, 3, 4)
    return interpolation.response_spline(x, y, depth, change, zero_plane=True, in_root=True)


_TEMPERATURE_STEP = 0.01  # K: it changes a frequency by 2e-8, half a step of the converter's code
_MOST_KEPT = 20_000  # resonators


class SensorWorld:
    """Coils, switches, tank and elastomer of a design.

    `table` returns the change of the inductance matrix over x, y and depth from the map's `origin`,
    in m on the board. `copper` is the relative change of all resistances in 1/K. At room
    temperature and without an indentation it agrees with `coilarray.circuit.coupling.scan_design`.
    With an indentation it solves the same network with the changed inductance matrix, as
    `coilarray.response.map.response_map` does.
    """

    def __init__(
        self,
        network: Network,
        table: Callable[[], interpolation.ResponseSpline],
        origin: tuple[float, float] = (0.0, 0.0),
        *,
        copper: float = COPPER_PER_KELVIN,
    ) -> None:
        self._network, self._make_table, self._origin = network, table, (*origin, 0.0)
        self._copper = copper
        self._untouched: dict[Hashable, tuple[StateResult, float] | None] = {}
        self._found: dict[Hashable, Resonator] = {}

    @cached_property
    def table(self) -> interpolation.ResponseSpline:
        """Change of the inductance matrix over position and depth."""
        return self._make_table()

    def check(self, place: Place) -> None:
        """Refuse a place of the indenter outside the table."""
        outside = self.table.outside(np.array(place)) if place.depth > 0 else None
        if outside is not None:
            axis, value = outside
            edges = (self.table.lower[axis], self.table.upper[axis], value)
            low, high, got = ((self._origin[axis] + edge) * 1e3 for edge in edges)
            where = " on the board" if axis < 2 else ""
            raise HardwareError(
                f"{interpolation.PARAMETERS[axis]} of the emulated indenter must be {low:.4g} to {high:.4g} mm{where}; "
                f"got {got:.4g} mm."
            )

    def resonator(self, state: ScanState, place: Place, temperature: float) -> Resonator | None:
        """Return the tank that the converter drives."""
        seen = (state.measured, state.connection, state.others, *state.exceptions.items())
        if seen not in self._untouched:
            try:
                found = resonate(self._network, state)  # at rest and at room temperature
                self._untouched[seen] = found, loaded_quality(self._network, found)
            except NetworkError:
                self._untouched[seen] = None
        untouched = self._untouched[seen]
        if untouched is None:
            return None
        steps = round((temperature - ROOM_TEMPERATURE) / _TEMPERATURE_STEP)
        key = (seen, place if place.depth > 0 else LIFTED, steps)
        if key not in self._found:
            if len(self._found) >= _MOST_KEPT:
                self._found.clear()
            self._found[key] = self._changed(*untouched, place, steps * _TEMPERATURE_STEP)
        return self._found[key]

    def _changed(self, untouched: StateResult, quality: float, place: Place, warmer: float) -> Resonator:
        if place.depth <= 0 and warmer == 0:
            return Resonator(untouched.frequency, untouched.parallel_resistance, quality)
        network, more = self._network, 1 + self._copper * warmer
        if warmer != 0:
            network = replace(network, resistance=lambda frequency: self._network.resistance(frequency) * more)
        inductance = network.inductance + (self.table.values_at(np.array(place)) if place.depth > 0 else 0.0)
        frequency = float(changed_resonances(network, untouched, inductance[None])[0][0])
        pressed = solve_state(replace(network, inductance=inductance), untouched.state, frequency)
        lossier = pressed.parallel_resistance / untouched.parallel_resistance
        return Resonator(frequency, pressed.parallel_resistance, quality * lossier)
