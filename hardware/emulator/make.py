"""Make an emulated board of a design.

It has all the physics of the design.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from coilarray.compute.store import open_store
from coilarray.constants import COPPER_PER_KELVIN
from coilarray.errors import HardwareError
from coilarray.hardware.chips.converters import CONVERTERS, Converter
from coilarray.hardware.chips.ldc1614 import LARGEST_RCOUNT
from coilarray.hardware.emulator.board import EmulatedBoard, Netlist
from coilarray.hardware.emulator.conditions import Conditions, Drift, Oscillator, VirtualClock
from coilarray.hardware.wire.buses import Clock

if TYPE_CHECKING:
    from coilarray.compute.threads import Progress
    from coilarray.design.model import Design
    from coilarray.hardware.emulator.response_table import ResponseTable


def emulated_board(
    design: Design,
    wiring: Netlist,
    *,
    path: Sequence[tuple[float, float, float, float]] | None = None,
    seed: int = 0,
    noise: float | None = None,
    drift: Drift | None = None,
    oscillator: Oscillator | None = None,
    first_offset: float = 0.0,
    strays: Mapping[str, float] | None = None,
    copper: float = COPPER_PER_KELVIN,
    capacitor: float = 0.0,
    count_parts: bool = False,
    clock: Clock | None = None,
    converter: Converter | None = None,
    clkin: float | None = None,
    strict: bool = False,
    folder: Path | None = None,
    progress: Progress | None = None,
) -> EmulatedBoard:
    """Make a board of a design.

    Parameters
    ----------
    design : Design
        Design with all the coils of the wiring.
    wiring : Netlist
        Wiring of the switches, or of coils to channels, as `coilarray.hardware.scan.wiring.load_wiring` returns it.
    path : sequence of (float, float, float, float), optional
        Path of the indenter: time in s, x, y and depth in m. Lifted by default.
    seed : int
        Seed of the noise.
    noise : float
        Relative standard deviation of a frequency at full resolution. By default it follows from the design's
        `Readout`.
    drift : Drift, optional
        Temperature of the board. Constant by default.
    oscillator : Oscillator, optional
        Internal oscillator of the converter. The typical 43.4 MHz by default.
    first_offset : float
        Error of the first conversion after sleep in codes, see `Conditions`.
    strays, copper, capacitor
        Deviations from the design, see `SensorWorld`.
    count_parts : bool
        Whether the switches have the capacitances of the wiring's parts, which are typical and not verified, in place
        of the capacitances of the design.
    clock : Clock, optional
        Clock of the board. A new `VirtualClock` by default.
    converter : Converter, optional
        Type of the converter. An LDC1614 by default.
    clkin : float, optional
        Frequency at its pin CLKIN in Hz. The pin is grounded by default.
    strict : bool
        Whether undocumented use of the converter raises UndocumentedUse. It is noted in any case.
    folder : Path, optional
        Folder of the store in which circuit and response table are kept, as in `coilarray.compute.store.open_store`.
    progress : callable, optional
        Called with (done, total) while a response table is computed. This happens when the indenter is pressed for the
        first time and no table is stored.

    Raises
    ------
    HardwareError
        A coil of the wiring that the design does not have, or a place that the indenter cannot go to.
    OutputError
        A folder or file that cannot be written.
    """
    # A board of other coils does not need the physics of a design, which takes a second to load.
    from coilarray.hardware.emulator.sensor_world import SensorWorld
    from coilarray.hardware.scan.board_network import board_network

    missing = [name for name in wiring.coils if name not in design.array.names]
    if missing:
        raise HardwareError(
            f"the wiring has the coil {missing[0]!r}, the design {design.name} only {', '.join(design.array.names)}."
        )
    store = open_store(folder)

    def table() -> ResponseTable:
        """Compute the response table at the mean scan frequency."""
        from coilarray.circuit.network import resonate
        from coilarray.hardware.emulator.response_table import response_table

        setup = design.indentation
        frequency = None
        if setup is not None and setup.ball is not None:
            frequency = float(np.mean([resonate(network, state).frequency for state in design.plan]))
        return response_table(design, store, frequency=frequency, progress=progress)

    network = board_network(design, wired=bool(wiring.channels))
    if count_parts:
        network = replace(network, switches=wiring.capacitances(network.switches))
    world = SensorWorld(
        network, table,
        strays=strays, copper=copper, capacitor=capacitor,
    )  # fmt: skip
    if noise is None:
        noise = replace(design.readout, rcount=LARGEST_RCOUNT).frequency_noise
    conditions = Conditions(oscillator or Oscillator(), drift or Drift(), noise, clkin, first_offset)
    board = EmulatedBoard(
        wiring.coils, wiring.encode(), world, wired=wiring.channels, converter=converter or CONVERTERS["LDC1614"],
        clock=clock or VirtualClock(), conditions=conditions, drains=wiring.drains, strict=strict, seed=seed,
    )  # fmt: skip
    if path is not None:
        board.indenter.follow(path)
    return board
