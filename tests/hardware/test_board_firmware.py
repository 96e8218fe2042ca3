"""The same board behind a microcontroller: the real firmware, compiled for this computer, on a pseudo-terminal.

What stands on the interface `Reader` alone must not see a difference.
"""

import contextlib
import random
import signal
import sys

import pytest
from support.emulated_reader import WIRING, at_rest, brown_out, plain, quick_settings, reader_of

if sys.platform == "win32":
    pytest.skip("no pseudo-terminals on Windows", allow_module_level=True)

from support.firmware_host import FirmwareHost, needs_compiler
from support.patience import PATIENCE
from support.refusals import raising

from coilarray.hardware.board.connect import open_board
from coilarray.hardware.scan.readings import read_scan
from coilarray.hardware.wire.buses import BoardRestarted, BusFault, CommandRefused, SwitchFault
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


@pytest.mark.parametrize("clock", [35e6, 55e6])
def test_the_firmware_waits_for_the_interrupt_of_every_converter(clock):
    with behind_firmware(plain(oscillator=clock)) as (_, opened):  # strict: a look before it raises
        opened.reader.configure(quick_settings(rcount=0x4000, discard=1))
        assert {sample.status for sample in opened.reader.scan().samples} == {0x0048}


@pytest.mark.slow
def test_whatever_fails_every_value_is_the_inductance_of_its_coil():
    """Faults in registers, nets and oscillators. Truth is the inductance that the coils of the emulator have.

    A switch that does not ground another coil than the measured one changes a value by what the two share, here 0.25 %,
    and no scan shows that: the self-test must name it, and does.
    """
    board, settings, noise = plain(strict=False), quick_settings(), random.Random(8)
    bus, chain, world, resistance = board.bus, board.chain, board.world, board.world.resistance
    wired = [(device, bit) for device in range(6) for bit in range(8) if chain.devices[device][bit] is not None]
    faults = {
        "hold": bus.hold, "refuse": lambda: bus.refuse(noise.randint(1, 60)),
        "brown-out": lambda: brown_out(board.chip),
        "loss": lambda: setattr(world, "resistance", noise.choice([200.0, 400.0])),
        "broken": lambda: setattr(chain, "broken", True),
    }  # fmt: skip
    plan = [("stick", *place, state) for place in wired for state in ("open", "closed")]
    plan += [(kind,) for kind in faults for _ in range(8)]
    accepted = 0

    def bad_of(scan):
        """Count the values of a scan, all of which must be right, and return how many states have none."""
        nonlocal accepted
        states = read_scan(scan, settings, world.capacitance).states
        for state in states:
            if state.inductance is not None:
                # losses pull the frequency by 1/Q², clamps by 1e-3; coils are 2 % apart
                assert state.inductance == pytest.approx(world.inductances[state.name], rel=6e-3), kind
                accepted += 1
        return sum(state.inductance is None for state in states)

    with behind_firmware(board) as (host, opened):
        opened.reader.configure(settings)
        for kind, *place in plan:
            with host.paused():
                chain.stick(*place) if place else faults[kind]()
            try:
                told = sum(bad_of(opened.reader.scan()) for _ in range(2))
            except (BoardRestarted, BusFault, SwitchFault, CommandRefused):
                told = True
            assert told or place, kind  # a switch may be stuck where it belongs
            with host.paused():
                chain.heal()
                bus.clear()
                bus.refuse(0)
                world.resistance, chain.broken = resistance, False
                board.clock.sleep(0.01)  # the converter starts again
            opened.reader.configure(settings)
            assert bad_of(opened.reader.scan()) == 0, kind
    assert accepted > 6 * len(plan)
