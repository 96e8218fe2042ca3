"""Drive current of every coil.

The converter finds it, and its amplitude flags check it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace

from coilarray.errors import HardwareError
from coilarray.hardware.chips.ldc1614 import FAMILIES
from coilarray.hardware.chips.ldc1614_registers import register
from coilarray.hardware.scan.readings import Reader, Reason, judge
from coilarray.hardware.scan.settings import ScanSettings, StateSettings, error_config

_CONFIG, _DRIVE_CURRENT = register("CONFIG"), register("DRIVE_CURRENT0")
_BY_ITSELF = _CONFIG.field("RP_OVERRIDE_EN").mask | _CONFIG.field("AUTO_AMP_DIS").mask
_INIT = _DRIVE_CURRENT.field("INIT_IDRIVE0")
_LARGEST = _DRIVE_CURRENT.field("IDRIVE0").largest
_RCOUNT = 0x1000  # conversions of 3 ms


@dataclass(frozen=True)
class FoundDrive:
    """Drive current of a coil."""

    code: int  # IDRIVE, 0 to 31
    proposed: int  # INIT_IDRIVE, found by the converter itself
    reasons: tuple[Reason, ...]  # warnings about the amplitude that remain with this code


def find_drives(reader: Reader, settings: ScanSettings) -> Mapping[str, FoundDrive]:
    """Find the drive current of every state.

    No object may be near the sensor that is absent during the measurement. Afterwards the board is not configured and
    its coils are grounded.

    The procedure is taken from the data sheet: wake with the automatic amplitude and, before the converter sleeps
    again, read INIT_IDRIVE. Fixed currents are tried from there, one code up or down, until the converter warns of
    neither a low nor a high amplitude. If every code gives a warning, the largest code that is not too high is taken.
    """
    found = {state.name: _find(reader, settings, state) for state in settings.states}
    reader.rest()
    return found


def _find(reader: Reader, settings: ScanSettings, state: StateSettings) -> FoundDrive:
    """Find the drive current of one state."""
    proposed = _proposal(reader, settings, state)
    code, reasons = proposed, _reasons(reader, settings, state, proposed)
    if Reason.AMPLITUDE_HIGH in reasons:
        while Reason.AMPLITUDE_HIGH in reasons and code > 0:
            code -= 1
            reasons = _reasons(reader, settings, state, code)
    else:
        while reasons and code < _LARGEST:
            higher = _reasons(reader, settings, state, code + 1)
            if Reason.AMPLITUDE_HIGH in higher:
                break
            code, reasons = code + 1, higher
    if not set(reasons) <= {Reason.AMPLITUDE_LOW, Reason.AMPLITUDE_HIGH}:
        raise HardwareError(f"{state.name} does not oscillate with any drive current: {', '.join(reasons)}.")
    return FoundDrive(code, proposed, reasons)


def _proposal(reader: Reader, settings: ScanSettings, state: StateSettings) -> int:
    """Let the converter find the drive current.

    The result is 0 if the converter gave no result. If it finds no current, the current of the settings is returned.
    """
    if not FAMILIES[settings.family].finds_drive:
        return state.drive
    given = {field.name: getattr(settings, field.name) for field in fields(ScanSettings)}
    reader.configure(_OwnAmplitude(**(given | {"states": (replace(state, drive=0),), "rcount": _RCOUNT})))
    return ((reader.scan().samples[0].drive or 0) & _INIT.mask) >> _INIT.lsb


def _reasons(reader: Reader, settings: ScanSettings, state: StateSettings, code: int) -> tuple[Reason, ...]:
    """Reasons not to trust a result with a fixed current."""
    reader.configure(replace(settings, states=(replace(state, drive=code),), rcount=_RCOUNT))
    return judge(
        reader.scan().samples[0],
        offset=settings.offset,
        error_config=error_config(settings.family),
        channel=state.channel,
    )[1]


class _OwnAmplitude(ScanSettings):
    """Settings with which the converter finds the drive current itself."""

    @property
    def registers(self) -> tuple[tuple[int, int], ...]:
        return tuple(
            (address, value & ~_BY_ITSELF if address == _CONFIG.address else value)
            for address, value in super().registers
        )
