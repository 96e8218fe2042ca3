"""Names of ports, the board behind each, and the line that says who answers."""

import sys
from types import SimpleNamespace

import pytest
from support.emulated_reader import WIRING, at_rest, plain, quick_settings, reader_of
from support.quick_coils import plain_board
from support.refusals import refused

from coilarray.errors import HardwareError
from coilarray.hardware import emulator
from coilarray.hardware.board.connect import Board, open_board, wiring_of_board
from coilarray.hardware.emulator import Conditions, VirtualClock
from coilarray.hardware.wire import direct_buses as linux_host
from coilarray.hardware.wire import ports
from coilarray.hardware.wire.buses import ShiftSettings
from coilarray.hardware.wire.direct_buses import SwitchPins


@pytest.fixture(autouse=True)
def quick_emulator(monkeypatch):
    """Coils of given inductance in place of a design's, whose circuit takes seconds."""
    monkeypatch.setattr(emulator, "emulated_board", lambda design, wiring, **options: plain_board(wiring, **options))


@pytest.mark.parametrize(
    ("text", "port"),
    [
        ("emulator", ports.EmulatorPort()),
        (" emulator ", ports.EmulatorPort()),
        ("/dev/ttyACM0", ports.SerialPort("/dev/ttyACM0")),
        ("/dev/serial/by-id/usb-SEGGER_J-Link_1-if00", ports.SerialPort("/dev/serial/by-id/usb-SEGGER_J-Link_1-if00")),
        ("COM5", ports.SerialPort("COM5")),
        ("com12", ports.SerialPort("com12")),
        ("usb:000591234567", ports.SerialPort("usb:000591234567")),
        ("/dev/ttyACM0?baud=9600", ports.SerialPort("/dev/ttyACM0", (9600,))),
        ("COM5?baud=any", ports.SerialPort("COM5", (115200, 230400, 460800, 921600, 9600))),
        ("i2c:1", ports.LinuxPort(1, 0x2A, 0, 0)),
        ("i2c:1:0x2B", ports.LinuxPort(1, 0x2B, 0, 0)),
        ("i2c:20:43,spi:1.2", ports.LinuxPort(20, 0x2B, 1, 2)),
        (
            "i2c:1,spi:0.1?mode=2&speed=500000&order=lsb&readback=yes",
            ports.LinuxPort(1, 0x2A, 0, 1, ShiftSettings(2, 5e5, True, True)),
        ),
        ("ftdi://ftdi:232h/1", ports.FtdiPort("ftdi://ftdi:232h/1")),
        (
            "ftdi://ftdi:232h:FT1ABC/1?address=0x2B&clock=4&data=6&sync=1&back=7&mode=2&readback=no",
            ports.FtdiPort("ftdi://ftdi:232h:FT1ABC/1", 0x2B, SwitchPins(4, 6, 1, 7), ShiftSettings(2)),
        ),
    ],
)  # fmt: skip
def test_names_of_ports(text, port):
    assert ports.parse_port(text) == port


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", r"port '' is not valid: it must be emulator, a serial port \(/dev/ttyACM0, COM5 or usb:SERIALNUMBER"),
        *((text, "it must be emulator") for text in ("emulater", "/dev/", "COM", "COM1234", "usb:")),
        ("emulator?seed=1", "there is no option 'seed'"),
        *((text, "it must be emulator") for text in ("i2c:", "i2c:one", "i2c:1,spi:0")),
        *((f"/dev/ttyACM0?baud={baud}", "baud must be 1 to 10000000, or any") for baud in ("0", "fast")),
        ("/dev/ttyACM0?speed=9600", "there is no option 'speed'"),
        ("i2c:1:0x29", r"the address of the converter must be 0x2a or 0x2b"),
        ("i2c:1?mode=5", r"the mode of SPI must be 0 to 3; got 5"),
        ("i2c:1?mode=two", "mode must be a whole number"),
        ("i2c:1?mode=1&mode=2", "an option is given twice"),
        *((text, r"options after \? are KEY=VALUE, joined by &") for text in ("i2c:1?mode", "i2c:1?")),
        ("i2c:1?order=big", "order must be msb or lsb"),
        ("i2c:1?readback=maybe", "readback must be no or yes"),
        ("i2c:1?clock=3", "chip and clock need channels= or board="),
        ("i2c:1?speed=0", "speed of SPI must be positive"),
        *(
            (f"ftdi://{text}", "named as ftdi://ftdi:232h/1")
            for text in ("", "ftdi:232h", "ftdi:232h/?mode=1", "ftdi:232h/9")
        ),
        ("ftdi://ftdi:232h/1?", "options after"),
        ("ftdi://ftdi:232h/1?clock=8", "four different ones of C0 to C7"),
        ("ftdi://ftdi:232h/1?colour=red", "there is no option 'colour'"),
        ("x" * 10000, "is not valid"),
    ],
)
def test_anything_else_is_one_line(text, message):
    with pytest.raises(HardwareError, match=message) as raised:
        ports.parse_port(text)
    assert len(str(raised.value)) < 500
    assert "\n" not in str(raised.value)


def test_the_emulator_is_the_default_and_says_so():
    with open_board() as board, open_board() as other:
        assert (board.emulated, board.identity.emulated) == (True, True)
        who = "emulator: emulator; LDC1614 (5449/3055); wiring six_coils"
        assert board.line == f"{who}; session {board.identity.boot:08X}"
        assert board.identity.boot != other.identity.boot
        board.reader.configure(quick_settings())
        board.reader.scan()
    assert at_rest(board.emulator)


def test_options_of_the_emulator_are_passed_on():
    clock = VirtualClock()
    with open_board(clock=clock, conditions=Conditions(noise=0.0)) as board:
        assert board.emulator.clock is clock
        assert board.emulator.conditions.noise == 0.0
    refused(TypeError, "colour", open_board, colour="red")


def test_the_line_tells_a_converter_that_does_not_answer_or_is_another_chip():
    board = plain()
    board.bus.refuse(10**6)
    assert "; no converter answers; " in Board(reader_of(board), "emulator", WIRING).line
    board = plain()
    read = board.bus.read
    board.bus.read = lambda register: 0x3054 if register == 0x7F else read(register)
    assert "; another chip than the LDC1614 (5449/3054); " in Board(reader_of(board), "emulator", WIRING).line


def test_ports_of_this_computer_are_found_by_kind(monkeypatch):
    monkeypatch.setattr(ports, "linux_buses", lambda: ("i2c:1",))
    monkeypatch.setattr(ports, "ft232h_adapters", lambda: ("ftdi://ftdi:232h/1",))
    found = ports.found_ports()
    assert list(found) == ["emulator", "serial", "linux", "ftdi"]
    assert (found["emulator"], found["linux"], found["ftdi"]) == (("emulator",), ("i2c:1",), ("ftdi://ftdi:232h/1",))
    monkeypatch.setitem(sys.modules, "serial", None)
    assert ports.found_ports()["serial"] == ()


def named(*names):
    """As much of a design as has the names of its coils."""
    return SimpleNamespace(array=SimpleNamespace(names=names))


def test_the_wiring_of_an_emulated_board_fits_its_design():
    assert wiring_of_board(ports.EmulatorPort()) == WIRING
    assert wiring_of_board(ports.EmulatorPort(), named(*WIRING.coils)) == WIRING
    assert wiring_of_board(ports.EmulatorPort(), named("left", "right")).coils == ("left", "right")
    with open_board(design=named("left", "right")) as board:
        assert board.wiring.coils == ("left", "right")
    # what is soldered is not guessed, and what is said counts
    assert wiring_of_board(ports.SerialPort("COM5"), named("left", "right")) == WIRING
    assert wiring_of_board(ports.EmulatorPort(), named("left", "right"), "six_coils") == WIRING


@pytest.mark.parametrize(("port", "rate", "known"), [
    ("emulator", 400e3, True), ("COM5", 150e3, True), ("ftdi://ftdi:232h/1", 100e3, True),
    ("i2c:1", 100e3, True), ("i2c:7", 400e3, True),  # as the device tree of `system` says
    ("i2c:3", 100e3, False), ("i2c:4", 100e3, False),  # nothing, or nothing that makes sense
    ("i2c:3?rate=50000", 50e3, True), ("i2c:7:0x2B,spi:0.1?rate=100000&mode=2", 100e3, True),
])  # fmt: skip
def test_the_clock_of_the_bus_is_that_of_the_port(monkeypatch, tmp_path, port, rate, known):
    for bus, node, held in (
        (1, "of_node", b"\x00\x01\x86\xa0"), (7, "device/of_node", b"\x00\x06\x1a\x80"), (4, "of_node", b"100"),
    ):  # fmt: skip
        (folder := tmp_path / f"i2c-{bus}" / node).mkdir(parents=True)
        (folder / "clock-frequency").write_bytes(held)
    monkeypatch.setattr(linux_host, "SYSTEM", tmp_path)
    assert ports.bus_rate(ports.parse_port(port)) == (rate, known)
