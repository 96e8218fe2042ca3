"""Names of ports, the board and the wiring behind each, and the line that says who answers."""

import sys
from types import SimpleNamespace

import pytest
from support.emulated_reader import WIRING, at_rest, plain, quick_settings, reader_of, settings_of
from support.quick_coils import plain_board
from support.refusals import refused

from coilarray import hardware
from coilarray.errors import HardwareError
from coilarray.hardware.board.connect import Board, open_board, wiring_of_board
from coilarray.hardware.emulator import board as emulator
from coilarray.hardware.emulator.board import Conditions
from coilarray.hardware.wire import buses, ports
from coilarray.hardware.wire.ports import ChannelBoard, EmulatorPort, FtdiPort, LinuxPort, SerialPort, parse_port

FTDI = "ftdi://ftdi:232h:FT1ABC/1"


@pytest.fixture(autouse=True)
def quick_emulator(monkeypatch):
    """Coils of given inductance in place of a design's, whose circuit takes seconds."""
    monkeypatch.setattr(emulator, "emulated_board", lambda design, wiring, **options: plain_board(wiring, **options))


def named(*names):
    """As much of a design as has the names of its coils."""
    return SimpleNamespace(array=SimpleNamespace(names=names))


@pytest.mark.parametrize(("text", "port"), [
    (" emulator ", EmulatorPort()),
    ("/dev/ttyACM0", SerialPort("/dev/ttyACM0")),
    ("com12", SerialPort("com12")),
    ("usb:000591234567", SerialPort("usb:000591234567")),
    ("/dev/ttyACM0?baud=9600", SerialPort("/dev/ttyACM0", 9600)),
    ("i2c:1", LinuxPort(1, 0x2A, 0, 0)),
    ("i2c:20:43,spi:1.2", LinuxPort(20, 0x2B, 1, 2)),
    ("i2c:1:0x2B,spi:0.1?mode=2&readback=yes", LinuxPort(1, 0x2B, 0, 1, mode=2, readback=True)),
    ("ftdi://ftdi:232h/1", FtdiPort("ftdi://ftdi:232h/1")),
    (f"{FTDI}?address=0x2B&mode=2&readback=no", FtdiPort(FTDI, 0x2B, mode=2)),
    ("emulator?channels=3,1", EmulatorPort(ChannelBoard((3, 1)))),
    ("i2c:1?channels=0,1&clock=40MHz", LinuxPort(1, board=ChannelBoard((0, 1), 40e6))),
    (f"{FTDI}?channels=2&clock=12000kHz", FtdiPort(FTDI, board=ChannelBoard((2,), 12e6))),
])  # fmt: skip
def test_names_of_ports(text, port):
    assert parse_port(text) == port


@pytest.mark.parametrize(("text", "words"), [
    *((text, "it must be emulator, a serial port") for text in ("", "emulater", "/dev/", "COM1234", "i2c:one", "ftdi:1",
                                                                "ftdi://ftdi:232h/9", "x" * 10000)),
    ("emulator?seed=1", "no option 'seed'"),
    ("i2c:1?channels=0&mode=2", "no option 'mode'"),
    ("COM5?channels=0", "no option 'channels'"),
    *((f"COM5?baud={baud}", "baud must be .* 1 to 10000000; got") for baud in ("0", "fast")),
    ("i2c:1:0x29", "address .* must be 0x2a or 0x2b"),
    *((f"i2c:1?mode={mode}", f"mode must be .* 0 to 3; got '{mode}'") for mode in ("5", "two", "1,spi:0.0")),
    ("i2c:1?mode=1&mode=2", "given twice"),
    *((f"i2c:1?{query}", "KEY=VALUE, joined by &") for query in ("mode", "")),
    ("i2c:1?readback=maybe", "readback must be yes or no"),
    *((f"i2c:1?channels={channels}", "channels must be numbers from 0 to 3") for channels in ("", "0,4", "10", "0,")),
    ("i2c:1?channels=0,0", "channels must be named once each"),
    *((f"i2c:1?channels=0&clock={clock}", "clock must be 2MHz to 40MHz") for clock in ("40", "41MHz", "fast", "1GHz")),
    ("emulator?clock=40MHz", "clock needs channels="),
    ("i2c:1,spi:0.0?channels=0", "no switches, and no spi"),
])  # fmt: skip
def test_anything_else_is_one_line(text, words):
    with pytest.raises(HardwareError, match=f"is not valid: .*{words}") as raised:
        parse_port(text)
    assert len(str(raised.value)) < 500
    assert "\n" not in str(raised.value)


def test_coils_of_a_design_come_to_the_channels_in_order():
    two = parse_port("i2c:1?channels=2,0")
    assert wiring_of_board(two, named("a", "b")).coils == ("a", "b")
    assert wiring_of_board(two, named("a", "b")).channel("a") == 2
    assert wiring_of_board(two, named("a")).channels == (2,)
    assert wiring_of_board(two, named("a", "b", "c"), coils=["c", "a"]).channel("c") == 2
    refused(HardwareError, r"2 channels \(2, 0\) for 3 coils; none is left for c", wiring_of_board, two,
            named("a", "b", "c"))  # fmt: skip
    refused(HardwareError, "no coil 'd' among a, b", wiring_of_board, two, named("a", "b"), coils=["d"])
    refused(HardwareError, "coils can be named only for a port with channels", wiring_of_board,
            parse_port("i2c:1"), named("a"), coils=["a"])  # fmt: skip


def test_a_wiring_of_the_other_kind_is_refused(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text('schema = 1\n[wiring]\ntitle = "mine"\nchannels = { a = 1, b = 3 }\n')
    assert wiring_of_board(parse_port("i2c:1?channels=0,1,2,3"), name=str(path)).channel("b") == 3
    for port, name, message in (
        ("i2c:1?channels=0,1", path, "coil at channel 3; the port has 0, 1"),
        ("i2c:1", path, "has coils at channels; give a port without switches"),
        ("i2c:1?channels=0", "six_coils", "has switches; a port with channels has none"),
    ):
        refused(HardwareError, message, wiring_of_board, parse_port(port), name=str(name))
    refused(HardwareError, "has switches", open_board, "emulator?channels=0", wiring=hardware.load_wiring())


def test_coils_at_channels_are_emulated_with_the_clock_of_the_port():
    with open_board("emulator?channels=0,3&clock=24MHz", conditions=Conditions(noise=0.0), strict=True) as board:
        assert "LDC1614 (5449/3055), channels 0, 3, 24 MHz at CLKIN; " in board.line
        settings = settings_of(board.wiring, rcount=200, drives=7, clock=24e6, external_clock=True)
        board.reader.configure(settings)
        reading = hardware.read_scan(board.reader.scan(), settings, 120e-12)
        # the clock at CLKIN is exact: a step of the code is at most 1e-7 of 2 MHz
        expected = [board.emulator.true_tank(channel).frequency for channel in (0, 3)]
        assert [state.frequency for state in reading.states] == pytest.approx(expected, rel=1e-7)
        assert board.emulator.misuse.notes == []
    assert board.emulator.chip.asleep


def test_the_emulator_is_the_default_and_says_so():
    with open_board() as board, open_board() as other:
        assert (board.emulated, board.identity.emulated) == (True, True)
        who = "emulator: emulator; LDC1614 (5449/3055); wiring six_coils"
        assert board.line == f"{who}; session {board.identity.boot:08X}"
        assert board.identity.boot != other.identity.boot
        board.reader.configure(quick_settings())
        board.reader.scan()
    assert at_rest(board.emulator)


def test_the_line_tells_a_converter_that_does_not_answer_or_is_another_chip():
    board = plain()
    board.bus.refuse(10**6)
    assert "; no converter answers; " in Board(reader_of(board), "emulator", WIRING).line
    board = plain()
    read = board.bus.read
    board.bus.read = lambda register: 0x3054 if register == 0x7F else read(register)
    assert "; another chip than the LDC1614 (5449/3054); " in Board(reader_of(board), "emulator", WIRING).line


def test_ports_of_this_computer_are_found_by_kind(monkeypatch):
    monkeypatch.setattr(ports.buses, "linux_buses", lambda: ("i2c:1",))
    monkeypatch.setattr(ports.buses, "ft232h_adapters", lambda: ("ftdi://ftdi:232h/1",))
    monkeypatch.setitem(sys.modules, "serial", None)
    found = {"emulator": ("emulator",), "serial": (), "linux": ("i2c:1",), "ftdi": ("ftdi://ftdi:232h/1",)}
    assert ports.found_ports() == found


def test_the_wiring_of_an_emulated_board_fits_its_design():
    assert wiring_of_board(EmulatorPort()) == WIRING
    assert wiring_of_board(EmulatorPort(), named(*WIRING.coils)) == WIRING
    with open_board(design=named("left", "right")) as board:
        assert board.wiring.coils == ("left", "right")
    # what is soldered is not guessed, and what is said counts
    assert wiring_of_board(SerialPort("COM5"), named("left", "right")) == WIRING
    assert wiring_of_board(EmulatorPort(), named("left", "right"), "six_coils") == WIRING


@pytest.mark.parametrize(("port", "rate"), [
    ("emulator", 400e3), ("COM5", 150e3), ("ftdi://ftdi:232h/1", 100e3),
    ("i2c:1", 50e3), ("i2c:7", 400e3),  # as the device tree says
    ("i2c:3", 100e3), ("i2c:4", 100e3),  # nothing, or nothing that makes sense
])  # fmt: skip
def test_the_clock_of_the_bus_is_that_of_the_port(monkeypatch, tmp_path, port, rate):
    for bus, node, held in (
        (1, "of_node", b"\x00\x00\xc3\x50"), (7, "device/of_node", b"\x00\x06\x1a\x80"), (4, "of_node", b"100"),
    ):  # fmt: skip
        (folder := tmp_path / f"i2c-{bus}" / node).mkdir(parents=True)
        (folder / "clock-frequency").write_bytes(held)
    monkeypatch.setattr(buses, "SYSTEM", tmp_path)
    assert ports.bus_rate(parse_port(port)) == rate
