"""Reader of a converter whose coils are wired straight to its channels: it scans them itself, one after the other.

In a stream without pauses the converter stays awake and goes on while its results are read. Anywhere else, and after
any fault, a scan begins from sleep, so that no result is older than the scan.
"""

from __future__ import annotations

import contextlib
import math

from coilarray.hardware.board.chip_driver import LOOK_AGAIN, ChipSettings, fault_of, no_sample
from coilarray.hardware.board.direct import DirectReader
from coilarray.hardware.scan.reader import RawSample, SampleFault
from coilarray.hardware.wire.buses import Clock, RegisterBus
from coilarray.hardware.wire.faults import BusFault


class AutoscanReader(DirectReader):
    """A `Reader` of the channels of a converter, 1 to 4; its other properties are those of `DirectReader`.

    `configure` takes settings of a wiring with channels only: HardwareError for others. A result that a slow computer
    does not fetch in time is replaced by the next one.
    """

    def __init__(self, bus: RegisterBus, clock: Clock, *, kind: str, emulated: bool = False) -> None:
        self._ready = -math.inf  # when the latest results were there
        self._turn = 0.0  # s, from there to the next look
        super().__init__(bus, _NoSwitches(), clock, b"", kind=kind, emulated=emulated)

    def _measured(self, chip_settings: ChipSettings, *, running: bool) -> tuple[float, list[RawSample]]:
        chips, going_on = self._chips, running and not self._chips.asleep
        start = self._clock.now()
        try:
            if going_on:
                wait = max(self._ready + self._turn - self._clock.now(), 0.0)
            else:
                if not chips.asleep:
                    chips.sleep()
                chips.wake(chip_settings)
                wait, self._turn = None, chip_settings.turn
            samples = list(chips.results(chip_settings, wait))
            if going_on and chips.ready_at > self._ready:
                # these results began one turn ago, however late the computer is
                start = chips.ready_at - chip_settings.turn
                # the next look comes a little before the next turn ends, whatever clock this converter has
                self._turn = max(chips.ready_at - self._ready - 2 * LOOK_AGAIN, 0.0)
            self._ready = chips.ready_at
        except BusFault as fault:
            samples = [no_sample(fault_of(fault))] * len(chip_settings.names)
        if not running or any(sample.fault is not SampleFault.NONE for sample in samples):
            with contextlib.suppress(BusFault):  # what it does then shows in the next scan
                chips.sleep()
        return start, samples


class _NoSwitches:
    """A `SwitchChain` of no switches."""

    def shift(self, words: bytes) -> bytes | None:
        return None

    def close(self) -> None:
        pass
