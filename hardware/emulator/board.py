"""A whole emulated board: converter, switches, coils, an indenter, a temperature and a time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

import numpy as np

from coilarray.compute.store import open_store
from coilarray.design.readout import Readout
from coilarray.design.scan_states import ScanState
from coilarray.errors import HardwareError
from coilarray.hardware.chips.converters import CONVERTERS, Converter
from coilarray.hardware.chips.ldc1614 import LARGEST_RCOUNT
from coilarray.hardware.emulator.conditions import Conditions, Indenter, Place, VirtualClock
from coilarray.hardware.emulator.conversion import Resonator
from coilarray.hardware.emulator.ldc1614_chip import EmulatedBus, Ldc1614, Misuse
from coilarray.hardware.emulator.switches import EmulatedChain, EmulatedSwitches
from coilarray.hardware.scan.switching import Seen, switch_table, what_is_seen
from coilarray.hardware.scan.wiring import Wiring
from coilarray.hardware.wire.buses import Clock

if TYPE_CHECKING:
    from coilarray.compute.threads import Progress
    from coilarray.design.model import Design
    from coilarray.hardware.emulator.sensor_world import ResponseTable

_CIRCUITS = 256  # number of solved circuits to keep; a scan repeats the same few


class World(Protocol):
    """Physics of the coils behind the switches."""

    def check(self, place: Place) -> None:
        """Refuse a place that the indenter cannot reach."""

    def resonator(self, state: ScanState, place: Place, temperature: float) -> Resonator | None:
        """Return the tank that the converter drives at its resonance.

        None is returned if nothing oscillates. `state` has the measured coils and the terminations of the others.
        `temperature` is the board's temperature in °C.
        """


class EmulatedBoard:
    """Converter, switches and coils on one clock.

    Notes
    -----
    A driver uses `bus` and `switches`. A test causes faults through `chip`, `chain`, `indenter` and `conditions`.
    `misuse.notes` lists the driver's violations of the data sheets.
    """

    def __init__(
        self,
        wiring: Wiring,
        world: World,
        *,
        clock: Clock,
        conditions: Conditions | None = None,
        converter: Converter = CONVERTERS["LDC1614"],
        strict: bool = False,
        readback: bool = True,
        seed: int = 0,
    ) -> None:
        self.coils = wiring.coils
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
            for channel, coil in zip(wiring.channels, self.coils, strict=False)
        }
        self.chip = Ldc1614(clock, self, converter=converter, misuse=self.misuse, seed=seed)
        self.chain = EmulatedChain(
            switch_table(wiring.encode()) if wiring.devices else (),
            before_change=self.chip.advance, after_change=self._switched, readback=readback,
        )  # fmt: skip
        self.indenter = Indenter(self.chip.advance, world.check)
        self.bus = EmulatedBus(self.chip, clock)
        self.switches = EmulatedSwitches(self.chain, clock)

    # ------------------------------------------------- the converter's surroundings

    @property
    def noise(self) -> float:
        """Relative standard deviation of a frequency at full resolution."""
        return Readout().frequency_noise if self.conditions.noise is None else self.conditions.noise

    def internal_clock(self, time: float) -> float:
        """Return the frequency of the converter's own oscillator in Hz."""
        return self.conditions.oscillator.at(time, self.conditions.drift.at(time))

    def external_clock(self, time: float) -> float | None:
        """Return the frequency at the pin CLKIN in Hz."""
        return self.conditions.clkin

    def sensor(self, channel: int, time: float) -> Resonator | None:
        """Return the tank at a channel of the converter."""
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


def emulated_board(
    design: Design,
    wiring: Wiring,
    *,
    conditions: Conditions | None = None,
    path: Sequence[tuple[float, float, float, float]] | None = None,
    count_parts: bool = False,
    clock: Clock | None = None,
    converter: Converter = CONVERTERS["LDC1614"],
    seed: int = 0,
    strict: bool = False,
    folder: Path | None = None,
    progress: Progress | None = None,
) -> EmulatedBoard:
    """Make an emulated board of a design, with all its physics.

    Parameters
    ----------
    design : Design
        Design with all the coils of the wiring.
    wiring : Wiring
        Wiring of the switches, or of coils to channels, as `coilarray.hardware.scan.wiring.load_wiring` returns it.
    conditions : Conditions, optional
        Oscillator, temperature and noise of the converter. By default the noise follows from the design's `Readout`.
    path : sequence of (float, float, float, float), optional
        Path of the indenter: time in s, x, y and depth in m. Lifted by default.
    count_parts : bool
        Whether the switches have the capacitances of the wiring's parts, which are typical and not verified, in place
        of the capacitances of the design.
    clock : Clock, optional
        Clock of the board. A new `VirtualClock` by default.
    converter : Converter
        Type of the converter.
    seed : int
        Seed of the noise.
    strict : bool
        Whether undocumented use of the converter raises UndocumentedUse. It is noted in any case.
    folder : Path, optional
        Folder of the store in which circuit and response table are kept, as in `coilarray.compute.store.open_store`.
    progress : callable, optional
        Called with (done, total) while a response table is computed. This happens when the indenter is pressed for the
        first time and no table is stored.
    """
    # A board of other coils does not need the physics of a design, which takes a second to load.
    from coilarray.hardware.emulator.sensor_world import SensorWorld
    from coilarray.hardware.scan.design_settings import board_network

    missing = [name for name in wiring.coils if name not in design.array.names]
    if missing:
        raise HardwareError(
            f"the wiring has the coil {missing[0]!r}, the design {design.name} only {', '.join(design.array.names)}."
        )
    store = open_store(folder)

    def table() -> ResponseTable:
        """Compute the response table at the mean scan frequency."""
        from coilarray.circuit.network import resonate
        from coilarray.hardware.emulator.sensor_world import response_table

        setup = design.indentation
        frequency = None
        if setup is not None and setup.ball is not None:
            frequency = float(np.mean([resonate(network, state).frequency for state in design.plan]))
        return response_table(design, store, frequency=frequency, progress=progress)

    network = board_network(design, wired=bool(wiring.channels))
    if count_parts:
        network = replace(network, switches=wiring.capacitances(network.switches))
    conditions = conditions or Conditions()
    if conditions.noise is None:
        conditions = replace(conditions, noise=replace(design.readout, rcount=LARGEST_RCOUNT).frequency_noise)
    board = EmulatedBoard(
        wiring, SensorWorld(network, table), clock=clock or VirtualClock(), conditions=conditions, converter=converter,
        strict=strict, seed=seed,
    )  # fmt: skip
    if path is not None:
        board.indenter.follow(path)
    return board
