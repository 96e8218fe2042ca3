"""Settings of a scan for the coils of a design.

Drive currents, settling and dividers follow from its circuit.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from coilarray.circuit.converter_limits import drive_for
from coilarray.circuit.network import loaded_quality, resonate
from coilarray.design.model import Design
from coilarray.design.scan_states import ScanState
from coilarray.errors import HardwareError
from coilarray.hardware.chips.converters import Family
from coilarray.hardware.chips.ldc1614 import BUS_RATE
from coilarray.hardware.scan.board_network import board_network
from coilarray.hardware.scan.settings import ScanSettings, scan_settings
from coilarray.hardware.scan.wiring import Wiring

_MARGIN = 1.25  # of the quality factor, for the settling time


def design_plan(design: Design, states: Sequence[str] | None = None) -> tuple[ScanState, ...]:
    """Return states of a design's scan plan.

    All states are returned without names. A wrong or repeated name raises a HardwareError.

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
    undivided: bool = False,
    family: Family = "LDC",
    clock: float | None = None,
    external_clock: bool = False,
    drives: Mapping[str, int] | int | None = None,
    discard: int = 0,
) -> ScanSettings:
    """Make settings for the coils of a design.

    Parameters
    ----------
    design : Design
        Design whose coils are among the coils of the wiring.
    wiring : Wiring
        Wiring of the board's switches, or of coils to the channels of the converter. A coil of the design that it does
        not have counts as open.
    states : sequence of str, optional
        Names of states of the design's scan plan. All states by default, or without switches all states of wired coils.
    rate : float, optional
        Scans per second. Full resolution by default.
    bus_rate : float
        Clock of the I²C bus in Hz.
    undivided, family
        See `scan_settings`.
    clock : float, optional
        Measured or external clock of the converter in Hz. Its own typical oscillator by default.
    external_clock : bool
        Whether the clock comes from the pin CLKIN.
    drives : mapping of str to int, or int, optional
        IDRIVE by coil, or of all coils. By default it follows from the parallel resistance of every state.
    discard : int
        Number of conversions to discard after waking, 0 to 15.

    Returns
    -------
    ScanSettings
        The settings, checked by the rules of the data sheet.

    Raises
    ------
    HardwareError
        A design whose coils the wiring does not have, a coil that the converter cannot drive, an external clock without
        its frequency, and all values that `scan_settings` refuses.
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
    plan = design_plan(design, states)
    if unknown:
        plan = _of_wired(plan, wiring, unknown, chosen=bool(states))
    network = board_network(design, wired=bool(wiring.channels))
    results = [resonate(network, state) for state in plan]
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
        [_among(state, wiring.coils) for state in plan],
        rate=rate,
        bus_rate=bus_rate,
        clock=clock,
        external_clock=external_clock,
        undivided=undivided,
        family=family,
        frequency={result.state.name: result.frequency for result in results},
        quality={result.state.name: _MARGIN * loaded_quality(network, result) for result in results},
        drives=drives,
        discard=discard,
    )


def _of_wired(
    plan: Sequence[ScanState], wiring: Wiring, others: Sequence[str], *, chosen: bool
) -> tuple[ScanState, ...]:
    """Return the states of wired coils.

    The `others` are open in them. All states are returned if the user has `chosen` them.
    """
    kept = [state for state in plan if chosen or {coil for coil, _ in state.measured} <= set(wiring.coils)]
    for state in kept:
        for coil, _ in state.measured:
            wiring.channel(coil)  # refuses a coil that is not wired
    if not kept:
        raise HardwareError(f"no state of the scan measures {' or '.join(wiring.coils)} alone.")
    return tuple(replace(state, exceptions={**state.exceptions, **dict.fromkeys(others, "open")}) for state in kept)


def _among(state: ScanState, coils: Sequence[str]) -> ScanState:
    """Return a state without its exceptions of other coils."""
    return replace(state, exceptions={coil: state.exceptions[coil] for coil in state.exceptions if coil in coils})


def _drive(coil: str, parallel_resistance: float) -> int:
    """Return the IDRIVE code of a coil."""
    drive = drive_for(parallel_resistance)
    if drive is None:
        raise HardwareError(
            f"the converter has no drive current for {coil}, whose parallel resistance is "
            f"{parallel_resistance * 1e-3:.3g} kΩ; give its IDRIVE."
        )
    return drive.code
