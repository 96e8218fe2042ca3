"""Faults of converter and switches in the emulator's registers, nets and oscillators, behind the compiled firmware.

Truth is the inductance that the coils of the emulator have.

A switch that does not ground another coil than the measured one changes a value by what the two share, here 0.25 %, and
no scan shows that: the self-test must name it, and does.
"""

import random
import sys
import time

import pytest
from support import patience
from support.emulated_reader import brown_out, plain, quick_settings

if sys.platform == "win32":
    pytest.skip("no pseudo-terminals on Windows", allow_module_level=True)

from support.firmware_host import FirmwareHost, needs_compiler

from coilarray.hardware.board.microcontroller import MicrocontrollerReader
from coilarray.hardware.scan.readings import read_scan
from coilarray.hardware.wire.buses import BoardRestarted, BusFault, CommandRefused, SwitchFault
from coilarray.hardware.wire.ports import OpenSerialPort
from coilarray.hardware.wire.protocol import LinkTimes

pytest.importorskip("serial")
pytestmark = [needs_compiler, pytest.mark.usefixtures("patient_writing")]
OTHERS = 8  # faults of each kind but stuck switches
LONGEST = 0.05  # s: a scan in which no state has a result
TIMES = LinkTimes(reply=0.04, attempts=14, gap=3.0, least_gap=1.6, heartbeat=2.0, ping=0.05, foreign=200)
COMMAND = TIMES.attempts * (TIMES.reply + LONGEST)  # s until a command is given up
SLACK = 2.0  # s in which this process runs and computes instead of waiting
_COUNTED = 0.05  # s between two looks at the clock that count at most; a port is waited for in steps of 0.02 s


class DriverClock:
    """Real time for a driver whose board is a thread of the same process.

    What a busy computer takes away does not count: the board had no time to answer then either.
    """

    sleep = staticmethod(time.sleep)

    def __init__(self):
        self._seconds, self._last = 0.0, time.monotonic()

    def now(self):
        now = time.monotonic()
        self._seconds += min(now - self._last, _COUNTED)
        self._last = now
        return self._seconds


class Emulated:
    """The emulator's chips behind the firmware, and the inductance that they really have."""

    def __init__(self):
        self.board = plain(strict=False)
        self.settings = quick_settings()
        self.host = FirmwareHost(self.board.bus, self.board.chain, self.board.clock)
        self.reader = MicrocontrollerReader(OpenSerialPort(self.host.port), times=TIMES, clock=DriverClock())
        self.reader.configure(self.settings)
        self.accepted, self.wrong, self.bad = 0, [], 0

    def look(self, scan):
        capacitance = self.board.world.capacitance
        for state in read_scan(scan, self.settings, capacitance).states:
            if state.inductance is None:
                self.bad += 1
                continue
            self.accepted += 1
            true = self.board.world.inductances[state.name]
            # losses pull the frequency by 1/Q², clamps by 1e-3; coils are 2 % apart
            if abs(state.inductance / true - 1) > 6e-3:
                self.wrong.append((state, true))
        return scan


@pytest.mark.slow
def test_every_value_is_the_inductance_of_its_coil():
    bench, noise = Emulated(), random.Random(8)
    chip, bus, chain, world = bench.board.chip, bench.board.bus, bench.board.chain, bench.board.world
    places = [(device, bit) for device in range(6) for bit in range(8) if chain.devices[device][bit] is not None]
    stuck = [("stick", *place, state) for place in places for state in ("open", "closed")]
    others = {
        "hold": bus.hold, "refuse": lambda: bus.refuse(noise.randint(1, 60)),
        "brown-out": lambda: brown_out(chip),
        "loss": lambda: setattr(world, "resistance", noise.choice([200.0, 400.0])),
        "broken": lambda: setattr(bench.board.chain, "broken", True),
    }  # fmt: skip
    plan = [*stuck, *((kind,) for kind in others for _ in range(OTHERS))]
    resistance = world.resistance
    for kind, *arguments in plan:
        before = bench.bad
        with bench.host.paused():
            if kind == "stick":
                chain.stick(*arguments)
            else:
                others[kind]()
        named = False
        try:
            for _ in range(2):
                with patience.lasting(COMMAND + 1.0 + SLACK):
                    bench.look(bench.reader.scan())
        except (BoardRestarted, BusFault, SwitchFault, CommandRefused):
            named = True
        with bench.host.paused():
            chain.heal()
            bus.clear()
            bus.refuse(0)
            world.resistance = resistance
            bench.board.chain.broken = False
            bench.board.clock.sleep(0.01)  # the converter starts again
        assert named or bench.bad > before or kind == "stick", kind  # a switch may be stuck where it belongs
        bench.reader.configure(bench.settings)
        bad = bench.bad
        bench.look(bench.reader.scan())
        assert bench.bad == bad, kind
    bench.reader.close()
    bench.host.close()
    assert bench.wrong == []
    assert bench.accepted > 6 * len(plan)
