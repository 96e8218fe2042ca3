"""The firmware behind a pseudo-terminal, on the emulated board; the hooks by which a campaign of faults reaches it.

The firmware and `DirectReader` are two drivers of the same chips by the same rules: they must read the same words.
"""

import contextlib
import itertools
import os
import time

import pytest
import serial
from support.emulated_reader import WIRING, at_rest, plain, quick_settings, reader_of
from support.firmware_chips import StubChain, StubConverter
from support.firmware_host import Firmware, FirmwareHost, draft, intact, needs_compiler, seal
from support.patience import PATIENCE, until

from coilarray.hardware.emulator import VirtualClock
from coilarray.hardware.wire.buses import ComputerClock

pytestmark = [needs_compiler, pytest.mark.skipif(not hasattr(os, "openpty"), reason="no pseudo-terminals here")]

SETTINGS = quick_settings()
INDUCTANCES = {name: (40 + 3 * index) * 1e-6 for index, name in enumerate(WIRING.coils)}


class Computer:
    """The least of a driver: one port, commands one after the other."""

    def __init__(self, port, number=0):
        self.port = serial.Serial(port, 115200, timeout=0.05, exclusive=True)
        self.number, self.begun, self.lines = number, b"", []

    def next_line(self):
        end = time.monotonic() + PATIENCE
        while not self.lines:
            assert time.monotonic() < end, "no line"
            *lines, self.begun = (self.begun + self.port.read(max(1, self.port.in_waiting))).split(b"\n")
            self.lines += [intact(line) for line in lines if line]
        return self.lines.pop(0)

    def ask(self, command):
        self.number = (self.number + 1) % 256
        self.port.write(seal(f">{self.number:02X},{command}"))
        while True:
            line = self.next_line()
            if line.startswith(f"<{self.number:02X},"):
                return line[4:]

    def configure(self, settings=SETTINGS):
        return [self.ask(command) for command in draft(settings)][-1]


@contextlib.contextmanager
def hosted():
    board = plain(inductances=INDUCTANCES)
    with FirmwareHost(board.bus, board.switches, board.clock) as host:
        computer = Computer(host.port)
        try:
            yield board, host, computer
        finally:
            computer.port.close()


def test_firmware_and_direct_driver_read_the_same_words():
    direct = reader_of(plain(inductances=INDUCTANCES))
    direct.configure(SETTINGS)
    with hosted() as (board, _, computer):
        assert computer.configure() == f"OK,{SETTINGS.hash:04X}"
        words = computer.ask("SCAN").split(",")[-6:]
        assert computer.ask("STOP") == "OK"
        assert at_rest(board)
    # no noise; the state of the clock's temperature is the same at any time without drift
    read = [(f"{sample.msb:04X}{sample.lsb:04X}", sample.status) for sample in direct.scan().samples]
    assert words == [word if status == 0x48 else f"{word}.{status:04X}" for word, status in read]
    assert len(set(words)) == 6
    assert not board.chip.misuse.notes


@pytest.mark.slow
def test_stream_through_the_port():
    with hosted() as (board, host, computer):
        computer.configure()
        computer.ask("START,00000000")
        for number in range(300):
            scan, _, plan, boot, *words = computer.next_line().split(",")
            assert (scan, plan, boot) == (f"S{number:08X}", f"{SETTINGS.hash:04X}", f"{host.boot:08X}")
            assert len(words) == 6
        # time waits for the computer: never further ahead than the bytes that are not read
        assert board.clock.now() < 20.0
        assert computer.ask("STOP") == "OK"
        assert at_rest(board)


def test_hooks_get_whole_lines_out_and_all_bytes_in():
    out, into = [], []
    with hosted() as (_, host, computer):
        with host.paused():
            host.to_computer = lambda line: out.append(line) or line
            host.to_board = lambda data: into.append(data) or data
        computer.configure()
        computer.ask("SCAN")
    assert all(line.endswith(b"\n") and line.count(b"\n") == 1 for line in out)
    assert b"".join(into).count(b"\n") == len(draft(SETTINGS)) + 1


@pytest.mark.slow
def test_dropped_lines_do_not_hold_time():
    """A computer that is gone: the stream ends with its lease although nobody reads."""
    dropped = []
    with hosted() as (board, host, computer):

        def drop(line):
            dropped.append((line[:2], board.clock.now()))
            return b""

        computer.configure()
        computer.ask("START,00080000")
        with host.paused():
            host.to_computer = drop
            started = board.clock.now()
        until(lambda: [kind[:1] for kind, _ in dropped[-2:]] == [b"H", b"H"])
        with host.paused():
            assert at_rest(board)
    (end,) = [index for index, (kind, _) in enumerate(dropped) if kind == b"E1"]
    assert dropped[end][1] < started + 10.1  # the lease, and the scan that was under way
    assert {kind[:1] for kind, _ in dropped[:end]} == {b"S"}
    assert {kind[:1] for kind, _ in dropped[end + 1 :]} == {b"H"}


@pytest.mark.slow
def test_real_time():
    """Heartbeats come after every second of the computer's own clock."""
    clock = ComputerClock()
    before = time.monotonic()
    converter = StubConverter(VirtualClock())
    with FirmwareHost(converter, StubChain(VirtualClock(), converter), clock) as host:
        computer = Computer(host.port)
        asked = int(computer.ask("PING").split(",")[2], 16)
        beats = [computer.next_line() for _ in range(2)]
        took = time.monotonic() - before
        computer.port.close()
    assert all(beat.startswith("H") for beat in beats)
    times = [asked, *(int(beat.split(",")[1], 16) for beat in beats)]
    between = [(later - earlier) % 2**32 for earlier, later in itertools.pairwise(times)]  # µs, which wrap
    assert all(1e6 <= one <= 1e6 * took for one in between)


def test_an_error_of_a_chip_that_no_board_could_have_is_raised():
    clock = VirtualClock()
    converter = StubConverter(clock)
    host = FirmwareHost(converter, StubChain(clock, converter), clock)
    computer = Computer(host.port)
    computer.ask("PING")

    converter.fault = lambda verb, register: 1 / 0
    computer.port.write(seal(">55,HELLO"))
    until(lambda: not host.alive)
    with pytest.raises(ZeroDivisionError):
        host.close()
    computer.port.close()


@pytest.mark.slow
def test_ten_minutes_lose_no_scan():
    board = plain(inductances=INDUCTANCES)
    firmware = Firmware(board.bus, board.switches, board.clock)
    for number, command in enumerate(draft(SETTINGS)):
        firmware.feed(seal(f">{number:02X},{command}"))
        firmware.run(0.1)
    firmware.feed(seal(f">80,START,{1_000_000:08X}"))
    scans = 0
    for number in range(120):
        firmware.feed(seal(f">{number:02X},PING"))
        scans += firmware.run(5.0).count(b"\nS")
    assert scans == pytest.approx(600, abs=3)
    assert not board.chip.misuse.notes
