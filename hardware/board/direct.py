"""Readers of a board with chips on the computer's buses.

They scan like the firmware of a microcontroller. `hardware/firmware/PROTOCOL.md`, "What the board does", defines the
order of the steps. Between two states, and after any failure, the converter is asleep and every coil is grounded.
"""

from __future__ import annotations

import contextlib
import math
import secrets
import time
from collections import Counter
from collections.abc import Generator, Iterator, Sequence
from dataclasses import replace

from coilarray.errors import HardwareError
from coilarray.hardware.board.chip_driver import (
    ATTEMPTS,
    BUS_FAULTS,
    LOOK_AGAIN,
    ChipDriver,
    ChipSettings,
    fault_of,
    no_sample,
)
from coilarray.hardware.chips.ldc1614_registers import DEVICE, MANUFACTURER
from coilarray.hardware.scan.readings import Identity, RawSample, RawScan, SampleFault
from coilarray.hardware.scan.settings import ScanSettings
from coilarray.hardware.wire.buses import (
    BoardRestarted,
    BusFault,
    Clock,
    RegisterBus,
    SwitchChain,
    SwitchFault,
    held_signals,
)

_FAULTY_SCANS = 3  # consecutive scans with the same kind of fault in the same state, before the stream ends


class DirectReader:
    """A `Reader` that drives the chips itself, for one thread.

    First of all the switches get `safe_words`, which ground both ends of every coil. `kind` and `emulated` are passed
    on to `Identity`, which also shows a converter that does not answer.
    """

    def __init__(
        self,
        bus: RegisterBus,
        switches: SwitchChain,
        clock: Clock,
        safe_words: bytes,
        *,
        kind: str,
        emulated: bool = False,
    ) -> None:
        self._chips, self._clock = ChipDriver(bus, switches, clock), clock
        self._safe_words = safe_words
        self._chip_settings: ChipSettings | None = None
        self._failure: HardwareError | None = None
        self._faulty: Counter[int] = Counter()  # consecutive scans, by state, with a fault of the bus
        self._differing: Counter[int] = Counter()  # the same for the chain of switches
        self._closed = False
        found = (0, 0)
        with held_signals():
            self._chips.switch(safe_words)
            with contextlib.suppress(BusFault):
                self._chips.sleep()
                found = self._chips.identity()
        self._identity = Identity(kind, emulated, *found, secrets.randbits(32))

    @property
    def identity(self) -> Identity:
        """Identity of the board."""
        return self._identity

    def configure(self, settings: ScanSettings) -> None:
        """Write settings and read every register back."""
        self._chip_settings, self._failure = None, None
        self._faulty.clear()
        self._differing.clear()
        if self._closed:
            raise HardwareError("the board is closed; open it again.")
        settings.check_switching()
        chip_settings = ChipSettings.of(settings)
        if len(settings.safe_words) != len(self._safe_words):
            raise HardwareError(
                f"the settings are for {len(settings.safe_words)} switches in a chain; "
                f"the board was opened with {len(self._safe_words)}."
            )
        self._safe_words = settings.safe_words
        with self._resting_on_failure():
            self.rest()
            self._chips.configure(chip_settings)
        self._identity = replace(self._identity, manufacturer=MANUFACTURER, device=DEVICE)
        self._chip_settings = chip_settings

    def scan(self) -> RawScan:
        """Measure every state once."""
        scan = self._scan(0)
        if isinstance(self._failure, BoardRestarted):
            raise self._failure
        return scan

    def scans(self, interval: float = 0.0) -> Generator[RawScan]:
        """Scan until the iterator is closed.

        A scan runs once every `interval` in s, or as fast as possible for 0.
        """
        if not (math.isfinite(interval) and interval >= 0):
            raise HardwareError(f"the interval must be finite and not negative; got {interval} s.")
        return self._stream(interval)

    def peek(self, address: int) -> int:
        """Read a register of the converter."""
        return self._chips.bus.read(address)

    def rest(self) -> None:
        """Put the converter to sleep and ground all coils.

        The coils are grounded even if the converter does not answer.
        """
        with held_signals():
            try:
                self._chips.sleep()
            finally:
                self._chips.switch(self._safe_words)

    def close(self) -> None:
        """Put the board to rest and close both buses."""
        if self._closed:
            return
        self._chip_settings = None
        for _ in range(ATTEMPTS):
            try:
                self.rest()
                break
            except Exception:  # after any failure only another attempt is left
                continue
        self._closed = True
        self._chips.close()

    def _stream(self, interval: float) -> Generator[RawScan]:
        """Scan at the interval until the generator is closed."""
        start, sequence, turn = self._clock.now(), 0, 0
        try:
            while True:
                scan = self._scan(sequence, running=interval == 0)
                sequence = scan.sequence + 1
                yield scan
                if interval > 0:
                    passed = self._clock.now() - start
                    turn = max(turn + 1, math.ceil(passed / interval))  # missed turns are left out
                    self._clock.sleep(turn * interval - passed)
        except GeneratorExit:
            if not self._closed:  # a stream that was not closed ends with its last reference
                self.rest()
            raise

    def _scan(self, sequence: int, *, running: bool = False) -> RawScan:
        """Measure all states."""
        if self._failure is not None:
            raise self._failure
        chip_settings = self._chip_settings
        if chip_settings is None:
            raise HardwareError("the board must be open and configured before a scan.")
        with self._resting_on_failure():
            start, samples, missed = self._measured(chip_settings, running=running)
            samples = self._verified(chip_settings, samples)
        return RawScan(sequence + missed, start, time.time(), chip_settings.hash, self._identity.boot, tuple(samples))

    def _measured(self, chip_settings: ChipSettings, *, running: bool) -> tuple[float, list[RawSample], int]:
        """Measure all states of a scan."""
        start = self._clock.now()
        return start, [self._sample(chip_settings, k) for k in range(len(chip_settings.words))], 0

    def _sample(self, chip_settings: ChipSettings, k: int) -> RawSample:
        """Measure a state.

        The converter is asleep and the coils are grounded before and, even if the converter fails, after.
        """
        chips, same = self._chips, True
        try:
            if not chips.asleep:
                chips.sleep()
            same &= chips.switch(bytes(len(chip_settings.words[k])))
            same &= chips.switch(chip_settings.words[k])
            chips.wake(chip_settings, chip_settings.drives[k])
            (sample,) = chips.results(chip_settings)
            chips.sleep(attempts=1)
        except BusFault as fault:
            sample = no_sample(fault_of(fault))
        if not chips.asleep:
            with contextlib.suppress(BusFault):  # the next state tries again before it closes a switch
                chips.sleep()
        same &= chips.switch(self._safe_words)
        return sample if same else no_sample(SampleFault.SWITCHES_DIFFER)

    def _verified(self, chip_settings: ChipSettings, samples: list[RawSample]) -> list[RawSample]:
        """Return the samples of a scan after checking the converter."""
        faults = [sample.fault for sample in samples]
        try:
            kept = self._chips.hold(chip_settings, thoroughly=any(fault in BUS_FAULTS for fault in faults))
        except BusFault:  # an unconfirmed result is not a measurement
            faults = [fault or SampleFault.NOT_ACKNOWLEDGED for fault in faults]
        else:
            if not kept:
                faults = [SampleFault.CONVERTER_RESET] * len(faults)
        self._judge(chip_settings, faults)
        return [no_sample(fault) if fault else sample for fault, sample in zip(faults, samples, strict=True)]

    def _judge(self, chip_settings: ChipSettings, faults: Sequence[SampleFault]) -> None:
        """Decide whether the faults of a scan end the stream."""
        for k, fault in enumerate(faults):
            self._faulty[k] = self._faulty[k] + 1 if fault in BUS_FAULTS else 0
            self._differing[k] = self._differing[k] + 1 if fault == SampleFault.SWITCHES_DIFFER else 0
        reasons = (self._reason(chip_settings.names[k], k, fault) for k, fault in enumerate(faults))
        self._failure = next((reason for reason in reasons if reason is not None), None)
        if self._failure is None:
            return
        self._chip_settings = None
        with contextlib.suppress(HardwareError):
            if isinstance(self._failure, BusFault):
                self._chips.bus.clear()
            self.rest()

    def _reason(self, state: str, k: int, fault: SampleFault) -> HardwareError | None:
        """Return why a fault of a state ends the stream."""
        if fault == SampleFault.CONVERTER_RESET:
            return BoardRestarted("the converter lost its settings while it was measuring.")
        if self._differing[k] >= _FAULTY_SCANS:
            return SwitchFault(
                f"state {state}: the chain of switches returned other words than it was sent in {_FAULTY_SCANS} "
                "consecutive scans."
            )
        if self._faulty[k] >= _FAULTY_SCANS:
            return BusFault(f"state {state}: the converter did not answer in {_FAULTY_SCANS} consecutive scans.")
        return None

    @contextlib.contextmanager
    def _resting_on_failure(self) -> Iterator[None]:
        """Rest if any exception leaves the block."""
        try:
            yield
        except BaseException:
            with contextlib.suppress(HardwareError):  # only the first failure is reported
                self.rest()
            raise


class AutoscanReader(DirectReader):
    """A `Reader` of a converter's 1 to 4 channels.

    If a slow computer does not fetch a result in time, the next result replaces it. The lost result is left out in the
    sequence numbers of a stream.
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
