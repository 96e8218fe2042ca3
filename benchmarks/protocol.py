"""The protocol of the boards: scans per second over a line of 115200 baud, its cost, and its memory in ten minutes.

The compiled firmware runs on stand-ins for its chips. Its time is virtual: every byte takes the time that a UART of
115200 baud needs, every wait and every transfer to a chip its own.
"""

from __future__ import annotations

import gc
import itertools
import sys
import time
import tracemalloc
from collections import deque
from pathlib import Path

from speed import Speed

sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))
from support.firmware_chips import StubChain, StubConverter
from support.firmware_host import COMPILER, Firmware, FirmwareHost

from coilarray.hardware.board.microcontroller import MicrocontrollerReader
from coilarray.hardware.emulator.board import VirtualClock
from coilarray.hardware.scan.settings import ScanSettings, scan_settings
from coilarray.hardware.scan.wiring import load_wiring
from coilarray.hardware.wire.ports import OpenSerialPort
from coilarray.hardware.wire.protocol import LinkTimes

RATE = 100.0  # scans/s
SCANS = 2000
MINUTES = 10


def _fastest() -> ScanSettings:
    """Six coils in short conversions: a scan and its line take about the same time, one beside the other."""
    return scan_settings(load_wiring("six_coils"), rcount=50)


def _chips(clock: VirtualClock, settings: ScanSettings) -> tuple[StubConverter, StubChain]:
    converter = StubConverter(clock, conversion=settings.wait_us * 1e-6)
    chain = StubChain(clock, converter)
    converter.log, chain.history = deque(maxlen=0), deque(maxlen=0)  # which would grow
    return converter, chain


class FirmwarePort:
    """The firmware without a port: bytes go from one to the other, and time passes while they are waited for."""

    name = "firmware"

    def __init__(self, settings: ScanSettings) -> None:
        self.clock = VirtualClock()
        self._firmware = Firmware(*_chips(self.clock, settings), self.clock)

    def read(self, seconds: float) -> bytes:
        """Return what has come within so long."""
        end = self.clock.now() + seconds
        data = self._firmware.take()
        while not data and self.clock.now() < end:
            data = self._firmware.run(min(5e-3, end - self.clock.now()))
        return data

    def write(self, data: bytes) -> None:
        """Hand over."""
        self._firmware.feed(data)

    def close(self) -> None:
        """Free the firmware."""
        self._firmware.close()


def _throughput() -> tuple[float, float]:
    """Return scans per second of the board's time through a pseudo-terminal, and the driver's own time of one in s."""
    settings, clock = _fastest(), VirtualClock()
    with FirmwareHost(*_chips(clock, settings), clock) as host:
        reader = MicrocontrollerReader(OpenSerialPort(host.port), times=LinkTimes(ping=0.05))
        reader.configure(settings)
        stream = reader.scans()
        start = time.thread_time()
        scans = list(itertools.islice(stream, SCANS))
        cost = (time.thread_time() - start) / SCANS
        lost = scans[-1].sequence - scans[0].sequence + 1 - SCANS
        stream.close()
        reader.close()
    if lost:
        raise RuntimeError(f"{lost} scans were lost on a line without faults")
    return (SCANS - 1) / (scans[-1].time - scans[0].time), cost


def _resident() -> int:
    """Bytes of memory of this process."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * 4096


def _growth(rate: float, *, traced: bool) -> tuple[int, int, float]:
    """Return bytes by which memory grows from the first virtual minute to the last, the scans, and real s."""
    settings = _fastest()
    port = FirmwarePort(settings)
    reader = MicrocontrollerReader(port, clock=port.clock)
    reader.configure(settings)
    start, used = time.perf_counter(), 0
    stream = reader.scans(1 / rate)
    first = next(stream).time
    marks = iter((60.0, 60.0 * MINUTES))
    if traced:
        tracemalloc.start()
    try:
        mark = next(marks)
        for scan in stream:
            if scan.time - first < mark:
                continue
            gc.collect()
            now = tracemalloc.get_traced_memory()[0] if traced else _resident()
            used, growth = now, now - used
            mark = next(marks, None)
            if mark is None:
                break
    finally:
        tracemalloc.stop()
    count = scan.sequence
    stream.close()
    reader.close()
    return growth, count, time.perf_counter() - start


def figures() -> list[Speed]:
    """Take all figures; about half a minute."""
    if COMPILER is None:
        return []
    rate, cost = _throughput()
    growth, count, seconds = _growth(RATE, traced=False)
    traced, _, _ = _growth(RATE / 10, traced=True)
    return [
        Speed(
            "scans of six coils, 115200 baud", rate, "1/s",
            f"by the board's clock; the driver takes {cost * 1e6:.0f} µs of one core for each", "≥ 100/s", rate >= 100,
        ),
        Speed(
            f"memory, minute {MINUTES} less minute 1", growth / 1e6, "MB",
            f"{count} scans in {seconds:.0f} s; in a tenth of them {traced / 1e3:.1f} kB of Python's own",
            "≤ 1 MB", growth <= 1e6 and traced <= 2e4,
        ),
    ]  # fmt: skip


if __name__ == "__main__":
    for figure in figures():
        print(f"{figure.what}: {figure.value:.3g} {figure.unit} ({figure.note}) {figure.goal} {figure.kept}")
