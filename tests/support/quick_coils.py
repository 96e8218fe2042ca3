"""Emulated boards of coils of given inductance that know nothing of each other or of an indenter: quick."""

import math

import numpy as np

from coilarray.design.readout import INTERNAL_CLOCK, Readout
from coilarray.hardware.emulator.board import Conditions, EmulatedBoard, VirtualClock
from coilarray.hardware.emulator.ldc1614_chip import Resonator

NOISE = Readout().frequency_noise


def series_tank(inductance, capacitance, resistance):
    """Tank of L and R in series, across C; None where nothing oscillates, R ≥ √(L/C).

    Its resonance is where Im Y = 0: ω² = 1/(LC) − (R/L)², R_p = L/(R C).
    """
    squared = 1 / (inductance * capacitance) - (resistance / inductance) ** 2
    if squared <= 0:
        return None
    frequency = math.sqrt(squared) / (2 * math.pi)
    if resistance == 0:
        return Resonator(frequency, math.inf, math.inf)
    return Resonator(
        frequency, inductance / (resistance * capacitance), 2 * math.pi * frequency * inductance / resistance
    )


class FixedCoils:
    """Coils of given inductance in H by name, each with the same capacitance in F and resistance in Ω."""

    def __init__(self, inductances, capacitance=120e-12, resistance=20.0):
        self.inductances = dict(inductances)
        self.capacitance, self.resistance = capacitance, resistance

    def check(self, place):
        """Any place will do: nothing here depends on it."""

    def resonator(self, state, place, temperature):
        L = [self.inductances[name] for name, _ in state.measured]
        if state.connection == "parallel":
            return series_tank(1 / sum(1 / one for one in L), self.capacitance, self.resistance / len(L))
        return series_tank(sum(L), self.capacitance, self.resistance * len(L))


def plain_board(
    wiring,
    inductances=None,
    *,
    capacitance=120e-12,
    resistance=20.0,
    noise=NOISE,
    drift=0.0,
    oscillator=INTERNAL_CLOCK,
    clock=None,
    clkin=None,
    conditions=None,
    **options,
):
    """An emulated board of fixed coils: 50 µH, 51 µH and so on by default."""
    L = {name: (50 + k) * 1e-6 for k, name in enumerate(wiring.coils)} if inductances is None else inductances
    return EmulatedBoard(
        wiring,
        FixedCoils(L, capacitance, resistance),
        clock=clock or VirtualClock(),
        conditions=conditions or Conditions(oscillator, drift, noise=noise, clkin=clkin),
        **options,
    )


class CoupledCoils:
    """A row of coils of about 52 µH; neighbours couple by 5 %, the next but one by 1 %.

    A coil in `missing` is not there; one in `shorted` has its ends joined.
    """

    def __init__(self, names, *, capacitance=120e-12, resistance=12.0):
        self.names = tuple(names)
        n = len(self.names)
        far = np.abs(np.subtract.outer(np.arange(n), np.arange(n)))
        coupling = np.select([far == 0, far == 1, far == 2], [1.0, 0.05, 0.01], 0.0)
        L = 52e-6 * (1 + 0.004 * np.arange(n))
        self.matrix = coupling * np.sqrt(np.outer(L, L))
        self.capacitance, self.resistance = capacitance, resistance
        self.missing, self.shorted = set(), set()

    def check(self, place):
        """Any place will do: nothing here depends on it."""

    def resonator(self, state, place, temperature):
        measured = [(name, sense) for name, sense in state.measured if name not in self.missing]
        if len(measured) < len(state.measured) or any(name in self.shorted for name, _ in measured):
            return None
        loops = [
            name
            for name in self.names
            if name not in dict(measured)
            and name not in self.missing
            and (state.exceptions.get(name, state.others) == "ground" or name in self.shorted)
        ]
        at = [self.names.index(name) for name, _ in measured]
        sense = np.array([sense for _, sense in measured])
        k = [self.names.index(name) for name in loops]
        reduced = self.matrix[np.ix_(at, at)] - self.matrix[np.ix_(at, k)] @ np.linalg.solve(
            self.matrix[np.ix_(k, k)], self.matrix[np.ix_(k, at)]
        )
        if state.connection == "series":
            L, R = sense @ reduced @ sense, self.resistance * len(at)
        else:
            L, R = 1 / (sense @ np.linalg.inv(reduced) @ sense), self.resistance / len(at)
        return series_tank(float(L), self.capacitance, R)


def coupled_board(wiring, *, noise=1.4e-7, seed=0, world=None):
    """An emulated board of coupled coils that refuses undocumented use."""
    return EmulatedBoard(
        wiring,
        world or CoupledCoils(wiring.coils),
        clock=VirtualClock(),
        conditions=Conditions(noise=noise),
        strict=True,
        seed=seed,
    )
