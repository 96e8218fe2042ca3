"""Colours of all pictures, distinct with any colour vision, as tests/viz/test_plots_colours.py measures."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypedDict

# Okabe & Ito (2008), "Color Universal Design", https://jfly.uni-koeln.de/color/; yellow is left out, being too faint
# for thin lines on white.
BLUE = "#0072B2"
VERMILLION = "#D55E00"
GREEN = "#009E73"
PURPLE = "#CC79A7"
ORANGE = "#E69F00"
SKY = "#56B4E9"
WINE, INDIGO, OLIVE = "#7A2E5A", "#3B2A6B", "#5A4A00"  # dark, for what lies on or beside those
INK = "#202020"  # text and rulers

COILS = (BLUE, VERMILLION, GREEN, PURPLE, ORANGE, SKY)
LAYERS = (VERMILLION, ORANGE, BLUE, SKY, PURPLE, GREEN)  # neighbours alike, pairs of layers far apart
KINDS = (*COILS, WINE, INDIGO, OLIVE)
"""Colours for areas of more than six kinds: those of the coils, then three dark ones."""
LAMINATE = "#3F8F4F"
BARREL = "#8C6D1F"
SHEETS = ("#8FA3BF", "#7A3E8E", "#4A4A4A")  # light, dark, darker: distinct by lightness alone

GREY = "#909090"  # lines to compare with
PALE = "#B8B8B8"  # background items
FAINT = "#E4E4E4"  # grids
SHADE = "#EDEDED"  # areas behind curves
UNKNOWN = "#D0D0D0"  # parts of a map without a value

SEQUENTIAL = "viridis"
"""Map of values of one sign: perceptually uniform, and as dark to light as it is to any eye."""
DIVERGING = "RdBu_r"
"""Map of values of both signs about a white zero: Brewer's blue and red, which no colour blindness mixes up."""

_LINES = ("-", "--", ":")


class CurveLook(TypedDict):
    """Keywords of a curve."""

    color: str
    linestyle: str


def cycled(colours: Sequence[str], names: Sequence[str]) -> dict[str, str]:
    """Give each name a colour, starting over where there are more names than colours."""
    return {name: colours[k % len(colours)] for k, name in enumerate(names)}


def curve_look(k: int) -> CurveLook:
    """Return colour and line style of curve k; neighbours differ in both, and 18 curves are different.

    Examples
    --------
    >>> curve_look(0), curve_look(6)["linestyle"]
    ({'color': '#0072B2', 'linestyle': '-'}, '--')
    """
    return {"color": COILS[k % len(COILS)], "linestyle": _LINES[(k + k // len(COILS)) % len(_LINES)]}
