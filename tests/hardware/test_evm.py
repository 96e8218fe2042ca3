"""The evaluation module: frames of public sources, what its firmware may answer, and what may happen on the way.

| what                                   | checked against                                             |
| -------------------------------------- | ----------------------------------------------------------- |
| commands and their CRC-8               | TI's FAQ (E2E 295036), four published frames                |
| answers and their CRC-8                | a block of a stream published in E2E 723630                 |
| both sets of commands, with and        | the emulated module; the second set is that of the public   |
| without checksums in the answers       | driver FDC2x14EVM, of which no answer is published          |
"""

import contextlib
import os
import select
import threading
import tty

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.emulated_evm import EmulatedEvm
from support.emulated_reader import plain
from support.quick_coils import plain_board
from support.refusals import refused

from coilarray.errors import HardwareError
from coilarray.hardware.board.autoscan import AutoscanReader
from coilarray.hardware.scan.readings import read_scan
from coilarray.hardware.scan.settings import scan_settings
from coilarray.hardware.scan.wiring import wired_to_channels
from coilarray.hardware.wire import serial_ports
from coilarray.hardware.wire.buses import ComputerClock
from coilarray.hardware.wire.evm import (
    EVM_USB,
    FAQ_COMMANDS,
    ONE_STEP_COMMANDS,
    REPLY_LENGTH,
    EvmRegisterBus,
    crc8,
    frame,
    open_evm,
)
from coilarray.hardware.wire.faults import BusFault, BusTimeout, DeviceLost, NoAnswer, NotABoard
from coilarray.hardware.wire.ports import found_ports, parse_port
from coilarray.hardware.wire.serial_ports import PortInfo

COMMANDS = {"FAQ": FAQ_COMMANDS, "one step": ONE_STEP_COMMANDS}
BLOCK = bytes.fromhex("4C3001 00092A 015142CB 01505FFF 1C" + 16 * "00" + "1C")


def module(**options):
    """An emulated module with its board, and the bus through it."""
    board = plain()
    evm = EmulatedEvm(board.bus, board.clock, **options)
    return evm, EvmRegisterBus(evm, 0x2A, board.clock)


@pytest.mark.parametrize(
    ("command", "payload", "published"),
    [
        (0x15, "2A 1B 82 0D", "4C 15 01 00 04 2A 1B 82 0D A3"),  # write 0x820D to register 0x1B
        (0x15, "2A 1B", "4C 15 01 00 02 2A 1B 10"),  # select it
        (0x14, "2A 02", "4C 14 01 00 02 2A 02 76"),  # read it
        (0x05, "01 29 04 04 30 2A", "4C 05 01 00 06 01 29 04 04 30 2A C1"),  # start a stream
        (0x06, "01", "4C 06 01 00 01 01 D2"),  # stop it
    ],
)
def test_commands_are_those_that_were_published(command, payload, published):
    assert frame(command, bytes.fromhex(payload)).hex(" ").upper() == published


def test_the_checksum_is_that_of_the_catalogue_and_of_a_published_block():
    assert crc8(b"123456789") == 0xF4  # check value of CRC-8, polynomial 0x07
    assert len(BLOCK) == REPLY_LENGTH
    end = 5 + BLOCK[4]
    assert BLOCK[end] == crc8(BLOCK[:end]) == BLOCK[-1]


@pytest.mark.parametrize("sealed", [True, False])
@pytest.mark.parametrize("commands", COMMANDS)
def test_registers_are_read_and_written_through_either_firmware(commands, sealed):
    _, bus = module(commands=COMMANDS[commands], sealed=sealed)
    assert (bus.commands, bus.sealed) == (COMMANDS[commands], sealed)
    assert (bus.read(0x7E), bus.read(0x7F)) == (0x5449, 0x3055)
    bus.write(0x08, 0xABCD)
    assert bus.read(0x08) == 0xABCD


@pytest.mark.parametrize("commands", COMMANDS)
def test_a_stream_that_another_program_left_is_ended(commands):
    evm, _ = module(commands=COMMANDS[commands])
    evm.write(frame(0x05, bytes.fromhex("01 29 04 04 30 2A")))
    assert evm.streaming
    bus = EvmRegisterBus(evm, 0x2A, evm._clock)
    assert not evm.streaming
    assert bus.read(0x7E) == 0x5449


def test_firmware_that_takes_none_of_the_commands_is_named_with_what_it_answers():
    refused(NotABoard, r"answers FF 00 4C and takes neither .* load the firmware", module, commands=None)


def test_a_port_where_nothing_answers_or_another_device_talks_is_named():
    refused(NoAnswer, "no evaluation module answers at emulated EVM", module, to_computer=lambda _: b"")
    refused(
        NotABoard, r"sends 8 bytes \(3C 30 30 2C 4F 4B 2A 0A\), which no", module, to_computer=lambda _: b"<00,OK*\n"
    )
    flood = lambda _: 100 * b"$GPGGA,123519"  # noqa: E731
    evm = EmulatedEvm(plain().bus, plain().clock)
    evm.read = lambda seconds: (evm._clock.sleep(1e-3), flood(0))[1]
    refused(NotABoard, "never stops sending", EvmRegisterBus, evm, 0x2A, evm._clock)


def test_a_converter_that_does_not_answer_its_module_is_a_fault_of_the_bus():
    evm, bus = module()
    evm._bus.refuse()
    refused(BusFault, r"reports error 0x02 for register 0x18\.", bus.read, 0x18)
    assert bus.read(0x7E) == 0x5449
    evm._bus.refuse(99)  # or from the beginning: the firmware is known by its answers
    assert EvmRegisterBus(evm, 0x2A, evm._clock).commands == FAQ_COMMANDS
    refused(BusFault, "reports error", EvmRegisterBus(evm, 0x2B, evm._clock).read, 0x7E)  # ADDR is low


def test_a_module_that_is_unplugged_is_lost():
    evm, bus = module()
    evm.unplugged = True
    refused(DeviceLost, "is gone", bus.read, 0x7E)
    refused(DeviceLost, "is gone", EvmRegisterBus, evm, 0x2A, evm._clock)
    bus.close()


def test_an_answer_that_comes_too_late_is_not_taken_for_the_next():
    evm, bus = module(commands=ONE_STEP_COMMANDS)  # whose answers say nothing of which reading they answer
    late = []
    evm._to_computer = lambda answer: late.append(answer) or b""
    refused(BusTimeout, "did not answer in 0.25 s", bus.read, 0x7F)
    evm._to_computer = bytes
    evm._going = late[0]
    assert bus.read(0x7E) == 0x5449


def _damaged(data, kind, place, value):
    place %= len(data)
    return {
        "flip": data[:place] + bytes([data[place] ^ value]) + data[place + 1 :],
        "drop": data[:place] + data[place + 1 :],
        "insert": data[:place] + bytes([value]) + data[place:],
        "cut": data[:place],
        "twice": data + data,
        "none": data,
    }[kind]


DAMAGE = st.tuples(
    st.sampled_from(["flip", "drop", "insert", "cut", "twice", "none"]), st.integers(0, 31), st.integers(1, 255)
)


@settings(max_examples=60)  # each with sixteen answers; the CRC-8 misses no single byte
@given(st.lists(DAMAGE, min_size=16, max_size=16), st.integers(1, 40))
def test_no_damage_to_one_place_of_an_answer_makes_a_wrong_value(damages, piece):
    evm, bus = module()
    coming, whole, waiting = iter(damages), evm.read, bytearray()

    def read(seconds):
        """At most this many bytes at a time, as USB may split them."""
        waiting.extend(b"" if waiting else whole(seconds))
        taken = bytes(waiting[:piece])
        del waiting[:piece]
        return taken

    evm.read = read
    evm._to_computer = lambda answer: _damaged(answer, *next(coming, ("none", 0, 1)))
    for _ in range(8):
        with contextlib.suppress(BusFault):
            assert bus.read(0x7E) == 0x5449
    evm._to_computer = bytes
    bus.clear()
    assert bus.read(0x7F) == 0x3055


class _OnPty:
    """An emulated module behind a pseudo-terminal, which pyserial opens."""

    def __init__(self):
        board = plain(clock=ComputerClock())
        self.evm = EmulatedEvm(board.bus, board.clock)
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        self.name = os.ttyname(self._slave)
        self._running = True
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self):
        while self._running:
            if select.select([self._master], [], [], 0.01)[0]:
                for byte in os.read(self._master, 4096):  # as slowly as USB can split it
                    self.evm.write(bytes([byte]))
            os.write(self._master, self.evm.read(0.0))

    def unplug(self):
        self._running = False
        self._thread.join()
        os.close(self._master)
        os.close(self._slave)


def test_a_real_port_is_opened_used_and_lost():
    pytest.importorskip("serial")
    there = _OnPty()
    try:
        bus = open_evm(there.name, 0x2A)
        assert bus.read(0x7E) == 0x5449
    finally:
        there.unplug()
    with contextlib.suppress(BusTimeout, DeviceLost):  # the first read after the end may only be empty
        bus.read(0x7E)
    refused(DeviceLost, "is gone", bus.read, 0x7E)
    bus.close()


def test_its_port_has_the_two_coils_and_the_clock_of_the_module():
    port = parse_port("evm:/dev/ttyACM0")
    assert (port.name, port.address) == ("/dev/ttyACM0", 0x2A)
    assert (port.board.channels, port.board.clock, port.board.converter.name) == ((0, 1), 40e6, "LDC1614")
    assert "protocol" in port.board.source
    other = parse_port("evm:usb:1234?channels=3&clock=internal&address=0x2B")
    assert (other.name, other.address, other.board.channels, other.board.clock) == ("usb:1234", 0x2B, (3,), None)
    for wrong in ("evm:", "evm:i2c:1", "evm:/dev/ttyACM0?baud=9600", "evm:/dev/ttyACM0?channels=4"):
        refused(HardwareError, "is not valid", parse_port, wrong)


def test_a_module_among_the_ports_has_the_name_that_opens_it(monkeypatch):
    listed = PortInfo("/dev/ttyACM1", *EVM_USB, "A1B2", "MSP430-USB Example")
    monkeypatch.setattr(serial_ports, "list_serial_ports", lambda: (listed,))
    (name,) = found_ports()["serial"]
    assert parse_port(name.split()[0]).name == "/dev/ttyACM1"


@pytest.mark.parametrize("sealed", [True, False])
@pytest.mark.parametrize("commands", COMMANDS)
def test_two_coils_are_scanned_through_the_module_as_without_it(commands, sealed):
    """The words are those that the chip gives by I²C: the module adds time, no noise and no fault."""
    wiring = wired_to_channels(("coil1", "coil2"), (0, 1))
    board = plain_board(wiring, noise=0.0, strict=True)
    settings = scan_settings(wiring, rcount=200, drives=7)
    through = EvmRegisterBus(
        EmulatedEvm(board.bus, board.clock, commands=COMMANDS[commands], sealed=sealed), 0x2A, board.clock
    )
    for bus in (through, board.bus):
        reader = AutoscanReader(bus, board.clock, kind="tested")
        reader.configure(settings)
        reading = read_scan(reader.scan(), settings, 120e-12)
        assert [state.verdict for state in reading.states] == ["good", "good"]
        assert list(reading.inductances.values()) == pytest.approx([50e-6, 51e-6], rel=2e-3)  # of losses: 1/Q²
        reader.rest()
    assert not board.misuse.notes
