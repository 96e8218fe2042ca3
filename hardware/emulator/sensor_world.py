"""The coils of a design under its elastomer: frequency and losses of what the converter drives, by our own physics."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping
from dataclasses import replace
from functools import cached_property

import numpy as np

from coilarray.circuit.network import Network, StateResult, loaded_quality, resonances_near, resonate, solve_state
from coilarray.design.scan_states import ScanState
from coilarray.errors import HardwareError, NetworkError
from coilarray.hardware.emulator.indenter import LIFTED, Place
from coilarray.hardware.emulator.oscillator import ROOM_TEMPERATURE
from coilarray.hardware.emulator.response_table import ResponseTable
from coilarray.hardware.emulator.tank import Resonator

COPPER = 3.93e-3
"""Relative change of copper's resistance in 1/K."""
_TEMPERATURE_STEP = 0.01  # K: 2e-8 of a frequency, half a step of the converter's code
_MOST_KEPT = 20_000  # resonators


class SensorWorld:
    """Coils, switches, tank and elastomer of a design.

    Parameters
    ----------
    network : Network
        As `coilarray.hardware.scan.board_network.board_network` returns it.
    table : callable
        Returns the response table; called when the indenter is pressed for the first time.
    strays : mapping of str to float, optional
        Capacitance across single coils in F that the design does not know.
    copper : float
        Relative change of all resistances in 1/K.
    capacitor : float
        Relative change of the tank's capacitance in 1/K; a class-1 ceramic has at most 30e-6 of either sign.

    Raises
    ------
    HardwareError
        A stray of a coil that is not there.

    Notes
    -----
    At room temperature and untouched it is `coilarray.circuit.impedance.scan_design`. Pressed, the resonance of the
    same network with the changed inductance matrix is found, as `coilarray.response.map.response_map` does it.
    """

    def __init__(
        self,
        network: Network,
        table: Callable[[], ResponseTable],
        *,
        strays: Mapping[str, float] | None = None,
        copper: float = COPPER,
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
        """Changes of the inductance matrix."""
        return self._make_table()

    def check(self, place: Place) -> None:
        """Refuse a place of the indenter that is not in the table; HardwareError."""
        if place.depth > 0:
            self.table.check(place)

    def resonator(self, state: ScanState, place: Place, temperature: float) -> Resonator | None:
        """Return the tank that the converter drives; None where the circuit has no resonance."""
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
        """Solve a state untouched and at room temperature, with the quality of the whole resonator."""
        try:
            found = resonate(self._network, state)
        except NetworkError:
            return None
        return found, loaded_quality(self._network, found)

    def _changed(self, untouched: StateResult, quality: float, place: Place, warmer: float) -> Resonator:
        """Solve a state with the indenter at a place and the board warmer by a difference in K."""
        if place.depth <= 0 and warmer == 0:
            return Resonator(untouched.frequency, untouched.parallel_resistance, quality)
        network = self._warmed(warmer)
        inductance = network.inductance + (self.table.at(place) if place.depth > 0 else 0.0)
        frequency = float(resonances_near(network, untouched, inductance[None])[0])
        pressed = solve_state(replace(network, inductance=inductance), untouched.state, frequency)
        lossier = pressed.parallel_resistance / untouched.parallel_resistance
        return Resonator(frequency, pressed.parallel_resistance, quality * lossier)

    def _warmed(self, difference: float) -> Network:
        if difference == 0:
            return self._network
        network, more = self._network, 1 + self._copper * difference
        capacitance = network.switches.tank_capacitance * (1 + self._capacitor * difference)
        return replace(
            network,
            resistance=lambda frequency: network.resistance(frequency) * more,
            switches=replace(network.switches, tank_capacitance=capacitance),
        )
