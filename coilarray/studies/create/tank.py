"""Capacitance of a sensor's tank, chosen for the converter."""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import suppress

import xarray as xr

from coilarray.circuit.converter_limits import SENSOR_FREQUENCY, Limit, check_channel
from coilarray.circuit.coupling import design_inductance
from coilarray.circuit.impedance import scan_design
from coilarray.design.model import Design
from coilarray.errors import DesignError, NetworkError

_SMALLEST, _DECADES = 100e-12, 5  # F, below which strays would weigh too much
_SERIES = (1.0, 1.5, 2.2, 3.3, 4.7, 6.8)  # E6
_SHARE_OF_SELF_RESONANCE = 0.5  # well below the converter's limit of 0.8
_STEPS, _MET, _DIGITS = 10, 1e-4, 3
_E24 = (1.0, 1.1, 1.2, 1.3, 1.5, 1.6, 1.8, 2.0, 2.2, 2.4, 2.7, 3.0, 3.3, 3.6, 3.9, 4.3, 4.7, 5.1, 5.6, 6.2, 6.8, 7.5,
        8.2, 9.1)  # fmt: skip
_CLOSE = 0.01  # of the wanted frequency: required accuracy of a standard capacitance


def tank_capacitance(with_capacitance: Callable[[float], Design], frequency: float | None = None) -> float:
    """Choose the capacitance of the tank in F.

    For a `frequency` in Hz, on the mean of the coils, it is the nearest of the series E24 within 1
    %, otherwise exact with three digits. By default it is the smallest of E6 from 100 pF that keeps
    the converter's limits, or breaks the fewest, at no more than half the coil's self-resonance.
    Frequency and quality factor are then as high as possible.
    """
    if frequency is not None:
        return _for_frequency(with_capacitance, frequency)
    fewest, best = math.inf, _SMALLEST
    series = (float(f"{value * _SMALLEST * 10**decade:.2g}") for decade in range(_DECADES) for value in _SERIES)
    for capacitance in series:
        try:
            scan = scan_design(with_capacitance(capacitance), elastomer=False, accuracy="screen")
        except NetworkError:  # too much for the losses of the coil: nothing resonates with more either
            break
        broken = len(broken_limits(scan, _SHARE_OF_SELF_RESONANCE))
        if broken < fewest:
            fewest, best = broken, capacitance
        if not broken:
            break
    return best


def expected_frequency(inductance: float) -> float:
    """Return the frequency in Hz that `tank_capacitance` will likely choose.

    Windings are compared at this frequency before there is a tank.
    """
    return min(1 / (2 * math.pi * math.sqrt(inductance * _SMALLEST)), SENSOR_FREQUENCY[1])


def broken_limits(scan: xr.Dataset, share_of_self_resonance: float = 1.0) -> list[tuple[str, Limit]]:
    """List the LDC1614's broken limits with the states.

    The frequency may also be no more than a share of the coil's self-resonance. None are broken
    without a converter.
    """
    names = ("frequency", "parallel_resistance", "loaded_quality_factor", "state_self_resonance")
    broken: list[tuple[str, Limit]] = []
    if "readable" not in scan:
        return broken
    for state, *values in zip(scan.state.values.tolist(), *(scan[name].values.tolist() for name in names), strict=True):
        frequency, _, _, self_resonance = values
        share = Limit("frequency over self-resonance", frequency / self_resonance, 0, share_of_self_resonance)
        limits = (share, *check_channel(*values))
        broken += [(state, limit) for limit in limits if not limit.kept]
    return broken


def is_standard(capacitance: float) -> bool:
    """Whether a capacitance in F belongs to the series E24."""
    return math.isclose(capacitance, _nearest_standard(capacitance), rel_tol=1e-6)


def _nearest_standard(capacitance: float) -> float:
    """Return the nearest E24 value, by ratio."""
    decade = 10.0 ** math.floor(math.log10(capacitance))
    return min((value * decade for value in (*_E24, 10.0)), key=lambda value: abs(math.log(value / capacitance)))


def _for_frequency(with_capacitance: Callable[[float], Design], frequency: float) -> float:
    """Find the capacitance for a frequency, by a secant method."""

    def reached(capacitance: float) -> float:
        scan = scan_design(with_capacitance(capacitance), elastomer=False, accuracy="screen")
        return float(scan.frequency.mean())

    inductance = float(design_inductance(with_capacitance(_SMALLEST), accuracy="screen")[0].diagonal().mean())
    wanted = capacitance = 1 / ((2 * math.pi * frequency) ** 2 * inductance)
    slope, before, short_before = 1.0, 0.0, 0.0
    for _ in range(_STEPS):  # a secant: winding and switches add capacitance, and losses lower the frequency
        try:
            short = wanted - 1 / ((2 * math.pi * reached(capacitance)) ** 2 * inductance)
        except NetworkError:
            break
        if abs(short) <= _MET * wanted:
            return _rounded(capacitance, frequency, reached)
        if before:
            slope = (short_before - short) / (capacitance - before)
        before, short_before = capacitance, short
        capacitance += short / slope
        if capacitance <= 0:
            break
    raise DesignError(
        f"a coil of {inductance * 1e6:.4g} µH cannot oscillate at {frequency * 1e-6:g} MHz: the capacitance of its "
        "winding is too large for that, or its losses are."
    )


def _rounded(capacitance: float, frequency: float, reached: Callable[[float], float]) -> float:
    """Nearest standard value if close, or three digits."""
    standard = _nearest_standard(capacitance)
    with suppress(NetworkError):  # it may be too much for the losses, unlike the exact value
        if abs(reached(standard) / frequency - 1) <= _CLOSE:
            return standard
    return float(f"{capacitance:.{_DIGITS}g}")
