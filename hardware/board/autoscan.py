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
    does not fetch in time is replaced by the next one, and left out in the sequence numbers of a stream: it is lost.
    """

    def __init__(self, bus: RegisterBus, clock: Clock, *, kind: str, emulated: bool = False) -> None:
        self._ready = -math.inf  # when the latest results were there
        self._turn = 0.0  # s, from result to result as this converter's clock makes it
        self._reading = math.inf  # s, that reading results took at least
        self._followed = 0  # consecutive results that came while it looked, so that it knows when
        super().__init__(bus, _NoSwitches(), clock, b"", kind=kind, emulated=emulated)

    def _measured(self, chip_settings: ChipSettings, *, running: bool) -> tuple[float, list[RawSample], int]:
        chips, going_on = self._chips, running and not self._chips.asleep
        start, missed = self._clock.now(), 0
        try:
            if going_on:
                # two results that were seen to come tell their turn; the look is a little before the next one ends
                look = self._ready + self._turn - 2 * LOOK_AGAIN if self._followed > 1 else start
                samples = list(chips.results(chip_settings, max(look - start, 0.0)))
                if chips.ready_at > self._ready:
                    # these results began one turn ago, however late the computer is
                    start = chips.ready_at - chip_settings.turn
                    missed = self._follow(chip_settings)
            else:
                if not chips.asleep:
                    chips.sleep()
                chips.wake(chip_settings)
                samples = list(chips.results(chip_settings))
                self._ready, self._turn, self._followed = chips.ready_at, chip_settings.turn, 0
                self._reading = math.inf
            self._reading = min(self._reading, self._clock.now() - chips.ready_at)
        except BusFault as fault:
            samples = [no_sample(fault_of(fault))] * len(chip_settings.names)
        if not running or any(sample.fault is not SampleFault.NONE for sample in samples):
            with contextlib.suppress(BusFault):  # what it does then shows in the next scan
                chips.sleep()
        return start, samples, missed

    def _follow(self, chip_settings: ChipSettings) -> int:
        """Learn the turn of the converter where results came while it looked; return how many scans were missed.

        Results that come faster than they can be read are not missed: a scan takes one turn, or twice the reading,
        which leaves room for a bus that is not always equally fast.
        """
        ready, passed = self._chips.ready_at, self._chips.ready_at - self._ready
        step = max(self._turn, 2 * self._reading)
        if self._chips.came:
            scans = max(round(passed / step), 1)
            self._ready, self._followed = ready, self._followed + 1
            if self._followed > 1:
                self._turn = min(passed, chip_settings.again)  # a computer that paused between two looks saw it late
        else:
            scans = max(math.floor(passed / step), 1)
            self._ready, self._followed = min(self._ready + scans * step, ready), 0
        return scans - 1


class _NoSwitches:
    """A `SwitchChain` of no switches."""

    def shift(self, words: bytes) -> bytes | None:
        return None

    def close(self) -> None:
        pass
