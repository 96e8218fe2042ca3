"""Linux buses: what the kernel is asked to put on the wire, and one line for everything that it may answer.

smbus2 itself runs; only the system call below it is played. spidev is a C module, so that a stand-in takes its place.
"""

import ctypes
import errno
import os
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest
from support.emulated_reader import WIRING

from coilarray.errors import HardwareError
from coilarray.hardware.board.connect import open_board
from coilarray.hardware.wire import buses as linux_host
from coilarray.hardware.wire.buses import (
    BusFault,
    BusTimeout,
    DeviceLost,
    LinuxRegisterBus,
    SpiSwitchChain,
    SwitchFault,
    linux_buses,
)

if sys.platform != "linux":
    pytest.skip("no i2c-dev on this system", allow_module_level=True)
smbus2 = pytest.importorskip("smbus2", reason="smbus2 is not installed")

FULL_I2C, SMBUS_ONLY = 0x0EFF0009, 0x00FF0000
READ = 0x0001  # flag of a message


class Kernel:
    """i2c-dev and a converter behind it: notes every message as (address, flags, bytes)."""

    def __init__(self):
        self.functions = FULL_I2C
        self.registers = {0x7E: 0x5449, 0x7F: 0x3055}
        self.transfers = []
        self.fails = []  # numbers of errors of the next transfers
        self._pointer = 0

    def ioctl(self, descriptor, request, argument):
        os.fstat(descriptor)  # open
        if request == 0x0705:  # I2C_FUNCS
            argument.value = self.functions
            return 0
        assert request == 0x0707, "only I2C_RDWR transfers: they alone have a repeated start"
        transfer = []
        self.transfers.append(transfer)
        for k in range(argument.nmsgs):
            message = argument.msgs[k]
            data = ctypes.string_at(message.buf, message.len)
            transfer.append((message.addr, message.flags, message.len if message.flags & READ else data))
            if message.addr != 0x2A:
                raise OSError(errno.ENXIO, os.strerror(errno.ENXIO))
            if self.fails:
                raise OSError(number := self.fails.pop(0), os.strerror(number))
            if message.flags & READ:
                value = self.registers.get(self._pointer, 0)
                ctypes.memmove(message.buf, value.to_bytes(2, "big"), message.len)
            else:
                self._pointer = data[0]
                if len(data) == 3:
                    self.registers[data[0]] = data[1] << 8 | data[2]
        return 0


class SpiDev:
    """Stand-in of spidev.SpiDev on a chain of six."""

    instances = ()

    def __init__(self):
        self.sent, self.held, self.closed, self.fails = [], bytes(6), 0, None
        self.path = self.mode = self.max_speed_hz = self.bits_per_word = None
        type(self).instances = (*type(self).instances, self)

    def open_path(self, path):
        os.close(os.open(path, os.O_RDWR))
        self.path = path

    def xfer2(self, values):
        if self.fails is not None:
            raise OSError(self.fails, os.strerror(self.fails))
        assert all(isinstance(value, int) for value in values)
        self.sent.append(bytes(values))
        before, self.held = self.held, bytes(values)
        return list(before)

    def close(self):
        self.closed += 1


@pytest.fixture
def devices(monkeypatch, tmp_path):
    monkeypatch.setattr(linux_host, "DEVICES", tmp_path)
    for name in ("i2c-1", "i2c-20", "spidev0.0", "spidev0.1", "tty1"):
        (tmp_path / name).touch()
    return tmp_path


@pytest.fixture
def kernel(monkeypatch, devices):
    played = Kernel()
    monkeypatch.setattr(smbus2.smbus2, "ioctl", played.ioctl)
    return played


@pytest.fixture
def spi(monkeypatch, devices):
    SpiDev.instances = ()
    monkeypatch.setitem(sys.modules, "spidev", SimpleNamespace(SpiDev=SpiDev))
    return lambda: SpiDev.instances[-1]


@pytest.fixture
def bus(kernel):
    return LinuxRegisterBus(1, 0x2A)


def test_a_register_is_read_with_a_repeated_start_and_written_in_one_message_highest_byte_first(kernel, bus):
    assert bus.read(0x7E) == 0x5449
    assert kernel.transfers.pop() == [(0x2A, 0, b"\x7e"), (0x2A, READ, 2)]
    bus.write(0x14, 0x1002)
    assert kernel.transfers.pop() == [(0x2A, 0, b"\x14\x10\x02")]
    assert bus.read(0x14) == 0x1002
    bus.clear()  # nine clocks that nobody acknowledges
    assert kernel.transfers.pop() == [(0x00, READ, 1)]


@pytest.mark.parametrize(("number", "fault", "message"), [
    *((number, BusFault, "does not answer") for number in (errno.EREMOTEIO, errno.ENXIO, errno.EIO)),
    *((number, BusTimeout, "holds up the bus") for number in (errno.ETIMEDOUT, errno.EAGAIN, errno.EBUSY)),
    (errno.ENODEV, DeviceLost, "is gone"),
])  # fmt: skip
def test_what_the_kernel_says_of_a_transfer_has_a_name(kernel, bus, number, fault, message):
    kernel.fails = [number, number]
    for step in (lambda: bus.read(0), lambda: bus.write(0, 0)):
        with pytest.raises(HardwareError, match=rf"i2c-1 {message}: {os.strerror(number)}\.") as raised:
            step()
        assert type(raised.value) is fault


def test_a_second_program_is_kept_away(kernel, bus):
    with pytest.raises(HardwareError, match=r"i2c-1 is used by another program\."):
        LinuxRegisterBus(1, 0x2A)
    bus.close()
    bus.close()
    LinuxRegisterBus(1, 0x2A).close()


def test_a_bus_that_only_knows_smbus_is_refused_and_closed(kernel, devices):
    kernel.functions = SMBUS_ONLY
    with pytest.raises(HardwareError, match="it is not a full I²C bus"):
        LinuxRegisterBus(1, 0x2A)
    # not their number: what other tests have left open is closed at any time
    held = {os.path.realpath(descriptor) for descriptor in Path("/proc/self/fd").iterdir()}
    assert os.path.realpath(devices / "i2c-1") not in held


def test_a_bus_that_is_not_there_names_those_that_are(kernel, devices):
    assert linux_buses() == ("i2c:1", "i2c:20", "spi:0.0", "spi:0.1")
    with pytest.raises(HardwareError, match=r"there is no \S*i2c-7; ports of this kind: i2c:1, i2c:20, spi:0\.0, "):
        LinuxRegisterBus(7, 0x2A)
    for path in devices.iterdir():
        path.unlink()
    with pytest.raises(HardwareError, match=r"there is no \S*i2c-1; ports of this kind: none at all\."):
        LinuxRegisterBus(1, 0x2A)


def test_words_go_out_in_one_transfer_in_the_mode_of_the_switches(spi, devices):
    chain = SpiSwitchChain(0, 1)
    assert chain.shift(b"\x22\x11\x11\x11\x11\x11") is None
    port = spi()
    assert port.sent == [b"\x22\x11\x11\x11\x11\x11"]
    assert (port.path, port.mode, port.max_speed_hz, port.bits_per_word) == (f"{devices}/spidev0.1", 1, 1_000_000, 8)


@pytest.mark.parametrize(("number", "fault"), [(errno.ENODEV, DeviceLost), (errno.EIO, SwitchFault)])
def test_a_transfer_that_fails_has_a_name_and_a_port_that_is_not_there(spi, number, fault):
    with pytest.raises(HardwareError, match=r"there is no \S*spidev3\.2; ports of this kind: i2c:1"):
        SpiSwitchChain(3, 2)
    chain = SpiSwitchChain(0, 0)
    spi().fails = number
    with pytest.raises(fault, match=r"spidev0\.0"):
        chain.shift(bytes(6))


def test_a_board_is_opened_grounded_and_asleep_and_left_so(kernel, spi):
    with open_board("i2c:1,spi:0.1") as board:
        assert "I²C bus 1 and SPI 0.1 of this computer; LDC1614 (5449/3055)" in board.line
        assert not board.emulated
        assert (spi().sent, kernel.registers[0x1A]) == ([WIRING.safe_words], 0x2801)
        kernel.registers[0x1A] = 0x1401
        spi().held = bytes(6)
    assert (spi().held, kernel.registers[0x1A]) == (WIRING.safe_words, 0x2801)
    assert spi().closed == 1


def test_a_board_without_switches_needs_the_i2c_bus_alone(kernel, monkeypatch):
    monkeypatch.setitem(sys.modules, "spidev", None)
    with open_board("i2c:1?channels=0,1") as board:
        assert board.line.startswith("i2c:1?channels=0,1: I²C bus 1 of this computer; LDC1614 (5449/3055), channels")
        assert board.wiring.channels == (0, 1)
        assert kernel.transfers[0] == [(0x2A, 0, b"\x1a\x28\x01")]  # to sleep, before anything else
