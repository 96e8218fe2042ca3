"""Physics of an emulated board: resonance and losses of a design's coils under its elastomer."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping
from dataclasses import replace
from functools import cached_property

import numpy as np
import xarray as xr

from coilarray.circuit.network import Network, StateResult, changed_resonances, loaded_quality, resonate, solve_state
from coilarray.compute.arrays import FloatArray
from coilarray.compute.store import Store
from coilarray.compute.threads import Progress
from coilarray.constants import COPPER_PER_KELVIN
from coilarray.design.model import Design, Indentation
from coilarray.design.scan_states import ScanState
from coilarray.errors import HardwareError, NetworkError
from coilarray.hardware.emulator.conditions import LIFTED, ROOM_TEMPERATURE, Place
from coilarray.hardware.emulator.conversion import Resonator
from coilarray.response.interpolation import (
    LEAST_POSITIONS,
    PARAMETERS,
    ResponseSpline,
    coil_extent,
    even_row,
    response_spline,
)
from coilarray.response.map import inductance_changes
from coilarray.response.setup import map_axes

SPACING = 1.2e-3
"""Largest distance of positions in m. For gast2020 the table's inductances are then wrong by 7e-7 (root of the mean
square) and at most 2e-6 at 1 mm depth, where they change by up to 1.5e-3 (tests/hardware/test_emulator_world.py)."""
_PLANES = 6
_DEEPEST = 1.7  # relative to the deepest indentation of the design


class ResponseTable:
    """Changes of the inductance matrix over position and depth.

    They are known at coordinates x, y and depth in m from the map's origin, each of shape (n,). `change`, shape (depth,
    y, x, coil, coil), is the inductance in H, dented minus flat. `origin` is the map's origin on the board in m.
    """

    def __init__(
        self,
        x: FloatArray,
        y: FloatArray,
        depth: FloatArray,
        change: FloatArray,
        origin: tuple[float, float] = (0.0, 0.0),
    ) -> None:
        self._origin = (*origin, 0.0)
        values = change.transpose(2, 1, 0, 3, 4)
        self.spline: ResponseSpline = response_spline(x, y, depth, values, zero_plane=True, in_root=True)

    def check(self, place: Place) -> None:
        """Refuse a place outside the table."""
        outside = self.spline.outside(np.array(place))
        if outside is not None:
            axis, value = outside
            edges = (self.spline.lower[axis], self.spline.upper[axis], value)
            low, high, got = ((self._origin[axis] + edge) * 1e3 for edge in edges)
            where = " on the board" if axis < 2 else ""
            raise HardwareError(
                f"{PARAMETERS[axis]} of the emulated indenter must be {low:.4g} to {high:.4g} mm{where}; "
                f"got {got:.4g} mm."
            )

    def at(self, place: Place) -> FloatArray:
        """Return the change of the inductance matrix in H."""
        return self.spline.values_at(np.array(place))


def table_axes(design: Design) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Choose the axes of the table in m.

    They are depth, y and x, each of the shape (n,). x and y are at most `SPACING` apart. The axes cover all coils and
    all positions of the design's own map, down to 1.7 times its depth. For a sample with edges they are only the map's
    positions and depth.
    """
    setup = _setup(design)
    edges = np.array([[min(setup.x), min(setup.y)], [max(setup.x), max(setup.y)]])
    deepest = max(setup.depths)
    if setup.sample_bounds is None:
        deepest *= _DEEPEST
        edges = np.concatenate((edges, coil_extent(design)))
    (x_min, y_min), (x_max, y_max) = edges.min(axis=0), edges.max(axis=0)
    depth = deepest * (np.arange(1, _PLANES + 1) / _PLANES) ** 1.5
    return depth, even_row(y_min, y_max, SPACING), even_row(x_min, x_max, SPACING)


def response_table(
    design: Design,
    store: Store,
    axes: tuple[FloatArray, FloatArray, FloatArray] | None = None,
    *,
    frequency: float | None = None,
    progress: Progress | None = None,
) -> ResponseTable:
    """Return the response table of a design.

    It is computed if the store does not have it, which takes 12 s for gast2020. `axes` are depth, y and x in m, at
    least 3 of the first and 4 of the others. The default is `table_axes`. The material of an indenter counts at a
    `frequency` in Hz. Its losses do not count.
    """
    origin = _setup(design).origin_point
    depth, y, x = table_axes(design) if axes is None else axes
    if min(len(y), len(x)) < LEAST_POSITIONS or len(depth) < LEAST_POSITIONS - 1:
        raise HardwareError("a table of the response needs 4 positions along x and y and 3 depths.")

    def compute() -> xr.Dataset:
        change = inductance_changes(design, map_axes(design, depth, x, y), frequency=frequency, progress=progress)
        dims = ("depth", "y", "x", "coil", "other")
        return xr.Dataset({"inductance_change": (dims, change, {"units": "H"})})

    table = store.dataset(("response table", design.digest, depth, y, x, frequency), compute)
    return ResponseTable(x, y, depth, table.inductance_change.values, origin)


def _setup(design: Design) -> Indentation:
    if design.indentation is None:
        raise HardwareError(f"the design {design.name} has no [indenter] and [indentation]; nothing can press on it.")
    return design.indentation


_TEMPERATURE_STEP = 0.01  # K: it changes a frequency by 2e-8, half a step of the converter's code
_MOST_KEPT = 20_000  # resonators


class SensorWorld:
    """Coils, switches, tank and elastomer of a design.

    `strays` are capacitances in F across single coils, `copper` and `capacitor` the relative changes in 1/K of all
    resistances and of the tank capacitance, for a class-1 ceramic at most ±30e-6.

    Notes
    -----
    At room temperature and without an indentation it agrees with `coilarray.circuit.impedance.scan_design`. With an
    indentation it solves the same network with the changed inductance matrix, as `coilarray.response.map.response_map`
    does.
    """

    def __init__(
        self,
        network: Network,
        table: Callable[[], ResponseTable],
        *,
        strays: Mapping[str, float] | None = None,
        copper: float = COPPER_PER_KELVIN,
        capacitor: float = 0.0,
    ) -> None:
        given = strays or {}
        for name in given:
            if name not in network.names:
                raise HardwareError(f"strays names the coil {name!r}; there are {', '.join(network.names)}.")
        added = np.array([given.get(name, 0.0) for name in network.names])
        self._network = replace(network, winding_capacitance=network.winding_capacitance + added)
        self._make_table = table
        self._copper, self._capacitor = copper, capacitor
        self._untouched: dict[Hashable, tuple[StateResult, float] | None] = {}
        self._found: dict[Hashable, Resonator] = {}

    @cached_property
    def table(self) -> ResponseTable:
        """Change of the inductance matrix over position and depth."""
        return self._make_table()

    def check(self, place: Place) -> None:
        """Refuse a place of the indenter outside the table."""
        if place.depth > 0:
            self.table.check(place)

    def resonator(self, state: ScanState, place: Place, temperature: float) -> Resonator | None:
        """Return the tank that the converter drives."""
        seen = (state.measured, state.connection, state.others, *state.exceptions.items())
        if seen not in self._untouched:
            self._untouched[seen] = self._resonance(state)
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

    def _resonance(self, state: ScanState) -> tuple[StateResult, float] | None:
        """Solve a state at rest and at room temperature."""
        try:
            found = resonate(self._network, state)
        except NetworkError:
            return None
        return found, loaded_quality(self._network, found)

    def _changed(self, untouched: StateResult, quality: float, place: Place, warmer: float) -> Resonator:
        """Solve a state with indenter and temperature."""
        if place.depth <= 0 and warmer == 0:
            return Resonator(untouched.frequency, untouched.parallel_resistance, quality)
        network = self._warmed(warmer)
        inductance = network.inductance + (self.table.at(place) if place.depth > 0 else 0.0)
        frequency = float(changed_resonances(network, untouched, inductance[None])[0][0])
        pressed = solve_state(replace(network, inductance=inductance), untouched.state, frequency)
        lossier = pressed.parallel_resistance / untouched.parallel_resistance
        return Resonator(frequency, pressed.parallel_resistance, quality * lossier)

    def _warmed(self, difference: float) -> Network:
        """Network at a temperature difference from room temperature in K."""
        if difference == 0:
            return self._network
        network, more = self._network, 1 + self._copper * difference
        capacitance = network.switches.tank_capacitance * (1 + self._capacitor * difference)
        return replace(
            network,
            resistance=lambda frequency: network.resistance(frequency) * more,
            switches=replace(network.switches, tank_capacitance=capacitance),
        )
