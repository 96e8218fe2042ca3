"""Customary units and digits for numbers in SI."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

_LARGEST_DIGITS, _MOST_DECIMALS = 4, 9
_SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


@dataclass(frozen=True)
class DisplayUnit:
    """Customary unit with its symbol, factor from SI and digits.

    `digits` are decimal places, by default as many as give the largest of the numbers four
    significant digits. With `significant` they are significant digits of each number.

    >>> display_unit("H").texts([58.0294e-6, -2.98254e-6]), display_unit("H").label("inductance")
    (['58.0294', '−2.9825'], 'inductance (µH)')
    >>> display_unit("1").texts([-0.051326, 0.0012]), PER_MILLION.texts([7.9e-4])
    (['−0.05133', '0.00120'], ['790.00'])
    >>> DisplayUnit(digits=3, significant=True).texts([5.152e-5, -0.1])
    ['5.15·10⁻⁵', '−0.1']
    >>> MM.of([0.0, 13.28e-3]).tolist(), MM.text(-13.28e-3), PER_MILLION.text(3e-7)
    ([0.0, 13.28], '−13.28 mm', '0.3·10⁻⁶')
    >>> PER_MILLION.text(8.4e-3, ".2")
    '8400·10⁻⁶'
    """

    symbol: str = ""
    factor: float = 1.0
    digits: int | None = None
    significant: bool = False

    def label(self, quantity: str) -> str:
        """Return the quantity's name with any unit in brackets."""
        return f"{quantity} ({self.symbol})" if self.symbol else quantity

    def texts(self, numbers: Sequence[float]) -> list[str]:
        """Return numbers in SI as texts in this unit."""
        shown = [number * self.factor for number in numbers]
        if self.significant:
            return [true_minus(_with_power(f"{number:.{self.digits or _LARGEST_DIGITS}g}")) for number in shown]
        digits = self.digits
        if digits is None:
            largest = max((abs(number) for number in shown if math.isfinite(number)), default=0.0)
            whole = largest == 0.0 or all(float(number).is_integer() for number in shown)
            wanted = 0 if whole else _LARGEST_DIGITS - 1 - math.floor(math.log10(largest))
            digits = min(max(wanted, 0), _MOST_DECIMALS)
        return [number_text(number, digits) for number in shown]

    def of(self, values: npt.ArrayLike) -> npt.NDArray[np.float64]:
        """Return values in SI as numbers in this unit."""
        import numpy as np  # not above: commands import this module before they set the number of threads of NumPy

        return np.asarray(values, dtype=np.float64) * self.factor

    def text(self, value: Any, digits: str = "") -> str:
        """Return a value in SI with unit, ``".3"`` digits."""
        between = "·" if self.symbol.startswith("10") else " "
        text = f"{float(value) * self.factor + 0.0:{digits}g}"
        text = f"{float(text):.0f}" if "e+" in text else _with_power(text)
        return true_minus(f"{text}{between}{self.symbol}".rstrip())


def number_text(number: float, digits: int, sign: str = "-") -> str:
    """Return a number with fixed decimals and true minus sign."""
    return true_minus(f"{round(number, digits) + 0.0:{sign}.{digits}f}")


def span(values: npt.ArrayLike, unit: DisplayUnit, digits: int) -> str:
    """Return the least and largest finite value with so many digits.

    >>> span([93.139e-6, 93.643e-6], display_unit("H"), 3), span([27e3, 27.01e3], KILOHM, 2)
    ('93.1–93.6 µH', '27 kΩ')
    """
    import numpy as np

    shown = unit.of(values)
    shown = shown[np.isfinite(shown)]
    if not shown.size:
        return "–"
    largest = float(np.abs(shown).max())
    decimals = max(digits - 1 - math.floor(math.log10(largest)), 0) if largest else 0
    low, high = (number_text(float(value), decimals) for value in (shown.min(), shown.max()))
    between = f"{low}–{high}" if float(shown.min()) >= 0 else f"{low} to {high}"
    return f"{low if low == high else between} {unit.symbol}".rstrip()


def value_text(value: object) -> str:
    """Return a value as text with up to six digits."""
    if value is None:
        return "–"
    if isinstance(value, float):
        return true_minus(_with_power(f"{value:.6g}"))
    return value if isinstance(value, str) else json.dumps(value)


def power_of_ten(exponent: int) -> str:
    """Return 10 to a power as text, such as 10⁻⁶."""
    return f"10{str(exponent).translate(_SUPERSCRIPT)}"


def _with_power(text: str) -> str:
    """Write a number's exponent as a power of ten."""
    mantissa, _, exponent = text.partition("e")
    return f"{mantissa}·{power_of_ten(int(exponent))}" if exponent else text


def true_minus(text: str) -> str:
    """Replace hyphens by minus signs, as wide as a plus."""
    return text.replace("-", "−")


PLAIN = DisplayUnit()
"""Numbers as they are."""
MM = DisplayUnit("mm", 1e3, 3)
"""Places and shapes. Pictures of boards are in mm."""
MILLI_DELTA = DisplayUnit("10⁻³", 1e3)
"""δ as an axis of its own, as in the figures of Gast & Zimmermann (2020)."""
KILOHM = DisplayUnit("kΩ", 1e-3, 2)
"""Parallel resistances."""
PERCENT = DisplayUnit("%", 100.0, 2)
"""Shares and relative changes."""
PPM = DisplayUnit("ppm", 1e6)
"""Relative changes in sentences and headings."""
PER_MILLION = DisplayUnit("10⁻⁶", 1e6, 2)
"""Relative changes of inductance, δ."""
_UNITS = {
    "1": DisplayUnit(),
    "A": DisplayUnit("µA", 1e6, 0),
    "A/A": DisplayUnit("A/A", 1.0, 5),
    "F": DisplayUnit("pF", 1e12, 2),
    "H": DisplayUnit("µH", 1e6, 4),
    "Hz": DisplayUnit("MHz", 1e-6, 4),
    "N": DisplayUnit("mN", 1e3, 2),
    "N/m": DisplayUnit("N/m", 1.0, 3),
    "T/A": DisplayUnit("µT/mA", 1e3, 4),
    "V": DisplayUnit("V", 1.0, 2),
    "m": DisplayUnit("mm", 1e3, 3),
    "ohm": DisplayUnit("Ω", 1.0, 3),
    "rad": DisplayUnit("mrad", 1e3, 3),
}


def display_unit(unit: str) -> DisplayUnit:
    """Return the customary unit for an SI unit."""
    return _UNITS.get(unit or "1", DisplayUnit(unit))
