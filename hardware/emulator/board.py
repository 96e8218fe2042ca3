"""A whole emulated board: converter, switches, coils, indenter, temperature and time."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Protocol

from coilarray.hardware.emulator.adg739_chain import Adg739Chain
from coilarray.hardware.emulator.i2c_bus import EmulatedBus
from coilarray.hardware.emulator.indenter import Indenter, Place
from coilarray.hardware.emulator.ldc1614_chip import CHANNELS, Ldc1614, OpenPoints
from coilarray.hardware.emulator.oscillator import ROOM_TEMPERATURE, Oscillator
from coilarray.hardware.emulator.switch_port import EmulatedSwitches
from coilarray.hardware.emulator.tank import Resonator
from coilarray.hardware.emulator.undocumented import Misuse
from coilarray.hardware.emulator.world import World
from coilarray.hardware.scan.closure import Seen, switch_table, what_is_seen
from coilarray.hardware.wire.buses import Clock

NOISE = 1.4e-7
"""Relative standard deviation of a frequency at full resolution: what a user of the LDC1612 reports at RCOUNT 0x800,
8e-7, by the root of the number of counted cycles. Not verified."""


_CIRCUITS = 256  # kept, since a scan comes back to the same few


class Netlist(Protocol):
    """What the emulator needs of a wiring."""

    @property
    def coils(self) -> tuple[str, ...]:
        """Names of the coils."""

    def encode(self) -> bytes:
        """Eight bytes a device, as `coilarray.hardware.scan.closure.switch_table` reads them."""


@dataclass(frozen=True)
class Drift:
    """Temperature of the board over time.

    Parameters
    ----------
    rate : float
        In K/s.
    sway, period : float
        Amplitude in K and period in s of a swing about it.
    start : float
        Temperature in °C at the time 0.
    """

    rate: float = 0.0
    sway: float = 0.0
    period: float = 600.0
    start: float = ROOM_TEMPERATURE

    def at(self, time: float) -> float:
        """Temperature in °C at a time in s."""
        return self.start + self.rate * time + self.sway * math.sin(2 * math.pi * time / self.period)


@dataclass
class Conditions:
    """What surrounds the converter; may be changed at any time.

    Parameters
    ----------
    oscillator : Oscillator
        Of the converter.
    drift : Drift
        Temperature.
    noise : float
        Relative standard deviation of a frequency at full resolution.
    clkin : float or None
        Frequency at the pin CLKIN in Hz; None where it is grounded.
    """

    oscillator: Oscillator = field(default_factory=Oscillator)
    drift: Drift = field(default_factory=Drift)
    noise: float = NOISE
    clkin: float | None = None


class EmulatedBoard:
    """Converter, switches and coils on one clock. `emulated_board` makes one.

    Parameters
    ----------
    coils : sequence of str
        Names of the coils by their number in the netlist.
    wiring : bytes
        Of the switches, as `switch_table` reads it.
    world : World
        Physics of the coils.
    clock : Clock
        Time.
    conditions : Conditions, optional
        Of the converter.
    channels, open_points, strict, seed
        As in `Ldc1614` and `Misuse`.
    readback : bool
        Whether the end of the chain of switches is wired back.

    Notes
    -----
    `bus` and `switches` are what a driver uses; `chip`, `chain`, `indenter` and `conditions` are for whoever plays the
    board's fate. `misuse.notes` tells what the driver did against the data sheets.
    """

    def __init__(
        self,
        coils: Sequence[str],
        wiring: bytes,
        world: World,
        *,
        clock: Clock,
        conditions: Conditions | None = None,
        channels: int = CHANNELS,
        open_points: OpenPoints | None = None,
        strict: bool = False,
        readback: bool = True,
        seed: int = 0,
    ) -> None:
        self.coils = tuple(coils)
        self.world = world
        self.clock = clock
        self.conditions = conditions or Conditions()
        self.misuse = Misuse(strict)
        self._seen = Seen("open")
        self._solve = lru_cache(maxsize=_CIRCUITS)(lambda closed: what_is_seen(closed, self.coils))
        self.chip = Ldc1614(clock, self, channels=channels, open_points=open_points, misuse=self.misuse, seed=seed)
        self.chain = Adg739Chain(
            switch_table(wiring), before_change=self.chip.advance, after_change=self._switched, readback=readback
        )
        self.indenter = Indenter(self.chip.advance, world.check)
        self.bus = EmulatedBus(self.chip, clock)
        self.switches = EmulatedSwitches(self.chain, clock)

    # ------------------------------------------------- the converter's surroundings

    @property
    def noise(self) -> float:
        """Relative standard deviation of a frequency at full resolution."""
        return self.conditions.noise

    def internal_clock(self, time: float) -> float:
        """Frequency of the converter's own oscillator in Hz."""
        return self.conditions.oscillator.at(time, self.conditions.drift.at(time))

    def external_clock(self, time: float) -> float | None:
        """Frequency at the pin CLKIN in Hz."""
        return self.conditions.clkin

    def sensor(self, channel: int, time: float) -> Resonator | None:
        """Return the tank at a channel of the converter: only the first is wired."""
        if channel != 0:
            return None
        if self._seen.state is None:
            return None
        return self.world.resonator(self._seen.state, self.indenter.at(time), self.conditions.drift.at(time))

    # ------------------------------------------------------------------ for tests

    def seen(self) -> Seen:
        """Say what the converter sees through the switches."""
        return self._seen

    def true_tank(self) -> Resonator | None:
        """Return the tank as it is now, without noise."""
        return self.sensor(0, self.clock.now())

    def place(self) -> Place:
        """Return where the indenter is now."""
        return self.indenter.at(self.clock.now())

    def _switched(self) -> None:
        self._seen = self._solve(self.chain.closed())
        commanded = self._solve(self.chain.commanded())
        if commanded.kind in ("short", "grounded", "tangled"):
            words = self.chain.words.hex()
            self.misuse.remark(f"the words {words} make a circuit that is {commanded.kind}.")  # or a bit slipped
