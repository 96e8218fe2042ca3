"""The capacitance of a sensor's tank, chosen for the converter."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

import xarray as xr

from coilarray.circuit.coupling import design_inductance
from coilarray.circuit.impedance import scan_design
from coilarray.design.model import Design
from coilarray.errors import DesignError, NetworkError
from coilarray.hardware.chips.ldc1614_limits import SENSOR_FREQUENCY, Limit, check_channel

_SMALLEST, _DECADES = 100e-12, 5  # F, below which strays would weigh too much
_SERIES = (1.0, 1.5, 2.2, 3.3, 4.7, 6.8)  # E6
_SHARE_OF_SELF_RESONANCE = 0.5  # to stay well below the converter's limit of 0.8
_STEPS, _DIGITS = 4, 3


def tank_capacitance(with_capacitance: Callable[[float], Design], frequency: float | None = None) -> float:
    """Choose the tank's capacitance.

    Parameters
    ----------
    with_capacitance : callable
        Returns the design of one coil with a capacitance in F.
    frequency : float, optional
        Frequency in Hz at which the tank is to oscillate. Without it the smallest capacitance of the series E6 from 100
        pF on is taken with which the converter keeps all its limits, at no more than half the coil's self-resonance:
        then frequency and quality factor are as high as may be. Where there is none, that which breaks the fewest.

    Returns
    -------
    float
        Capacitance in F.

    Raises
    ------
    DesignError
        A frequency that no capacitance gives, as it is above the coil's self-resonance.
    """
    if frequency is not None:
        return _for_frequency(with_capacitance, frequency)
    fewest, best = math.inf, _SMALLEST
    for capacitance in _series():
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
    """Return the frequency in Hz that `tank_capacitance` is likely to choose for an inductance in H.

    Windings are compared at it before there is a tank.

    Examples
    --------
    >>> round(expected_frequency(5e-6) * 1e-6, 2), round(expected_frequency(1e-6) * 1e-6, 2)
    (7.12, 10.0)
    """
    return min(1 / (2 * math.pi * math.sqrt(inductance * _SMALLEST)), SENSOR_FREQUENCY[1])


def broken_limits(scan: xr.Dataset, share_of_self_resonance: float = 1.0) -> list[tuple[str, Limit]]:
    """Limits of the LDC1614 that states break, each with the name of the state; `scan` is that of `scan_design`.

    The frequency may also be no more than a share of the coil's self-resonance.
    """
    names = ("frequency", "parallel_resistance", "loaded_quality_factor", "state_self_resonance")
    broken = []
    for state, *values in zip(scan.state.values.tolist(), *(scan[name].values.tolist() for name in names), strict=True):
        frequency, _, _, self_resonance = values
        share = Limit("frequency over self-resonance", frequency / self_resonance, 0, share_of_self_resonance)
        limits = (share, *check_channel(*values))
        broken += [(state, limit) for limit in limits if not limit.kept]
    return broken


def _series() -> Iterator[float]:
    for decade in range(_DECADES):
        for value in _SERIES:
            yield float(f"{value * _SMALLEST * 10**decade:.2g}")


def _for_frequency(with_capacitance: Callable[[float], Design], frequency: float) -> float:
    inductance = float(design_inductance(with_capacitance(_SMALLEST), accuracy="screen")[0][0, 0])
    wanted = capacitance = 1 / ((2 * math.pi * frequency) ** 2 * inductance)
    for _ in range(_STEPS):  # what the winding and the switches add is the same at all frequencies, nearly
        try:
            scan = scan_design(with_capacitance(capacitance), elastomer=False, accuracy="screen")
        except NetworkError:
            break
        total = 1 / ((2 * math.pi * float(scan.frequency[0])) ** 2 * inductance)
        capacitance += wanted - total
        if capacitance <= 0:
            break
    else:
        return float(f"{capacitance:.{_DIGITS}g}")
    raise DesignError(
        f"a coil of {inductance * 1e6:.4g} µH cannot oscillate at {frequency * 1e-6:g} MHz: the capacitance of its "
        "winding alone is too large for that."
    )
