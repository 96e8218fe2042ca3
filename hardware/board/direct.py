"""Reader of a board with chips on the computer's buses.

`hardware/firmware/PROTOCOL.md`, "What the board does", defines the order of the steps. Between two
states, and after any failure, the converter is asleep and every coil is grounded.
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
from coilarray.hardware.chips.ldc1614 import ASLEEP, CHANNELS, DEVICE, MANUFACTURER, register, registers
from coilarray.hardware.scan.readings import Identity, RawSample, RawScan, SampleFault, ready_status
from coilarray.hardware.scan.settings import ScanSettings, StateSettings
from coilarray.hardware.wire import buses

ATTEMPTS = 3  # number of attempts at a step that must not fail
BUS_FAULTS = (SampleFault.NOT_ACKNOWLEDGED, SampleFault.BUS_TIMEOUT)
"""Faults of a sample that come from the bus to the converter."""
_ADDRESS = {name: found.address for name, found in registers().items()}
_NAME = {address: name for name, address in _ADDRESS.items()}
_DATA_MSB, _DATA_LSB = ([_ADDRESS[f"DATA{channel}_{half}"] for channel in range(CHANNELS)] for half in ("MSB", "LSB"))
_STATUS, _CONFIG, _RESET_DEV = _ADDRESS["STATUS"], _ADDRESS["CONFIG"], _ADDRESS["RESET_DEV"]
_CLOCK_DIVIDERS, _DRIVE_CURRENTS = (
    [_ADDRESS[f"{name}{channel}"] for channel in range(CHANNELS)] for name in ("CLOCK_DIVIDERS", "DRIVE_CURRENT")
)
_DRIVE_MASK = register("DRIVE_CURRENT0").field("IDRIVE0").mask  # the chip writes any value into the bits below
_DATA_READY, _ERRORS, _ERROR_FLAGS = 0x0040, 0xFF00, 0x3F00  # bits of STATUS
_FIXED_DRIVE = register("CONFIG").field("RP_OVERRIDE_EN").mask
_RESET = 0x8000
_RESET_TIME = 2e-3  # s. The data sheet gives it for the pin SD and no time for the register
_LOOK_AGAIN = 1e-3  # s between two looks at STATUS
_FAULTY_SCANS = 3  # consecutive scans with the same kind of fault in the same state, before the stream ends


class ChipDriver:
    """Driver of the converter and the switches, if any. `configure` comes before `wake`."""

    def __init__(self, bus: buses.RegisterBus, switches: buses.SwitchChain | None, clock: buses.Clock) -> None:
        self.bus, self.clock = bus, clock
        self._switches = switches
        self._held: bytes | None = None  # words of the switches, None if they are not known
        self._sleep_word = register("CONFIG").reset
        self._active = 0  # register CONFIG while the converter is awake
        self._resting: dict[int, int] = {}  # values of the registers by address, while it sleeps
        self.asleep = False
        """Whether the converter was put to sleep and not woken since."""
        self.ready_at = 0.0
        """Time in s by the clock at which results were last seen to be ready."""

    def identity(self) -> tuple[int, int]:
        """Read the registers MANUFACTURER_ID and DEVICE_ID."""
        return self.bus.read(_ADDRESS["MANUFACTURER_ID"]), self.bus.read(_ADDRESS["DEVICE_ID"])

    def sleep(self, attempts: int = ATTEMPTS) -> None:
        """Put the converter to sleep."""
        while True:
            attempts -= 1
            try:
                self.bus.write(_CONFIG, self._sleep_word)
            except buses.BusFault:
                if not attempts:
                    raise
                with contextlib.suppress(buses.BusFault):
                    self.bus.clear()
            else:
                self.asleep = True
                return

    def wake(self, drive: int | None = None) -> None:
        """Start converting."""
        if drive is not None:
            self.bus.write(_DRIVE_CURRENTS[0], drive)
        self.asleep = False  # first, because the write may be cut off after it was done
        self.bus.write(_CONFIG, self._active)

    def results(self, settings: ScanSettings, wait: float | None = None) -> tuple[RawSample, ...]:
        """Wait for the next results of all channels."""
        # STATUS is first read after `wait` in s, or after the discarded conversions of a converter that just woke.
        # A drive current that the converter chose is read before sleep clears it.
        channels, timeout = tuple(dict.fromkeys(state.channel for state in settings.states)), settings.timeout_us * 1e-6
        looks = self._ready(settings.wait_us * 1e-6 if wait is None else wait, timeout)
        for _ in range(settings.discard if wait is None else 0):
            if looks is not None:
                for channel in channels:
                    self.bus.read(_DATA_MSB[channel])  # clears its flags
                looks = self._ready(settings.again_us * 1e-6, timeout)
        if looks is None:
            return (_no_sample(SampleFault.NO_RESULT),) * len(channels)
        scanning = len(settings.channels) > 1
        return tuple(self._sample(channel, looks, scanning=scanning) for channel in channels)

    def _ready(self, wait: float, timeout: float) -> list[int] | None:
        start, looks = self.clock.now(), []
        self.clock.sleep(wait)
        while True:
            passed = self.clock.now() - start  # before the look, so that a later pause of the computer does not count
            looks.append(self.bus.read(_STATUS))
            if looks[-1] & _DATA_READY:
                self.ready_at = start + passed
                return looks
            if passed >= timeout:
                return None
            self.clock.sleep(_LOOK_AGAIN)

    def _sample(self, channel: int, looks: Sequence[int], *, scanning: bool) -> RawSample:
        """Read the result of a channel, counting errors of all looks."""
        # Reading STATUS clears its errors.
        try:
            msb, lsb = self.bus.read(_DATA_MSB[channel]), self.bus.read(_DATA_LSB[channel])
            drive = None if self._active & _FIXED_DRIVE else self.bus.read(_DRIVE_CURRENTS[channel])
        except buses.BusFault as fault:
            if not scanning:
                raise
            return _no_sample(fault)
        if not scanning:
            errors = 0
            for look in looks:
                errors |= look & _ERRORS
            return RawSample(msb, lsb, looks[-1] | errors, drive=drive)
        # Bits of unread results freeze with an error of any channel, but DRDY is set for all.
        status = ready_status(channel)
        for look in looks:
            if look & _ERROR_FLAGS and look >> 14 == channel:
                status |= look & _ERRORS
        return RawSample(msb, lsb, status, drive=drive)

    def switch(self, words: bytes) -> bool:
        """Send words, and return whether the previous words came back."""
        if self._switches is None:
            return True
        expected, self._held = self._held, None  # unknown until all of them are through
        returned = self._switches.shift(words)
        self._held = words
        return returned is None or expected is None or returned == expected

    def configure(self, settings: ScanSettings) -> None:
        """Write all registers of a sleeping converter and verify them."""
        for attempts_left in reversed(range(ATTEMPTS)):
            try:
                self._write(settings)
            except buses.BusFault:
                if not attempts_left:
                    raise
                self._reset()
            else:
                return

    def hold(self, *, thoroughly: bool) -> bool:
        """Check whether the converter still has its settings."""
        # One register shows a reset. All registers show a corrupted transfer.
        kept = self._resting
        addresses = kept if thoroughly else [address for address in _CLOCK_DIVIDERS if address in kept][:1]
        return all((self.bus.read(address) ^ kept[address]) & _mask(address) == 0 for address in addresses)

    def close(self) -> None:
        """Close both buses, and never raise."""
        for port in (self.bus, self._switches):
            with contextlib.suppress(Exception):
                if port is not None:
                    port.close()

    def _write(self, settings: ScanSettings) -> None:
        found = self.identity()
        if found != (MANUFACTURER, DEVICE):
            raise buses.BusFault(
                f"the chip must be an LDC1614 or one of its kind, {MANUFACTURER:04X}/{DEVICE:04X}; "
                f"got {found[0]:04X}/{found[1]:04X}."
            )
        registers = dict(settings.registers)
        self._active, self._resting = registers[_CONFIG], registers | {_CONFIG: registers[_CONFIG] | ASLEEP}
        written = [*self._resting.items()]
        if not settings.wired:  # the drive current of the first state, to read it back
            written.append((_DRIVE_CURRENTS[0], settings.drive_register(settings.states[0])))
        for address, value in written:
            self.bus.write(address, value)
        self._sleep_word = self._resting[_CONFIG]
        for address, value in written:
            got = self.bus.read(address)
            if (got ^ value) & _mask(address):
                raise buses.BusFault(f"register {_NAME[address]} must read {value:#06x} as written; got {got:#06x}.")

    def _reset(self) -> None:
        """Reset a converter after a possibly interrupted transfer."""
        with contextlib.suppress(buses.BusFault):
            self.bus.clear()
            self.bus.write(_RESET_DEV, _RESET)
            self.clock.sleep(_RESET_TIME)
            self._sleep_word = register("CONFIG").reset
            self.sleep()


class DirectReader:
    """A `Reader` that drives the chips itself, for one thread."""

    # Without switches the converter converts all the time in a stream. The next result replaces one that a slow
    # computer does not fetch, which only the times of the scans show.

    def __init__(
        self,
        bus: buses.RegisterBus,
        switches: buses.SwitchChain | None,
        clock: buses.Clock,
        safe_words: bytes = b"",
        *,
        kind: str,
        emulated: bool = False,
    ) -> None:
        self._chips, self._clock = ChipDriver(bus, switches, clock), clock
        self._safe_words = safe_words
        self._settings: ScanSettings | None = None
        self._failure: HardwareError | None = None
        self._faulty: Counter[int] = Counter()  # consecutive scans, by state, with a fault of the bus
        self._differing: Counter[int] = Counter()  # the same for the chain of switches
        self._closed = False
        found = (0, 0)
        with buses.held_signals():
            self._chips.switch(safe_words)
            with contextlib.suppress(buses.BusFault):
                self._chips.sleep()
                found = self._chips.identity()
        self._identity = Identity(kind, emulated, *found, secrets.randbits(32))

    @property
    def identity(self) -> Identity:
        """Identity of the board."""
        return self._identity

    def configure(self, settings: ScanSettings) -> None:
        """Write settings and read every register back."""
        self._settings, self._failure = None, None
        self._faulty.clear()
        self._differing.clear()
        if self._closed:
            raise HardwareError("the board is closed; open it again.")
        settings.check_switching()
        if len(settings.safe_words) != len(self._safe_words):
            raise HardwareError(
                f"the settings are for {len(settings.safe_words)} switches in a chain; "
                f"the board was opened with {len(self._safe_words)}."
            )
        self._safe_words = settings.safe_words
        with self._resting_on_failure():
            self.rest()
            self._chips.configure(settings)
        self._identity = replace(self._identity, manufacturer=MANUFACTURER, device=DEVICE)
        self._settings = settings

    def scan(self) -> RawScan:
        """Measure every state once."""
        scan = self._scan(0)
        if isinstance(self._failure, buses.BoardRestarted):
            raise self._failure
        return scan

    def scans(self, interval: float = 0.0) -> Generator[RawScan]:
        """Scan every `interval` in s until the iterator is closed."""
        if not (math.isfinite(interval) and interval >= 0):
            raise HardwareError(f"the interval must be finite and not negative; got {interval} s.")
        return self._stream(interval)

    def rest(self) -> None:
        """Put the converter to sleep, and always ground all coils."""
        with buses.held_signals():
            try:
                self._chips.sleep()
            finally:
                self._chips.switch(self._safe_words)

    def close(self) -> None:
        """Put the board to rest and close both buses."""
        if self._closed:
            return
        self._settings = None
        for _ in range(ATTEMPTS):
            try:
                self.rest()
                break
            except Exception:  # after any failure only another attempt is left
                continue
        self._closed = True
        self._chips.close()

    def _stream(self, interval: float) -> Generator[RawScan]:
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
        """Measure all states, and leave a `running` converter awake."""
        if self._failure is not None:
            raise self._failure
        settings = self._settings
        if settings is None:
            raise HardwareError("the board must be open and configured before a scan.")
        with self._resting_on_failure():
            start = self._clock.now()
            if self._safe_words:
                samples = [self._sample(settings, state) for state in settings.states]
            else:
                start, samples = self._channels(settings, running=running)
            faults = [sample.fault for sample in samples]
            try:
                kept = self._chips.hold(thoroughly=any(fault in BUS_FAULTS for fault in faults))
            except buses.BusFault:  # an unconfirmed result is not a measurement
                faults = [fault or SampleFault.NOT_ACKNOWLEDGED for fault in faults]
            else:
                if not kept:
                    faults = [SampleFault.CONVERTER_RESET] * len(faults)
            self._judge(settings, faults)
            samples = [_no_sample(fault) if fault else sample for fault, sample in zip(faults, samples, strict=True)]
        return RawScan(sequence, start, time.time(), settings.hash, self._identity.boot, tuple(samples))

    def _sample(self, settings: ScanSettings, state: StateSettings) -> RawSample:
        # The converter sleeps and the coils are grounded before and, even if the converter fails, after.
        chips, same, words = self._chips, True, state.words
        try:
            if not chips.asleep:
                chips.sleep()
            same &= chips.switch(bytes(len(words)))
            same &= chips.switch(words)
            chips.wake(settings.drive_register(state))
            (sample,) = chips.results(settings)
            chips.sleep(attempts=1)
        except buses.BusFault as fault:
            sample = _no_sample(fault)
        if not chips.asleep:
            with contextlib.suppress(buses.BusFault):  # the next state tries again before it closes a switch
                chips.sleep()
        same &= chips.switch(self._safe_words)
        return sample if same else _no_sample(SampleFault.SWITCHES_DIFFER)

    def _channels(self, settings: ScanSettings, *, running: bool) -> tuple[float, list[RawSample]]:
        """Measure all channels, and return when their results began."""
        chips, start = self._chips, self._clock.now()
        try:
            if running and not chips.asleep:
                # A fast oscillator is early by less than a slow oscillator is late.
                again = settings.again_us * 1e-6
                turn = again * settings.slowest_reference / settings.reference  # from result to result, nominally
                look = chips.ready_at + 2 * turn - again - 2 * _LOOK_AGAIN
                samples = list(chips.results(settings, max(look - start, 0.0)))
                start = chips.ready_at - turn
            else:
                if not chips.asleep:
                    chips.sleep()
                chips.wake()
                samples = list(chips.results(settings))
        except buses.BusFault as fault:
            samples = [_no_sample(fault)] * len(settings.states)
        if not running or any(sample.fault is not SampleFault.NONE for sample in samples):
            with contextlib.suppress(buses.BusFault):  # a remaining fault shows in the next scan
                chips.sleep()
        return start, samples

    def _judge(self, settings: ScanSettings, faults: Sequence[SampleFault]) -> None:
        """Decide whether the faults of a scan end the stream."""
        for k, fault in enumerate(faults):
            state = settings.states[k].name
            self._faulty[k] = self._faulty[k] + 1 if fault in BUS_FAULTS else 0
            self._differing[k] = self._differing[k] + 1 if fault == SampleFault.SWITCHES_DIFFER else 0
            reason: HardwareError | None = None
            if fault == SampleFault.CONVERTER_RESET:
                reason = buses.BoardRestarted("the converter lost its settings while it was measuring.")
            elif self._differing[k] >= _FAULTY_SCANS:
                reason = buses.SwitchFault(
                    f"state {state}: the chain of switches returned other words than it was sent in {_FAULTY_SCANS} "
                    "consecutive scans."
                )
            elif self._faulty[k] >= _FAULTY_SCANS:
                reason = buses.BusFault(
                    f"state {state}: the converter did not answer in {_FAULTY_SCANS} consecutive scans."
                )
            self._failure = self._failure or reason
        if self._failure is not None:
            self._settings = None
            with contextlib.suppress(HardwareError):
                if isinstance(self._failure, buses.BusFault):
                    self._chips.bus.clear()
                self.rest()

    @contextlib.contextmanager
    def _resting_on_failure(self) -> Iterator[None]:
        try:
            yield
        except BaseException:
            with contextlib.suppress(HardwareError):  # only the first failure is reported
                self.rest()
            raise


def _mask(address: int) -> int:
    """Return the bits of a register that read back unchanged."""
    return _DRIVE_MASK if address in _DRIVE_CURRENTS else 0xFFFF


def _no_sample(fault: SampleFault | buses.BusFault) -> RawSample:
    if isinstance(fault, buses.BusFault):
        fault = SampleFault.BUS_TIMEOUT if isinstance(fault, buses.BusTimeout) else SampleFault.NOT_ACKNOWLEDGED
    return RawSample(0, 0, 0, fault)
