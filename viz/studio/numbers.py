"""What a page shows in numbers: inductances, couplings, resonances and the margins to the fabrication rules."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import xarray as xr
from matplotlib import colormaps

from coilarray.circuit.coupling import couple, design_inductance, shorts_of
from coilarray.design.model import Design
from coilarray.electromagnetics.inductance import Accuracy
from coilarray.electromagnetics.resistance import dc_resistance
from coilarray.geometry.rules import Margin, check_rules
from coilarray.viz.palette import DIVERGING

FloatArray = npt.NDArray[np.float64]

_DARK = 0.42  # luminance below which text on a colour is white
_SHOWN_MARGINS = 40


@dataclass(frozen=True, eq=False)
class Numbers:
    """What follows from a design without an indentation.

    Parameters
    ----------
    coupling : xarray.Dataset
        As `coilarray.circuit.coupling.couple` returns it.
    accuracy : {"full", "screen"}
        Of the inductances.
    """

    coupling: xr.Dataset
    accuracy: Accuracy

    @property
    def names(self) -> tuple[str, ...]:
        """Of the coils."""
        return tuple(str(name) for name in self.coupling.coil.values)

    @property
    def inductance(self) -> FloatArray:
        """Inductance matrix in H."""
        return np.asarray(self.coupling.inductance.values, dtype=np.float64)

    @property
    def k(self) -> FloatArray:
        """Coupling coefficients."""
        return np.asarray(self.coupling.coupling.values, dtype=np.float64)


@dataclass(frozen=True)
class Cell:
    """One cell of a matrix on the page.

    Parameters
    ----------
    text : str
        Rounded.
    full : str
        With its name, unit and all digits.
    colour, ink : str
        Behind the text and of it.
    """

    text: str
    full: str
    colour: str = "#FFFFFF"
    ink: str = "#202020"


def numbers_of(design: Design, accuracy: Accuracy = "full") -> Numbers:
    """Compute inductances, couplings and resonances of a design under its flat sheets.

    Parameters
    ----------
    design : Design
        As `coilarray.load_design` returns it.
    accuracy : {"full", "screen"}
        As in `coilarray.inductance_matrix`; ``"screen"`` is for while a slider moves.

    Raises
    ------
    NetworkError
        Coils that cannot be, such as two in one place.
    """
    circuit = design.circuit
    result = couple(
        design.array.names,
        design_inductance(design, accuracy=accuracy)[0],
        dc_resistance(design.array.conductors(), circuit.resistivity),
        circuit.capacitance,
        shorts_of(design),
        circuit.short_resistance,
    )
    return Numbers(result, accuracy)


def margins_of(design: Design) -> tuple[Margin, ...]:
    """Return the worst margin of every rule on every layer, the worst first."""
    worst: dict[tuple[str, str], Margin] = {}
    for margin in check_rules(design.array, design.rules):
        worst.setdefault((margin.rule, margin.layer), margin)
    return tuple(worst.values())[:_SHOWN_MARGINS]


def coupling_cells(numbers: Numbers) -> tuple[tuple[Cell, ...], ...]:
    """Return the cells of the coupling matrix: colours of both signs about zero, the diagonal left out."""
    k, names = numbers.k, numbers.names
    apart = k[~np.eye(len(k), dtype=bool)]
    largest = float(np.abs(apart).max(initial=0.0)) or 1.0
    return tuple(
        tuple(
            Cell(_signed(value, 4), f"k({a}, {b}) = {value!r}", *_colours(None if a == b else value / largest))
            for b, value in zip(names, row, strict=True)
        )
        for a, row in zip(names, k.tolist(), strict=True)
    )


def inductance_cells(numbers: Numbers) -> tuple[tuple[Cell, ...], ...]:
    """Return the cells of the inductance matrix in µH, coloured as those of the coupling."""
    L, names = numbers.inductance, numbers.names
    apart = L[~np.eye(len(L), dtype=bool)]
    largest = float(np.abs(apart).max(initial=0.0)) or 1.0
    return tuple(
        tuple(
            Cell(
                f"{value * 1e6:.3f}".replace("-", "−"),
                f"{'L' if a == b else 'M'}({a}, {b}) = {value!r} H",
                *_colours(None if a == b else value / largest),
            )
            for b, value in zip(names, row, strict=True)
        )
        for a, row in zip(names, L.tolist(), strict=True)
    )


def coil_rows(numbers: Numbers) -> tuple[tuple[str, ...], ...]:
    """Return a row for each coil: name, L and L_eff in µH, change in %, R in Ω, Q and resonance in MHz."""
    data = numbers.coupling
    rows = []
    for name in numbers.names:
        one = data.sel(coil=name)
        rows.append(
            (
                name,
                f"{float(one.open_inductance) * 1e6:.3f}",
                f"{float(one.effective_inductance) * 1e6:.3f}",
                _signed(float(one.inductance_change) * 100, 2),
                f"{float(one.resistance):.2f}",
                f"{float(one.quality_factor):.1f}",
                f"{float(one.frequency) * 1e-6:.4f}",
            )
        )
    return tuple(rows)


def margin_rows(margins: Sequence[Margin]) -> tuple[tuple[str, str, str, str, str, str, bool], ...]:
    """Return a row for each margin: rule, layer, feature, value, limit, margin, and whether it is kept."""
    return tuple(
        (
            margin.rule,
            margin.layer or "board",
            margin.feature,
            _length(margin.value, margin.unit),
            _length(margin.limit, margin.unit),
            _length(margin.margin, margin.unit, sign="+"),
            margin.kept,
        )
        for margin in margins
    )


def _length(value: float, unit: str, sign: str = "-") -> str:
    text = f"{value * 1e3:{sign}.3f} mm" if unit == "m" else f"{value:{sign}.4g}"
    return text.replace("-", "−")


def _signed(value: float, digits: int) -> str:
    return f"{round(value, digits) + 0.0:+.{digits}f}".replace("-", "−")


def _colours(part: float | None) -> tuple[str, str]:
    """Colour of a value from −1 to 1, and ink that is read on it; white for what is left out."""
    if part is None:
        return "#FFFFFF", "#202020"
    red, green, blue, _ = colormaps[DIVERGING]((part + 1) / 2)
    dark = 0.2126 * red + 0.7152 * green + 0.0722 * blue < _DARK
    hexadecimal = "".join(f"{round(255 * part):02X}" for part in (red, green, blue))
    return f"#{hexadecimal}", "#FFFFFF" if dark else "#202020"
