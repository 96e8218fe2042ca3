"""FT232H: what the commands to its engine do at the pins, with pyftdi's own code between, down to the edges.

The engine below executes the commands of the chip's application note AN_108; on its pins hang chips that know edges.
"""

from types import SimpleNamespace

import pytest
from support.emulated_reader import WIRING
from support.firmware_chips import I2cSlave, ShiftRegisters, StubConverter

from coilarray.errors import HardwareError
from coilarray.hardware.board.connect import open_board
from coilarray.hardware.emulator.board import VirtualClock
from coilarray.hardware.wire.buses import DeviceLost, Ft232h

pyftdi_i2c = pytest.importorskip("pyftdi.i2c", reason="pyftdi is not installed")
from pyftdi.ftdi import Ftdi, FtdiError  # noqa: E402
from pyftdi.usbtools import UsbToolsError  # noqa: E402

URL = "ftdi://ftdi:232h/1"
CLOCK, DATA, SYNC, BACK = range(4)  # pins C0 to C3


class Engine(Ftdi):
    """The serial engine of an FT232H with chips on its pins; pyftdi talks to it instead of to USB."""

    bench = None  # what is on the pins: set by the tests

    def open_mpsse_from_url(self, url, **options):
        bench = self.bench
        if bench.refuses is not None:
            raise bench.refuses
        self._connected, self._answers = True, bytearray()
        self._low = [options["initial"] & 0xFF, options["direction"] & 0xFF]
        self._high = [options["initial"] >> 8, options["direction"] >> 8]
        self._levels()
        return options["frequency"]

    is_connected = property(lambda self: getattr(self, "_connected", False))
    fifo_sizes = property(lambda self: (1024, 1024))
    has_wide_port = property(lambda self: self.bench.wide)
    mpsse_bit_delay = property(lambda self: 0.5e-6)

    def enable_3phase_clock(self, enable=True):
        assert enable

    def enable_drivezero_mode(self, lines):
        assert lines == 0b111

    def close(self, freeze=False):
        self.bench.closed.append(freeze)
        self._connected = False

    def read_data_bytes(self, size, attempt=1, request_gen=None):
        taken, self._answers = self._answers[:size], self._answers[size:]
        return bytearray() if self.bench.dumb else taken

    def write_data(self, data):
        if self.bench.unplugged:
            raise FtdiError("UsbError: [Errno 19] No such device (it may have been disconnected)")
        self.bench.writes += 1
        rest = list(data)
        while rest:
            self._execute(rest.pop(0), rest)
        return len(data)

    def _execute(self, command, rest):
        if command == 0x80:
            self._low = [rest.pop(0), rest.pop(0)]
            self._levels()
        elif command == 0x82:
            self._high = [rest.pop(0), rest.pop(0)]
            self._levels()
        elif command == 0x81:
            self._answers.append(self._low[0] & ~4 | self._levels() << 2)
        elif command == 0x83:
            back = int(self.bench.chain.dout) << BACK
            self._answers.append(self._high[0] & self._high[1] & ~(1 << BACK) | back)
        elif command == 0x11:  # bytes out, at falling edges, highest bit first
            for _ in range(rest.pop(0) + (rest.pop(0) << 8) + 1):
                byte = rest.pop(0)
                for bit in reversed(range(8)):
                    self._pulse(byte >> bit & 1)
        elif command == 0x13:  # bits out
            count, byte = rest.pop(0) + 1, rest.pop(0)
            for k in range(count):
                self._pulse(byte >> (7 - k) & 1)
        elif command == 0x20:  # bytes in, at rising edges
            for _ in range(rest.pop(0) + (rest.pop(0) << 8) + 1):
                self._bits_in(8)
        elif command == 0x22:  # bits in
            self._bits_in(rest.pop(0) + 1)
        else:
            assert command == 0x87, f"command {command:#04x} is not for the engine"

    def _bits_in(self, count):
        self._answers.append(int("".join(str(self._pulse()) for _ in range(count)), 2))

    def _pulse(self, bit=None):
        """One clock; a bit out, or, released, the level in."""
        if bit is not None:
            self._low[0] = self._low[0] & ~2 | bit << 1
        self._low[0] &= ~1
        self._levels()
        self._low[0] |= 1
        level = self._levels()
        self._low[0] &= ~1
        self._levels()
        return level

    def _levels(self):
        """Drive the pins; return the level of SDA on the wire."""
        value, out = self._low
        scl, sda = (value & 1 if out & 1 else 1), (value >> 1 & 1 if out & 2 else 1)
        level, driven = self._high
        assert not driven & ~0b111
        level |= ~driven  # pulled up
        for wire, pin in (("sync", SYNC), ("din", DATA), ("sclk", CLOCK)):
            self.bench.chain.drive(wire, bool(level >> pin & 1))
        return self.bench.chip.line(scl, sda)


class Bench:
    def __init__(self):
        converter, self.latched = StubConverter(VirtualClock()), []
        self.registers, self.chip = converter.registers, I2cSlave(converter)
        self.chain = ShiftRegisters(SimpleNamespace(shift=self.latched.append), 6)
        self.wide, self.unplugged, self.dumb, self.refuses = True, False, False, None
        self.writes, self.closed = 0, []


@pytest.fixture
def bench(monkeypatch):
    made = Bench()
    monkeypatch.setattr(Engine, "bench", made)
    monkeypatch.setattr(pyftdi_i2c, "Ftdi", Engine)
    return made


def opened(**options):
    return Ft232h(URL, 0x2A, **options)


def test_a_register_is_read_with_a_repeated_start_and_written_in_one_transfer_highest_byte_first(bench):
    bus = opened()
    assert bus.read(0x7E) == 0x5449
    assert (bench.chip.transfers, bench.chip.stops) == ([[0x54, 0x7E], [0x55]], 1)
    bus.write(0x14, 0x1002)
    assert (bench.chip.transfers[2:], bench.chip.stops) == ([[0x54, 0x14, 0x10, 0x02]], 2)
    assert bus.read(0x14) == 0x1002


def test_clearing_the_bus_is_nine_clocks_and_a_stop(bench):
    bus = opened()
    rises = []
    line = bench.chip.line

    def watch(scl, sda):
        if scl and not bench.chip.scl:
            rises.append(sda)
        return line(scl, sda)

    bench.chip.line = watch
    bus.clear()
    assert rises == [1] * 9 + [0]  # SDA falls while the clock is low and rises while it is high
    assert bench.chip.stops == 1
    assert bus.read(0x7E) == 0x5449


WORDS = b"\x01\x02\x04\x80\xa5\xff"


@pytest.mark.parametrize("mode", [1, 2])
def test_words_arrive_bit_by_bit_latched_by_sync_and_come_back_at_the_next_transfer(bench, mode):
    switches = opened(mode=mode, readback=True)
    # the clock idles where its mode has it from the beginning
    assert (bench.chain.level["sclk"], bench.chain.level["sync"], bench.latched) == (mode == 2, True, [])
    before = bench.writes
    switches.shift(WORDS)
    assert bench.writes - before == 1  # one message to the adapter
    assert (bench.latched, bench.chain.clocks) == ([WORDS], 48)
    assert (switches.shift(bytes(6)), switches.shift(bytes(6))) == (WORDS, bytes(6))


def test_an_adapter_that_is_unplugged_is_lost(bench):
    bus = opened()
    bench.unplugged = True
    for step in (lambda: bus.read(0), lambda: bus.write(0, 0), bus.clear, lambda: bus.shift(bytes(6))):
        with pytest.raises(DeviceLost, match=r"the adapter ftdi://ftdi:232h/1 is gone: UsbError"):
            step()
    for port in (bus, bus):  # which leaves the pins as they are, and may be repeated
        port.close()
    assert set(bench.closed) == {True}


@pytest.mark.parametrize(("error", "message"), [
    (UsbToolsError("No USB device matches URL ftdi://ftdi:232h/1"), "No USB device matches URL"),
    (OSError(13, "Access denied (insufficient permissions)"), "insufficient permissions"),
])  # fmt: skip
def test_an_adapter_that_cannot_be_opened_is_one_line(bench, error, message):
    bench.refuses = error
    with pytest.raises(HardwareError, match=rf"ftdi://ftdi:232h/1 cannot be opened: .*{message}"):
        opened()


def test_an_adapter_without_a_second_port_is_refused_and_closed(bench):
    bench.wide = False
    with pytest.raises(HardwareError, match="has no pins C0 to C7 for the switches"):
        opened()
    assert bench.closed
    # without switches, any adapter will do, and its other pins stay as they are
    with open_board(f"{URL}?channels=0") as board:
        assert (board.wiring.channels, board.identity.device) == ((0,), 0x3055)
    assert not bench.latched


@pytest.mark.lowest
def test_a_board_at_the_adapter_is_opened_grounded_and_asleep(bench):
    bench.registers[0x1A] = 0x1401
    with open_board(f"{URL}?readback=yes") as board:
        assert board.line.startswith("ftdi://ftdi:232h/1?readback=yes: FT232H; LDC1614 (5449/3055); wiring six_coils;")
        assert (bench.latched, bench.registers[0x1A]) == ([WIRING.safe_words], 0x2801)
        bench.registers[0x1A] = 0x1401
    assert (bench.registers[0x1A], bench.latched[-1]) == (0x2801, WIRING.safe_words)
    assert bench.closed == [True]
