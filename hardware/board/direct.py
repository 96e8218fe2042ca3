"""Reader of a board with chips on the computer's buses.

It scans like the firmware of a microcontroller. `hardware/firmware/PROTOCOL.md`, "What the board does", defines the
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
from coilarray.hardware.board.chip_driver import ATTEMPTS, BUS_FAULTS, ChipDriver, ChipSettings, fault_of, no_sample
from coilarray.hardware.chips.ldc1614_registers import DEVICE, MANUFACTURER
from coilarray.hardware.scan.reader import Identity, RawSample, RawScan, SampleFault
from coilarray.hardware.scan.settings import ScanSettings
from coilarray.hardware.wire.buses import Clock, RegisterBus, SwitchChain
from coilarray.hardware.wire.faults import BoardRestarted, BusFault, SwitchFault
from coilarray.hardware.wire.signals import held_signals

_FAULTY_SCANS = 3  # consecutive scans with the same kind of fault in the same state, before the stream ends


class DirectReader:
    """A `Reader` that drives the chips itself, for one thread.

    First of all the switches get `safe_words`, which ground both ends of every coil. `kind` and `emulated` are passed
    on to `Identity`, which also shows a converter that does not answer. A lost port raises DeviceLost, and switches
    that cannot be reached raise a SwitchFault.
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
        """Identity of the board.

        The two registers are 0 if the converter does not answer.
        """
        return self._identity

    def configure(self, settings: ScanSettings) -> None:
        """Write settings and read every register back.

        Settings that close a forbidden connection, or are for another chain of switches, raise a HardwareError. A
        BusFault is raised as by `ChipDriver.configure`.
        """
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
        """Measure every state once.

        BoardRestarted is raised if the converter has lost its settings. BusFault or SwitchFault is raised if the
        previous scan failed, until `configure` clears it. A board that is not configured raises a HardwareError.
        """
        scan = self._scan(0)
        if isinstance(self._failure, BoardRestarted):
            raise self._failure
        return scan

    def scans(self, interval: float = 0.0) -> Generator[RawScan]:
        """Scan until the iterator is closed.

        A scan runs once every `interval` in s, or as fast as possible for 0. A scan that ends the stream is still
        returned, and the next call raises the reason. A board that is not configured, or an interval that is negative
        or not finite, raises a HardwareError.
        """
        if not (math.isfinite(interval) and interval >= 0):
            raise HardwareError(f"the interval must be finite and not negative; got {interval} s.")
        return self._stream(interval)

    def peek(self, address: int) -> int:
        """Read a register of the converter.

        A converter that does not answer raises a BusFault.
        """
        return self._chips.bus.read(address)

    def rest(self) -> None:
        """Put the converter to sleep and ground all coils.

        The coils are grounded even if the converter does not answer. Failures are raised afterwards.
        """
        with held_signals():
            try:
                self._chips.sleep()
            finally:
                self._chips.switch(self._safe_words)

    def close(self) -> None:
        """Put the board to rest and close both buses.

        The board is put to rest only if the chips answer. The method never raises and may be called again.
        """
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
        """Measure all states.

        `running` means that the next scan follows without a pause.
        """
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
        """Measure all states of a scan.

        The start of the scan in s, the samples and the number of scans missed before it are returned. The converter
        sleeps between two scans, and no scan is missed.
        """
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
        """Return the samples of a scan after checking the converter.

        The converter must still hold its settings.
        """
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
        """Decide whether the faults of a scan end the stream.

        If they do, the board is put to rest, and the next scan raises the reason.
        """
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
        """Return why a fault of a state ends the stream.

        The fault is from the last scan. None is returned if it does not end the stream.
        """
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
        """Rest if any exception leaves the block.

        KeyboardInterrupt is included.
        """
        try:
            yield
        except BaseException:
            with contextlib.suppress(HardwareError):  # only the first failure is reported
                self.rest()
            raise
