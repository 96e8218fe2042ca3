"""Drive current of every coil, as the converter finds it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from coilarray.errors import HardwareError
from coilarray.hardware.chips.ldc1614_registers import register
from coilarray.hardware.scan.readings import RawSample, Reader, Reason, judge
from coilarray.hardware.scan.settings import LARGEST_DRIVE, ScanSettings, StateSettings

_INIT = register("DRIVE_CURRENT0").field("INIT_IDRIVE0")
_RCOUNT = 0x1000  # conversions of 3 ms


@dataclass(frozen=True)
class FoundDrive:
    """Drive current of a coil."""

    code: int  # IDRIVE, 0 to 31
    proposed: int  # INIT_IDRIVE, found by the converter itself, 0 if it gave no result
    reasons: tuple[Reason, ...]  # warnings about the amplitude that remain with this code


def find_drives(reader: Reader, settings: ScanSettings) -> Mapping[str, FoundDrive]:
    """Find the drive current of every state.

    No object may be near the sensor that is absent during the measurement. The procedure of the
    data sheet starts at INIT_IDRIVE of the automatic amplitude. The code is changed by one until
    neither a low nor a high amplitude is reported, or is the largest that is not too high.
    """
    found = {state.name: _find(reader, settings, state) for state in settings.states}
    reader.rest()
    return found


def _find(reader: Reader, settings: ScanSettings, state: StateSettings) -> FoundDrive:
    """Find the drive current of one state."""
    proposal = _measured(reader, replace(settings, automatic_drive=True), state, 0)
    proposed = ((proposal.drive or 0) & _INIT.mask) >> _INIT.lsb

    def reasons_of(code: int) -> tuple[Reason, ...]:
        return judge(_measured(reader, settings, state, code), state.channel)[1]

    code, reasons = proposed, reasons_of(proposed)
    if Reason.AMPLITUDE_HIGH in reasons:
        while Reason.AMPLITUDE_HIGH in reasons and code > 0:
            code -= 1
            reasons = reasons_of(code)
    else:
        while reasons and code < LARGEST_DRIVE:
            higher = reasons_of(code + 1)
            if Reason.AMPLITUDE_HIGH in higher:
                break
            code, reasons = code + 1, higher
    if not set(reasons) <= {Reason.AMPLITUDE_LOW, Reason.AMPLITUDE_HIGH}:
        raise HardwareError(f"{state.name} does not oscillate with any drive current: {', '.join(reasons)}.")
    return FoundDrive(code, proposed, reasons)


def _measured(reader: Reader, settings: ScanSettings, state: StateSettings, code: int) -> RawSample:
    """Measure a state, or all wired channels, with a current."""
    changed = replace(state, drive=code)
    states = tuple(changed if one == state else one for one in settings.states) if settings.wired else (changed,)
    reader.configure(replace(settings, states=states, rcount=_RCOUNT))
    return reader.scan().samples[states.index(changed)]
