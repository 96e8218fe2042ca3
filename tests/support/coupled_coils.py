"""Coils that feel each other, for an emulated board: shorted ones lower the inductance of their neighbours."""

import numpy as np

from coilarray.hardware.emulator import Conditions, EmulatedBoard, Oscillator, VirtualClock
from support.quick_coils import series_tank


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
        conditions=Conditions(Oscillator(), noise=noise),
        strict=True,
        seed=seed,
    )
