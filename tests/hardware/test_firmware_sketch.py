"""The whole sketch with its pins, compiled against a small Arduino.h and run on wires: I²C and SPI edge by edge."""

import ctypes
import functools
import itertools
import shutil
from types import SimpleNamespace

import pytest
from support.emulated_reader import settings_of
from support.firmware_chips import I2cSlave, ShiftRegisters, StubChain, StubConverter
from support.firmware_host import SKETCH, SUPPORT, compiled, draft, intact, logic_sources, needs_compiler, seal

from coilarray.hardware.emulator.board import VirtualClock
from coilarray.hardware.scan.wiring import load_wiring
from coilarray.hardware.wire.buses import BusFault

pytestmark = needs_compiler

SCL, SDA, DIN, SCLK, SYNC, DOUT = 10, 11, 1, 2, 3, 0
LOW_AT_FIRST, OPEN_DRAIN = (1, 3), 3  # modes of pins that drive
SETTINGS = settings_of(load_wiring(), rcount=900)
CODE = 0x17982F3
READ = [f"{CODE:08X}"] * 6
CALL = 0.9e-6  # s, of a call that moves a pin; about that of the core on the XMC1100

Mode = ctypes.CFUNCTYPE(None, ctypes.c_uint8, ctypes.c_uint8)
ReadPin = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_uint8)
Now = ctypes.CFUNCTYPE(ctypes.c_double)
Sleep = ctypes.CFUNCTYPE(None, ctypes.c_double)
Open = ctypes.CFUNCTYPE(None, ctypes.c_ulong)
Receive = ctypes.CFUNCTYPE(ctypes.c_int)
Send = ctypes.CFUNCTYPE(None, ctypes.c_uint8)


class Pins(ctypes.Structure):
    _fields_ = [("mode", Mode), ("write", Mode), ("read", ReadPin), ("analog", ReadPin), ("now", Now), ("sleep", Sleep),
                ("open", Open), ("receive", Receive), ("send", Send)]  # fmt: skip


@pytest.fixture(scope="module")
def build(tmp_path_factory):
    """Compile the sketch, as it is or with the end of the chain wired back; a fresh copy of its memory each time."""
    folder = tmp_path_factory.mktemp("sketch")

    @functools.cache
    def compile_one(wired_back):
        sources = shutil.copytree(SKETCH, folder / f"back-{wired_back}")
        if wired_back:
            board = sources / "board.h"
            text = board.read_text()
            assert "kDoutPin = kNoPin" in text
            board.write_text(text.replace("kDoutPin = kNoPin", f"kDoutPin = {DOUT}"))
        files = [str(sources / path.name) for path in (*logic_sources(), SKETCH / "arduino_hal.cpp")]
        files.append(str(SUPPORT / "sketch.cpp"))
        return compiled(folder, f"{wired_back}.so", "-shared", "-fPIC", *files, sketch=sources)

    copies = itertools.count()

    def load(wired_back=False):
        return ctypes.CDLL(str(shutil.copy(compile_one(wired_back), folder / f"copy-{next(copies)}.so")))

    return load


class Sketch:
    """The sketch on wires, and a computer at its port."""

    def __init__(self, library, *, answers=True, noise=0):
        self.clock = VirtualClock()
        self.converter = StubConverter(self.clock, lambda: CODE, conversion=SETTINGS.wait_us * 1e-6)
        self.converter.clock = SimpleNamespace(now=self.clock.now, sleep=lambda s: None)  # the wires take the time
        self.chain = StubChain(self.clock, self.converter)
        self.i2c = I2cSlave(self.converter, 0x2A if answers else 0x2B)
        self.spi = ShiftRegisters(self.chain, 6)
        self.modes, self.calls, self.coming, self.sent = {}, [], b"", bytearray()
        self.edges = []  # of SCL: time and level
        self.rise = 0.0  # s, of SCL
        self.number = -1
        self.noise = itertools.count(noise)
        self.library = library
        self.pins = Pins(Mode(self._mode), Mode(self._write), ReadPin(self._read), ReadPin(self._analog),
                         Now(self.clock.now), Sleep(self.clock.sleep), Open(self._open), Receive(self._receive),
                         Send(self._send))  # fmt: skip
        library.sketch_race.argtypes = [ctypes.c_double]
        library.sketch_install(ctypes.byref(self.pins))
        library.sketch_setup()

    def _mode(self, pin, mode):
        self.modes[pin] = mode
        self.calls.append(("mode", pin))
        self._level(pin, mode not in LOW_AT_FIRST)

    def _write(self, pin, level):
        assert self.modes[pin] in LOW_AT_FIRST
        self.clock.sleep(CALL)
        self._level(pin, bool(level))

    def _level(self, pin, level):
        if pin in (SCL, SDA):
            wire = "scl" if pin == SCL else "sda"
            before = self.i2c.scl
            self.i2c.drive(wire, level)
            if before != self.i2c.scl:
                self.edges.append((self.clock.now(), self.i2c.scl))
        elif pin in (DIN, SCLK, SYNC):
            self.spi.drive({DIN: "din", SCLK: "sclk", SYNC: "sync"}[pin], level)

    def _read(self, pin):
        self.clock.sleep(CALL)
        if pin == SCL and self.i2c.scl and self.edges and self.clock.now() < self.edges[-1][0] + self.rise:
            return 0
        return int({SCL: self.i2c.scl, SDA: self.i2c.sda, DOUT: self.spi.dout}[pin])

    def _analog(self, pin):
        self.clock.sleep(20e-6)
        return next(self.noise) * 7919 % 1024

    def _open(self, baud):
        self.calls.append(("open", baud))

    def _receive(self):
        byte, self.coming = self.coming[:1], self.coming[1:]
        return byte[0] if byte else -1

    def _send(self, byte):
        self.clock.sleep(10 / 115200)
        self.sent.append(byte)

    def ask(self, command):
        self.number += 1
        self.coming += seal(f">{self.number:02X},{command}")
        start = f"<{self.number:02X},".encode()
        for _ in range(20_000):
            self.library.sketch_loop(20)
            self.clock.sleep(20e-6)
            for line in bytes(self.sent).split(b"\n")[:-1]:
                if line.startswith(start):
                    return intact(line)[4:]
        raise AssertionError(f"no reply to {command}")

    def configure(self):
        return [self.ask(command) for command in draft(SETTINGS)][-1]

    def scan(self):
        return self.ask("SCAN").split(",")[-6:]


@pytest.fixture
def sketch(build):
    return Sketch(build())


@pytest.mark.slow
def test_coils_are_grounded_and_pins_at_rest_before_the_port_is_opened(sketch):
    assert sketch.chain.history[-1][0] == b"\x11" * 6
    assert ("write", 0x1A, 0x2801) in sketch.converter.log
    assert sketch.calls[-1] == ("open", 115200)
    # pins reach their rest without a start or stop: one is of the bus clear, one of what puts the converter to sleep
    assert (sketch.i2c.stops, sketch.i2c.misuse) == (2, [])
    assert sketch.modes[SCL] == sketch.modes[SDA] == OPEN_DRAIN
    assert (sketch.i2c.scl, sketch.i2c.sda) == (True, True)
    assert sketch.spi.level == {"din": sketch.spi.level["din"], "sclk": False, "sync": True}


def test_hello_and_scan_over_the_wires(sketch):
    assert ",5449,3055,32,16,-" in sketch.ask("HELLO")
    assert sketch.configure() == f"OK,{SETTINGS.hash:04X}"
    for address, value in SETTINGS.registers:
        assert sketch.converter.registers[address] == (value | 0x2000 if address == 0x1A else value)
    assert sketch.scan() == READ
    assert {state.words for state in SETTINGS.states} <= {words for words, _ in sketch.chain.history}
    assert all(slept for _, slept in sketch.chain.history[1:])
    assert (sketch.i2c.misuse, set(sketch.spi.frames[1:])) == ([], {48})


def test_clock_keeps_the_limits_of_the_converter(sketch):
    """10 to 400 kHz, as the data sheet of the converter has it, with pin calls as fast as on the XMC1100."""
    sketch.edges.clear()
    sketch.ask("PEEK,7F")
    rises = [time for time, level in sketch.edges if level]
    periods = sorted(later - earlier for earlier, later in itertools.pairwise(rises))
    assert periods[0] > 1 / 400e3
    assert periods[4 * 9 - 1] < 1 / 10e3  # of one transfer; what lies between two transfers is no period
    high = [after - before for (before, level), (after, _) in itertools.pairwise(sketch.edges) if level]
    assert min(high) > 0.6e-6  # s, of the fast mode of the bus


def test_no_acknowledgement_is_told_from_a_bus_that_is_held(sketch):
    sketch.configure()
    sketch.converter.fault = lambda verb, register: (_ for _ in ()).throw(BusFault("gone"))
    assert sketch.scan() == ["!1"] * 6
    sketch.converter.fault = lambda verb, register: None
    assert sketch.scan() == READ
    sketch.i2c.stuck_scl = True
    before = sketch.clock.now()
    assert sketch.scan() == ["!2"] * 6
    assert sketch.clock.now() - before < 0.1  # s; the guard is 1 ms a transfer
    sketch.i2c.stuck_scl = False
    assert (sketch.ask("STOP"), sketch.scan()) == ("OK", READ)


@pytest.mark.slow
def test_a_clock_that_slips_does_not_refuse_a_transfer(sketch):
    """The core's clock is 1 ms ahead where its tick falls into the reading; a slow edge has it read at every bit.

    With a single reading 129 of these 240 states were refused: the guard of a bus that is held is 1 ms too.
    """
    sketch.configure()
    sketch.rise = 4e-6
    sketch.library.sketch_race(1e-6)
    assert [word for _ in range(40) for word in sketch.scan()] == READ * 40


def test_nine_clocks_free_a_bus_that_the_converter_holds(sketch):
    """A reset of the microcontroller cuts a read off, and the slave waits in the middle of a zero for its clock."""
    sketch.i2c.holds_sda, sketch.i2c.sending, sketch.i2c.count = True, [0x00, 0xFF], 3
    sketch.i2c.receiving = sketch.i2c.acknowledging = False
    clocks = sketch.i2c.clocks
    assert (sketch.ask("STOP"), sketch.converter.log[-1]) == ("OK", ("write", 0x1A, 0x2801))
    # nine of the clear and one of its stop; the first try never came to a clock; four bytes and a start and a stop
    assert sketch.i2c.clocks - clocks == pytest.approx(10 + 36 + 2, abs=2)


@pytest.mark.slow
def test_chain_that_is_wired_back(build):
    sketch = Sketch(build(wired_back=True))
    assert sketch.ask("HELLO").endswith(",readback")
    assert sketch.configure().startswith("OK")
    assert (sketch.ask("CHAIN"), sketch.scan()) == ("OK,same", READ)
    sketch.spi.register[-1] ^= 1
    assert sketch.scan() == ["!5", *READ[1:]]


def test_boot_number_comes_from_the_noise_of_a_pin(build):
    numbers = {Sketch(build(), noise=start).ask("PING").split(",")[1] for start in range(20)}
    assert len(numbers) == 20
