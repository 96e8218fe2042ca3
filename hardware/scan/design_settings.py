"""Circuit, noise budget and settings of a design's board."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from coilarray.circuit.converter_limits import drive_for
from coilarray.circuit.network import Network, loaded_quality, resonate
from coilarray.design.model import Design
from coilarray.design.scan_states import ScanState
from coilarray.design.switch_parts import CONVERTER_PIN
from coilarray.errors import HardwareError
from coilarray.hardware.chips.ldc1614 import BUS_RATE
from coilarray.hardware.scan.settings import ConverterClock, ScanSettings, Sensor, scan_settings
from coilarray.hardware.scan.wiring import Wiring

if TYPE_CHECKING:
    from coilarray.circuit.noise_budget import NoiseBudget


def board_network(design: Design, *, wired: bool = False) -> Network:
    """Return the circuit of a design, without switches if `wired`."""
    from coilarray.circuit.coupling import design_circuit

    network = design_circuit(design)
    if not wired:
        return network
    switches = replace(design.circuit.switches, on_resistance=0.0)
    if design.circuit.part is not None:  # of whose capacitances the pins of the converter remain
        bus = min(switches.bus_capacitance, CONVERTER_PIN)
        switches = replace(switches, off_capacitance=0.0, terminal_capacitance=0.0, bus_capacitance=bus)
    return replace(network, switches=switches)


def board_budget(design: Design, settings: ScanSettings, *, baseline_scans: int | None = None) -> NoiseBudget:
    """Return the noise budget of all states of a design.

    The settings determine the clock and the length of a conversion. With `baseline_scans` for L_0 a
    reading is a single scan. All other values are taken from the design's `Readout`.
    """
    from coilarray.circuit.noise_budget import noise_budget  # not needed by the emulator

    readout = replace(
        design.readout,
        rcount=settings.rcount,
        clock=settings.clock,
        external_clock=settings.external_clock,
        reference_divider=settings.fref_divider,
    )
    if baseline_scans is not None:
        readout = replace(readout, averaged_scans=1, baseline_scans=baseline_scans)
    return noise_budget(design, readout=readout, network=board_network(design, wired=settings.wired))


_MARGIN = 1.25  # of the quality factor, for the settling time


def design_settings(
    design: Design,
    wiring: Wiring,
    *,
    states: Sequence[str] | None = None,
    rate: float | None = None,
    bus_rate: float = BUS_RATE,
    clock: ConverterClock | None = None,
    drives: Mapping[str, int] | int | None = None,
    discard: int = 0,
) -> ScanSettings:
    """Make settings for the coils of a design.

    Parameters
    ----------
    design : Design
        Design whose coils are among the coils of the wiring.
    wiring : Wiring
        Wiring of the board's switches, or of coils to the channels of the converter. A coil of the
        design that it does not have counts as open.
    states : sequence of str, optional
        Names of states of the design's scan plan. All states by default, or without switches all
        states of wired coils.
    rate : float, optional
        Scans per second. Full resolution by default.
    bus_rate : float
        Clock of the I²C bus in Hz.
    clock : ConverterClock, optional
        Clock of the converter. Its own oscillator by default.
    drives : mapping of str to int, or int, optional
        IDRIVE by coil, or of all coils. By default it follows from the parallel resistance of every
        state.
    discard : int
        Number of conversions to discard after waking, 0 to 15.

    Returns
    -------
    ScanSettings
        Settings that follow the rules of the data sheet.

    Raises
    ------
    HardwareError
        A design whose coils the wiring does not have, a coil that the converter cannot drive, and
        all values that `scan_settings` refuses.
    NetworkError
        A state without a resonance.
    """
    names = design.array.names
    unknown = [name for name in wiring.coils if name not in names] if wiring.channels else []
    if unknown:
        raise HardwareError(
            f"the design {design.name} has no coil {unknown[0]!r} of the wiring {wiring.name}; "
            f"there are {', '.join(names)}."
        )
    unknown = [name for name in names if name not in wiring.coils]
    if unknown and not wiring.channels:
        raise HardwareError(
            f"wiring {wiring.name} has no coil {unknown[0]!r} of the design {design.name}; there are "
            f"{', '.join(wiring.coils)}: give the wiring file of this board."
        )
    known = [state.name for state in design.plan]
    for name in states or ():
        if name not in known:
            raise HardwareError(f"the scan of {design.name} has no state {name!r}; there are {', '.join(known)}.")
    if states and len(set(states)) < len(states):
        raise HardwareError(f"states must be named once each; got {', '.join(states)}.")
    plan = tuple(state for state in design.plan if not states or state.name in states)
    if unknown:
        plan = _of_wired(plan, wiring, unknown, chosen=bool(states))
    network = board_network(design, wired=bool(wiring.channels))
    if isinstance(drives, Mapping) and (strange := [coil for coil in drives if coil not in wiring.coils]):
        raise HardwareError(f"a drive names the coil {strange[0]!r}; there are {', '.join(wiring.coils)}.")
    sensors, states_of_wiring = {}, []
    for state in plan:
        coil, result = state.measured[0][0], resonate(network, state)
        code = drives.get(coil) if isinstance(drives, Mapping) else drives
        if code is None:
            drive = drive_for(result.parallel_resistance)
            if drive is None:
                raise HardwareError(
                    f"the converter has no drive current for {coil}, whose parallel resistance is "
                    f"{result.parallel_resistance * 1e-3:.3g} kΩ; give its IDRIVE."
                )
            code = drive.code
        sensors[state.name] = Sensor(result.frequency, _MARGIN * loaded_quality(network, result), code)
        exceptions = {one: passive for one, passive in state.exceptions.items() if one in wiring.coils}
        states_of_wiring.append(replace(state, exceptions=exceptions))
    return scan_settings(
        wiring, states_of_wiring, sensors=sensors, clock=clock, rate=rate, bus_rate=bus_rate, discard=discard
    )


def _of_wired(
    plan: Sequence[ScanState], wiring: Wiring, others: Sequence[str], *, chosen: bool
) -> tuple[ScanState, ...]:
    """Return the states of wired coils, with all others open."""
    kept = [state for state in plan if chosen or {coil for coil, _ in state.measured} <= set(wiring.coils)]
    for state in kept:
        for coil, _ in state.measured:
            wiring.channel(coil)  # refuses a coil that is not wired
    if not kept:
        raise HardwareError(f"no state of the scan measures {' or '.join(wiring.coils)} alone.")
    return tuple(replace(state, exceptions={**state.exceptions, **dict.fromkeys(others, "open")}) for state in kept)
