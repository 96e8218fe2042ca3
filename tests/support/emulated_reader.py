"""A quick emulated board with its driver, for tests of both and of what stands on them."""

import math

from coilarray.design.scan_states import paper_plan
from coilarray.hardware.board.direct import DirectReader
from coilarray.hardware.scan.settings import ConverterClock, Sensor, scan_settings
from coilarray.hardware.scan.wiring import load_wiring
from support.quick_coils import plain_board

WIRING = load_wiring()


def reader_of(board, *, bus=None, switches=None, clock=None, wiring=WIRING):
    """Return the driver of an emulated board; its buses may be wrapped."""
    buses = bus or board.bus, switches or board.chain, clock or board.clock
    return DirectReader(*buses, wiring.safe_words, kind="emulator", emulated=True)


def settings_of(
    wiring,
    plan=None,
    *,
    frequency=2e6,
    quality=60.0,
    drives=6,
    clock=None,
    external_clock=False,
    **options,
):
    """Settings of a scan; frequencies and quality factors by state or of all, drive currents by coil or of all."""

    def of(values, name):
        return values[name] if isinstance(values, dict) else values

    states = paper_plan(wiring.coils) if plan is None else plan
    sensors = {
        state.name: Sensor(of(frequency, state.name), of(quality, state.name), of(drives, state.measured[0][0]))
        for state in states
    }
    clock = ConverterClock(clock, external_clock)
    return scan_settings(wiring, plan, sensors=sensors, clock=clock, **options)


def quick_settings(wiring=WIRING, *, coils=None, **options):
    """Settings of short conversions."""
    plan = paper_plan(wiring.coils if coils is None else coils)
    return settings_of(wiring, plan, **{"rcount": 200, "drives": 7, **options})


def at_rest(board, wiring=WIRING):
    """Whether all coils are grounded and the converter sleeps."""
    return board.chain.words == wiring.safe_words and board.chip.asleep


def plain(**options):
    """An emulated board without noise that refuses undocumented use."""
    return plain_board(WIRING, **{"noise": 0.0, "strict": True, **options})


def brown_out(chip):
    """Drop the supply of a converter for a moment, which resets it."""
    chip.excused = True
    chip.write(0x1C, 0x8000)


def oscillation_frequency(inductance, capacitance, quality=math.inf):
    """Equation 1 of the data sheet: f = √(1 − 1/Q² − 5 ns/(Q √(LC))) / (2π √(LC))."""
    period = math.sqrt(inductance * capacitance)  # by 2π
    return math.sqrt(1 - 1 / quality**2 - 5e-9 / (quality * period)) / (2 * math.pi * period)


def result_words(code, flags=0):
    """DATA0_MSB and DATA0_LSB of a result; the flags are under-range, over-range, watchdog and amplitude."""
    return flags << 12 | code >> 16, code & 0xFFFF


def code_of(frequency, reference, divider=1):
    """Conversion result nearest to a frequency in Hz: f = divider · f_ref · code/2²⁸."""
    return round(frequency / (divider * reference) * (1 << 28))
