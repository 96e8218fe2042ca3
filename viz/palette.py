"""Colours of all pictures, distinct with any colour vision."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypedDict

import numpy as np
import numpy.typing as npt

# Okabe & Ito (2008), "Color Universal Design", https://jfly.uni-koeln.de/color/. Yellow is left
# out, because it is too faint for thin lines on white.
BLUE = "#0072B2"
VERMILLION = "#D55E00"
GREEN = "#009E73"
PURPLE = "#CC79A7"
ORANGE = "#E69F00"
SKY = "#56B4E9"
WINE, INDIGO, OLIVE = "#7A2E5A", "#3B2A6B", "#5A4A00"  # dark, for areas on or beside the others
INK = "#202020"  # text and rulers
ON_MAP, ON_DARK = "#010101", "#fefefe"  # lines and text on colours, which a dark page leaves as they are
METAL = "#7C828A"  # indenters and targets
METALS = ("#A08050", "#5F7F9F", "#8F6F8F", "#6F8F6F")  # plates

COILS = (BLUE, VERMILLION, GREEN, PURPLE, ORANGE, SKY)
# After COILS each colour is as far as possible from all before it, in CIELAB and with any kind of
# cones missing.
MANY = (
    *COILS,
    "#8700F0", "#5A3C1E", "#C3C378", "#3C2DA5", "#870069", "#9687FF", "#F00F5A", "#F0B4B4", "#874B00", "#965AFF",
    "#00E13C", "#D20FB4", "#960F4B", "#78A53C", "#F07887", "#69693C", "#875A78", "#A50FD2", "#694B87", "#691E87",
    "#E1B4E1", "#A5D296", "#FF78E1", "#0F4B3C", "#D24BE1", "#5A00C3", "#FF5A3C", "#D20F1E", "#78B496", "#0000FF",
    "#2DC35A", "#87D25A", "#C36969", "#C32D3C", "#C378C3", "#B41E96", "#782D00", "#C34B96", "#C3A578", "#E1871E",
    "#FF96C3", "#1E4BC3", "#B40F69", "#3C4BFF", "#4BD2FF", "#3C87E1", "#B45A2D", "#A55AC3", "#3C875A", "#78C3C3",
    "#78A5FF", "#4B690F", "#B496C3", "#E1C33C", "#8778A5", "#D2964B", "#2D0FD2", "#005A5A",
)  # fmt: skip
"""Colours for 64 coils, 16 distinct for every eye."""
# Neighbours are alike, pairs of layers far apart. There are as many as layers of the thickest
# boards.
LAYERS = (
    VERMILLION, ORANGE, BLUE, SKY, PURPLE, GREEN, "#8700F0", "#9687FF", "#5A3C1E", "#C3C378", "#870069", "#F0B4B4",
    "#3C2DA5", "#965AFF", "#874B00", "#F00F5A",
)  # fmt: skip
KINDS = (*COILS, WINE, INDIGO, OLIVE)
"""Colours for areas: the coils', then three dark ones."""
COPPER = "#E8985A", "#6B3A1E"
"""Tones of the copper of the uppermost and of the lowest layer."""
LAMINATE = "#3F8F4F"
BOARDS = ("#9AA7B1", "#C2A13A", "#8A7296")  # copper of other boards in space, tinned, gilt and tinted
BARREL = "#8C6D1F"
SHEETS = ("#8FA3BF", "#7A3E8E", "#4A4A4A")  # light, dark, darker, distinct by lightness alone

GREY = "#909090"  # lines to compare with
PALE = "#B8B8B8"  # background items
FAINT = "#E4E4E4"  # grids
SHADE = "#EDEDED"  # areas behind curves
UNKNOWN = "#D0D0D0"  # parts of a map without a value

SEQUENTIAL = "viridis"
"""Perceptually uniform map of values of one sign."""
POSITIVE, NEGATIVE = "YlOrRd", "YlGnBu_r"
"""Warm and cold maps from a pale zero."""
DIVERGING = "RdBu_r"
"""Map of both signs about white: Brewer's colour-blind safe RdBu."""

_LINES = ("-", "--", ":")
_NEARNESS = 3  # power of the distance with which coils may look alike


class CurveLook(TypedDict):
    """Keywords of a curve."""

    color: str
    linestyle: str


def cycled(colours: Sequence[str], names: Sequence[str]) -> dict[str, str]:
    """Give each name a colour."""
    return {name: colours[k % len(colours)] for k, name in enumerate(names)}


def signed_colours(values: npt.ArrayLike, both: str = DIVERGING, share: float = 0.02) -> tuple[str, float, float]:
    """Colour map and its ends for values about zero.

    It is `both` if both signs exceed this `share` of the largest value.

    >>> signed_colours([0.1, -0.3]), signed_colours([-0.3, 0.001])
    (('RdBu_r', -0.3, 0.3), ('YlGnBu_r', -0.3, 0.0))
    """
    numbers = np.asarray(values, dtype=np.float64)
    finite = numbers[np.isfinite(numbers)]
    low, high = float(finite.min(initial=0.0)), float(finite.max(initial=0.0))
    largest = max(-low, high) or 1.0
    if min(-low, high) > share * largest:
        return both, -largest, largest
    return (NEGATIVE, -largest, 0.0) if low < -high else (POSITIVE, 0.0, largest)


def coil_colours(names: Sequence[str], centres: npt.ArrayLike | None = None) -> dict[str, str]:
    """Give each of up to 64 coils its own colour.

    Up to six have colours in order. More have colours by `centres` (coils, 2) in any unit, by
    default in a row, so that neighbours differ most.

    >>> coil_colours(["a", "b"])
    {'a': '#0072B2', 'b': '#D55E00'}
    """
    if len(names) <= len(COILS):
        return cycled(COILS, names)
    row = np.column_stack((np.arange(len(names)), np.zeros(len(names))))
    places = np.asarray(row if centres is None else centres, dtype=np.float64)
    return cycled([MANY[k] for k in _by_place(places[: len(MANY)])], names)


def _by_place(places: npt.NDArray[np.float64]) -> list[int]:
    """Choose different colours of `MANY` for places."""
    red, green, blue = np.array([[int(colour[k : k + 2], 16) / 255 for k in (1, 3, 5)] for colour in MANY]).T
    # Lightness, and each of the two differences of colour that remain if one kind of cones is
    # missing.
    axes = (2 * (0.299 * red + 0.587 * green + 0.114 * blue), blue - (red + green) / 2, red - green)
    light, cold, warm = (axis[:, None] - axis for axis in axes)
    apart = np.minimum(np.hypot(light, cold), np.hypot(light, warm))
    chosen = [0]
    for k in range(1, len(places)):
        near = np.linalg.norm(places[:k] - places[k], axis=1) ** _NEARNESS
        score = (apart[: len(places), chosen] * near).min(axis=1)
        score[chosen] = -1.0
        chosen.append(int(score.argmax()))
    return chosen


def curve_look(k: int) -> CurveLook:
    """Colour and line style of curve k, 18 are different."""
    return {"color": COILS[k % len(COILS)], "linestyle": _LINES[(k + k // len(COILS)) % len(_LINES)]}
