"""Numbers on a page.

Inductances, couplings, resonances and the margins to the fabrication rules.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr
from matplotlib import colormaps

from coilarray.circuit.coupling import couple_design, design_circuit, design_inductance
from coilarray.circuit.network import Network, checked_network
from coilarray.compute.arrays import FloatArray
from coilarray.compute.display_units import number_text, true_minus
from coilarray.design.model import Design
from coilarray.electromagnetics.inductance import Accuracy, coupling_matrix
from coilarray.geometry.rules import Margin, check_rules
from coilarray.viz.palette import DIVERGING

_DARK = 0.42  # luminance below which text on a colour is white
_SHOWN_MARGINS = 40


@dataclass(frozen=True, eq=False)
class Numbers:
    """Inductance matrix of a design.

    It is known while a slider moves.
    """

    names: tuple[str, ...]  # of the n coils
    inductance: FloatArray  # H, shape (n, n)
    accuracy: Accuracy

    @property
    def k(self) -> FloatArray:
        """Coupling coefficients, shape (n, n)."""
        return coupling_matrix(self.inductance)


@dataclass(frozen=True, eq=False)
class Circuit:
    """Circuit of a design as the converter sees it.

    Its solution takes seconds.
    """

    network: Network  # coils, switches and tank with all losses and strays
    coupling: xr.Dataset  # of `coilarray.circuit.coupling.couple_design`


@dataclass(frozen=True)
class Cell:
    """Cell of a matrix on the page."""

    text: str  # rounded number
    full: str  # name, number with all digits, and unit
    colour: str = "#FFFFFF"
    ink: str = "#202020"  # colour of the text


def numbers_of(design: Design, accuracy: Accuracy = "full") -> Numbers:
    """Compute the inductance matrix of a design.

    The design has its flat sheets. The accuracy "screen" is quick enough for a moving slider. Impossible coils, such as
    two in one place, raise a NetworkError.
    """
    inductance = checked_network(design_inductance(design, accuracy=accuracy)[0], 0.0)[0]
    return Numbers(design.array.names, inductance, accuracy)


def circuit_of(design: Design) -> Circuit:
    """Solve the circuit of a design.

    A state of its scan plan without a resonance raises a NetworkError.
    """
    return Circuit(design_circuit(design), couple_design(design))


def margins_of(design: Design) -> tuple[Margin, ...]:
    """Worst margin of every rule on every layer.

    The worst margin comes first.
    """
    worst: dict[tuple[str, str], Margin] = {}
    for margin in check_rules(design.array, design.rules):
        worst.setdefault((margin.rule, margin.layer), margin)
    return tuple(worst.values())[:_SHOWN_MARGINS]


def coupling_cells(numbers: Numbers) -> tuple[tuple[Cell, ...], ...]:
    """Cells of the coupling matrix.

    They have colours of both signs about zero. The diagonal is not coloured.
    """
    return _cells(numbers.k, numbers.names, lambda a, b, k: (number_text(k, 4, "+"), f"k({a}, {b}) = {k!r}"))


def inductance_cells(numbers: Numbers) -> tuple[tuple[Cell, ...], ...]:
    """Cells of the inductance matrix in µH.

    They are coloured like the cells of the coupling matrix.
    """

    def texts(a: str, b: str, L: float) -> tuple[str, str]:
        return true_minus(f"{L * 1e6:.3f}"), f"{'L' if a == b else 'M'}({a}, {b}) = {L!r} H"

    return _cells(numbers.inductance, numbers.names, texts)


def largest_of_two(matrix: FloatArray) -> float:
    """Largest magnitude off the diagonal.

    The colours end at this value. It is 0 for a single coil.
    """
    return float(np.abs(matrix[~np.eye(len(matrix), dtype=bool)]).max(initial=0.0))


def _cells(
    matrix: FloatArray, names: Sequence[str], texts: Callable[[str, str, float], tuple[str, str]]
) -> tuple[tuple[Cell, ...], ...]:
    """Make the cells of a matrix."""
    colours = _colours(matrix / (largest_of_two(matrix) or 1.0))
    rows = zip(names, matrix.tolist(), colours, strict=True)
    return tuple(
        tuple(
            Cell(*texts(a, b, value), *(() if a == b else colour))
            for b, value, colour in zip(names, row, its_colours, strict=True)
        )
        for a, row, its_colours in rows
    )


def coil_rows(numbers: Numbers, circuit: Circuit | None = None) -> tuple[tuple[str, ...], ...]:
    """Rows of the coils.

    A row has name, L and L_eff in µH, change in %, R in Ω, Q, resonance in MHz, and ideal L_eff in µH. Until the
    circuit is known, all values from L_eff on are "…".
    """
    rows = []
    for name, own in zip(numbers.names, np.diag(numbers.inductance).tolist(), strict=True):
        seen: tuple[str, ...] = ("…",) * 6
        if circuit is not None:
            one = circuit.coupling.sel(coil=name)
            seen = (
                f"{float(one.effective_inductance) * 1e6:.3f}",
                number_text(float(one.inductance_change) * 100, 2, "+"),
                f"{float(one.resistance):.2f}",
                f"{float(one.quality_factor):.1f}",
                f"{float(one.frequency) * 1e-6:.4f}",
                f"{float(one.ideal_effective_inductance) * 1e6:.3f}",
            )
        rows.append((name, f"{own * 1e6:.3f}", *seen))
    return tuple(rows)


def margin_rows(margins: Sequence[Margin]) -> tuple[tuple[str, str, str, str, str, str, bool], ...]:
    """Rows of the margins.

    A row has rule, layer, feature, value, limit, margin, and whether the rule is kept.
    """
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
    return true_minus(text)


def _colours(parts: FloatArray) -> list[list[tuple[str, str]]]:
    """Colours of a matrix, and legible inks on them.

    The values are from −1 to 1.
    """
    shades = colormaps[DIVERGING]((parts + 1) / 2)[..., :3]
    dark = shades @ (0.2126, 0.7152, 0.0722) < _DARK
    inks = np.where(dark, "#FFFFFF", Cell.ink).tolist()
    codes = np.rint(255 * shades).astype(int).tolist()
    return [
        [(f"#{red:02X}{green:02X}{blue:02X}", ink) for (red, green, blue), ink in zip(*row, strict=True)]
        for row in zip(codes, inks, strict=True)
    ]
