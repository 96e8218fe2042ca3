"""Reader of a microcontroller board with the protocol of `hardware/firmware/PROTOCOL.md`."""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Generator
from contextlib import nullcontext, suppress

from coilarray.errors import HardwareError
from coilarray.hardware.scan.readings import Identity, RawScan, SampleFault
from coilarray.hardware.scan.settings import ScanSettings
from coilarray.hardware.wire import buses, protocol
from coilarray.hardware.wire.ports import BAUD, OpenSerialPort, choose_serial_port

LONGEST_INTERVAL = 2147.0  # longest time between two scans of a stream in s: half a wrap of the board's clock
_HASH = re.compile("([0-9A-F]{4})(?:,.*)?").fullmatch
_CHAIN = re.compile("(same|differ|none)(?:,.*)?").fullmatch
_LOOK_AGAIN = 0.1  # s between two looks for a port that is not back yet

_ENDS: dict[protocol.StreamEndReason, tuple[type[HardwareError], str]] = {
    protocol.StreamEndReason.LEASE: (buses.NoAnswer, "it heard nothing of this computer in time"),
    protocol.StreamEndReason.CONVERTER_RESET: (buses.BoardRestarted, "the converter was reset; configure it again"),
    protocol.StreamEndReason.BUS_FAULT: (buses.BusFault, "the converter does not answer; configure it again"),
    protocol.StreamEndReason.SWITCHES_DIFFER: (
        buses.SwitchFault,
        "the switches do not hold what they were sent; configure it again",
    ),
}
_SIGNS = {
    SampleFault.CONVERTER_RESET: protocol.StreamEndReason.CONVERTER_RESET,
    SampleFault.SWITCHES_DIFFER: protocol.StreamEndReason.SWITCHES_DIFFER,
    SampleFault.NOT_ACKNOWLEDGED: protocol.StreamEndReason.BUS_FAULT,
    SampleFault.BUS_TIMEOUT: protocol.StreamEndReason.BUS_FAULT,
}


def open_microcontroller(
    port: str, *, baud: int = BAUD, times: protocol.LinkTimes | None = None
) -> MicrocontrollerReader:
    """Open a new session with a microcontroller board."""
    chosen = choose_serial_port(port)
    same = f"usb:{chosen.serial_number}" if chosen.serial_number else chosen.name
    opened = OpenSerialPort(chosen.name, baud=baud)
    try:
        return MicrocontrollerReader(
            opened, times=times, reopen=lambda: open_microcontroller(same, baud=baud, times=times)
        )
    except BaseException:
        opened.close()
        raise


class MicrocontrollerReader:
    """Reader of a serial board for one session, or another by `reconnect`."""

    # So scans are never mixed. The board ends a stream (NoAnswer) if no scan is fetched for ten seconds.

    def __init__(
        self,
        port: OpenSerialPort,
        *,
        times: protocol.LinkTimes | None = None,
        clock: buses.Clock | None = None,
        reopen: Callable[[], MicrocontrollerReader] | None = None,
    ) -> None:
        self._session = protocol.Session(port, times=times or protocol.LinkTimes(), clock=clock)
        self._reopen = reopen
        self._settings: ScanSettings | None = None
        self._stream = 0  # number of the running stream, 0 without a stream
        self._streams = 0
        self._silent = False  # whether it did not answer STOP
        self._unsure = False  # whether the board may still be measuring: it must be stopped first
        self._faults: frozenset[SampleFault] = frozenset()  # of the last scan of the stream
        self._after, self._sequence = 0, -1  # time in µs and number of the last scan

    @property
    def identity(self) -> Identity:
        """Identity of the board."""
        greeting = self._session.greeting
        kind = f"{greeting.firmware}, protocol {greeting.version[0]}.{greeting.version[1]}"
        return Identity(kind, False, greeting.manufacturer, greeting.device, greeting.boot)

    def configure(self, settings: ScanSettings) -> None:
        """Send the board its settings."""
        settings.check_switching()
        if settings.wired:
            raise HardwareError(
                "the firmware converts channel 0 alone; settings of coils at channels are for a converter at a bus of "
                "this computer."
            )
        greeting = self._session.greeting
        for what, count, most in (
            ("states", len(settings.states), greeting.most_states),
            ("devices", len(settings.safe_words), greeting.most_devices),
        ):
            if count > most:
                raise HardwareError(f"settings for this board must have at most {most} {what}; got {count}.")
        self._prepare()
        self._settings = None
        *commands, commit = protocol.draft_commands(settings)
        for command in commands:
            self._session.ask(protocol.ANYTHING, *command)
        held = self._session.ask(_HASH, *commit, patience=_longest_scan(settings))[1]
        if int(held, 16) != settings.hash:
            raise buses.BusFault(f"the board holds the settings {held}, not {settings.hash:04X}; configure it again.")
        self._settings = settings

    def scan(self) -> RawScan:
        """Measure every state once."""
        settings = self._configured()
        self._after, self._sequence = self._session.newest, -1
        try:
            scan = self._passed(
                settings, self._session.ask(protocol.read_scan, "SCAN", patience=_longest_scan(settings))
            )
        except buses.CommandRefused as refusal:
            raise self._refused(refusal) from None
        except (buses.NoAnswer, buses.NotABoard):
            self._unsure = True  # it may still start to measure
            raise
        if scan is None:
            raise buses.NoAnswer(f"the board at {self._session.name} answered SCAN with a scan that was not requested.")
        self._faults = frozenset(sample.fault for sample in scan.samples)
        if SampleFault.CONVERTER_RESET in self._faults:
            raise self._ended(protocol.StreamEndReason.CONVERTER_RESET)
        return scan

    def scans(self, interval: float = 0.0) -> Generator[RawScan]:
        """Scan until the iterator is closed."""
        if not 0 <= interval <= LONGEST_INTERVAL:
            raise HardwareError(f"interval must be 0 to {LONGEST_INTERVAL:g} s; got {interval:g}.")
        return self._run(self._configured(), round(interval * 1e6))

    def rest(self) -> None:
        """Ground all coils and put the converter to sleep."""
        self._session.check()
        self._stream = 0
        self._unsure = True
        try:
            self._session.ask(protocol.ANYTHING, "STOP", patience=_longest_scan(self._settings))
        except (buses.BusFault, buses.CommandRefused):  # the coils are grounded, but the converter did not obey
            self._unsure = self._silent = False
            raise
        except (buses.NoAnswer, buses.NotABoard):
            self._silent = True
            raise
        self._unsure = self._silent = False

    def check_chain(self) -> str:
        """Compare sent and returned words of the chain of switches."""
        self._prepare()
        return self._session.ask(_CHAIN, "CHAIN")[1]

    def close(self) -> None:
        """Put a board that still answers to rest, and close."""
        # A board that did not answer STOP gets another STOP, whose reply is not awaited.
        try:
            with suppress(Exception):
                if self._silent:
                    self._session.wake()
                    self._session.post("STOP")
                else:
                    self.rest()
        finally:
            self._session.close()

    def reconnect(self, patience: float = 0.0) -> MicrocontrollerReader:
        """Open another session with the same device within `patience` in s."""
        # The device is found by its USB serial number, and not configured.
        self.close()
        if self._reopen is None:
            raise HardwareError(f"{self._session.name} cannot be opened again by this reader.")
        clock = self._session.clock
        end = clock.now() + patience
        while True:
            try:
                return self._reopen()
            except buses.VersionMismatch:
                raise
            except HardwareError:
                if clock.now() >= end:
                    raise
            clock.sleep(_LOOK_AGAIN)

    def _prepare(self) -> None:
        """Check that the session goes on without a stream."""
        self._session.check()
        if self._stream:
            raise HardwareError("a stream is running; close its iterator first.")
        if self._unsure:
            self.rest()

    def _configured(self) -> ScanSettings:
        self._prepare()
        if self._settings is None:
            raise HardwareError("the board must be configured before it can scan.")
        return self._settings

    def _passed(self, settings: ScanSettings, message: protocol.ScanMessage) -> RawScan | None:
        """Return a later scan of the same settings, else None."""
        self._session.check_boot(message.boot)
        microseconds = self._session.unwrap(message.time)
        if microseconds < self._after:
            return None
        if message.configuration != settings.hash:
            self._settings = None
            raise buses.BoardRestarted(
                f"the board measures with the settings {message.configuration:04X}, not with {settings.hash:04X}; "
                "configure it again."
            )
        if len(message.samples) != len(settings.states) or message.sequence <= self._sequence:
            return None
        self._after, self._sequence = microseconds, message.sequence
        board_time = microseconds * 1e-6
        return RawScan(message.sequence, board_time, time.time(), message.configuration, message.boot, message.samples)

    def _run(self, settings: ScanSettings, interval: int) -> Generator[RawScan]:
        if self._configured() is not settings:
            raise HardwareError("the board was configured again after the scans were requested; request them again.")
        longest = _longest_scan(settings)
        self._session.ping(longest)  # scans of this stream are not older than this
        self._after, self._sequence = self._session.newest, -1
        self._streams += 1
        mine = self._stream = self._streams
        self._unsure, self._faults = True, frozenset()
        failed = True
        try:
            self._session.ask(protocol.ANYTHING, "START", f"{interval:08X}", patience=longest)
            yield from self._fetch(mine, settings, max(interval * 1e-6, settings.period()), longest)
            failed = False
        except GeneratorExit:
            failed = False
            raise
        except buses.CommandRefused as refusal:
            raise self._refused(refusal) from None
        finally:
            if self._stream == mine:
                with suppress(HardwareError) if failed else nullcontext():
                    self.rest()
                self._stream = 0

    def _fetch(self, mine: int, settings: ScanSettings, period: float, longest: float) -> Generator[RawScan]:
        """Yield the scans of the stream until `rest`."""
        now, times = self._session.clock.now, self._session.times
        gap, silence = max(times.gap * period, times.least_gap + longest), times.heartbeat + longest
        scan_due, line_due, ping_due = now() + gap, now() + silence, now() + times.ping
        while self._stream == mine:
            if now() >= ping_due:
                ping_due = now() + times.ping
                self._session.post("PING")
            message = self._session.receive(min(scan_due, line_due, ping_due))
            scan = self._passed(settings, message) if isinstance(message, protocol.ScanMessage) else None
            if scan is not None:
                self._faults = frozenset(sample.fault for sample in scan.samples)
                yield scan
                if SampleFault.CONVERTER_RESET in self._faults:
                    raise self._ended(protocol.StreamEndReason.CONVERTER_RESET)
                scan_due, line_due = now() + gap, now() + silence
                continue
            if message is not None:
                self._heed(message)
                line_due = now() + silence
            elif now() >= min(scan_due, line_due):
                fault = self._session.silence_fault(f"no scan came from {self._session.name} in time.")
                raise self._end_unheard() or fault

    def _heed(self, message: protocol.Message) -> None:
        if isinstance(message, protocol.StreamEnd):
            raise self._ended(message.reason, message.text)
        mode = protocol.Mode.STREAMING
        if isinstance(message, protocol.Answer):
            if pong := protocol.read_pong(message.text):
                self._session.keep(pong)
                mode = pong.mode
        elif isinstance(message, protocol.Heartbeat) and self._session.present(
            message.time
        ):  # it is not from before the stream
            mode = message.mode
        if mode is protocol.Mode.STREAMING:
            return
        fault = self._end_unheard()
        if fault is None and mode is protocol.Mode.UNCONFIGURED:
            self._settings = None
            fault = buses.BoardRestarted(
                f"the board at {self._session.name} has lost its settings; configure it again."
            )
        raise fault or buses.NoAnswer(
            f"the board at {self._session.name} has ended the scans, and its reason was lost."
        )

    def _refused(self, refusal: buses.CommandRefused) -> HardwareError:
        self._settings = None
        return self._end_unheard() or refusal

    def _end_unheard(self) -> HardwareError | None:
        """Return the fault of a stream that stopped silently."""
        reason = next((_SIGNS[fault] for fault in sorted(self._faults) if fault in _SIGNS), None)
        return None if reason is None else self._ended(reason)

    def _ended(self, reason: protocol.StreamEndReason, text: str = "") -> HardwareError:
        if reason is not protocol.StreamEndReason.LEASE:
            self._settings = None
        kind, meaning = _ENDS[reason]
        said = f" ({text})" if text else ""
        return kind(f"the board at {self._session.name} has ended the scans: {meaning}{said}.")


def _longest_scan(settings: ScanSettings | None) -> float:
    """Return the time of a scan without results in s."""
    if settings is None:
        return 0.0
    state = settings.state_time()
    timeouts = (1 + settings.discard) * settings.timeout_us * 1e-6
    return len(settings.states) * (timeouts + state.total - state.until_ready)
