"""Emulated boards of coils of given inductance that know nothing of each other or of an indenter: quick."""

import math

from coilarray.design.readout import Readout
from coilarray.hardware.emulator import Conditions, Drift, EmulatedBoard, Oscillator, VirtualClock
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
    drift=None,
    oscillator=None,
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
        conditions=conditions or Conditions(oscillator or Oscillator(), drift or Drift(), noise, clkin),
        **options,
    )
