"""The other way through the converter: the frequency of a tank, and the two words of a result."""

import math


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
