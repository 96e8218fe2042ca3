"""Make an emulated board: of a design with all its physics, or of coils of given inductance."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from coilarray.compute.store import open_store
from coilarray.compute.threads import Progress
from coilarray.design.model import Design
from coilarray.errors import HardwareError
from coilarray.hardware.emulator.board import NOISE, Conditions, Drift, EmulatedBoard, Netlist
from coilarray.hardware.emulator.oscillator import Oscillator
from coilarray.hardware.emulator.response_table import response_table
from coilarray.hardware.emulator.sensor_world import COPPER, SensorWorld
from coilarray.hardware.emulator.virtual_clock import VirtualClock
from coilarray.hardware.emulator.world import FixedCoils
from coilarray.hardware.scan.board_network import board_network
from coilarray.hardware.wire.buses import Clock


def emulated_board(
    design: Design,
    wiring: Netlist,
    *,
    path: Sequence[tuple[float, float, float, float]] | None = None,
    seed: int = 0,
    noise: float = NOISE,
    drift: Drift | None = None,
    oscillator: Oscillator | None = None,
    strays: Mapping[str, float] | None = None,
    copper: float = COPPER,
    capacitor: float = 0.0,
    clock: Clock | None = None,
    strict: bool = False,
    folder: Path | None = None,
    progress: Progress | None = None,
) -> EmulatedBoard:
    """Make a board of a design.

    Parameters
    ----------
    design : Design
        With all the coils of the wiring.
    wiring : Netlist
        Of the switches, as `coilarray.hardware.scan.wiring.load_wiring` returns it.
    path : sequence of (float, float, float, float), optional
        Of the indenter: time in s, x, y and depth in m. Lifted by default.
    seed : int
        Of the noise.
    noise : float
        Relative standard deviation of a frequency at full resolution.
    drift : Drift, optional
        Temperature; constant by default.
    oscillator : Oscillator, optional
        Of the converter; the typical 43.4 MHz by default.
    strays, copper, capacitor
        As in `SensorWorld`.
    clock : Clock, optional
        A new `VirtualClock` by default.
    strict : bool
        Whether undocumented use of the converter raises UndocumentedUse; noted in any case.
    folder : Path, optional
        Where circuit and response table are kept, as `coilarray.compute.store.open_store` says.
    progress : callable, optional
        Called with (done, total) while a response table is computed: when the indenter is pressed for the first time,
        where none is kept.

    Returns
    -------
    EmulatedBoard

    Raises
    ------
    HardwareError
        A coil of the wiring that the design does not have, or a place that the indenter cannot go to.
    OutputError
        A folder or part that cannot be written.
    """
    missing = [name for name in wiring.coils if name not in design.array.names]
    if missing:
        raise HardwareError(
            f"the wiring has the coil {missing[0]!r}, the design {design.name} only {', '.join(design.array.names)}."
        )
    store = open_store(folder)
    world = SensorWorld(
        board_network(design, store),
        lambda: response_table(design, store, progress=progress),
        strays=strays,
        copper=copper,
        capacitor=capacitor,
    )
    board = EmulatedBoard(
        wiring.coils,
        wiring.encode(),
        world,
        clock=clock or VirtualClock(),
        conditions=Conditions(oscillator or Oscillator(), drift or Drift(), noise),
        strict=strict,
        seed=seed,
    )
    if path is not None:
        board.indenter.follow(path)
    return board


def plain_board(
    wiring: Netlist,
    inductances: Mapping[str, float] | None = None,
    *,
    capacitance: float = 120e-12,
    resistance: float = 20.0,
    seed: int = 0,
    noise: float = NOISE,
    drift: Drift | None = None,
    oscillator: Oscillator | None = None,
    clock: Clock | None = None,
    strict: bool = False,
) -> EmulatedBoard:
    """Make a board of coils of given inductance, which know nothing of each other: quick, for tests of drivers.

    Parameters
    ----------
    wiring : Netlist
        Of the switches.
    inductances : mapping of str to float, optional
        By coil in H; 50 µH, 51 µH and so on by default.
    capacitance, resistance : float
        Of every tank in F and Ω.
    seed, noise, drift, oscillator, clock, strict
        As in `emulated_board`.

    Returns
    -------
    EmulatedBoard

    Raises
    ------
    HardwareError
        A coil without inductance.
    """
    L = {name: (50 + k) * 1e-6 for k, name in enumerate(wiring.coils)} if inductances is None else inductances
    missing = [name for name in wiring.coils if name not in L]
    if missing:
        raise HardwareError(f"inductances must have every coil of the wiring; {missing[0]!r} is missing.")
    return EmulatedBoard(
        wiring.coils,
        wiring.encode(),
        FixedCoils(L, capacitance, resistance),
        clock=clock or VirtualClock(),
        conditions=Conditions(oscillator or Oscillator(), drift or Drift(), noise),
        strict=strict,
        seed=seed,
    )
