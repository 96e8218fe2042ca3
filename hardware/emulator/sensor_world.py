"""Physics of an emulated board.

It computes the resonance and losses of a design's coils under its elastomer.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from coilarray.circuit.network import Network, StateResult, changed_resonances, loaded_quality, resonate, solve_state
from coilarray.constants import COPPER_PER_KELVIN
from coilarray.design.scan_states import ScanState
from coilarray.errors import HardwareError, NetworkError
from coilarray.hardware.emulator.conditions import ROOM_TEMPERATURE
from coilarray.hardware.emulator.conversion import Resonator
from coilarray.hardware.emulator.indenter import LIFTED, Place

if TYPE_CHECKING:
    from coilarray.hardware.emulator.response_table import ResponseTable

_TEMPERATURE_STEP = 0.01  # K: it changes a frequency by 2e-8, half a step of the converter's code
_MOST_KEPT = 20_000  # resonators


class SensorWorld:
    """Coils, switches, tank and elastomer of a design.

    Parameters
    ----------
    network : Network
        Circuit of the board, as `coilarray.hardware.scan.board_network.board_network` returns it.
    table : callable
        Returns the response table. It is called when the indenter is pressed for the first time.
    strays : mapping of str to float, optional
        Additional capacitance across single coils in F, by name of the coil.
    copper : float
        Relative change of all resistances with temperature in 1/K.
    capacitor : float
        Relative change of the tank capacitance with temperature in 1/K, at most ±30e-6 for a class-1 ceramic.

    Raises
    ------
    HardwareError
        A stray capacitance of a coil that does not exist.

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
        """Refuse a place of the indenter outside the table.

        It raises a HardwareError.
        """
        if place.depth > 0:
            self.table.check(place)

    def resonator(self, state: ScanState, place: Place, temperature: float) -> Resonator | None:
        """Return the tank that the converter drives.

        None is returned if the circuit has no resonance.
        """
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
        """Solve a state at rest and at room temperature.

        The quality factor of the whole tank is returned with it.
        """
        try:
            found = resonate(self._network, state)
        except NetworkError:
            return None
        return found, loaded_quality(self._network, found)

    def _changed(self, untouched: StateResult, quality: float, place: Place, warmer: float) -> Resonator:
        """Solve a state with indenter and temperature.

        The indenter is at a place, and `warmer` is the board's excess over room temperature in K.
        """
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
