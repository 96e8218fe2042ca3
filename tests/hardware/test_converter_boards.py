"""Ports of boards without switches: their options, known boards, and the wiring of coils to channels."""

from types import SimpleNamespace

import pytest
from support.emulated_reader import settings_of
from support.quick_coils import plain_board
from support.refusals import refused

from coilarray import hardware
from coilarray.errors import HardwareError
from coilarray.hardware import emulator
from coilarray.hardware.board.connect import open_board, wiring_of_board
from coilarray.hardware.board.direct import AutoscanReader
from coilarray.hardware.chips.ldc1614 import CONVERTERS, converter
from coilarray.hardware.emulator import Conditions
from coilarray.hardware.wire.ports import BOARDS, board_of, parse_port


@pytest.fixture(autouse=True)
def quick_emulator(monkeypatch):
    """Coils of given inductance in place of a design's, whose circuit takes seconds."""
    monkeypatch.setattr(emulator, "emulated_board", lambda design, wiring, **options: plain_board(wiring, **options))


def named(*names):
    """As much of a design as has the names of its coils."""
    return SimpleNamespace(array=SimpleNamespace(names=names))


@pytest.mark.parametrize("start", ["i2c:1", "ftdi://ftdi:232h/1", "emulator"])
@pytest.mark.parametrize(("options", "name", "channels", "clock"), [
    ("channels=0", "LDC1614", (0,), None),
    ("channels=3,1", "LDC1614", (3, 1), None),
    ("channels=0,1&chip=ldc1612&clock=40MHz", "LDC1612", (0, 1), 40e6),
    ("channels=0,1,2,3&chip=FDC2214&clock=internal", "FDC2214", (0, 1, 2, 3), None),
    ("board=grove-ldc1612", "LDC1612", (0, 1), 40e6),
    ("board=Grove-LDC1612&channels=1&clock=12.5MHz", "LDC1612", (1,), 12.5e6),
    ("board=cartographer", "LDC1612", (0,), 24e6),
    ("board=btt-eddy&clock=12000kHz", "LDC1612", (0,), 12e6),
])  # fmt: skip
def test_options(start, options, name, channels, clock):
    board = board_of(parse_port(f"{start}?{options}"))
    assert (board.converter.name, board.channels, board.clock) == (name, channels, pytest.approx(clock))


@pytest.mark.parametrize(("text", "message"), [
    ("i2c:1?channels=", "channels must be numbers from 0 to 3"),
    ("i2c:1?channels=0,0", "channels must be named once each"),
    ("i2c:1?channels=0,4", "an LDC1614 has the channels 0 to 3; got 4"),
    ("i2c:1?channels=0,2&chip=LDC1612", "an LDC1612 has the channels 0 to 1; got 2"),
    ("i2c:1?channels=10", "channels must be numbers from 0 to 3"),
    ("i2c:1?channels=0&chip=LDC1314", "'LDC1314' has results of 12 bits"),
    ("i2c:1?channels=0&chip=555", "'555' is not known; use LDC1614, LDC1612, FDC2214, FDC2212"),
    *((f"i2c:1?channels=0&clock={clock}", "clock must be internal, or 2MHz to 40MHz at CLKIN")
      for clock in ("40", "41MHz", "1MHz", "fast", "nanMHz", "40GHz", "")),
    ("i2c:1?board=eddy", "board must be grove-ldc1612, btt-eddy, cartographer, mellow-fly, ldc1614evm"),
    ("i2c:1,spi:0.0?channels=0", "coils at the channels of a converter have no switches, and no spi"),
    ("i2c:1?channels=0&mode=2", "there is no option 'mode'"),
    ("i2c:1?chip=LDC1612", "chip and clock need channels= or board="),
    ("emulator?clock=40MHz", "chip and clock need channels= or board="),
    ("i2c:1?board=grove-ldc1612,spi:0.0", "spi comes before the options"),
    ("COM5?channels=0", "there is no option 'channels'"),
])  # fmt: skip
def test_what_is_not_valid_is_one_line(text, message):
    refused(HardwareError, message, parse_port, text)


def test_the_coils_of_a_design_come_in_order_and_may_be_named():
    two = parse_port("i2c:1?channels=2,0")
    assert wiring_of_board(two, named("a", "b")).coils == ("a", "b")
    assert wiring_of_board(two, named("a", "b")).channel("a") == 2
    assert wiring_of_board(two, named("a")).channels == (2,)
    assert wiring_of_board(two, named("a", "b", "c"), coils=["c", "a"]).channel("c") == 2
    refused(HardwareError, r"2 channels \(2, 0\) for 3 coils; none is left for c: .* a, b", wiring_of_board, two,
            named("a", "b", "c"))  # fmt: skip
    refused(HardwareError, "there is no coil 'd' among a, b", wiring_of_board, two, named("a", "b"), coils=["d"])
    refused(HardwareError, "coils can be named only for a port with channels instead of switches", wiring_of_board,
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


@pytest.mark.parametrize("name", list(BOARDS))
def test_every_known_board_is_emulated(name):
    with open_board(f"emulator?board={name}", conditions=Conditions(noise=0.0), strict=True) as board:
        known = BOARDS[name]
        assert isinstance(board.reader, AutoscanReader)
        assert f"{known.title}: {known.converter.name}, channel" in board.line
        settings = settings_of(board.wiring, rcount=200, drives=7, clock=known.clock, external_clock=True)
        board.reader.configure(settings)
        reading = hardware.read_scan(board.reader.scan(), settings, 120e-12)
        assert reading.verdict == "good"
        # the clock at CLKIN is exact: a step of the code is at most 1e-7 of 2 MHz
        expected = [board.emulator.true_tank(channel).frequency for channel in known.channels]
        assert [state.frequency for state in reading.states] == pytest.approx(expected, rel=1e-7)
        assert board.emulator.misuse.notes == []
    assert board.emulator.chip.asleep


def test_converters_by_name():
    assert [converter(name.lower()) for name in CONVERTERS] == list(CONVERTERS.values())
    assert [one.channels for one in CONVERTERS.values()] == [4, 2, 4, 2]
