"""What is behind the switches: coils that oscillate with the tank's capacitor."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

from coilarray.design.scan_states import ScanState
from coilarray.hardware.emulator.indenter import Place
from coilarray.hardware.emulator.tank import Resonator, series_tank


class World(Protocol):
    """Physics of the board."""

    def check(self, place: Place) -> None:
        """Refuse a place where the indenter cannot go; HardwareError."""

    def resonator(self, state: ScanState, place: Place, temperature: float) -> Resonator | None:
        """Return the tank that the converter drives.

        Parameters
        ----------
        state : ScanState
            Which coils it sees and what closes the others.
        place : Place
            Of the indenter.
        temperature : float
            In °C.

        Returns
        -------
        Resonator or None
            None where nothing oscillates.
        """


class FixedCoils:
    """Coils of given inductance that know nothing of each other or of an indenter.

    Parameters
    ----------
    inductances : mapping of str to float
        By coil, in H.
    capacitance : float
        Of the tank in F.
    resistance : float
        Of every coil and its switches in Ω.

    Examples
    --------
    >>> coils = FixedCoils({"coil1": 52.77e-6})
    >>> state = ScanState("coil1", (("coil1", 1),))
    >>> round(coils.resonator(state, Place(0, 0, 0), 25.0).frequency * 1e-6, 3)
    1.999
    """

    def __init__(
        self, inductances: Mapping[str, float], capacitance: float = 120e-12, resistance: float = 20.0
    ) -> None:
        self.inductances = dict(inductances)
        self.capacitance = capacitance
        self.resistance = resistance

    def check(self, place: Place) -> None:
        """Allow every place."""

    def resonator(self, state: ScanState, place: Place, temperature: float) -> Resonator | None:
        """Return the tank of the measured coils."""
        L = [self.inductances[name] for name, _ in state.measured]
        if state.connection == "parallel":
            joined, resistance = 1 / sum(1 / one for one in L), self.resistance / len(L)
        else:
            joined, resistance = sum(L), self.resistance * len(L)
        return series_tank(joined, self.capacitance, resistance)
