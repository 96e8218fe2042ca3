"""Units of axes: the factor from SI to the numbers on an axis, and the prefixed unit in its label.

A label reads ``inductance (µH)`` and the ticks are plain numbers, on logarithmic axes too; no tick carries a unit.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
from matplotlib.axis import Axis
from matplotlib.ticker import EngFormatter, FuncFormatter, LogLocator, NullFormatter

if TYPE_CHECKING:
    import xarray as xr

FloatArray = npt.NDArray[np.float64]

_SYMBOLS = {"ohm": "Ω", "1": ""}  # of the units in datasets
_SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_MINUS = "\u2212"  # as wide as a plus, like the numbers on the axes


@dataclass(frozen=True)
class AxisUnit:
    """Unit of an axis.

    Parameters
    ----------
    factor : float
        Factor from SI to the numbers on the axis.
    symbol : str
        Unit with its prefix, as "µH", or a power of ten; empty for plain numbers.

    Examples
    --------
    >>> MM.label("x"), MM.of([0.0, 13.28e-3]).tolist(), MM.text(13.28e-3)
    ('x (mm)', [0.0, 13.28], '13.28 mm')
    """

    factor: float
    symbol: str

    def of(self, values: npt.ArrayLike) -> FloatArray:
        """Return the numbers on the axis for values in SI."""
        return np.asarray(values, dtype=np.float64) * self.factor

    def label(self, quantity: str) -> str:
        """Return the text of the axis: the quantity, and the unit in brackets where there is one."""
        return f"{quantity} ({self.symbol})" if self.symbol else quantity

    def text(self, value: float | xr.DataArray, digits: str = "") -> str:
        """Return a value in SI as a number with its unit; `digits` is a precision as in ``".3"``."""
        return f"{float(value) * self.factor:{digits}g} {self.symbol}".rstrip()


MM = AxisUnit(1e3, "mm")
"""Places and shapes: people read pictures of boards in mm."""
MILLI_DELTA = AxisUnit(1e3, "10⁻³")
"""δ as an axis of its own, as in the figures of Gast & Zimmermann (2020)."""
PLAIN = AxisUnit(1.0, "")
"""Numbers as they are."""


def axis_unit(values: npt.ArrayLike | xr.DataArray, unit: str | None = None) -> AxisUnit:
    """Choose the prefix that brings the largest of the values between 1 and 1000.

    Parameters
    ----------
    values : array_like
        Values in `unit`; those that are not finite are ignored.
    unit : str, optional
        SI unit without a prefix: "H", "ohm". For a pure number, "" or "1", the power of ten is written out. By default
        the unit in the attributes of `values`.

    Examples
    --------
    >>> axis_unit([58.2e-6, -3e-6], "H").label("L")
    'L (µH)'
    >>> axis_unit([7.9e-4], "1").label("δ"), axis_unit([19.5], "ohm").label("R")
    ('δ (10⁻⁶)', 'R (Ω)')
    """
    named = str(getattr(values, "attrs", {}).get("units", "1")) if unit is None else unit
    symbol = _SYMBOLS.get(named, named)
    array = np.asarray(values, dtype=np.float64)
    factor, prefixed = _prefixed(array[np.isfinite(array)], symbol)
    if symbol:
        return AxisUnit(factor, prefixed)
    exponent = -round(math.log10(factor))
    return AxisUnit(factor, f"10{str(exponent).translate(_SUPERSCRIPT)}" if exponent else "")


def _prefixed(values: FloatArray, unit: str) -> tuple[float, str]:
    """Return the factor and the unit with an SI prefix that bring the largest of the values between 1 and 1000."""
    largest = float(np.abs(values).max(initial=0.0))
    if largest == 0.0 or not math.isfinite(largest):
        return 1.0, unit
    # the small excess keeps 1000 (1 − 1e-16) from being shown as 1000 of the smaller unit
    exponent = min(max(3 * math.floor(math.log10(largest * (1 + 1e-12)) / 3), -24), 24)
    return 10.0**-exponent, EngFormatter.ENG_PREFIXES[exponent] + unit


def number_text(number: float, digits: int) -> str:
    """Return a number as text with a true minus sign, and none before a zero.

    Examples
    --------
    >>> number_text(-0.0004, 3), number_text(-12.35, 1)
    ('0.000', '−12.3')
    """
    return true_minus(f"{round(number, digits) + 0.0:.{digits}f}")


def true_minus(text: str) -> str:
    """Replace hyphens by minus signs, as wide as those on the axes."""
    return text.replace("-", _MINUS)


def logarithmic_ticks(axis: Axis, decades: float) -> None:
    """Write plain numbers on a logarithmic axis: 1, 2 and 5 of each decade where there are few."""
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if decades < 2.5 else (1.0,)))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())
