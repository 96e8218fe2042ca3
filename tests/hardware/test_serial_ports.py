"""Serial ports: choosing among made-up lists, opening, and losing a pseudo-terminal in every way it can be lost."""

import os
import struct
from types import SimpleNamespace

import pytest
from support.patience import until

from coilarray.errors import HardwareError
from coilarray.hardware.board.microcontroller import open_microcontroller
from coilarray.hardware.wire.buses import DeviceLost, NoAnswer
from coilarray.hardware.wire.ports import OpenSerialPort, choose_serial_port, list_serial_ports
from coilarray.hardware.wire.protocol import LinkTimes

comports = pytest.importorskip("serial.tools.list_ports")
serial = pytest.importorskip("serial")


def entry(name, vid=None, serial_number=None, description=None):
    pid = None if vid is None else 0x0105
    return SimpleNamespace(device=name, vid=vid, pid=pid, serial_number=serial_number, description=description)


@pytest.fixture
def ports(monkeypatch):
    """The list of the system, to be filled."""
    listed = []
    monkeypatch.setattr(comports, "comports", lambda: listed)
    return listed


@pytest.fixture
def terminal():
    """Both ends of a pseudo-terminal and the name of the far one."""
    tty = pytest.importorskip("tty")  # not on Windows
    near, far = os.openpty()
    tty.setraw(far)
    ends = SimpleNamespace(near=near, far=far, name=os.ttyname(far))
    yield ends
    for end in (ends.near, ends.far):
        if end >= 0:
            os.close(end)


def send(terminal, data):
    """Write at the near end and wait until something is at the far one: the system takes it there when it has time."""
    import fcntl  # not on Windows
    import termios

    def arrived():
        (count,) = struct.unpack("i", fcntl.ioctl(terminal.far, termios.FIONREAD, bytes(4)))
        return count

    os.write(terminal.near, data)
    until(arrived)


def unplugged(terminal):
    os.close(terminal.near)
    os.close(terminal.far)
    terminal.near = terminal.far = -1


def test_ports_are_listed_in_words(ports):
    ports += [entry("/dev/ttyS0", description="n/a"), entry("/dev/ttyACM1", 0x1366, "000123", "J-Link")]
    assert [port.text for port in list_serial_ports()] == [
        "/dev/ttyACM1 1366:0105 usb:000123 (J-Link)", "/dev/ttyS0 (n/a)",
    ]  # fmt: skip


@pytest.mark.parametrize("name", ["usb:123", "usb:000123", "usb: 123"])
def test_a_serial_number_chooses_its_port_whatever_the_name(ports, name):
    ports += [entry("/dev/ttyS0"), entry("COM5", 0x1366, "0000123", "J-Link"), entry("COM6", 0x2341, "1234", "Arduino")]
    assert choose_serial_port(name).name == "COM5"
    assert choose_serial_port("COM6").serial_number == "1234"  # a name is taken as it is
    assert choose_serial_port("/dev/pts/7").serial_number == ""


@pytest.mark.parametrize(("name", "entries", "message"), [
    ("usb:7", [], "'7' is needed, but there is none: no serial port at all"),
    ("usb:7", [entry("COM1", 0x1366, "1", "a")], "'7' is needed, but there is none: COM1"),
    *((f"usb:{empty}", [entry("COM1", 0x1366, empty, "a")], f"'{empty}' is needed, but there is none")
      for empty in ("", "0")),
    ("usb:1", [entry("COM1", 0x1366, "1", "a"), entry("COM2", 0x1366, "01", "b")], "there are 2: COM1 .*, COM2"),
])  # fmt: skip
def test_an_unclear_choice_lists_what_there_is(ports, name, entries, message):
    ports += entries
    with pytest.raises(HardwareError, match=message):
        choose_serial_port(name)


@pytest.mark.parametrize(("error", "message"), [
    (PermissionError(13, "Permission denied"), "group dialout"),
    (OSError(16, "Device or resource busy"), "is used by another program"),
    (ValueError("Not a valid baudrate: -1"), "cannot be opened: Not a valid baudrate"),
    (OSError(5, "Input/output error"), "cannot be opened: .*Input/output"),
])  # fmt: skip
def test_reasons_of_the_system_are_told(monkeypatch, error, message):
    def refused(*_, **__):
        if isinstance(error, OSError):
            raise serial.SerialException(error.errno, f"could not open port: {error}") from error
        raise error

    monkeypatch.setattr(serial, "Serial", refused)
    with pytest.raises(HardwareError, match=message):
        OpenSerialPort("COM5")


@pytest.fixture
def port(terminal):
    return OpenSerialPort(terminal.name)


def test_a_port_is_opened_once(terminal, port):
    with pytest.raises(HardwareError, match="is used by another program"):
        OpenSerialPort(terminal.name)
    port.close()
    OpenSerialPort(terminal.name).close()


def test_bytes_go_both_ways_and_old_ones_are_thrown_away(terminal):
    send(terminal, b"old")
    port = OpenSerialPort(terminal.name)
    assert port.read(0.0) == b""
    send(terminal, b"new\n")
    assert port.read(1.0) == b"new\n"
    port.write(b"\x00\xffhello\r\n")
    assert os.read(terminal.near, 100) == b"\x00\xffhello\r\n"
    assert port.name == terminal.name


@pytest.mark.parametrize(("call", "argument"), [("read", 0.1), ("read", 0.0), ("write", b"x")])
def test_a_port_that_is_unplugged_is_lost(terminal, port, call, argument):
    unplugged(terminal)
    for _ in range(3):
        with pytest.raises(DeviceLost, match=f"{terminal.name} is gone"):
            getattr(port, call)(argument)
    port.close()
    port.close()


@pytest.mark.slow
def test_opening_what_does_not_answer_lets_go_of_the_port(terminal, ports):
    with pytest.raises(NoAnswer, match=r"did not answer STOP in 3 attempts"):
        open_microcontroller(terminal.name, times=LinkTimes(reply=0.05))
    OpenSerialPort(terminal.name).close()
