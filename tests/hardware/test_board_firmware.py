"""The same board behind a microcontroller: the real firmware, compiled for this computer, on a pseudo-terminal.

What stands on the interface `Reader` alone must not see a difference.
"""

import contextlib
import signal
import sys

import pytest
from support.coupled_coils import coupled_board
from support.emulated_reader import WIRING, at_rest, plain, quick_settings, reader_of

if sys.platform == "win32":
    pytest.skip("no pseudo-terminals on Windows", allow_module_level=True)

from support.firmware_host import FirmwareHost, needs_compiler
from support.patience import PATIENCE
from support.refusals import raising

from coilarray.hardware.board.connect import open_board
from coilarray.hardware.board.self_test import self_test
from coilarray.hardware.emulator import Oscillator
from coilarray.hardware.scan.wiring import load_wiring
from coilarray.hardware.wire.protocol import LinkTimes

pytestmark = [needs_compiler, pytest.mark.usefixtures("patient_writing")]
SETTINGS = quick_settings(drives=8, quality=150.0)
# nothing is lost here; but a board in a thread stands still with the driver, whose time goes on meanwhile
TIMES = LinkTimes(reply=PATIENCE / 3, least_gap=PATIENCE, heartbeat=PATIENCE)


@contextlib.contextmanager
def behind_firmware(board, wiring=WIRING):
    """Give the firmware with the chips of a board, and the board as it is opened through it."""
    with (
        FirmwareHost(board.bus, board.chain, board.clock, safe_words=wiring.safe_words) as host,
        open_board(host.port, wiring=wiring, times=TIMES) as opened,
    ):
        yield host, opened


@pytest.mark.parametrize("discard", [0, 2])
def test_samples_are_the_same_as_of_the_chips_driven_directly(discard):
    settings = quick_settings(discard=discard, rcount=0x4000, clock=43.4e6)
    direct = reader_of(plain())
    direct.configure(settings)
    wanted = direct.scan()
    with behind_firmware(plain()) as (_, opened):
        opened.reader.configure(settings)
        scan = opened.reader.scan()
    # without noise: the same words to the last bit
    assert (scan.samples, scan.configuration) == (wanted.samples, wanted.configuration)


@pytest.mark.slow
def test_the_chain_can_be_asked_through_the_firmware():
    board = plain()
    with behind_firmware(board) as (host, opened):
        assert (opened.emulated, opened.emulator) == (False, None)
        assert f"LDC1614 (5449/3055); wiring six_coils; session {host.boot:08X}" in opened.line
        assert opened.check_chain() in ("same", "none")
        with host.paused():
            board.chain.broken = True
        assert opened.check_chain() in ("differ", "none")


@pytest.mark.parametrize(
    ("way_out", "error"),
    [
        (lambda: None, type(None)),
        (raising(KeyboardInterrupt()), KeyboardInterrupt),
        (raising(RuntimeError("mistake")), RuntimeError),
        (lambda: signal.raise_signal(signal.SIGTERM), SystemExit),
    ],
    ids=["the end", "Ctrl-C", "an exception", "SIGTERM"],
)
def test_leaving_in_the_middle_of_a_stream_grounds_the_coils(way_out, error):
    board, met = plain(), None
    with FirmwareHost(board.bus, board.chain, board.clock, safe_words=WIRING.safe_words) as host:
        try:
            with open_board(host.port, times=TIMES) as opened:
                opened.reader.configure(SETTINGS)
                stream = opened.reader.scans()
                next(stream)
                way_out()
        except BaseException as left_by:
            met = left_by
        with host.paused():
            assert at_rest(board)
    assert isinstance(met, error)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["six_coils", "six_coils_4"])
def test_a_good_board_passes_its_self_test(name):
    wiring = load_wiring(name)
    board = coupled_board(wiring)
    with behind_firmware(board, wiring) as (host, opened):
        result = self_test(opened.reader, wiring, quick_settings(wiring, drives=8, quality=150.0))
        with host.paused():
            assert at_rest(board, wiring)
    assert (result.symptoms, result.findings) == ((), ())


@pytest.mark.parametrize("clock", [35e6, 55e6])
def test_the_firmware_waits_for_the_interrupt_of_every_converter(clock):
    with behind_firmware(plain(oscillator=Oscillator(clock))) as (_, opened):  # strict: a look before it raises
        opened.reader.configure(quick_settings(rcount=0x4000, discard=1))
        assert {sample.status for sample in opened.reader.scan().samples} == {0x0048}
