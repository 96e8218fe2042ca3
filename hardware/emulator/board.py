"""A whole emulated board.

It has a converter, switches, coils, an indenter, a temperature and a time.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Protocol

from coilarray.design.scan_states import ScanState, Switches
from coilarray.hardware.chips.converters import CONVERTERS, Converter
from coilarray.hardware.emulator.conditions import Conditions
from coilarray.hardware.emulator.conversion import Resonator
from coilarray.hardware.emulator.indenter import Indenter, Place
from coilarray.hardware.emulator.ldc1614_chip import EmulatedBus, Ldc1614, Misuse, OpenPoints
from coilarray.hardware.emulator.switches import EmulatedChain, EmulatedSwitches
from coilarray.hardware.scan.closure import Drains, Seen, switch_table, what_is_seen
from coilarray.hardware.wire.buses import Clock

_CIRCUITS = 256  # number of solved circuits to keep; a scan repeats the same few


class Netlist(Protocol):
    """Properties of a wiring that the emulator needs."""

    @property
    def coils(self) -> tuple[str, ...]:
        """Names of the coils."""

    @property
    def channels(self) -> tuple[int, ...]:
        """Channels of the coils.

        They are empty if there are switches.
        """

    def encode(self) -> bytes:
        """Return eight bytes per device.

        `coilarray.hardware.scan.closure.switch_table` reads them.
        """

    @property
    def drains(self) -> Sequence[Drains]:
        """Bits of every device that share a common pin.

        The devices are in the order of the words.
        """

    def capacitances(self, switches: Switches) -> Switches:
        """Return switches with the capacitances of the parts."""


class World(Protocol):
    """Physics of the coils behind the switches.

    `SensorWorld` has all of them.
    """

    def check(self, place: Place) -> None:
        """Refuse a place that the indenter cannot reach.

        It raises a HardwareError.
        """

    def resonator(self, state: ScanState, place: Place, temperature: float) -> Resonator | None:
        """Return the tank that the converter drives at its resonance.

        None is returned if nothing oscillates. `state` has the measured coils and the terminations of the others.
        `temperature` is the board's temperature in °C.
        """


class EmulatedBoard:
    """Converter, switches and coils on one clock.

    `emulated_board` makes such a board.

    Parameters
    ----------
    coils : sequence of str
        Names of the coils by their number in the netlist.
    wiring : bytes
        Wiring of the switches, as `switch_table` reads it. Empty without switches.
    world : World
        Physics of the coils.
    clock : Clock
        Clock of the board, real or virtual.
    conditions : Conditions, optional
        Oscillator, temperature and noise of the converter.
    wired : sequence of int
        Channel of each coil, without switches. The coils of other channels are grounded while a coil is converted.
        Other coils of the world are open.
    converter : Converter
        Type of the converter.
    drains : sequence of Drains, optional
        Bits that share a common pin, of every device in the order of the words. None by default.
    open_points : OpenPoints, optional
        Behaviour of the converter in points on which its documents contradict each other.
    strict : bool
        Whether undocumented use of a chip raises UndocumentedUse. It is noted in any case.
    readback : bool
        Whether the end of the chain of switches is wired back.
    seed : int
        Seed of the noise.

    Notes
    -----
    A driver uses `bus` and `switches`. A test causes faults through `chip`, `chain`, `indenter` and `conditions`.
    `misuse.notes` lists the driver's violations of the data sheets.
    """

    def __init__(
        self,
        coils: Sequence[str],
        wiring: bytes,
        world: World,
        *,
        clock: Clock,
        conditions: Conditions | None = None,
        wired: Sequence[int] = (),
        converter: Converter = CONVERTERS["LDC1614"],
        drains: Sequence[Drains] | None = None,
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
        self._at_channel = {
            channel: ScanState(
                coil, ((coil, 1),), others="open", exceptions={one: "ground" for one in self.coils if one != coil}
            )
            for channel, coil in zip(wired, self.coils, strict=False)
        }
        self.chip = Ldc1614(clock, self, converter=converter, open_points=open_points, misuse=self.misuse, seed=seed)
        self.chain = EmulatedChain(
            switch_table(wiring) if wiring else (),
            before_change=self.chip.advance, after_change=self._switched, drains=drains, readback=readback,
        )  # fmt: skip
        self.indenter = Indenter(self.chip.advance, world.check)
        self.bus = EmulatedBus(self.chip, clock)
        self.switches = EmulatedSwitches(self.chain, clock)

    # ------------------------------------------------- the converter's surroundings

    @property
    def noise(self) -> float:
        """Relative standard deviation of a frequency at full resolution."""
        return self.conditions.noise

    @property
    def first_offset(self) -> float:
        """Error of the first conversion after sleep in codes."""
        return self.conditions.first_offset

    def internal_clock(self, time: float) -> float:
        """Return the frequency of the converter's own oscillator in Hz."""
        return self.conditions.oscillator.at(time, self.conditions.drift.at(time))

    def external_clock(self, time: float) -> float | None:
        """Return the frequency at the pin CLKIN in Hz."""
        return self.conditions.clkin

    def sensor(self, channel: int, time: float) -> Resonator | None:
        """Return the tank at a channel of the converter.

        Switches connect coils only to the first channel.
        """
        state = self._at_channel.get(channel) if self._at_channel else self._seen.state if channel == 0 else None
        if state is None:
            return None
        return self.world.resonator(state, self.indenter.at(time), self.conditions.drift.at(time))

    # ------------------------------------------------------------------ for tests

    def seen(self) -> Seen:
        """Return the circuit that the converter sees through the switches."""
        return self._seen

    def true_tank(self, channel: int = 0) -> Resonator | None:
        """Return the present tank at a channel, without noise."""
        return self.sensor(channel, self.clock.now())

    def temperature(self) -> float:
        """Return the present temperature of the board in °C."""
        return self.conditions.drift.at(self.clock.now())

    def place(self) -> Place:
        """Return the present place of the indenter."""
        return self.indenter.at(self.clock.now())

    def _switched(self) -> None:
        self._seen = self._solve(self.chain.closed())
        commanded = self._solve(self.chain.commanded()).kind
        if commanded in ("short", "grounded", "tangled"):  # or a bit was shifted
            self.misuse.remark(f"the words {self.chain.words.hex()} make a circuit that is {commanded}.")
