"""A whole emulated board: converter, switches, coils and indenter."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np

from coilarray.compute.store import open_store
from coilarray.design.readout import INTERNAL_CLOCK, INTERNAL_CLOCK_PER_KELVIN, LARGEST_RCOUNT, Readout
from coilarray.design.scan_states import ScanState
from coilarray.errors import HardwareError
from coilarray.hardware.emulator.ldc1614_chip import EmulatedBus, Ldc1614, Misuse, Resonator
from coilarray.hardware.scan.wiring import (
    SWITCHES,
    Net,
    Seen,
    SwitchTable,
    WiredSwitch,
    Wiring,
    closed_switches,
    switch_table,
    what_is_seen,
)
from coilarray.hardware.wire.buses import Clock

if TYPE_CHECKING:
    from coilarray.compute.threads import Progress
    from coilarray.design.model import Design
    from coilarray.hardware.emulator.sensor_world import SensorWorld
    from coilarray.response.interpolation import ResponseSpline


ROOM_TEMPERATURE = 25.0  # temperature in °C at which the frequency of a converter's clock is given
_AHEAD, _BEHIND = 1e-3, 0.05  # s


class VirtualClock(Clock):
    """Clock whose time passes only in `sleep`."""

    def __init__(self, start: float = 0.0) -> None:
        self._now = start

    def now(self) -> float:
        """Return the time in s."""
        return self._now

    def sleep(self, seconds: float) -> None:
        """Let time pass."""
        if not math.isfinite(seconds):
            raise HardwareError(f"a wait must be finite; got {seconds} s.")
        self._now += max(seconds, 0.0)


class PacedClock(Clock):
    """Clock of an emulated board in real time.

    A computer takes up to twice as long for a wait as short as 0.1 ms, a transfer. Therefore the
    waits are added up, and the computer sleeps only if they are ahead of its own clock. If it falls
    behind by more than `_BEHIND`, time goes on without the board. So a computer that is too slow
    has fewer scans and not slower seconds.
    """

    def __init__(self) -> None:
        self._time = time.monotonic()

    def now(self) -> float:
        """Return the time in s."""
        self._time = max(self._time, time.monotonic() - _BEHIND)
        return self._time

    def sleep(self, seconds: float) -> None:
        """Let time pass."""
        self._time = self.now() + max(seconds, 0.0)
        if (ahead := self._time - time.monotonic()) > _AHEAD:
            time.sleep(ahead)


@dataclass
class Conditions:
    """Surroundings of the converter, which may change at any time."""

    oscillator: float = INTERNAL_CLOCK  # frequency of the converter's own at room temperature in Hz, 35 to 55 MHz
    drift: float = 0.0  # rate at which the board warms in K/s
    start: float = ROOM_TEMPERATURE  # temperature of the board in °C at the time 0
    noise: float | None = None  # relative standard deviation of a frequency at full resolution
    clkin: float | None = None  # frequency at the pin CLKIN in Hz. None if the pin is grounded


class Place(NamedTuple):
    """Position from the map's origin and depth, in m."""

    x: float
    y: float
    depth: float


LIFTED = Place(0.0, 0.0, 0.0)  # place of an indenter without contact


class Indenter:
    """Indenter on the emulated sensor.

    `before_change` is called before it moves. `check` is called with every place on its path and
    refuses places that it cannot reach.

    >>> indenter = Indenter()
    >>> indenter.follow([(0.0, 0.0, 0.0, 0.0), (1.0, 2e-3, 0.0, 1e-3)])
    >>> indenter.at(0.5)
    Place(x=0.001, y=0.0, depth=0.0005)
    """

    def __init__(
        self, before_change: Callable[[], None] = lambda: None, check: Callable[[Place], None] = lambda place: None
    ) -> None:
        self._before_change, self._check = before_change, check
        self._path = np.array([(0.0, *LIFTED)]).T  # times, x, y and depths

    def press(self, x: float, y: float, depth: float) -> None:
        """Press at once at a position to a depth."""
        self.follow([(0.0, x, y, depth)])

    def lift(self) -> None:
        """Lift at once."""
        x, y = self._path[1:3, -1].tolist()
        self.press(x, y, 0.0)

    def follow(self, path: Sequence[tuple[float, float, float, float]]) -> None:
        """Move along straight lines through (time, x, y, depth) in s and m."""
        # It stands still before the first and after the last time. Times are the board's and rise.
        for point in path:
            self._check(Place(*point[1:]))
        self._before_change()
        self._path = np.array(path).T

    def at(self, time: float) -> Place:
        """Return the place of the indenter."""
        times, *rows = self._path
        return Place(*(float(np.interp(time, times, row)) for row in rows))


_SPEED = 8e6  # Hz, of the switches' port
_FALLING_EDGE_MODES = (1, 2)  # SPI modes with data stable at the falling edge, where the chip samples


class EmulatedChain:
    """A daisy chain of packages behind one shift register.

    The first device is at the far end of the chain and gets the first byte. A bit is shifted in at
    every falling edge of the clock. When SYNC rises, each package latches its last eight bits.
    After power-up all switches are open. `readback` means that the end of the chain is wired back.
    A driver calls `shift` and `close`.
    """

    def __init__(
        self,
        devices: SwitchTable,
        clock: Clock,
        *,
        before_change: Callable[[], None] = lambda: None,
        after_change: Callable[[], None] = lambda: None,
        readback: bool = True,
    ) -> None:
        self.devices, self._clock, self.readback = devices, clock, readback
        self.mode = 1
        """SPI mode. Change it to emulate a port with another mode."""
        self.broken = False
        """Whether the data line is broken, so that the chain receives zeros."""
        self._before_change, self._after_change = before_change, after_change
        self._stuck: dict[tuple[int, int], bool] = {}
        self._register = 0  # the far end of the chain first
        self.words = bytes(len(devices))
        """Words that the packages latched last, in sending order."""

    def closed(self) -> tuple[WiredSwitch, ...]:
        """Return the conducting switches, including switches stuck closed."""
        return closed_switches(self.devices, self.words, stuck=self._stuck)

    def shift(self, words: bytes) -> bytes | None:
        """Send one byte per device and latch all of them."""
        self._clock.sleep(SWITCHES * len(words) / _SPEED)
        return self.transfer(bytes(len(words)) if self.broken else words)

    def close(self) -> None:
        """Release the port."""

    def transfer(self, data: bytes) -> bytes | None:
        """Shift bytes in with SYNC low, then let SYNC rise."""
        # In the SPI modes 0 and 3 data change at the edge at which the chip samples them: it takes the bit before.
        count = SWITCHES * len(data)
        sent = int.from_bytes(data)
        if self.mode not in _FALLING_EDGE_MODES:
            sent >>= 1
        through = self._register << count | sent
        self._register = through & (1 << SWITCHES * len(self.devices)) - 1
        words = self._register.to_bytes(len(self.devices))
        if words != self.words:
            self._before_change()
            self.words = words
            self._after_change()
        if not self.readback:
            return None
        return (through >> SWITCHES * len(self.devices)).to_bytes(len(data))

    def stick(self, device: int, bit: int, state: Literal["open", "closed"]) -> None:
        """Break a switch, which then stays in this state."""
        self._before_change()
        self._stuck[device, bit] = state == "closed"
        self._after_change()

    def heal(self) -> None:
        """Repair all switches."""
        self._before_change()
        self._stuck.clear()
        self._after_change()

    def find(self, coil: int, end: int, net: Net) -> tuple[int, int]:
        """Return device and bit of a switch."""
        for device, switches in enumerate(self.devices):
            for bit, switch in enumerate(switches):
                if switch == WiredSwitch((coil, end), net):
                    return device, bit
        raise HardwareError(f"no switch joins end {end} of coil {coil} to {net}.")


_CIRCUITS = 256  # number of solved circuits to keep, as a scan repeats the same few


class EmulatedBoard:
    """Converter, switches and coils on one clock.

    A driver uses `bus` and `chain`. A test causes faults through `chip`, `chain`, `indenter` and
    `conditions`. `misuse.notes` lists the driver's violations of the data sheets.
    """

    def __init__(
        self,
        wiring: Wiring,
        world: SensorWorld,
        *,
        clock: Clock,
        conditions: Conditions | None = None,
        strict: bool = False,
        readback: bool = True,
        seed: int = 0,
    ) -> None:
        self.coils = wiring.coils
        self.world = world
        self.clock = clock
        self.conditions = conditions or Conditions()
        self.misuse = Misuse(strict)
        self.seen = Seen("open")
        """Circuit that the converter sees through the switches."""
        self._solve = lru_cache(maxsize=_CIRCUITS)(lambda closed: what_is_seen(closed, self.coils))
        self._at_channel = {
            channel: ScanState(
                coil, ((coil, 1),), others="open", exceptions={one: "ground" for one in self.coils if one != coil}
            )
            for channel, coil in zip(wiring.channels, self.coils, strict=False)
        }
        self.chip = Ldc1614(clock, self, misuse=self.misuse, seed=seed)
        devices = switch_table(wiring.encode()) if wiring.devices else ()
        changes = {"before_change": self.chip.advance, "after_change": self._switched}
        self.chain = EmulatedChain(devices, clock, **changes, readback=readback)
        self.indenter = Indenter(self.chip.advance, world.check)
        self.bus = EmulatedBus(self.chip, clock)

    @property
    def noise(self) -> float:
        """Relative standard deviation of a frequency at full resolution."""
        return Readout().frequency_noise if self.conditions.noise is None else self.conditions.noise

    def clock_of(self, time: float, *, external: bool) -> float:
        """Return the converter's clock in Hz, 0 if the pin CLKIN is grounded."""
        if external:
            return self.conditions.clkin or 0.0
        warmer = self.temperature(time) - ROOM_TEMPERATURE
        return self.conditions.oscillator * (1 + INTERNAL_CLOCK_PER_KELVIN * warmer)

    def sensor(self, channel: int, time: float) -> Resonator | None:
        """Return the tank at a channel of the converter."""
        state = self._at_channel.get(channel) if self._at_channel else self.seen.state if channel == 0 else None
        if state is None:
            return None
        return self.world.resonator(state, self.indenter.at(time), self.temperature(time))

    def true_tank(self, channel: int = 0) -> Resonator | None:
        """Return the present tank at a channel, without noise."""
        return self.sensor(channel, self.clock.now())

    def temperature(self, time: float | None = None) -> float:
        """Return the temperature of the board in °C, at present by default."""
        return self.conditions.start + self.conditions.drift * (self.clock.now() if time is None else time)

    def place(self) -> Place:
        """Return the present place of the indenter."""
        return self.indenter.at(self.clock.now())

    def _switched(self) -> None:
        self.seen = self._solve(self.chain.closed())
        commanded = self._solve(closed_switches(self.chain.devices, self.chain.words)).kind  # as if none were stuck
        if commanded in ("short", "grounded", "tangled"):  # or a bit was shifted
            self.misuse.remark(f"the words {self.chain.words.hex()} make a circuit that is {commanded}.")


def emulated_board(
    design: Design,
    wiring: Wiring,
    *,
    conditions: Conditions | None = None,
    clock: Clock | None = None,
    seed: int = 0,
    strict: bool = False,
    folder: Path | None = None,
    progress: Progress | None = None,
) -> EmulatedBoard:
    """Make an emulated board of a design.

    By default the noise follows from the design's `Readout`. `strict` raises UndocumentedUse at
    undocumented use of the converter. `folder` is the folder of the store, as in
    `coilarray.compute.store.open_store`. `progress` is called with (done, total) while a response
    table is computed. This happens when the indenter is pressed for the first time and no table is
    stored.
    """
    # A board of other coils does not need the physics of a design, which takes a second to load.
    from coilarray.design.model import one_board
    from coilarray.hardware.emulator.sensor_world import SensorWorld
    from coilarray.hardware.scan.settings import board_network

    one_board(design, "the emulated board")
    missing = [name for name in wiring.coils if name not in design.array.names]
    if missing:
        raise HardwareError(
            f"the wiring has the coil {missing[0]!r}, the design {design.name} only {', '.join(design.array.names)}."
        )
    store = open_store(folder)

    def table() -> ResponseSpline:
        """Compute the response table at the mean scan frequency."""
        from coilarray.circuit.network import resonate
        from coilarray.hardware.emulator.sensor_world import response_table

        frequency = None
        if setup is not None and setup.ball is not None:
            frequency = float(np.mean([resonate(network, state).frequency for state in design.plan]))
        return response_table(design, store, frequency=frequency, progress=progress)

    setup = design.indentation
    origin = (0.0, 0.0) if setup is None else setup.origin_point
    network = board_network(design, wired=bool(wiring.channels))
    conditions = conditions or Conditions()
    if conditions.noise is None:
        conditions = replace(conditions, noise=replace(design.readout, rcount=LARGEST_RCOUNT).frequency_noise)
    return EmulatedBoard(
        wiring,
        SensorWorld(network, table, origin),
        clock=clock or VirtualClock(),
        conditions=conditions,
        strict=strict,
        seed=seed,
    )
