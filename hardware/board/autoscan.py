"""Reader of a converter that scans its channels itself.

The coils are wired straight to its channels, and it measures them in turn. In a stream without pauses the converter
stays awake and goes on while its results are read. Anywhere else, and after any fault, a scan begins from sleep, so
that no result is older than the scan.
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
    """A `Reader` of a converter's 1 to 4 channels.

    Its other properties are inherited from `DirectReader`. `configure` takes only settings of a wiring with channels
    and raises a HardwareError for others. If a slow computer does not fetch a result in time, the next result replaces
    it. The lost result is left out in the sequence numbers of a stream.
    """

    def __init__(self, bus: RegisterBus, clock: Clock, *, kind: str, emulated: bool = False) -> None:
        self._ready = -math.inf  # time at which the latest results were ready
        self._turn = 0.0  # s, from result to result, measured with this converter's clock
        self._reading = math.inf  # s, least time for reading the results
        self._followed = 0  # consecutive results that became ready between two looks, so that their time is known
        super().__init__(bus, _NoSwitches(), clock, b"", kind=kind, emulated=emulated)

    def _measured(self, chip_settings: ChipSettings, *, running: bool) -> tuple[float, list[RawSample], int]:
        """Measure all channels, from sleep or in a running scan."""
        chips, going_on = self._chips, running and not self._chips.asleep
        start, missed = self._clock.now(), 0
        try:
            if going_on:
                # The turn is known after two results that became ready between looks. The next look is a little before
                # the next result.
                look = self._ready + self._turn - 2 * LOOK_AGAIN if self._followed > 1 else start
                samples = list(chips.results(chip_settings, max(look - start, 0.0)))
                if chips.ready_at > self._ready:
                    # These results began one turn ago, however late the computer is.
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
            with contextlib.suppress(BusFault):  # a remaining fault shows in the next scan
                chips.sleep()
        return start, samples, missed

    def _follow(self, chip_settings: ChipSettings) -> int:
        """Return the number of missed scans, and learn the turn.

        The turn of the converter is learnt from results that became ready between two looks. Results that come faster
        than they can be read are not missed. A scan takes one turn, or twice the time of a look and the reading, which
        leaves room for a bus whose speed varies.
        """
        ready, passed = self._chips.ready_at, self._chips.ready_at - self._ready
        step = max(self._turn, 2 * (self._reading + LOOK_AGAIN))
        if self._chips.came:
            scans = max(round(passed / step), 1)
            self._ready, self._followed = ready, self._followed + 1
            if self._followed > 1:
                self._turn = min(passed, chip_settings.again)  # after a pause the computer saw the result late
        else:
            scans = max(math.floor(passed / step), 1)
            self._ready, self._followed = min(self._ready + scans * step, ready), 0
        return scans - 1


class _NoSwitches:
    """A `SwitchChain` without switches."""

    def shift(self, words: bytes) -> bytes | None:
        return None

    def close(self) -> None:
        pass
