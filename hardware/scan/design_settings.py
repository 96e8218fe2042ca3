"""Settings of a scan that fit the coils of a design: drive currents, settling and dividers from its circuit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from coilarray.circuit.network import loaded_quality, resonate
from coilarray.compute.store import open_store
from coilarray.design.model import Design
from coilarray.design.scan_states import ScanState
from coilarray.errors import HardwareError
from coilarray.hardware.chips.ldc1614 import BUS_RATE
from coilarray.hardware.chips.ldc1614_limits import drive_for
from coilarray.hardware.scan.board_network import board_network
from coilarray.hardware.scan.settings import ScanSettings, scan_settings
from coilarray.hardware.scan.wiring import Wiring

_MARGIN = 1.25  # of the quality factor, for the settling time


def design_plan(design: Design, states: Sequence[str] | None = None) -> tuple[ScanState, ...]:
    """Return the states of these names, or all, in a design's scan plan; HardwareError for a wrong or repeated name.

    >>> from coilarray import load_design
    >>> [state.name for state in design_plan(load_design("gast2020"), ["coil1", "coil3"])]
    ['coil1', 'coil3']
    """
    plan = design.plan
    known = [state.name for state in plan]
    for name in states or ():
        if name not in known:
            raise HardwareError(f"the scan of {design.name} has no state {name!r}; there are {', '.join(known)}.")
    if states and len(set(states)) < len(states):
        raise HardwareError(f"states must be named once each; got {', '.join(states)}.")
    return tuple(state for state in plan if not states or state.name in states)


def design_settings(
    design: Design,
    wiring: Wiring,
    *,
    states: Sequence[str] | None = None,
    rate: float | None = None,
    bus_rate: float = BUS_RATE,
    clock: float | None = None,
    external_clock: bool = False,
    drives: Mapping[str, int] | int | None = None,
    discard: int = 0,
) -> ScanSettings:
    """Make settings for the coils of a design.

    Parameters
    ----------
    design : Design
        Design whose coils are among those of the wiring.
    wiring : Wiring
        Wiring of the board's switches.
    states : sequence of str, optional
        Names of states of the design's scan plan; all by default.
    rate : float, optional
        Scans per second; full resolution by default.
    bus_rate : float
        Clock of the I²C bus in Hz.
    clock : float, optional
        Measured or external clock of the converter in Hz; that of its own typical oscillator by default.
    external_clock : bool
        Whether the clock comes from the pin CLKIN.
    drives : mapping of str to int, or int, optional
        IDRIVE by coil, or of all coils; by default from the parallel resistance of every state.
    discard : int
        Number of conversions to throw away after waking, 0 to 15.

    Returns
    -------
    ScanSettings

    Raises
    ------
    HardwareError
        A design whose coils the wiring does not have, a coil that the converter cannot drive, an external clock without
        its frequency, and what `scan_settings` refuses.
    NetworkError
        A state without a resonance.
    """
    unknown = [name for name in design.array.names if name not in wiring.coils]
    if unknown:
        raise HardwareError(
            f"wiring {wiring.name} has no coil {unknown[0]!r} of the design {design.name}; "
            f"there are {', '.join(wiring.coils)}: give the wiring of this board."
        )
    plan = design_plan(design, states)
    network = board_network(design, open_store())
    results = [resonate(network, state) for state in plan]
    highest = max(result.frequency for result in results)
    # the settling rule counts periods of the sensor: the slowest one decides
    quality = max(loaded_quality(network, result) * highest / result.frequency for result in results)
    if not isinstance(drives, int):
        known = dict(drives or {})
        for coil in known:
            if coil not in wiring.coils:
                raise HardwareError(f"a drive names the coil {coil!r}; there are {', '.join(wiring.coils)}.")
        for state, result in zip(plan, results, strict=True):
            coil = state.measured[0][0]
            if coil not in known:
                known[coil] = _drive(coil, result.parallel_resistance)
        drives = known
    return scan_settings(
        wiring,
        plan,
        rate=rate,
        bus_rate=bus_rate,
        clock=clock,
        external_clock=external_clock,
        frequency=highest,
        quality=_MARGIN * quality,
        drives=drives,
        discard=discard,
    )


def _drive(coil: str, parallel_resistance: float) -> int:
    drive = drive_for(parallel_resistance)
    if drive is None:
        raise HardwareError(
            f"the converter has no drive current for {coil}, whose parallel resistance is "
            f"{parallel_resistance * 1e-3:.3g} kΩ; give its IDRIVE."
        )
    return drive.code
